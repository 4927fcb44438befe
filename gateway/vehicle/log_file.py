"""Log files of other programs, played at the times that they state."""

import gzip
import threading
import zlib
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import IO, ClassVar

from gateway.core.clock import Clock
from gateway.core.errors import SourceError
from gateway.core.links.playback import Playback
from gateway.core.links.source import LinkEvent, LinkEventKind, LinkItem, Sentences, SourceAddress, positive_option
from gateway.core.nearest_name import missing_path_remedy
from gateway.core.reasons import Reason


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

    def _cut_off(self, last_ns: int, error: str) -> LinkEvent:
        """Return the event of a file whose rest cannot be read."""
        return LinkEvent(self.link, last_ns, LinkEventKind.LOST, f"the rest of the file cannot be read: {error}")

    def _end(self, last_ns: int, stop: threading.Event) -> Iterator[LinkEvent]:
        """Yield that the file has ended, unless it was stopped or closed before."""
        if not stop.is_set() and not self._closed.is_set():
            yield LinkEvent(self.link, last_ns, LinkEventKind.ENDED)


class LineLog(LogFile, ABC):
    """A log file of lines, plain or packed by gzip.

    Attributes:
        lines: what its lines are.
        undated: what a file without any time lacks, and the remedy.
        details: of its end.
    """

    lines: ClassVar[type[Sentences]] = Sentences
    undated: ClassVar[tuple[str, str]]
    details: tuple[Reason, ...] = ()

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the lines up to each stated time at that time, then that the file has ended.

        Raises:
            SourceError: the file cannot be read, or states no time.
        """
        last_ns = 0
        try:
            with self._opened() as file:
                for last_ns, lines in self._dated(file):
                    if not self.playback.wait_until(last_ns, stop, self._closed):
                        return
                    yield self.lines(self.link, last_ns, lines)
        except (OSError, EOFError, zlib.error) as error:  # EOFError: a compressed file that is cut off
            reason = getattr(error, "strerror", None) or str(error)
            if not last_ns:
                raise SourceError(f"cannot read '{self._path}': {reason}", "Check the file.") from error
            yield self._cut_off(last_ns, reason)
        if not last_ns:
            lacks, remedy = self.undated
            raise SourceError(f"'{self._path}' has {lacks}", remedy)
        yield from (replace(event, details=self.details) for event in self._end(last_ns, stop))

    def _opened(self) -> IO[bytes]:
        is_packed = self._path.suffix.lower() == ".gz"
        return gzip.open(self._path) if is_packed else self._path.open("rb")  # type: ignore[return-value]

    @abstractmethod
    def _dated(self, file: IO[bytes]) -> Iterator[tuple[int, bytes]]:
        """Yield lines and their time in ns since the epoch, with the offset."""
