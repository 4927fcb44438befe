"""Opening of files with the bytes of links: recordings, and raw dumps of a link."""

from collections.abc import Generator, Iterable, Iterator
from pathlib import Path
from typing import Final, Protocol

from gateway.core.errors import RecordingError
from gateway.core.links.source import Chunk, LinkItem
from gateway.core.nearest_name import missing_path_remedy
from gateway.core.reasons import Reason
from gateway.core.recording.mcap_records import MAGIC
from gateway.core.recording.reader import RecordingInfo, RecordingReader
from gateway.core.recording.regular_file import open_recording_file

_DUMP_BLOCK_BYTES: Final = 4096


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


class RawDump:
    """File with only the bytes of a link, such as from `cat /dev/ttyUSB0 > dump.bin`.

    It has no arrival times. They are counted from 0 at a given byte rate, or are 0 without one.

    Attributes:
        damage: always None, as bytes that are no frames are counted by the decoder.
        link: name of the link, from that of the file.
        position: bytes read so far in the current pass.
        vehicle_toml: None; a dump contains no configuration.
    """

    vehicle_toml: str | None = None

    def __init__(self, path: Path, rate_bytes_per_s: float | None) -> None:
        """Prepare the dump without reading it."""
        self.damage: Reason | None = None
        self.link = f"dump:{path.name}"
        self.position = 0
        self._path = path
        self._rate = rate_bytes_per_s

    @property
    def info(self) -> RecordingInfo:
        """Description of the file."""
        return RecordingInfo(self._path, self._path.stat().st_size, finished=True, sources=(self.link,))

    def items(self) -> Generator[LinkItem, None, None]:
        """Yield the dump in blocks, of at most 10 ms with a rate."""
        block = _DUMP_BLOCK_BYTES if self._rate is None else max(1, min(_DUMP_BLOCK_BYTES, int(self._rate / 100)))
        offset = 0
        with self._path.open("rb") as file:
            while data := file.read(block):
                offset += len(data)
                self.position = offset
                yield Chunk(self.link, 0 if self._rate is None else round(offset * 1e9 / self._rate), data)


def check_exist(paths: Iterable[Path]) -> None:
    """Check that files exist before the first of them is worked on.

    Raises:
        RecordingError: one does not exist.
    """
    for path in paths:
        if not path.exists():
            raise RecordingError(f"recording '{path}' does not exist", missing_path_remedy(path))


def open_recorded_file(path: Path | str, rate_bytes_per_s: float | None = None) -> RecordingReader | RawDump:
    """Open a recording, or the raw dump of a link, which ends in `.bin`; the rate is that of a dump.

    Raises:
        RecordingError: the file cannot be read, or is neither.
    """
    path = Path(path)
    if path.suffix.lower() != ".bin":
        return RecordingReader(path)
    with open_recording_file(path) as file:
        magic = file.read(len(MAGIC))
    return RecordingReader(path) if magic == MAGIC else RawDump(path, rate_bytes_per_s)
