"""Test vectors of signed frames, and those of RFC 4493 for the CMAC beneath; part of `conformance.py`."""

from __future__ import annotations

from functools import partial
from typing import Any, Final

from firmware_protocol import wire
from firmware_protocol.declaration import WireFrame, build
from firmware_protocol.messages import HUB_ITSELF, MessageType
from firmware_protocol.reference_cmac import aes_cmac
from firmware_protocol.signing import sign

# RFC 4493, section 4: one key, a message of which the four examples are beginnings, and their codes.
_RFC_KEY: Final = "2b7e151628aed2a6abf7158809cf4f3c"
_RFC_MESSAGE: Final = (
    "6bc1bee22e409f96e93d7e117393172aae2d8a571e03ac9c9eb76fac45af8e51"
    "30c81c46a35ce411e5fbc1191a0a52eff69f2445df4f9b17ad2b417be66c3710"
)
_RFC_MACS: Final = {
    0: "bb1d6929e95937287fa37d129b756746",
    16: "070a16b46b4d4144f79bdd9dd04a287c",
    40: "dfa66747de9ae63030ca32611497c827",
    64: "51f0bebf7e3b9d92fc49741779363cfe",
}

_SENSOR_KEY: Final = bytes(range(16))
_HUB_KEY: Final = bytes(range(0xF0, 0x100))
_SENSOR: Final = 0x0000A001
_HUB: Final = 0x0123456789ABCDEF


def _samples(n: int) -> dict[str, Any]:
    counts = [(7919 * index) % 65536 - 32768 for index in range(3 * n)]
    return {"first_sample": 9600, "axes": 0b111, "n": n, "counts": counts}


def signed_vectors() -> dict[str, list[dict[str, Any]]]:
    """Return CMACs by key and message, and frames unsigned and signed with what their keys belong to."""
    macs = [
        {"name": f"RFC 4493, {size} bytes", "key": _RFC_KEY, "message": _RFC_MESSAGE[: 2 * size], "mac": mac}
        for size, mac in _RFC_MACS.items()
    ]
    environment = {"pressure_pa": 235_000, "temperature_cdegc": 3150, "supply_mv": 2987}
    sensor = (_SENSOR_KEY, _SENSOR)
    frames = [
        _frame("one sample", WireFrame(MessageType.SAMPLES, 0, 1, 7, 1_000_000, _samples(1)), *sensor, 41),
        _frame("as many samples as fit", WireFrame(MessageType.SAMPLES, 0, 1, 8, 1_003_646, _samples(35)), *sensor, 41),
        _frame("environment", WireFrame(MessageType.ENVIRONMENT, 0, 1, 9, 9, environment), *sensor, 41),
        _frame(
            "counters at their ends",
            WireFrame(MessageType.ENVIRONMENT, 255, 254, 2**32 - 1, 2**32 - 1, environment),
            _SENSOR_KEY,
            2**32 - 1,
            2**32 - 1,
        ),
        _frame(
            "the hub itself",
            WireFrame(MessageType.LOG_TEXT, 0, HUB_ITSELF, 80, 7, {"level": 1, "text": b"awake"}),
            _HUB_KEY,
            _HUB,
            41,
        ),
    ]
    return {"macs": macs, "signed": frames}


def _frame(name: str, frame: WireFrame, key: bytes, identity: int, boot_count: int) -> dict[str, Any]:
    unsigned = build(frame)
    return {
        "name": name,
        "key": key.hex(),
        "identity": f"{identity:016x}",
        "boot_count": boot_count,
        "unsigned": unsigned.hex(),
        "signed": sign(unsigned, identity, boot_count, partial(aes_cmac, key)).hex(),
        "tag_bytes": wire.TAG_BYTES,
    }
