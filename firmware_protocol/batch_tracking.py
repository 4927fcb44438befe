"""Applies the counter rules to a whole block of frames; equal to asking `tracking.SourceTracker` frame by frame."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.sequence import COUNTER_MASK, Window, advance
from firmware_protocol.tracking import LinkTracker, SourceTracker
from firmware_protocol.wire import WINDOW_FRAMES

# Below this, the numpy calls for a source cost more than its frames one by one.
_FEW_FRAMES: Final = 16


class BootNotice(NamedTuple):
    """A hello in a block.

    Attributes:
        place: index of its frame in the block.
        boot_count: what it says.
    """

    place: int
    boot_count: int


def accept_batch(
    tracker: LinkTracker,
    keys: NDArray[np.uint16],
    seqs: NDArray[np.uint32],
    readable: NDArray[np.bool_],
    notices: Sequence[BootNotice],
) -> NDArray[np.bool_]:
    """Count frames by their counters and return which are no duplicates.

    Args:
        tracker: state of the link.
        keys: (k,) sources, `wheel << 8 | hub`.
        seqs: (k,) counters.
        readable: (k,) whether the frame will be delivered unless it is a duplicate.
        notices: the hellos among the frames, in order.
    """
    accepted = np.ones(len(keys), np.bool_)
    if tracker.restarts_within((int(keys[place]) & 0xFF, boot_count) for place, boot_count in notices):
        # A reboot touches every source of the hub at one place of the stream: keep the order.
        _one_by_one(tracker, keys, seqs, readable, notices, np.arange(len(keys)), accepted)
        return accepted
    for key, members in by_key(keys):
        source = tracker.source(key)
        hellos = [notice for notice in notices if keys[notice.place] == key]
        if len(members) < _FEW_FRAMES or not _all_ahead(source, seqs[members]):
            _one_by_one(tracker, keys, seqs, readable, hellos, members, accepted)
            continue
        source.counters.frames += int(np.count_nonzero(readable[members]))
        for hello in hellos:
            tracker.hello(key, hello.boot_count)
    return accepted


def by_key(keys: NDArray[np.uint16]) -> Iterator[tuple[int, NDArray[np.int64]]]:
    """Yield every key, ascending, with the indices at which it stands, ascending."""
    order = np.argsort(keys, kind="stable")
    ordered = keys[order]
    bounds = [0, *(np.flatnonzero(ordered[1:] != ordered[:-1]) + 1).tolist(), len(order)]
    for first, after in pairwise(bounds):
        if after > first:
            yield int(ordered[first]), order[first:after]


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


def _all_ahead(source: SourceTracker, seqs: NDArray[np.uint32]) -> bool:
    """Count frames that are each ahead of the one before; return False, having done nothing, when one is not."""
    window = source.window
    if window is None:
        window = Window.starting(int(seqs[0]))
        seqs = seqs[1:]
    count = len(seqs)
    last = int(seqs[-1])
    steps = np.empty(count, np.uint32)
    steps[0] = (int(seqs[0]) - window.last) & COUNTER_MASK
    np.subtract(seqs[1:], seqs[:-1], out=steps[1:])
    signed = steps.view(np.int32)
    if int(signed.min()) < 1:
        return False
    moved = int(signed.sum(dtype=np.int64))
    if moved == count:
        source.window = advance(window, count)
        return True
    behind = np.uint32(last) - seqs[-WINDOW_FRAMES:]
    bits = np.left_shift(np.uint64(1), behind[behind < WINDOW_FRAMES].astype(np.uint64))
    seen = int(np.bitwise_or.reduce(bits))
    if moved < WINDOW_FRAMES:
        seen |= window.seen << moved & ((1 << WINDOW_FRAMES) - 1)
    source.counters.lost += moved - count
    source.window = Window(last, seen, min(window.span + moved, WINDOW_FRAMES))
    return True
