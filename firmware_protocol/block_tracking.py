"""Counter rules for a whole block of frames, equal to `source_tracking.SourceTracker` frame by frame."""

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.sequence import COUNTER_MASK, FULL_WINDOW, Window, advance
from firmware_protocol.source_tracking import LinkTracker, SourceTracker
from firmware_protocol.wire import WINDOW_FRAMES

# Below this, the numpy calls for a source cost more than its frames one by one.
_FEW_FRAMES: Final = 16


class BootNotice(NamedTuple):
    """A hello in a block.

    Attributes:
        place: index of its frame in the block.
        boot_count: boot count in the hello.
    """

    place: int
    boot_count: int


class BySource(NamedTuple):
    """Frames of a block sorted by source, in the order of the stream within each.

    Attributes:
        keys: the s sources, `wheel << 8 | hub`, ascending.
        order: (k,) indices of the frames.
        bounds: (s + 1,) first place in `order` of every source, and the end.
    """

    keys: list[int]
    order: NDArray[np.int64]
    bounds: list[int]

    def groups(self) -> Iterator[tuple[int, NDArray[np.int64]]]:
        """Yield every source with the indices of its frames, ascending."""
        for key, (first, after) in zip(self.keys, pairwise(self.bounds), strict=True):
            yield key, self.order[first:after]


def by_source(keys: NDArray[np.uint16]) -> BySource:
    """Sort frames by their source, `wheel << 8 | hub`."""
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    if not len(ordered):
        return BySource([], order, [0])
    first = [0, *(np.flatnonzero(ordered[1:] != ordered[:-1]) + 1).tolist()]
    return BySource(ordered[first].tolist(), order, [*first, len(order)])


def accept_batch(
    tracker: LinkTracker,
    keys: NDArray[np.uint16],
    seqs: NDArray[np.uint32],
    readable: NDArray[np.bool_],
    notices: Sequence[BootNotice],
    sources: BySource,
) -> NDArray[np.bool_]:
    """Count frames by their counters and return which are no duplicates.

    Args:
        tracker: state of the link.
        keys: (k,) sources.
        seqs: (k,) counters.
        readable: (k,) whether the frame will be delivered unless it is a duplicate.
        notices: the hellos among the frames, in order.
        sources: `by_source(keys)`.
    """
    accepted = np.ones(len(keys), np.bool_)
    if not len(keys):
        return accepted
    if tracker.restarts_within((int(keys[position]) & 0xFF, boot_count) for position, boot_count in notices):
        # A reboot touches every source of the hub at one place of the stream: keep the order.
        _one_by_one(tracker, keys, seqs, readable, notices, np.arange(len(keys)), accepted)
        return accepted
    ordered = seqs[sources.order]
    firsts = sources.bounds[:-1]
    steps = np.empty(len(ordered), np.uint32)
    np.subtract(ordered[1:], ordered[:-1], out=steps[1:])
    trackers = [tracker.source(key) for key in sources.keys]
    steps[firsts] = [
        (seq - source.expected + 1) & COUNTER_MASK if source.window is not None else 1
        for source, seq in zip(trackers, ordered[firsts].tolist(), strict=True)
    ]
    signed = steps.view(np.int32)
    least = np.minimum.reduceat(signed, firsts).tolist()
    moved = np.add.reduceat(signed, firsts, dtype=np.int64).tolist()
    delivered = np.add.reduceat(readable[sources.order], firsts, dtype=np.int64).tolist()
    by_key: dict[int, list[BootNotice]] = {}
    for notice in notices:
        by_key.setdefault(int(keys[notice.place]), []).append(notice)
    for index, (key, source) in enumerate(zip(sources.keys, trackers, strict=True)):
        rows = slice(sources.bounds[index], sources.bounds[index + 1])
        hellos = by_key.get(key, [])
        if least[index] < 1 or rows.stop - rows.start < _FEW_FRAMES:
            _one_by_one(tracker, keys, seqs, readable, hellos, sources.order[rows], accepted)
            continue
        _all_ahead(source, ordered[rows], moved[index])
        source.counters.frames += delivered[index]
        for hello in hellos:
            tracker.hello(key, hello.boot_count)
    return accepted


def _one_by_one(
    tracker: LinkTracker,
    keys: NDArray[np.uint16],
    seqs: NDArray[np.uint32],
    readable: NDArray[np.bool_],
    notices: Sequence[BootNotice],
    members: NDArray[np.int64],
    accepted: NDArray[np.bool_],
) -> None:
    boots = dict(notices)
    columns = (members, keys[members], seqs[members], readable[members])
    for index, key, seq, counts in zip(*(column.tolist() for column in columns), strict=True):
        if index in boots:
            tracker.hello(key, boots[index])
        source = tracker.source(key)
        if not source.accept(seq):
            accepted[index] = False
        elif counts:
            source.counters.frames += 1


def _all_ahead(source: SourceTracker, seqs: NDArray[np.uint32], moved: int) -> None:
    """Count frames that are each ahead of the one before, by `moved` counters altogether."""
    count = len(seqs)
    window = source.window
    if window is None:
        window = Window.starting(int(seqs[0]))
        moved -= 1
        count -= 1
    if moved == count:
        source.window = advance(window, count)
        return
    last = int(seqs[-1])
    behind = seqs[-1] - seqs[-WINDOW_FRAMES:]
    bits = np.left_shift(np.uint64(1), behind[behind < WINDOW_FRAMES].astype(np.uint64))
    seen = int(np.bitwise_or.reduce(bits))
    if moved < WINDOW_FRAMES:
        seen |= window.seen << moved & FULL_WINDOW
    source.counters.lost += moved - count
    source.window = Window(last, seen, min(window.span + moved, WINDOW_FRAMES))
