"""The tables of a diagnosis's page, as text that a template only has to put in place."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from gateway.closure.diagnosis import Diagnosis, Finding, Fitted, Verdict
from gateway.views.closure_rows import (
    VERDICTS,
    ShownNumber,
    orders_text,
    plain,
    ratio,
    show_fitted,
    significant,
    span_text,
)
from gateway.views.numbers import MISSING, fixed
from gateway.views.text import clean

_DEGREES: Final = 180.0 / math.pi
_BAND_STDS: Final = 2.0
_SCALINGS: Final = {"omega^2": "ω²", "omega^1": "ω"}


class ErrorRow(NamedTuple):
    """One error beside the noise floor; `share` is the length of its bar, 0 to 100."""

    label: str
    kind: str
    text: str
    over_floor: str
    share: float


@dataclass(frozen=True, slots=True)
class EffectRow:
    """One effect; remarks are (label, text)."""

    name: str
    lock: str
    verdict: str
    verdict_class: str
    parameters: tuple[ShownNumber, ...]
    rms: str
    held_out: str
    gain: str
    chi2: str
    reason: str
    remarks: tuple[tuple[str, str], ...]


class UnexplainedRow(NamedTuple):
    """Something unexplained."""

    axis: str
    lock: str
    orders: str
    hz: str
    angle: str
    scaling: str
    rms: str
    text: str


class Interval(NamedTuple):
    """A number with its error as drawn, in a box of 100 x 16."""

    kind: str
    low: float
    at: float
    high: float
    y: float


@dataclass(frozen=True, slots=True)
class EstimateRow:
    """One estimate before and after."""

    label: str
    unit: str
    before: str
    after: str
    percent: str
    errors: str
    determined: bool
    drawn: tuple[Interval, ...] = field(default=())


class StepCell(NamedTuple):
    """An estimate after a step, and by how much the step changed it."""

    text: str
    percent: str


class Step(NamedTuple):
    """All estimates after a step."""

    label: str
    cells: tuple[StepCell, ...]


def error_rows(diagnosis: Diagnosis) -> list[ErrorRow]:
    """Return the errors in the order in which they are read."""
    floor, held_out = diagnosis.noise_floor_mps2, diagnosis.held_out
    errors = [
        ("Before: starting model", "before", held_out.rms_before_mps2),
        ("After: with the named effects", "after", held_out.rms_after_mps2),
    ]
    if diagnosis.empirical_rms_mps2 is not None:
        errors.append(("After, with a fitted empirical correction", "empirical", diagnosis.empirical_rms_mps2))
    errors.append(("Noise floor: what a right model would leave", "floor", floor))
    largest = max((value for *_, value in errors if math.isfinite(value)), default=math.nan)
    return [
        ErrorRow(label, kind, significant(value), fixed(ratio(value, floor), 2), _share(value, largest))
        for label, kind, value in errors
    ]


def effect_rows(diagnosis: Diagnosis) -> list[EffectRow]:
    """Return the effects that were named or cannot be told apart, in the diagnosis's order."""
    return [_effect(finding) for finding in diagnosis.findings if finding.verdict is not Verdict.REFUSED]


def refused_rows(diagnosis: Diagnosis) -> list[EffectRow]:
    """Return the effects that were refused, in the diagnosis's order."""
    return [_effect(finding) for finding in diagnosis.findings if finding.verdict is Verdict.REFUSED]


def unexplained_rows(diagnosis: Diagnosis) -> list[UnexplainedRow]:
    """Return what is left, in the diagnosis's order."""
    return [
        UnexplainedRow(
            clean(left.axis),
            {"angle": "wheel angle", "time": "time"}.get(left.lock, clean(left.lock)),
            orders_text(left.orders),
            span_text(left.hz),
            span_text(left.angle_rad, _DEGREES),
            _SCALINGS.get(left.scaling, clean(left.scaling)),
            plain(left.rms_mps2, left.std_mps2),
            clean(left.text),
        )
        for left in diagnosis.unexplained
    ]


def estimate_rows(diagnosis: Diagnosis) -> list[EstimateRow]:
    """Return every estimate that there was before or is after."""
    before, after = diagnosis.estimates_before, diagnosis.estimates_after
    return [
        _estimate(name, before.get(name), after.get(name), diagnosis.determined.get(name, True))
        for name in dict.fromkeys((*before, *after))
    ]


def steps(diagnosis: Diagnosis) -> tuple[list[str], list[Step]]:
    """Return the estimates' names, and their values in the starting model and after each named effect."""
    added = [finding for finding in diagnosis.named if finding.estimates]
    if not added:
        return [], []
    names = list(dict.fromkeys(name for finding in added for name in finding.estimates))
    first = {name: before for name, (before, _) in added[0].estimates.items()}
    rows = [Step("starting model", tuple(_step_cell(name, None, first.get(name)) for name in names))]
    for finding in added:
        pairs: Mapping[str, tuple[Fitted | None, Fitted | None]] = dict(finding.estimates)
        cells = tuple(_step_cell(name, *pairs.get(name, (None, None))) for name in names)
        rows.append(Step(f"+ {clean(finding.name)}", cells))
    return [_heading(name, added) for name in names], rows


def _heading(name: str, added: list[Finding]) -> str:
    known = next(finding.estimates[name][1] for finding in added if name in finding.estimates)
    shown = show_fitted(name, known)
    return f"{shown.label}, {shown.unit}" if shown.unit else shown.label


def _step_cell(name: str, before: Fitted | None, after: Fitted | None) -> StepCell:
    new = show_fitted(name, after)
    return StepCell(new.text, _percent(show_fitted(name, before), new) if before is not None else "")


def _effect(finding: Finding) -> EffectRow:
    remarks = [("", clean(finding.summary)), ("Equation:", clean(finding.equation))]
    if finding.rivals:
        others = ", ".join(map(clean, finding.rivals))
        told = finding.verdict is Verdict.INDISTINGUISHABLE
        remarks.append(("Cannot be told from:" if told else "Explains the same as:", others))
    remarks.append(("To decide:", clean(finding.decide_with)))
    change = (
        f"{significant(finding.rms_before_mps2)} → {significant(finding.rms_after_mps2)}"
        if math.isfinite(finding.rms_before_mps2) and math.isfinite(finding.rms_after_mps2)
        else MISSING
    )
    return EffectRow(
        name=clean(finding.name),
        lock=f"{clean(finding.lock)}-locked",
        verdict=VERDICTS[finding.verdict],
        verdict_class=finding.verdict.value,
        parameters=tuple(show_fitted(name, fitted) for name, fitted in finding.parameters.items()),
        rms=significant(finding.rms_mps2),
        held_out=change,
        gain=plain(finding.held_out_gain, finding.held_out_std),
        chi2=significant(finding.chi2),
        reason=clean(finding.reason),
        remarks=tuple((label, text) for label, text in remarks if text),
    )


def _estimate(name: str, before: Fitted | None, after: Fitted | None, determined: bool) -> EstimateRow:
    old, new = show_fitted(name, before), show_fitted(name, after)
    errors = ratio(new.value - old.value, old.std)
    return EstimateRow(
        label=new.label,
        unit=new.unit or old.unit,
        before=old.text,
        after=new.text,
        percent=_percent(old, new).removesuffix(" %") or MISSING,
        errors=f"{errors:+.1f}" if math.isfinite(errors) else MISSING,
        determined=determined,
        drawn=_intervals(old, new),
    )


def _percent(old: ShownNumber, new: ShownNumber) -> str:
    share = 100.0 * ratio(new.value - old.value, abs(old.value))
    return f"{round(share, 1) + 0.0:+.1f} %" if math.isfinite(share) else ""


def _intervals(old: ShownNumber, new: ShownNumber) -> tuple[Interval, ...]:
    known = [
        (kind, one.value, _BAND_STDS * one.std if math.isfinite(one.std) else 0.0, y)
        for kind, one, y in (("before", old, 4.5), ("after", new, 11.5))
        if math.isfinite(one.value)
    ]
    low = min((value - half for _, value, half, _ in known), default=0.0)
    high = max((value + half for _, value, half, _ in known), default=0.0)
    if not 0.0 < high - low < math.inf:
        return ()

    def at(value: float) -> float:
        return round(3.0 + 94.0 * (value - low) / (high - low), 2)

    return tuple(Interval(kind, at(value - half), at(value), at(value + half), y) for kind, value, half, y in known)


def _share(value: float, largest: float) -> float:
    share = 100.0 * ratio(value, largest)
    return round(share, 2) if math.isfinite(share) else 0.0
