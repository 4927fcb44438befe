"""Diagnosis of bytes in which no frame is intact although frames were meant."""

import re
import struct
from collections.abc import Callable, Iterator, Mapping
from typing import Final
from zlib import crc32

from firmware_protocol import wire
from gateway.core.reasons import Reason
from gateway.core.session.line_content import swapped_syncs
from gateway.core.session.reasons import SessionCode
from gateway.makers.check.clauses import Clause
from gateway.makers.check.counter_rules import swapped
from gateway.makers.reasons import FirmwareCode

_MASK: Final = 0xFFFF_FFFF
_HEADER: Final = re.compile(re.escape(wire.SYNC) + rb"[\x10-\x1f]", re.DOTALL)
# As many damaged frames are tried at most, and so many must agree.
_MAX_TRIED: Final = 40
_MIN_AGREEING: Final = 3


def _reflected_crc(polynomial: int, start: int, data: bytes) -> int:
    for byte in data:
        start ^= byte
        for _ in range(8):
            start = start >> 1 ^ polynomial if start & 1 else start >> 1
    return start


def _forward_crc(data: bytes) -> int:
    """Return the CRC with the polynomial's bits not reflected (MPEG-2), as many CRC units compute it."""
    crc = _MASK
    for byte in data:
        crc ^= byte << 24
        for _ in range(8):
            crc = (crc << 1 ^ 0x04C11DB7 if crc >> 31 else crc << 1) & _MASK
    return crc


def _reversed_words(data: bytes) -> bytes:
    """Return whole words of 32 bits with their bytes reversed, as an STM32's CRC unit takes them."""
    return b"".join(data[offset : offset + 4][::-1] for offset in range(0, len(data), 4))


_VARIANTS: Final[Mapping[str, Callable[[bytes], int]]] = {
    "big_endian": lambda data: swapped(crc32(data)),
    "not_inverted": lambda data: crc32(data) ^ _MASK,
    "from_zero": lambda data: crc32(data, _MASK),
    "from_zero_not_inverted": lambda data: crc32(data, _MASK) ^ _MASK,
    "without_sync": lambda data: crc32(data[2:]),
    "of_payload": lambda data: crc32(data[wire.HEADER_BYTES :]),
    "of_header": lambda data: crc32(data[: wire.HEADER_BYTES]),
    "mpeg2": _forward_crc,
    "bzip2": lambda data: _forward_crc(data) ^ _MASK,
    "of_words": lambda data: _forward_crc(_reversed_words(data)),
    "castagnoli": lambda data: _reflected_crc(0x82F63B78, _MASK, data) ^ _MASK,
    "always_zero": lambda _: 0,
}
_LENGTHS: Final[Mapping[str, int]] = {
    "frame": wire.OVERHEAD_BYTES,
    "with_header": wire.HEADER_BYTES,
    "with_crc": wire.CRC_BYTES,
}


def diagnosis(data: bytes) -> tuple[Clause, Reason, bytes, int] | None:
    """Return what is wrong with all frames in bytes that hold none: clause, reason, example and its place.

    None where nothing looks like a frame.
    """
    first: tuple[int, bytes] | None = None
    fault_counts: dict[tuple[Clause, str], int] = {}
    for tried, (offset, frame) in enumerate(_candidates(data)):
        if tried == _MAX_TRIED:
            break
        if first is None:
            first = offset, frame
        for key in (*_length_faults(data, offset), *_crc_faults(frame)):
            fault_counts[key] = fault_counts.get(key, 0) + 1
            if fault_counts[key] >= _MIN_AGREEING:
                code = FirmwareCode.FRAME_LENGTH_COUNTS if key[0] is Clause.LENGTH else FirmwareCode.FRAME_CRC_VARIANT
                return key[0], Reason(code, how=key[1]), frame, offset
    if swapped_syncs(data) >= _MIN_AGREEING:
        offset = data.find(wire.SYNC[::-1])
        return Clause.SYNC, Reason(SessionCode.LINE_SYNC_SWAPPED), data[offset : offset + wire.MAX_FRAME_BYTES], offset
    if first is not None:
        return Clause.CRC, Reason(FirmwareCode.FRAME_CRC_WRONG), first[1], first[0]
    return None


def _candidates(data: bytes) -> Iterator[tuple[int, bytes]]:
    for match in _HEADER.finditer(data):
        offset = match.start()
        if offset + wire.LENGTH_KNOWN_BYTES <= len(data):
            end = offset + wire.OVERHEAD_BYTES + data[offset + wire.LENGTH_OFFSET]
            yield offset, data[offset:end]


def _length_faults(data: bytes, offset: int) -> Iterator[tuple[Clause, str]]:
    for variant, excess_bytes in _LENGTHS.items():
        length = data[offset + wire.LENGTH_OFFSET] - excess_bytes
        end = offset + wire.OVERHEAD_BYTES + length
        if length >= 0 and end <= len(data) and crc32(data[offset:end]) == wire.CRC_RESIDUE:
            yield Clause.LENGTH, variant


def _crc_faults(frame: bytes) -> Iterator[tuple[Clause, str]]:
    if len(frame) < wire.OVERHEAD_BYTES or len(frame) != wire.OVERHEAD_BYTES + frame[wire.LENGTH_OFFSET]:
        return
    body = frame[: -wire.CRC_BYTES]
    (received_crc,) = struct.unpack("<I", frame[-wire.CRC_BYTES :])
    for variant, crc in _VARIANTS.items():
        if crc(body) == received_crc:
            yield Clause.CRC, variant
