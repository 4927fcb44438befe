# From a fresh clone: `make demo` shows treadlink, `make hub` is a hub to connect to, `make test` checks it, `make docs` builds its documentation.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMP := $(VENV)/.installed
DOCS_VENV := .venv-docs
DOCS_STAMP := $(DOCS_VENV)/.installed

# Of `make nightly`: another one every day.
SEED ?= $(shell date +%Y%m%d)

# Locks name versions and hashes for every system and Python, and no address to download from.
LOCK := $(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes \
  --no-header --no-annotate --upgrade
# Of the last commit: two builds of it are equal to the byte.
export SOURCE_DATE_EPOCH ?= $(shell git log -1 --format=%ct 2>/dev/null || echo 315532800)
# Without bytecode each worker and each child process of the tests would compile the gateway again.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo hub core test nightly coverage lint types bench firmware firmware-packages docs docs-pages docs-serve dist sbom locks clean

$(STAMP): requirements.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "treadlink needs Python 3.11 or newer; '$(PYTHON)' is older. Try: make PYTHON=python3.12 $(MAKECMDGOALS)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	@touch $@

demo: $(STAMP)
	@mkdir -p recordings
	$(BIN)/treadlink live sim:town --duration 30 --record recordings/

# A hub on this computer: the reference collector behind a TCP port, a wheel played from a file as its sensor.
PORT ?= 5000
CC ?= cc

hub: $(STAMP)
	$(BIN)/treadlink protocol collector --force --out build/hub > /dev/null
	$(CC) -std=c11 -O2 -D_POSIX_C_SOURCE=200809L -Ibuild/hub build/hub/*.c build/hub/ports/host/host_collector.c -o build/hub/host_collector
	build/hub/host_collector --tcp $(PORT) --sensor build/hub/ports/host/wheel.csv --flash build/hub/flash

# The compiled core in this tree, as the installation builds it; without a C compiler the same functions in numpy are used.
core: $(STAMP)
	@$(BIN)/python hatch_build.py || true

test: lint types core
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow"

# Every test, hypothesis with fresh examples, then a longer fuzz. A failure prints what repeats it.
nightly: $(STAMP)
	@echo "seed $(SEED): repeat with make nightly SEED=$(SEED)"
	@status=0; \
	  $(BIN)/python -m pytest -n 2 --dist worksteal --hypothesis-profile nightly --hypothesis-seed $(SEED) || status=1; \
	  $(BIN)/python -m tools.fuzz_files --count 20000 --seed $(SEED) || status=1; \
	  exit $$status

# Coverage imports modules, and writes its counts onto the full disk, in these tests of what a command does.
NOT_COVERED := tests/reliability/test_recording_survives.py::test_full_disk_stops_the_recording_only \
  tests/test_import_rules.py::test_help_imports_nothing_heavy \
  tests/test_import_rules.py::test_completion_of_commands_imports_no_command

# Lines and branches by room; fails where a room is below what tools/coverage_rooms.py states.
coverage: $(STAMP) core
	@mkdir -p build
	$(BIN)/coverage erase
	$(BIN)/coverage run -m pytest -n 2 --dist worksteal -m "not slow" $(NOT_COVERED:%=--deselect %); status=$$?; \
	  $(BIN)/coverage combine --quiet; $(BIN)/coverage json --quiet -o build/coverage.json && \
	  $(BIN)/python -m tools.coverage_rooms build/coverage.json && exit $$status

# Source distribution, wheel for every system, and wheel with the compiled core for this one, with their hashes.
dist: $(STAMP)
	rm -rf dist
	TREADLINK_COMPILED=0 $(BIN)/python -m build --no-isolation --outdir dist .
	$(BIN)/python -m build --no-isolation --wheel --outdir dist .
	cd dist && sha256sum treadlink-*

# What an installation with all extras consists of, as CycloneDX, from the lock file with its hashes.
sbom: $(STAMP)
	@mkdir -p dist
	$(BIN)/cyclonedx-py requirements requirements-run.lock --pyproject pyproject.toml --output-reproducible \
	  --output-file dist/treadlink.cdx.json
	@# The version is not in pyproject.toml, where that program looks for it.
	@$(BIN)/python -c 'import gateway, json, pathlib; path = pathlib.Path("dist/treadlink.cdx.json"); \
	  bom = json.loads(path.read_text("utf-8")); bom["metadata"]["component"]["version"] = gateway.__version__; \
	  path.write_text(json.dumps(bom, indent=2) + "\n", "utf-8")'

# The newest versions of everything; run the tests afterwards.
locks: $(STAMP)
	$(LOCK) pyproject.toml --all-extras --output-file requirements.lock
	$(LOCK) pyproject.toml --extra all --output-file requirements-run.lock
	$(LOCK) --group docs --output-file requirements-docs.lock

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(STAMP)
	$(BIN)/mypy

# What the emulated board needs, on Debian and Ubuntu; clang and cppcheck check the code.
FIRMWARE_PACKAGES := qemu-system-arm gcc-arm-none-eabi libnewlib-arm-none-eabi gcc libc6-dev clang cppcheck

firmware-packages:
	apt-get update -qq && apt-get install -y -qq --no-install-recommends $(FIRMWARE_PACKAGES)

# The reference collector in the loop, and what it costs.
firmware: $(STAMP)
	$(BIN)/python -m pytest tests/makers/firmware
	$(BIN)/python -m tests.makers.firmware.bench_firmware

bench: $(STAMP)
	for bench in tools/bench_*.py; do echo "== $$bench"; $(BIN)/python $$bench || exit 1; done
	$(BIN)/python -m tests.core.ble.bench_ble

$(DOCS_STAMP): requirements-docs.lock
	$(PYTHON) -m venv $(DOCS_VENV)
	$(DOCS_VENV)/bin/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements-docs.lock
	@touch $@

# The pages that the site generator reads: those of docs/ and those generated from the code.
docs-pages: $(STAMP)
	$(BIN)/python -m tools.docs_site build/docs --run-notebooks

# The site, in build/site. A broken link is an error.
docs: docs-pages $(DOCS_STAMP)
	rm -rf build/site
	$(DOCS_VENV)/bin/zensical build --clean --strict

# The site on http://localhost:8000. After a change run `make docs-pages` in another terminal: the site follows.
docs-serve: docs-pages $(DOCS_STAMP)
	$(DOCS_VENV)/bin/zensical serve

clean:
	rm -rf $(VENV) $(DOCS_VENV) build .cache .mypy_cache .ruff_cache .pytest_cache
