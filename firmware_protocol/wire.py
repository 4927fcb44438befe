"""Constants of the wire format other than payload layouts. Protocol 1.1."""

from typing import Final

VERSION_MAJOR: Final = 1
VERSION_MINOR: Final = 1
LAYOUT_MINOR: Final = 0
VERSION_BYTE: Final = VERSION_MAJOR << 4 | LAYOUT_MINOR
"""Version byte of frames: 1.1 changed no layout, so all frames are those of 1.0."""

SIGNED_COMMANDS_MINOR: Final = 1
"""Minor version of hubs that verify commands."""

SYNC: Final = b"\xa5\x5a"
HEADER_BYTES: Final = 16
CRC_BYTES: Final = 4
OVERHEAD_BYTES: Final = HEADER_BYTES + CRC_BYTES
MAX_PAYLOAD_BYTES: Final = 224
MAX_FRAME_BYTES: Final = OVERHEAD_BYTES + MAX_PAYLOAD_BYTES

VERSION_OFFSET: Final = 2
TYPE_OFFSET: Final = 3
LENGTH_OFFSET: Final = 4
HUB_OFFSET: Final = 5
WHEEL_OFFSET: Final = 6
FLAGS_OFFSET: Final = 7
LENGTH_KNOWN_BYTES: Final = LENGTH_OFFSET + 1
"""Bytes of a candidate that must be there before its length is known."""

HEADER_FORMAT: Final = "<2sBBBBBBII"
SAMPLES_FORMAT: Final = "<IBB"
SAMPLES_HEADER_BYTES: Final = 6

SIGNED_FLAG: Final = 1
"""Flag of a signed frame: the last TAG_BYTES of the payload region are its tag."""
TAG_BYTES: Final = 8
MAX_SIGNED_PAYLOAD_BYTES: Final = MAX_PAYLOAD_BYTES - TAG_BYTES
KNOWN_FLAGS: Final = SIGNED_FLAG
"""Flag bits that this decoder understands."""

CRC_RESIDUE: Final = 0x2144DF1C
"""CRC-32 of any intact frame taken with its own CRC at the end: one comparison checks a frame."""

CRC_CHECK_VALUE: Final = 0xCBF43926
"""CRC-32 of the nine bytes "123456789"."""

COUNTER_BITS: Final = 32
WINDOW_FRAMES: Final = 64
"""Largest step back of a counter that is a late frame or a duplicate rather than a restart."""

MIN_RATE_HZ: Final = 2000.0
MAX_RATE_HZ: Final = 25600.0
MAX_SATURATION_COUNTS: Final = 32768
ALL_AXES: Final = 0b111
MAX_BATTERY_PERCENT: Final = 100

NONE_U8: Final = 0xFF
NONE_I8: Final = -0x80
NONE_U16: Final = 0xFFFF
NONE_I16: Final = -0x8000
NONE_I32: Final = -0x80000000

HELLO_PERIOD_S: Final = 2.0
ENVIRONMENT_PERIOD_S: Final = 1.0
HUB_STATUS_PERIOD_S: Final = 1.0
TIME_SYNC_PERIOD_S: Final = 1.0
