"""What the views of a diagnosis share: its numbers as text, in field units, and its words."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.closure.diagnosis import Curves, Diagnosis, Fitted, FloatArray, Unexplained, Verdict
from gateway.views.numbers import MISSING, UNITS, Unit, round_to_error, split_name
from gateway.views.text import clean

AXES: Final = ("circumferential", "lateral", "radial")

MODELS: Final = {
    "paper": "the ring paper's series as printed",
    "series": "the corrected linear series",
    "exact": "the exact ring",
}
VERDICTS: Final = {
    Verdict.NAMED: "named",
    Verdict.INDISTINGUISHABLE: "cannot be told apart",
    Verdict.REFUSED: "refused",
}

# Units of the names' suffixes, spelled out, of those that are shown in another unit.
_SI: Final = {"_rad": "rad", "_m": "m", "_mps": "m/s", "_pa": "Pa"}
# Suffixes of names whose unit always stands beside the number.
_COMPOUND: Final = ("_npm2", "_per_rad", "_per_k", "_s2pm", "_rad2", "_kgm", "_m2", "_pm", "_pn")
_PRINTED: Final = {"^2": "²", "^3": "³", "omega": "ω", "degC": "°C"}


class ShownNumber(NamedTuple):
    """A fitted number ready to be read; `value` and `std` are in the shown unit, not rounded."""

    label: str
    text: str
    unit: str
    value: float
    std: float

    def joined(self) -> str:
        """Return number and unit."""
        return f"{self.text} {self.unit}".rstrip() if self.text != MISSING else MISSING


def show_fitted(name: str, fitted: Fitted | None) -> ShownNumber:
    """Return a number in the unit that views show it in; what has a display unit already keeps it."""
    label, shown = _label(name)
    if fitted is None:
        return ShownNumber(label, MISSING, shown.symbol, math.nan, math.nan)
    suffix = next((suffix for suffix in UNITS if name.endswith(suffix) and len(name) > len(suffix)), "")
    factor, unit = fitted.factor, fitted.display_unit or fitted.unit
    if not fitted.display_unit and fitted.unit in ("", _SI.get(suffix)):
        factor, unit = shown.factor, shown.symbol
    value, std = float(fitted.value) * factor, float(fitted.std) * factor
    return ShownNumber(label, round_to_error(value, std).joined(), _written(unit), value, std)


def _label(name: str) -> tuple[str, Unit]:
    """Return what a name says without its unit, and the unit where views have one for it."""
    if name.endswith("_ln") and len(name) > 3:
        return f"ln {clean(name[:-3].replace('_', ' '))}", Unit("")
    suffix = next((suffix for suffix in _COMPOUND if name.endswith(suffix) and len(name) > len(suffix)), "")
    label, unit = (name[: -len(suffix)].replace("_", " "), Unit("")) if suffix else split_name(name)
    return clean(label), unit


def _written(unit: str) -> str:
    """Return a unit as it is printed: `N/m^2` -> `N/m²`."""
    for plain_text, printed in _PRINTED.items():
        unit = unit.replace(plain_text, printed)
    return clean(unit)


def plain(value: float, std: float = math.nan) -> str:
    """Return a number rounded to its error."""
    return round_to_error(float(value), float(std)).joined()


def significant(value: float, digits: int = 3) -> str:
    """Return a number whose error nobody states, with three significant digits but all of those before its point."""
    if not math.isfinite(value):
        return MISSING
    decade = math.floor(math.log10(abs(value))) if value else 0
    if not -4 < decade < 9:
        return f"{value:.{digits - 1}e}"
    return f"{value:.{max(digits - 1 - decade, 0)}f}"


def ratio(part: float, whole: float) -> float:
    """Return a quotient, NaN where it means nothing."""
    return part / whole if math.isfinite(part) and math.isfinite(whole) and whole > 0.0 else math.nan


def model_words(model: str) -> str:
    """Return what a starting model is."""
    return MODELS.get(model, clean(model))


def orders_text(orders: tuple[int, int] | None) -> str:
    """Return `24 to 26`, `12`, or MISSING."""
    if orders is None:
        return MISSING
    return f"{orders[0]}" if orders[0] == orders[1] else f"{orders[0]} to {orders[1]}"


def span_text(span: tuple[float, float] | None, factor: float = 1.0) -> str:
    """Return a range rounded to what its width deserves, or MISSING."""
    if span is None or not all(map(math.isfinite, span)):
        return MISSING
    low, high = span[0] * factor, span[1] * factor
    if low == high:
        return plain(low)
    size = max(abs(low), abs(high))
    decimals = min(max(1 - math.floor(math.log10(max(high - low, 1e-3 * size, 1e-9))), 0), 6)
    return f"{round(low, decimals) + 0.0:.{decimals}f} to {round(high, decimals) + 0.0:.{decimals}f}"


def place_text(left: Unexplained) -> str:
    """Return where something unexplained sits, in one phrase: Hz of what is locked to time, else orders and angle."""
    if left.lock == "time" and left.hz is not None:
        return f"{span_text(left.hz)} Hz"
    parts = []
    if left.orders is not None:
        parts.append(("order " if left.orders[0] == left.orders[1] else "orders ") + orders_text(left.orders))
    elif left.hz is not None:
        parts.append(f"{span_text(left.hz)} Hz")
    if left.angle_rad is not None:
        parts.append(f"{span_text(left.angle_rad, 180.0 / math.pi)} deg")
    return ", ".join(parts) or "spread out"


class AxisResidual(NamedTuple):
    """What is left of one axis of one group, rms, and the noise of its mean beside it."""

    axis: str
    before_mps2: float
    after_mps2: float
    noise_mps2: float


def present(curves: Curves) -> list[int]:
    """Return the axes that were recorded."""
    return [axis for axis in range(3) if bool(np.isfinite(curves.measured_mps2[axis]).any())]


def residuals(curves: Curves) -> list[AxisResidual]:
    """Return the residual of the mean waveform of every recorded axis; noise and all."""
    return [
        AxisResidual(
            AXES[axis],
            _rms(curves.measured_mps2[axis] - curves.before_mps2[axis]),
            _rms(curves.measured_mps2[axis] - curves.after_mps2[axis]),
            float(curves.noise_mps2[axis]),
        )
        for axis in present(curves)
    ]


def reference_group(curves: Sequence[Curves]) -> int:
    """Return the group whose residual before stands highest above its noise: the one that shows most."""
    return max(range(len(curves)), key=lambda index: (_conspicuous(curves[index]), -index))


def _conspicuous(curves: Curves) -> float:
    shares = [ratio(axis.before_mps2, axis.noise_mps2) for axis in residuals(curves)]
    return max((share for share in shares if math.isfinite(share)), default=0.0)


def _rms(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(known**2))) if known.size else math.nan


def undetermined(diagnosis: Diagnosis) -> list[str]:
    """Return the estimates that the data do not determine."""
    return [name for name, known in diagnosis.determined.items() if not known]
