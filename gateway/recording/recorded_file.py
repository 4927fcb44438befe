"""Opening of files with the bytes of links: recordings, and raw dumps of a link."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from gateway.errors import RecordingError
from gateway.io.source import LinkItem
from gateway.reasons import Reason
from gateway.recording.mcap_records import MAGIC
from gateway.recording.reader import RecordingInfo, RecordingReader
from gateway.recording.regular_file import open_regular
from gateway.recording.replay_source import RawDump


class RecordedFile(Protocol):
    """A file of link items that can be read again and again."""

    @property
    def damage(self) -> Reason | None:
        """After a pass, what was unreadable; None when everything was read."""
        ...

    @property
    def info(self) -> RecordingInfo:
        """Description of the file."""
        ...

    @property
    def position(self) -> int:
        """Bytes read so far in the current pass."""
        ...

    @property
    def vehicle_toml(self) -> str | None:
        """Text of the vehicle configuration in the file, None when it contains none."""
        ...

    def items(self) -> Iterator[LinkItem]:
        """Yield link items in file order."""
        ...


def open_recorded_file(path: Path | str) -> RecordedFile:
    """Open a recording, or the raw dump of a link, which ends in `.bin`.

    Raises:
        RecordingError: the file cannot be read, or is neither.
    """
    path = Path(path)
    if path.suffix.lower() != ".bin":
        return RecordingReader(path)
    try:
        with open_regular(path) as file:
            magic = file.read(len(MAGIC))
    except FileNotFoundError as error:
        raise RecordingError(f"recording '{path}' does not exist", "Check the path.") from error
    except OSError as error:
        raise RecordingError(f"cannot read recording '{path}': {error.strerror}", "Check its permissions.") from error
    return RecordingReader(path) if magic == MAGIC else RawDump(path, None)
