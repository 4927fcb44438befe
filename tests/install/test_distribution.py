"""Source distribution and wheel: equal in every build, and usable without the tree."""

import hashlib
import os
import re
import subprocess
import sys
import sysconfig
import tarfile
import venv
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PYTHON = Path("Scripts" if os.name == "nt" else "bin") / "python"


def build(source: Path, out: Path, kind: str) -> Path:
    """Return the distribution built with the back end that pyproject.toml names."""
    out.mkdir()
    code = f"import hatchling.build as back; back.build_{kind}({str(out)!r})"
    environment = {**os.environ, "SOURCE_DATE_EPOCH": "1700000000"}
    subprocess.run([sys.executable, "-c", code], cwd=source, env=environment, check=True)
    (made,) = out.iterdir()
    return made


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(ROOT, tmp_path_factory.mktemp("wheel") / "out", "wheel")


@pytest.fixture(scope="module")
def sdist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return build(ROOT, tmp_path_factory.mktemp("sdist") / "out", "sdist")


def test_builds_are_equal_and_the_source_distribution_gives_the_same_wheel(sdist, wheel, tmp_path):
    assert digest(build(ROOT, tmp_path / "again", "sdist")) == digest(sdist)
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    (source,) = tmp_path.glob("treadlink-*")
    assert {"tests", "docs", "LICENSE", "SECURITY.md"} <= {path.name for path in source.iterdir()}
    assert digest(build(source, tmp_path / "wheel", "wheel")) == digest(wheel)


def test_the_wheel_works_in_a_bare_environment(wheel, tmp_path):
    """It takes its dependencies from the environment of the tests, and treadlink from the wheel alone."""
    venv.create(tmp_path / "bare", with_pip=False)
    python = tmp_path / "bare" / PYTHON
    (site,) = (tmp_path / "bare").rglob("site-packages")
    options = ["--quiet", "--no-deps", "--no-index", "--disable-pip-version-check", "--target", str(site)]
    subprocess.run([sys.executable, "-m", "pip", "install", *options, str(wheel)], check=True)
    (site / "dependencies.pth").write_text(sysconfig.get_path("purelib"))

    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}

    def run(*arguments: str) -> str:
        command = [str(python), *arguments]
        done = subprocess.run(command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr
        return done.stdout

    code = "import gateway, firmware_protocol; print(gateway.__file__, firmware_protocol.__file__)"
    assert all(Path(name).is_relative_to(site) for name in run("-c", code).split())
    run("-m", "gateway.cli", "simulate", "lab", "--duration", "2", "--out", "lab.mcap")
    assert "mean speed" in run("-m", "gateway.cli", "estimate", "lab.mcap", "--csv", "lab.csv")
    assert (tmp_path / "lab.csv").read_text().count("\n") > 10


@pytest.mark.parametrize("name", ["requirements.lock", "requirements-run.lock", "requirements-docs.lock"])
def test_locks_have_hashes_and_no_address(name):
    text = (ROOT / name).read_text()
    assert "://" not in text
    for entry in re.split(r"(?<!\\)\n", text.strip()):
        head, *hashes = entry.split(" \\\n")
        assert re.fullmatch(r"[\w.-]+==\S+( ; .+)?", head), head
        assert hashes, head
        assert all(re.fullmatch(r" +--hash=sha256:[0-9a-f]{64}", hashe) for hashe in hashes), head


def test_every_dependency_is_explained():
    """`docs/reference/dependencies.md` has a row for each that pyproject.toml names, but those of the developers."""
    import tomllib

    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(line for name in extras if name != "dev" for line in extras[name])]
    names = {re.match(r"[\w-]+", line).group() for line in wanted} - {"treadlink"}
    table = (ROOT / "docs" / "reference" / "dependencies.md").read_text()
    assert names == set(re.findall(r"^\| `([\w-]+)` \|", table, re.M))


def test_container_is_given_what_its_build_copies() -> None:
    """An image cannot be built by every test machine; what is left out of the context fails there."""
    lines = [line.split() for line in (ROOT / "Containerfile").read_text("utf-8").splitlines()]
    copied = {
        name.rstrip("/")
        for command, *names in (line for line in lines if line)
        if command == "COPY" and not names[0].startswith("--from")
        for name in names[:-1]
    }
    ignored, *more = (ROOT / ".dockerignore").read_text("utf-8").split()
    assert ignored == "*"
    assert copied == {name[1:] for name in more if name.startswith("!")}
    assert all((ROOT / name).exists() for name in copied)
