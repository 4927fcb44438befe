"""What of a frame is signed and where the tag is. The cryptography itself is the caller's."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final
from zlib import crc32

from firmware_protocol import wire
from firmware_protocol.checks import integer, reject
from firmware_protocol.messages import HUB_ITSELF

Gate = Callable[[bytes], bool]
"""Asked by a decoder for every intact frame, in the order of the stream and before its counter is looked at: may it?"""

Mac = Callable[[bytes], bytes]
"""AES-128-CMAC of some bytes under the key of one sensor; 16 bytes, of which the first are the tag."""

_FRESHNESS: Final = struct.Struct("<QI")
_CRC: Final = struct.Struct("<I")
_U32: Final = 0xFFFF_FFFF
_U64: Final = 0xFFFF_FFFF_FFFF_FFFF


def freshness(identity: int, boot_count: int) -> bytes:
    """Return the 12 bytes that are signed before the frame and never sent with it.

    Args:
        identity: serial number of the sensor, or of the hub for what the hub itself says.
        boot_count: how often the hub has started; with the frame's own counter the full freshness counter.
    """
    return _FRESHNESS.pack(integer("identity", identity, 0, _U64), integer("boot_count", boot_count, 0, _U32))


def signed_part(frame: bytes) -> bytes:
    """Return the bytes of a signed frame that its tag covers: all before the tag."""
    return frame[: len(frame) - wire.CRC_BYTES - wire.TAG_BYTES]


def tag_of(frame: bytes) -> bytes:
    """Return the tag of a signed frame."""
    return frame[len(frame) - wire.CRC_BYTES - wire.TAG_BYTES : len(frame) - wire.CRC_BYTES]


def is_signed(frame: bytes) -> bool:
    """Tell whether an intact frame claims a tag and has room for one."""
    return bool(frame[wire.FLAGS_OFFSET] & wire.SIGNED_FLAG) and frame[wire.LENGTH_OFFSET] >= wire.TAG_BYTES


def is_of_hub(frame: bytes) -> bool:
    """Tell whether the hub itself speaks, with its own key."""
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
