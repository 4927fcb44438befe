"""Assignment of bytes of unknown origin to links, by frame checksums and hub clocks."""

from collections.abc import Iterator
from typing import Final, NamedTuple

from firmware_protocol.framing import next_frame
from firmware_protocol.wire import HEADER, MAX_FRAME_BYTES, SYNC

REACH: Final = MAX_FRAME_BYTES - 1
"""Number of bytes after a place that a frame that started before it can need at most."""
_HEADER: Final = HEADER.reader("hub", "tick_us")
_MAX_TRIMS: Final = 65_536
_MAX_TRIMS_AT_END: Final = 2048
_HISTORY_BYTES: Final = 16_384
# A frame that lacks fewer bytes than this may pass its checksum by chance.
_MIN_CERTAIN_BYTES: Final = 3
_TICK_RANGE: Final = 1 << 32
_TICK_TOLERANCE_US: Final = 2_000_000
_MAX_TICKS_AHEAD_US: Final = 600_000_000


class FrameAt(NamedTuple):
    """Intact frame: hub, the hub's time, start and end in the given bytes."""

    hub: int
    tick_us: int
    start: int
    end: int


class Run(NamedTuple):
    """Consecutive frames of one link: start of the first and end of the last."""

    link: int
    start: int
    end: int


class LinkHistory:
    """Latest bytes of the stream of one link before a torn place."""

    def __init__(self) -> None:
        self._bytes = bytearray()
        self._ticks: dict[int, int] | None = None

    def append(self, data: bytes) -> None:
        """Append the next bytes of the stream."""
        self._bytes += data
        self._ticks = None
        if len(self._bytes) > 2 * _HISTORY_BYTES:
            del self._bytes[:-_HISTORY_BYTES]

    def unfinished(self) -> bytes:
        """Return the end of the stream from the possible start of an incomplete frame."""
        return unfinished(bytes(self._bytes[-REACH:]))

    def tail(self) -> bytes:
        """Return the end of the stream, with the length of an incomplete frame."""
        return bytes(self._bytes[-REACH:])

    def ticks_us(self) -> dict[int, int]:
        """Return the latest time of each hub in the kept bytes."""
        if self._ticks is None:
            self._ticks = ticks_in(bytes(self._bytes))
        return self._ticks


def frames_in(data: bytes) -> list[FrameAt]:
    """Return the intact frames in `data`, which may contain bytes of several links and start and end anywhere."""
    return [FrameAt(*_hub_and_tick(data, start), start, end) for start, end in _places(data)]


def ticks_in(data: bytes) -> dict[int, int]:
    """Return the latest time of each hub in `data`."""
    return {frame.hub: frame.tick_us for frame in frames_in(data)}


def intact(data: bytes) -> int:
    """Return the number of frames in `data` that pass their checksum."""
    return sum(1 for _ in _places(data))


def unfinished(tail: bytes) -> bytes:
    """Return the end of `tail` from the possible start of an incomplete frame."""
    start, end, _ = next_frame(tail, 0)
    while end:
        start, end, _ = next_frame(tail, end)
    return tail[start:]


def completes(data: bytes, following: bytes) -> bool:
    """Return whether a frame starts in `data` and passes its checksum with the following bytes."""
    tail = unfinished(data[-REACH:])
    return bool(tail) and intact(tail + following[:REACH]) > intact(following[:REACH])


def continuation(pending: bytes, data: bytes, following: bytes, begin: int = 0, until: int | None = None) -> int | None:
    """Return the number of bytes to remove from the start of `data` so that the frame started by `pending` passes.

    A frame that lacks only its last bytes may pass by chance at a wrong place, so the next frame must follow it.

    Args:
        pending: start of a frame, as returned by `unfinished`.
        data: bytes that may contain its rest, after bytes that do not belong to the stream.
        following: bytes of the stream after `data`.
        begin: smallest number to remove.
        until: largest number to remove; the frame cannot continue after the next frame of the link.

    Returns:
        The number of bytes, len(data) when the frame continues in `following`, None when it passes nowhere.
    """
    if not pending:
        return None
    passing: int | None = None
    others: list[FrameAt] | None = None
    last = len(data) if until is None else until
    trims: list[int] = [*range(begin, min(last, begin + _MAX_TRIMS)), last]
    for trim in trims:
        window = data[trim : trim + REACH]
        window += following[: REACH - len(window)]
        if intact(pending + window) > intact(window):
            end = next(
                (candidate.end for candidate in frames_in(pending + window) if candidate.start < len(pending)),
                len(pending),
            )
            used = end - len(pending)
            others = frames_in(data + following[:REACH]) if others is None else others
            if any(frame.start < trim + used and frame.end > trim for frame in others):
                continue  # all frames start alike, and this is the rest of a frame that is complete in `data`
            if SYNC.startswith((data[trim:] + following)[used : used + len(SYNC)]):
                return trim
            if passing is None and used >= _MIN_CERTAIN_BYTES:
                passing = trim
    return passing


def ending(data: bytes, following: bytes) -> int:
    """Return the length of `data` to keep so that its last, incomplete frame continues in `following`.

    Returns:
        The length, len(data) when no other length completes a frame.
    """
    window = following[:REACH]
    plain = intact(window)
    for until in range(len(data), max(0, len(data) - _MAX_TRIMS_AT_END), -1):
        tail = data[max(0, until - REACH) : until]
        if intact(tail + window) > plain + intact(tail):
            return until
    return len(data)


class Span(NamedTuple):
    """Times of a link's hubs around a torn place: the latest before it, and the first after it."""

    before_us: dict[int, int]
    after_us: dict[int, int]

    def admits(self, frame: FrameAt) -> bool | None:
        """Return whether a hub of this link can have sent a frame there; None when the hub is unknown."""
        before, after = self.before_us.get(frame.hub), self.after_us.get(frame.hub)
        first = before if before is not None else after
        if first is None:
            return None
        # After a restart of the hub the span is nearly the whole range of the ticks, and every frame is admitted.
        span = (after - first) % _TICK_RANGE if after is not None else _MAX_TICKS_AHEAD_US
        return (frame.tick_us - first + _TICK_TOLERANCE_US) % _TICK_RANGE <= span + 2 * _TICK_TOLERANCE_US


def without_foreign_frames(data: bytes, span: Span) -> bytes:
    """Return `data` without frames that no hub can have sent there: remains of deleted files on the disk."""
    remaining = bytearray()
    begin = 0
    for frame in frames_in(data):
        if span.admits(frame) is False:
            remaining += data[begin : frame.start]
            begin = frame.end
    return bytes(remaining + data[begin:]) if begin else data


def divide(
    frames: list[FrameAt],
    ticks_us: dict[int, dict[int, int]],
    head: int | None = None,
    bounds: tuple[int, int] = (0, 1 << 62),
) -> list[Run]:
    """Assign the frames of a torn place to links.

    Every hub has its own clock, so frames follow the earlier ones of their link closely.

    Args:
        frames: frames in the order of the stream.
        ticks_us: latest time of each hub, by possible link.
        head: link of the message that starts here, None when unknown.
        bounds: frames before the first bound belong to `head`, frames after the second do not.
    """
    ticks = {link: dict(hubs) for link, hubs in ticks_us.items()}

    def distance_us(link: int, frame: FrameAt) -> int:
        latest_us = ticks[link].get(frame.hub)
        return (
            abs((frame.tick_us - latest_us + _TICK_RANGE // 2) % _TICK_RANGE - _TICK_RANGE // 2)
            if latest_us is not None
            else _TICK_RANGE
        )

    runs: list[Run] = []
    for frame in frames:
        links = list(ticks)
        if head is not None and frame.start < bounds[0]:
            links = [head]
        elif frame.end > bounds[1] and len(links) > 1:
            links = [link for link in links if link != head]
        owner = min(links, key=lambda link: (distance_us(link, frame), link != head))
        ticks[owner][frame.hub] = frame.tick_us
        if runs and runs[-1].link == owner:
            runs[-1] = runs[-1]._replace(end=frame.end)
        else:
            runs.append(Run(owner, frame.start, frame.end))
    return runs


def _places(data: bytes) -> Iterator[tuple[int, int]]:
    position = 0
    while position < len(data):
        start, end, _ = next_frame(data, position)
        if end:
            yield start, end
        # A frame that does not fit may hide others that do.
        position = end or start + 1


def _hub_and_tick(data: bytes, start: int) -> tuple[int, int]:
    hub, tick_us = _HEADER.unpack_from(data, start)
    return hub, tick_us
