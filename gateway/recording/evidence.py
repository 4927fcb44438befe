"""What frame checksums and hub clocks tell about bytes of unknown origin: whose they are, and where they belong."""

from __future__ import annotations

from collections.abc import Iterator
from struct import Struct
from typing import Final, NamedTuple

from firmware_protocol.framing import next_frame
from firmware_protocol.wire import HEADER_FORMAT, MAX_FRAME_BYTES, SYNC

REACH: Final = MAX_FRAME_BYTES - 1
"""A frame that began before a place needs at most so many bytes behind it."""
_HEADER: Final = Struct(HEADER_FORMAT)
_MOST_TRIMS: Final = 65_536
_MOST_TRIMS_BEHIND: Final = 2048
_HISTORY_BYTES: Final = 16_384
_NO_CHANCE_BYTES: Final = 3
_TICKS: Final = 1 << 32
_SLACK_US: Final = 2_000_000
_MOST_AHEAD_US: Final = 600_000_000


class FrameAt(NamedTuple):
    """An intact frame's hub and the hub's time, and where it begins and ends in the bytes looked at."""

    hub: int
    tick_us: int
    start: int
    end: int


class Run(NamedTuple):
    """Frames in a row of one link: where the first begins and the last ends."""

    link: int
    start: int
    end: int


class LinkHistory:
    """The latest bytes of one link's stream, before a torn place."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._ticks: dict[int, int] | None = None

    def append(self, data: bytes) -> None:
        """Note what the stream went on with."""
        self._bytes += data
        self._ticks = None
        if len(self._bytes) > 2 * _HISTORY_BYTES:
            del self._bytes[:-_HISTORY_BYTES]

    def unfinished(self) -> bytes:
        """Return the end of the stream from where a frame may have begun that is not complete."""
        return unfinished(bytes(self._bytes[-REACH:]))

    def tail(self) -> bytes:
        """Return the end of the stream, as much as a frame may need of it."""
        return bytes(self._bytes[-REACH:])

    def ticks_us(self) -> dict[int, int]:
        """Return the latest time of each hub that spoke lately."""
        if self._ticks is None:
            self._ticks = ticks_in(bytes(self._bytes))
        return self._ticks


def frames_in(data: bytes) -> list[FrameAt]:
    """Return the intact frames in `data`, which may begin and end anywhere; of several links too, so repeats count."""
    return [FrameAt(*_hub_and_tick(data, start), start, end) for start, end in _places(data)]


def ticks_in(data: bytes) -> dict[int, int]:
    """Return the latest time of each hub in `data`."""
    return {frame.hub: frame.tick_us for frame in frames_in(data)}


def intact(data: bytes) -> int:
    """Return how many frames pass their checksum in `data`."""
    return sum(1 for _ in _places(data))


def unfinished(tail: bytes) -> bytes:
    """Return the end of `tail` from where a frame may have begun that is not complete."""
    start, end, _ = next_frame(tail, 0)
    while end:
        start, end, _ = next_frame(tail, end)
    return tail[start:]


def completes(data: bytes, following: bytes) -> bool:
    """Tell whether a frame begins in `data` and passes with what follows."""
    tail = unfinished(data[-REACH:])
    return bool(tail) and intact(tail + following[:REACH]) > intact(following[:REACH])


def continuation(pending: bytes, data: bytes, following: bytes, begin: int = 0, until: int | None = None) -> int | None:
    """Return how many bytes of `data` must go so that the frame that `pending` begins passes.

    A frame that lacks only its last bytes may pass by chance at a wrong place; the next frame must begin behind it
    then.

    Args:
        pending: start of a frame, as `unfinished` returns it.
        data: bytes that may hold its rest, behind bytes that do not belong to the stream.
        following: how the stream goes on behind `data`.
        begin: the least to go.
        until: the most to go; the frame cannot go on behind the link's next one.

    Returns:
        The trim, len(data) when the frame goes on right at `following`, None when it passes nowhere.
    """
    if not pending:
        return None
    passing: int | None = None
    others: list[FrameAt] | None = None
    last = len(data) if until is None else until
    trims: list[int] = [*range(begin, min(last, begin + _MOST_TRIMS)), last]
    for trim in trims:
        window = data[trim : trim + REACH]
        window += following[: REACH - len(window)]
        if intact(pending + window) > intact(window):
            end = next((at.end for at in frames_in(pending + window) if at.start < len(pending)), len(pending))
            used = end - len(pending)
            others = frames_in(data + following[:REACH]) if others is None else others
            if any(frame.start < trim + used and frame.end > trim for frame in others):
                continue  # all frames begin alike: this is the rest of one that is whole by itself
            if SYNC.startswith((data[trim:] + following)[used : used + len(SYNC)]):
                return trim
            if passing is None and used >= _NO_CHANCE_BYTES:
                passing = trim
    return passing


def ending(data: bytes, following: bytes) -> int:
    """Return where `data` must end so that the frame that it leaves unfinished goes on right at `following`.

    Returns:
        The length to keep, len(data) when no other serves a frame.
    """
    window = following[:REACH]
    plain = intact(window)
    for until in range(len(data), max(0, len(data) - _MOST_TRIMS_BEHIND), -1):
        tail = data[max(0, until - REACH) : until]
        if intact(tail + window) > plain + intact(tail):
            return until
    return len(data)


class Span(NamedTuple):
    """The times of a link's hubs around a torn place, latest before and first known behind it."""

    before_us: dict[int, int]
    after_us: dict[int, int]

    def admits(self, frame: FrameAt) -> bool | None:
        """Tell whether a hub of this link can have sent a frame there; None when the hub is not known here."""
        before, after = self.before_us.get(frame.hub), self.after_us.get(frame.hub)
        first = before if before is not None else after
        if first is None:
            return None
        # After a restart of the hub the span is nearly the whole circle, and everything passes.
        span = (after - first) % _TICKS if after is not None else _MOST_AHEAD_US
        return (frame.tick_us - first + _SLACK_US) % _TICKS <= span + 2 * _SLACK_US


def without_strangers(data: bytes, span: Span) -> bytes:
    """Return `data` without frames that a hub cannot have sent there: left-overs of other files on the disk."""
    kept = bytearray()
    begin = 0
    for frame in frames_in(data):
        if span.admits(frame) is False:
            kept += data[begin : frame.start]
            begin = frame.end
    return bytes(kept + data[begin:]) if begin else data


def divide(
    frames: list[FrameAt],
    ticks_us: dict[int, dict[int, int]],
    head: int | None = None,
    bounds: tuple[int, int] = (0, 1 << 62),
) -> list[Run]:
    """Say which link the frames of a torn place belong to.

    Every hub has its own clock, so that frames follow those of their own link within moments.

    Args:
        frames: in the order of the stream.
        ticks_us: for each link that comes into question the latest time of each of its hubs.
        head: the link of the message that begins here, None when not known.
        bounds: before the first only `head` can have frames, behind the second it can have none.
    """
    ticks = {link: dict(hubs) for link, hubs in ticks_us.items()}

    def distance_us(link: int, frame: FrameAt) -> int:
        known = ticks[link].get(frame.hub)
        return abs((frame.tick_us - known + _TICKS // 2) % _TICKS - _TICKS // 2) if known is not None else _TICKS

    found: list[Run] = []
    for frame in frames:
        links = list(ticks)
        if head is not None and frame.start < bounds[0]:
            links = [head]
        elif frame.end > bounds[1] and len(links) > 1:
            links = [link for link in links if link != head]
        owner = min(links, key=lambda link: (distance_us(link, frame), link != head))
        ticks[owner][frame.hub] = frame.tick_us
        if found and found[-1].link == owner:
            found[-1] = found[-1]._replace(end=frame.end)
        else:
            found.append(Run(owner, frame.start, frame.end))
    return found


def _places(data: bytes) -> Iterator[tuple[int, int]]:
    at = 0
    while at < len(data):
        start, end, _ = next_frame(data, at)
        if end:
            yield start, end
        # A frame that has no room for its end may hide others that have.
        at = end or start + 1


def _hub_and_tick(data: bytes, start: int) -> tuple[int, int]:
    _, _, _, _, hub, _, _, _, tick_us = _HEADER.unpack_from(data, start)
    return hub, tick_us
