"""Log files of other programs, played at the times that they state."""

import threading
from collections.abc import Iterator
from pathlib import Path

from gateway.core.clock import Clock
from gateway.core.errors import SourceError
from gateway.core.links.playback import Playback
from gateway.core.links.source import LinkEvent, LinkEventKind, SourceAddress, positive_option
from gateway.core.nearest_name import missing_path_remedy


class LogFile:
    """A log file as a source: its name, schedule and end. What its lines are is the source's own.

    Attributes:
        playback: the schedule, which can be paused.
    """

    vehicle_toml: str | None = None

    def __init__(self, address: SourceAddress, clock: Clock, *options: str) -> None:
        """Take path, `speed` and `offset_s`, which is added to its times, from an address.

        Args:
            address: of the file.
            clock: paces the playback.
            options: names of further options that the source has.

        Raises:
            SourceError: there is no such file, or an option is not known or not allowed.
        """
        address.check_options(("speed", "offset_s", *options))
        self._path = path = Path(address.target)
        if not path.is_file():
            raise SourceError(f"log file '{path}' does not exist", missing_path_remedy(path))
        text = address.options.get("offset_s", "0")
        try:
            self._offset_ns = round(float(text) * 1e9)
        except (ValueError, OverflowError) as error:
            raise SourceError(f"invalid option offset_s={text}", "Give seconds, such as -0.25.") from error
        speed = positive_option("speed", address.options.get("speed", "1"), or_max=True)
        self.playback = Playback(clock, speed)
        self._scheme = address.scheme
        self._closed = threading.Event()

    @property
    def link(self) -> str:
        """Name of the link."""
        return f"{self._scheme}:{self._path.name}"

    def close(self) -> None:
        """End `items`."""
        self._closed.set()

    def _cut_off(self, last_ns: int, why: str) -> LinkEvent:
        """Return the event of a file whose rest cannot be read."""
        return LinkEvent(self.link, last_ns, LinkEventKind.LOST, f"the rest of the file cannot be read: {why}")

    def _end(self, last_ns: int, stop: threading.Event) -> Iterator[LinkEvent]:
        """Yield that the file has ended, unless it was stopped or closed before."""
        if not stop.is_set() and not self._closed.is_set():
            yield LinkEvent(self.link, last_ns, LinkEventKind.ENDED)
