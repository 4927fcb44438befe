"""Test vectors: frames with their fields, and streams with the frames and counters that a decoder must find.

Built without the codec that they test. The expected result of a stream is stated by hand.
"""

import json
from collections.abc import Mapping
from functools import partial
from typing import Any, Final

import numpy as np

from firmware_protocol import wire
from firmware_protocol.messages import EVERY_HUB, HUB_ITSELF, MessageType, Outcome
from firmware_protocol.reference_cmac import aes_cmac
from firmware_protocol.reference_frames import WireFrame, frame_bytes, payload_bytes, raw_frame
from firmware_protocol.signing import sign

# RFC 4493, section 4: one key, one message whose prefixes are the four examples, and their codes.
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
_NONCE: Final = 0xFEDCBA9876543210


def _three_axes(n: int) -> dict[str, Any]:
    counts = [(7919 * index) % 65536 - 32768 for index in range(3 * n)]
    return {"first_sample": 9600, "axes": 0b111, "n": n, "counts": counts}


def signed_vectors() -> dict[str, list[dict[str, Any]]]:
    """Return CMACs by key and message, and unsigned and signed frames with the identity of each key."""
    macs = [
        {"name": f"RFC 4493, {size} bytes", "key": _RFC_KEY, "message": _RFC_MESSAGE[: 2 * size], "mac": mac}
        for size, mac in _RFC_MACS.items()
    ]
    environment = {"pressure_pa": 235_000, "temperature_cdegc": 3150, "supply_mv": 2987}
    sensor = (_SENSOR_KEY, _SENSOR)
    frames = [
        _signed_frame("one sample", WireFrame(MessageType.SAMPLES, 0, 1, 7, 1_000_000, _three_axes(1)), *sensor, 41),
        _signed_frame(
            "full of samples", WireFrame(MessageType.SAMPLES, 0, 1, 8, 1_003_646, _three_axes(35)), *sensor, 41
        ),
        _signed_frame("environment", WireFrame(MessageType.ENVIRONMENT, 0, 1, 9, 9, environment), *sensor, 41),
        _signed_frame(
            "counters at their maximum",
            WireFrame(MessageType.ENVIRONMENT, 255, 254, 2**32 - 1, 2**32 - 1, environment),
            _SENSOR_KEY,
            2**32 - 1,
            2**32 - 1,
        ),
        _signed_frame(
            "a hello, under its own boot count", WireFrame(MessageType.HELLO, 0, 1, 0, 1500, _hello()), *sensor, 41
        ),
        _signed_frame(
            "the hub itself",
            WireFrame(MessageType.LOG_TEXT, 0, HUB_ITSELF, 80, 7, {"level": 1, "text": b"awake"}),
            _HUB_KEY,
            _HUB,
            41,
        ),
    ]
    return {"macs": macs, "signed": frames, "commands": _command_vectors()}


def _command_vectors() -> list[dict[str, Any]]:
    """Return commands in the order in which one hub receives them, each with type and payload of its reply.

    The hub and its wheel 1 have keys; it is their start 41. Every party has a counter of its own.
    """
    stop = {"running": 0}
    hub, sensor = (_HUB_KEY, _HUB, 41), (_SENSOR_KEY, _SENSOR, 41)

    def command(seq: int, wheel: int = HUB_ITSELF) -> WireFrame:
        return WireFrame(MessageType.SET_STREAM, 0, wheel, seq, 0, stop)

    def challenge(number: int) -> bytes:
        return frame_bytes(WireFrame(MessageType.CHALLENGE, number, HUB_ITSELF, 0, 0, {"nonce": _NONCE}))

    def signed(frame: WireFrame, key: bytes, identity: int, boot_count: int) -> bytes:
        return sign(frame_bytes(frame), identity, boot_count, partial(aes_cmac, key))

    first = signed(command(1000), *hub)
    rate = WireFrame(MessageType.SET_RATE, EVERY_HUB, HUB_ITSELF, 1005, 0, {"rate_hz": 9600.0})
    unknown = raw_frame(b"", WireFrame(63, 0, HUB_ITSELF, 1007, 0, {}))
    steps: list[tuple[str, bytes, Outcome | None, int]] = [
        ("not signed", frame_bytes(command(1)), Outcome.NOT_VERIFIED, 1),
        ("challenge before any command", challenge(255), None, 1),
        ("signed, above the counter of the challenge", first, Outcome.DONE, 1000),
        ("the same again", first, Outcome.REPEATED, 1000),
        ("a lower counter", signed(command(999), *hub), Outcome.REPEATED, 1000),
        ("the next counter", signed(command(1001), *hub), Outcome.DONE, 1001),
        ("a gap", signed(command(1004), *hub), Outcome.DONE, 1004),
        ("in the gap, thus late", signed(command(1003), *hub), Outcome.REPEATED, 1004),
        ("to every hub", signed(rate, *hub), Outcome.DONE, 1005),
        ("challenge, which takes a counter", challenge(0), None, 1006),
        ("signed before the challenge", signed(command(1006), *hub), Outcome.REPEATED, 1006),
        (
            "unknown command",
            sign(unknown, _HUB, 41, partial(aes_cmac, _HUB_KEY)),
            Outcome.UNKNOWN_COMMAND,
            1007,
        ),
        ("of the start before", signed(command(2000), _HUB_KEY, _HUB, 40), Outcome.NOT_VERIFIED, 2000),
        ("key of the wheel", signed(command(2001), _SENSOR_KEY, _SENSOR, 41), Outcome.NOT_VERIFIED, 2001),
        ("to the wheel, its key and counter", signed(command(5, 1), *sensor), Outcome.DONE, 5),
        ("to the wheel, key of the hub", signed(command(6, 1), *hub), Outcome.NOT_VERIFIED, 6),
        ("to a wheel that is not there", signed(command(7, 9), *sensor), Outcome.NOT_VERIFIED, 7),
        ("last counter", signed(command(2**32 - 1), *hub), Outcome.DONE, 2**32 - 1),
        ("counter wrapped", signed(command(0), *hub), Outcome.REPEATED, 2**32 - 1),
    ]
    return [
        {
            "name": name,
            "hex": frame.hex(),
            "reply_type": int(reply.type),
            "reply_payload": frame_bytes(reply)[wire.HEADER_BYTES : -wire.CRC_BYTES].hex(),
        }
        for name, frame, outcome, seq in steps
        for reply in [_reply_to(frame, outcome, seq)]
    ]


def _reply_to(command: bytes, outcome: Outcome | None, seq: int) -> WireFrame:
    """Return the reply to a command, or to a challenge where there is no outcome; its own counter and tick are 0."""
    fields: dict[str, int]
    if outcome is None:
        fields = {"nonce": _NONCE, "boot_count": 41, "highest_seq": seq}
        return WireFrame(MessageType.CHALLENGE_ANSWER, 0, HUB_ITSELF, 0, 0, fields)
    fields = {"seq": seq, "command": command[wire.TYPE_OFFSET], "outcome": int(outcome)}
    return WireFrame(MessageType.COMMAND_RESULT, 0, HUB_ITSELF, 0, 0, fields)


def _signed_frame(name: str, frame: WireFrame, key: bytes, identity: int, boot_count: int) -> dict[str, Any]:
    unsigned = frame_bytes(frame)
    return {
        "name": name,
        "key": key.hex(),
        "identity": f"{identity:016x}",
        "boot_count": boot_count,
        "unsigned": unsigned.hex(),
        "signed": sign(unsigned, identity, boot_count, partial(aes_cmac, key)).hex(),
        "tag_bytes": wire.TAG_BYTES,
    }


_F32: Final = np.float32


def _f32(*values: float) -> list[float]:
    return [float(_F32(value)) for value in values]


def _hello(**changes: Any) -> dict[str, Any]:
    fields = {
        "protocol_major": wire.VERSION_MAJOR,
        "protocol_minor": wire.VERSION_MINOR,
        "firmware_major": 2,
        "firmware_minor": 7,
        "firmware_patch": 300,
        "axes": 0b111,
        "coupling": 0,
        "hub_id": 0x0123456789ABCDEF,
        "sensor_id": 0x0000A001,
        "boot_count": 41,
        "rate_hz": 9600.0,
        "highpass_hz": 0.0,
        "range_mps2": _f32(4000.0, 2000.0, 4000.0),
        "scale_mps2": _f32(0.125, -0.0625, 0.122583125),
        "offset_counts": _f32(-3.5, 0.0, 12.25),
        "saturation_counts": 32000,
    }
    return fields | changes


def _samples(first_sample: int, axes: int, n: int, values: list[int] | None = None) -> dict[str, Any]:
    channels = axes.bit_count()
    counts = values or [(row * 257 + channel * 1000) % 65536 - 32768 for row in range(n) for channel in range(channels)]
    return {"first_sample": first_sample, "axes": axes, "n": n, "counts": counts}


def _environment(pressure_pa: int = 235_000, temperature_cdegc: int = 3150, supply_mv: int = 2987) -> dict[str, Any]:
    return {"pressure_pa": pressure_pa, "temperature_cdegc": temperature_cdegc, "supply_mv": supply_mv}


def _status(battery_percent: int, rssi_dbm: int) -> dict[str, Any]:
    return {
        "uptime_s": 86_400,
        "frames_sent": 4_000_000_000,
        "frames_dropped": 12,
        "samples_dropped": 432,
        "link_retries": 99,
        "supply_uw": 1_250_000,
        "supply_mv": 12_012,
        "battery_percent": battery_percent,
        "rssi_dbm": rssi_dbm,
    }


_SMALL: Final = {"first_sample": 0, "axes": 0b100, "n": 2, "counts": [-2, 300]}

EXAMPLE: Final = WireFrame(MessageType.SAMPLES, 0, 3, 7, 1_000_000, _SMALL | {"first_sample": 9600})
"""The worked example of the specification."""

_FRAMES: Final[dict[str, WireFrame]] = {
    "worked example of the specification": EXAMPLE,
    "hello, DC, three axes": WireFrame(MessageType.HELLO, 0, 0, 0, 1500, _hello()),
    "hello, AC, radial only": WireFrame(
        MessageType.HELLO,
        255,
        254,
        1,
        2,
        _hello(axes=0b100, coupling=1, highpass_hz=2.5, rate_hz=25600.0, saturation_counts=32768),
    ),
    "hello, values of absent axes 0": WireFrame(
        MessageType.HELLO,
        0,
        2,
        1,
        2,
        _hello(
            axes=0b101,
            range_mps2=_f32(4000.0, 0.0, 4000.0),
            scale_mps2=_f32(0.125, 0.0, 0.125),
            offset_counts=_f32(-3.5, 0.0, 12.25),
        ),
    ),
    "hello, AC, corner not known": WireFrame(
        MessageType.HELLO, 0, 3, 1, 2, _hello(axes=0b100, coupling=1, highpass_hz=0.0)
    ),
    "samples, three axes, full": WireFrame(MessageType.SAMPLES, 0, 1, 12345, 67890, _samples(444_384, 0b111, 36)),
    "samples, radial axis, full": WireFrame(MessageType.SAMPLES, 0, 2, 5, 6, _samples(7, 0b100, 109)),
    "samples, two axes, one sample": WireFrame(MessageType.SAMPLES, 1, 0, 5, 6, _samples(1, 0b101, 1)),
    "samples, extreme counts": WireFrame(
        MessageType.SAMPLES, 0, 0, 9, 9, _samples(2**32 - 2, 0b010, 4, [-32768, 32767, -1, 0])
    ),
    "environment": WireFrame(MessageType.ENVIRONMENT, 0, 3, 8, 9, _environment()),
    "environment, below zero": WireFrame(MessageType.ENVIRONMENT, 0, 3, 9, 10, _environment(-1200, -2755, 0)),
    "environment, nothing available": WireFrame(
        MessageType.ENVIRONMENT, 0, 3, 10, 11, _environment(wire.NONE_I32, wire.NONE_I16, wire.NONE_U16)
    ),
    "hub status": WireFrame(MessageType.HUB_STATUS, 0, HUB_ITSELF, 77, 5, _status(87, -71)),
    "hub status, no battery, wired": WireFrame(
        MessageType.HUB_STATUS, 0, HUB_ITSELF, 78, 6, _status(wire.NONE_U8, wire.NONE_I8)
    ),
    "time sync, tick wrapped": WireFrame(
        MessageType.TIME_SYNC, 0, HUB_ITSELF, 79, 5, {"hub_us": 3 * 2**32 + 5, "host_ns": 1_700_000_000_123_456_789}
    ),
    "log text": WireFrame(MessageType.LOG_TEXT, 0, HUB_ITSELF, 80, 7, {"level": 2, "text": "Sensor zu heiß".encode()}),
    "log text, level of a later version": WireFrame(
        MessageType.LOG_TEXT, 0, HUB_ITSELF, 85, 7, {"level": 7, "text": b"awake"}
    ),
    "log text, empty": WireFrame(MessageType.LOG_TEXT, 0, HUB_ITSELF, 81, 8, {"level": 0, "text": b""}),
    "log text, full": WireFrame(MessageType.LOG_TEXT, 0, 0, 82, 8, {"level": 3, "text": b"x" * 223}),
    "command result": WireFrame(
        MessageType.COMMAND_RESULT, 0, HUB_ITSELF, 83, 9, {"seq": 4, "command": MessageType.SET_RATE, "outcome": 0}
    ),
    "command result, outcome of a later version": WireFrame(
        MessageType.COMMAND_RESULT, 0, HUB_ITSELF, 84, 9, {"seq": 2**32 - 1, "command": 99, "outcome": 250}
    ),
    "challenge answer": WireFrame(
        MessageType.CHALLENGE_ANSWER,
        0,
        HUB_ITSELF,
        85,
        9,
        {"nonce": 2**64 - 2, "boot_count": 41, "highest_seq": 1006},
    ),
    "command: challenge": WireFrame(MessageType.CHALLENGE, 0, HUB_ITSELF, 4, 0, {"nonce": 0x0123456789ABCDEF}),
    "command: start the stream": WireFrame(MessageType.SET_STREAM, EVERY_HUB, HUB_ITSELF, 0, 0, {"running": 1}),
    "command: stop the stream of one wheel": WireFrame(MessageType.SET_STREAM, 0, 3, 1, 0, {"running": 0}),
    "command: set the rate": WireFrame(
        MessageType.SET_RATE, EVERY_HUB, HUB_ITSELF, 2, 0, {"rate_hz": float(_F32(6666.6667))}
    ),
    "command: set the time": WireFrame(
        MessageType.SET_TIME, EVERY_HUB, HUB_ITSELF, 3, 0, {"host_ns": 1_700_000_000_123_456_789}
    ),
    "counter and tick before they wrap": WireFrame(MessageType.ENVIRONMENT, 0, 0, 2**32 - 1, 2**32 - 1, _environment()),
    "counter and tick after they wrapped": WireFrame(MessageType.ENVIRONMENT, 0, 0, 0, 249, _environment()),
}


def _seq(seq: int, wheel: int = 0, tick_us: int = 100) -> WireFrame:
    return WireFrame(MessageType.SAMPLES, 0, wheel, seq, tick_us, _SMALL)


def _raw(seq: int, payload: bytes, type_: int = 0x77, **header: int) -> bytes:
    return raw_frame(payload, WireFrame(type_, 0, 0, seq, 100, {}), **header)


def _flip(data: bytes, index: int) -> bytes:
    return data[:index] + bytes([data[index] ^ 1]) + data[index + 1 :]


def _stream(
    name: str, parts: list[bytes | WireFrame], inside: list[WireFrame] | None = None, **counters: int
) -> dict[str, Any]:
    """Return a stream of raw bytes and delivered frames; `inside` are frames delivered from within raw bytes."""
    delivered = [part for part in parts if isinstance(part, WireFrame)] + (inside or [])
    data = b"".join(part if isinstance(part, bytes) else frame_bytes(part) for part in parts)
    return {
        "name": name,
        "hex": data.hex(),
        "frames": [dict(zip(WireFrame._fields, frame[:5], strict=False)) for frame in delivered],
        "counters": dict.fromkeys(_COUNTERS, 0) | {"intact": len(delivered)} | counters,
    }


_COUNTERS: Final = (
    "intact",
    "crc_errors",
    "noise_bytes",
    "truncated",
    "bad_payload",
    "unknown_type",
    "other_major",
    "newer_minor",
    "unknown_flags",
    "lost",
    "duplicates",
    "reordered",
    "restarts",
)


def _streams() -> list[dict[str, Any]]:
    size = len(frame_bytes(_seq(0)))
    hello = WireFrame(MessageType.HELLO, 0, 0, 0, 50, _hello())
    rebooted = hello._replace(payload=_hello(boot_count=42))
    environment = WireFrame(MessageType.ENVIRONMENT, 0, 0, 5, 5, _environment())
    inner = frame_bytes(_seq(9, wheel=9))
    return [
        _stream("frames back to back", [hello, _seq(1), _seq(2), _seq(3)]),
        _stream(
            "frames before the first hello are delivered, and it restarts nothing",
            [_seq(7), environment._replace(seq=8), hello._replace(seq=9), _seq(10)],
        ),
        _stream(
            "samples of other axes than the hello's are delivered: the reader leaves them out",
            [hello, WireFrame(MessageType.SAMPLES, 0, 0, 1, 100, _samples(0, 0b100, 2)), _seq(2)],
        ),
        _stream(
            "a new rate: its hello first, then sample number 0, counters go on",
            [
                hello,
                _seq(1)._replace(payload=_SMALL | {"first_sample": 9600}),
                hello._replace(seq=2, payload=_hello(rate_hz=4800.0)),
                _seq(3),
            ],
        ),
        _stream(
            "a hub of number 255 is read like any other",
            [hello._replace(hub=EVERY_HUB), _seq(1)._replace(hub=EVERY_HUB), _seq(3)._replace(hub=EVERY_HUB)],
            lost=1,
        ),
        _stream(
            "noise between frames", [b"\x00\xff noise", _seq(1), b"\xa5", _seq(2), b"\x5a\xa5\xa5"], noise_bytes=12
        ),
        _stream(
            "one bit flipped: only this frame is lost",
            [_seq(1), _flip(frame_bytes(_seq(2)), 18), _seq(3)],
            crc_errors=1,
            noise_bytes=size,
            lost=1,
        ),
        _stream(
            "a byte missing: the next frame lies within the claimed length",
            [_seq(1), frame_bytes(_seq(2))[:-1], _seq(3)],
            crc_errors=1,
            noise_bytes=size - 1,
            lost=1,
        ),
        _stream(
            "a false header whose length covers a frame",
            [bytes.fromhex("a55a100210"), _seq(1), bytes(40)],
            crc_errors=1,
            noise_bytes=45,
        ),
        _stream("an impossible length", [bytes.fromhex("a55a1002e1"), _seq(1)], noise_bytes=5),
        _stream("unknown type, skipped", [_seq(1), _raw(2, b"\xa5\x5a?"), _seq(3)], intact=3, unknown_type=1),
        _stream(
            "newer minor version, skipped",
            [_seq(1), _raw(2, inner, MessageType.SAMPLES, version=0x11), _seq(3)],
            intact=3,
            newer_minor=1,
        ),
        _stream(
            "other major version: counter ignored",
            [_seq(1), _raw(900, b"?", MessageType.SAMPLES, version=0x20), _seq(2)],
            intact=3,
            other_major=1,
        ),
        _stream(
            "unknown flag",
            [_seq(1), _raw(2, b"?", MessageType.SAMPLES, flags=2), _seq(3)],
            intact=3,
            unknown_flags=1,
        ),
        _stream(
            "a signed frame, tag ignored",
            [_seq(1), raw_frame(payload_bytes(MessageType.SAMPLES, _SMALL) + bytes(8), _seq(2), flags=1)],
            [_seq(2)],
        ),
        _stream(
            "a signed frame too short for its tag",
            [_seq(1), _raw(2, bytes(7), MessageType.SAMPLES, flags=1), _seq(3)],
            intact=3,
            bad_payload=1,
        ),
        _stream(
            "payload of a wrong length",
            [_seq(1), _raw(2, b"???", MessageType.ENVIRONMENT), _seq(3)],
            intact=3,
            bad_payload=1,
        ),
        _stream(
            "a frame inside a log text is text",
            [WireFrame(MessageType.LOG_TEXT, 0, 0, 1, 1, {"level": 1, "text": inner}), _seq(2)],
        ),
        _stream(
            "a frame inside a damaged log text is a frame",
            [_flip(frame_bytes(WireFrame(MessageType.LOG_TEXT, 0, 0, 1, 1, {"level": 1, "text": inner})), 16)],
            [_seq(9, wheel=9)],
            crc_errors=1,
            noise_bytes=21,
        ),
        _stream("counters wrap", [_seq(2**32 - 2), _seq(2**32 - 1), _seq(0), _seq(1)]),
        _stream("ticks wrap", [_seq(1, tick_us=2**32 - 3750), _seq(2, tick_us=0), _seq(3, tick_us=3750)]),
        _stream("a gap", [_seq(1), _seq(5)], lost=3),
        _stream("sources have counters of their own", [_seq(1), _seq(7, wheel=1), _seq(2), _seq(9, wheel=1)], lost=1),
        _stream(
            "a duplicate is not delivered",
            [_seq(1), _seq(2), frame_bytes(_seq(1)), frame_bytes(_seq(2)), _seq(3)],
            intact=5,
            duplicates=2,
        ),
        _stream("a late frame is not counted as lost", [_seq(1), _seq(4), _seq(3)], lost=1, reordered=1),
        _stream("late across the wrap", [_seq(2**32 - 1), _seq(1), _seq(0)], reordered=1),
        _stream("a counter far back is a restart", [_seq(1000), _seq(1001), _seq(0), _seq(1)], restarts=1),
        _stream(
            "a new boot count restarts every source of the hub",
            [hello, environment, _seq(0, wheel=1), rebooted, _seq(0, wheel=1)],
            lost=4,
            restarts=2,
        ),
        _stream("a frame cut off by the end", [_seq(1), frame_bytes(_seq(2))[:-3]], truncated=1, noise_bytes=size - 3),
        _stream("a frame after a truncated header", [b"\xa5\x5a\x10\x02\xe0", _seq(1)], truncated=1, noise_bytes=5),
    ]


def make_vectors() -> dict[str, str]:
    """Return the vector files by name, as JSON text."""
    frames = [
        {"name": name, **_plain(frame._asdict()), "hex": frame_bytes(frame).hex()} for name, frame in _FRAMES.items()
    ]
    refused = [
        {"name": name, "type": int(type_), "payload_hex": payload.hex()} for name, type_, payload in _refused_payloads()
    ]
    protocol = f"{wire.VERSION_MAJOR}.{wire.VERSION_MINOR}"
    tolerated = [
        {"name": name, "type": int(type_), "payload_hex": payload.hex()}
        for name, type_, payload in _tolerated_payloads()
    ]
    return {
        "frames.json": _json(
            {
                "protocol": protocol,
                "frames": frames,
                "refused_payloads": refused,
                "tolerated_payloads": tolerated,
                "shown_texts": _SHOWN_TEXTS,
            }
        ),
        "streams.json": _json({"protocol": protocol, "streams": _streams()}),
        "signed.json": _json({"protocol": protocol, **signed_vectors()}),
    }


_SHOWN_TEXTS: Final = [
    {"name": name, "payload_hex": payload.hex(), "level": level, "shown": shown}
    for name, payload, level, shown in (
        ("plain", b"\x01awake", "info", "awake"),
        ("a level of a later version", b"\x07awake", "level 7", "awake"),
        ("lines and tabs", b"\x02one\r\ntwo\tthree", "warning", "one\\r\\ntwo\\tthree"),
        ("an escape sequence", b"\x03\x1b[2J\x1b[31mred", "error", "\\x1b[2J\\x1b[31mred"),
        ("a null byte and delete", b"\x00a\x00b\x7f", "debug", "a\\x00b\\x7f"),
        ("a C1 control character", b"\x01\xc2\x9b2J", "info", "\\x9b2J"),
        ("a change of the writing direction", "\x01\u202egnol".encode(), "info", "\\u202egnol"),
        ("a line separator", "\x01a\u2028b".encode(), "info", "a\\u2028b"),
        ("not UTF-8", b"\x01a\xff\xc3(\xe2\x82", "info", "a\ufffd\ufffd(\ufffd"),
        ("a character cut off by the end", b"\x01zu hei\xc3", "info", "zu hei\ufffd"),
        ("other scripts", "\x01Größe 寸法 😀".encode(), "info", "Größe 寸法 😀"),
        ("a backslash", b"\x01C:\\new", "info", "C:\\new"),
    )
]
"""What a reader shows of a log text: level in words, and the text with everything unprintable escaped."""


def _tolerated_payloads() -> list[tuple[str, MessageType, bytes]]:
    """Return payloads that a reader accepts by their layout, and that no encoder makes."""
    hellos = {
        "hello, scale of a present axis 0": _hello(scale_mps2=_f32(0.125, 0.0, 0.125)),
        "hello, every scale 0": _hello(scale_mps2=_f32(0.0, 0.0, 0.0)),
        "hello, DC with a high-pass corner": _hello(highpass_hz=2.5),
    }
    return [(name, MessageType.HELLO, payload_bytes(MessageType.HELLO, fields)) for name, fields in hellos.items()]


def _refused_payloads() -> list[tuple[str, MessageType, bytes]]:
    hello = bytearray(payload_bytes(MessageType.HELLO, _hello()))
    status = bytearray(payload_bytes(MessageType.HUB_STATUS, _status(87, -71)))
    return [
        ("hello without axes", MessageType.HELLO, bytes(hello[:6] + b"\0" + hello[7:])),
        ("hello with a rate that is not a number", MessageType.HELLO, bytes(hello[:24] + b"\0\0\xc0\x7f" + hello[28:])),
        ("hello with an infinite scale", MessageType.HELLO, bytes(hello[:44] + b"\0\0\x80\x7f" + hello[48:])),
        (
            "hello with no number as the offset of an absent axis",
            MessageType.HELLO,
            bytes(hello[:6] + b"\x04" + hello[7:56] + b"\0\0\xc0\x7f" + hello[60:]),
        ),
        ("samples without samples", MessageType.SAMPLES, bytes.fromhex("000000000700")),
        ("samples with more samples than n", MessageType.SAMPLES, bytes.fromhex("00000000040100000000")),
        ("samples of a fourth axis", MessageType.SAMPLES, bytes.fromhex("0000000008010000")),
        ("battery at 101 %", MessageType.HUB_STATUS, bytes(status[:26] + b"\x65" + status[27:])),
        ("log text without a level", MessageType.LOG_TEXT, b""),
        ("command result cut short", MessageType.COMMAND_RESULT, bytes(5)),
        ("stream flag out of range", MessageType.SET_STREAM, b"\x02"),
        ("rate below the minimum", MessageType.SET_RATE, bytes.fromhex("00e0f944")),
        ("rate not a number", MessageType.SET_RATE, bytes.fromhex("0000c07f")),
        ("time too long", MessageType.SET_TIME, bytes(9)),
        ("challenge too long", MessageType.CHALLENGE, bytes(9)),
        ("challenge answer cut short", MessageType.CHALLENGE_ANSWER, bytes(15)),
    ]


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {name: _plain(inner) for name, inner in value.items()}
    if isinstance(value, bytes):
        return value.decode()
    return int(value) if isinstance(value, MessageType) else value


def _json(content: Mapping[str, Any]) -> str:
    """Return JSON with one line per vector, so that a changed vector is a changed line."""
    parts = []
    for name, value in content.items():
        if isinstance(value, list):
            lines = ",\n".join(json.dumps(item, ensure_ascii=False) for item in value)
            parts.append(f'"{name}": [\n{lines}\n]')
        else:
            parts.append(f'"{name}": {json.dumps(value)}')
    return "{\n" + ",\n".join(parts) + "\n}\n"
