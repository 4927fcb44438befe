"""Range checks of encoded values. Errors name the field."""

from enum import IntEnum
from typing import Final, NoReturn

MAX_F32: Final = (2 - 2**-23) * 2.0**127
"""Greatest 32-bit float."""


_ROUNDS_TO_ZERO: Final = 2.0**-150
"""Greatest magnitude that becomes 0 as a 32-bit float."""


def is_zero_f32(value: float) -> bool:
    """Return whether a value is 0 as a 32-bit float."""
    return abs(value) <= _ROUNDS_TO_ZERO


def reject(name: str, value: object, allowed: str) -> NoReturn:
    """Raise the error that names a field, its value and what is allowed."""
    raise ValueError(f"{name} is {value}; allowed: {allowed}")


def integer(name: str, value: int, low: float, high: float) -> int:
    """Return `value`, a whole number in range; raise ValueError otherwise."""
    if not low <= value <= high or value != int(value):
        reject(name, value, f"whole numbers {low} to {high}")
    return int(value)


def real(name: str, value: float, low: float, high: float) -> float:
    """Return `value` if it is in range and a 32-bit float can hold it."""
    if not (low <= value <= high and abs(value) <= MAX_F32):
        reject(name, value, f"{low:g} to {high:g}")
    return value


def fixed(name: str, value: float | None, per_unit: int, low: float, high: float) -> int:
    """Return `value` as a fixed-point number of `per_unit` steps a unit."""
    if value is None or not low - 0.5 <= value * per_unit <= high + 0.5:
        reject(name, value, f"{low / per_unit:g} to {high / per_unit:g}")
    return int(min(max(round(value * per_unit), low), high))


class PayloadError(ValueError):
    """Payload that breaks the layout of its type.

    Attributes:
        field: with a value out of its range, empty where the length is wrong.
        layout_bytes: length that the payload must have, None where it has it or may have several.
    """

    def __init__(self, type_: IntEnum, cause: str, field: str = "", layout_bytes: int | None = None) -> None:
        super().__init__(f"{type_.name} payload has {cause}")
        self.field, self.layout_bytes = field, layout_bytes


def require_length(type_: IntEnum, payload: bytes, length: int) -> None:
    """Raise PayloadError when the length of a payload differs from its layout."""
    if len(payload) != length:
        raise PayloadError(type_, f"{len(payload)} bytes, its layout {length}", layout_bytes=length)
