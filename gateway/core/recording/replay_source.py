"""Replay sources: recordings and raw dumps with their recorded times."""

import contextlib
import threading
from collections.abc import Iterator
from pathlib import Path

from gateway.core.clock import Clock
from gateway.core.errors import RecordingError, SourceError
from gateway.core.links.playback import Playback
from gateway.core.links.source import LinkEvent, LinkEventKind, LinkItem, Source, SourceAddress, positive_option
from gateway.core.reasons import Reason
from gateway.core.recording.recorded_file import RawDump, RecordedFile, open_recorded_file


class ReplaySource:
    """Replay of items on an absolute schedule, so that delays do not accumulate.

    Attributes:
        playback: the schedule, which can be paused.
    """

    def __init__(self, recording: RecordedFile, link: str, speed: float, clock: Clock) -> None:
        """Replay `recording` at `speed` times its pace; infinite speed does not wait.

        Args:
            recording: or dump.
            link: name of its first link; chunks have the recorded names.
            speed: pace relative to the recorded times.
            clock: clock of the replay; the chunks keep their recorded times.
        """
        self._recording = recording
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
        return self._recording.damage

    @property
    def vehicle_toml(self) -> str | None:
        """Vehicle configuration in the recording."""
        return self._recording.vehicle_toml

    @property
    def dbc_text(self) -> str | None:
        """DBC file in the recording."""
        return self._recording.info.dbc_text

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the recorded items, then an `ENDED` event that reports any damage."""
        last: LinkItem | None = None
        for item in self._recording.items():
            if not self.playback.wait_until(item.host_ns, stop, self._closed):
                return
            yield item
            last = item
        damage = self._recording.damage
        has_ended = isinstance(last, LinkEvent) and last.kind is LinkEventKind.ENDED
        if not stop.is_set() and not self._closed.is_set() and (damage or not has_ended):
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
    address.check_options(("speed", "rate"), "speed=1|10|max, and rate= for .bin files")
    rate = address.options.get("rate")
    try:
        recording = open_recorded_file(path, None if rate is None else positive_option("rate", rate))
    except RecordingError as error:
        raise SourceError(str(error), error.remedy) from error
    if isinstance(recording, RawDump):
        return ReplaySource(recording, recording.link, _speed(address, "1" if rate else "max"), clock)
    if rate is not None:
        raise SourceError("option 'rate' is for raw .bin dumps only", f"'{path.name}' has recorded times. Use speed=.")
    with contextlib.closing(recording.items()) as items:
        first = next(items, None)
    link = first.link if first is not None and first.link else f"replay:{path.name}"
    return ReplaySource(recording, link, _speed(address, "1"), clock)


def _speed(address: SourceAddress, default: str) -> float:
    return positive_option("speed", address.options.get("speed", default), or_max=True)
