"""Next steps of a diagnosis: one for everything that it leaves open, and for what it identified."""

import math
from collections.abc import Iterator
from typing import Final, NamedTuple

from gateway.core.reasons import Reason
from gateway.core.text.text import clean
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Diagnosis, ScalingStatus, Unexplained
from gateway.diagnosis.views.phrases import (
    Kind,
    effect_kind,
    effect_title,
    effects_listed,
    likely,
    listed,
    place_text,
    reason_text,
    undecided_sets,
    undetermined,
    why_undetermined,
)
from gateway.diagnosis.views.quantities import parameter_label, span_text

_OF_KIND: Final = {
    Kind.SENSOR: "state it in the vehicle file or repair the sensor, and diagnose again",
    Kind.UNEVEN: (
        "compare its size with what your test allows; turn the tire on its rim and record again: what turns with the "
        "tire is the tire's, the rest the wheel's"
    ),
    **dict.fromkeys(
        (Kind.TERM, Kind.OTHER),
        "nothing to repair: use the estimates after. To have it subtracted from later recordings of this tire, save it "
        "with this diagnosis (--save-effects) and give it to estimate or live (--effects)",
    ),
}
_MOST_RESIDUALS: Final = 4
# Beyond the contact's edge: the belt's bending layers.
_NEAR_RAD: Final = 0.3
_UNSEEN: Final = frozenset({ScalingStatus.ONE_SPEED, ScalingStatus.SEEN_AT_ONE_SPEED, ScalingStatus.SPEED_WITH_LOAD})
_OF_NOTES: Final = {
    DiagnosisCode.SENSOR_IN_DOUBT: (
        "the sensor is in doubt",
        "check that it is fastened and aligned, and record again",
    ),
    DiagnosisCode.SEARCH_ENDED_EARLY: (
        "the search ended at its time limit",
        "give it more time: a larger --budget, or none",
    ),
    DiagnosisCode.CONTACTS_CONTRADICT: (
        "recordings contradict each other",
        "correct what is stated, or diagnose them apart",
    ),
    DiagnosisCode.LOADS_CONTRADICT: ("loads contradict each other", "correct the load or pressure that is stated"),
    DiagnosisCode.NUMBERS_CONTRADICT: (
        "recordings contradict each other",
        "correct what is stated, or diagnose them apart",
    ),
    DiagnosisCode.NOT_A_RING: (
        "the signal is not that of a rolling tire's belt",
        "check radius, axes and gain in the vehicle file",
    ),
    DiagnosisCode.PLUGIN_EFFECTS_LEFT_OUT: (
        "effects of plug-ins were left out",
        "remove or repair the plug-in in the note",
    ),
    DiagnosisCode.FEW_REVOLUTIONS: ("few revolutions", "record half a minute at a steady speed"),
    DiagnosisCode.ONE_SPEED: ("one speed", "record at a second speed under the same load and pressure"),
}


class NextStep(NamedTuple):
    """What is open, or was identified, and what to do about it."""

    about: str
    step: str


def next_steps(diagnosis: Diagnosis) -> list[NextStep]:
    """Return each step once, in the order of the report: effects, what is unexplained, estimates, notes."""
    subjects_by_step: dict[str, list[str]] = {}
    for subject, step in dict.fromkeys(_steps(diagnosis)):
        subjects_by_step.setdefault(step, []).append(subject)
    return [NextStep("; ".join(subjects), step) for step, subjects in subjects_by_step.items()]


def _steps(diagnosis: Diagnosis) -> Iterator[tuple[str, str]]:
    notes = [note for note in diagnosis.notes if isinstance(note, Reason)]
    for kind, step in _OF_KIND.items():
        names = [effect.name for effect in diagnosis.named if effect_kind(effect.name) is kind]
        if names and not diagnosis.taken_from:
            yield effects_listed(names), step
    if any(note.code is DiagnosisCode.SEARCH_ENDED_EARLY for note in notes):
        # What is left and not determined may be explained by a search that is complete.
        yield _OF_NOTES[DiagnosisCode.SEARCH_ENDED_EARLY]
        return
    for finding in undecided_sets(diagnosis):
        decide = reason_text(finding.decide_with) or "record at another speed, load or pressure"
        yield effects_listed((finding.name, *finding.rivals), "or"), decide
    for finding in likely(diagnosis):
        is_small = finding.reason is not None and finding.reason.code is DiagnosisCode.SMALLER_THAN_LEFT
        step = "find the cause of what is left first" if is_small else "record longer, or at another speed or load"
        yield effect_title(finding.name), step
    for residual in diagnosis.unexplained[:_MOST_RESIDUALS]:
        yield f"{clean(residual.axis)}, {place_text(residual)}", _of_residual(residual, _half_angle_rad(diagnosis))
    if names := undetermined(diagnosis):
        yield f"not determined: {listed([parameter_label(name) for name in names])}", why_undetermined(diagnosis, names)
    for note in notes:
        if note.code in _OF_NOTES:
            yield _OF_NOTES[note.code]


def _half_angle_rad(diagnosis: Diagnosis) -> float:
    half_angle = diagnosis.estimates_after.get("contact_half_angle_rad")
    return 0.0 if half_angle is None or not math.isfinite(half_angle.value) else half_angle.value


def _of_residual(residual: Unexplained, half_angle_rad: float) -> str:
    """Return what would tell more about a residual, by its own features."""
    if residual.changes:
        return "record one state at a time: load, slip angle, camber, pressure and temperature as steady as possible"
    if residual.lock == "samples" or math.isfinite(residual.timing_s):
        return "repair or replace sensor, hub or link"
    if residual.lock == "turns":
        return "look for what comes every second turn: a belt, a chain or a part that two turns bring back"
    if residual.lock == "time":
        return _of_time_locked(residual)
    if residual.angle_rad is None:
        step = "turn the tire on its rim and record again: what turns with it is the tire's, the rest the wheel's"
    elif abs(sum(residual.angle_rad)) / 2.0 < half_angle_rad + _NEAR_RAD:
        step = "it is at the contact: record at another load; what moves with the edges is tread or road"
    else:
        span = span_text(residual.angle_rad, math.degrees(1.0))
        step = (
            f"look at the tire {span} deg behind the sensor, which is in the contact then: a splice, "
            "a nail, a patch, a bent rim; turned on its rim, a tire takes its own along"
        )
    return f"{step}; record at a second speed" if residual.scaling.status in _UNSEEN else step


def _of_time_locked(residual: Unexplained) -> str:
    if math.isfinite(residual.centre_order):
        return (
            f"look for what turns {residual.centre_order:.2f} times as fast as the wheel: a bearing, a gear, a drum, "
            "another wheel"
        )
    if residual.narrow and math.isfinite(residual.centre_hz):
        source = f"a source of {residual.centre_hz:.1f} Hz"
        if residual.scaling.status in _UNSEEN:
            return f"record at a second speed: {source} keeps its frequency, what turns with the wheel does not"
        return f"look for {source}: mains, a motor, a fan; switch it off and record again"
    if residual.speeds is None:
        return "record at a second speed: a resonance keeps its frequency, what turns does not"
    return "it keeps its frequency: look for a resonance of suspension, rim, sensor or electronics"
