"""A manifest goes with its recordings, and a copy is compared with it."""

import shutil
import subprocess
from pathlib import Path

import pytest

from gateway.errors import RecordingError
from gateway.recording.manifest import MANIFEST_NAME, read_manifest, verify, write_manifest
from gateway.recording.run_description import Note, add_note, notes_path
from gateway.recording.writer import RecordingWriter
from tests.testkit.commands import invoked


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    car = tmp_path / "car"
    car.mkdir()
    for number in range(2):
        RecordingWriter(car / f"drive {number}.mcap", start_ns=number).close()
    add_note(car / "drive 0.mcap", Note("2026-01-01T00:00:00Z", "rain"))
    return car


def test_a_copy_is_verified_and_damage_is_named(folder: Path, tmp_path: Path) -> None:
    assert len(write_manifest(folder)) == 3
    copy = tmp_path / "archive"
    shutil.copytree(folder, copy)
    files = sorted(copy.glob("*.mcap"))
    done = invoked("inspect", "--verify", *files)
    assert (done.exit_code, done.output.count("as in the manifest")) == (0, 2)
    data = bytearray(files[1].read_bytes())
    data[len(data) // 2] ^= 1
    files[1].write_bytes(data)
    done = invoked("inspect", "--verify", *files)
    assert done.exit_code == 1
    assert "drive 1.mcap: NOT VERIFIED" in done.output
    notes_path(files[0]).unlink()
    with pytest.raises(RecordingError, match="missing"):
        verify(files[0])
    files[1].unlink()
    done = invoked("inspect", "--verify", files[0])
    assert "drive 1.mcap' is missing" in done.output


@pytest.mark.skipif(shutil.which("sha256sum") is None, reason="needs sha256sum")
def test_the_format_is_that_of_sha256sum(folder: Path) -> None:
    write_manifest(folder)
    subprocess.run(["sha256sum", "--check", "--strict", MANIFEST_NAME], cwd=folder, check=True, capture_output=True)


def test_a_second_run_adds_and_never_hides_damage(folder: Path) -> None:
    before = write_manifest(folder)
    (folder / "drive 1.mcap").write_bytes(b"damaged")
    RecordingWriter(folder / "drive 2.mcap", start_ns=2).close()
    add_note(folder / "drive 0.mcap", Note("2026-01-01T00:00:01Z", "dry"))
    after = write_manifest(folder)
    assert after["drive 1.mcap"] == before["drive 1.mcap"]
    assert "drive 2.mcap" in after
    verify(folder / "drive 0.mcap")
    with pytest.raises(RecordingError, match="not as when"):
        verify(folder / "drive 1.mcap")


def test_a_recording_in_progress_waits_for_the_next_run(folder: Path) -> None:
    writer = RecordingWriter(folder / "now.mcap", start_ns=3)
    assert "now.mcap" not in write_manifest(folder)
    done = invoked("manifest", folder)
    assert f"left out: {folder / 'now.mcap'}" in done.output
    with pytest.raises(RecordingError, match="is being recorded"):
        verify(folder / "now.mcap")
    writer.close()
    assert "now.mcap" in write_manifest(folder)


def test_what_is_wrong_is_named(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="does not have") as error:
        verify(folder / "drive 0.mcap")
    # A folder named "." is not followed by a full stop, which would name its parent.
    assert f"`treadlink manifest {folder}`" in error.value.remedy
    with pytest.raises(RecordingError, match="no recording"):
        write_manifest(tmp_path)
    (folder / MANIFEST_NAME).write_text("x")
    with pytest.raises(RecordingError, match="line 1"):
        read_manifest(folder)
