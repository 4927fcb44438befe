"""First import map for a measurement: what its columns show, with the rest as comments."""

from __future__ import annotations

import contextlib
import json
import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from gateway.config.vehicle import ASSUMED_RADIUS_MM
from gateway.errors import ImportDataError
from gateway.importing.columns import ColumnReader, FileFacts
from gateway.importing.csv_layout import TextLayout, recognise_layout
from gateway.importing.file_formats import open_columns, suffix_format
from gateway.importing.import_map import (
    ACCELERATION_UNITS_MPS2,
    ISO,
    PRESSURE_UNITS_PA,
    REFERENCE_UNITS,
    TIME_UNITS_S,
    Axes,
    AxisColumn,
    FileFormat,
    FileLayout,
    ImportMap,
    Sampling,
    Sensor,
)
from gateway.importing.reader_process import ReaderProcesses
from gateway.importing.unit_check import contact_depth, fits, revolution_lag
from gateway.types import FloatArray

_MOST_COLUMNS: Final = 64
_UNIT_WORD: Final = re.compile(
    r"(?:^|[^a-z0-9])(rpm|kmh|kph|km/h|mph|deg|kpa|bar|psi|mps2|m/s2|m/s\^2|mg)(?:[^a-z0-9]|$)", re.IGNORECASE
)
_ROLES: Final = {
    "radial": re.compile(r"radial", re.IGNORECASE),
    "circumferential": re.compile(r"circumf|tangent|longitud", re.IGNORECASE),
    "lateral": re.compile(r"lateral|(^|[^a-z])quer", re.IGNORECASE),
}
_SLOW_S: Final = 0.005
_SLOW_ROWS: Final = 50
_LAG_S: Final = 1.0
_POSITION: Final = re.compile(r"(?:^|[^a-z0-9])(fl|fr|rl|rr|vl|vr|hl|hr|w\d{1,2})(?:[^a-z0-9]|$)", re.IGNORECASE)
_GERMAN: Final = {"VL": "FL", "VR": "FR", "HL": "RL", "HR": "RR"}
_NAMED_UNIT: Final = re.compile(r"[\[(]\s*([^\])]{1,12}?)\s*[\])]\s*$")
_UNIT_NAMES: Final = {
    "m/s²": "m/s^2", "m/s**2": "m/s^2", "mps^2": "m/s^2", "ms^-2": "m/s^2", "g": "g", "G": "g", "mg": "mg",
    "kph": "km/h", "kmh": "km/h", "km/hr": "km/h", "1/min": "rpm", "U/min": "rpm", "r/min": "rpm", "min^-1": "rpm",
    "kpa": "kPa", "°": "deg", "degree": "deg", "degrees": "deg", "sec": "s", "seconds": "s", "µs": "us",
}  # fmt: skip
_SPEED: Final = re.compile(r"speed|veloc|geschw|(^|[^a-z])v([^a-z]|$)|kmh|km/h", re.IGNORECASE)
_ROTATION: Final = re.compile(r"rpm|drehz|rotat|(^|[^a-z])n([^a-z]|$)|omega", re.IGNORECASE)
_ANGLE: Final = re.compile(r"angle|winkel|encoder|phi|theta", re.IGNORECASE)
_PULSES: Final = re.compile(r"tach|puls|trig|index|hall", re.IGNORECASE)
_PRESSURE: Final = re.compile(r"press|druck|(^|[^a-z])p([^a-z]|$)", re.IGNORECASE)
_TEMPERATURE: Final = re.compile(r"temp|(^|[^a-z])t([^a-z]|$)", re.IGNORECASE)
_TIME: Final = re.compile(r"time|zeit|stamp|^t$", re.IGNORECASE)
_LIKELY_HZ: Final = (1500.0, 400_000.0)
# Samples of a pulse are near its ends; those of a tire are not.
_AT_ENDS: Final = 0.97
_FEWEST_ROWS: Final = 200


@dataclass(slots=True)
class _Seen:
    """One column.

    Attributes:
        name: its name.
        values: (n,) its first rows.
        unit: unit that the file states, empty without one.
    """

    name: str
    values: FloatArray
    unit: str


@dataclass(slots=True)
class _Axis:
    """A column taken for an axis.

    Attributes:
        seen: the column.
        unit: unit by the file or by magnitude, empty when neither says it.
        why: reason for the unit.
        steady: mean in its own unit.
        depth: depth of the contact in its own unit, negative where the contact points up.
        swing: standard deviation.
    """

    seen: _Seen
    unit: str
    why: str
    steady: float
    depth: float
    swing: float


@dataclass(slots=True)
class _Found:
    """Sorted columns."""

    time: str | None = None
    time_unit: str = "s"
    rate_hz: float | None = None
    candidates: list[_Seen] = field(default_factory=list)
    references: list[tuple[_Seen, str, str]] = field(default_factory=list)
    pressure: tuple[_Seen, str] | None = None
    temperature: _Seen | None = None
    others: list[tuple[str, str]] = field(default_factory=list)


def guess_map(path: Path, progress: Callable[[float], None] = lambda _: None) -> str:
    """Return a first import map in TOML; keys that cannot be known are comments.

    Args:
        path: measurement.
        progress: called with the share done, 0 to 1.

    Raises:
        ImportDataError: the file cannot be read, or none of its columns can be an acceleration.
    """
    text = _text_layout(path)
    layout = text.layout if text is not None else FileLayout()
    # The columns are known only after the file is open; a map needs one.
    probe = ImportMap(
        file=layout,
        sampling=Sampling(rate_hz=1e4),
        axis=Axes(radial=AxisColumn(column="?", unit="g")),
        sensor=Sensor(coupling="DC"),
    )
    with contextlib.closing(open_columns(path, probe, ReaderProcesses())) as reader:
        facts = reader.facts
        seen, skipped = _columns(reader, facts, text, progress)
        found = _sorted(seen, facts, text)
    found.others = skipped + found.others
    if not found.candidates:
        shown = ", ".join(facts.names[:20]) or "none"
        raise ImportDataError(
            f"{path}: no column looks like the acceleration of a tire",
            f"It takes at least {_FEWEST_ROWS} rows of numbers that vary. Columns of the file: {shown}.",
        )
    return _written(path, layout, found, facts)


def _text_layout(path: Path) -> TextLayout | None:
    if path.is_file() and suffix_format(path) is FileFormat.CSV:
        return recognise_layout(path)
    return None


def _columns(
    reader: ColumnReader, facts: FileFacts, text: TextLayout | None, progress: Callable[[float], None]
) -> tuple[list[_Seen], list[tuple[str, str]]]:
    """Return the first rows of every column of numbers, and (name, reason) of the others."""
    seen: list[_Seen] = []
    skipped = [(name, reason) for name, (reason, _) in facts.unusable.items()]
    names = [name for name in facts.names if name not in facts.dates]
    if text is not None:
        skipped += [(name, "text") for name in names if name in text.texts]
        names = [name for name in names if name not in text.texts | text.dates]
    skipped += [(name, "not looked at") for name in names[_MOST_COLUMNS:]]
    for k, name in enumerate(names[:_MOST_COLUMNS]):
        progress(k / len(names))
        try:
            block = reader.sample([name])
        except ImportDataError as error:
            skipped.append((name, str(error).rsplit(": ", 1)[-1]))
            continue
        if block is not None:
            seen.append(_Seen(name, block.values[:, 0], _stated_unit(name, facts, text)))
    longest = max((len(column.values) for column in seen), default=0)
    skipped += [
        (column.name, f"{len(column.values)} rows, others {longest}") for column in seen if len(column.values) < longest
    ]
    return [column for column in seen if len(column.values) == longest], skipped


def _stated_unit(name: str, facts: FileFacts, text: TextLayout | None) -> str:
    stated = facts.units.get(name, "") or (text.units.get(name, "") if text is not None else "")
    if not stated and (found := _NAMED_UNIT.search(name)):
        stated = found[1]
    stated = stated.strip().strip("[]()").strip()
    if not stated and (named := _UNIT_WORD.search(name)):
        stated = named[1].lower()
    return _UNIT_NAMES.get(stated, stated)


def _sorted(seen: Sequence[_Seen], facts: FileFacts, text: TextLayout | None) -> _Found:
    found = _Found()
    dates = list(facts.dates) or (sorted(text.dates) if text is not None else [])
    if dates:
        found.time, found.time_unit = dates[0], ISO
    finite = [(column, column.values[np.isfinite(column.values)]) for column in seen]
    if found.time is None:
        next((column for column, values in finite if _is_time(column, values, found)), None)
    for column, values in finite:
        if column.name == found.time:
            continue
        kind = _kind(column, values, found)
        if kind is not None:
            found.others.append((column.name, kind))
    if found.time_unit != ISO and found.time is None and facts.time_column is not None:
        found.time = facts.time_column
    return found


def _is_time(column: _Seen, values: FloatArray, found: _Found) -> bool:
    """Note a column of uniform times, with its unit: as stated, or the first that gives a likely rate."""
    steps = np.diff(values)
    if len(steps) < 2 or not (steps >= 0).all() or not steps.any():
        return False
    # Times may be rounded, but their trend is straight.
    trend = values[0] + (values[-1] - values[0]) * np.arange(len(values)) / (len(values) - 1)
    step = float((values[-1] - values[0]) / len(steps))
    if float(np.abs(values - trend).max()) > 3.0 * max(step, float(steps.max())):
        return False
    units = [column.unit] if column.unit in TIME_UNITS_S else ["s", "ms", "us"]
    for unit in units:
        rate_hz = 1.0 / (step * TIME_UNITS_S[unit])
        if _LIKELY_HZ[0] <= rate_hz <= _LIKELY_HZ[1] and (_TIME.search(column.name) or step != 1.0):
            found.time, found.time_unit, found.rate_hz = column.name, unit, rate_hz
            return True
    return False


def _kind(column: _Seen, values: FloatArray, found: _Found) -> str | None:
    """Sort a column in; return the reason why it is left out, None when it is used."""
    if len(values) < _FEWEST_ROWS:
        return f"{len(values)} values only"
    spread = float(values.std())
    if not spread > 0.0:
        return f"constant, {values[0]:g}"
    unit, name = column.unit, column.name
    # A contact changes an acceleration by its whole size within milliseconds.
    rows = min(_SLOW_ROWS, len(values) // 100)
    step = max(1, rows if found.rate_hz is None else round(_SLOW_S * found.rate_hz))
    smooth = len(values) > step and float(np.abs(values[step:] - values[:-step]).mean()) < 0.05 * spread
    low, high = float(values.min()), float(values.max())
    at_ends = float(np.mean(np.minimum(values - low, high - values) < 0.1 * (high - low)))
    for quantity, pattern in (("speed", _SPEED), ("rotation", _ROTATION)):
        if unit in REFERENCE_UNITS[quantity] or (pattern.search(name) and not _is_acceleration(unit)):
            found.references.append((column, quantity, unit if unit in REFERENCE_UNITS[quantity] else ""))
            return None
    if _PULSES.search(name) or (at_ends > _AT_ENDS and not _is_acceleration(unit)):
        found.references.append((column, "pulses", ""))
        return None
    if _is_sawtooth(values) and (unit in REFERENCE_UNITS["angle"] or not _is_acceleration(unit)):
        full = high - low
        by_size = "deg" if 300.0 < full < 361.0 else "rad" if 5.5 < full < 6.3 else "turns" if 0.8 < full <= 1.0 else ""
        found.references.append((column, "angle", unit if unit in REFERENCE_UNITS["angle"] else by_size))
        return None
    if unit in PRESSURE_UNITS_PA or (_PRESSURE.search(name) and not _is_acceleration(unit)):
        found.pressure = found.pressure or (column, unit if unit in PRESSURE_UNITS_PA else "")
        return None
    if unit in ("degC", "°C", "C") or (_TEMPERATURE.search(name) and smooth and not _is_acceleration(unit)):
        found.temperature = found.temperature or column
        return None
    if _ANGLE.search(name) or (smooth and not _is_acceleration(unit)):
        return "a slow quantity"
    if unit and not _is_acceleration(unit):
        return f"unit {unit}"
    found.candidates.append(column)
    return None


def _is_acceleration(unit: str) -> bool:
    return unit in ACCELERATION_UNITS_MPS2


def _is_sawtooth(values: FloatArray) -> bool:
    """Return whether values rise or fall evenly and jump back."""
    steps, full = np.diff(values), float(np.ptp(values))
    jumps = np.abs(steps) > 0.7 * full
    rest = steps[~jumps]
    if not jumps.any() or np.count_nonzero(jumps) > 0.1 * len(steps):
        return False
    one_way = max(float(np.mean(rest >= 0)), float(np.mean(rest <= 0)))
    return one_way > 0.98 and float(np.abs(rest).max()) < 0.3 * full


def _axes(columns: Sequence[_Seen], rate_hz: float | None) -> list[_Axis]:
    """Return the columns as axes, the most likely radial one first."""
    found = []
    for column in columns:
        values = _liveliest(column.values, rate_hz)
        lag = None if rate_hz is None else revolution_lag(values, rate_hz, ASSUMED_RADIUS_MM * 1e-3)
        steady, depth = float(np.nanmean(values)), 0.0
        if lag is not None:
            down, up = contact_depth(values, lag), contact_depth(-values, lag)
            depth = down if down >= up else -up
        unit, why = (column.unit, "stated in the file") if _is_acceleration(column.unit) else ("", "")
        if not unit and lag is not None and rate_hz is not None:
            expected = (2.0 * math.pi * rate_hz / lag) ** 2 * ASSUMED_RADIUS_MM * 1e-3
            for name in ("m/s^2", "g", "mg"):
                size = max(abs(steady), abs(depth)) * ACCELERATION_UNITS_MPS2[name]
                if size > 0.0 and fits(size, expected):
                    unit, why = name, f"by magnitude: V²/R of its revolutions is {expected:.0f} m/s²"
        found.append(_Axis(column, unit, why, steady, depth, float(np.nanstd(values))))
    named = _ROLES["radial"]
    return sorted(
        found,
        key=lambda axis: (
            not named.search(axis.seen.name),
            -max(abs(axis.steady), abs(axis.depth), 1e-3 * axis.swing),
        ),
    )


def _liveliest(values: FloatArray, rate_hz: float | None) -> FloatArray:
    """Return the second with the largest scatter: over a longer time the speed may change."""
    rows = len(values) if rate_hz is None else min(len(values), round(_LAG_S * rate_hz))
    parts = [values[first : first + rows] for first in range(0, len(values) - rows + 1, rows)]
    known = [part for part in parts if np.isfinite(part).any()]
    return max(known, key=lambda part: float(np.nanstd(part)), default=values)


def _by_wheel(columns: Sequence[_Seen]) -> dict[str, list[_Seen]]:
    """Return the columns by the wheel in their names; `W1` where there is none."""
    wheels: dict[str, list[_Seen]] = {}
    for column in columns:
        match = _POSITION.search(column.name)
        position = match[1].upper() if match else "W1"
        wheels.setdefault(_GERMAN.get(position, position), []).append(column)
    if "W1" in wheels and len(wheels) > 1 and not any(_POSITION.search(column.name) for column in wheels["W1"]):
        del wheels["W1"]
    return wheels


def _written(path: Path, layout: FileLayout, found: _Found, facts: FileFacts) -> str:
    lines = [
        f"# First import map for {_comment(path.name)}. Check every line marked with ?, and state what is missing.",
        "# Meaning of the keys: docs/how-to/import-measurements.md",
        "",
    ]
    lines += _file_lines(layout)
    rate_hz = found.rate_hz
    lines += ["[sampling]"]
    if found.time is not None:
        seen = f"   # {rate_hz:.6g} Hz in its first rows" if rate_hz else ""
        lines += [f"time_column = {_quoted(found.time)}{seen}", f"time_unit = {_quoted(found.time_unit)}"]
        if found.time_unit == ISO:
            lines.append('# time_zone = "Europe/Berlin"   # ? needed if the times state no offset')
    else:
        lines.append("# rate_hz = 10000.0   # ? not in the file: the sampling rate has to be stated")
    if facts.start_ns is None and found.time_unit != ISO:
        lines.append("# start_utc = 2024-05-01T12:00:00Z   # ? not in the file; else its modification time")
    lines.append("")
    wheels = _by_wheel(found.candidates)
    several = len(wheels) > 1
    axes = {position: _axes(columns, rate_hz) for position, columns in wheels.items()}
    for position, group in axes.items():
        if several:
            lines += ["[[wheel]]", f"position = {_quoted(position)}"]
            lines += ["# load_n = 4000.0   # ? vertical load", '# sensor_id = "0000a001"   # ?']
        lines += _axis_lines("wheel.axis" if several else "axis", group)
        lines += [f"# column {_quoted(axis.seen.name)}: more than three axes?" for axis in group[3:]]
        if several:
            lines.append("")
    first = next(iter(axes.values()))[0]
    lines += _sensor_lines(first)
    lines += _environment_lines(found, several=several)
    lines += _reference_lines(found)
    lines += [
        "# [mounting]         # ? of the sensor, as in the vehicle file",
        "# offset_mm = 0.0    # ? distance below the belt's neutral layer in mm",
        "",
        "[conditions]   # ? leave out what is not known",
        f"# radius_mm = {ASSUMED_RADIUS_MM:g}   # ? belt radius: rolling circumference / (2 pi); assumed if not stated",
    ]
    if not several:
        position = next(iter(axes))
        lines += [f"position = {_quoted(position)}" + ("   # ?" if position == "W1" else "")]
        lines += ["# load_n = 4000.0   # ? vertical load"]
    lines += ["# pressure_kpa = 220.0   # ? gauge pressure", '# tire = "205/55R16"']
    if found.others:
        lines += ["", "# Columns that are not used:"]
        lines += [f"#   {_comment(name)}: {_comment(reason)}" for name, reason in found.others[:_MOST_COLUMNS]]
    return "\n".join(lines) + "\n"


def _file_lines(layout: FileLayout) -> list[str]:
    stated = layout.model_dump(exclude_defaults=True)
    if not stated:
        return []
    return ["[file]", *(f"{key} = {json.dumps(value)}" for key, value in stated.items()), ""]


def _axis_lines(prefix: str, group: Sequence[_Axis]) -> list[str]:
    lines = []
    ordered = _ordered(group)
    only_lateral = len(ordered) == 2 and _ROLES["lateral"].search(ordered[1].seen.name)
    for name, axis in zip(("radial", "lateral") if only_lateral else _AXES, ordered, strict=False):
        lines += [f"[{prefix}.{name}]", f"column = {_quoted(axis.seen.name)}{_reason(name, axis)}"]
        unit = axis.unit or group[0].unit
        why = axis.why or ("as the radial axis" if unit else "? neither the file nor the magnitude says it")
        lines.append(f"unit = {_quoted(unit or 'g')}   # {why}")
        if name == "radial":
            against = axis.steady < 0.0 if abs(axis.steady) > 0.3 * abs(axis.depth) else axis.depth < 0.0
            lines.append(f"sign = {-1 if against else 1}   # positive toward the wheel centre, by its mean and contact")
        else:
            lines.append("# sign = -1   # ? positive " + _DIRECTIONS[name])
        lines.append("# full_scale = 500.0   # ? end of the sensor's range, in the column's unit")
    return [*lines, ""]


_AXES: Final = ("radial", "circumferential", "lateral")
_DIRECTIONS: Final = {
    "circumferential": "in the direction in which the sensor travels",
    "lateral": "to the left of the vehicle",
}


def _ordered(group: Sequence[_Axis]) -> list[_Axis]:
    """Return the radial axis, then the others by their swing: that of the circumferential one is larger."""
    sideways = _ROLES["lateral"]
    return [group[0], *sorted(group[1:3], key=lambda axis: (bool(sideways.search(axis.seen.name)), -axis.swing))]


def _reason(name: str, axis: _Axis) -> str:
    if _ROLES[name].search(axis.seen.name):
        return "   # by its name"
    if name != "radial":
        return "   # ? by the size of its variation only"
    if axis.depth:
        return f"   # mean {axis.steady:.4g}, contact {abs(axis.depth):.4g} deep"
    return f"   # ? the largest mean, {axis.steady:.4g}; no revolutions are seen in the first rows"


def _sensor_lines(radial: _Axis) -> list[str]:
    steady = abs(radial.steady) > 0.3 * abs(radial.depth)
    why = "the radial axis has a steady part" if steady else "? the radial axis has no steady part"
    lines = ["[sensor]", f"coupling = {_quoted('DC' if steady else 'AC')}   # {why}"]
    if not steady:
        lines.append("# highpass_hz = 0.1   # ? corner of the coupling")
    return [*lines, ""]


def _environment_lines(found: _Found, *, several: bool) -> list[str]:
    if found.pressure is None and found.temperature is None:
        return []
    mark = "# " if several else ""
    lines = [f"{mark}[environment]" if not several else "# Columns for [wheel.environment] of a wheel:"]
    if found.pressure is not None:
        column, unit = found.pressure
        lines += [f"{mark}pressure_column = {_quoted(column.name)}"]
        lines += [f"{mark}pressure_unit = {_quoted(unit or 'kPa')}" + ("" if unit else "   # ?")]
    if found.temperature is not None:
        lines += [f"{mark}temperature_column = {_quoted(found.temperature.name)}   # degC"]
    return [*lines, ""]


def _reference_lines(found: _Found) -> list[str]:
    lines: list[str] = []
    for number, (column, quantity, unit) in enumerate(found.references, 1):
        lines += ["[[reference]]", f"name = {_quoted(_name(column.name, number))}"]
        lines += [f"column = {_quoted(column.name)}", f"quantity = {_quoted(quantity)}"]
        if quantity == "pulses":
            lines.append("# pulses_per_turn = 1   # ? of the wheel")
        else:
            lines.append(
                f"unit = {_quoted(unit or next(iter(REFERENCE_UNITS[quantity])))}" + ("" if unit else "   # ?")
            )
        lines.append("")
    return lines


def _name(column: str, number: int) -> str:
    """Return a name for a reference; the number makes it unique."""
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", column).strip("_.-")[:32]
    return f"{plain or 'reference'}_{number}" if number > 1 or not plain else plain


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False).replace("\x7f", "\\u007f")


def _comment(text: str) -> str:
    return "".join(character if character.isprintable() else "?" for character in text)[:120]
