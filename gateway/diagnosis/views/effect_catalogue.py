"""Listing of the effect catalogue: text for a terminal, JSON, and the Markdown of its reference page."""

import re
import textwrap
import unicodedata
from collections.abc import Iterable, Iterator
from itertools import groupby
from typing import Any, Final

from gateway.core.constants import AXIS_NAMES
from gateway.diagnosis.bayes.parameter_estimates import fitted_parameter
from gateway.diagnosis.effects.catalogue import candidates, catalogue, group_of
from gateway.diagnosis.effects.effect import (
    BaselineModel,
    Confounder,
    Effect,
    Parameter,
    RingEffect,
    ScatterEffect,
    SignalEffect,
    SpectrumEffect,
)
from gateway.diagnosis.views.quantities import show_fitted, typeset

_INDENT: Final = "    "
_LABEL_WIDTH: Final = 17
_MIN_WIDTH: Final = 60
_MAX_WIDTH: Final = 120
# Kind in JSON, and what the effect changes.
_KINDS: Final[tuple[tuple[type[Effect], str, str], ...]] = (
    (RingEffect, "ring", "shape of the ring, locked to the wheel"),
    (SignalEffect, "signal", "signal, locked to the wheel"),
    (SpectrumEffect, "spectrum", "non-synchronous vibration"),
    (ScatterEffect, "scatter", "differences between revolutions"),
)
_MARKDOWN_SPECIAL: Final = re.compile(r"([|*_<>\[\]])")
_INTRODUCTION: Final = """\
# Effects

`treadlink diagnose` traces the difference between recordings and a model of the tire to the effects on this page. The
same list is printed by `treadlink diagnose --list-effects`.

The name in code style is the key of an effect in reports and files. A parameter outside its plausible range
disqualifies an effect. Similarity is the cosine between the waveforms of an effect and of its confounder: at 1 or -1
these data do not separate them. The baseline models are those that lack the effect, so that it is a candidate there.
"""


def find_effects(part: str = "") -> list[Effect]:
    """Return the effects whose name or title contains a text, else those whose summary does, by group; all if empty."""
    needle = part.casefold()
    matches = [e for e in catalogue().values() if needle in e.name.casefold() or needle in e.title.casefold()]
    # A user knows the damage, such as a nail, and not what the model calls its effect.
    matches = matches or [e for e in catalogue().values() if needle in e.summary.casefold()]
    groups = list(dict.fromkeys(group_of(effect) for effect in catalogue().values()))
    return sorted(matches, key=lambda effect: groups.index(group_of(effect)))


def effect_lines(effects: Iterable[Effect], columns: int) -> Iterator[str]:
    """Yield the description of effects as plain lines of at most `columns` columns, grouped by physics."""
    width = max(_MIN_WIDTH, min(columns, _MAX_WIDTH))
    group = ""
    for effect in effects:
        if group_of(effect) != group:
            group = group_of(effect)
            yield group.upper()
            yield ""
        title = effect.display_title
        yield f"  {title}" + (f" (key: {effect.name})" if title != effect.name else "")
        yield from _wrapped(typeset(effect.summary), width, _INDENT)
        for label, text in _rows(effect):
            yield from _wrapped(text, width, f"{_INDENT}{label:<{_LABEL_WIDTH}}")
        yield ""


def _wrapped(text: str, width: int, start: str) -> list[str]:
    indent = " " * len(start)
    return textwrap.wrap(text, width, initial_indent=start, subsequent_indent=indent, break_on_hyphens=False)


def effects_json(effects: Iterable[Effect]) -> list[dict[str, Any]]:
    """Return the description of effects as JSON values; parameters in SI units and in those of display."""
    return [
        {
            "name": effect.name,
            "title": effect.display_title,
            "group": group_of(effect),
            "kind": _kind(effect)[0],
            "summary": effect.summary,
            "equation": effect.equation,
            "source": effect.source,
            "parameters": [_parameter_json(parameter) for parameter in effect.parameters],
            "axes": [AXIS_NAMES[axis] for axis in effect.axes],
            "observed_in": effect.observed_in,
            "confounders": [
                {
                    "names": list(confounder.names),
                    "similarity": confounder.similarity,
                    "distinction": confounder.distinction,
                }
                for confounder in effect.confounders
            ],
            "baseline_models": _baseline_models(effect),
        }
        for effect in effects
    ]


def effects_markdown() -> str:
    """Return the reference page of all effects."""
    lines = [_INTRODUCTION]
    for group, effects in groupby(find_effects(), key=group_of):
        members = list(effects)
        lines += [f"## {_heading(group)}", "", "| Effect | Physics |", "|---|---|"]
        lines += [f"| {_link(effect.name)} | {_escaped(typeset(effect.summary))} |" for effect in members]
        lines.append("")
        for effect in members:
            lines += [*_section(effect), ""]
    return "\n".join(lines).rstrip() + "\n"


def _section(effect: Effect) -> Iterator[str]:
    """Yield the Markdown lines of one effect."""
    yield f"### {_heading(effect.display_title)}"
    yield ""
    yield f"`{effect.name}`: {_escaped(typeset(effect.summary))}"
    yield ""
    yield "```text"
    yield from textwrap.wrap(typeset(effect.equation), _MAX_WIDTH)
    yield "```"
    yield ""
    yield f"- Source: {_escaped(typeset(effect.source))}"
    yield f"- Acts on: {_acts_on(effect)}"
    yield f"- Visible in: {_escaped(typeset(effect.observed_in))}"
    yield f"- Baseline models: {', '.join(f'`{model}`' for model in _baseline_models(effect))}"
    yield ""
    yield "| Parameter | Plausible range |"
    yield "|---|---|"
    for parameter in effect.parameters:
        label, limits = _range(parameter)
        yield f"| {_escaped(label)} | {_escaped(limits)} |"
    yield ""
    yield "| Confused with | Similarity | Distinction |"
    yield "|---|---|---|"
    for confounder in effect.confounders:
        names = ", ".join(_link(name) if name in catalogue() else _escaped(typeset(name)) for name in confounder.names)
        similarity, data = _escaped(typeset(confounder.similarity)), _escaped(typeset(confounder.distinction))
        yield f"| {names} | {similarity or '—'} | {data or '—'} |"


def _rows(effect: Effect) -> Iterator[tuple[str, str]]:
    """Yield label and text of what the terminal shows of one effect."""
    yield "Equation", typeset(effect.equation)
    yield "Source", typeset(effect.source)
    for index, parameter in enumerate(effect.parameters):
        label, limits = _range(parameter)
        yield "" if index else "Parameters", f"{label}: {limits}"
    yield "Acts on", _acts_on(effect)
    yield "Visible in", typeset(effect.observed_in)
    yield "Baseline models", ", ".join(_baseline_models(effect))
    for index, confounder in enumerate(effect.confounders):
        yield "" if index else "Confused with", typeset(_confounder_text(confounder))


def _confounder_text(confounder: Confounder) -> str:
    names = [catalogue()[name].display_title if name in catalogue() else name for name in confounder.names]
    similarity = f" (similarity {confounder.similarity})" if confounder.similarity else ""
    return f"{', '.join(names)}{similarity}" + (
        f". Distinction: {confounder.distinction}" if confounder.distinction else ""
    )


def _kind(effect: Effect) -> tuple[str, str]:
    return next((kind, text) for base, kind, text in _KINDS if isinstance(effect, base))


def _acts_on(effect: Effect) -> str:
    return f"{', '.join(AXIS_NAMES[axis] for axis in effect.axes)}; {_kind(effect)[1]}"


def _baseline_models(effect: Effect) -> list[str]:
    """Return the baseline models that lack an effect and can take it."""
    return [str(model) for model in BaselineModel if effect.name in candidates(model)]


def _range(parameter: Parameter) -> tuple[str, str]:
    """Return label and plausible range of a parameter in the unit that reports show."""
    high = show_fitted(parameter.name, fitted_parameter(parameter, parameter.high, 0.0))
    if parameter.inverse_display is not None and parameter.low <= 0.0:
        # The inverse of 0 is an effect that is absent.
        return high.label, f"{_number(high.value)} {high.unit} or more"
    low = show_fitted(parameter.name, fitted_parameter(parameter, parameter.low, 0.0))
    return high.label, f"{_number(low.value)} to {_number(high.value)} {high.unit}".rstrip()


def _parameter_json(parameter: Parameter) -> dict[str, Any]:
    label, limits = _range(parameter)
    return {
        "name": parameter.name,
        "unit": parameter.unit,
        "low": parameter.low,
        "high": parameter.high,
        "label": label,
        "range": limits,
    }


def _number(value: float) -> str:
    """Return a limit with three significant digits and no more zeros than it needs."""
    return f"{float(f'{value:.3g}'):g}"


def _heading(text: str) -> str:
    return text[:1].upper() + text[1:]


def _link(name: str) -> str:
    """Return a link to the section of an effect."""
    title = catalogue()[name].display_title
    return f"[{_escaped(title)}](#{_slug(title)})"


def _slug(heading: str) -> str:
    """Return the anchor that Python-Markdown gives a heading."""
    plain = unicodedata.normalize("NFKD", heading).encode("ascii", "ignore").decode("ascii")
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", plain).strip().lower())


def _escaped(text: str) -> str:
    """Return text in which Markdown finds nothing to format."""
    return _MARKDOWN_SPECIAL.sub(r"\\\1", text)
