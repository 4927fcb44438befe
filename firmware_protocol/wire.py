"""Header and constants of the wire format; `declaration.py` declares the payloads. Protocol 1.1."""

from typing import Final

from firmware_protocol.layout import Field, Layout

VERSION_MAJOR: Final = 1
VERSION_MINOR: Final = 1
LAYOUT_MINOR: Final = 0
VERSION_BYTE: Final = VERSION_MAJOR << 4 | LAYOUT_MINOR
"""Version byte of frames: 1.1 changed no layout, so all frames are those of 1.0."""

SIGNED_COMMANDS_MINOR: Final = 1
"""Minor version of hubs that verify commands."""

SYNC: Final = b"\xa5\x5a"
MAX_PAYLOAD_BYTES: Final = 224
MAX_SAMPLES: Final = 109
"""Greatest number of samples of one axis in a payload."""

HEADER: Final = Layout(
    Field("sync", "s", "A5 5A", elements=len(SYNC)),
    Field("version", "B", "16 * major + minor; minor is the version in which the layout of this frame appeared"),
    Field("type", "B", "message type"),
    Field("length", "B", "bytes of the payload", 0, MAX_PAYLOAD_BYTES),
    Field("hub", "B", "number of the hub on its link"),
    Field("wheel", "B", "number of the wheel at the hub; 255: the hub itself"),
    Field("flags", "B", "0; bit 0: signed (below)"),
    Field("seq", "I", "counter of the source (hub, wheel), 0 at start, one more with every frame, wraps"),
    Field("tick_us", "I", "µs since the hub's start, low 32 bits; of the first sample for samples"),
)
HEADER_BYTES: Final = HEADER.size
CRC_BYTES: Final = 4
OVERHEAD_BYTES: Final = HEADER_BYTES + CRC_BYTES
MAX_FRAME_BYTES: Final = OVERHEAD_BYTES + MAX_PAYLOAD_BYTES

VERSION_OFFSET: Final = HEADER.offset("version")
TYPE_OFFSET: Final = HEADER.offset("type")
LENGTH_OFFSET: Final = HEADER.offset("length")
HUB_OFFSET: Final = HEADER.offset("hub")
WHEEL_OFFSET: Final = HEADER.offset("wheel")
FLAGS_OFFSET: Final = HEADER.offset("flags")
LENGTH_KNOWN_BYTES: Final = LENGTH_OFFSET + 1
"""Bytes of a candidate that must be there before its length is known."""

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
