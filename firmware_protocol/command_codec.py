"""Encodes and decodes commands to the hub and their results; part of `codec.py`."""

from __future__ import annotations

import struct
from collections.abc import Callable
from typing import Final

from firmware_protocol import wire
from firmware_protocol.checks import integer, real, require_length
from firmware_protocol.messages import CommandResult, Message, MessageType, SetRate, SetStream, SetTime

_RESULT: Final = struct.Struct("<IBB")
_RATE: Final = struct.Struct("<f")
_TIME: Final = struct.Struct("<Q")
_U8: Final = 0xFF
_U32: Final = 0xFFFF_FFFF
_U64: Final = 0xFFFF_FFFF_FFFF_FFFF


def _encode_result(message: CommandResult) -> bytes:
    return _RESULT.pack(
        integer("seq", message.seq, 0, _U32),
        integer("command", message.command, 0, _U8),
        integer("outcome", message.outcome, 0, _U8),
    )


def _decode_result(payload: bytes) -> CommandResult:
    require_length("command result", payload, _RESULT.size)
    return CommandResult(*_RESULT.unpack(payload))


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


def _encode_time(message: SetTime) -> bytes:
    return _TIME.pack(integer("host_ns", message.host_ns, 0, _U64))


def _decode_time(payload: bytes) -> SetTime:
    require_length("set time", payload, _TIME.size)
    return SetTime(*_TIME.unpack(payload))


COMMAND_ENCODERS: Final[dict[type, tuple[MessageType, Callable[..., bytes]]]] = {
    CommandResult: (MessageType.COMMAND_RESULT, _encode_result),
    SetStream: (MessageType.SET_STREAM, _encode_stream),
    SetRate: (MessageType.SET_RATE, _encode_rate),
    SetTime: (MessageType.SET_TIME, _encode_time),
}
COMMAND_DECODERS: Final[dict[int, Callable[[bytes], Message]]] = {
    MessageType.COMMAND_RESULT: _decode_result,
    MessageType.SET_STREAM: _decode_stream,
    MessageType.SET_RATE: _decode_rate,
    MessageType.SET_TIME: _decode_time,
}
COMMAND_FIXED_LENGTHS: Final[dict[int, int]] = {
    MessageType.COMMAND_RESULT: _RESULT.size,
    MessageType.SET_TIME: _TIME.size,
}
