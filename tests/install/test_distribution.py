"""Distributions: equal in every build, complete without the tree, and the shipped unit and udev rule."""

import configparser
import email
import hashlib
import os
import re
import shlex
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import venv
import zipfile
from pathlib import Path

import click
import pytest

from gateway.core.cli import treadlink
from gateway.core.links.source import is_live

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
    run("-m", "gateway.core.cli", "simulate", "lab", "--duration", "2", "--out", "lab.mcap")
    assert "mean speed" in run("-m", "gateway.core.cli", "estimate", "lab.mcap", "--csv", "lab.csv")
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
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    assert copied >= set(project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"])


@pytest.fixture(scope="module")
def wheel_names(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, "-w", str(folder), str(ROOT)], check=True)
    (made,) = folder.glob("treadlink-*.whl")
    return made


def test_wheel_holds_both_packages_with_their_data(wheel_names: Path) -> None:
    names = set(zipfile.ZipFile(wheel_names).namelist())
    tops = {name.split("/")[0] for name in names}
    assert {top for top in tops if not top.endswith(".dist-info")} == {"gateway", "firmware_protocol", "treadlink"}
    for needed in (
        "gateway/py.typed",
        "firmware_protocol/py.typed",
        "firmware_protocol/vectors/frames.json",
        "firmware_protocol/collector/tl_collector.c",
        "gateway/simulator/scenarios/demo.toml",
    ):
        assert needed in names
    assert wheel_names.stat().st_size < 2_400_000


def test_wheel_states_who_it_is(wheel_names: Path) -> None:
    archive = zipfile.ZipFile(wheel_names)
    (position,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
    facts = email.message_from_bytes(archive.read(position))
    assert facts["Name"] == "treadlink"
    assert facts["Requires-Python"] == ">=3.11"
    assert facts["License-Expression"] == "MIT"
    assert {
        "all",
        "auth",
        "campaign",
        "can",
        "cluster",
        "formats",
        "foxglove",
        "mqtt",
        "pandas",
        "parquet",
        "plot",
        "web",
    } <= set(facts.get_all("Provides-Extra", []))
    entries = archive.read(position.replace("METADATA", "entry_points.txt")).decode()
    assert "treadlink = gateway.core.cli:main" in entries


def test_installed_wheel_runs(wheel_names: Path, tmp_path: Path) -> None:
    options = ["--quiet", "--no-deps", "--no-index", "--disable-pip-version-check"]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, "--target", str(tmp_path / "site"), str(wheel_names)],
        check=True,
    )
    command = [sys.executable, str(tmp_path / "site" / "bin" / "treadlink"), "simulate", "lab", "--duration", "1"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "x.mcap")], env=environment, cwd=tmp_path, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "x.mcap").stat().st_size > 10_000


FOLDER = Path(__file__).parents[2] / "examples" / "gateway-service"


def unit() -> configparser.ConfigParser:
    parser = configparser.ConfigParser(strict=True, interpolation=None)
    parser.optionxform = str  # type: ignore[assignment,method-assign]
    parser.read(FOLDER / "treadlink.service", "utf-8")
    return parser


def test_unit_calls_record_with_options_that_exist() -> None:
    program, command, *arguments = shlex.split(unit()["Service"]["ExecStart"])
    assert Path(program).name == "treadlink"
    result = treadlink.get_command(click.Context(treadlink), command)
    assert result is not None
    context = result.make_context(command, arguments)
    assert context.params["sources"] == ("serial:///dev/treadlink",)
    assert is_live(context.params["sources"][0])
    # A folder takes a new file at every start: nothing is overwritten.
    assert str(context.params["out"]).startswith(f"/var/lib/{unit()['Service']['StateDirectory']}")


def test_unit_starts_again_and_ends_recordings() -> None:
    service = unit()["Service"]
    assert service["Restart"] == "always"
    # The program finishes its recording on SIGTERM, which systemd sends unless the unit says otherwise.
    assert "KillSignal" not in service
    assert float(service["TimeoutStopSec"]) >= 10


def test_udev_rule_makes_the_name_that_the_unit_uses() -> None:
    rule = (FOLDER / "99-treadlink.rules").read_text("utf-8").splitlines()[-1]
    parts = dict(re.findall(r'([A-Z]+(?:\{\w+\})?)(?:==|\+=|=)"([^"]*)"', rule))
    assert f"serial:///dev/{parts['SYMLINK']}" in unit()["Service"]["ExecStart"]
    assert parts["ENV{SYSTEMD_WANTS}"] == "treadlink.service"
    assert parts["GROUP"] in unit()["Service"]["SupplementaryGroups"].split()
