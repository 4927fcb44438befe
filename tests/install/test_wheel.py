"""The wheel holds what an installed treadlink needs, and nothing else."""

import email
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("wheel")
    options = ["--quiet", "--no-deps", "--no-build-isolation", "--no-index", "--disable-pip-version-check"]
    subprocess.run([sys.executable, "-m", "pip", "wheel", *options, "-w", str(folder), str(ROOT)], check=True)
    (made,) = folder.glob("treadlink-*.whl")
    return made


def test_wheel_holds_both_packages_with_their_data(wheel: Path) -> None:
    names = set(zipfile.ZipFile(wheel).namelist())
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
    assert wheel.stat().st_size < 2_000_000


def test_wheel_states_who_it_is(wheel: Path) -> None:
    archive = zipfile.ZipFile(wheel)
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
    assert "treadlink = gateway.cli:main" in entries


def test_installed_wheel_runs(wheel: Path, tmp_path: Path) -> None:
    options = ["--quiet", "--no-deps", "--no-index", "--disable-pip-version-check"]
    subprocess.run(
        [sys.executable, "-m", "pip", "install", *options, "--target", str(tmp_path / "site"), str(wheel)], check=True
    )
    command = [sys.executable, str(tmp_path / "site" / "bin" / "treadlink"), "simulate", "lab", "--duration", "1"]
    environment = {**os.environ, "PYTHONPATH": str(tmp_path / "site")}
    done = subprocess.run(
        [*command, "--out", str(tmp_path / "x.mcap")], env=environment, cwd=tmp_path, capture_output=True, text=True,
        check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "x.mcap").stat().st_size > 10_000
