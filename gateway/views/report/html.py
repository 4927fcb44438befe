"""A diagnosis as one HTML file that needs nothing else: tables first, then figures."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from gateway import __version__
from gateway.closure.diagnosis import FAR_OFF, Diagnosis
from gateway.views.numbers import fixed
from gateway.views.output_file import check_target, write_whole
from gateway.views.report.chapters import Chapter, chapters
from gateway.views.report.report_tables import (
    EffectRow,
    ErrorRow,
    EstimateRow,
    StateRows,
    StepRow,
    UnexplainedRow,
    by_state,
    effect_rows,
    error_rows,
    estimate_rows,
    refused_rows,
    steps,
    unexplained_rows,
)
from gateway.views.report.rows import (
    CHANGES,
    GROWN,
    listed,
    model_words,
    nothing_left,
    place_text,
    plain,
    ratio,
    remark_words,
    significant,
    undecided_sets,
)
from gateway.views.report.svg import require_report_packages
from gateway.views.text import clean

if TYPE_CHECKING:
    import jinja2

_PACKAGE: Final = "gateway.views.report"
_TEMPLATE: Final = "closure_report.html.j2"
_STYLE: Final = "closure_report.css"


def write_html(diagnosis: Diagnosis, path: Path, *, force: bool = False) -> None:
    """Write a diagnosis as one self-contained HTML file, whole or not at all.

    Raises:
        OutputError: matplotlib or jinja2 is missing, the file exists and `force` is not set, or it cannot be written.
    """
    check_target(path, force=force)
    write_whole(path, diagnosis_html(diagnosis), force=force)


def diagnosis_html(diagnosis: Diagnosis) -> str:
    """Return a diagnosis as an HTML page without script and without address; the same one gives the same bytes.

    Raises:
        OutputError: matplotlib or jinja2 is missing.
    """
    require_report_packages()
    return _template().render(page=_page(diagnosis))


@cache
def _template() -> jinja2.Template:
    import jinja2

    source = resources.files(_PACKAGE).joinpath(_TEMPLATE).read_text(encoding="utf-8")
    return jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined).from_string(source)


@dataclass(frozen=True, slots=True)
class _Page:
    """What the template shows; all text but `style` and drawings is escaped there."""

    version: str
    style: Any
    wheel: str
    model: str
    facts: str
    answer: str
    folds: str
    errors: list[ErrorRow]
    effects: list[EffectRow]
    refused: list[EffectRow]
    unexplained: list[UnexplainedRow]
    nothing_left: str
    estimates: list[StateRows[EstimateRow]]
    legend: bool
    states: bool
    logarithms: bool
    doubt: str
    step_names: list[str]
    steps: list[StateRows[StepRow]]
    stated: list[str]
    assumed: list[str]
    notes: list[str]
    recordings: list[str]
    chapters: list[Chapter]


def _page(diagnosis: Diagnosis) -> _Page:
    from markupsafe import Markup

    estimates = estimate_rows(diagnosis)
    step_names, step_rows = steps(diagnosis)
    return _Page(
        version=__version__,
        style=Markup(resources.files(_PACKAGE).joinpath(_STYLE).read_text(encoding="utf-8")),  # our own file
        wheel=clean(diagnosis.wheel),
        model=model_words(diagnosis.model),
        facts=_facts(diagnosis),
        answer=" ".join(_answer(diagnosis)),
        folds=_folds(diagnosis),
        errors=error_rows(diagnosis),
        effects=effect_rows(diagnosis),
        refused=refused_rows(diagnosis),
        unexplained=unexplained_rows(diagnosis),
        nothing_left=nothing_left(diagnosis, "Nothing"),
        estimates=by_state(estimates),
        legend=any(row.drawn for row in estimates),
        states=any(row.state for row in estimates),
        logarithms=any(name.endswith("_ln") for finding in diagnosis.findings for name in finding.parameters),
        doubt=_doubt(diagnosis),
        step_names=step_names,
        steps=by_state(step_rows),
        stated=[remark_words(one) for one in diagnosis.stated],
        assumed=[remark_words(one) for one in diagnosis.assumed],
        notes=[remark_words(one) for one in diagnosis.notes],
        recordings=[clean(path) for path in diagnosis.recordings],
        chapters=chapters(diagnosis),
    )


def _facts(diagnosis: Diagnosis) -> str:
    count = len(diagnosis.recordings)
    parts = [
        f"Starting model: {model_words(diagnosis.model)}",
        f"{diagnosis.revolutions} revolutions of {count} recording{'' if count == 1 else 's'}",
    ]
    if diagnosis.rejected:
        parts.append(f"{diagnosis.rejected} left out")
    return " · ".join(parts)


def _folds(diagnosis: Diagnosis) -> str:
    """Return what was held out, and why that is not all where it is not."""
    held_out, used = diagnosis.held_out, diagnosis.revolutions
    text = f"Folds: {held_out.folds} {clean(diagnosis.folds_of)}, each held out in turn; "
    if held_out.revolutions >= used:
        return f"{text}{held_out.revolutions} revolutions in all."
    return (
        f"{text}{held_out.revolutions} of the {used} revolutions in all. The rest was in every fit: of a group of few "
        "revolutions each is a fold, five folds at most are held out, and none that nothing can be fitted without."
    )


def _doubt(diagnosis: Diagnosis) -> str:
    """Return what to think of estimates of a model that still lacks much, empty otherwise."""
    share = ratio(diagnosis.held_out.rms_after_mps2, diagnosis.noise_floor_mps2)
    if not share > FAR_OFF:
        return ""
    return (
        f"The error after is still {fixed(share, 2)} noise floors. Standard errors count what is left as if it were "
        "chance; what the model lacks in earnest may have moved the estimates by more."
    )


def _answer(diagnosis: Diagnosis) -> Iterator[str]:
    """Yield the diagnosis in sentences."""
    held_out, floor = diagnosis.held_out, diagnosis.noise_floor_mps2
    named = [finding.name for finding in diagnosis.named]
    undecided = undecided_sets(diagnosis)
    before, after = significant(held_out.rms_before_mps2), significant(held_out.rms_after_mps2)
    if named:
        yield f"The model lacks {listed(named)}."
    elif not undecided:
        yield "No effect of the catalogue has evidence enough to be named."
    for finding in undecided:
        subject = "it also" if named else "the model"
        if finding.rivals:
            names = listed((finding.name, *finding.rivals), "or")
            yield f"{subject[0].upper()}{subject[1:]} lacks one of {names}; these data cannot tell which."
        else:
            yield f"Whether {subject} lacks {clean(finding.name)} these data cannot tell."
    share = ratio(held_out.rms_after_mps2, floor)
    times = f" ({fixed(share, 2)} times it)" if math.isfinite(share) else ""
    beside = f"beside a noise floor of {significant(floor)} m/s²{times}."
    if named or undecided:
        yield f"With what was added the held-out error goes from {before} to {after} m/s² rms, {beside}"
        if ratio(held_out.rms_after_mps2, held_out.rms_before_mps2) > GROWN:
            yield "It has grown: what was added must not be relied on before the rest is explained."
    else:
        yield f"The held-out error is {after} m/s² rms, {beside}"
    if diagnosis.unexplained:
        first = diagnosis.unexplained[0]
        rest = len(diagnosis.unexplained) - 1
        more = f", and {rest} more" if rest else ""
        size = plain(first.rms_mps2, first.std_mps2)
        doubt = f"; it {CHANGES}" if first.changes else "" if first.lock_known else "; its lock is not known"
        yield f"Unexplained: {clean(first.axis)}, {place_text(first)}, {size} m/s² rms{doubt}{more}."
    else:
        yield f"{nothing_left(diagnosis, 'Nothing else')}."
