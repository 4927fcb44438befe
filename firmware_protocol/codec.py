"""Encoder and decoder of frames and payloads with `struct`, as declared."""

import struct
from collections.abc import Callable
from operator import itemgetter
from typing import Any, Final
from zlib import crc32

import numpy as np

from firmware_protocol import wire
from firmware_protocol.checks import PayloadError, fixed, integer, is_zero_f32, real, reject, require_length
from firmware_protocol.declaration import PAYLOADS, SAMPLES, Payload
from firmware_protocol.layout import Field
from firmware_protocol.messages import Axis, Coupling, Frame, Hello, LogText, Message, MessageType, SampleBlock

SAMPLE_DTYPE: Final = np.dtype(f"<{SAMPLES.fields[-1].code}")
CHANNELS: Final = tuple(mask.bit_count() if 0 < mask <= wire.ALL_AXES else 0 for mask in range(256))
"""Number of channels per axis mask, 0 where the mask is invalid."""


def _sample_layouts() -> tuple[tuple[int, tuple[int, int]], ...]:
    layouts = [(-1, (0, 0))] * 0x10000
    for axes, channels in enumerate(CHANNELS):
        row_bytes = SAMPLE_DTYPE.itemsize * channels
        for n in range(1, (wire.MAX_PAYLOAD_BYTES - SAMPLES.size) // row_bytes + 1 if row_bytes else 0):
            layouts[n << 8 | axes] = (SAMPLES.size + row_bytes * n, (n, channels))
    return tuple(layouts)


SAMPLE_LAYOUTS: Final = _sample_layouts()
"""Payload length and shape of a sample block, by `n << 8 | axes`; length -1 where there is no such block."""

_CRC: Final = struct.Struct("<I")


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
    values = (wire.SYNC, version, type_, len(payload), hub, wheel, flags, seq, tick_us)
    if len(payload) > wire.MAX_PAYLOAD_BYTES:
        reject("length of the payload", len(payload), f"at most {wire.MAX_PAYLOAD_BYTES}")
    try:
        body = wire.HEADER.head.pack(*values) + payload
    except struct.error:
        for field, value in zip(wire.HEADER.fields[1:], values[1:], strict=True):
            _writer(field)(value)
        raise
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
        ValueError: the type is unknown.
        PayloadError: the payload breaks the layout of its type.
    """
    decode = DECODERS.get(type_)
    if decode is None:
        raise ValueError(f"unknown message type {type_}")
    return decode(payload)


def _writer(field: Field) -> Callable[[Any], Any]:
    """Return the function from a value of a message to the number of the wire; it raises ValueError out of range."""
    low, high = field.bounds
    name, none, per_unit = field.name, field.none, field.per_unit
    if per_unit is not None:
        attribute = field.attribute or name
        return lambda value: (
            none if value is None and none is not None else fixed(attribute, value, per_unit, low, high)
        )
    check = real if field.code == "f" else integer
    if none is not None:
        return lambda value: none if value is None else check(name, value, low, high)
    return lambda value: check(name, value, low, high)


def _reader(field: Field, indices: list[int]) -> Callable[[tuple[Any, ...]], Any] | None:
    """Return the function from the numbers of the wire to a value of the message, None where it is one of them."""
    index, none, per_unit, kind = indices[0], field.none, field.per_unit, field.kind
    if per_unit is not None:
        return lambda numbers: None if numbers[index] == none else numbers[index] / per_unit
    if none is not None:
        return lambda numbers: None if numbers[index] == none else numbers[index]
    if kind is not None:
        return lambda numbers: kind(numbers[index])
    return itemgetter(*indices) if len(indices) > 1 else None


class _Codec:
    """Codec of the payloads of one type, all of one length.

    Attributes:
        is_free: whether every payload of this length is valid, whatever it holds.
    """

    def __init__(self, payload: Payload) -> None:
        self._type, self._size = payload.type, payload.size
        self._pack, self._unpack, self._message = payload.head.pack, payload.head.unpack, payload.message
        # One field for every number of the wire, and the indices of the numbers that make each value of the message.
        fields = [field for field in payload.fields for _ in range(field.elements or 0)]
        indices: dict[str, list[int]] = {attribute: [] for attribute in payload.message._fields}
        for index, field in enumerate(fields):
            indices[field.attribute or field.name].append(index)
        limited = [(i, field) for i, field in enumerate(fields) if field.low is not None or field.high is not None]
        self._limits = [(i, *field.bounds, field.none, field.name) for i, field in limited]
        self.is_free = not limited
        self._count = len(fields)
        self._writers = [(name, [(i, _writer(fields[i])) for i in members]) for name, members in indices.items()]
        self._order = [members[0] for members in indices.values()]
        readers = [_reader(fields[members[0]], members) for members in indices.values()]
        self._readers = [(position, read) for position, read in enumerate(readers) if read is not None]

    def encode(self, message: Any) -> bytes:
        numbers: list[Any] = [0] * self._count
        for (attribute, writers), value in zip(self._writers, message, strict=True):
            if len(writers) == 1:
                index, write = writers[0]
                numbers[index] = write(value)
                continue
            if len(value) != len(writers):
                reject(attribute, value, f"{len(writers)} values")
            for (index, write), part in zip(writers, value, strict=True):
                numbers[index] = write(part)
        return self._pack(*numbers)

    def decode(self, payload: bytes) -> Any:
        if len(payload) != self._size:
            require_length(self._type, payload, self._size)
        numbers = self._unpack(payload)
        for index, low, high, none, name in self._limits:
            if not low <= numbers[index] <= high and numbers[index] != none:
                raise PayloadError(self._type, f"{name} {numbers[index]:g}", name)
        values = [numbers[index] for index in self._order]
        for position, read in self._readers:
            values[position] = read(numbers)
        return self._message(*values)


_write_first_sample, _write_axes = map(_writer, SAMPLES.fields[:2])
_write_level: Final = _writer(PAYLOADS[MessageType.LOG_TEXT].fields[0])


def _encode_hello(message: Hello) -> bytes:
    payload = _HELLO.encode(message)
    _check_sendable(message)
    return payload


def _check_sendable(message: Hello) -> None:
    """Raise the error of a hello that no hub may send although every reader accepts its layout."""
    if any(message.axes >> axis & 1 and is_zero_f32(message.scale_mps2[axis]) for axis in Axis):
        reject("scale_mps2", message.scale_mps2, "other than 0 on every axis that the mask has")
    if message.coupling == Coupling.DC and not is_zero_f32(message.highpass_hz):
        reject("highpass_hz", message.highpass_hz, "0 with DC coupling")


def _encode_samples(message: SampleBlock) -> bytes:
    counts = message.counts
    if counts.dtype != SAMPLE_DTYPE:
        exact = counts.astype(SAMPLE_DTYPE)
        if not np.array_equal(exact, counts):
            reject("counts", counts.dtype, "whole numbers of 16 bit")
        counts = exact
    channels = CHANNELS[_write_axes(message.axes)]
    most = (wire.MAX_PAYLOAD_BYTES - SAMPLES.size) // (SAMPLE_DTYPE.itemsize * channels)
    if counts.ndim != 2 or counts.shape[1] != channels or not 1 <= len(counts) <= most:
        reject("shape of counts", counts.shape, f"(1 to {most}, {channels})")
    head = SAMPLES.head.pack(_write_first_sample(message.first_sample), message.axes, len(counts))
    return head + counts.tobytes()


def _decode_samples(payload: bytes) -> SampleBlock:
    if len(payload) < SAMPLES.size:
        require_length(MessageType.SAMPLES, payload, SAMPLES.size)
    first_sample, axes, n = SAMPLES.head.unpack_from(payload)
    length, shape = SAMPLE_LAYOUTS[n << 8 | axes]
    if len(payload) != length:
        if length >= 0:
            require_length(MessageType.SAMPLES, payload, length)
        field = "n" if CHANNELS[axes] else "axes"
        raise PayloadError(MessageType.SAMPLES, f"{n} samples of axis mask {axes:#x}", field)
    counts: np.ndarray[tuple[int, int], np.dtype[np.int16]]
    counts = np.ndarray(shape, SAMPLE_DTYPE, payload, SAMPLES.size)
    return SampleBlock(first_sample, axes, counts)


def _encode_log_text(message: LogText) -> bytes:
    text = message.text.encode()
    if len(text) >= wire.MAX_PAYLOAD_BYTES:
        reject("length of text", len(text), f"at most {wire.MAX_PAYLOAD_BYTES - 1} bytes of UTF-8")
    return bytes((_write_level(message.level),)) + text


def _decode_log_text(payload: bytes) -> LogText:
    if not payload:
        raise PayloadError(MessageType.LOG_TEXT, "no level", "level")
    return LogText(payload[0], payload[1:].decode(errors="replace"))


_CODECS: Final = {
    type_: _Codec(payload) for type_, payload in PAYLOADS.items() if payload.fields[-1].elements is not None
}
_HELLO: Final = _CODECS[MessageType.HELLO]

_ENCODERS: Final[dict[type, tuple[MessageType, Callable[..., bytes]]]] = {
    **{PAYLOADS[type_].message: (type_, codec.encode) for type_, codec in _CODECS.items()},
    Hello: (MessageType.HELLO, _encode_hello),
    SampleBlock: (MessageType.SAMPLES, _encode_samples),
    LogText: (MessageType.LOG_TEXT, _encode_log_text),
}

DECODERS: Final[dict[int, Callable[[bytes], Message]]] = {
    **{type_: codec.decode for type_, codec in _CODECS.items()},
    MessageType.SAMPLES: _decode_samples,
    MessageType.LOG_TEXT: _decode_log_text,
}
"""Payload decoder per type byte; each raises PayloadError when the payload breaks its layout."""

FIXED_LENGTHS: Final[dict[int, int]] = {
    type_: PAYLOADS[type_].size for type_, codec in _CODECS.items() if codec.is_free
}
"""Types of which every payload of this length is valid, whatever it holds."""
