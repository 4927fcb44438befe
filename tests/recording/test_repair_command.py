"""Tests of `treadlink repair` and `treadlink compact`."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gateway.cli import treadlink
from gateway.errors import RecordingError
from gateway.io.source import LinkItem
from tests.recording import streams


@pytest.fixture
def recording(tmp_path: Path) -> tuple[Path, list[LinkItem]]:
    rng = np.random.default_rng(30)
    items: list[LinkItem] = [*streams.chunks(rng, b"".join(streams.frames(rng, 400)), "serial:/dev/ttyUSB0")]
    return streams.write(tmp_path / "drive.mcap", items).path, items


def run(*arguments: str) -> str:
    result = CliRunner().invoke(treadlink, arguments, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    return result.output


def test_repair_of_a_cut_file_is_reported(recording: tuple[Path, list[LinkItem]]) -> None:
    path, items = recording
    path.write_bytes(path.read_bytes()[: path.stat().st_size * 3 // 4])
    before = path.read_bytes()
    output = run("repair", str(path))
    assert "drive.repaired.mcap" in output
    assert "recovered:" in output
    assert "missing:" in output
    assert "looking" not in output, "a progress bar belongs on a terminal only"
    assert path.read_bytes() == before
    got = streams.link_bytes(streams.read(path.with_name("drive.repaired.mcap")))
    assert streams.link_bytes(items).startswith(got)
    assert len(got) > 60_000


def test_repair_loads_no_scipy(recording: tuple[Path, list[LinkItem]]) -> None:
    """Loaded for the report, it could fail for want of memory after the file is written."""
    path, _ = recording
    path.write_bytes(path.read_bytes()[:-10])
    code = (
        "import sys; from gateway.cli import treadlink; "
        "treadlink(['repair', sys.argv[1]], standalone_mode=False); print('scipy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code, str(path)], capture_output=True, text=True, check=True)
    assert "recovered:" in done.stdout
    assert done.stdout.splitlines()[-1] == "False"


def test_undamaged_file_is_not_repaired(recording: tuple[Path, list[LinkItem]]) -> None:
    path, items = recording
    assert "nothing to repair" in run("repair", str(path))
    assert [entry.name for entry in path.parent.iterdir()] == ["drive.mcap"]
    run("repair", "--force", "--out", str(path.with_name("copy.mcap")), str(path))
    assert streams.read(path.with_name("copy.mcap")) == items


def test_earlier_repair_is_not_overwritten(recording: tuple[Path, list[LinkItem]]) -> None:
    path, _ = recording
    path.write_bytes(path.read_bytes()[:-10])
    path.with_name("drive.repaired.mcap").write_bytes(b"precious")
    with pytest.raises(RecordingError, match="already exists") as caught:
        run("repair", str(path))
    assert "--out" in caught.value.remedy
    assert path.with_name("drive.repaired.mcap").read_bytes() == b"precious"


def test_compact_beside_and_in_place(recording: tuple[Path, list[LinkItem]]) -> None:
    path, items = recording
    assert "messages verified" in run("compact", str(path))
    small = path.with_name("drive.compact.mcap")
    assert streams.read(small) == items
    assert small.stat().st_size < path.stat().st_size
    run("compact", "--in-place", str(path))
    small.unlink()
    assert [entry.name for entry in path.parent.iterdir()] == ["drive.mcap"]
    assert streams.read(path) == items


def test_out_requires_a_single_recording(recording: tuple[Path, list[LinkItem]]) -> None:
    path = str(recording[0])
    result = CliRunner().invoke(treadlink, ["compact", "--out", "x.mcap", path, path])
    assert result.exit_code == 2
    assert "single recording" in result.output


@pytest.mark.parametrize("command", ["repair", "compact"])
def test_missing_file_is_named(tmp_path: Path, command: str) -> None:
    with pytest.raises(RecordingError, match=r"recording '.*gone\.mcap' does not exist"):
        run(command, str(tmp_path / "gone.mcap"))
