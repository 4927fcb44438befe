"""A diagnosis in about ten lines for the terminal."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

from gateway.closure.diagnosis import Diagnosis, Finding, Verdict
from gateway.views.closure_rows import model_words, place_text, plain, ratio, show_fitted, significant
from gateway.views.numbers import fixed
from gateway.views.text import clean, crop, pad, width

LINE_WIDTH: Final = 80

_INDENT: Final = "  "
_LABEL_WIDTH: Final = 13
_MOST_NAMED: Final = 4
_MOST_OTHERS: Final = 2
_MOST_NOTES: Final = 2
# What the user came for, in this order; the rest is in the report.
_ESTIMATES: Final = ("Bs", "Cw", "Rs", "Ts")


def closure_summary_lines(diagnosis: Diagnosis) -> list[str]:
    """Return a diagnosis as plain lines of at most LINE_WIDTH columns, without escape codes."""
    return [crop(line.rstrip(), LINE_WIDTH) for line in _lines(diagnosis)]


def _lines(diagnosis: Diagnosis) -> Iterator[str]:
    held_out, floor = diagnosis.held_out, diagnosis.noise_floor_mps2
    used = f"{diagnosis.revolutions} revolutions of {_count(len(diagnosis.recordings), 'recording')}"
    left_out = f", {diagnosis.rejected} left out" if diagnosis.rejected else ""
    wheel = crop(clean(diagnosis.wheel), 16)
    yield f"{wheel}: {model_words(diagnosis.model)} against {used}{left_out}"
    yield _row(
        "held-out rms",
        f"{fixed(held_out.rms_before_mps2, 2)} m/s² before, {fixed(held_out.rms_after_mps2, 2)} m/s² after",
    )
    share = ratio(held_out.rms_after_mps2, floor)
    yield _row("noise floor", f"{fixed(floor, 2)} m/s²; after / floor {fixed(share, 2)}")
    yield from _named(diagnosis.named)
    yield from _undecided([one for one in diagnosis.findings if one.verdict is Verdict.INDISTINGUISHABLE])
    yield from _unexplained(diagnosis)
    yield from _estimates(diagnosis)
    for index, note in enumerate(diagnosis.notes[:_MOST_NOTES]):
        more = len(diagnosis.notes) - _MOST_NOTES
        last = f" (and {more} more)" if more > 0 and index == _MOST_NOTES - 1 else ""
        yield _row("note", clean(note), last)


def _named(named: tuple[Finding, ...]) -> Iterator[str]:
    if not named:
        yield _row("named", "nothing: no effect of the catalogue has evidence enough")
    for index, finding in enumerate(named[:_MOST_NAMED]):
        more = len(named) - _MOST_NAMED
        size = f"  {significant(finding.rms_mps2)} m/s²"
        if more > 0 and index == _MOST_NAMED - 1:
            size += f" (and {more} more)"
        numbers = [show_fitted(name, fitted) for name, fitted in finding.parameters.items()]
        # One parameter needs no label.
        cells = [one.joined() if len(numbers) == 1 else f"{one.label} {one.joined()}" for one in numbers]
        text = ": ".join(filter(None, (clean(finding.name), ", ".join(cells).replace(" ± ", "±"))))
        yield _row("named" if index == 0 else "", text, size)


def _undecided(undecided: list[Finding]) -> Iterator[str]:
    # Every rival is a finding too: one line for each set of them.
    sets: dict[frozenset[str], Finding] = {}
    for finding in undecided:
        sets.setdefault(frozenset({finding.name, *finding.rivals}), finding)
    for finding in list(sets.values())[:_MOST_OTHERS]:
        names = " or ".join(map(clean, (finding.name, *finding.rivals)))
        yield _row("undecided", names)
        if finding.decide_with:
            yield _row("", f"to decide: {clean(finding.decide_with)}")


def _unexplained(diagnosis: Diagnosis) -> Iterator[str]:
    if not diagnosis.unexplained:
        yield _row("unexplained", "nothing above the noise")
    for index, left in enumerate(diagnosis.unexplained[:_MOST_OTHERS]):
        more = len(diagnosis.unexplained) - _MOST_OTHERS
        size = f"  {plain(left.rms_mps2, left.std_mps2)} m/s²"
        if more > 0 and index == _MOST_OTHERS - 1:
            size += f" (and {more} more)"
        text = f"{clean(left.axis)}, {place_text(left)}"
        yield _row("unexplained" if index == 0 else "", text, size)


def _estimates(diagnosis: Diagnosis) -> Iterator[str]:
    before, after = diagnosis.estimates_before, diagnosis.estimates_after
    cells = []
    for name in (name for name in _ESTIMATES if name in after):
        old, new = show_fitted(name, before.get(name)), show_fitted(name, after[name])
        mark = "" if diagnosis.determined.get(name, True) else " (not determined)"
        cells.append(f"{new.label} {old.text} -> {new.joined()}{mark}".replace(" ± ", "±"))
    label = "estimates"
    while cells:
        line = cells.pop(0)
        while cells and width(line) + 2 + width(cells[0]) <= LINE_WIDTH - len(_INDENT) - _LABEL_WIDTH:
            line += "  " + cells.pop(0)
        yield _row(label, line)
        label = ""


def _row(label: str, text: str, tail: str = "") -> str:
    """Return a line; when it is too long its text is cropped, never its tail."""
    room = LINE_WIDTH - len(_INDENT) - _LABEL_WIDTH - width(tail)
    return _INDENT + pad(label, _LABEL_WIDTH) + crop(text, room) + tail


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" + ("" if number == 1 else "s")
