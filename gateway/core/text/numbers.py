"""Numbers as an engineer writes them: rounded to their standard error, in field units, never NaN."""

import math
from collections.abc import Collection
from functools import lru_cache
from typing import Final, NamedTuple

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.reasons import Reason
from gateway.core.shown_units import ShownUnits, conversion, shown_units
from gateway.core.text.rounding import MISSING as MISSING
from gateway.core.text.rounding import UNKNOWN, Rounded
from gateway.core.text.rounding import round_to_error as round_to_error
from gateway.core.text.wording import joined

STATUS_MARKS: Final[dict[Status, str]] = {Status.VALID: "", Status.PROVISIONAL: "~", Status.INVALID: "x"}
"""Mark behind a number, by status."""


class Unit(NamedTuple):
    """Unit of display: symbol, and factor from the unit in a quantity's name, to which the offset is added."""

    symbol: str
    factor: float = 1.0
    offset: float = 0.0
    decimals: int = 0

    def of(self, value: float) -> float:
        """Return a value of the quantity in this unit; an error or a difference takes the factor alone."""
        return value * self.factor + self.offset


# Suffix of a quantity's name -> shown unit. Longer suffixes first: `_mps2` must not be read as `_mps`.
UNITS: Final[dict[str, Unit]] = {
    "_per_degc": Unit("1/K"),
    "_radps2": Unit("rad/s²"),
    "_radps": Unit("rad/s"),
    "_rpm": Unit("rpm"),
    "_mps2": Unit("m/s²"),
    "_mps": Unit("km/h", 3.6),
    "_kmh": Unit("km/h"),
    "_m3": Unit("m³"),
    "_rad": Unit("deg", 180.0 / math.pi),
    "_degc": Unit("°C"),
    "_deg": Unit("deg"),
    "_kpa": Unit("kPa"),
    "_pa": Unit("kPa", 1e-3),
    "_percent": Unit("%"),
    "_mm": Unit("mm"),
    "_hz": Unit("Hz"),
    "_npm": Unit("N/m"),
    "_nm": Unit("N m"),
    "_n": Unit("N"),
    "_m": Unit("mm", 1e3),
    "_s": Unit("s"),
    "_w": Unit("W"),
    "_v": Unit("V"),
}
_DIMENSIONLESS: Final = Unit("")


RENAMED: Final = "estimated_"
"""Prefix of an estimate whose name another field of its row has."""


def distinct_name(name: str, taken: Collection[str]) -> str:
    """Return the name of an estimate in a row that has other fields: `estimated_NAME` where NAME is taken.

    A later estimator may estimate what is also a condition, such as the load. The condition keeps the plain name.
    """
    return RENAMED + name if name in taken else name


def split_name(name: str) -> tuple[str, Unit]:
    """Split a quantity's name into a label and the unit it is shown in: `leading_edge_rad` -> `leading edge`, deg."""
    return _split_name(name, shown_units())


@lru_cache(maxsize=512)
def _split_name(name: str, units: ShownUnits) -> tuple[str, Unit]:
    declared, prefix = quantity_of(name), name.rpartition(":")[0]
    suffix = next((suffix for suffix in UNITS if name.endswith(suffix) and len(name) > len(suffix)), "")
    label = name.removesuffix(suffix).replace("_", " ") if suffix else name.replace("_over_", "/").replace("_", " ")
    if declared.label:
        label = f"{prefix}:{declared.label}" if prefix else declared.label
    unit = UNITS[suffix] if suffix else _DIMENSIONLESS
    if declared.shown_unit is not None:
        unit = Unit(*declared.shown_unit)
    symbol, factor, offset, decimals = conversion(unit.symbol, units)
    return label, Unit(symbol, unit.factor * factor, offset, decimals)


def plain_name(name: str) -> str:
    """Return a quantity's name for people who know tires: `Bs` -> `bending stiffness number (Bs)`, else its label."""
    prefix, plain = name.rpartition(":")[0], quantity_of(name).plain
    return (f"{prefix}: {plain}" if prefix else plain) if plain else split_name(name)[0]


class Shown(NamedTuple):
    """An estimate ready for the screen.

    Attributes:
        label: name of the quantity.
        number: value and error in the shown unit; UNKNOWN when the estimate is invalid.
        unit: symbol, empty when dimensionless.
        value: the value in that unit, not rounded; NaN when the estimate is invalid.
        status: as estimated.
        reasons: as estimated.
        plain: name for people who know tires.
    """

    label: str
    number: Rounded
    unit: str
    value: float
    status: Status
    reasons: tuple[Reason, ...]
    plain: str = ""

    @property
    def mark(self) -> str:
        """Status mark, empty when valid."""
        return STATUS_MARKS[self.status]

    @property
    def reason(self) -> str:
        """The reasons as one text."""
        return joined(self.reasons)

    def text(self, sign: str = " ± ") -> str:
        """Return number, unit and mark, e.g. `65.03 ± 0.02 km/h ~`."""
        text = self.number.joined(sign)
        if self.unit:
            text += " " + self.unit
        return f"{text} {self.mark}" if self.mark else text


def show(estimate: Estimate) -> Shown:
    """Convert an estimate to its shown unit and round it; an invalid one shows MISSING whatever its value."""
    label, unit = split_name(estimate.name)
    plain = plain_name(estimate.name)
    if estimate.status is Status.INVALID:
        return Shown(label, UNKNOWN, unit.symbol, math.nan, estimate.status, estimate.reasons, plain)
    value = unit.of(estimate.value)
    number = round_to_error(value, estimate.std * unit.factor)
    return Shown(label, number, unit.symbol, value, estimate.status, estimate.reasons, plain)


def finite_or_none(value: float) -> float | None:
    """Return a number as JSON and empty cells take it: None where it is not finite."""
    return float(value) if math.isfinite(value) else None


def fixed(value: float | None, decimals: int, factor: float = 1.0) -> str:
    """Return a plain number with fixed decimals, or MISSING for None and values that are not finite."""
    if value is None or not math.isfinite(value):
        return MISSING
    return f"{round(value * factor, decimals) + 0.0:.{decimals}f}"


def shown_value(name: str, value: float | None, decimals: int) -> str:
    """Return a value in the unit in which a quantity is shown, without it: 210000.0 of `pressure_pa` as `210.0`."""
    unit = split_name(name)[1]
    return fixed(None if value is None else unit.of(value), decimals + unit.decimals)


def unit_symbol(name: str) -> str:
    """Return the unit in which a quantity is shown."""
    return split_name(name)[1].symbol


def duration(seconds: float) -> str:
    """Return `h:mm:ss`."""
    if not math.isfinite(seconds):
        return MISSING
    total_s = max(int(seconds), 0)
    return f"{total_s // 3600}:{total_s // 60 % 60:02d}:{total_s % 60:02d}"


def age(seconds: float) -> str:
    """Return a time that has passed as whole seconds, from two minutes on as `h:mm:ss`."""
    return f"{seconds:.0f} s" if seconds < 120.0 else duration(seconds)


def percent(part: int, whole: int) -> str:
    """Return a share as `1.02 %`; `0 %` when nothing is missing and `<0.01 %` rather than a rounded zero."""
    if whole <= 0 or part <= 0:
        return "0 %"
    share = 100.0 * part / whole
    return "<0.01 %" if share < 0.01 else f"{share:.2f} %" if share < 9.995 else f"{share:.1f} %"
