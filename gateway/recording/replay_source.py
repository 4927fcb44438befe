"""Replay sources: recordings and raw dumps with their recorded times."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Final, Protocol

from gateway.clock import Clock
from gateway.errors import RecordingError, SourceError
from gateway.io.playback import Playback
from gateway.io.source import Chunk, LinkEvent, LinkEventKind, LinkItem, Source, SourceAddress, positive_option
from gateway.reasons import Reason
from gateway.recording.mcap_records import MAGIC
from gateway.recording.reader import RecordingInfo, RecordingReader
from gateway.recording.regular_file import open_regular

_DUMP_BLOCK_BYTES: Final = 4096


class _Playable(Protocol):
    """Items in order, with what was unreadable and the vehicle configuration."""

    @property
    def damage(self) -> Reason | None: ...

    @property
    def vehicle_toml(self) -> str | None: ...

    @property
    def dbc_text(self) -> str | None: ...

    def items(self) -> Iterator[LinkItem]: ...


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
    dbc_text: str | None = None

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

    def items(self) -> Iterator[LinkItem]:
        """Yield the dump in blocks, of at most 10 ms with a rate."""
        block = _DUMP_BLOCK_BYTES if self._rate is None else max(1, min(_DUMP_BLOCK_BYTES, int(self._rate / 100)))
        offset = 0
        with self._path.open("rb") as file:
            while data := file.read(block):
                offset += len(data)
                self.position = offset
                yield Chunk(self.link, 0 if self._rate is None else round(offset * 1e9 / self._rate), data)


class ReplaySource:
    """Replay of items on an absolute schedule, so that delays do not accumulate.

    Attributes:
        playback: the schedule, which can be paused.
    """

    def __init__(self, playable: _Playable, link: str, speed: float, clock: Clock) -> None:
        """Replay `playable` at `speed` times its pace; infinite speed does not wait.

        Args:
            playable: recording or dump.
            link: name of its first link; chunks have the recorded names.
            speed: pace relative to the recorded times.
            clock: clock of the replay; the chunks keep their recorded times.
        """
        self._playable = playable
        self._link = link
        self.playback = Playback(clock, speed)
        self._closed = threading.Event()

    @property
    def link(self) -> str:
        """Name of the first link; a recording of several links yields each under its own name."""
        return self._link

    @property
    def damage(self) -> Reason | None:
        """What was unreadable of what has been replayed."""
        return self._playable.damage

    @property
    def vehicle_toml(self) -> str | None:
        """Vehicle configuration in the recording."""
        return self._playable.vehicle_toml

    @property
    def dbc_text(self) -> str | None:
        """DBC file in the recording."""
        return self._playable.dbc_text

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the recorded items, then an `ENDED` event that reports any damage."""
        last: LinkItem | None = None
        for item in self._playable.items():
            if not self.playback.wait_until(item.host_ns, stop, self._closed):
                return
            yield item
            last = item
        damage = self._playable.damage
        ended_already = isinstance(last, LinkEvent) and last.kind is LinkEventKind.ENDED
        if not stop.is_set() and not self._closed.is_set() and (damage or not ended_already):
            details = (damage,) if damage else ()
            host_ns = last.host_ns if last is not None else 0
            yield LinkEvent(self._link, host_ns, LinkEventKind.ENDED, details=details)

    def close(self) -> None:
        """End `items`."""
        self._closed.set()


def open_replay(address: SourceAddress, clock: Clock) -> Source:
    """Open `replay:FILE?speed=1|10|max` (MCAP), or a raw `.bin` dump with `rate` in bytes/s.

    Raises:
        SourceError: the file does not exist, is not a recording, or an option is invalid.
    """
    path = Path(address.target)
    _check_options(address)
    try:
        with open_regular(path) as file:
            magic = file.read(len(MAGIC))
    except RecordingError as error:
        raise SourceError(str(error), error.remedy) from error
    except OSError as error:
        raise SourceError(f"cannot open '{path}': {error.strerror}", "Check the path of the recording.") from error
    if magic != MAGIC and path.suffix.lower() == ".bin":
        rate = address.options.get("rate")
        dump = RawDump(path, None if rate is None else positive_option("rate", rate))
        return ReplaySource(dump, dump.link, _speed(address, "1" if rate else "max"), clock)
    if "rate" in address.options:
        raise SourceError("option 'rate' is for raw .bin dumps only", f"'{path.name}' has recorded times. Use speed=.")
    try:
        reader = RecordingReader(path)
    except RecordingError as error:
        raise SourceError(str(error), error.remedy) from error
    with contextlib.closing(reader.items()) as items:
        first = next(items, None)
    link = first.link if first is not None and first.link else f"replay:{path.name}"
    return ReplaySource(reader, link, _speed(address, "1"), clock)


def _check_options(address: SourceAddress) -> None:
    for name in address.options:
        if name not in ("speed", "rate"):
            raise SourceError(f"replay has no option '{name}'", "Options are speed=1|10|max, and rate= for .bin files.")


def _speed(address: SourceAddress, default: str) -> float:
    return positive_option("speed", address.options.get("speed", default), or_max=True)
