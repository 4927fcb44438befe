"""Summary of a session: per wheel revolutions, speed, losses and the last estimates with their errors."""

import math
import shutil
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass, field
from itertools import groupby, zip_longest
from textwrap import wrap
from typing import Final, NamedTuple

from gateway.core.constants import AXIS_NAMES
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import (
    AlarmRecord,
    LinkSnapshot,
    RevolutionResult,
    SinkSnapshot,
    WheelCounters,
    WheelSnapshot,
)
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.effect_correction import CorrectionTable
from gateway.core.text.numbers import MISSING, age, duration, fixed, percent, plain_name, show, shown_value, unit_symbol
from gateway.core.text.readout import DISTANCE, SPEED
from gateway.core.text.text import counted, filled, pad, width
from gateway.core.text.wording import joined, text

LINE_WIDTH: Final = 98
"""Columns of a wheel's lines, and two more where a command indents them."""

_Row = tuple[str, str, str]
_GAP: Final = "  "
_NEXT_NAME: Final = ", "
_LABEL_WIDTH: Final = 30
_INDENT: Final = "  "
# Names that the line of a shared reason has; more are counted.
_MAX_NAMES: Final = 2
_LEAST_NOTE: Final = 24
# Last revolutions whose values are those of the end.
_END_REVOLUTIONS: Final = 8


def columns_of_terminal() -> int:
    """Return the columns that a summary has on the terminal: LINE_WIDTH, or fewer where the terminal is narrower."""
    return min(LINE_WIDTH, shutil.get_terminal_size((LINE_WIDTH + 2, 24)).columns - 2)


class Stale(NamedTuple):
    """An estimate that is not the newest.

    Attributes:
        revolution: that it is of, counted from 1.
        reasons: why that of the last revolution is invalid.
    """

    revolution: int
    reasons: tuple[Reason, ...]


@dataclass(slots=True)
class WheelSummary:
    """Summary of one wheel over a whole session or recording.

    Attributes:
        position: wheel.
        counters: of its samples, as last known.
        revolutions: completed.
        revolutions_valid: without a fault.
        faults: number of revolutions with each fault.
        saturated: revolutions with a saturated sample.
        rolling_s: time in completed revolutions.
        missing_s: time of the samples within them that were lost.
        distance_m: 2 pi radius times revolutions.
        speed_min_mps: slowest revolution.
        speed_max_mps: fastest revolution.
        uncorrected: revolutions that known effects were not subtracted from.
        uncorrected_reason: why, of the last such; None when there is none.
        newest: the last estimate of each name.
        usable: the last that was not invalid, with the number of its revolution, counted from 1.
    """

    position: str
    counters: WheelCounters = field(default_factory=WheelCounters)
    revolutions: int = 0
    revolutions_valid: int = 0
    faults: Counter[Reason] = field(default_factory=Counter)
    saturated: int = 0
    rolling_s: float = 0.0
    missing_s: float = 0.0
    distance_m: float = 0.0
    speed_min_mps: float = math.inf
    speed_max_mps: float = -math.inf
    uncorrected: int = 0
    uncorrected_reason: Reason | None = None
    newest: dict[str, Estimate] = field(default_factory=dict)
    usable: dict[str, tuple[int, Estimate]] = field(default_factory=dict)

    @property
    def speed_mean_mps(self) -> float:
        """Distance over time, NaN where there is no time."""
        return self.distance_m / self.rolling_s if self.rolling_s > 0.0 else math.nan

    @property
    def missing_fraction(self) -> float:
        """Share of the samples within completed revolutions that were lost, by time; NaN likewise."""
        return self.missing_s / self.rolling_s if self.rolling_s > 0.0 else math.nan

    @property
    def lost_fraction(self) -> float:
        """Share of the samples that were lost while the sensor was heard; NaN when not known."""
        sent = self.counters.samples + self.counters.lost_while_heard
        return self.counters.lost_while_heard / sent if sent else math.nan

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The last of each name, the last one that was not invalid where there was one."""
        return tuple(self.usable.get(name, (0, estimate))[1] for name, estimate in self.newest.items())

    @property
    def stale(self) -> dict[str, Stale]:
        """Those that are not the newest, which is invalid, by name."""
        return {
            name: Stale(number, self.newest[name].reasons)
            for name, (number, _) in self.usable.items()
            if self.newest[name].status is Status.INVALID and self.revolutions - number >= _END_REVOLUTIONS
        }


class ResultSummary:
    """Accumulates results wheel by wheel in constant memory."""

    def __init__(self) -> None:
        self._wheels: dict[str, WheelSummary] = {}

    def add(self, result: RevolutionResult) -> None:
        """Count one result."""
        wheel = self._wheels.get(result.position)
        if wheel is None:
            wheel = self._wheels[result.position] = WheelSummary(result.position)
        revolution = result.revolution
        wheel.revolutions += 1
        wheel.revolutions_valid += not revolution.faults
        wheel.saturated += revolution.saturated
        if revolution.uncorrected is not None:
            wheel.uncorrected += 1
            wheel.uncorrected_reason = revolution.uncorrected
        if revolution.faults:
            wheel.faults.update(revolution.faults)
        wheel.rolling_s += revolution.period_s
        wheel.missing_s += revolution.missing_fraction * revolution.period_s
        wheel.distance_m += 2.0 * math.pi * result.conditions.radius_m * revolution.turns
        speed_mps = revolution.omega_radps * result.conditions.radius_m
        wheel.speed_min_mps = min(wheel.speed_min_mps, speed_mps)
        wheel.speed_max_mps = max(wheel.speed_max_mps, speed_mps)
        newest, usable, number, invalid = wheel.newest, wheel.usable, wheel.revolutions, Status.INVALID
        for estimate in result.estimates:
            newest[estimate.name] = estimate
            if estimate.status is not invalid:
                usable[estimate.name] = number, estimate

    def wheels(self, states: Iterable[WheelSnapshot] = ()) -> tuple[WheelSummary, ...]:
        """Return the summaries so far, wheels in the order of their first result.

        Args:
            states: last states of the wheels, which count the samples.
        """
        for state in states:
            if state.position in self._wheels:
                self._wheels[state.position].counters = state.counters
        return tuple(self._wheels.values())


def effects_line(wheel: WheelSummary, effects: Sequence[str]) -> str:
    """Return whether a wheel's known effects were subtracted; they hold only where they were found."""
    names, count, uncorrected = ", ".join(effects), wheel.revolutions, wheel.uncorrected
    if wheel.uncorrected_reason is None:
        return f"{wheel.position}: subtracted from its axes: {names}"
    reason = text(wheel.uncorrected_reason)
    if uncorrected == count:
        return f"{wheel.position}: NOT subtracted from its axes: {names}: {reason}"
    return (
        f"{wheel.position}: subtracted from its axes in {count - uncorrected} of {count} revolutions: {names}; "
        f"not in the others: {reason}"
    )


def removed_line(wheel: WheelSummary, table: CorrectionTable) -> str:
    """Return the size of what known effects removed from each axis, at the wheel's mean speed; empty for nothing."""
    if wheel.uncorrected >= wheel.revolutions or not math.isfinite(wheel.speed_mean_mps):
        return ""
    removed = table.contribution_mps2(wheel.speed_mean_mps / table.radius_m)
    sizes = ", ".join(
        f"{axis} {math.sqrt(float(row @ row) / len(row)):.2f}" for axis, row in zip(AXIS_NAMES, removed, strict=True)
    )
    speed = shown_value(SPEED, wheel.speed_mean_mps, 1)
    return f"{wheel.position}: removed at {speed} {unit_symbol(SPEED)}, m/s² rms: {sizes}"


def summary_lines(
    wheels: Iterable[WheelSummary],
    links: Sequence[LinkSnapshot] = (),
    alarms: Sequence[AlarmRecord] = (),
    sinks: Sequence[SinkSnapshot] = (),
    columns: int = LINE_WIDTH,
) -> list[str]:
    """Return a summary as aligned lines: a block for each wheel, the alarms, then a line for each link and output.

    Args:
        wheels: summaries.
        links: last states.
        alarms: of the whole session.
        sinks: live outputs.
        columns: that a wheel's lines may have.
    """
    blocks = [_wheel_lines(wheel, columns) for wheel in wheels] or [["no revolution was completed"]]
    if alarms:
        blocks.append(["alarms", *map(alarm_line, alarms)])
    lines = [line for block in blocks for line in (*block, "")]
    return [*lines, *map(_link_line, links), *map(_sink_line, sinks)] if links else lines[:-1]


def alarm_line(alarm: AlarmRecord) -> str:
    """Return what was wrong, when and for how long."""
    end = "the end" if alarm.is_standing else f"{fixed(alarm.last_s, 1)} s"
    times = f"from {fixed(alarm.first_s, 1)} s to {end}"
    if alarm.count > 1:
        times = f"{alarm.count} times {times}, {age(alarm.total_s)} in all"
    return f"  {alarm.position} {alarm.name}: {times}: {text(alarm.reason)}"


def _wheel_lines(wheel: WheelSummary, columns: int) -> list[str]:
    rows: list[_Row] = [("revolutions", str(wheel.revolutions), _revolutions_note(wheel))]
    rows.append(_mean_speed_row(wheel))
    elapsed = f"in {duration(wheel.rolling_s) if wheel.rolling_s >= 60 else fixed(wheel.rolling_s, 2) + ' s'}"
    distance = next((show(estimate) for estimate in wheel.estimates if estimate.name == DISTANCE), None)
    if distance is None:
        rows.append(("distance", f"{fixed(wheel.distance_m, 1)} m", elapsed))
    elif distance.status is Status.INVALID:
        rows.append(("distance", MISSING, f"{elapsed}; invalid: {distance.reason}"))
    elif (stale := wheel.stale.get(DISTANCE)) is not None:
        rows.append(
            (
                "distance",
                f"{fixed(wheel.distance_m, 1)} m",
                f"{elapsed}; invalid since revolution {stale.revolution + 1}: {joined(stale.reasons)}",
            )
        )
    else:
        rows.append(("distance", distance.text(), "; ".join(filter(None, (elapsed, distance.reason)))))
    rows.append(("samples lost", _percent_text(wheel.lost_fraction), _samples_note(wheel)))
    estimate_rows, common_notes = _estimate_rows(wheel)
    all_rows = (*rows, *estimate_rows)
    words = max(width(word) for label, _, _ in all_rows for word in label.split())
    label_width = max(min(max(width(label) for label, _, _ in all_rows), _LABEL_WIDTH, columns // 3), words)
    value_width = max(width(value) for _, value, _ in all_rows)
    note_width = max(columns - label_width - value_width - len(_INDENT) - 2 * len(_GAP), _LEAST_NOTE)
    blocks = [_row_lines(row, label_width, value_width, note_width) for row in all_rows]
    lines = [[line for block in part for line in block] for part in (blocks[: len(rows)], blocks[len(rows) :])]
    lines.append([f"{_INDENT}{line}" for note in common_notes for line in _hanging(note, columns - len(_INDENT))])
    heads: tuple[list[str], ...] = ([], [f"{_INDENT}at the end:"], [f"{_INDENT}of several numbers:"])
    return [wheel.position, *(line for head, part in zip(heads, lines, strict=True) if part for line in (*head, *part))]


def _mean_speed_row(wheel: WheelSummary) -> _Row:
    """Return the mean speed with its span, and with the status of the speed; why is said where the speed stands."""
    speed = next((estimate for estimate in wheel.estimates if estimate.name == SPEED), None)
    if speed is not None and speed.status is Status.INVALID:
        return "mean speed", MISSING, "invalid"
    unit = unit_symbol(SPEED)
    note = f"{shown_value(SPEED, wheel.speed_min_mps, 2)} to {shown_value(SPEED, wheel.speed_max_mps, 2)} {unit}"
    if (stale := wheel.stale.get(SPEED)) is not None:
        note = f"{note}; invalid since revolution {stale.revolution + 1}"
    elif speed is not None and speed.status is Status.PROVISIONAL:
        note = f"{note}; provisional"
    return "mean speed", f"{shown_value(SPEED, wheel.speed_mean_mps, 3)} {unit}", note


def _row_lines(row: _Row, label_width: int, value_width: int, note_width: int) -> list[str]:
    """Return a row of label, value and note as one line, as more where label or note do not fit their columns."""
    label, value, note = row
    notes = (
        wrap(note, note_width, break_long_words=False, break_on_hyphens=False) if width(note) > note_width else [note]
    )
    lines = zip_longest(filled(label.split(), label_width), [value], notes, fillvalue="")
    return [
        f"{_INDENT}{pad(label_line, label_width)}{_GAP}{pad(value_line, value_width)}{_GAP}{note_line}".rstrip()
        for label_line, value_line, note_line in lines
    ]


def _hanging(note: str, columns: int) -> list[str]:
    """Return a note as lines, those behind the first indented."""
    return wrap(note, columns, subsequent_indent=_INDENT, break_long_words=False, break_on_hyphens=False)


class _Group(NamedTuple):
    """Neighbours with the same status and reasons."""

    status: Status
    reasons: tuple[Reason, ...]
    stale: Stale | None
    estimates: list[Estimate]

    @property
    def texts(self) -> list[str]:
        """Reasons in words, each once; those of a stale group stand with its revolution."""
        return [] if self.stale is not None else list(dict.fromkeys(map(text, self.reasons)))

    @property
    def names(self) -> list[str]:
        """Plain names."""
        return [plain_name(estimate.name) for estimate in self.estimates]


def _groups(wheel: WheelSummary) -> list[_Group]:
    stales = wheel.stale

    def group_key(estimate: Estimate) -> tuple[Status, tuple[Reason, ...], Stale | None]:
        return estimate.status, estimate.reasons, stales.get(estimate.name)

    others = [estimate for estimate in wheel.estimates if estimate.name != DISTANCE]
    return [_Group(*key, list(group)) for key, group in groupby(others, group_key)]


def _estimate_rows(wheel: WheelSummary) -> tuple[list[_Row], list[str]]:
    """Return (label, value, note) of each estimate, and the reasons of several, each with their names.

    Neighbours that are invalid for one reason share a row, as neighbours with equal notes share one.
    """
    groups = _groups(wheel)
    counts = Counter(phrase for group in groups for phrase in group.texts)
    names_by_phrase = {
        phrase: [name for group in groups if phrase in group.texts for name in group.names]
        for phrase, count in counts.items()
        if count > 1
    }
    rows: list[_Row] = []
    for group in groups:
        note = _note(group, names_by_phrase, wheel.revolutions)
        if group.status is Status.INVALID:
            rows.append((_NEXT_NAME.join(group.names), MISSING, note))
            continue
        repeated = "as above" if group.stale is not None else "" if group.status is Status.VALID else str(group.status)
        for index, (name, quantity) in enumerate(zip(group.names, map(show, group.estimates), strict=True)):
            value = f"{quantity.number.joined()} {quantity.unit}".rstrip()
            rows.append((name, value, repeated if index else note))
    return rows, [f"{_first_names(names)}: {phrase}" for phrase, names in names_by_phrase.items()]


def _note(group: _Group, common_phrases: Collection[str], revolutions: int) -> str:
    """Return status and reasons of a group, without those that several groups have."""
    if group.stale is not None:
        since = f"of revolution {group.stale.revolution} of {revolutions}, invalid since"
        return f"{since}: {joined(group.stale.reasons)}"
    word = "" if group.status is Status.VALID else str(group.status)
    note = "; ".join(phrase for phrase in group.texts if phrase not in common_phrases)
    if word and note:
        return f"{word}: {note}"
    return f"{word}, see below" if word and group.texts else word or note


def _first_names(names: Sequence[str]) -> str:
    """Return the first names, and how many more there are."""
    omitted = len(names) - _MAX_NAMES
    return ", ".join(names[:_MAX_NAMES]) + f" and {omitted} more" if omitted > 1 else ", ".join(names)


def _percent_text(fraction: float) -> str:
    if math.isnan(fraction):
        return MISSING
    return "0 %" if fraction == 0 else f"{fixed(fraction, 3, 100.0)} %"


def _samples_note(wheel: WheelSummary) -> str:
    """Return the share lost of the samples of completed revolutions, if not that of all, silence and what saturated."""
    missing = _percent_text(wheel.missing_fraction)
    saturated = f"{counted(wheel.saturated, 'revolution')} saturated" if wheel.saturated else ""
    note = f"{missing} within completed revolutions" if missing != _percent_text(wheel.lost_fraction) else ""
    silent = f"besides {age(wheel.counters.silent_s)} of silence" if wheel.counters.silent_s else ""
    return "; ".join(filter(None, (note, silent, saturated)))


def _revolutions_note(wheel: WheelSummary) -> str:
    if wheel.revolutions_valid == wheel.revolutions:
        return "none with a fault"
    faults = ", ".join(f"{count} x {text(fault)}" for fault, count in wheel.faults.most_common())
    return f"{wheel.revolutions_valid} without a fault; {faults}"


def _sink_line(sink: SinkSnapshot) -> str:
    """Return what a live output has published; the reason is given when it did not end as it should."""
    counts = f"{sink.sink}: {sink.published} published, {sink.dropped} dropped"
    return counts if sink.note.code is CoreCode.SINK_CLOSED else f"{counts}; {text(sink.note)}"


def _link_line(link: LinkSnapshot) -> str:
    expected = link.frames + link.frames_lost
    parts = [f"{link.frames} frames", f"{link.frames_lost} lost ({percent(link.frames_lost, expected)})"]
    counted = {
        "bad CRC": link.crc_errors,
        "duplicate": link.duplicates,
        "reordered": link.reordered,
        "skipped": link.skipped,
        "noise bytes": link.noise_bytes,
        **link.judged,
        **{f"dropped by {stage}": count for stage, count in link.queue_dropped.items()},
    }
    return f"{link.link}: " + ", ".join([*parts, *(f"{count} {name}" for name, count in counted.items() if count)])
