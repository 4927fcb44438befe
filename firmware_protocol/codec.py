"""Encoder and decoder of frames and payloads with `struct`. Tests compare them byte for byte with `declaration.py`."""

import math
import struct
from collections.abc import Callable
from typing import Any, Final
from zlib import crc32

import numpy as np

from firmware_protocol import wire
from firmware_protocol.checks import fixed, integer, is_zero_f32, real, reject, require_length, triple
from firmware_protocol.messages import (
    Axis,
    Challenge,
    ChallengeAnswer,
    CommandResult,
    Coupling,
    Environment,
    Frame,
    Hello,
    HubStatus,
    LogText,
    Message,
    MessageType,
    SampleBlock,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)

SAMPLE_DTYPE: Final = np.dtype("<i2")
CHANNELS: Final = tuple(mask.bit_count() if 0 < mask <= wire.ALL_AXES else 0 for mask in range(256))
"""Number of channels per axis mask, 0 where the mask is invalid."""


def _sample_layouts() -> tuple[tuple[int, tuple[int, int]], ...]:
    layouts = [(-1, (0, 0))] * 0x10000
    for axes, channels in enumerate(CHANNELS):
        row_bytes = SAMPLE_DTYPE.itemsize * channels
        for n in range(1, (wire.MAX_PAYLOAD_BYTES - wire.SAMPLES_HEADER_BYTES) // row_bytes + 1 if row_bytes else 0):
            layouts[n << 8 | axes] = (wire.SAMPLES_HEADER_BYTES + row_bytes * n, (n, channels))
    return tuple(layouts)


SAMPLE_LAYOUTS: Final = _sample_layouts()
"""Payload length and shape of a sample block, by `n << 8 | axes`; length -1 where there is no such block."""

_HEADER: Final = struct.Struct(wire.HEADER_FORMAT)
_CRC: Final = struct.Struct("<I")
_HELLO: Final = struct.Struct("<BBBBHBBQIIff3f3f3fH")
_SAMPLES: Final = struct.Struct(wire.SAMPLES_FORMAT)
_ENVIRONMENT: Final = struct.Struct("<ihH")
_HUB_STATUS: Final = struct.Struct("<IIIIIIHBb")
_RATE: Final = struct.Struct("<f")

_U8: Final = 0xFF
_U16: Final = 0xFFFF
_U32: Final = 0xFFFF_FFFF
_U64: Final = 0xFFFF_FFFF_FFFF_FFFF
_INF: Final = math.inf


def encode_frame(frame: Frame) -> bytes:
    """Return the bytes of `frame`; its message decides the type and the payload.

    Raises:
        ValueError: a value does not fit; the message names the field.
    """
    type_, encode = _ENCODERS[type(frame.message)]
    if frame.type != type_:
        reject("type", frame.type, f"{type_:d} for {type(frame.message).__name__}")
    return encode_raw(type_, encode(frame.message), frame.hub, frame.wheel, frame.seq, frame.tick_us)


def encode_raw(
    type_: int,
    payload: bytes,
    hub: int,
    wheel: int,
    seq: int,
    tick_us: int,
    *,
    version: int = wire.VERSION_BYTE,
    flags: int = 0,
) -> bytes:
    """Return a frame around any payload, also of types, versions and flags that this version does not know.

    Raises:
        ValueError: a value does not fit; the message names the field.
    """
    if len(payload) > wire.MAX_PAYLOAD_BYTES:
        reject("length of the payload", len(payload), f"at most {wire.MAX_PAYLOAD_BYTES}")
    try:
        header = _HEADER.pack(wire.SYNC, version, type_, len(payload), hub, wheel, flags, seq, tick_us)
    except struct.error:
        for name, value, top in (
            ("version", version, _U8),
            ("type", type_, _U8),
            ("hub", hub, _U8),
            ("wheel", wheel, _U8),
            ("flags", flags, _U8),
            ("seq", seq, _U32),
            ("tick_us", tick_us, _U32),
        ):
            integer(name, value, 0, top)
        raise
    body = header + payload
    return body + _CRC.pack(crc32(body))


def encode_payload(message: Message) -> bytes:
    """Return the payload bytes of `message`.

    Raises:
        ValueError: a value does not fit; the message names the field.
    """
    return _ENCODERS[type(message)][1](message)


def decode_payload(type_: int, payload: bytes) -> Message:
    """Return the message in `payload`; samples are a view of it.

    Raises:
        ValueError: the type is unknown, or the payload breaks the layout of its type.
    """
    decode = DECODERS.get(type_)
    if decode is None:
        raise ValueError(f"unknown message type {type_}")
    return decode(payload)


def _encode_hello(message: Hello) -> bytes:
    major, minor, patch = message.firmware
    payload = _HELLO.pack(
        integer("protocol_major", message.protocol_major, 0, _U8),
        integer("protocol_minor", message.protocol_minor, 0, _U8),
        integer("firmware major", major, 0, _U8),
        integer("firmware minor", minor, 0, _U8),
        integer("firmware patch", patch, 0, _U16),
        integer("axes", message.axes, 1, wire.ALL_AXES),
        integer("coupling", message.coupling, 0, max(Coupling)),
        integer("hub_id", message.hub_id, 0, _U64),
        integer("sensor_id", message.sensor_id, 0, _U32),
        integer("boot_count", message.boot_count, 0, _U32),
        real("rate_hz", message.rate_hz, wire.MIN_RATE_HZ, wire.MAX_RATE_HZ),
        real("highpass_hz", message.highpass_hz, 0.0, _INF),
        *triple("range_mps2", message.range_mps2, 0.0),
        *triple("scale_mps2", message.scale_mps2, -_INF),
        *triple("offset_counts", message.offset_counts, -_INF),
        integer("saturation_counts", message.saturation_counts, 1, wire.MAX_SATURATION_COUNTS),
    )
    _check_sendable(message)
    return payload


def _check_sendable(message: Hello) -> None:
    """Raise the error of a hello that no hub may send although every reader accepts its layout."""
    if any(message.axes >> axis & 1 and is_zero_f32(message.scale_mps2[axis]) for axis in Axis):
        reject("scale_mps2", message.scale_mps2, "other than 0 on every axis that the mask has")
    if message.coupling == Coupling.DC and not is_zero_f32(message.highpass_hz):
        reject("highpass_hz", message.highpass_hz, "0 with DC coupling")


def _decode_hello(payload: bytes) -> Hello:
    require_length("hello", payload, _HELLO.size)
    values = _HELLO.unpack(payload)
    major, minor, fw_major, fw_minor, fw_patch, axes, coupling, hub_id, sensor_id, boot_count = values[:10]
    rate_hz, highpass_hz, saturation = values[10], values[11], values[21]
    reals = values[10:21]
    if not (
        CHANNELS[axes]
        and coupling <= max(Coupling)
        and all(map(math.isfinite, reals))
        and wire.MIN_RATE_HZ <= rate_hz <= wire.MAX_RATE_HZ
        and min(highpass_hz, *values[12:15]) >= 0
        and 1 <= saturation <= wire.MAX_SATURATION_COUNTS
    ):
        raise ValueError("hello holds a value outside its range")
    return Hello(
        major,
        minor,
        hub_id,
        sensor_id,
        (fw_major, fw_minor, fw_patch),
        boot_count,
        rate_hz,
        axes,
        Coupling(coupling),
        highpass_hz,
        values[12:15],
        values[15:18],
        values[18:21],
        saturation,
    )


def _encode_samples(message: SampleBlock) -> bytes:
    counts = message.counts
    if counts.dtype != SAMPLE_DTYPE:
        exact = counts.astype(SAMPLE_DTYPE)
        if not np.array_equal(exact, counts):
            reject("counts", counts.dtype, "whole numbers of 16 bit")
        counts = exact
    channels = CHANNELS[integer("axes", message.axes, 1, wire.ALL_AXES)]
    most = (wire.MAX_PAYLOAD_BYTES - wire.SAMPLES_HEADER_BYTES) // (SAMPLE_DTYPE.itemsize * channels)
    if counts.ndim != 2 or counts.shape[1] != channels or not 1 <= len(counts) <= most:
        reject("shape of counts", counts.shape, f"(1 to {most}, {channels})")
    head = _SAMPLES.pack(integer("first_sample", message.first_sample, 0, _U32), message.axes, len(counts))
    return head + counts.tobytes()


def _decode_samples(payload: bytes) -> SampleBlock:
    if len(payload) < wire.SAMPLES_HEADER_BYTES:
        require_length("samples", payload, wire.SAMPLES_HEADER_BYTES)
    first_sample, axes, n = _SAMPLES.unpack_from(payload)
    length, shape = SAMPLE_LAYOUTS[n << 8 | axes]
    if len(payload) != length:
        raise ValueError(f"samples payload has {len(payload)} bytes, axis mask {axes:#x} and {n} samples")
    counts: np.ndarray[tuple[int, int], np.dtype[np.int16]]
    counts = np.ndarray(shape, SAMPLE_DTYPE, payload, wire.SAMPLES_HEADER_BYTES)
    return SampleBlock(first_sample, axes, counts)


def _encode_environment(message: Environment) -> bytes:
    return _ENVIRONMENT.pack(
        fixed("pressure_pa", message.pressure_pa, 1, wire.NONE_I32 + 1, -(wire.NONE_I32 + 1), wire.NONE_I32),
        fixed("temperature_degc", message.temperature_degc, 100, wire.NONE_I16 + 1, 0x7FFF, wire.NONE_I16),
        fixed("supply_v", message.supply_v, 1000, 0, wire.NONE_U16 - 1, wire.NONE_U16),
    )


def _decode_environment(payload: bytes) -> Environment:
    require_length("environment", payload, _ENVIRONMENT.size)
    pressure, temperature, supply = _ENVIRONMENT.unpack(payload)
    return Environment(
        None if pressure == wire.NONE_I32 else float(pressure),
        None if temperature == wire.NONE_I16 else temperature / 100,
        None if supply == wire.NONE_U16 else supply / 1000,
    )


def _encode_hub_status(message: HubStatus) -> bytes:
    battery, rssi = message.battery_percent, message.rssi_dbm
    return _HUB_STATUS.pack(
        integer("uptime_s", message.uptime_s, 0, _U32),
        integer("frames_sent", message.frames_sent, 0, _U32),
        integer("frames_dropped", message.frames_dropped, 0, _U32),
        integer("samples_dropped", message.samples_dropped, 0, _U32),
        integer("link_retries", message.link_retries, 0, _U32),
        fixed("supply_w", message.supply_w, 1_000_000, 0, _U32),
        fixed("supply_v", message.supply_v, 1000, 0, _U16),
        wire.NONE_U8 if battery is None else integer("battery_percent", battery, 0, wire.MAX_BATTERY_PERCENT),
        wire.NONE_I8 if rssi is None else integer("rssi_dbm", rssi, wire.NONE_I8 + 1, 0x7F),
    )


def _decode_hub_status(payload: bytes) -> HubStatus:
    require_length("hub status", payload, _HUB_STATUS.size)
    uptime_s, sent, dropped, samples_dropped, retries, supply_uw, supply_mv, battery, rssi = _HUB_STATUS.unpack(payload)
    if wire.MAX_BATTERY_PERCENT < battery != wire.NONE_U8:
        raise ValueError(f"hub status with a battery at {battery} %")
    return HubStatus(
        uptime_s,
        None if battery == wire.NONE_U8 else battery,
        supply_mv / 1000,
        supply_uw / 1_000_000,
        None if rssi == wire.NONE_I8 else rssi,
        sent,
        dropped,
        samples_dropped,
        retries,
    )


def _encode_log_text(message: LogText) -> bytes:
    text = message.text.encode()
    if len(text) >= wire.MAX_PAYLOAD_BYTES:
        reject("length of text", len(text), f"at most {wire.MAX_PAYLOAD_BYTES - 1} bytes of UTF-8")
    return bytes((integer("level", message.level, 0, _U8),)) + text


def _decode_log_text(payload: bytes) -> LogText:
    if not payload:
        require_length("log text", payload, 1)
    return LogText(payload[0], payload[1:].decode(errors="replace"))


def _encode_stream(message: SetStream) -> bytes:
    return bytes((integer("running", message.running, 0, 1),))


def _decode_stream(payload: bytes) -> SetStream:
    require_length("set stream", payload, 1)
    if payload[0] > 1:
        raise ValueError(f"set stream holds {payload[0]}, neither 0 nor 1")
    return SetStream(bool(payload[0]))


def _encode_rate(message: SetRate) -> bytes:
    return _RATE.pack(real("rate_hz", message.rate_hz, wire.MIN_RATE_HZ, wire.MAX_RATE_HZ))


def _decode_rate(payload: bytes) -> SetRate:
    require_length("set rate", payload, _RATE.size)
    (rate_hz,) = _RATE.unpack(payload)
    if not wire.MIN_RATE_HZ <= rate_hz <= wire.MAX_RATE_HZ:
        raise ValueError(f"set rate asks for {rate_hz:g} Hz")
    return SetRate(rate_hz)


class _Integers:
    """Codec of a message of unsigned integers, in the order of its fields; every bit pattern is valid.

    Attributes:
        message: class of the message.
        layout: of the payload.
    """

    def __init__(self, message: Any, name: str, widths: str) -> None:
        self.message = message
        self.layout = struct.Struct(f"<{widths}")
        self._name = name
        self._highest = {
            field: (1 << 8 * struct.calcsize(width)) - 1 for field, width in zip(message._fields, widths, strict=True)
        }

    def encode(self, message: Any) -> bytes:
        return self.layout.pack(
            *(integer(field, getattr(message, field), 0, highest) for field, highest in self._highest.items())
        )

    def decode(self, payload: bytes) -> Any:
        require_length(self._name, payload, self.layout.size)
        return self.message(*self.layout.unpack(payload))


_INTEGERS: Final = {
    MessageType.TIME_SYNC: _Integers(TimeSync, "time sync", "QQ"),
    MessageType.COMMAND_RESULT: _Integers(CommandResult, "command result", "IBB"),
    MessageType.SET_TIME: _Integers(SetTime, "set time", "Q"),
    MessageType.CHALLENGE: _Integers(Challenge, "challenge", "Q"),
    MessageType.CHALLENGE_ANSWER: _Integers(ChallengeAnswer, "challenge answer", "QII"),
}

_ENCODERS: Final[dict[type, tuple[MessageType, Callable[..., bytes]]]] = {
    Hello: (MessageType.HELLO, _encode_hello),
    SampleBlock: (MessageType.SAMPLES, _encode_samples),
    Environment: (MessageType.ENVIRONMENT, _encode_environment),
    HubStatus: (MessageType.HUB_STATUS, _encode_hub_status),
    LogText: (MessageType.LOG_TEXT, _encode_log_text),
    SetStream: (MessageType.SET_STREAM, _encode_stream),
    SetRate: (MessageType.SET_RATE, _encode_rate),
    **{codec.message: (type_, codec.encode) for type_, codec in _INTEGERS.items()},
}

DECODERS: Final[dict[int, Callable[[bytes], Message]]] = {
    MessageType.HELLO: _decode_hello,
    MessageType.SAMPLES: _decode_samples,
    MessageType.ENVIRONMENT: _decode_environment,
    MessageType.HUB_STATUS: _decode_hub_status,
    MessageType.LOG_TEXT: _decode_log_text,
    MessageType.SET_STREAM: _decode_stream,
    MessageType.SET_RATE: _decode_rate,
    **{type_: codec.decode for type_, codec in _INTEGERS.items()},
}
"""Payload decoder per type byte; each raises ValueError when the payload breaks its layout."""

FIXED_LENGTHS: Final[dict[int, int]] = {
    MessageType.ENVIRONMENT: _ENVIRONMENT.size,
    **{type_: codec.layout.size for type_, codec in _INTEGERS.items()},
}
"""Types of which every payload of this length is valid, whatever it holds."""
