"""Table of the declared fields: offset, type and meaning of each, for the specification and the C code."""

from collections.abc import Iterator
from typing import Any, Final, NamedTuple

import construct as c

from firmware_protocol.declaration import Limited

_C_TYPES: Final = {
    "B": "uint8_t",
    "H": "uint16_t",
    "I": "uint32_t",
    "L": "uint32_t",
    "Q": "uint64_t",
    "b": "int8_t",
    "h": "int16_t",
    "i": "int32_t",
    "l": "int32_t",
    "f": "float",
}


class Field(NamedTuple):
    """One field of a header or payload.

    Attributes:
        name: as declared.
        offset: bytes from the start of the header or payload.
        c_type: type of one element, in C; `char` for text.
        size: bytes of one element.
        elements: number of them, None where it varies.
        docs: meaning.
        low: least value, None where the type alone limits it.
        high: greatest value, likewise.
        none: value that means "not available", None where there is no such value.
    """

    name: str
    offset: int
    c_type: str
    size: int
    elements: int | None
    docs: str
    low: float | None
    high: float | None
    none: int | None


def fields(struct: c.Struct) -> Iterator[Field]:
    """Yield the fields of a declared struct in the order of the wire."""
    offset = 0
    for named in struct.subcons:
        if not isinstance(named, c.Renamed):
            continue
        kind = _unnamed(named)
        count: int | None = 1
        low = high = none = None
        if isinstance(kind, c.Array):
            count, kind = (None if callable(kind.count) else kind.count), kind.subcon
        if isinstance(kind, Limited):
            low, high, none, kind = kind.low, kind.high, kind.none, kind.subcon
        if isinstance(kind, c.Const):
            c_type, size = "uint8_t", 1
            count = len(kind.value)
        elif isinstance(kind, c.FormatField):
            c_type, size = _C_TYPES[kind.fmtstr[-1]], kind.sizeof()
        else:
            c_type, size = "char", 1
            count = None
        yield Field(named.name, offset, c_type, size, count, named.docs, low, high, none)
        offset += size * (count or 0)


def _unnamed(subcon: Any) -> Any:
    while isinstance(subcon, c.Renamed):
        subcon = subcon.subcon
    return subcon
