"""Numbers of a diagnosis as they are shown: fitted numbers with label, unit and rounding, and residuals of groups."""

import math
import re
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.text.numbers import MISSING, UNITS, Unit, round_to_error, shown_value, split_name, unit_symbol
from gateway.core.text.text import clean
from gateway.core.types import FloatArray
from gateway.diagnosis.result import Curves, Fitted, TireState

# Suffixes of names whose unit is another one in tables, and their unit in SI.
_SI: Final = {"_rad": "rad", "_m": "m", "_mps": "m/s", "_pa": "Pa"}
# Suffixes of compound units, which have a column of their own in tables.
_COMPOUND: Final = (
    "_npm2",
    "_m4ps2",
    "_m2ps2",
    "_m4ps",
    "_ps",
    "_per_rad",
    "_per_k",
    "_s2pm",
    "_s4pm2",
    "_s2",
    "_rad2",
    "_kgm",
    "_m2",
    "_pm",
    "_pn",
)
_TYPOGRAPHY: Final = {"degC": "°C", "+-": "±", " * ": " · "}
# Not the first digit of an exponent such as 2.4 or 20.
_POWER: Final = re.compile(r"\^([23])(?!\d|\.\d)")
_SUPERSCRIPT: Final = {"2": "²", "3": "³"}
_GREEK: Final = {
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "kappa": "κ",
    "omega": "ω",
    "phi": "φ",
    "pi": "π",
    "psi": "ψ",
    "rho": "ρ",
    "theta": "θ",
}
_GREEK_WORD: Final = re.compile(rf"(?<![A-Za-z])(d?)({'|'.join(_GREEK)})(?![a-z])")
# "Before" and "after" a correction are the model; in names of parameters they are sides of the contact.
_SIDES: Final = {"before ": "before contact: ", "after ": "after contact: ", "ahead ": "lone packet: "}
# Standard errors from 0 below which the inverse of a number says nothing.
_INVERTIBLE_STDS: Final = 2.0
_INVERSE: Final = "inverse "
# Labels that say more than the name of the parameter.
_LABELS: Final = {"leading": "leading edge", "trailing": "trailing edge", "roll off": "roll-off"}


class ShownNumber(NamedTuple):
    """A fitted number as it is shown; `value` and `std` are in the shown unit, not rounded."""

    label: str
    text: str
    unit: str
    value: float
    std: float

    def joined(self) -> str:
        """Return number and unit."""
        return f"{self.text} {self.unit}".rstrip() if self.text != MISSING else MISSING


def show_fitted(name: str, fitted: Fitted | None, *, state: bool = True) -> ShownNumber:
    """Return a number in its shown unit; a number with a display unit keeps that.

    Args:
        name: of the parameter, or the key of the estimate.
        fitted: the number; None where it is not known.
        state: whether the label names the load and pressure of an estimate.
    """
    quantity = (fitted.quantity if fitted is not None else "") or name
    label, shown_unit = _label(quantity)
    if state and fitted is not None and fitted.state is not None:
        label = f"{label} ({state_text(fitted.state)})"
    if fitted is None:
        return ShownNumber(label, MISSING, shown_unit.symbol, math.nan, math.nan)
    if fitted.inverse_display is not None and fitted.value > _INVERTIBLE_STDS * fitted.std:
        factor, unit, power = fitted.inverse_display
        value = factor * float(fitted.value) ** (-1.0 / power)
        std = value * float(fitted.std) / float(fitted.value) / power
        label = label.removeprefix(_INVERSE)
        return ShownNumber(label, round_to_error(value, std).joined(), in_print(unit), value, std)
    if fitted.std == 0.0 and fitted.factor == 1.0 and float(fitted.value).is_integer():
        unit = in_print(fitted.display_unit or fitted.unit)
        return ShownNumber(label, f"{fitted.value:.0f}", unit, fitted.value, 0.0)
    suffix = next((suffix for suffix in UNITS if quantity.endswith(suffix) and len(quantity) > len(suffix)), "")
    factor, unit = fitted.factor, fitted.display_unit or fitted.unit
    if not fitted.display_unit and fitted.unit in ("", _SI.get(suffix)):
        factor, unit = shown_unit.factor, shown_unit.symbol
    value, std = float(fitted.value) * factor, float(fitted.std) * factor
    return ShownNumber(label, round_to_error(value, std).joined(), in_print(unit), value, std)


def parameter_label(name: str) -> str:
    """Return the label of a parameter."""
    return _label(name)[0]


def state_text(state: TireState | None) -> str:
    """Return load, pressure and contact; empty for None, the state of the most revolutions."""
    if state is None:
        return ""
    return ", ".join(
        f"{shown_value(name, value, 0)} {unit_symbol(name)}"
        for name, value in (("load_n", state.load_n), ("pressure_pa", state.pressure_pa))
    ) + (f", contact {state.number}" if state.number else "")


def _label(name: str) -> tuple[str, Unit]:
    """Return the label of a name without its unit, and the shown unit where there is one for it."""
    if name.endswith("_ln") and len(name) > 3:
        return f"ln {clean(name[:-3].replace('_', ' '))}", Unit("")
    suffix = next((suffix for suffix in _COMPOUND if name.endswith(suffix) and len(name) > len(suffix)), "")
    label, unit = (name[: -len(suffix)].replace("_", " "), Unit("")) if suffix else split_name(name)
    for side, written in _SIDES.items():
        if label.startswith(side):
            label = written + label.removeprefix(side)
    return _LABELS.get(label) or clean(label), unit


def in_print(text: str) -> str:
    """Return a text or unit in print: `N/m^2` -> `N/m²`."""
    text = _POWER.sub(lambda match: _SUPERSCRIPT[match[1]], text)
    for typed, written in _TYPOGRAPHY.items():
        text = text.replace(typed, written)
    return clean(text)


def typeset(text: str) -> str:
    """Return an equation, or a text with parts of one, in print: `omega^2` -> `ω²`; `psi` is no unit."""
    return _GREEK_WORD.sub(lambda match: match[1] + _GREEK[match[2]], in_print(text))


def plain(value: float, std: float = math.nan) -> str:
    """Return a number rounded to its error."""
    return round_to_error(float(value), float(std)).joined()


def significant(value: float) -> str:
    """Return a number without a standard error with three significant digits, and all digits before its point."""
    if not math.isfinite(value):
        return MISSING
    decade = math.floor(math.log10(abs(value))) if value else 0
    if not -4 < decade < 9:
        return f"{value:.2e}"
    return f"{value:.{max(2 - decade, 0)}f}"


def ratio(part: float, whole: float) -> float:
    """Return a quotient, NaN where it is not defined."""
    return part / whole if math.isfinite(part) and math.isfinite(whole) and whole > 0.0 else math.nan


def orders_text(orders: tuple[int, int] | None) -> str:
    """Return `24 to 26`, `12`, or MISSING."""
    if orders is None:
        return MISSING
    return f"{orders[0]}" if orders[0] == orders[1] else f"{orders[0]} to {orders[1]}"


def span_text(span: tuple[float, float] | None, factor: float = 1.0) -> str:
    """Return a range rounded according to its width, or MISSING."""
    if span is None or not all(map(math.isfinite, span)):
        return MISSING
    low, high = span[0] * factor, span[1] * factor
    if low == high:
        return plain(low)
    size = max(abs(low), abs(high))
    decimals = min(max(1 - math.floor(math.log10(max(high - low, 1e-3 * size, 1e-9))), 0), 6)
    return f"{round(low, decimals) + 0.0:.{decimals}f} to {round(high, decimals) + 0.0:.{decimals}f}"


class AxisResidual(NamedTuple):
    """The rms residual of one axis of one group, and the noise of its mean."""

    axis: str
    before_mps2: float
    after_mps2: float
    noise_mps2: float


def recorded_axes(curves: Curves) -> list[int]:
    """Return the axes that were recorded."""
    return [axis for axis in range(3) if bool(np.isfinite(curves.measured_mps2[axis]).any())]


def residuals(curves: Curves) -> list[AxisResidual]:
    """Return the residual of the mean waveform of every recorded axis, noise included."""
    return [
        AxisResidual(
            AXIS_NAMES[axis],
            _rms(curves.measured_mps2[axis] - curves.before_mps2[axis]),
            _rms(curves.measured_mps2[axis] - curves.after_mps2[axis]),
            float(curves.noise_mps2[axis]),
        )
        for axis in recorded_axes(curves)
    ]


def reference_group(curves: Sequence[Curves]) -> int:
    """Return the group whose residual before is largest relative to its noise."""
    return max(range(len(curves)), key=lambda index: (_over_noise(curves[index]), -index))


def _over_noise(curves: Curves) -> float:
    shares = [ratio(axis.before_mps2, axis.noise_mps2) for axis in residuals(curves)]
    return max((share for share in shares if math.isfinite(share)), default=0.0)


def _rms(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(finite**2))) if finite.size else math.nan
