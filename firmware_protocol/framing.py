"""Reference form of the framing rule."""

from typing import Final
from zlib import crc32

from firmware_protocol import wire

_SYNC: Final = wire.SYNC
_HALF_SYNC: Final = wire.SYNC[:1]


def next_frame(buffer: bytes, start: int) -> tuple[int, int, int]:
    """Find the next intact frame at or after `start`.

    Returns:
        Its start; its end, or 0 when a frame may begin at the start but needs more bytes; and the number of candidates
        skipped because of a bad CRC.
    """
    size = len(buffer)
    crc_errors = 0
    while True:
        offset = buffer.find(_SYNC, start)
        if offset < 0:
            return size - buffer.endswith(_HALF_SYNC, start), 0, crc_errors
        if offset + wire.LENGTH_KNOWN_BYTES > size:
            return offset, 0, crc_errors
        length = buffer[offset + wire.LENGTH_OFFSET]
        if length <= wire.MAX_PAYLOAD_BYTES:
            end = offset + wire.OVERHEAD_BYTES + length
            if end > size:
                return offset, 0, crc_errors
            if crc32(buffer[offset:end]) == wire.CRC_RESIDUE:
                return offset, end, crc_errors
            crc_errors += 1
        start = offset + 1
