"""CAN frames of a vehicle bus as bytes: the form in which they are recorded."""

import struct
from collections.abc import Iterable, Iterator
from typing import Final, NamedTuple

_HEAD: Final = struct.Struct("<IIBB")
_EXTENDED: Final = 1 << 31
_REMOTE: Final = 1 << 30
_ERROR: Final = 1 << 29
_ID_MASK: Final = _ERROR - 1
_FD: Final = 1
_CHANNEL_SHIFT: Final = 1
_MAX_CHANNEL: Final = 126
_MAX_DATA: Final = 64
_MAX_AFTER_US: Final = (1 << 32) - 1

LAYOUT: Final = """\
Frames of a vehicle bus as received; log_time is the arrival of the first. Each frame: uint32 microseconds after
log_time, uint32 identifier (bit 31 extended, bit 30 remote, bit 29 error), uint8 length, uint8 flags (bit 0 CAN
FD, bits 1 to 7 the channel of the log plus 1, 0 where it names none), data. Little
endian. The channel's metadata name the link.
"""


class BusFrame(NamedTuple):
    """A frame of a vehicle bus.

    Attributes:
        host_ns: arrival, ns since the epoch, to a microsecond after the first of its block.
        can_id: identifier.
        is_extended: of 29 bits.
        data: up to 64 bytes.
        is_fd: a frame of CAN FD.
        is_remote: a request without data.
        is_error: an error of the bus, no frame.
        channel: number of the bus by the log, 0 to 126; None where it names none.
    """

    host_ns: int
    can_id: int
    is_extended: bool
    data: bytes
    is_fd: bool = False
    is_remote: bool = False
    is_error: bool = False
    channel: int | None = None


def pack(frames: Iterable[BusFrame], first_ns: int) -> bytes:
    """Return frames as bytes; `first_ns` is the arrival of the first."""
    parts = []
    for frame in frames:
        after_us = min(max(0, (frame.host_ns - first_ns) // 1000), _MAX_AFTER_US)
        number = frame.can_id & _ID_MASK
        number |= _EXTENDED * frame.is_extended | _REMOTE * frame.is_remote | _ERROR * frame.is_error
        data = frame.data[:_MAX_DATA]
        channel = 0 if frame.channel is None else min(frame.channel, _MAX_CHANNEL) + 1
        parts.append(_HEAD.pack(after_us, number, len(data), _FD * frame.is_fd | channel << _CHANNEL_SHIFT) + data)
    return b"".join(parts)


def has_frames(data: bytes) -> bool:
    """Return whether a block has a frame: errors of the bus say that nothing is heard on it."""
    return any(not frame.is_error for frame in unpack(data, 0))


def unpack(data: bytes, first_ns: int) -> Iterator[BusFrame]:
    """Yield the frames in bytes; what is cut off or damaged at the end is left out."""
    offset = 0
    while offset + _HEAD.size <= len(data):
        after_us, number, length, flags = _HEAD.unpack_from(data, offset)
        offset += _HEAD.size
        if length > _MAX_DATA or offset + length > len(data):
            return
        yield BusFrame(
            first_ns + after_us * 1000,
            number & _ID_MASK,
            bool(number & _EXTENDED),
            data[offset : offset + length],
            bool(flags & _FD),
            bool(number & _REMOTE),
            bool(number & _ERROR),
            (flags >> _CHANNEL_SHIFT) - 1 if flags >> _CHANNEL_SHIFT else None,
        )
        offset += length
