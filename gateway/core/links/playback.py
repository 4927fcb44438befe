"""Playback: items on an absolute schedule of the clock, at a multiple of their own pace, with a pause."""

from __future__ import annotations

import math
import threading
from typing import Final, Protocol, runtime_checkable

from gateway.core.clock import Clock
from gateway.core.links.source import is_time

_WAIT_SLICE_NS: Final = 100_000_000


@runtime_checkable
class PlayedSource(Protocol):
    """A source that plays items whose times are not those of the clock."""

    @property
    def playback(self) -> Playback:
        """Its schedule."""
        ...


class Playback:
    """Schedule of a played stream. Delays do not accumulate, and a pause stops the time of the stream.

    Any thread may call `pause` and `now_ns`; the thread of the source calls `wait_until`.
    """

    def __init__(self, clock: Clock, speed: float) -> None:
        """Play at `speed` times the stream's pace; infinite speed does not wait."""
        self._clock = clock
        self._speed = speed
        self._lock = threading.Lock()
        # Clock time and stream time of the start or of the last resumption.
        self._anchor: tuple[int, int] | None = None
        self._paused_at_ns: int | None = None
        self._next_ns = 0
        self._newest_ns: int | None = None

    def begin(self, stream_ns: int) -> None:
        """Begin at a time of the stream; without this call the first item is due at once."""
        with self._lock:
            self._anchor = (self._clock.now_ns(), stream_ns)

    def wait_until(self, stream_ns: int, stop: threading.Event, closed: threading.Event) -> bool:
        """Wait until an item is due; return False when `stop` or, within 0.1 s, `closed` is set before it.

        An item whose time is out of range is due at once, and leaves the schedule as it is.

        Args:
            stream_ns: time of the item.
            stop: asks the source to end.
            closed: the source is closed.
        """
        if not is_time(stream_ns):
            return not stop.is_set() and not closed.is_set()
        with self._lock:
            now_ns = self._clock.now_ns()
            if self._anchor is None:
                self._anchor = (now_ns, stream_ns)
            self._next_ns = stream_ns
        while not stop.is_set() and not closed.is_set():
            now_ns = self._clock.now_ns()
            due_ns = self._due_ns(stream_ns, now_ns)
            if now_ns >= due_ns:
                with self._lock:
                    self._newest_ns = stream_ns
                return True
            if self._clock.sleep_until_ns(min(due_ns, now_ns + _WAIT_SLICE_NS), stop):
                return False
        return False

    def now_ns(self) -> int | None:
        """Return the present time of the stream, at most that of the item which is due next; None before the first."""
        with self._lock:
            if self._anchor is None or self._newest_ns is None:
                return None
            if math.isinf(self._speed):
                return self._newest_ns
            clock_ns, stream_ns = self._anchor
            at_ns = self._paused_at_ns if self._paused_at_ns is not None else self._clock.now_ns()
            return max(self._newest_ns, min(self._next_ns, stream_ns + round((at_ns - clock_ns) * self._speed)))

    def pause(self, paused: bool) -> None:
        """Stop the time of the stream, or let it go on from where it stopped."""
        with self._lock:
            now_ns = self._clock.now_ns()
            if paused and self._paused_at_ns is None:
                self._paused_at_ns = now_ns
            elif not paused and self._paused_at_ns is not None:
                if self._anchor is not None:
                    self._anchor = (
                        self._anchor[0] + now_ns - max(self._paused_at_ns, self._anchor[0]),
                        self._anchor[1],
                    )
                self._paused_at_ns = None

    def _due_ns(self, stream_ns: int, now_ns: int) -> int:
        with self._lock:
            assert self._anchor is not None
            if self._paused_at_ns is not None:
                return now_ns + _WAIT_SLICE_NS
            if math.isinf(self._speed):
                return now_ns
            clock_ns, first_ns = self._anchor
            return clock_ns + round((stream_ns - first_ns) / self._speed)
