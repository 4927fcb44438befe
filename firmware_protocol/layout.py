"""Layout of a header or payload: its fields one after the other, little-endian and without padding."""

from itertools import pairwise
from struct import Struct, calcsize
from typing import Any, Final, NamedTuple

from firmware_protocol.checks import MAX_F32

_C_TYPES: Final = {
    "B": "uint8_t",
    "H": "uint16_t",
    "I": "uint32_t",
    "Q": "uint64_t",
    "b": "int8_t",
    "h": "int16_t",
    "i": "int32_t",
    "f": "float",
}
_UNSIGNED: Final = {calcsize(f"<{code}"): code for code in "BHIQ"}


class Field(NamedTuple):
    """One field of a header or payload.

    Attributes:
        name: with the unit of the wire.
        code: type of one element as in `struct`; "s" for a byte of text or of a constant.
        docs: meaning.
        low: least value, None where the type alone limits it.
        high: greatest value, likewise.
        none: value that means "not available", None where there is no such value.
        elements: number of them, None where it varies; such a field is the last.
        attribute: of the message, where it is not the name of the field. Fields of one attribute make a tuple.
        per_unit: steps per unit of the message's value, None where the message has the number of the wire.
        kind: class of the message's value, None where it is a plain number.
        offset: bytes from the start of the header or payload; the layout sets it.
    """

    name: str
    code: str
    docs: str = ""
    low: float | None = None
    high: float | None = None
    none: int | None = None
    elements: int | None = 1
    attribute: str = ""
    per_unit: int | None = None
    kind: Any = None
    offset: int = 0

    @property
    def size(self) -> int:
        """Bytes of one element."""
        return calcsize(f"<{self.code}")

    @property
    def end(self) -> int:
        """Bytes from the start of the header or payload to the end of the field."""
        return self.offset + self.size * (self.elements or 0)

    @property
    def c_type(self) -> str:
        """Type of one element, in C; `char` for text."""
        return _C_TYPES.get(self.code, "uint8_t" if self.elements else "char")

    @property
    def bounds(self) -> tuple[float, float]:
        """Least and greatest number that the field can have, without the value for "not available"."""
        if self.code == "f":
            low, high = -MAX_F32, MAX_F32
        else:
            span = 1 << 8 * self.size
            low, high = (0, span - 1) if self.code.isupper() else (-span // 2, span // 2 - 1)
            low, high = low + (self.none == low), high - (self.none == high)
        return (low if self.low is None else self.low), (high if self.high is None else self.high)


class Layout:
    """Fields in the order of the wire.

    Attributes:
        fields: with their offsets.
        size: bytes, without a last field of varying length.
        head: all fields but one of varying length.
    """

    def __init__(self, *fields: Field) -> None:
        placed: list[Field] = []
        for field in fields:
            placed.append(field._replace(offset=placed[-1].end if placed else 0))
        self.fields: Final = tuple(placed)
        self.size: Final = placed[-1].end
        self._fields = {field.name: field for field in placed}
        self.head: Final = self.reader(*(field.name for field in placed if field.elements is not None))

    def offset(self, name: str) -> int:
        """Return the bytes before a field."""
        return self._fields[name].offset

    def reader(self, *names: str | tuple[str, ...]) -> Struct:
        """Return the struct of some fields in the order of the wire, the others skipped.

        Args:
            names: of the fields; a tuple of adjacent ones is read as one unsigned number.

        Raises:
            ValueError: fields of a tuple are not adjacent.
        """
        codes, end = "<", 0
        for name in names:
            group = [self._fields[member] for member in ((name,) if isinstance(name, str) else name)]
            first, last = group[0], group[-1]
            if any(field.end != after.offset for field, after in pairwise(group)):
                raise ValueError(f"the fields {name} are not adjacent")
            code = f"{first.elements}{first.code}" if len(group) == 1 else _UNSIGNED[last.end - first.offset]
            codes += f"{first.offset - end}x{code}"
            end = last.end
        return Struct(codes)
