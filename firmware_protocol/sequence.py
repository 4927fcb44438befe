"""Classification of frames by their wrapping counters. Pure functions."""

from __future__ import annotations

from enum import Enum
from typing import Final, NamedTuple

from firmware_protocol.wire import COUNTER_BITS, WINDOW_FRAMES

COUNTER_MASK: Final = (1 << COUNTER_BITS) - 1
FULL_WINDOW: Final = (1 << WINDOW_FRAMES) - 1
_HALF: Final = 1 << (COUNTER_BITS - 1)


class Arrival(Enum):
    """Position of a frame relative to the earlier frames of its source."""

    FIRST = "first"
    IN_ORDER = "in order"
    GAP = "after a gap"
    LATE = "late"
    DUPLICATE = "duplicate"
    RESTART = "restart"


class Window(NamedTuple):
    """History of a source's counters.

    Attributes:
        last: highest counter since the start.
        seen: bit i is set when `last - i` has arrived.
        span: number of counters in the window at or after the first one seen, at most WINDOW_FRAMES.
    """

    last: int
    seen: int
    span: int

    @classmethod
    def starting(cls, seq: int) -> Window:
        """Return the window of a source whose first frame carries `seq`."""
        return cls(seq, 1, 1)


class Verdict(NamedTuple):
    """Meaning of one counter.

    Attributes:
        arrival: kind of arrival.
        lost: change of the number of lost frames: the gap before this frame, or -1 for a late frame counted before.
        window: the source's window after this frame.
    """

    arrival: Arrival
    lost: int
    window: Window


def classify(window: Window | None, seq: int) -> Verdict:
    """Classify a frame by its counter.

    A counter up to half its range ahead is new; one less than WINDOW_FRAMES behind is late or a duplicate; any other is
    a restart of the source.

    Args:
        window: history of the source, None for its first frame.
        seq: counter of the frame, 32 bit.
    """
    if window is None:
        return Verdict(Arrival.FIRST, 0, Window.starting(seq))
    last, seen, span = window
    ahead = (seq - last) & COUNTER_MASK
    if 0 < ahead < _HALF:
        arrived = (seen << ahead | 1) & FULL_WINDOW if ahead < WINDOW_FRAMES else 1
        moved = Window(seq, arrived, min(span + ahead, WINDOW_FRAMES))
        return Verdict(Arrival.IN_ORDER if ahead == 1 else Arrival.GAP, ahead - 1, moved)
    behind = -ahead & COUNTER_MASK
    if behind >= WINDOW_FRAMES:
        return Verdict(Arrival.RESTART, 0, Window.starting(seq))
    bit = 1 << behind
    if seen & bit:
        return Verdict(Arrival.DUPLICATE, 0, window)
    # Frames from before the first one seen were never counted as lost.
    return Verdict(Arrival.LATE, -1 if behind < span else 0, Window(last, seen | bit, span))


def advance(window: Window, frames: int) -> Window:
    """Return `window` after `frames` more frames, each the next of the one before."""
    if not frames:
        return window
    seen = FULL_WINDOW
    if frames < WINDOW_FRAMES:
        seen = ((window.seen + 1 << frames) - 1) & FULL_WINDOW
    return Window((window.last + frames) & COUNTER_MASK, seen, min(window.span + frames, WINDOW_FRAMES))


def unwrap(last_unwrapped: int, value: int, bits: int = COUNTER_BITS) -> int:
    """Return the number nearest to `last_unwrapped` whose low `bits` bits are `value`.

    >>> unwrap(0xFFFF_FFF0, 5)
    4294967301
    >>> unwrap(4294967301, 0xFFFF_FFF0)
    4294967280
    """
    span = 1 << bits
    half = span >> 1
    return last_unwrapped + (value - last_unwrapped + half) % span - half
