"""Frames built with `construct` from the declaration: slow, for test vectors, which must not use what they test."""

import zlib
from collections.abc import Callable, Mapping
from typing import Any, Final, NamedTuple

import construct as c

from firmware_protocol import wire
from firmware_protocol.declaration import PAYLOADS
from firmware_protocol.layout import Field
from firmware_protocol.messages import MessageType


class WireFrame(NamedTuple):
    """A frame in the units of the wire; `payload` has the fields of its declaration."""

    type: int
    hub: int
    wheel: int
    seq: int
    tick_us: int
    payload: Mapping[str, Any]


def number(field: Field) -> Any:
    """Return the type of one element, within what its bytes can hold."""
    whole = c.BytesInteger(field.size, signed=field.code.islower(), swapped=True)
    return c.Float32l if field.code == "f" else whole


def struct_of(fields: tuple[Field, ...], *more: Any, element: Callable[[Field], Any] = number) -> Any:
    """Return the struct of a header or payload.

    Args:
        fields: as declared.
        more: what follows them.
        element: returns the type of one element of a field.
    """

    def member(field: Field) -> Any:
        if field.code == "s":
            return c.GreedyBytes if field.elements is None else c.Const(wire.SYNC)
        if field.elements is None:
            return c.Array(lambda this: this.n * this.axes.bit_count(), element(field))
        return element(field) if field.elements == 1 else c.Array(field.elements, element(field))

    return c.Struct(*(field.name / member(field) for field in fields), *more)


FRAME: Final = c.Struct(
    "body" / c.RawCopy(struct_of(wire.HEADER.fields, "payload" / c.Bytes(c.this.length))),
    "crc32" / c.Checksum(c.Int32ul, zlib.crc32, c.this.body.data),
)
_PAYLOADS: Final = {type_: struct_of(payload.fields) for type_, payload in PAYLOADS.items()}


def frame_bytes(frame: WireFrame) -> bytes:
    """Return the bytes of `frame`."""
    return raw_frame(payload_bytes(frame.type, frame.payload), frame)


def payload_bytes(type_: int, fields: Mapping[str, Any]) -> bytes:
    """Return the payload with these fields, each a number, a list of numbers or bytes; their limits are not checked."""
    payload: bytes = _PAYLOADS[MessageType(type_)].build(dict(fields))
    return payload


def raw_frame(payload: bytes, frame: WireFrame, *, version: int = wire.VERSION_BYTE, flags: int = 0) -> bytes:
    """Return a frame with the header values of `frame` around any payload."""
    header = frame._asdict() | {"version": version, "flags": flags, "length": len(payload), "payload": payload}
    built: bytes = FRAME.build({"body": {"value": header}})
    return built
