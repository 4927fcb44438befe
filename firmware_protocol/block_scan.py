"""Frame search in a whole block at once: the parse of the streaming decoder, with numpy across frames.

Most candidates (sync bytes and a possible length) of a stream follow each other without a gap. Runs of frames of one
length are checked by a single CRC over several of them: an intact frame leaves the CRC in a state that depends on its
length alone, so the CRC of r such frames back to back is a constant. Errors in two of them go unnoticed where they
cancel out, which chance brings about once in 2^32, as it does errors that a frame's own CRC misses.

Only where candidates overlap does it matter which of them the parser would visit; where many do, the block is parsed
in the plain way instead.
"""

from functools import cache
from typing import Final, NamedTuple
from zlib import crc32

import numpy as np
from numpy.typing import NDArray

from firmware_protocol import wire
from firmware_protocol.codec import encode_raw
from firmware_protocol.framing import next_frame

MAX_GROUP: Final = 64
"""Most frames checked by one CRC."""
LOOKAHEAD_BYTES: Final = wire.MAX_FRAME_BYTES
"""Bytes after the end of the block that must be addressable; their content does not matter."""

_BAD: Final = 0
_GOOD: Final = 1
_INCOMPLETE: Final = 2
_NOT_VISITED: Final = 3
_CHUNK: Final = 1 << 14
# Share of candidates that overlap the next above which going through them one by one is quicker.
_DENSE: Final = 0.25

Bytes = NDArray[np.uint8]
Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]


class Scan(NamedTuple):
    """Frames found in a block.

    Attributes:
        start: (k,) offsets of the intact frames.
        total: (k,) their lengths in bytes.
        crc_errors: candidates with a bad CRC.
        truncated: candidates cut off by the end of the stream.
        consumed: offset up to which the block is settled; the rest may be the start of a frame.
    """

    start: Indices
    total: Indices
    crc_errors: int
    truncated: int
    consumed: int


def scan(buffer: Bytes, size: int, *, final: bool, group: int) -> Scan:
    """Parse `buffer[:size]`.

    Args:
        buffer: at least `size + LOOKAHEAD_BYTES` bytes.
        size: bytes of the block.
        final: whether the stream ends here.
        group: frames to check by one CRC, 1 to MAX_GROUP; only the speed depends on it.
    """
    start, end = _candidates(buffer, size)
    overlaps = np.zeros(len(start), np.bool_)
    overlaps[:-1] = start[1:] < end[:-1]
    if np.count_nonzero(overlaps) > _DENSE * len(start):
        return _scan_plainly(buffer[:size].tobytes(), final=final)
    state = np.full(len(start), _INCOMPLETE, np.uint8)
    complete = np.flatnonzero(end <= size)
    state[complete] = _check(buffer, start[complete], end[complete], group)
    decide = np.flatnonzero((overlaps & (state == _GOOD)) | (state == _INCOMPLETE))
    truncated, pending = _walk(start, end, state, decide, final=final) if len(decide) else (0, None)

    good = np.flatnonzero(state == _GOOD)
    start, end = start[good], end[good]
    if final:
        consumed = size
    elif pending is not None:
        consumed = pending
    else:
        after = int(end[-1]) if len(end) else 0
        consumed = size - (after < size and int(buffer[size - 1]) == wire.SYNC[0])
    return Scan(start, end - start, int(np.count_nonzero(state == _BAD)), truncated, consumed)


def _candidates(buffer: Bytes, size: int) -> tuple[Indices, Indices]:
    """Return start and end of every candidate, in order; those whose length is not there yet end after `size`."""
    sync = np.uint16(int.from_bytes(wire.SYNC, "little"))
    pairs = size // 2
    even = buffer[: 2 * pairs].view("<u2")
    # The block is followed by at least one addressable byte; a pair that reaches into it is dropped below.
    odd = buffer[1 : 1 + 2 * pairs].view("<u2")
    at_even, at_odd = even == sync, odd == sync
    pair = np.flatnonzero(np.logical_or(at_even, at_odd, out=at_odd))
    start = 2 * pair + 1 - at_even[pair]
    start = start[: np.searchsorted(start, size - 1)]
    end = start + buffer[start + wire.LENGTH_OFFSET]
    end += wire.OVERHEAD_BYTES
    end[np.searchsorted(start, size - wire.LENGTH_OFFSET) :] = size + 1
    possible = end - start <= wire.MAX_FRAME_BYTES
    return (start, end) if possible.all() else (start[possible], end[possible])


def _check(buffer: Bytes, start: Indices, end: Indices, group: int) -> Flags:
    """Return which candidates have a good CRC, checking runs of frames of one length `group` at a time."""
    count = len(start)
    if not count:
        return np.zeros(0, np.bool_)
    total = end - start
    new_run = np.flatnonzero((end[:-1] != start[1:]) | (total[:-1] != total[1:])) + 1
    run = np.concatenate(([0], new_run, [count]))
    pieces = -(-np.diff(run) // group)
    before = np.cumsum(pieces) - pieces
    first = np.repeat(run[:-1] - group * before, pieces) + group * np.arange(pieces.sum())
    after = np.minimum(first + group, np.repeat(run[1:], pieces))
    frames = after - first
    right = _crcs(buffer, start[first], end[after - 1]) == _of_runs(total[first], frames)
    good = np.ones(count, np.bool_)
    wrong = np.flatnonzero(~right)
    if len(wrong):
        of_several = wrong[frames[wrong] > 1]
        each = np.repeat(first[of_several] - np.cumsum(frames[of_several]) + frames[of_several], frames[of_several])
        each += np.arange(len(each))
        good[first[wrong]] = False
        good[each] = _crcs(buffer, start[each], end[each]) == wire.CRC_RESIDUE
    return good


def _crcs(buffer: Bytes, start: Indices, end: Indices) -> NDArray[np.uint32]:
    view = buffer.data
    out = np.empty(len(start), np.uint32)
    for index in range(0, len(start), _CHUNK):
        chunk = slice(index, index + _CHUNK)
        out[chunk] = [crc32(view[a:b]) for a, b in zip(start[chunk].tolist(), end[chunk].tolist(), strict=True)]
    return out


def _of_runs(total: Indices, frames: Indices) -> NDArray[np.uint32]:
    """Return the CRCs of runs of intact frames: `frames` of `total` bytes each, (n,)."""
    lengths, index = np.unique(total, return_inverse=True)
    crcs: NDArray[np.uint32] = np.stack([_back_to_back(length) for length in lengths.tolist()])[index, frames]
    return crcs


@cache
def _back_to_back(total: int) -> NDArray[np.uint32]:
    """Return the CRCs of intact frames of `total` bytes back to back, whatever they hold, by their number."""
    crcs = np.zeros(MAX_GROUP + 1, np.uint32)
    payload = total - len(encode_raw(0, b"", 0, 0, 0, 0))
    if payload < 0:
        return crcs  # no frame is that short
    frame, crc = encode_raw(0, bytes(payload), 0, 0, 0, 0), 0
    for count in range(1, MAX_GROUP + 1):
        crc = crcs[count] = crc32(frame, crc)
    return crcs


def _walk(
    start: Indices, end: Indices, state: NDArray[np.uint8], decide: Indices, *, final: bool
) -> tuple[int, int | None]:
    """Visit, as the parser would, the candidates at which the way on is not plain; settle `state` by that.

    Args:
        start: offsets of all candidates.
        end: their ends.
        state: of each; afterwards candidates that the parser jumps over or never reaches are _NOT_VISITED.
        decide: indices of the candidates that are good and overlap the next, or are incomplete.
        final: whether incomplete candidates will stay so.

    Returns:
        Number of truncated frames, and the offset of the candidate that waits for more bytes, if any.
    """
    followers = np.searchsorted(start, end[decide]).tolist()
    visited = 0
    truncated = 0
    for index, follower, is_good in zip(decide.tolist(), followers, (state[decide] == _GOOD).tolist(), strict=True):
        if index < visited:
            continue
        if is_good:
            state[index + 1 : follower] = _NOT_VISITED
            visited = follower
        elif final:
            truncated += 1
        else:
            state[index:] = _NOT_VISITED
            return truncated, int(start[index])
    return truncated, None


def _scan_plainly(block: bytes, *, final: bool) -> Scan:
    """Parse frame by frame: where candidates crowd inside each other, the parser visits few of them."""
    starts: list[int] = []
    ends: list[int] = []
    crc_errors = truncated = offset = 0
    while True:
        offset, end, errors = next_frame(block, offset)
        crc_errors += errors
        if end:
            starts.append(offset)
            ends.append(end)
            offset = end
        elif final and offset < len(block):
            truncated += offset + 1 < len(block)
            offset += 1
        else:
            start = np.array(starts, np.int64)
            return Scan(start, np.array(ends, np.int64) - start, crc_errors, truncated, offset)
