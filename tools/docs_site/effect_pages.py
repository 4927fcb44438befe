"""Reference of the effect catalogue."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gateway.closure.effects import base
from gateway.closure.effects.catalogue import catalogue
from tools.docs_site.markdown import code, escaped, sentence, table

_INTRODUCTION: Final = """\
# Effects

The effects that `treadlink diagnose` can name. Each parameter is 0 where the effect is absent. An effect whose fitted
parameters leave the plausible range is rejected.
"""

_KINDS: Final = (
    (base.RingEffect, "Tire", "These effects change the rolling ring that is solved."),
    (base.SignalEffect, "Signal", "These effects add to the signal, locked to the wheel's angle."),
    (base.SpectrumEffect, "Spectrum", "These effects add to the spectrum of what is not locked to the wheel's angle."),
    (base.ScatterEffect, "Scatter", "These effects make revolutions differ from one another."),
)


def effects_markdown() -> str:
    """Return the reference of every effect, by where it acts."""
    lines = [_INTRODUCTION]
    left = dict(catalogue())
    for kind, title, meaning in _KINDS:
        named = [name for name, effect in left.items() if isinstance(effect, kind)]
        lines += [f"## {title}", "", meaning, ""]
        for name in named:
            lines += _effect(left.pop(name))
    assert not left, f"effects of no known kind: {', '.join(left)}"
    return "\n".join(lines).rstrip() + "\n"


def _effect(effect: base.Effect) -> Iterator[str]:
    yield from (f"### {effect.name}", "", escaped(sentence(effect.summary)), "")
    yield from ("```text", effect.equation, "```", "")
    yield from table(
        ("Parameter", "Unit", "Plausible range"),
        ((code(item.name), escaped(item.unit) or "1", f"{item.low:g} to {item.high:g}") for item in effect.parameters),
    )
    yield from (f"**Visible in:** {escaped(sentence(effect.seen_by))}", "")
    yield from (f"**Confounders:** {escaped(sentence(effect.confused_with))}", "")
    if effect.already_in:
        names = ", ".join(sorted(str(model) for model in effect.already_in))
        yield from (f"**Already part of the model:** {names}.", "")
