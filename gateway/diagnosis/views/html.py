"""A diagnosis as one self-contained HTML page."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.reasons import Reason
from gateway.core.shown_units import shown_in
from gateway.core.text.html_template import result_page
from gateway.core.text.numbers import MISSING, fixed, split_name
from gateway.core.text.output_file import check_target, write_whole
from gateway.core.text.page_figure import Drawing, inline_svg, report_style, require_report_packages
from gateway.core.text.text import clean, counted
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Curves, Diagnosis, EffectCurves, HeldOut, Origin, SelfTest, Spectra, Trend, Verdict
from gateway.diagnosis.views.figures import (
    CONTACT_VIEW_DEG,
    NOISE_STDS,
    effect_figure,
    on_axis,
    orders_figure,
    residual_figure,
    spectra_figure,
    trend_figure,
    waveform_figure,
)
from gateway.diagnosis.views.next_steps import next_steps
from gateway.diagnosis.views.phrases import (
    GROWN,
    NON_STATIONARY,
    VERDICTS,
    Kind,
    effect_kind,
    effect_title,
    effects_listed,
    likely,
    listed,
    model_words,
    named_sentences,
    no_effect,
    no_residual,
    place_text,
    reason_text,
    remark,
    said,
    self_test_text,
    sentence,
    so_far,
    undecided_sets,
    undetermined,
)
from gateway.diagnosis.views.quantities import (
    AxisResidual,
    plain,
    ratio,
    recorded_axes,
    reference_group,
    residuals,
    show_fitted,
    significant,
)
from gateway.diagnosis.views.report_tables import (
    bounded_probability,
    by_state,
    chi_square,
    effect_remarks,
    error_rows,
    estimate_rows,
    held_out_change,
    omissions,
    sizes_alone,
    sizes_drawn,
    unexplained_rows,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_TEMPLATE: Final = ("gateway.diagnosis.views", "closure_report.html.j2")
MOST_GROUPS: Final = 12
"""Groups other than the reference group whose residual is drawn."""
MOST_SPECTRA: Final = 6
_MODELS: Final = {
    "exact": "the ring model, solved exactly, without effects",
    "paper": "the series of the ring paper as printed",
}
# Notes that the summary repeats.
_IN_SUMMARY: Final = (
    DiagnosisCode.SENSOR_IN_DOUBT,
    DiagnosisCode.NOT_A_RING,
    DiagnosisCode.CONTACTS_CONTRADICT,
    DiagnosisCode.LOADS_CONTRADICT,
)


class Chapter(NamedTuple):
    """Figures under one heading; `layout` is the class of their box."""

    id: str
    title: str
    text: str
    layout: str
    drawings: list[Drawing]


def write_html(diagnosis: Diagnosis, path: Path, *, force: bool = False) -> None:
    """Write a diagnosis as one self-contained HTML file, whole or not at all.

    Raises:
        OutputError: matplotlib or jinja2 is missing, the file exists and `force` is not set, or it cannot be written.
    """
    check_target(path, force=force)
    write_whole(path, diagnosis_html(diagnosis), force=force)


def diagnosis_html(diagnosis: Diagnosis) -> str:
    """Return a diagnosis as an HTML page without scripts and external resources; deterministic.

    Raises:
        OutputError: matplotlib or jinja2 is missing.
    """
    require_report_packages()
    with shown_in(diagnosis.units):
        return _page_of(diagnosis)


def _page_of(diagnosis: Diagnosis) -> str:
    return result_page(
        *_TEMPLATE,
        title=f"Diagnosis of {clean(diagnosis.wheel)}",
        facts=_facts(diagnosis),
        answer=" ".join(_answer(diagnosis)),
        steps=next_steps(diagnosis),
        is_calm=_is_all_well(diagnosis),
        page=_page(diagnosis),
        diagnosis=diagnosis,
        bounded_probability=bounded_probability,
        chi_square=chi_square,
        clean=clean,
        effect_title=effect_title,
        no_effect=no_effect,
        effect_remarks=effect_remarks,
        fixed=fixed,
        held_out_change=held_out_change,
        reason_text=reason_text,
        said=said,
        show_fitted=show_fitted,
        significant=significant,
        sizes_alone=sizes_alone,
        sizes_drawn=sizes_drawn,
        utc=_utc,
        verdicts=VERDICTS,
    )


def _page(diagnosis: Diagnosis) -> dict[str, object]:
    """Return the values of the template, which escapes all text except drawings."""
    estimates = estimate_rows(diagnosis)
    step_names, step_rows = omissions(diagnosis)
    undecided = so_far(diagnosis)
    return {
        "wheel": clean(diagnosis.wheel),
        "folds": _folds(diagnosis),
        "errors": error_rows(diagnosis),
        "effects": [finding for finding in diagnosis.findings if finding.verdict is not Verdict.REFUSED],
        "so_far": undecided,
        "refused": [
            finding for finding in diagnosis.findings if finding.verdict is Verdict.REFUSED and finding not in undecided
        ],
        "unexplained": unexplained_rows(diagnosis),
        "no_residual": no_residual(diagnosis, "Nothing"),
        "estimates": by_state(estimates),
        "legend": any(row.drawn for row in estimates),
        "states": any(row.state for row in estimates),
        "logarithms": any(name.endswith("_ln") for finding in diagnosis.findings for name in finding.parameters),
        "step_names": step_names,
        "steps": by_state(step_rows),
        "stated": [remark(text) for text in diagnosis.stated],
        "assumed": [remark(text) for text in diagnosis.assumed],
        "notes": [remark(text) for text in diagnosis.notes],
        "provenance": _provenance(diagnosis.origin, diagnosis.self_test) if diagnosis.origin is not None else [],
        "chapters": chapters(diagnosis),
    }


def _facts(diagnosis: Diagnosis) -> str:
    parts = [f"{diagnosis.revolutions} revolutions of {counted(len(diagnosis.recordings), 'recording')}"]
    recordings = diagnosis.origin.recordings if diagnosis.origin is not None else ()
    times_s = [time_s for recording in recordings for time_s in (recording.first_s, recording.last_s) if time_s > 0.0]
    if times_s:
        parts.append(f"{_utc(min(times_s))} to {_utc(max(times_s))} UTC")
    parts.append(f"compared with {_MODELS.get(diagnosis.model, model_words(diagnosis.model))}")
    if diagnosis.rejected:
        parts.append(f"{diagnosis.rejected} left out")
    return " · ".join(parts)


def _utc(time_s: float) -> str:
    return f"{datetime.fromtimestamp(time_s, UTC):%Y-%m-%d %H:%M:%S}" if time_s > 0.0 else MISSING


def _folds(diagnosis: Diagnosis) -> str:
    """Return which revolutions were held out, and why some were not."""
    held_out, used = diagnosis.held_out, diagnosis.revolutions
    total = "" if held_out.revolutions >= used else f" of the {used}"
    text = f"Folds: {held_out.folds} {clean(diagnosis.folds_of)}, each held out in turn; {held_out.revolutions}{total} "
    share = ratio(held_out.rms_after_mps2, held_out.rms_before_mps2)
    ratio_text = f" After over before: {plain(share, held_out.std_ratio)}." if held_out.std_ratio > 0.0 else ""
    return f"{text}revolutions in all.{ratio_text}"


def _provenance(origin: Origin, tested: SelfTest | None) -> list[tuple[str, str]]:
    """Return what a diagnosis was made of besides recordings, and how."""
    sensor = "" if origin.sensor_id is None else f"{origin.sensor_id:08x}"
    entries = (
        ("Command", origin.command),
        ("Commit", origin.commit),
        ("Sensor", sensor),
        ("Vehicle", origin.vehicle),
        ("Tire", origin.tire),
        ("Self-test", "" if tested is None else self_test_text(tested)),
    )
    return [(label, clean(text)) for label, text in entries if text]


def _answer(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield the summary of the diagnosis, sentence by sentence."""
    if _is_all_well(diagnosis):
        yield "Nothing is wrong that these data show."
    yield from _effect_sentences(diagnosis)
    for note in diagnosis.notes:
        if isinstance(note, Reason) and note.code in _IN_SUMMARY:
            yield sentence(remark(note))
    yield from _error_sentences(diagnosis)
    if diagnosis.unexplained:
        first = diagnosis.unexplained[0]
        remaining = len(diagnosis.unexplained) - 1
        more = f", and {remaining} more" if remaining else ""
        size = plain(first.rms_mps2, first.std_mps2)
        doubt = f" ({NON_STATIONARY})" if first.changes else "" if first.lock_known else " (lock not known)"
        yield f"Unexplained: {clean(first.axis)} axis, {place_text(first)}, {size} m/s² rms{doubt}{more}."
    else:
        yield f"{no_residual(diagnosis, 'Nothing else')}."


def _effect_sentences(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield which effects the model lacks, and which these data do not decide."""
    named = [finding.name for finding in diagnosis.named]
    undecided = undecided_sets(diagnosis)
    if named and diagnosis.taken_from:
        source = clean(diagnosis.taken_from)
        yield f"{sentence(effects_listed(named))[:-1]}: as found in {source}, nothing of it refitted."
    elif named:
        yield from named_sentences(named)
    elif not undecided:
        yield no_effect(diagnosis)
    for finding in undecided:
        subject = "It also" if named else "The model"
        if finding.rivals:
            names = effects_listed((finding.name, *finding.rivals), "or")
            yield f"{subject} needs {names}; these data do not distinguish them."
        else:
            yield f"{subject} may need {effect_title(finding.name)}; these data do not decide."


def _error_sentences(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield the error on unseen revolutions, without and with the effects."""
    held_out, floor = diagnosis.held_out, diagnosis.noise_floor_mps2
    before, after = significant(held_out.rms_before_mps2), significant(held_out.rms_after_mps2)
    share = ratio(held_out.rms_after_mps2, floor)
    times = f"{fixed(share, 2)} times the" if math.isfinite(share) else "with a"
    floor_text = f", {times} noise floor of {significant(floor)} m/s²."
    uncertain = [effect_title(finding.name) for finding in likely(diagnosis)]
    identified = (*diagnosis.named, *undecided_sets(diagnosis))
    shaped = [finding.name for finding in identified if finding.lock == "angle"]
    if shaped or uncertain:
        grown = ratio(held_out.rms_after_mps2, held_out.rms_before_mps2) > GROWN
        verb = "increases" if grown else "changes" if before == after else f"falls{_fallen_axes(held_out)}"
        added = ["this effect" if len(shaped) == 1 else "these effects"] if shaped else []
        verb_of = "is" if len(uncertain) == 1 else "are"
        doubt = "not certain" if diagnosis.complete else "likely so far"
        unsure = f", which {verb_of} {doubt}," if uncertain else ""
        sets = f"With {listed([*added, *uncertain])}{unsure}"
        yield f"{sets} the error on unseen revolutions {verb} from {before} to {after} m/s² rms{floor_text}"
        if grown:
            yield "Do not rely on the effects before the rest of the residual is explained."
    else:
        yield f"The error on unseen revolutions is {after} m/s² rms{floor_text}"


def _is_all_well(diagnosis: Diagnosis) -> bool:
    """Return whether a complete diagnosis has identified no more than terms of the model, and nothing is open."""
    doubts = any(isinstance(note, Reason) and note.code in _IN_SUMMARY for note in diagnosis.notes)
    is_open = diagnosis.unexplained or undecided_sets(diagnosis) or likely(diagnosis) or undetermined(diagnosis)
    only_terms = all(effect_kind(finding.name) is Kind.TERM for finding in diagnosis.named)
    return diagnosis.complete and not diagnosis.taken_from and only_terms and not doubts and not is_open


def _fallen_axes(held_out: HeldOut) -> str:
    """Return the axes on which the error falls, where it does not on all."""
    fallen = [clean(axis.axis) for axis in held_out.axes if axis.before_mps2 > GROWN * axis.after_mps2]
    if not 0 < len(fallen) < len(held_out.axes):
        return ""
    return f", on the {listed(fallen)} {'axis' if len(fallen) == 1 else 'axes'} only,"


def chapters(diagnosis: Diagnosis) -> list[Chapter]:
    """Draw all figures of a diagnosis; a chapter without data is left out."""
    with report_style():
        return [chapter for chapter in _chapters(diagnosis) if chapter.drawings]


def _chapters(diagnosis: Diagnosis) -> Iterator[Chapter]:
    groups = diagnosis.curves
    if groups:
        index = reference_group(groups)
        reference = groups[index]
        label = remark(reference.label)
        chosen = ""
        if len(groups) > 1:
            chosen = f" (of {len(groups)} groups, that with the largest residual relative to its noise)"
        yield Chapter(
            "waveforms",
            "Waveform and residual",
            f"{label}{chosen}. Residual: mean of the measured revolutions minus model. A residual within the band, "
            f"{NOISE_STDS:.0f} standard deviations of the mean's noise, is not significant.",
            "figures",
            [_waveform(diagnosis, reference, axis, label) for axis in recorded_axes(reference)],
        )
        yield Chapter(
            "orders",
            "Order spectrum of the residual",
            f"{label}. Cosine and sine coefficients of measured minus model. Where they span decades, the scale is "
            "linear within the noise and logarithmic above it.",
            "figures",
            [_orders(diagnosis, reference, axis, label) for axis in recorded_axes(reference)],
        )
        others = _spread([group for number, group in enumerate(groups) if number != index], MOST_GROUPS)
        yield Chapter(
            "groups",
            "Residual of the other groups",
            _drawn("Colours and lines as above: dashed before, solid after.", len(others), len(groups) - 1),
            "small-figures",
            [_residual(number, group) for number, group in enumerate(others)],
        )
    yield Chapter(
        "effects-curves",
        "What each effect adds",
        "At the group where it is largest. The band has the errors of all parameters of the effect.",
        "figures",
        [_effect(number, curves) for number, curves in enumerate(diagnosis.effect_curves)],
    )
    yield from _time_locked(diagnosis)
    yield Chapter(
        "trends",
        "Trends of the residual",
        "One point for each group: the residual of its mean with noise power subtracted, and the noise of the mean.",
        "figures",
        [_trend(number, trends) for number, trends in enumerate(_by_quantity(diagnosis.trends))],
    )


def _time_locked(diagnosis: Diagnosis) -> Iterator[Chapter]:
    measured = [spectra for spectra in diagnosis.spectra if bool(np.isfinite(spectra.measured_m2ps3).any())]
    if not measured:
        return
    label = diagnosis.curves[reference_group(diagnosis.curves)].label if diagnosis.curves else measured[0].label
    number = next((number for number, spectra in enumerate(measured) if spectra.label == label), 0)
    others = _spread([spectra for index, spectra in enumerate(measured) if index != number], MOST_SPECTRA)
    yield Chapter(
        "spectra",
        "Signal that does not repeat with the wheel",
        "Spectral density after the mean revolution is subtracted. Vibration, resonances and tones exceed the sensor's "
        "noise.",
        "figures",
        [_spectrum("s", measured[number], diagnosis)],
    )
    yield Chapter(
        "other-spectra",
        "Time-locked spectra of the other groups",
        _drawn("Colours and lines as above.", len(others), len(measured) - 1),
        "small-figures",
        [_spectrum(f"s{index}", spectra, diagnosis, is_small=True) for index, spectra in enumerate(others)],
    )


def _effect(number: int, curves: EffectCurves) -> Drawing:
    title = effect_title(curves.name)
    return _drawing(
        effect_figure(curves),
        f"e{number}",
        f"What {title} adds to each axis, in m/s² over the wheel's angle, with its error.",
        sentence(title),
        f"{remark(curves.label)}.",
    )


def _waveform(diagnosis: Diagnosis, curves: Curves, axis: int, label: str) -> Drawing:
    size = next(axis_residual for axis_residual in residuals(curves) if axis_residual.axis == AXIS_NAMES[axis])
    return _drawing(
        waveform_figure(curves, axis, diagnosis.unexplained),
        f"w{axis}",
        f"{AXIS_NAMES[axis].capitalize()} acceleration and residual in m/s² over the wheel's angle, {label}. "
        f"{_sizes(size)}",
        f"{AXIS_NAMES[axis].capitalize()} acceleration.",
        f"Top: measured mean and models. Middle: residuals before and after. Bottom: residual after, to its own scale. "
        f"Right: within ±{CONTACT_VIEW_DEG:.0f} deg of the contact's centre. {_sizes(size)}",
    )


def _orders(diagnosis: Diagnosis, curves: Curves, axis: int, label: str) -> Drawing:
    has_marks = any(residual.orders is not None for residual in on_axis(diagnosis.unexplained, axis, "angle"))
    return _drawing(
        orders_figure(curves, axis, diagnosis.unexplained),
        f"o{axis}",
        f"Cosine and sine coefficients in m/s² of the {AXIS_NAMES[axis]} residual by order, before and after, {label}.",
        f"{AXIS_NAMES[axis].capitalize()} residual by order.",
        "Bars at the bottom mark unexplained orders." if has_marks else "",
    )


def _residual(index: int, curves: Curves) -> Drawing:
    label = remark(curves.label)
    sizes = "Residual in m/s² rms, before → after (noise of the mean): " + ", ".join(
        f"{size.axis} {significant(size.before_mps2)} → {significant(size.after_mps2)} ({significant(size.noise_mps2)})"
        for size in residuals(curves)
    )
    return _drawing(
        residual_figure(curves), f"g{index}", f"Residuals over the wheel's angle, {label}. {sizes}.", label, sizes
    )


def _spectrum(prefix: str, spectra: Spectra, diagnosis: Diagnosis, *, is_small: bool = False) -> Drawing:
    label = remark(spectra.label)
    return _drawing(
        spectra_figure(spectra, diagnosis.unexplained, small=is_small),
        prefix,
        f"Spectral density in (m/s²)²/Hz over frequency for each axis: measured, sensor noise, with effects; {label}.",
        label,
        "",
    )


def _trend(index: int, trends: Sequence[Trend]) -> Drawing:
    name = clean(split_name(trends[0].against)[0])
    axes = ", ".join(clean(trend.axis) for trend in trends)
    return _drawing(
        trend_figure(trends),
        f"t{index}",
        f"Residual in m/s² rms against {name}, before and after, for the axes {axes}.",
        f"Against {name}.",
        "",
    )


def _drawing(figure: Figure, prefix: str, alt: str, title: str, caption: str) -> Drawing:
    return Drawing(inline_svg(figure, prefix), alt, title, caption)


def _sizes(size: AxisResidual) -> str:
    return (
        f"Residual {significant(size.before_mps2)} m/s² rms before, {significant(size.after_mps2)} after; "
        f"noise of the mean {significant(size.noise_mps2)}."
    )


def _drawn(keys: str, drawn: int, total: int) -> str:
    return keys if drawn == total else f"{keys} {drawn} of {total} groups, evenly spaced."


def _spread(items: list[Any], limit: int) -> list[Any]:
    if len(items) <= limit:
        return items
    return [items[round(position)] for position in np.linspace(0, len(items) - 1, limit)]


def _by_quantity(trends: Sequence[Trend]) -> list[list[Trend]]:
    grouped: dict[str, list[Trend]] = {}
    for trend in trends:
        if trend.at.size:
            grouped.setdefault(trend.against, []).append(trend)
    return list(grouped.values())
