"""Values and their ranges as C expressions; part of `cgen.py`."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from firmware_protocol.checks import MAX_F32
from firmware_protocol.field_table import Field

_TOP: Final = {"uint8_t": 0xFF, "uint16_t": 0xFFFF, "uint32_t": 0xFFFF_FFFF}


def limits(field: Field) -> Iterator[str]:
    """Yield the conditions on a field that its C type does not hold already."""
    for index in range(field.elements or 0):
        value = f"message->{field.name}" + ("" if field.elements == 1 else f"[{index}]")
        checks = []
        if field.low is not None and not (field.low == 0 and field.c_type in _TOP):
            checks.append(f"{value} >= {literal(field.low, field)}")
        if field.high is not None and field.high != _TOP.get(field.c_type):
            checks.append(f"{value} <= {literal(field.high, field)}")
        if checks:
            inside = " && ".join(checks)
            none = "" if field.none is None else f" || {value} == {literal(field.none, field)}"
            yield f"({inside}{none})" if none else inside


def literal(value: float, field: Field) -> str:
    """Return a value in the C type of a field."""
    if field.c_type == "float":
        return {MAX_F32: "TL_F32_MAX", -MAX_F32: "-TL_F32_MAX"}.get(value, f"{value:.1f}f")
    if field.c_type.startswith("u"):
        return f"{value:d}u" if isinstance(value, int) else f"{int(value)}u"
    # The least value of a type has no literal of its own in C.
    return f"({int(value) + 1} - 1)"
