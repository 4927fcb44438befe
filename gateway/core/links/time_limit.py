"""Sources that end after a stretch of their own time."""

import contextlib
import threading
from collections.abc import Iterator

from gateway.core.links.playback import Playback, PlayedSource
from gateway.core.links.source import LinkItem, Source, WrappedSource, is_time


def limited(source: Source, duration_s: float) -> Source:
    """Return the source with a time limit; a played source stays one."""
    kind = _TimeLimitedPlayback if isinstance(source, PlayedSource) else TimeLimitedSource
    return kind(source, duration_s)


class TimeLimitedSource(WrappedSource):
    """A source whose items end a given time after its first, by their own times.

    The pace at which items are read and processed does not matter: a simulation or a recording that is played faster
    than real time, or a computer that falls behind a hub, gives the same items.
    """

    def __init__(self, source: Source, duration_s: float) -> None:
        """Wrap a source.

        Args:
            source: any source.
            duration_s: time between the first item and the last.
        """
        super().__init__(source)
        self._duration_ns = round(duration_s * 1e9)

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the items of the source up to the end of the time."""
        end_ns: int | None = None
        # Closing the generator ends the source where it is, as `stop` does.
        with contextlib.closing(self._source.items(stop)) as items:  # type: ignore[type-var]  # all are generators
            for item in items:
                if is_time(item.host_ns):
                    if end_ns is None:
                        end_ns = item.host_ns + self._duration_ns
                    if item.host_ns > end_ns:
                        return
                yield item


class _TimeLimitedPlayback(TimeLimitedSource):
    @property
    def playback(self) -> Playback:
        """Schedule of the source."""
        assert isinstance(self._source, PlayedSource)
        return self._source.playback
