"""Rows of the tables of a diagnosis's page, as text."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import PurePath
from typing import Final, Generic, NamedTuple, Protocol, TypeVar

from gateway.core.text.numbers import MISSING, fixed
from gateway.core.text.probabilities import probability_text
from gateway.core.text.text import clean
from gateway.diagnosis.result import Diagnosis, Finding, Fitted, Scaling, ScalingStatus, Verdict
from gateway.diagnosis.views.phrases import (
    SCALINGS,
    effect_title,
    effects_listed,
    reason_text,
    remark,
    residual_remarks,
    scaling_text,
)
from gateway.diagnosis.views.quantities import (
    ShownNumber,
    orders_text,
    plain,
    ratio,
    show_fitted,
    significant,
    span_text,
    state_text,
    typeset,
)

_DEGREES: Final = 180.0 / math.pi
_BAND_STDS: Final = 2.0
# Probabilities above are shown as a bound, and with a third digit.
_CERTAIN: Final = 0.999
_LEAST_CHI_SQUARE: Final = 0.01


class _HasState(Protocol):
    @property
    def state(self) -> str: ...


Row = TypeVar("Row", bound=_HasState)


class ErrorRow(NamedTuple):
    """One error and its ratio to the noise floor; `share` is the length of its bar, 0 to 100."""

    label: str
    kind: str
    text: str
    over_floor: str
    share: float


class UnexplainedRow(NamedTuple):
    """One unexplained residual."""

    axis: str
    lock: str
    orders: str
    hz: str
    angle: str
    scaling: str
    rms: str
    remark: str


class Interval(NamedTuple):
    """A number with its error as drawn, in a box of 100 x 16."""

    kind: str
    low: float
    at: float
    high: float
    y: float


@dataclass(frozen=True, slots=True)
class EstimateRow:
    """One estimate before and after; `state` is a load and pressure, empty where most revolutions are."""

    state: str
    label: str
    before: str
    after: str
    percent: str
    errors: str
    determined: bool
    determined_text: str
    drawn: tuple[Interval, ...]


class StepCell(NamedTuple):
    """An estimate after a step, and its change by the step."""

    text: str
    percent: str


class StepRow(NamedTuple):
    """One estimate in the baseline model and after every step."""

    state: str
    label: str
    cells: tuple[StepCell, ...]


class StateRows(NamedTuple, Generic[Row]):
    """Rows of one load and pressure; `state` is empty where most revolutions are."""

    state: str
    rows: list[Row]


def by_state(rows: Iterable[Row]) -> list[StateRows[Row]]:
    """Return rows grouped by their load and pressure, in their order."""
    states: dict[str, StateRows[Row]] = {}
    for row in rows:
        states.setdefault(row.state, StateRows(row.state, [])).rows.append(row)
    return list(states.values())


def error_rows(diagnosis: Diagnosis) -> list[ErrorRow]:
    """Return the errors in the order in which they are read."""
    floor, held_out = diagnosis.noise_floor_mps2, diagnosis.held_out
    errors = [
        ("Before: baseline model", "before", held_out.rms_before_mps2, held_out.std_before_mps2),
        ("After: with effects", "after", held_out.rms_after_mps2, held_out.std_after_mps2),
    ]
    if diagnosis.empirical_rms_mps2 is not None:
        errors.append(("After, with an empirical correction", "empirical", diagnosis.empirical_rms_mps2, math.nan))
    errors.append(("Noise floor: scatter between revolutions", "floor", floor, math.nan))
    if (raw := held_out.as_recorded) is not None:
        errors.append(("Before, contact edges as recorded", "before", raw.rms_before_mps2, math.nan))
        errors.append(("After, contact edges as recorded", "after", raw.rms_after_mps2, math.nan))
    largest = max((value for _, _, value, _ in errors if math.isfinite(value)), default=math.nan)
    return [
        ErrorRow(label, kind, _with_error(value, std), fixed(ratio(value, floor), 2), _share(value, largest))
        for label, kind, value, std in errors
    ]


def _with_error(value: float, std: float) -> str:
    return plain(value, std) if 0.0 < std < math.inf else significant(value)


def bounded_probability(probability: float) -> str:
    """Return a probability, near 1 as a bound."""
    if not math.isfinite(probability):
        return MISSING
    if probability > _CERTAIN:
        return f"> {_CERTAIN}"
    return probability_text(probability)


_LOCKS: Final = {
    "angle": "wheel angle",
    "time": "time",
    "place": "one angle, each turn anew",
    "turns": "every second turn",
    "samples": "data fault",
}


def unexplained_rows(diagnosis: Diagnosis) -> list[UnexplainedRow]:
    """Return the unexplained residuals, in the diagnosis's order."""
    return [
        UnexplainedRow(
            clean(residual.axis),
            _LOCKS.get(residual.lock, clean(residual.lock)) if residual.lock_known else "not known",
            orders_text(residual.orders),
            span_text(residual.hz),
            span_text(residual.angle_rad, _DEGREES),
            _scaling(residual.scaling),
            plain(residual.rms_mps2, residual.std_mps2),
            "; ".join(residual_remarks(residual)),
        )
        for residual in diagnosis.unexplained
    ]


def estimate_rows(diagnosis: Diagnosis) -> list[EstimateRow]:
    """Return every estimate of before or after."""
    before, after = diagnosis.estimates_before, diagnosis.estimates_after
    return [
        _estimate(name, before.get(name), after.get(name), diagnosis.determined.get(name, True))
        for name in dict.fromkeys((*before, *after))
    ]


def omissions(diagnosis: Diagnosis) -> tuple[list[str], list[StepRow]]:
    """Return every estimate with all effects, and without each of them; none for fewer than two effects."""
    findings = added(diagnosis)
    if len(findings) < 2:
        return [], []
    rows = []
    for name in dict.fromkeys(name for finding in findings for name in finding.estimates):
        pairs = [finding.estimates.get(name, (None, None)) for finding in findings]
        fitted = next(new for _, new in pairs if new is not None)
        cells = (StepCell(show_fitted(name, fitted).text, ""), *(_step_cell(name, new, old) for old, new in pairs))
        rows.append(StepRow(state_text(fitted.state), _labelled(name, fitted), cells))
    return ["with all", *(f"without {effect_title(finding.name)}" for finding in findings)], rows


def _labelled(name: str, fitted: Fitted | None) -> str:
    """Return an estimate's label with its unit."""
    number = show_fitted(name, fitted, state=False)
    return f"{number.label}, {number.unit}" if number.unit else number.label


def _step_cell(name: str, before: Fitted | None, after: Fitted | None) -> StepCell:
    new = show_fitted(name, after)
    return StepCell(new.text, _percent(show_fitted(name, before), new) if before is not None else "")


def sizes_alone(finding: Finding, parameter: str, recordings: Sequence[str]) -> list[tuple[str, str]]:
    """Return a parameter of an effect as each part of the data alone gives it, by part, in the unit of all of them."""
    fitted = finding.parameters[parameter]
    return [
        (
            f"{remark(PurePath(str(size.label)).name if size.label in recordings else size.label)} alone",
            show_fitted(parameter, replace(fitted, value=size.value, std=size.std)).joined(),
        )
        for size in finding.single_sizes
        if size.parameter == parameter
    ]


def effect_remarks(finding: Finding) -> list[tuple[str, str]]:
    """Return what is to be known of an effect: labels and texts."""
    remarks = [("", typeset(finding.summary)), ("Equation:", typeset(finding.equation))]
    if finding.rivals:
        remarks.append(("Confounded with:", effects_listed(finding.rivals)))
    if finding.verdict is Verdict.INDISTINGUISHABLE:
        remarks.append(("Reason:", reason_text(finding.reason)))
    remarks.append(("To decide:", reason_text(finding.decide_with)))
    return [(label, text) for label, text in remarks if text]


def held_out_change(finding: Finding) -> str:
    """Return the held-out error without and with an effect."""
    errors_mps2 = finding.rms_before_mps2, finding.rms_after_mps2
    return " → ".join(map(significant, errors_mps2)) if all(map(math.isfinite, errors_mps2)) else MISSING


def chi_square(value: float) -> str:
    """Return a chi-square; a small one is rounding of the two that it is the difference of."""
    return significant(value) if not abs(value) < _LEAST_CHI_SQUARE else f"< {_LEAST_CHI_SQUARE:g}"


def _scaling(scaling: Scaling) -> str:
    if scaling.status is ScalingStatus.NON_STATIONARY:
        return MISSING
    if scaling.status in SCALINGS:
        return SCALINGS[scaling.status]
    if scaling.status is ScalingStatus.KNOWN and scaling.exponent == 1.0:
        return "ω"
    return typeset(scaling_text(scaling))


def _estimate(name: str, before: Fitted | None, after: Fitted | None, determined: bool) -> EstimateRow:
    old, new = show_fitted(name, before), show_fitted(name, after)
    errors = ratio(new.value - old.value, old.std)
    return EstimateRow(
        state=state_text(fitted.state) if (fitted := after or before) is not None else "",
        label=_labelled(name, after or before),
        before=old.text,
        after=new.text,
        percent=_percent(old, new).removesuffix(" %") or MISSING,
        errors=f"{round(errors, 1) + 0.0:+.1f}" if math.isfinite(errors) else MISSING,
        determined=determined,
        determined_text="not fitted" if new.std == 0.0 else "yes" if determined else "no",
        drawn=_to_scale([("before", old.value, old.std, 4.5), ("after", new.value, new.std, 11.5)]),
    )


def _percent(old: ShownNumber, new: ShownNumber) -> str:
    share = 100.0 * ratio(new.value - old.value, abs(old.value))
    digits = 1 if abs(share) >= 0.095 else 2
    return f"{round(share, digits) + 0.0:+.{digits}f} %" if math.isfinite(share) else ""


def sizes_drawn(finding: Finding, parameter: str) -> tuple[Interval, ...]:
    """Return a parameter of an effect as all data give it, and below as each part alone does, to one scale.

    Each is 7 lower than the one before; empty without sizes of parts.
    """
    fitted = finding.parameters[parameter]
    parts = [size for size in finding.single_sizes if size.parameter == parameter]
    rows = [("after", fitted.value, fitted.std, 4.5)]
    rows += [("before", size.value, size.std, 11.5 + 7.0 * number) for number, size in enumerate(parts)]
    return _to_scale(rows) if parts else ()


def _to_scale(rows: Sequence[tuple[str, float, float, float]]) -> tuple[Interval, ...]:
    """Return intervals of two standard errors: kind, value, standard error and height of each."""
    drawn = [
        (kind, value, _BAND_STDS * std if math.isfinite(std) else 0.0, y)
        for kind, value, std, y in rows
        if math.isfinite(value)
    ]
    low = min((value - half for _, value, half, _ in drawn), default=0.0)
    high = max((value + half for _, value, half, _ in drawn), default=0.0)
    if not 0.0 < high - low < math.inf:
        return ()

    def at(value: float) -> float:
        return round(3.0 + 94.0 * (value - low) / (high - low), 2)

    return tuple(Interval(kind, at(value - half), at(value), at(value + half), y) for kind, value, half, y in drawn)


def _share(value: float, largest: float) -> float:
    share = 100.0 * ratio(value, largest)
    return round(share, 2) if math.isfinite(share) else 0.0


def added(diagnosis: Diagnosis) -> list[Finding]:
    """Return the effects of the model after, in the order in which they were added, as far as it can be inferred."""
    remaining = [
        finding for finding in diagnosis.findings if finding.verdict is not Verdict.REFUSED and finding.estimates
    ]
    ordered: list[Finding] = []
    estimates = diagnosis.estimates_before
    while remaining:
        # Its estimates before are those after the previous effect, except for the new weights of the noise.
        following = min(
            remaining,
            key=lambda candidate: _distance(estimates, {name: old for name, (old, _) in candidate.estimates.items()}),
        )
        remaining.remove(following)
        ordered.append(following)
        estimates = {name: new for name, (_, new) in following.estimates.items()}
    return ordered


def _distance(first: Mapping[str, Fitted], second: Mapping[str, Fitted]) -> float:
    """Return the sum of the relative differences of estimates."""
    pairs = [(first[name].value, second[name].value) for name in first if name in second]
    return sum(min(abs(a - b) / max(abs(a), 1e-300), 1e3) for a, b in pairs if math.isfinite(a) and math.isfinite(b))
