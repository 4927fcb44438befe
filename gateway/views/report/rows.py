"""What the views of a diagnosis share: its numbers as text, in field units, and its words."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.closure.diagnosis import Curves, Diagnosis, Finding, Fitted, Unexplained, Verdict
from gateway.closure.observation import Remark
from gateway.constants import AXIS_NAMES
from gateway.reasons import Reason
from gateway.types import FloatArray
from gateway.views.numbers import MISSING, UNITS, Unit, round_to_error, split_name
from gateway.views.text import clean
from gateway.views.wording import text as reason_text

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

GROWN: Final = 1.02
"""A held-out error that is this many times the one before has grown."""

CHANGES: Final = "changes during the recording"

# Units of the names' suffixes, spelled out, of those that are shown in another unit.
_SI: Final = {"_rad": "rad", "_m": "m", "_mps": "m/s", "_pa": "Pa"}
# Suffixes of names whose unit always stands beside the number.
_COMPOUND: Final = ("_npm2", "_per_rad", "_per_k", "_s2pm", "_s4pm2", "_rad2", "_kgm", "_m2", "_pm", "_pn")
_PRINTED: Final = {"^2": "²", "^3": "³", "degC": "°C", "+-": "±", " * ": " · "}
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
# An estimate of another load or pressure than that of most revolutions: `Bs (3500 N, 210 kPa)`.
_STATE: Final = re.compile(r"(.+) \((\S+ N, \S+ kPa)\)")
# "Before" and "after" are the starting model and what was found; parameters mean sides of the contact.
_SIDES: Final = {"before ": "before contact: ", "after ": "after contact: ", "ahead ": "lone packet: "}
# A number that is not told from 0 has no inverse worth showing.
_TOLD_STDS: Final = 2.0
_INVERSE: Final = "inverse "
# Labels that say more than the name of the parameter.
_LABELS: Final = {"leading": "leading edge", "trailing": "trailing edge", "roll off": "roll-off"}


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
    name, state = split_state(name)
    label, shown = _label(name)
    label = f"{label} ({state})" if state else label
    if fitted is None:
        return ShownNumber(label, MISSING, shown.symbol, math.nan, math.nan)
    if fitted.inverse_display is not None and fitted.value > _TOLD_STDS * fitted.std:
        factor, unit = fitted.inverse_display
        value = factor / float(fitted.value)
        std = value * float(fitted.std) / float(fitted.value)
        label = label.removeprefix(_INVERSE)
        return ShownNumber(label, round_to_error(value, std).joined(), printed(unit), value, std)
    suffix = next((suffix for suffix in UNITS if name.endswith(suffix) and len(name) > len(suffix)), "")
    factor, unit = fitted.factor, fitted.display_unit or fitted.unit
    if not fitted.display_unit and fitted.unit in ("", _SI.get(suffix)):
        factor, unit = shown.factor, shown.symbol
    value, std = float(fitted.value) * factor, float(fitted.std) * factor
    return ShownNumber(label, round_to_error(value, std).joined(), printed(unit), value, std)


def split_state(name: str) -> tuple[str, str]:
    """Split an estimate's name into its own and the load and pressure that it belongs to, empty where most data are."""
    match = _STATE.fullmatch(name)
    return (match[1], clean(match[2])) if match else (name, "")


def _label(name: str) -> tuple[str, Unit]:
    """Return what a name says without its unit, and the unit where views have one for it."""
    if name.endswith("_ln") and len(name) > 3:
        return f"ln {clean(name[:-3].replace('_', ' '))}", Unit("")
    suffix = next((suffix for suffix in _COMPOUND if name.endswith(suffix) and len(name) > len(suffix)), "")
    label, unit = (name[: -len(suffix)].replace("_", " "), Unit("")) if suffix else split_name(name)
    for side, written in _SIDES.items():
        if label.startswith(side):
            label = written + label.removeprefix(side)
    return _LABELS.get(label) or clean(label), unit


def remark_words(remark: Remark) -> str:
    """Return a remark as it is printed."""
    return printed(reason_text(remark) if isinstance(remark, Reason) else remark)


def printed(text: str) -> str:
    """Return a text or unit as it is printed: `N/m^2` -> `N/m²`, `omega` -> `ω`."""
    for typed, written in _PRINTED.items():
        text = text.replace(typed, written)
    return clean(_GREEK_WORD.sub(lambda match: match[1] + _GREEK[match[2]], text))


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


def remark_text(left: Unexplained) -> str:
    """Return what an entry's sentence says beyond its figures: of what is steady and locked to the wheel, nothing."""
    if left.changes:
        return f"{CHANGES}: load, slip angle, camber or temperature may; record one state at a time"
    if left.lock == "angle":
        return ""
    if left.lock != "time":
        return printed(left.text)
    parts = []
    if not left.lock_known:
        parts.append("at the wheel's orders: locked to time, or to the wheel but not alike in every revolution")
    elif left.orders is not None:
        parts.append("moves with speed, but not in step with the wheel")
    elif seen := re.search(r" at (every speed|\d+ of \d+ speeds)", left.text):
        parts.append(f"the same Hz at {seen[1]}")
    if also := re.search(r"\(and ([^()]+)\)", left.text):
        parts.append(f"also {printed(also[1])}")
    return "; ".join(parts)


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
            AXIS_NAMES[axis],
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


def added(diagnosis: Diagnosis) -> list[Finding]:
    """Return the effects in the model after, in the order in which they were added where that can be seen."""
    left = [finding for finding in diagnosis.findings if finding.verdict is not Verdict.REFUSED and finding.estimates]
    found: list[Finding] = []
    at = diagnosis.estimates_before
    while left:
        # What it started from is what the one before it led to, but for noise that was weighted anew.
        here = min(left, key=lambda one: _distance(at, {name: old for name, (old, _) in one.estimates.items()}))
        left.remove(here)
        found.append(here)
        at = {name: new for name, (_, new) in here.estimates.items()}
    return found


def _distance(one: Mapping[str, Fitted], other: Mapping[str, Fitted]) -> float:
    """Return by how much estimates differ, as shares of themselves."""
    pairs = [(one[name].value, other[name].value) for name in one if name in other]
    return sum(min(abs(a - b) / max(abs(a), 1e-300), 1e3) for a, b in pairs if math.isfinite(a) and math.isfinite(b))


def undecided_sets(diagnosis: Diagnosis) -> list[Finding]:
    """Return one finding of each set of effects that cannot be told apart: every rival may be a finding too."""
    sets: dict[frozenset[str], Finding] = {}
    for finding in diagnosis.findings:
        if finding.verdict is Verdict.INDISTINGUISHABLE:
            sets.setdefault(frozenset({finding.name, *finding.rivals}), finding)
    return list(sets.values())


def listed(names: Sequence[str], last: str = "and") -> str:
    """Return `a`, `a and b`, or `a, b and c`."""
    return clean(f" {last} ".join(filter(None, (", ".join(names[:-1]), names[-1]))))


def nothing_left(diagnosis: Diagnosis, nothing: str = "nothing") -> str:
    """Return that nothing is unexplained, and of what somebody has looked at."""
    if diagnosis.spectra:
        return f"{nothing} stands out of the noise"
    return (
        f"{nothing} that repeats with the wheel stands out of the noise; the rest was not looked at (steady stretches "
        "too short)"
    )


def undetermined(diagnosis: Diagnosis) -> list[str]:
    """Return the estimates that the data do not determine."""
    return [name for name, known in diagnosis.determined.items() if not known]
