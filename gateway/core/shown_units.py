"""Units in which screens show speed, pressure, temperature and force; files, tables and messages keep theirs."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from enum import StrEnum
from typing import Final, NamedTuple


class ShownUnits(StrEnum):
    """Units of the screens of a session."""

    SI = "si"  # km/h, kPa, °C, N
    BAR = "bar"  # km/h, bar, °C, N
    US = "us"  # mph, psi, °F, lbf


class Conversion(NamedTuple):
    """From the usual unit of a screen to the one that is shown.

    Attributes:
        symbol: of the shown unit.
        factor: shown value over usual value.
        offset: added to it.
        decimals: that a number has more, so that its last digit means as much.
    """

    symbol: str
    factor: float = 1.0
    offset: float = 0.0
    decimals: int = 0


_CONVERSIONS: Final[dict[ShownUnits, dict[str, Conversion]]] = {
    ShownUnits.SI: {},
    ShownUnits.BAR: {"kPa": Conversion("bar", 0.01, decimals=2)},
    ShownUnits.US: {
        "km/h": Conversion("mph", 1.0 / 1.609344),
        "kPa": Conversion("psi", 1.0 / 6.894757293168361, decimals=1),
        "°C": Conversion("°F", 1.8, 32.0),
        "degC": Conversion("degF", 1.8, 32.0),
        "N": Conversion("lbf", 1.0 / 4.4482216152605),
    },
}
_UNITS: Final[ContextVar[ShownUnits]] = ContextVar("shown units", default=ShownUnits.SI)


@contextmanager
def shown_in(units: ShownUnits) -> Iterator[None]:
    """Show numbers and reasons in these units, within this block and this thread."""
    token = _UNITS.set(units)
    try:
        yield
    finally:
        _UNITS.reset(token)


def shown_units() -> ShownUnits:
    """Return the units in which numbers are shown now: SI outside `shown_in`."""
    return _UNITS.get()


def conversion(symbol: str, units: ShownUnits) -> Conversion:
    """Return how a usual unit is shown, also one a month."""
    unit, per, _ = symbol.partition("/month")
    scaling = _CONVERSIONS[units].get(unit) or Conversion(unit)
    return Conversion(f"{scaling.symbol}{per}", scaling.factor, decimals=scaling.decimals) if per else scaling
