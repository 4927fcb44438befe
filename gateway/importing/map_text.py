"""Text of a first import map."""

import json
import re
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, NamedTuple

from gateway.core.config.toml_writer import toml_string
from gateway.core.config.vehicle import ASSUMED_RADIUS_MM
from gateway.importing.columns import FileFacts
from gateway.importing.guessed_columns import (
    MOST_COLUMNS,
    SCALED_UNITS,
    VOLTS,
    Axis,
    Guess,
    by_wheel,
    names_role,
    ordered_axes,
    position_of,
)
from gateway.importing.import_map import ISO, REFERENCE_UNITS, FileLayout


def map_text(path: Path, layout: FileLayout, guess: Guess, facts: FileFacts) -> str:
    """Return what was recognised in a file as a map in TOML, with doubts as comments marked by `?`."""
    conditions = {key: (value, origin) for key, value, origin in guess.stated}
    wheels, unnamed = _wheels(guess)
    is_several = len(wheels) > 1 or guess.identities is not None
    lines = [
        f"# First import map for {_comment(path.name)}. Check every line marked with ?, and state what is missing.",
        "# Meaning of the keys: docs/how-to/import-measurements.md",
        "",
        *_warning_lines(facts),
        *_file_lines(layout, guess),
        "[sampling]",
        *(_rate_lines(guess) if guess.time is None else _time_lines(guess, guess.time)),
        *_start_lines(guess, facts, conditions.get("date"), conditions.get("clock")),
        "",
    ]
    for wheel in wheels:
        missed = [name for name in guess.missed if not is_several or position_of(name) == wheel.position]
        lines += _wheel_lines(wheel, wheels[0]) if is_several else []
        lines += _axis_lines("wheel.axis" if is_several else "axis", wheel.axes, missed, guess.mv_per_g)
        lines += [f"# column {toml_string(axis.seen.name)}: more than three axes?" for axis in wheel.axes[3:]]
        lines += [""] if is_several else []
    lines += _sensor_lines(wheels[0].axes[0])
    lines += _environment_lines(guess, is_several=is_several)
    lines += _reference_lines(guess)
    lines += [
        "# [mounting]         # ? of the sensor, as in the vehicle file",
        "# offset_mm = 0.0    # ? distance below the belt's neutral layer in mm",
        "",
        "[conditions]   # ? leave out what is not known",
        f"# radius_mm = {ASSUMED_RADIUS_MM:g}   # ? belt radius: rolling circumference / (2 pi); assumed if not stated",
    ]
    if not is_several:
        position = wheels[0].position
        lines.append(f"position = {toml_string(position)}" + ("   # ?" if position == "W1" else ""))
        lines.append(_stated_line(conditions, "load_n", "4000.0", "vertical load"))
    lines.append(_stated_line(conditions, "pressure_kpa", "220.0", "gauge pressure"))
    lines.append(_stated_line(conditions, "tire", '"205/55R16"', "size"))
    others = [*guess.others, *((name, "names no wheel, as others do") for name in unnamed)]
    if others:
        lines += ["", "# Columns that are not used:"]
        lines += [f"#   {_comment(name)}: {_comment(reason)}" for name, reason in others[:MOST_COLUMNS]]
        lines += [f"#   and {len(others) - MOST_COLUMNS} more"] if len(others) > MOST_COLUMNS else []
    return "\n".join(lines) + "\n"


class _Wheel(NamedTuple):
    """A wheel by its position, its axes, and the text by which rows state its sensor; None where they state none."""

    position: str
    axes: list[Axis]
    sensor: str | None


def _wheels(guess: Guess) -> tuple[list[_Wheel], list[str]]:
    """Return the wheels, and the columns that are of none of them."""
    groups = by_wheel(guess.candidates, guess.groups)
    used = {column.name for columns in groups.values() for column in columns}
    unnamed = [column.name for column in guess.candidates if column.name not in used]
    axes = {position: ordered_axes(columns, guess.rate_hz) for position, columns in groups.items()}
    if guess.identities is None:
        return [_Wheel(position, group, None) for position, group in axes.items()], unnamed
    group = next(iter(axes.values()))
    return [_Wheel(position, group, text) for position, text in _positions(guess.identities[1]).items()], unnamed


def _warning_lines(facts: FileFacts) -> list[str]:
    lines = [
        f"# ? The file is cut: {_comment(name)} has {rows} of {expected} samples; common rows are used."
        for name, (rows, expected) in facts.cut.items()
    ]
    lines += [f"# ? Warned when it was read: {_comment(warning)}" for warning in facts.warnings]
    return [*lines, ""] if lines else []


def _time_lines(guess: Guess, time: str) -> list[str]:
    rate = f"{guess.rate_hz:.6g} Hz in its first rows" if guess.rate_hz else ""
    remark = ", ".join(filter(None, (rate, _comment(guess.time_doubt))))
    mark = "? " if guess.time_doubt else ""
    lines = [
        f"time_column = {toml_string(time)}" + (f"   # {mark}{remark}" if remark else ""),
        f"time_unit = {toml_string(guess.time_unit)}",
    ]
    if guess.time_unit == ISO and guess.is_dated:
        lines.append('# time_zone = "Europe/Berlin"   # ? needed if the times state no offset')
    order = guess.date_order.rstrip("?")
    if order != "ymd":
        alternative = "mdy" if order == "dmy" else "dmy"
        lines.append(f'date_order = "{order}"' + (f"   # ? or {alternative}" if order != guess.date_order else ""))
    return lines


def _rate_lines(guess: Guess) -> list[str]:
    if guess.stated_rate:
        remark = f"; {_comment(guess.no_time)}" if guess.no_time is not None else ""
        return [f"rate_hz = {guess.rate_hz:.9g}   # ? stated in the file: {_comment(guess.stated_rate)}{remark}"]
    if guess.no_time is not None:
        return [f"# rate_hz = {guess.rate_hz or 10000.0:.6g}   # ? {_comment(guess.no_time)}"]
    return ["# rate_hz = 10000.0   # ? not in the file: the sampling rate has to be stated"]


def _start_lines(
    guess: Guess, facts: FileFacts, day: tuple[str, str] | None, clock: tuple[str, str] | None
) -> list[str]:
    """Return the start as the times or the file state it, with the date and the time of day as (value, place)."""
    if facts.start_ns is not None:
        return []
    if guess.since_1970_s is not None:
        start = datetime.fromtimestamp(guess.since_1970_s, UTC).isoformat(timespec="milliseconds")
        return [f"start_utc = {start.replace('+00:00', 'Z')}   # ? if its times count from 1970 in UTC"]
    if guess.time_unit == ISO and guess.is_dated:
        return []
    if day is not None:
        missing = f"time by {clock[1]}: state the zone" if clock else "state the time of the first row"
        hour = clock[0] if clock else "12:00:00"
        return [f"# start_utc = {day[0]}T{hour}Z   # ? date by {day[1]}; {missing}"]
    reason = "not in the file" if guess.is_dated else "the times have no date"
    return [f"# start_utc = 2024-05-01T12:00:00Z   # ? {reason}; else its modification time"]


def _wheel_lines(wheel: _Wheel, first: _Wheel) -> list[str]:
    """Return the head of one of several wheels."""
    mark = "" if position_of(wheel.position) == wheel.position else "   # ? name of the wheel"
    lines = ["[[wheel]]", f"position = {toml_string(wheel.position)}{mark}"]
    if wheel.sensor is not None and first.sensor is not None:
        lines.append(f"sensor = {toml_string(wheel.sensor)}")
        lines += [f"# Its axes are as in the rows of {_comment(first.sensor)}."] if wheel is not first else []
    return [*lines, "# load_n = 4000.0   # ? vertical load", '# sensor_id = "0000a001"   # ?']


def _positions(identities: Sequence[str]) -> dict[str, str]:
    """Return names of wheels for the texts by which rows state their sensor."""
    named = {re.sub(r"[^A-Za-z0-9_.-]+", "_", text).strip("_.-")[:24]: text for text in identities}
    if len(named) == len(identities) and all(re.match("[A-Za-z]", name) for name in named):
        return named
    return {f"W{number}": text for number, text in enumerate(identities, 1)}


def _stated_line(conditions: Mapping[str, tuple[str, str]], key: str, example: str, description: str) -> str:
    """Return a condition as the file states it, or else as a comment."""
    if key in conditions:
        value, origin = conditions[key]
        return f"{key} = {value}   # ? stated in the file: {_comment(origin)}"
    return f"# {key} = {example}   # ? {description}"


def _file_lines(layout: FileLayout, guess: Guess) -> list[str]:
    if guess.identities is not None:
        layout = layout.model_copy(update={"sensor_column": guess.identities[0]})
    lines = [f"{key} = {json.dumps(value)}" for key, value in layout.model_dump(exclude_defaults=True).items()]
    used = [*guess.candidates, *(reference.seen for reference in guess.references)]
    fault = next(filter(None, (guess.time_fault, *(column.fault for column in used))), None)
    if fault is not None:
        lines.append(f'# unreadable = "missing"   # ? takes cells that are no numbers for gaps: {_comment(fault)}')
    return ["[file]", *lines, ""] if lines else []


def _axis_lines(prefix: str, group: Sequence[Axis], missed: Sequence[str], mv_per_g: float | None) -> list[str]:
    lines: list[str] = []
    ordered = _ordered(group)
    has_only_lateral = len(ordered) == 2 and names_role(ordered[1].seen.name, "lateral")
    for name, axis in zip(("radial", "lateral") if has_only_lateral else _AXES, ordered, strict=False):
        entries = [
            f"[{prefix}.{name}]",
            f"column = {toml_string(axis.seen.name)}{_reason(name, axis, missed, len(group))}",
            *_unit_lines(axis, group[0], mv_per_g),
            _sign_line(name, axis),
            "# full_scale = 500.0   # ? end of the sensor's range, in the column's unit",
        ]
        is_sure = _is_sure(name, axis, missed, len(group))
        lines += [line if is_sure or line.startswith("#") else f"# {line}" for line in entries]
    return [*lines, ""]


def _unit_lines(axis: Axis, radial: Axis, mv_per_g: float | None) -> list[str]:
    """Return unit, scale and offset of an axis."""
    stated_unit = axis.seen.unit
    # Only on the radial axis does V²/R say how large a value is.
    says_unit = axis is radial or axis.seen.is_acceleration
    unit = axis.unit if says_unit else radial.unit
    reason = axis.why if says_unit and axis.why else "as the radial axis" if unit and not says_unit else _NO_UNIT
    if stated_unit in VOLTS and mv_per_g is not None:
        scale = (1.0 if stated_unit == "mV" else 1e3) / mv_per_g
        return ['unit = "g"', f"scale = {scale:.6g}   # the file says {stated_unit} and {mv_per_g:g} mV/g"]
    if (scaled := stated_unit or unit) in SCALED_UNITS:
        base_unit, scale = SCALED_UNITS[scaled]
        comment = f"the file says {scaled}" if stated_unit else f"{scaled} {reason}"
        lines = [f'unit = "{base_unit}"   # {comment}', f"scale = {scale:g}"]
    elif stated_unit and not axis.seen.is_acceleration:
        comment = _comment(stated_unit)
        lines = [f'# unit = "g"   # ? the file says {comment}: state scale, in g per {comment}']
    else:
        lines = [f"unit = {toml_string(unit or 'g')}   # {reason}"]
    if radial.scale is not None:
        size = f"# scale = {radial.scale:.4g}"
        lines.append(f"{size}   # ? counts or volts? V²/R fits with about this size of 1: state the exact one")
        offset = axis.steady - (axis.depth if axis is radial else 0.0)
        if abs(offset) > 0.3 * abs(radial.depth):
            lines.append(f"# offset = {offset:.3g}   # ? reading at zero acceleration")
    return lines


def _sign_line(name: str, axis: Axis) -> str:
    if name != "radial":
        return f"# sign = -1   # ? positive {_DIRECTIONS[name]}"
    # With a reading at zero acceleration, the mean says no direction.
    by_mean = axis.is_steady and axis.scale is None
    is_reversed = axis.steady < 0.0 if by_mean else axis.depth < 0.0
    basis = "positive toward the wheel centre, by its mean and contact"
    basis = basis if axis.is_rolling else "? positive toward the wheel centre, by its mean and largest peaks"
    return f"sign = {-1 if is_reversed else 1}   # {basis}"


def _is_sure(name: str, axis: Axis, missed: Sequence[str], count: int) -> bool:
    """Return whether a column may stand for an axis: not in place of one that is not read, nor of another sensor."""
    if names_role(axis.seen.name, name):
        return True
    return not (missed and axis.doubt) if name == "radial" else count <= len(_AXES)


_NO_UNIT: Final = "? neither the file nor the magnitude says it"
_AXES: Final = ("radial", "circumferential", "lateral")
_DIRECTIONS: Final = {
    "circumferential": "in the direction in which the sensor travels",
    "lateral": "to the left of the vehicle",
}


def _ordered(group: Sequence[Axis]) -> list[Axis]:
    """Return the radial axis, then the others by their swing: that of the circumferential one is larger."""
    return [
        group[0],
        *sorted(group[1:3], key=lambda axis: (names_role(axis.seen.name, "lateral"), -axis.swing)),
    ]


def _reason(name: str, axis: Axis, missed: Sequence[str], count: int) -> str:
    """Return the comment that says why a column is an axis, with ? where that is not certain."""
    doubts = [axis.doubt if name == "radial" else axis.seen.fault]
    if name == "radial" and missed:
        doubts.append("not read: " + ", ".join(f"'{column}'" for column in missed))
    if name == "radial" and count > len(_AXES):
        doubts.append(f"{count} columns may be axes")
    is_uncertain = False
    if names_role(axis.seen.name, name):
        reason = "by its name"
    elif name != "radial":
        reason, is_uncertain = "by the size of its variation only", True
        doubts += ["it may be of another sensor"] if count > len(_AXES) else []
    elif axis.is_rolling:
        reason = f"mean {axis.steady:.4g}, contact {abs(axis.depth):.4g} deep"
    else:
        reason = f"the largest mean, {axis.steady:.4g}; no revolutions are seen in the first rows"
        is_uncertain = True
    remark = "; ".join([reason, *filter(None, doubts)])
    return f"   # {'? ' if is_uncertain or any(doubts) else ''}{_comment(remark)}"


def _sensor_lines(radial: Axis) -> list[str]:
    reason = "the radial axis has a steady part" if radial.is_steady else "the radial axis has no steady part"
    mark = "" if radial.is_steady and radial.is_rolling and radial.scale is None else "? "
    lines = ["[sensor]", f"coupling = {toml_string('DC' if radial.is_steady else 'AC')}   # {mark}{reason}"]
    if not radial.is_steady:
        lines.append("# highpass_hz = 0.1   # ? corner of the coupling")
    return [*lines, ""]


def _environment_lines(guess: Guess, *, is_several: bool) -> list[str]:
    if not guess.environment:
        return []
    mark = "# " if is_several else ""
    lines = ["# Columns for [wheel.environment] of a wheel:" if is_several else "[environment]"]
    if "pressure" in guess.environment:
        column, unit = guess.environment["pressure"]
        lines.append(f"{mark}pressure_column = {toml_string(column.name)}")
        lines.append(f"{mark}pressure_unit = {toml_string(unit or 'kPa')}" + ("" if unit else "   # ?"))
    if "temperature" in guess.environment:
        column, doubt = guess.environment["temperature"]
        remark = f"? degC, {doubt}" if doubt else "degC"
        lines.append(f"{mark}temperature_column = {toml_string(column.name)}   # {remark}")
    return [*lines, ""]


def _reference_lines(guess: Guess) -> list[str]:
    lines: list[str] = []
    for number, reference in enumerate(guess.references, 1):
        name, doubt = reference.seen.name, "; ".join(filter(None, (reference.doubt, reference.seen.fault)))
        lines += ["[[reference]]", f"name = {toml_string(_name(name, number))}", f"column = {toml_string(name)}"]
        lines.append(f"quantity = {toml_string(reference.quantity)}" + (f"   # ? {_comment(doubt)}" if doubt else ""))
        if reference.quantity == "pulses":
            lines.append("# pulses_per_turn = 1   # ? of the wheel")
        else:
            unit = reference.unit or next(iter(REFERENCE_UNITS[reference.quantity]))
            lines.append(f"unit = {toml_string(unit)}" + ("" if reference.seen.unit else "   # ?"))
            lines.append("# std = 0.1   # ? standard error of the column, in its unit; exact if not stated")
        lines.append("")
    return lines


def _name(column: str, number: int) -> str:
    """Return a name for a reference; the number makes it unique."""
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", column).strip("_.-")[:32]
    return f"{plain or 'reference'}_{number}" if number > 1 or not plain else plain


def _comment(text: str) -> str:
    return "".join(character if character.isprintable() else "?" for character in text)[:240]
