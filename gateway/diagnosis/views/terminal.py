"""A diagnosis in about ten lines of text."""

from collections.abc import Iterator, Sequence
from typing import Final

from gateway.core.reasons import Reason
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.core.shown_units import shown_in
from gateway.core.text.numbers import fixed
from gateway.core.text.text import clean, counted, crop, filled, pad, width
from gateway.diagnosis.data.campaign_data import Remark
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Diagnosis, Finding
from gateway.diagnosis.views.phrases import (
    GROWN,
    NON_STATIONARY,
    SINGLE_TURNS,
    decisively_rejected,
    drift_texts,
    effect_title,
    effects_listed,
    likely,
    listed,
    model_words,
    no_residual,
    place_text,
    reason_text,
    remark,
    self_test_text,
    single_turns,
    undecided_sets,
    undetermined,
    why_undetermined,
)
from gateway.diagnosis.views.quantities import plain, ratio, show_fitted, significant
from gateway.diagnosis.views.report_tables import bounded_probability
from gateway.diagnosis.views.transfer_report import axis_lines

LINE_WIDTH: Final = 80
MOST_WIDE: Final = 120
"""Lines that are longer are hard to read."""

_INDENT: Final = "  "
_LABEL_WIDTH: Final = 13
_MOST_NAMED: Final = 4
_MOST_OTHERS: Final = 2
_MOST_NOTES: Final = 2
_DECISIVE: Final = frozenset(
    {
        DiagnosisCode.CONTACTS_CONTRADICT,
        DiagnosisCode.ERROR_BY_MISSING_EFFECT,
        DiagnosisCode.ERROR_BY_POSSIBLE_EFFECT,
        DiagnosisCode.LOADS_CONTRADICT,
        DiagnosisCode.OTHER_OPTIMUM,
        DiagnosisCode.RECORDING_LEFT_OUT,
        DiagnosisCode.SENSOR_ALARM,
        DiagnosisCode.SENSOR_IN_DOUBT,
    }
)


def closure_summary_lines(diagnosis: Diagnosis, columns: int = LINE_WIDTH, *, has_all_notes: bool = False) -> list[str]:
    """Return a diagnosis as plain lines of at most `columns` columns, LINE_WIDTH at least, without escape codes.

    Args:
        diagnosis: the result.
        columns: width of the terminal.
        has_all_notes: whether to print every note, as in a file; else those that bear on the result and a few others,
            and the number of the rest.
    """
    columns = max(LINE_WIDTH, min(columns, MOST_WIDE))
    with shown_in(diagnosis.units):
        return [crop(line.rstrip(), columns) for line in _Lines(columns, has_all_notes).of(diagnosis)]


class _Lines:
    """Formats a diagnosis as lines of a width."""

    def __init__(self, columns: int, has_all_notes: bool) -> None:
        self._room = columns - len(_INDENT) - _LABEL_WIDTH
        self._has_all_notes = has_all_notes

    def of(self, diagnosis: Diagnosis) -> Iterator[str]:
        held_out, floor = diagnosis.held_out, diagnosis.noise_floor_mps2
        used = f"{diagnosis.revolutions} revolutions of {counted(len(diagnosis.recordings), 'recording')}"
        left_out = f", {diagnosis.rejected} left out" if diagnosis.rejected else ""
        wheel = crop(clean(diagnosis.wheel), 16)
        yield f"{wheel}: {model_words(diagnosis.model)} against {used}{left_out}"
        grown = ratio(held_out.rms_after_mps2, held_out.rms_before_mps2) > GROWN
        before, after = fixed(held_out.rms_before_mps2, 2), fixed(held_out.rms_after_mps2, 2)
        yield self._row("held-out rms", f"{before} m/s² before, {after} m/s² after{' (increased)' if grown else ''}")
        share = ratio(held_out.rms_after_mps2, floor)
        yield from axis_lines(held_out)
        yield self._row("noise floor", f"{fixed(floor, 2)} m/s²; after / noise floor {fixed(share, 2)}")
        undecided = undecided_sets(diagnosis)
        yield from self._named(diagnosis, bool(undecided))
        yield from self._undecided(undecided)
        yield from self._likely(likely(diagnosis), diagnosis.complete)
        yield from self._rejected(decisively_rejected(diagnosis))
        yield from self._unexplained(diagnosis)
        yield from self._estimates(diagnosis)
        if diagnosis.self_test is not None:
            yield from self._rows("self-test", self_test_text(diagnosis.self_test))
        yield from self._notes(diagnosis.notes)

    def _notes(self, notes: Sequence[Remark]) -> Iterator[str]:
        decisive = sum(_is_decisive(note) for note in notes)
        selected = sorted(notes, key=lambda note: not _is_decisive(note))
        if not self._has_all_notes:
            selected = selected[: max(decisive, _MOST_NOTES)]
        for note in selected:
            yield from self._rows("note", remark(note))
        if len(selected) < len(notes):
            yield from self._rows(
                "", f"and {counted(len(notes) - len(selected), 'more note')}: all are in --json and --html"
            )

    def _named(self, diagnosis: Diagnosis, undecided: bool) -> Iterator[str]:
        named = diagnosis.named
        if not named:
            reason = "these data do not decide" if undecided else "no effect has sufficient evidence"
            if not diagnosis.complete:
                reason = "the search ended before it was complete"
            yield self._row("identified", f"nothing: {reason}")
        for index, finding in enumerate(named[:_MOST_NAMED]):
            more = len(named) - _MOST_NAMED
            size = f"  {significant(finding.rms_mps2)} m/s²"
            if more > 0 and index == _MOST_NAMED - 1:
                size += f" (and {more} more)"
            numbers = [show_fitted(name, fitted) for name, fitted in finding.parameters.items()]
            # One parameter needs no label.
            cells = [
                number.joined() if len(numbers) == 1 else f"{number.label} {number.joined()}" for number in numbers
            ]
            cells = [cell.replace(" ± ", "±") for cell in cells]
            text = _first_of(f"{effect_title(finding.name)}: ", cells, self._room - width(size))
            yield self._row("identified" if index == 0 else "", text, size)

    def _undecided(self, undecided: Sequence[Finding]) -> Iterator[str]:
        for finding in undecided[:_MOST_OTHERS]:
            yield self._row("undecided", effects_listed((finding.name, *finding.rivals), "or"))
            if finding.decide_with is not None:
                yield from self._rows("", f"to decide: {reason_text(finding.decide_with)}")

    def _likely(self, uncertain: Sequence[Finding], is_complete: bool) -> Iterator[str]:
        if uncertain:
            names = [
                f"{effect_title(finding.name)} (probability {bounded_probability(finding.probability)})"
                for finding in uncertain
            ]
            label, reason = ("not certain", "not identified") if is_complete else ("so far", "others are untried")
            yield from self._rows(label, f"{listed(names)}: in the error after, but {reason}")

    def _rejected(self, findings: Sequence[Finding]) -> Iterator[str]:
        for finding in findings[:_MOST_OTHERS]:
            if finding.reason is not None:
                yield from self._rows("rejected", f"{effect_title(finding.name)}: {reason_text(finding.reason)}")

    def _unexplained(self, diagnosis: Diagnosis) -> Iterator[str]:
        if not diagnosis.unexplained:
            yield from self._rows("unexplained", no_residual(diagnosis))
        for index, residual in enumerate(diagnosis.unexplained[:_MOST_OTHERS]):
            more = len(diagnosis.unexplained) - _MOST_OTHERS
            size = f"  {plain(residual.rms_mps2, residual.std_mps2)} m/s²".replace(" ± ", "±")
            if more > 0 and index == _MOST_OTHERS - 1:
                size += f" (+{more})"
            text = f"{clean(residual.axis)}, {place_text(residual)}"
            yield self._row("unexplained" if index == 0 else "", text, size)
            if residual.lock in SINGLE_TURNS:
                yield from self._rows("", single_turns(residual))
            elif residual.drifts:
                first, *others = drift_texts(residual)
                yield from self._rows("", f"{first} (+{len(others)})" if others else first)
            elif residual.changes or not residual.lock_known:
                yield self._row("", NON_STATIONARY if residual.changes else "time-locked or angle-locked: not known")

    def _estimates(self, diagnosis: Diagnosis) -> Iterator[str]:
        before, after = diagnosis.estimates_before, diagnosis.estimates_after
        names = [name for name in RING_NUMBERS if name in after]
        cells = []
        for name in names:
            old, new = show_fitted(name, before.get(name)), show_fitted(name, after[name])
            cells.append(f"{new.label} {old.text} -> {new.joined()}".replace(" ± ", "±"))
        label = "estimates"
        for line in filled(cells, self._room, "   "):
            yield self._row(label, line)
            label = ""
        if doubtful := [name for name in undetermined(diagnosis) if name in names]:
            reason = why_undetermined(diagnosis, doubtful)
            yield from self._rows(label, f"not determined: {', '.join(doubtful)} ({reason})")

    def _row(self, label: str, text: str, tail: str = "") -> str:
        """Return a line; when it is too long its text is cropped, never its tail."""
        return _INDENT + pad(label, _LABEL_WIDTH) + crop(text, self._room - width(tail)) + tail

    def _rows(self, label: str, text: str) -> Iterator[str]:
        """Yield a text in as many lines as it needs, broken between words."""
        while text:
            line, text = _broken(text, self._room)
            yield self._row(label, line)
            label = ""


def _first_of(start: str, cells: Sequence[str], room: int) -> str:
    """Return as many whole cells as fit, and the number of the others."""
    for count in range(len(cells), 0, -1):
        text, omitted = f"{start}{', '.join(cells[:count])}", len(cells) - count
        for tail in (f" and {counted(omitted, 'more parameter')}", f" and {omitted} more") if omitted else ("",):
            if width(text + tail) <= room:
                return text + tail
    return f"{start}{counted(len(cells), 'parameter')}" if cells else start.removesuffix(": ")


def _broken(text: str, room: int) -> tuple[str, str]:
    """Return the words that fit, and the rest; of a word that is too long, such as a path, what fits."""
    if width(text) <= room:
        return text, ""
    words, first = text.split(" "), ""
    while words and width(f"{first} {words[0]}".lstrip()) <= room:
        first = f"{first} {words.pop(0)}".lstrip()
    if first:
        return first, " ".join(words)
    cut = next(cut for cut in range(len(text), 0, -1) if width(text[:cut]) <= room)
    return text[:cut], text[cut:]


def _is_decisive(note: Remark) -> bool:
    """Return whether a note says that the result may be wrong, or belongs to fewer recordings than were given."""
    reason = note["reason"] if isinstance(note, Reason) and note.code is DiagnosisCode.ABOUT_RECORDING else note
    return isinstance(reason, Reason) and reason.code in _DECISIVE
