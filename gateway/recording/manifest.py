"""Manifest of a folder of recordings: SHA-256 of every file, in the format of `sha256sum`, carried by any copy."""

import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Final

from gateway.bounded_input import read_bounded
from gateway.errors import RecordingError
from gateway.recording.file_content import read_content
from gateway.recording.reader import RecordingReader
from gateway.recording.run_description import NOTES_SUFFIX, notes_path

MANIFEST_NAME: Final = "SHA256SUMS"
_LINE: Final = re.compile(r"([0-9a-f]{64}) [ *](.+)")
# No file system has a longer name.
_MOST_NAME_BYTES: Final = 255
_MAX_BYTES: Final = 64 << 20


def write_manifest(folder: Path, on_file: Callable[[Path], None] = lambda _: None) -> dict[str, str]:
    """Write the manifest of the finished recordings of a folder and of their notes; return the hashes by name.

    A file whose hash is in the manifest keeps it: a file that has changed since is damage, which a new hash would hide.
    What is recorded at present is left out. Entries of files that are gone stay, so that a copy shows what it lacks.

    Args:
        folder: of the recordings, not of those in folders below.
        on_file: called with each file before it is read.

    Raises:
        RecordingError: the folder has no recording, or the manifest cannot be read or written.
    """
    paths = sorted(folder.glob("*.mcap"))
    if not paths:
        raise RecordingError(f"there is no recording in '{folder}'", "Give the folder that has the .mcap files.")
    hashes = read_manifest(folder)
    for path in paths:
        notes = notes_path(path)
        if notes.exists():  # notes are added to, so theirs is new each time
            hashes[notes.name] = _sha256(notes)
        if path.name not in hashes and not RecordingReader(path).info.in_progress:
            on_file(path)
            hashes[path.name] = _sha256(path)
    text = "".join(f"{digest}  {name}\n" for name, digest in sorted(hashes.items()))
    target, part = folder / MANIFEST_NAME, folder / f".{MANIFEST_NAME}.part"
    try:
        part.unlink(missing_ok=True)  # of a killed command; a link that somebody has put there is not followed
        with part.open("x", encoding="utf-8", newline="\n") as file:
            file.write(text)
        part.replace(target)
    except OSError as error:
        raise RecordingError(
            f"the manifest '{target}' cannot be written: {error.strerror}", "Check the folder's permissions and space."
        ) from error
    return hashes


def read_manifest(folder: Path) -> dict[str, str]:
    """Return the hashes in a folder's manifest by file name; none without a manifest.

    Raises:
        RecordingError: it cannot be read, or a line is wrong.
    """
    path = folder / MANIFEST_NAME
    try:
        lines = read_bounded(path, _MAX_BYTES).decode().splitlines()
    except FileNotFoundError:
        return {}
    except (OSError, UnicodeDecodeError) as error:
        raise RecordingError(f"the manifest '{path}' cannot be read: {error}", "Copy it again.") from error
    hashes = {}
    for number, line in enumerate(lines, 1):
        match = _LINE.fullmatch(line)
        if match is None or len(match[2].encode()) > _MOST_NAME_BYTES:
            raise RecordingError(f"line {number} of the manifest '{path}' is wrong", "Copy it again.")
        hashes[match[2]] = match[1]
    return hashes


def absent_recordings(folder: Path) -> list[Path]:
    """Return the recordings that are in a folder's manifest but not in the folder.

    Raises:
        RecordingError: the manifest cannot be read.
    """
    names = (name for name in read_manifest(folder) if not name.endswith(NOTES_SUFFIX))
    return [folder / name for name in names if not (folder / name).exists()]


def verify(recording: Path) -> None:
    """Compare a recording, and its notes, with the manifest of its folder.

    Raises:
        RecordingError: a file differs or is missing, or the manifest does not have the recording.
    """
    hashes = read_manifest(recording.parent)
    if recording.name not in hashes:
        if RecordingReader(recording).info.in_progress:
            raise RecordingError(
                f"'{recording}' is being recorded",
                f"When its session has ended, run `treadlink manifest {shlex.quote(str(recording.parent))}`.",
            )
        raise RecordingError(
            f"the manifest of '{recording.parent}' does not have '{recording.name}'",
            f"Where the recording was made, run `treadlink manifest {shlex.quote(str(recording.parent))}`, and copy "
            f"{MANIFEST_NAME} too.",
        )
    for path in (recording, notes_path(recording)):
        if path.name not in hashes:
            continue
        if not path.exists():
            raise RecordingError(f"'{path}' is missing, but in the manifest", "Copy it again.")
        if _sha256(path) != hashes[path.name]:
            remedy = (
                "If notes were added since, run treadlink manifest again."
                if path.name.endswith(NOTES_SUFFIX)
                else "Copy it again from where it was recorded; `treadlink inspect` says what is damaged."
            )
            raise RecordingError(f"'{path}' is not as when the manifest was written", remedy)


def _sha256(path: Path) -> str:
    content = read_content(path)
    assert content is not None  # nothing stops the reading
    return content.sha256
