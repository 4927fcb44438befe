"""Streaming frame decoder. Sans-io: no I/O and no clock; the frames do not depend on how the stream is split."""

from contextlib import suppress
from typing import Any, Final
from zlib import crc32

import numpy as np

from firmware_protocol import wire
from firmware_protocol.codec import DECODERS, SAMPLE_DTYPE, SAMPLE_LAYOUTS, decode_payload
from firmware_protocol.counters import LinkCounters
from firmware_protocol.declaration import SAMPLES, SAMPLES_FRAME, SAMPLES_WORD
from firmware_protocol.framing import next_frame
from firmware_protocol.messages import Frame, Hello, Message, MessageType, SampleBlock
from firmware_protocol.sequence import COUNTER_MASK
from firmware_protocol.signing import Gate
from firmware_protocol.source_tracking import LinkTracker

_HEADER: Final = wire.HEADER.reader("version", "type", "length", ("hub", "wheel"), "flags", "seq", "tick_us")
# A sample frame up to its samples in one unpack: sync, version and type are one number, as are hub and wheel,
# and axes and n.
_SAMPLES_START: Final = SAMPLES_FRAME.reader(
    ("sync", "version", "type"), "length", ("hub", "wheel"), "flags", "seq", "tick_us", "first_sample", ("axes", "n")
)
_SAMPLES: Final = int(MessageType.SAMPLES)
_SAMPLES_OFFSET: Final = SAMPLES_FRAME.size
_SAMPLES_LEAST: Final = wire.OVERHEAD_BYTES + SAMPLES.size
_NEVER: Final = 1 << 62
_SYNC_0, _SYNC_1 = wire.SYNC
_OVERHEAD: Final = wire.OVERHEAD_BYTES
_MAX_FRAME: Final = wire.MAX_FRAME_BYTES
_LENGTH_OFFSET: Final = wire.LENGTH_OFFSET
_RESIDUE: Final = wire.CRC_RESIDUE
_unpack_start: Final = _SAMPLES_START.unpack_from
# Called directly: a named tuple's own constructor takes twice the time.
_new_tuple: Final[Any] = tuple.__new__
_new_array: Final[Any] = np.ndarray


class FrameDecoder:
    """Streaming decoder of one link.

    Never raises on any bytes. Holds at most one incomplete frame (243 bytes) and counters of at most 65,536 sources.

    Attributes:
        counters: counters of the stream so far; updated in place.
    """

    def __init__(self, gate: Gate | None = None) -> None:
        """Start at the beginning of a stream.

        Args:
            gate: called with every intact frame of this major version. Frames that it rejects are counted and dropped.
                Without a gate, signed frames are read unverified.
        """
        self._gate = gate
        # Every frame must pass the gate, so none takes the fast path.
        self._quick_from = _SAMPLES_LEAST if gate is None else _NEVER
        self._tail = b""
        self._wanted = 0
        self._tracker = LinkTracker()
        self._sources = self._tracker.sources
        self.counters: LinkCounters = self._tracker.counters

    @property
    def pending_bytes(self) -> int:
        """Bytes held back because they may be the start of a frame."""
        return len(self._tail)

    def feed(self, data: bytes | bytearray | memoryview) -> list[Frame]:
        """Return the frames that `data` completes, in the order of the stream."""
        buffer = self._tail + data if self._tail else bytes(data)
        frames: list[Frame] = []
        size = len(buffer)
        if size < self._wanted:
            self._tail = buffer
            return frames
        sources = self._sources
        quick_from = self._quick_from
        start = wanted = 0
        # Fast path: sample frames of a known source, contiguous and in order. All other frames go through _read.
        while start < size:
            remainder = size - start
            if remainder >= quick_from:
                if remainder < _MAX_FRAME:
                    total = _OVERHEAD + buffer[start + _LENGTH_OFFSET]
                    if remainder < total <= _MAX_FRAME and buffer[start] == _SYNC_0 and buffer[start + 1] == _SYNC_1:
                        wanted = total
                        break
                word, length, key, flags, seq, tick_us, first_sample, axes_n = _unpack_start(buffer, start)
                layout = SAMPLE_LAYOUTS[axes_n]
                if word == SAMPLES_WORD and length == layout[0] and not flags:
                    end = start + _OVERHEAD + length
                    source = sources.get(key)
                    if source is not None and seq == source.expected and crc32(buffer[start:end]) == _RESIDUE:
                        source.expected = seq + 1 if seq != COUNTER_MASK else 0
                        source.counters.frames += 1
                        counts = _new_array(layout[1], SAMPLE_DTYPE, buffer, start + _SAMPLES_OFFSET)
                        block = _new_tuple(SampleBlock, (first_sample, axes_n & 0xFF, counts))
                        frames.append(_new_tuple(Frame, (_SAMPLES, key & 0xFF, key >> 8, seq, tick_us, block)))
                        start = end
                        continue
            noise_start = start
            start, end, crc_errors = next_frame(buffer, start)
            self.counters.noise_bytes += start - noise_start
            self.counters.crc_errors += crc_errors
            if not end:
                break
            self._read(buffer, start, end, frames)
            start = end
        self._tail = buffer[start:]
        self._wanted = wanted
        return frames

    def finish(self) -> list[Frame]:
        """End the stream: search the bytes held back as they are. The decoder can be fed again afterwards."""
        frames: list[Frame] = []
        while self._tail:
            rest, self._tail, self._wanted = self._tail[1:], b"", 0
            self.counters.truncated += bool(rest)
            self.counters.noise_bytes += 1
            frames += self.feed(rest)
        return frames

    def _read(self, buffer: bytes, offset: int, end: int, frames: list[Frame]) -> None:
        """Count the intact frame at `offset`, and append it unless it is to be skipped."""
        version, type_, _, key, flags, seq, tick_us = _HEADER.unpack_from(buffer, offset)
        counters = self.counters
        if version >> 4 != wire.VERSION_MAJOR:
            counters.other_major += 1
            return
        if self._gate is not None and not self._gate(buffer[offset:end]):
            counters.refused += 1
            return
        readable = version <= wire.VERSION_BYTE and not flags & ~wire.KNOWN_FLAGS
        message: Message | None = None
        if readable and type_ in DECODERS:
            behind = wire.CRC_BYTES + (wire.TAG_BYTES if flags & wire.SIGNED_FLAG else 0)
            with suppress(ValueError):
                message = decode_payload(type_, buffer[offset + wire.HEADER_BYTES : end - behind])
        if isinstance(message, Hello):
            self._tracker.hello(key, message.boot_count)
        # The counter comes first: it counts even when the content cannot be read.
        source = self._tracker.source(key)
        if not source.accept(seq):
            return
        if message is not None:
            source.counters.frames += 1
            frames.append(Frame(type_, key & 0xFF, key >> 8, seq, tick_us, message))
        elif version > wire.VERSION_BYTE:
            counters.newer_minor += 1
        elif not readable:
            counters.unknown_flags += 1
        elif type_ not in DECODERS:
            counters.unknown_type += 1
            source.counters.unknown_type += 1
        else:
            counters.bad_payload += 1
