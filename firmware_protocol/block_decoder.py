"""Block decoder for recorded streams: the frames and counters of the streaming decoder, many times faster."""

from collections.abc import Iterator
from enum import IntEnum
from functools import lru_cache
from itertools import pairwise
from math import isqrt
from operator import itemgetter
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from firmware_protocol import wire
from firmware_protocol.block_scan import LOOKAHEAD_BYTES, MAX_GROUP, Bytes, Indices, scan
from firmware_protocol.block_tracking import BootNotice, BySource, accept_batch, by_source
from firmware_protocol.codec import DECODERS, FIXED_LENGTHS, SAMPLE_DTYPE, SAMPLE_LAYOUTS, decode_payload
from firmware_protocol.counters import LinkCounters
from firmware_protocol.declaration import SAMPLES, SAMPLES_FRAME, SAMPLES_WORD
from firmware_protocol.frame_blocks import Admits, Heard, SampleRun, Stretch
from firmware_protocol.messages import Frame, Hello, Message, MessageType
from firmware_protocol.signing import Gate
from firmware_protocol.source_tracking import LinkTracker

# The header and the start of a sample payload as six little-endian 32-bit words, one row of an array each.
_NAMES: Final = ("sync", "length", "seq", "tick_us", "first_sample", "axes")
_WORD0, _WORD1, _SEQ, _TICK, _FIRST_SAMPLE, _AXES_N = (SAMPLES_FRAME.offset(name) // 4 for name in _NAMES)
_WORDS: Final = _AXES_N + 1
_FLAGS_SHIFT: Final = 8 * (wire.FLAGS_OFFSET % 4)
_NO_FLAGS: Final = (1 << _FLAGS_SHIFT) - 1
_UNKNOWN_FLAGS: Final = 0xFF & ~wire.KNOWN_FLAGS
_NO_ROOM: Final = -wire.TAG_BYTES
_SAMPLES: Final = int(MessageType.SAMPLES)
_NO_HUB: Final = 1 << 8
_RAISES_THRESHOLD_BYTES: Final = 24 << 20
_ANY: Final = -1
_NONE: Final = -2
# Payload length by type: _ANY where it takes a look inside, _NONE where there is no such type.
_LENGTHS: Final = np.array(
    [FIXED_LENGTHS.get(type_, _ANY if type_ in DECODERS else _NONE) for type_ in range(256)], np.int16
)
_SAMPLE_LENGTHS: Final = np.array([length for length, _ in SAMPLE_LAYOUTS], np.int16)


Words = NDArray[np.uint32]


class _Fate(IntEnum):
    """Classification of an intact frame."""

    READABLE = 0
    NEWER_MINOR = 1
    UNKNOWN_FLAGS = 2
    UNKNOWN_TYPE = 3
    BAD_PAYLOAD = 4


class SampleGroup(NamedTuple):
    """All sample blocks of one wheel and shape in a batch, in the order of the stream.

    Attributes:
        hub: number of the hub.
        wheel: number of the wheel.
        axes: axis mask.
        frame_index: (k,) places in the batch.
        first_sample: (k,) running number of each block's first sample, 32 bit, wraps.
        tick_us: (k,) hub time of each block's first sample, 32 bit, wraps.
        counts: (k, n, channels) samples.
    """

    hub: int
    wheel: int
    axes: int
    frame_index: Indices
    first_sample: NDArray[np.uint32]
    tick_us: NDArray[np.uint32]
    counts: NDArray[np.int16]

    def run(self, first: int, end: int) -> SampleRun:
        """Return blocks that follow each other without a gap, from `first` to `end`, exclusive."""
        part = slice(first, end)
        samples = self.counts[part].reshape(-1, self.counts.shape[2])
        number, ticks_us = int(self.first_sample[first]), self.tick_us[part].tolist()
        return SampleRun(self.hub, self.wheel, self.axes, number, ticks_us, samples, self.frame_index[part])


class FrameBatch:
    """Frames of one block, in the order of the stream. Everything in it is valid until the decoder is fed again.

    Attributes:
        type: (k,) uint8 type bytes.
        hub: (k,) uint8.
        wheel: (k,) uint8.
        seq: (k,) uint32 counters.
        tick_us: (k,) uint32 hub times.
        end_offset: (k,) int64 offset in the whole stream of the byte after each frame.
    """

    def __init__(self, buffer: Bytes, start: Indices, words: Words, sources: BySource, base: int) -> None:
        self._buffer = buffer
        self._start = start
        self._words = words
        self._sources = sources
        self.type = _byte(words, wire.TYPE_OFFSET)
        self.hub = _byte(words, wire.HUB_OFFSET)
        self.wheel = _byte(words, wire.WHEEL_OFFSET)
        self.seq = words[_SEQ]
        self.tick_us = words[_TICK]
        self.end_offset: Indices = start + _byte(words, wire.LENGTH_OFFSET)
        self.end_offset += base + wire.OVERHEAD_BYTES
        self._groups: list[SampleGroup] | None = None

    def __len__(self) -> int:
        return len(self._start)

    def message(self, index: int) -> Message:
        """Return the payload of frame `index`, decoded."""
        word = int(self._words[_WORD1, index])
        length = (word & 0xFF) - (wire.TAG_BYTES if word >> _FLAGS_SHIFT & wire.SIGNED_FLAG else 0)
        return decode_payload(int(self.type[index]), _payload(self._buffer, int(self._start[index]), length))

    def _axes(self, index: int) -> int:
        return int(self._words[_AXES_N, index]) & 0xFF

    def frame(self, index: int) -> Frame:
        """Return frame `index` as the streaming decoder would."""
        type_, hub, wheel = int(self.type[index]), int(self.hub[index]), int(self.wheel[index])
        return Frame(type_, hub, wheel, int(self.seq[index]), int(self.tick_us[index]), self.message(index))

    def frames(self) -> Iterator[Frame]:
        """Yield every frame as the streaming decoder would."""
        return map(self.frame, range(len(self)))

    def by_source(self) -> Iterator[tuple[int, int, Indices]]:
        """Yield hub, wheel and places of the frames of every source, in the order of their first frames."""
        groups = sorted(self._sources.groups(), key=lambda group: int(group[1][0]))
        for key, members in groups:
            yield key & 0xFF, key >> 8, members

    def sample_groups(self) -> list[SampleGroup]:
        """Return the samples as one array per wheel, axis mask and block size; wheels in ascending order."""
        if self._groups is None:
            self._groups = self._grouped()
        return self._groups

    def stretches(self, admits: Admits) -> Iterator[Stretch]:
        """Yield the frames of admitted sources, as `FrameBlock.stretches`."""
        used = {(hub, wheel) for hub, wheel, _ in self.by_source() if admits(hub, wheel)}
        groups = [group for group in self.sample_groups() if (group.hub, group.wheel) in used]
        # Group of each frame, -1 where its samples are not used, and its place in the group.
        group_of: Indices = np.full(len(self), -1)
        place: Indices = np.zeros(len(self), np.int64)
        for number, group in enumerate(groups):
            group_of[group.frame_index] = number
            place[group.frame_index] = np.arange(len(group.frame_index))
        begin = 0
        for stop in (*np.flatnonzero(self.type != _SAMPLES).tolist(), len(self)):
            of = group_of[begin:stop]
            runs = _in_stream_order(groups, of, place[begin:stop]) if stop > begin else []
            hubs = np.where(of >= 0, self.hub[begin:stop], _NO_HUB)
            places = [(hub, np.flatnonzero(hubs == hub) + begin) for hub in sorted({run.hub for run in runs})]
            is_last = stop < len(self) and (int(self.hub[stop]), int(self.wheel[stop])) in used
            yield Stretch(begin, stop, places, runs, (stop, self.frame(stop)) if is_last else None)
            begin = stop + 1

    def heard(self, arrivals_ns: Indices, slot_ns: int) -> Iterator[Heard]:
        """Yield those frames that matter as signs of life, as `FrameBlock.heard`."""
        is_samples = self.type == _SAMPLES
        wanted = ~is_samples
        for _, _, frames in self.by_source():
            sample_frames = frames[is_samples[frames]]
            if not len(sample_frames):
                continue
            slots = arrivals_ns[sample_frames] // slot_ns
            steps = np.flatnonzero(np.diff(slots)) + 1
            wanted[sample_frames[steps]] = wanted[sample_frames[steps - 1]] = True
            wanted[sample_frames[[0, -1]]] = True
        places = np.flatnonzero(wanted)
        columns = (column[places].tolist() for column in (arrivals_ns, self.hub, self.wheel, self.type))
        for index, (arrived_ns, hub, wheel, type_) in zip(places.tolist(), zip(*columns, strict=True), strict=True):
            is_of_samples = type_ == _SAMPLES
            message = None if is_of_samples else self.message(index)
            yield Heard(arrived_ns, hub, wheel, type_, message, self._axes(index) if is_of_samples else 0)

    def _grouped(self) -> list[SampleGroup]:
        is_samples = self.type == _SAMPLES
        groups: list[SampleGroup] = []
        for key, members in self._sources.groups():
            indices = members[is_samples[members]]
            if not len(indices):
                continue
            shapes = self._words[_AXES_N, indices] & 0xFFFF
            if shapes.min() == shapes.max():
                groups.append(self._group(key, int(shapes[0]), indices))
                continue
            groups += [self._group(key, shape, indices[shapes == shape]) for shape in np.unique(shapes).tolist()]
        return groups

    def _group(self, key: int, axes_n: int, indices: Indices) -> SampleGroup:
        length, shape = SAMPLE_LAYOUTS[axes_n]
        rows = _records(self._buffer, length - SAMPLES.size)[self._start[indices] + SAMPLES_FRAME.size]
        return SampleGroup(
            key & 0xFF,
            key >> 8,
            axes_n & 0xFF,
            indices,
            self._words[_FIRST_SAMPLE, indices],
            self._words[_TICK, indices],
            rows.view(SAMPLE_DTYPE).reshape(-1, *shape),
        )


def _in_stream_order(groups: list[SampleGroup], of: Indices, place: Indices) -> list[SampleRun]:
    """Return the samples of consecutive frames, by group and place in it of each, in order for each wheel."""
    numbers, counts = np.unique(of, return_counts=True)
    parts_of: dict[tuple[int, int], list[tuple[SampleGroup, int, int]]] = {}
    for number, count in zip(numbers.tolist(), counts.tolist(), strict=True):
        if number >= 0:
            group, first = groups[number], int(place[int(np.argmax(of == number))])
            parts_of.setdefault((group.hub, group.wheel), []).append((group, first, first + count))
    runs: list[SampleRun] = []
    for of_wheel in parts_of.values():
        if len(of_wheel) == 1:
            group, first, end = of_wheel[0]
            breaks = np.flatnonzero(np.diff(group.first_sample[first:end]) != group.counts.shape[1]) + first + 1
            runs += (group.run(*edges) for edges in pairwise([first, *breaks.tolist(), end]))
            continue
        # The wheel changed its block size or its axes: its blocks are taken one by one.
        blocks = [
            (int(group.frame_index[index]), group, index)
            for group, first, end in of_wheel
            for index in range(first, end)
        ]
        runs += (group.run(index, index + 1) for _, group, index in sorted(blocks, key=itemgetter(0)))
    return runs


class BatchDecoder:
    """Decoder of one link for streams read in large blocks.

    Equal to `decoder.FrameDecoder`, frame for frame and counter for counter, however the stream is cut. The exception
    is damage to several frames that cancels out in one CRC over all of them (see `scan`), as improbable as damage that
    a CRC misses. Memory is a fixed number of bytes per byte of the largest block.

    Attributes:
        counters: counters of the stream so far; updated in place.
    """

    def __init__(self, block_bytes: int = 1 << 21, gate: Gate | None = None) -> None:
        """Prepare a buffer for blocks of `block_bytes`; larger ones are taken too and enlarge it.

        Args:
            block_bytes: room for a block.
            gate: as for the streaming decoder.
        """
        self._gate = gate
        self._buffer: Bytes = np.zeros(0, np.uint8)
        self._block_bytes = block_bytes
        # glibc hands freed memory above a threshold back to the system, and every block would fault it in again: up to
        # half of the time. Freeing one large piece, never touched, raises the threshold.
        np.empty(_RAISES_THRESHOLD_BYTES, np.uint8)
        self._held = slice(0, 0)
        self._offset = 0
        self._group = 16
        self._tracker = LinkTracker()
        self.counters: LinkCounters = self._tracker.counters

    def writable(self, size: int | None = None) -> memoryview:
        """Return room for the next block, `block_bytes` or `size` bytes, to be filled and then committed.

        Saves the copy that `feed` makes: `decoder.commit(file.readinto(decoder.writable()))`.
        """
        size = self._block_bytes if size is None else size
        held = self._held.stop - self._held.start
        target = self._buffer
        if len(target) < held + size + LOOKAHEAD_BYTES:
            target = np.zeros(wire.MAX_FRAME_BYTES + max(size, self._block_bytes) + LOOKAHEAD_BYTES, np.uint8)
        target[:held] = self._buffer[self._held].copy()
        self._buffer, self._held = target, slice(0, held)
        return target.data[held : held + size]

    def commit(self, size: int) -> FrameBatch:
        """Decode the first `size` bytes written to `writable()` and return the frames that they complete."""
        return self._decode(self._held.stop + size, final=False)

    def feed(self, block: bytes | bytearray | memoryview) -> FrameBatch:
        """Return the frames that `block` completes, in the order of the stream."""
        size = len(block)
        self.writable(max(size, 1))[:size] = block
        return self.commit(size)

    def finish(self) -> FrameBatch:
        """End the stream: search the bytes held back as they are. The decoder can be fed again afterwards."""
        self.writable(0)
        return self._decode(self._held.stop, final=True)

    def _decode(self, size: int, *, final: bool) -> FrameBatch:
        result = scan(self._buffer, size, final=final, group=self._group)
        counters = self.counters
        counters.crc_errors += result.crc_errors
        counters.truncated += result.truncated
        counters.noise_bytes += result.consumed - int(result.total.sum())
        # With a share d of frames damaged, one CRC over 1/sqrt(d) frames costs least.
        if len(result.start):
            self._group = min(max(isqrt(len(result.start) // (result.crc_errors + 1)), 1), MAX_GROUP)
        start = result.start if self._gate is None else self._let_through(result.start, self._gate)
        batch = FrameBatch(self._buffer, *self._select(start), self._offset)
        self._held = slice(result.consumed, size)
        self._offset += result.consumed
        return batch

    def _select(self, start: Indices) -> tuple[Indices, Words, BySource]:
        """Return offsets, first words and sources of the intact frames that are delivered; count the others."""
        gathered = _records(self._buffer, 4 * _WORDS)[start].view("<u4").reshape(-1, _WORDS)
        words = np.ascontiguousarray(gathered.T)
        word1 = words[_WORD1]
        plain = words[_WORD0] == SAMPLES_WORD
        clear = word1 <= _NO_FLAGS
        lengths: NDArray[np.integer] = _byte(words, wire.LENGTH_OFFSET)
        if not clear.all():
            flags = _byte(words, wire.FLAGS_OFFSET)
            clear = flags & _UNKNOWN_FLAGS == 0
            lengths = _lengths(lengths, flags)
        plain &= clear
        plain &= _SAMPLE_LENGTHS[words[_AXES_N] & 0xFFFF] == lengths
        others = np.flatnonzero(~plain)
        foreign = others[_byte(words, wire.VERSION_OFFSET)[others] >> 4 != wire.VERSION_MAJOR]
        if len(foreign):
            self.counters.other_major += len(foreign)
            return self._select(np.delete(start, foreign))
        fates, notices = self._examine(start, words, others)
        readable = np.ones(len(start), np.bool_)
        readable[others] = fates == _Fate.READABLE
        keys = _source_keys(words)
        sources = by_source(keys)
        accepted = accept_batch(self._tracker, keys, words[_SEQ], readable, notices, sources)
        self._count(fates[accepted[others]])
        delivered = accepted & readable
        if delivered.all():
            return start, words, sources
        unknown = others[(fates == _Fate.UNKNOWN_TYPE) & accepted[others]]
        for key, count in zip(*np.unique(keys[unknown], return_counts=True), strict=True):
            self._tracker.source(int(key)).counters.unknown_type += int(count)
        return start[delivered], words.compress(delivered, axis=1), by_source(keys[delivered])

    def _let_through(self, start: Indices, gate: Gate) -> Indices:
        """Return the offsets of the frames that the gate does not refuse; other major versions are not its business."""
        admitted = np.ones(len(start), np.bool_)
        buffer = self._buffer
        for index, position in enumerate(start.tolist()):
            if buffer[position + wire.VERSION_OFFSET] >> 4 == wire.VERSION_MAJOR:
                end = position + wire.OVERHEAD_BYTES + int(buffer[position + wire.LENGTH_OFFSET])
                admitted[index] = gate(buffer[position:end].tobytes())
        self.counters.refused += int(len(admitted) - np.count_nonzero(admitted))
        return start[admitted]

    def _examine(self, start: Indices, words: Words, others: Indices) -> tuple[NDArray[np.uint8], list[BootNotice]]:
        """Return the fates of frames that are no plain samples, and the hellos among them."""
        types, sent, flags, versions = (
            _byte(words, offset)[others]
            for offset in (wire.TYPE_OFFSET, wire.LENGTH_OFFSET, wire.FLAGS_OFFSET, wire.VERSION_OFFSET)
        )
        expected = _LENGTHS[types]
        lengths = _lengths(sent, flags)
        fates = np.zeros(len(others), np.uint8)
        fates[(expected >= 0) & (expected != lengths)] = _Fate.BAD_PAYLOAD
        fates[expected == _NONE] = _Fate.UNKNOWN_TYPE
        fates[flags & _UNKNOWN_FLAGS != 0] = _Fate.UNKNOWN_FLAGS
        fates[versions > wire.VERSION_BYTE] = _Fate.NEWER_MINOR
        notices = []
        for position in np.flatnonzero((expected == _ANY) & (fates == _Fate.READABLE)).tolist():
            index = int(others[position])
            payload = _payload(self._buffer, int(start[index]), int(lengths[position]))
            valid, boot_count = _look_inside(int(types[position]), payload)
            if not valid:
                fates[position] = _Fate.BAD_PAYLOAD
            elif boot_count is not None:
                notices.append(BootNotice(index, boot_count))
        return fates, notices

    def _count(self, fates: NDArray[np.uint8]) -> None:
        counts = np.bincount(fates, minlength=len(_Fate)).tolist()
        self.counters.newer_minor += counts[_Fate.NEWER_MINOR]
        self.counters.unknown_flags += counts[_Fate.UNKNOWN_FLAGS]
        self.counters.unknown_type += counts[_Fate.UNKNOWN_TYPE]
        self.counters.bad_payload += counts[_Fate.BAD_PAYLOAD]


@lru_cache(maxsize=256)  # a wheel repeats its hello unchanged
def _look_inside(type_: int, payload: bytes) -> tuple[bool, int | None]:
    """Return whether a payload keeps to its layout, and its boot count when it is a hello."""
    try:
        message = decode_payload(type_, payload)
    except ValueError:
        return False, None
    return True, message.boot_count if isinstance(message, Hello) else None


def _lengths(lengths: NDArray[np.integer], flags: NDArray[np.uint8]) -> NDArray[np.int16]:
    """Return payload lengths without the tags, a length that no payload has where a tag has no room."""
    without = lengths.astype(np.int16) - wire.TAG_BYTES * (flags & wire.SIGNED_FLAG).astype(np.int16)
    without[without < 0] = _NO_ROOM
    return without


def _payload(buffer: Bytes, start: int, length: int) -> bytes:
    return buffer[start + wire.HEADER_BYTES : start + wire.HEADER_BYTES + length].tobytes()


def _byte(words: Words, offset: int) -> NDArray[np.uint8]:
    """Return the header byte at `offset` of every frame, a view."""
    octets: NDArray[np.uint8] = words[offset // 4].view(np.uint8)
    return octets[offset % 4 :: 4]


def _source_keys(words: Words) -> NDArray[np.uint16]:
    hub_and_wheel: NDArray[np.uint32] = words[_WORD1] >> 8
    return hub_and_wheel.astype(np.uint16)


def _records(buffer: Bytes, size: int) -> NDArray[np.void]:
    """Return a view with the `size` bytes from offset i at i, whatever i: gathering rows of it is one copy a row."""
    return np.ndarray((len(buffer) - size + 1,), np.dtype((np.void, size)), buffer, strides=(1,))
