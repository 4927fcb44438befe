"""Signed part of a frame and position of its tag. The caller supplies the cryptography."""

import struct
from collections.abc import Callable
from typing import Final
from zlib import crc32

from firmware_protocol import wire
from firmware_protocol.checks import integer, reject
from firmware_protocol.messages import HUB_ITSELF

Gate = Callable[[bytes], bool]
"""Called by a decoder with every intact frame, in stream order and before its counter is read; returns acceptance."""

Mac = Callable[[bytes], bytes]
"""AES-128-CMAC of some bytes under the key of one sensor: 16 bytes; the first TAG_BYTES are the tag."""

_FRESHNESS: Final = struct.Struct("<QI")
_CRC: Final = struct.Struct("<I")
_U32: Final = 0xFFFF_FFFF
_U64: Final = 0xFFFF_FFFF_FFFF_FFFF


def freshness(identity: int, boot_count: int) -> bytes:
    """Return the 12 bytes that are signed before the frame and never sent with it.

    Args:
        identity: serial number of the sensor, or of the hub for frames of the hub itself.
        boot_count: number of starts of the hub; with the frame's own counter the full freshness counter.
    """
    return _FRESHNESS.pack(integer("identity", identity, 0, _U64), integer("boot_count", boot_count, 0, _U32))


def signed_part(frame: bytes) -> bytes:
    """Return the bytes of a signed frame that its tag covers: all before the tag."""
    return frame[: len(frame) - wire.CRC_BYTES - wire.TAG_BYTES]


def tag_of(frame: bytes) -> bytes:
    """Return the tag of a signed frame."""
    return frame[len(frame) - wire.CRC_BYTES - wire.TAG_BYTES : len(frame) - wire.CRC_BYTES]


def is_signed(frame: bytes) -> bool:
    """Return whether an intact frame is flagged as signed and long enough for a tag."""
    return bool(frame[wire.FLAGS_OFFSET] & wire.SIGNED_FLAG) and frame[wire.LENGTH_OFFSET] >= wire.TAG_BYTES


def is_of_hub(frame: bytes) -> bool:
    """Return whether the frame is from the hub itself, which has its own key."""
    return frame[wire.WHEEL_OFFSET] == HUB_ITSELF


def sign(frame: bytes, identity: int, boot_count: int, mac: Mac) -> bytes:
    """Return an unsigned frame signed.

    Raises:
        ValueError: the payload leaves no room for the tag; the frame is signed already.
    """
    length = frame[wire.LENGTH_OFFSET]
    if length > wire.MAX_SIGNED_PAYLOAD_BYTES:
        reject("length of the payload", length, f"at most {wire.MAX_SIGNED_PAYLOAD_BYTES} in a signed frame")
    if frame[wire.FLAGS_OFFSET] & wire.SIGNED_FLAG:
        reject("flags", frame[wire.FLAGS_OFFSET], "a frame that is not signed yet")
    body = bytearray(frame[: -wire.CRC_BYTES])
    body[wire.LENGTH_OFFSET] += wire.TAG_BYTES
    body[wire.FLAGS_OFFSET] |= wire.SIGNED_FLAG
    body += mac(freshness(identity, boot_count) + body)[: wire.TAG_BYTES]
    return bytes(body) + _CRC.pack(crc32(body))
