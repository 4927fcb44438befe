"""Numbers rounded to their standard error, never NaN."""

import math
from typing import Final, NamedTuple

MISSING: Final = "—"
"""Shown for an unknown value."""

_SIGNIFICANT_DIGITS: Final = 6  # at most; keeps columns narrow
_DIGITS_WITHOUT_ERROR: Final = 4
# Values beyond these are no measurements, and powers of ten would overflow.
_TINY: Final = 1e-30
_HUGE: Final = 1e30


class Rounded(NamedTuple):
    """A value and its standard error as text, with a common power of ten.

    Attributes:
        value: digits of the value, or MISSING.
        error: digits of the error, empty when it is not known.
        exponent: power of ten that multiplies both; 0 when there is none.
    """

    value: str
    error: str
    exponent: int

    @property
    def power(self) -> str:
        """The power of ten as written behind the digits, e.g. `e-3`; empty when there is none."""
        return f"e{self.exponent}" if self.exponent else ""

    def joined(self, sign: str = " ± ") -> str:
        """Return `0.1953 ± 0.0012`, `(3.083 ± 0.012)e-3`, `65.03` or MISSING."""
        if not self.error:
            return self.value + self.power
        text = f"{self.value}{sign}{self.error}"
        return f"({text}){self.power}" if self.exponent else text


UNKNOWN: Final = Rounded(MISSING, "", 0)


def _decade(value: float) -> int:
    """Return the power of ten of a positive value after rounding to two digits: 0.0996 counts as 0.10."""
    decade = math.floor(math.log10(value))
    return decade + 1 if value >= 9.95 * 10.0**decade else decade


def round_to_error(value: float, std: float = math.nan) -> Rounded:
    """Round a value to two significant digits of its standard error.

    Without a usable error (NaN, infinite, not positive) four significant digits are given. Values below 0.01 and from
    1e6 on get a power of ten in steps of three; what is not finite is UNKNOWN. At most six significant digits are
    shown; an error smaller than the last of them is rounded up to it, never down to zero.
    """
    if not abs(value) < _HUGE:
        return UNKNOWN
    has_error = _TINY < std < _HUGE
    if abs(value) < _TINY:
        value = 0.0
    size = max(abs(value), std) if has_error else abs(value)
    exponent = 0
    if size and not 1e-2 <= size < 1e6:
        exponent = 3 * (_decade(size) // 3)
        value, std, size = value / 10.0**exponent, std / 10.0**exponent, size / 10.0**exponent
    finest = _SIGNIFICANT_DIGITS - 1 - _decade(size) if size else _SIGNIFICANT_DIGITS
    if not has_error:
        digits = min(_DIGITS_WITHOUT_ERROR - 1 - _decade(size), finest) if size else 0
        return Rounded(f"{round(value, digits) + 0.0:.{max(digits, 0)}f}", "", exponent)
    digits = 1 - _decade(std)
    if digits > finest:
        digits = finest
        std = max(std, 10.0**-digits)
    decimals = max(digits, 0)
    # Adding 0.0 turns a rounded -0.0 into 0.0.
    return Rounded(f"{round(value, digits) + 0.0:.{decimals}f}", f"{round(std, digits):.{decimals}f}", exponent)
