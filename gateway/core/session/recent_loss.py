"""Share of the frames of a link lost lately: a gap must not be told for a day, nor a good day hide a bad link."""

from collections import deque
from typing import Final

WINDOW_S: Final = 10.0
_WINDOW_NS: Final = round(WINDOW_S * 1e9)
_STEP_NS: Final = 500_000_000


class RecentLoss:
    """Counts of a link over the last WINDOW_S."""

    def __init__(self) -> None:
        """Start without frames."""
        self._counts: deque[tuple[int, int, int]] = deque()

    def share(self, now_ns: int, frames: int, lost: int) -> float | None:
        """Return the share of frames lost in the window, 0 to 1; None where it has no frames.

        Args:
            now_ns: time of the link's newest frames.
            frames: received so far.
            lost: missing so far; frames that come late reduce it.
        """
        if self._counts and now_ns < self._counts[-1][0] - _WINDOW_NS:
            self._counts.clear()
            self._counts.append((now_ns, frames, lost))
        elif not self._counts:
            self._counts.append((now_ns, 0, 0))
        elif now_ns - self._counts[-1][0] >= _STEP_NS:
            self._counts.append((now_ns, frames, lost))
        while len(self._counts) > 1 and now_ns - self._counts[1][0] >= _WINDOW_NS:
            self._counts.popleft()
        _, frames_before, lost_before = self._counts[0]
        received, missing = frames - frames_before, max(lost - lost_before, 0)
        return missing / (received + missing) if received + missing > 0 else None
