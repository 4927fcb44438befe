"""The SHA256SUMS of a folder goes with its recordings, and a copy is compared with it."""

import hashlib
import shutil
import subprocess
from pathlib import Path

import pytest

from gateway.core.errors import RecordingError
from gateway.core.recording.manifest import MANIFEST_NAME, WRITING_LINE, read_manifest, verify
from gateway.core.recording.run_description import Note, add_note, notes_path
from gateway.core.recording.writer import RecordingWriter
from tests.testkit.commands import invoked


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    car = tmp_path / "car"
    car.mkdir()
    for number in range(2):
        RecordingWriter(car / f"drive {number}.mcap", start_ns=number).close()
    add_note(car / "drive 0.mcap", Note("2026-01-01T00:00:00Z", "rain"))
    return car


def write_manifest(folder: Path, line: str = "{digest}  {name}\n") -> None:
    """Write the hashes as `sha256sum *.mcap*` prints them."""
    text = "".join(
        line.format(digest=hashlib.sha256(path.read_bytes()).hexdigest(), name=path.name)
        for path in sorted(folder.glob("*.mcap*"))
    )
    (folder / MANIFEST_NAME).write_text(text, newline="")


def test_a_copy_is_verified_and_damage_is_named(folder: Path, tmp_path: Path) -> None:
    write_manifest(folder)
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
def test_the_line_of_the_remedy_writes_what_is_read(folder: Path) -> None:
    subprocess.run(["sh", "-c", WRITING_LINE], cwd=folder, check=True)
    assert sorted(read_manifest(folder)) == sorted(path.name for path in folder.glob("*.mcap*"))
    verify(folder / "drive 0.mcap")


def test_capital_digits_and_line_ends_of_powershell_are_read(folder: Path) -> None:
    write_manifest(folder, "{digest}  {name}\r\n")
    path = folder / MANIFEST_NAME
    path.write_bytes(b"".join(line[:64].upper() + line[64:] for line in path.read_bytes().splitlines(keepends=True)))
    verify(folder / "drive 0.mcap")
    verify(folder / "drive 1.mcap")


def test_a_recording_in_progress_is_named(folder: Path) -> None:
    write_manifest(folder)
    writer = RecordingWriter(folder / "now.mcap", start_ns=3)
    with pytest.raises(RecordingError, match="is being recorded"):
        verify(folder / "now.mcap")
    writer.close()


def test_what_is_wrong_is_named(folder: Path) -> None:
    with pytest.raises(RecordingError, match="does not have") as error:
        verify(folder / "drive 0.mcap")
    assert WRITING_LINE in error.value.remedy
    (folder / MANIFEST_NAME).write_text("x")
    with pytest.raises(RecordingError, match="line 1"):
        read_manifest(folder)


def test_the_removed_command_names_what_replaces_it(folder: Path) -> None:
    done = invoked("manifest", folder)
    assert done.exit_code == 2
    assert "was removed" in done.output
    assert "sha256sum" in done.output
