"""Range checks of encoded values. Errors name the field."""

import math
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


def integer(name: str, value: int, low: int, high: int) -> int:
    """Return `value`, a whole number in range; raise ValueError otherwise."""
    if not low <= value <= high or value != int(value):
        reject(name, value, f"whole numbers {low} to {high}")
    return int(value)


def real(name: str, value: float, low: float, high: float) -> float:
    """Return `value` if it is in range and a 32-bit float can hold it."""
    if not (low <= value <= high and abs(value) <= MAX_F32):
        reject(name, value, f"{low:g} to {high:g}")
    return value


def triple(name: str, values: tuple[float, float, float], low: float) -> tuple[float, float, float]:
    """Return three values, one per axis, if each is at least `low` and a 32-bit float can hold it."""
    if len(values) != 3:
        reject(name, values, "three values, one per axis")
    first, second, third = (real(name, value, low, math.inf) for value in values)
    return first, second, third


def fixed(name: str, value: float | None, per_unit: int, low: int, high: int, none: int | None = None) -> int:
    """Return `value` as a fixed-point number of `per_unit` steps a unit, or the sentinel for None."""
    if value is None and none is not None:
        return none
    if value is None or not low - 0.5 <= value * per_unit <= high + 0.5:
        reject(name, value, f"{low / per_unit:g} to {high / per_unit:g}")
    return min(max(round(value * per_unit), low), high)


def require_length(what: str, payload: bytes, length: int) -> None:
    """Raise ValueError when the length of a payload differs from its layout."""
    if len(payload) != length:
        raise ValueError(f"{what} payload has {len(payload)} bytes, its layout {length}")
