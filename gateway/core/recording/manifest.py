"""Comparison of recordings with the SHA256SUMS of their folder, which `sha256sum` or PowerShell wrote."""

import re
from pathlib import Path
from typing import Final

from gateway.core.bounded_input import read_bounded
from gateway.core.errors import RecordingError
from gateway.core.recording.file_content import read_content
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.run_description import NOTES_SUFFIX, notes_path

MANIFEST_NAME: Final = "SHA256SUMS"
WRITING_LINE: Final = f"sha256sum *.mcap* > {MANIFEST_NAME}"
_LINE: Final = re.compile(r"([0-9a-fA-F]{64}) [ *](.+)")
# No file system has a longer name.
_MAX_NAME_BYTES: Final = 255
_MAX_BYTES: Final = 64 << 20


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
        if match is None or len(match[2].encode()) > _MAX_NAME_BYTES:
            raise RecordingError(f"line {number} of the manifest '{path}' is wrong", "Copy it again.")
        hashes[match[2]] = match[1].lower()
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
                f"When its session has ended, write {MANIFEST_NAME} again.",
            )
        raise RecordingError(
            f"the manifest of '{recording.parent}' does not have '{recording.name}'",
            f"Where the recording was made, run `{WRITING_LINE}` in its folder, and copy {MANIFEST_NAME} too.",
        )
    for path in (recording, notes_path(recording)):
        if path.name not in hashes:
            continue
        if not path.exists():
            raise RecordingError(f"'{path}' is missing, but in the manifest", "Copy it again.")
        if _sha256(path) != hashes[path.name]:
            remedy = (
                f"If notes were added since, run `{WRITING_LINE}` again where the recording was made."
                if path.name.endswith(NOTES_SUFFIX)
                else "Copy it again from where it was recorded; `treadlink inspect` says what is damaged."
            )
            raise RecordingError(f"'{path}' is not as when the manifest was written", remedy)


def _sha256(path: Path) -> str:
    content = read_content(path)
    assert content is not None  # nothing stops the reading
    return content.sha256
