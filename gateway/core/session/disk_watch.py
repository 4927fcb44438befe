"""Free space of the disk that a session records to, and the time until it is full."""

import shutil
from collections import deque
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

from gateway.core.estimates.results import DiskRoom
from gateway.core.reasons import Notice, Reason
from gateway.core.session.reasons import SessionCode

_WINDOW_NS: Final = 60_000_000_000
_MIN_SPAN_NS: Final = 10_000_000_000


class DiskWatch:
    """Measures free space and how fast it is used; called by the thread that writes, which the disk may hold."""

    def __init__(self, folder: Path, size_bytes: Callable[[], int], most_bytes: Callable[[], int | None]) -> None:
        """Start without a measurement.

        Args:
            folder: of the recording.
            size_bytes: returns the size of the recording so far.
            most_bytes: returns the size that it keeps at most, None for any.
        """
        self._folder = folder
        self._size_bytes = size_bytes
        self._most_bytes = most_bytes
        self._history: deque[tuple[int, int, int]] = deque()

    def room(self, now_ns: int) -> DiskRoom | None:
        """Return what is left, None where the system does not say.

        Other programs may use the disk too, so the faster of the recording and the disk counts.
        """
        try:
            free = shutil.disk_usage(self._folder).free
        except OSError:
            return None
        size = self._size_bytes()
        self._history.append((now_ns, size, free))
        while now_ns - self._history[0][0] > _WINDOW_NS:
            self._history.popleft()
        then_ns, size_then, free_then = self._history[0]
        used = max(size - size_then, free_then - free)
        if now_ns - then_ns < _MIN_SPAN_NS or used <= 0:
            return DiskRoom(free, None)
        max_bytes = self._most_bytes()
        if max_bytes is not None and max_bytes - size < free and free_then - free <= max(size - size_then, 0):
            return DiskRoom(free, None)
        return DiskRoom(free, free * (now_ns - then_ns) * 1e-9 / used)


def disk_notices(before: DiskRoom | None, now: DiskRoom) -> Iterator[Notice]:
    """Yield what a session says once: the space at its start, and the time left when it is known."""
    if before is None:
        yield Notice("recording", Reason(SessionCode.DISK_SPACE, lasts="unknown", free_bytes=now.free_bytes))
    elif before.left_s is None and now.left_s is not None:
        yield Notice(
            "recording", Reason(SessionCode.DISK_SPACE, lasts="hours", free_bytes=now.free_bytes, left_s=now.left_s)
        )
