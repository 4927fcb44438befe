"""Phrases of a diagnosis that its JSON, page and terminal summary share, made from its values."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from enum import StrEnum
from typing import Final, NamedTuple

from gateway.core.reasons import Code, Reason
from gateway.core.text import wording
from gateway.core.text.numbers import fixed
from gateway.core.text.text import clean, counted
from gateway.diagnosis import criteria
from gateway.diagnosis.data.campaign_data import Remark
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.effect_contribution import MEASURED
from gateway.diagnosis.result import Diagnosis, Finding, Scaling, ScalingStatus, SelfTest, Unexplained, Verdict
from gateway.diagnosis.views.quantities import in_print, orders_text, parameter_label, show_fitted, span_text

MODELS: Final = {"paper": "the ring paper's series as printed", "exact": "the exact ring"}
VERDICTS: Final = {Verdict.NAMED: "identified", Verdict.INDISTINGUISHABLE: "undecided", Verdict.REFUSED: "rejected"}
NON_STATIONARY: Final = "changes during the recording"
SCALINGS: Final = {
    ScalingStatus.ONE_SPEED: "one speed",
    ScalingStatus.SEEN_AT_ONE_SPEED: "seen at one speed on this axis",
    ScalingStatus.SPEED_WITH_LOAD: "speed and load or pressure changed together",
    ScalingStatus.TOO_WEAK: "too weak at other speeds",
    ScalingStatus.NON_STATIONARY: NON_STATIONARY,
}
"""Reasons why the growth of a residual with speed is unknown."""

SINGLE_TURNS: Final = {
    "place": "at one angle with another waveform each turn",
    "turns": "differs between odd and even turns",
    "samples": "error by samples that repeat the one before on every axis: a data fault of sensor, hub or link",
}
"""Phrases for a residual of single turns, by its lock."""

_EFFECTS: Final = "gateway.diagnosis.effects"
GROWN: Final = 1.02
"""Ratio of the held-out error after to that before above which it has increased."""

# Probability from which an effect is rather present than not.
_EVEN: Final = 0.5
# Ratio of the held-out error after to the noise floor above which something is missing.
_MISSING: Final = 1.05
# Reasons against the value of an effect with which the model would fit better.
_IMPLAUSIBLE: Final = frozenset(
    {DiagnosisCode.IMPLAUSIBLE_PARAMETER, DiagnosisCode.HOLLOW_ROAD, DiagnosisCode.FADES_WITHIN_ONE_WAVE}
)

# Reasons against an effect that a longer search may overturn.
_ENDED_BEFORE: Final = frozenset({DiagnosisCode.RIVALS_UNTRIED, DiagnosisCode.LEFT_WHEN_ENDED})


class Kind(StrEnum):
    """What an effect is about: the sensor, a wheel that is not even, how tires roll, or anything else."""

    SENSOR = "sensor"
    UNEVEN = "uneven"
    TERM = "term"
    OTHER = "other"


# By the modules of the effects. Those of the sensor a vehicle file or a better sensor takes away.
_KINDS: Final = {
    **dict.fromkeys(("mounting", "acquisition", "sensor_response", "axis_errors"), Kind.SENSOR),
    **dict.fromkeys(("wheel_nonuniformity", "local_effects"), Kind.UNEVEN),
    **dict.fromkeys(
        ("series_corrections", "damping", "belt_structure", "belt_waves", "contact", "lateral_loads", "wheel_motion"),
        Kind.TERM,
    ),
}
_MEANS: Final = {
    Kind.SENSOR: "Sensor or mounting differ from what is stated or assumed: {effects}.",
    Kind.UNEVEN: "Tire or rim is not the same all around: {effects}.",
    Kind.TERM: "To describe this wheel, the model needs {effects}: terms of how tires roll, not faults.",
    Kind.OTHER: "The signal also has {effects}.",
}


def effect_kind(name: str) -> Kind:
    """Return what an effect of the catalogue is about, by the module that it is in."""
    effect = catalogue().get(name)
    package, _, module = ("" if effect is None else type(effect).__module__).rpartition(".")
    return _KINDS.get(module, Kind.OTHER) if package == _EFFECTS else Kind.OTHER


def named_sentences(names: Sequence[str]) -> Iterator[str]:
    """Yield what identified effects mean, those of sensor and wheel before the terms of the model."""
    for kind, words in _MEANS.items():
        of_kind = [name for name in names if effect_kind(name) is kind]
        if of_kind:
            yield words.format(effects=effects_listed(of_kind))


def remark(value: Remark) -> str:
    """Return the text of a reason, or a user's own text, in print."""
    return in_print(said(value))


def said(value: Remark) -> str:
    """Return the text of a reason, or a user's own text, as files have it."""
    return wording.text(value) if isinstance(value, Reason) else value


def reason_text(reason: Reason | None) -> str:
    """Return why an effect was refused or undecided, with the labels of the table for its parameter and effect."""
    if reason is None:
        return ""
    values = dict(reason.values)
    if isinstance(name := values.get("parameter"), str):
        values["parameter"] = parameter_label(name)
    if isinstance(name := values.get("effect"), str):
        values["effect"] = effect_title(name)
    return remark(Reason(reason.code, **values))


def effect_title(name: str) -> str:
    """Return the term of the field for an effect."""
    effect = catalogue().get(name)
    return clean(name if effect is None else effect.display_title)


def effects_listed(names: Sequence[str], last: str = "and") -> str:
    """Return the titles of effects as `a`, `a and b`, or `a, b and c`."""
    return listed([effect_title(name) for name in names], last)


def self_test_text(tested: SelfTest) -> str:
    """Return how simulations of a result were diagnosed."""
    failed = f"{counted(tested.failed, 'simulation')} without a diagnosis" if tested.failed else ""
    if not tested.count:
        return failed or "no simulation was diagnosed: the time was over"
    kinds = (("false", tested.false), ("not identified again", tested.missed))
    named = [
        f"{kind}: {listed([f'{effect_title(name)} ({count})' for name, count in names.items()])}"
        for kind, names in kinds
        if names
    ]
    pulls = f"rms {fixed(tested.pull_rms, 2)} of their errors" if tested.pulls else "none determined"
    text = f"{tested.wrong} of {counted(tested.count, 'simulation')} with a false effect"
    parts = text, failed, *named, f"{counted(len(tested.pulls), 'number')} off by {pulls}"
    return "; ".join(filter(None, parts))


def sentence(phrase: str) -> str:
    """Return a phrase as a sentence."""
    return f"{phrase[:1].upper()}{phrase[1:].rstrip('.')}." if phrase else ""


def listed(names: Sequence[str], last: str = "and") -> str:
    """Return `a`, `a and b`, or `a, b and c`."""
    return clean(f" {last} ".join(filter(None, (", ".join(names[:-1]), names[-1]))))


def model_words(model: str) -> str:
    """Return the description of a baseline model."""
    return MODELS.get(model, clean(model))


def scaling_text(scaling: Scaling) -> str:
    """Return the growth with speed as in JSON: `omega^2`, `constant`, `not known: one speed`."""
    if scaling.status is ScalingStatus.KNOWN:
        if scaling.exponent == 0.0:
            return "constant"
        is_whole = float(scaling.exponent).is_integer()
        return f"omega^{scaling.exponent:.0f}" if is_whole else f"omega^{scaling.exponent:.1f}"
    if scaling.status is ScalingStatus.UNCERTAIN:
        return f"not known: omega^({scaling.exponent:.1f} +- {scaling.std:.1f})"
    return f"not known: {SCALINGS[scaling.status]}"


def place_text(residual: Unexplained) -> str:
    """Return the place of a residual in one phrase: Hz where it is time-locked, else orders and angle."""
    if residual.lock == "time" and residual.hz is not None:
        return f"{span_text(residual.hz)} Hz"
    if residual.lock == "samples":
        return "repeated samples"
    parts = []
    if residual.orders is not None:
        parts.append(
            ("order " if residual.orders[0] == residual.orders[1] else "orders ") + orders_text(residual.orders)
        )
    elif residual.hz is not None:
        parts.append(f"{span_text(residual.hz)} Hz")
    if residual.angle_rad is not None:
        parts.append(f"{span_text(residual.angle_rad, 180.0 / math.pi)} deg")
    return ", ".join(parts) or "all orders"


def residual_remarks(residual: Unexplained) -> list[str]:
    """Return the remarks on a residual beyond its figures; none for a stationary one locked to the wheel."""
    if residual.changes:
        return drift_texts(residual) or [
            f"{NON_STATIONARY}: load, slip angle, camber or temperature may change; record one state at a time"
        ]
    if residual.lock in SINGLE_TURNS:
        return [single_turns(residual), *_other_axes(residual), f"most in {remark(residual.largest_in)}"]
    if residual.lock != "time":
        return []
    parts = []
    if not residual.lock_known:
        parts.append("at multiples of the wheel frequency: time-locked, or angle-locked but not the same every turn")
    elif residual.orders is not None:
        parts.append(
            "its frequency rises with the wheel's, but it does not repeat every turn"
            + (f" but every {residual.road_m:.3g} m of road" if math.isfinite(residual.road_m) else "")
        )
    elif residual.speeds is not None:
        count, total = residual.speeds
        parts.append(f"at the same frequency at {'every speed' if count == total else f'{count} of {total} speeds'}")
    return [*parts, *_other_axes(residual)]


def single_turns(residual: Unexplained) -> str:
    """Return what a residual of single turns is like: at a place with its scatter, the timing noise that makes it."""
    if math.isfinite(residual.timing_s):
        return (
            f"timing noise of {1e6 * residual.timing_s:.2g} us: on every axis and at every angle the scatter goes with "
            "the slope of the waveform"
        )
    return SINGLE_TURNS[residual.lock]


def drift_texts(residual: Unexplained) -> list[str]:
    """Return what drifts, with rate, beginning and end in each group; none where no quantity explains the change."""
    texts = []
    for drift in residual.drifts:
        rate, begin, end = (
            show_fitted(drift.parameter, fitted) for fitted in (drift.per_minute, drift.begin, drift.end)
        )
        cause = listed([_drifting(name) for name in (drift.name, *drift.rivals)], "or")
        parameter = "" if drift.parameter == drift.name else f" {rate.label}"
        speed = f" {rate.joined()} per minute," if math.isfinite(drift.per_minute.value) else ""
        texts.append(
            f"drift of {cause}:{parameter}{speed} from {begin.joined()} to {end.joined()} in {remark(drift.label)}"
        )
    return texts


def _drifting(name: str) -> str:
    """Return the term for an effect, a number of the tire, load or pressure."""
    return effect_title(name) if name in catalogue() else parameter_label(name)


def _other_axes(residual: Unexplained) -> list[str]:
    other_axes = ", ".join(f"{value:.2g} m/s² {axis}" for axis, value in residual.other_axes)
    return [f"also {other_axes}"] if other_axes else []


def residual_sentence(residual: Unexplained) -> str:
    """Return a residual as one sentence, as in JSON."""
    size = f"{residual.rms_mps2:.2g} m/s^2 rms"
    if residual.changes:
        group = f", most in {remark(residual.largest_in)}" if residual.largest_in else ""
        cause = "; ".join(drift_texts(residual)) or (
            "load, slip angle, camber or temperature may change: record one state at a time"
        )
        return (
            f"{residual.axis} axis, {place_text(residual)}: {NON_STATIONARY}, by {size} about its mean{group}; {cause}"
        )
    if residual.lock in SINGLE_TURNS:
        others = "".join(f", {value:.2g} m/s^2 {axis}" for axis, value in residual.other_axes)
        return (
            f"{residual.axis} axis, {place_text(residual)}: {size} over the turn{others}; {single_turns(residual)}; "
            f"most in {remark(residual.largest_in)}; scaling: {scaling_text(residual.scaling)}"
        )
    if residual.lock != "time":
        place = "spread over the revolution"
        if residual.angle_rad is not None:
            low, high = (math.degrees(angle) for angle in residual.angle_rad)
            place = f"between {low:.0f} and {high:.0f} deg of the contact's centre"
        head = f"{residual.axis} axis, {place_text(replace(residual, angle_rad=None))}, {place}"
        return f"{head}: {size}, repeats every revolution; scaling: {scaling_text(residual.scaling)}"
    place = f"{residual.centre_hz:.1f} Hz" if math.isfinite(residual.centre_hz) else place_text(residual)
    if math.isfinite(residual.centre_order):
        place = f"order {residual.centre_order:.2f} of the wheel"
    notes = "".join(f"; {text}" for text in residual_remarks(residual))
    kind = "line" if residual.narrow else "band"
    return f"{kind} at {place} on the {residual.axis} axis, {size}{notes}; scaling: {scaling_text(residual.scaling)}"


def no_residual(diagnosis: Diagnosis, subject: str = "nothing") -> str:
    """Return that no residual exceeds the noise, and in which part of the signal."""
    if diagnosis.spectra:
        return f"{subject} exceeds the noise"
    return (
        f"{subject} that repeats with the wheel exceeds the noise; the rest was not analyzed (steady stretches too "
        "short)"
    )


def undecided_sets(diagnosis: Diagnosis) -> list[Finding]:
    """Return one finding of each set of effects that cannot be distinguished: a confounder may be a finding too."""
    sets: dict[frozenset[str], Finding] = {}
    for finding in diagnosis.findings:
        if finding.verdict is Verdict.INDISTINGUISHABLE:
            sets.setdefault(frozenset({finding.name, *finding.rivals}), finding)
    return list(sets.values())


def likely(diagnosis: Diagnosis) -> list[Finding]:
    """Return the effects that are more likely than not, but not certain: the error after contains them."""
    return [
        finding
        for finding in diagnosis.findings
        if finding.verdict is Verdict.REFUSED
        and finding.lock == "angle"
        and finding.probability > _EVEN
        and _code(finding) is not DiagnosisCode.NOT_ON_EXACT_RING
    ]


def so_far(diagnosis: Diagnosis) -> list[Finding]:
    """Return the effects that a search which ended early has neither identified nor rejected."""
    open_ones = [] if diagnosis.complete else [finding.name for finding in likely(diagnosis)]
    return [finding for finding in diagnosis.findings if finding.name in open_ones or _code(finding) in _ENDED_BEFORE]


def no_effect(diagnosis: Diagnosis) -> str:
    """Return that no effect is identified, and why."""
    if diagnosis.complete:
        return "No effect of the catalogue is supported by sufficient evidence."
    return "No effect is identified: the search ended at its time limit."


def decisively_rejected(diagnosis: Diagnosis) -> list[Finding]:
    """Return the effects that were as good as identified but for the reason against them.

    These are the effects that the exact ring does not confirm and, where something is missing, the first one with which
    the model would fit better, but with an implausible value.
    """
    refused = [
        finding for finding in diagnosis.findings if finding.verdict is Verdict.REFUSED and finding.lock == "angle"
    ]
    unconfirmed = [finding for finding in refused if _code(finding) is DiagnosisCode.NOT_ON_EXACT_RING]
    if diagnosis.held_out.rms_after_mps2 > _MISSING * diagnosis.noise_floor_mps2:
        return [*unconfirmed, *[finding for finding in refused if _code(finding) in _IMPLAUSIBLE][:1]]
    return unconfirmed


def _code(finding: Finding) -> Code | None:
    return finding.reason.code if finding.reason is not None else None


def undetermined(diagnosis: Diagnosis) -> list[str]:
    """Return the estimates that the data do not determine."""
    return [name for name, is_determined in diagnosis.determined.items() if not is_determined]


_CONTRADICTED: Final = "the recordings contradict each other: see the notes"
# Notes by which numbers are not determined, the weightiest first.
_NOTHING_DETERMINED: Final = {
    DiagnosisCode.CONTACTS_CONTRADICT: _CONTRADICTED,
    DiagnosisCode.NUMBERS_CONTRADICT: _CONTRADICTED,
    DiagnosisCode.SENSOR_IN_DOUBT: "the sensor is in doubt: see the notes",
    DiagnosisCode.NOT_A_RING: "the signal is not that of a rolling tire's belt: see the notes",
    DiagnosisCode.LEFT_WHEN_ENDED: "the search ended before it had explained the signal: allow it more time",
}


def why_undetermined(diagnosis: Diagnosis, names: Sequence[str]) -> str:
    """Return the main reason why some estimates are not determined, and the remedy; empty for none."""
    if not names:
        return ""
    noted = {note.code for note in diagnosis.notes if isinstance(note, Reason)}
    for code, reason in _NOTHING_DETERMINED.items():
        if code in noted:
            return reason
    conditions = (("load", diagnosis.load_known), ("pressure", diagnosis.pressure_known))
    assumed = [quantity for quantity, is_stated in conditions if not is_stated]
    if assumed:
        return f"{listed(assumed)} assumed; state {'it' if len(assumed) == 1 else 'them'}"
    estimates = {name: estimate for name, estimate in diagnosis.estimates_after.items() if name in names}
    if any(isinstance(note, Reason) and _is_of_plane(note) for note in diagnosis.notes):
        return "too uncertain beside what is left unexplained: see the notes"
    too_small = [name for name, fitted in estimates.items() if fitted.std < criteria.DETERMINED * abs(fitted.value)]
    if len(too_small) == len(estimates):
        return "too small to be measured; record at more loads"
    addition = f"; {', '.join(too_small)}: too small to be measured" if too_small else ""
    return f"standard error above {100.0 * criteria.DETERMINED:.0f} %; record longer, or at more loads{addition}"


def _is_of_plane(note: Reason) -> bool:
    """Return whether a note says that much is left of the axes on which the numbers rest."""
    axes = note["axes"] if note.code is DiagnosisCode.EVIDENCE_TEMPERED else ()
    return isinstance(axes, tuple) and "radial" in axes


class NoCorrection(NamedTuple):
    """Return why no correction is saved, and the remedy."""

    reason: str
    remedy: str


def why_unsaved(diagnosis: Diagnosis) -> NoCorrection:
    """Return why a diagnosis has nothing that `live` and `estimate` could subtract."""
    if not diagnosis.named:
        undecided = undecided_sets(diagnosis)
        if not undecided and not diagnosis.complete:
            return NoCorrection(
                "no effect was identified before the search ended", "Give it more time: a larger --budget, or none."
            )
        if not undecided and diagnosis.unexplained:
            return NoCorrection(
                "no effect was identified",
                "What is left is not in the catalogue: see the unexplained residuals of the report.",
            )
        if not undecided:
            return NoCorrection(
                "no effect was identified",
                "live and estimate need no correction. Recordings at more speeds or loads may reveal smaller effects.",
            )
        first = undecided[0]
        advice = "record at another speed, load or pressure"
        remedy = sentence(advice if first.decide_with is None else reason_text(first.decide_with))
        if not first.rivals:
            return NoCorrection(f"{effect_title(first.name)} is not certain", remedy)
        names = effects_listed((first.name, *first.rivals))
        return NoCorrection(f"{names} cannot be distinguished, so none is identified", remedy)
    usable = [name for name in _in_waveform(diagnosis) if name not in MEASURED]
    if usable:
        return NoCorrection(
            f"the ring has no solution at the fitted parameters without {effects_listed(usable)}, "
            "so nothing can be subtracted",
            "Check belt radius, load and pressure in the configuration, then the report's unexplained residuals.",
        )
    reasons = "; ".join(_not_subtracted(diagnosis))
    return NoCorrection(f"no identified effect can be subtracted: {reasons}", "live and estimate need no correction.")


def saved_text(diagnosis: Diagnosis) -> str:
    """Return which effects the saved correction holds, and which identified ones it does not, with the reason."""
    saved = (
        ", ".join(effect_title(effect.name) for effect in diagnosis.correction.effects) if diagnosis.correction else ""
    )
    return "; ".join([saved, *_not_subtracted(diagnosis)])


def _not_subtracted(diagnosis: Diagnosis) -> list[str]:
    waveform = _in_waveform(diagnosis)
    measured = [name for name in waveform if name in MEASURED]
    varying = [finding.name for finding in diagnosis.named if finding.name not in waveform]
    reasons = []
    if measured:
        reasons.append(f"{effects_listed(measured)} {_is(measured)} left for the estimators to measure")
    if varying:
        reasons.append(f"{effects_listed(varying)} {_is(varying)} not the same in every revolution")
    return reasons


def _in_waveform(diagnosis: Diagnosis) -> list[str]:
    return [finding.name for finding in diagnosis.named if finding.lock == "angle"]


def _is(names: list[str]) -> str:
    return "is" if len(names) == 1 else "are"
