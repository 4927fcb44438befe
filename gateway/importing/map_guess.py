"""First import map for a measurement: what its columns show, with the rest as comments."""

import contextlib
import itertools
import json
import math
import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from firmware_protocol.wire import MIN_RATE_HZ
from gateway.core.config.toml_writer import toml_string
from gateway.core.config.vehicle import ASSUMED_RADIUS_MM
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.column_names import A_MAGNITUDE, names_acceleration, other_quantity, unit_of
from gateway.importing.columns import Block, ColumnReader, FileFacts
from gateway.importing.csv_columns import CsvColumns
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
from gateway.importing.time_counter import TimeCounter
from gateway.importing.unit_check import contact_depth, fits, no_unit_fits, revolution_lag

_MOST_COLUMNS: Final = 64
_ROLES: Final = {
    "radial": re.compile(r"radial", re.IGNORECASE),
    "circumferential": re.compile(r"circumf|tangent|longitud", re.IGNORECASE),
    "lateral": re.compile(r"lateral|(^|[^a-z])quer", re.IGNORECASE),
}
# Short forms, which beside a named acceleration name another axis; alone they may be of a position.
_SHORT_ROLES: Final = {
    "circumferential": re.compile(r"(^|[^a-z])(tang?|circ|long?)([^a-z]|$)", re.IGNORECASE),
    "lateral": re.compile(r"(^|[^a-z])lat([^a-z]|$)", re.IGNORECASE),
}
_SLOW_S: Final = 0.005
_SLOW_ROWS: Final = 50
_LAG_S: Final = 1.0
_POSITION: Final = re.compile(r"(?:^|[^a-z0-9])(fl|fr|rl|rr|vl|vr|hl|hr|w\d{1,2})(?:[^a-z0-9]|$)", re.IGNORECASE)
_GERMAN: Final = {"VL": "FL", "VR": "FR", "HL": "RL", "HR": "RR"}
_SPEED: Final = re.compile(r"speed|veloc|geschw|(^|[^a-z])v([^a-z]|$)|kmh|km/h", re.IGNORECASE)
_ROTATION: Final = re.compile(r"rpm|drehz|rotat|(^|[^a-z])n([^a-z]|$)|omega", re.IGNORECASE)
_ANGLE: Final = re.compile(r"angle|winkel|encoder|phi|theta", re.IGNORECASE)
_PULSES: Final = re.compile(r"tach|puls|trig|index|hall", re.IGNORECASE)
_PRESSURE: Final = re.compile(r"press|druck|(^|[^a-z])p([^a-z]|$)", re.IGNORECASE)
_TEMPERATURE: Final = re.compile(r"temp|(^|[^a-z])t([^a-z]|$)", re.IGNORECASE)
_TIME: Final = re.compile(r"time|zeit|stamp|^t$", re.IGNORECASE)
_LIKELY_HZ: Final = (1500.0, 400_000.0)
# Rates of slower devices, whose times have a name.
_SLOWEST_HZ: Final = 5.0
# Seconds since 1970: of the years 2000 to 2100.
_SINCE_1970_S: Final = (0.95e9, 4.1e9)
# Day numbers of the same years, and the day of each on which 1970 began: of Excel and of MATLAB.
_DAYS: Final = (((36_500.0, 73_100.0), 25_569.0), ((730_500.0, 767_100.0), 719_529.0))
# Samples of a pulse are near its ends; those of a tire are not.
_AT_ENDS: Final = 0.97
_FEWEST_ROWS: Final = 200
# With a larger share of unreadable cells, a column is no column of numbers.
_MOST_UNREADABLE: Final = 0.1
# Rounding repeats a larger share of the times, or none.
_FEW_REPEATS: Final = 0.01
# Times that repeat more often are coarser than an import takes, which is 1.2 sample intervals.
_MOST_REPEATS: Final = 0.2
# Columns of a wheel among which a magnitude is searched.
_MOST_COMPARED: Final = 9
# Share of a magnitude by which columns that are rounded apart may miss it.
_ROUNDED: Final = 1e-3
_VOLTS: Final = frozenset({"V", "mV"})
_VOLTAGES: Final = _VOLTS | {""}
_TEMPERATURE_UNITS: Final = frozenset({"degC", "C"})
# A constant column of these states a condition of the test.
_UNITS_OF_CONSTANTS: Final = (
    _TEMPERATURE_UNITS | PRESSURE_UNITS_PA.keys() | REFERENCE_UNITS["speed"].keys() | REFERENCE_UNITS["rotation"].keys()
) - {"Hz"}
_LISTED_REASONS: Final = 40


@dataclass(slots=True)
class _Seen:
    """One column.

    Attributes:
        name: its name.
        values: (n,) its first rows.
        unit: unit that the file states, empty without one.
        where: returns the place of a row for messages.
        fault: place and text of its first unreadable cell, empty without one.
    """

    name: str
    values: FloatArray
    unit: str
    where: Callable[[int], str]
    fault: str = ""

    @property
    def is_acceleration(self) -> bool:
        """Whether its unit is that of an acceleration."""
        return self.unit in ACCELERATION_UNITS_MPS2

    @property
    def says_acceleration(self) -> bool:
        """Whether its unit says an acceleration, or its name where it has no unit."""
        if self.unit or self.is_acceleration:
            return self.is_acceleration and other_quantity(self.name) != A_MAGNITUDE
        others = (_TEMPERATURE, _PRESSURE, _PULSES, _ANGLE, _SPEED, _ROTATION)
        named = names_acceleration(self.name) or any(role.search(self.name) for role in _ROLES.values())
        return named and not any(pattern.search(self.name) for pattern in others)


@dataclass(slots=True)
class _Axis:
    """A column taken for an axis.

    Attributes:
        seen: the column.
        unit: unit by the file or by magnitude, empty when neither says it.
        why: reason for the unit.
        steady: mean in its own unit.
        depth: depth of the contact in its own unit, negative where the contact points up; without revolutions that of
            the largest peaks.
        is_rolling: whether revolutions are seen.
        scale: size of 1 in its unit by V²/R, where no unit fits by far.
        swing: standard deviation.
        doubt: why it may not be the radial axis, empty without a reason.
    """

    seen: _Seen
    unit: str
    why: str
    steady: float
    depth: float
    swing: float
    doubt: str
    is_rolling: bool
    scale: float | None = None

    @property
    def is_steady(self) -> bool:
        """Whether it has a steady part, so that its mean says its direction."""
        return abs(self.steady) > 0.3 * abs(self.depth)


@dataclass(slots=True)
class _Reference:
    """A column taken for a reference.

    Attributes:
        seen: the column.
        quantity: what it measures.
        unit: its unit, empty where neither file nor values say it.
        doubt: why the quantity or the unit is not certain, empty where it is.
    """

    seen: _Seen
    quantity: str
    unit: str
    doubt: str


@dataclass(slots=True)
class _Guess:
    """Sorted columns.

    Attributes:
        time: name of the time column, None without one.
        time_unit: its unit.
        time_doubt: what is doubtful about it, empty where nothing is.
        no_time: why a column of times cannot be used, None without one.
        rate_hz: sampling rate, None where it is unknown.
        stated_rate: where the file states the rate, empty where it comes from times or is unknown.
        since_1970_s: time of the first row since 1970, None where the times have another zero.
        is_dated: whether times of dates are no times of day alone.
        date_order: of year, month and day in dates, with `?` where it is not certain.
        candidates: columns that may be accelerations.
        missed: columns whose name or unit says an acceleration, and that cannot be read.
        references: reference columns.
        pressure: column of the pressure with its unit.
        temperature: column of the temperature, and what is doubtful about it.
        others: (name, reason) of the columns that are not used.
    """

    time: str | None = None
    time_unit: str = "s"
    time_doubt: str = ""
    no_time: str | None = None
    rate_hz: float | None = None
    stated_rate: str = ""
    since_1970_s: float | None = None
    is_dated: bool = True
    date_order: str = "ymd"
    candidates: list[_Seen] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)
    references: list[_Reference] = field(default_factory=list)
    pressure: tuple[_Seen, str] | None = None
    temperature: tuple[_Seen, str] | None = None
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
    # The columns are known only after the file is open; a map needs one. The zone of dates does not change their steps.
    sampling = Sampling(rate_hz=1e4)
    if text is not None and text.dates:
        order: Any = text.date_order.rstrip("?")
        sampling = Sampling(time_column=min(text.dates), time_unit=ISO, time_zone="UTC", date_order=order)
    probe = ImportMap(
        file=layout,
        sampling=sampling,
        axis=Axes(radial=AxisColumn(column="?", unit="g")),
        sensor=Sensor(coupling="DC"),
    )
    with contextlib.closing(open_columns(path, probe, ReaderProcesses())) as reader:
        facts = reader.facts
        seen, skipped, remedies = _columns(reader, path, facts, text, progress)
        guess = _sorted(seen, reader.facts, text)
    guess.others = skipped + guess.others
    guess.missed = [name for name, _ in skipped if _names_axis(name, unit_of(name, facts.units.get(name, "")))]
    if not guess.candidates:
        reasons = [f"  {name}: {reason}" for name, reason in guess.others[:_LISTED_REASONS]]
        more = len(guess.others) - len(reasons)
        raise ImportDataError(
            "\n".join(
                (
                    f"{path}: no column looks like the acceleration of a tire",
                    *([f"  {guess.time}: the time"] if guess.time is not None else []),
                    *(f"  {reference.seen.name}: taken for {reference.quantity}" for reference in guess.references),
                    *reasons,
                    *([f"  and {more} more"] if more > 0 else []),
                )
            ),
            next(filter(None, remedies), f"It takes at least {_FEWEST_ROWS} rows of numbers that vary."),
        )
    return _written(path, layout, guess, facts)


def _text_layout(path: Path) -> TextLayout | None:
    if path.is_file() and suffix_format(path) is FileFormat.CSV:
        return recognise_layout(path)
    return None


def _columns(
    reader: ColumnReader, path: Path, facts: FileFacts, text: TextLayout | None, progress: Callable[[float], None]
) -> tuple[list[_Seen], list[tuple[str, str]], list[str]]:
    """Return the first rows of every column of numbers, (name, reason) of the others, and remedies for these."""
    seen: list[_Seen] = []
    remedies: list[str] = []
    skipped = [(name, f"{reason}. {remedy}".strip()) for name, (reason, remedy) in facts.unusable.items()]
    names = list(facts.names)
    if text is not None:
        skipped += [(name, f"text, such as '{text.texts[name][:40]}'") for name in names if name in text.texts]
        skipped += [(name, "further dates") for name in sorted(text.dates - set(facts.dates))]
        names = [name for name in names if name not in text.texts and name not in text.dates - set(facts.dates)]
    skipped += [(name, "not looked at") for name in names[_MOST_COLUMNS:]]
    for k, name in enumerate(names[:_MOST_COLUMNS]):
        progress(k / len(names))
        stated = facts.units.get(name, "") or (text.units.get(name, "") if text is not None else "")
        first_rows = _first_rows(reader, path, name)
        if first_rows is None:
            # The time of an MDF file has rows only beside a channel.
            skipped += [] if name == facts.time_column else [(name or "(no name)", "no rows")]
        elif isinstance(first_rows, _Unreadable):
            skipped.append((name or "(no name)", first_rows.reason))
            remedies.append(first_rows.remedy)
        else:
            block, fault = first_rows
            seen.append(_Seen(name, block.values[:, 0], unit_of(name, stated), block.where, fault))
    rows = _main_rows(seen)
    main = [column for column in seen if len(column.values) == rows]
    if main:
        beside = next((column for column in main if column.says_acceleration), main[0])
        if facts.time_column is not None and all(column.name != facts.time_column for column in main):
            main = [*_at_rows_of(beside, _Seen(facts.time_column, beside.values, "s", beside.where), reader), *main]
        for column in [column for column in seen if len(column.values) != rows]:
            resampled = _at_rows_of(beside, column, reader)
            main += resampled
            skipped += [] if resampled else [(column.name, f"{len(column.values)} rows, others {rows}")]
    return main, skipped, remedies


def _at_rows_of(beside: _Seen, column: _Seen, reader: ColumnReader) -> list[_Seen]:
    """Return a column with the rows of another, as MDF files give their time and slower channels; nothing elsewhere."""
    try:
        block = reader.sample([beside.name, column.name])
    except ImportDataError:  # the import says why, if the map states that column
        return []
    return [] if block is None else [_Seen(column.name, block.values[:, 1], column.unit, block.where)]


class _Unreadable(NamedTuple):
    """Why a column cannot be read, and what to do about it."""

    reason: str
    remedy: str


def _first_rows(reader: ColumnReader, path: Path, name: str) -> tuple[Block, str] | _Unreadable | None:
    """Return the first rows of a column with its first unreadable cell, or why it has none; None without rows."""
    try:
        block = reader.sample([name])
        return None if block is None else (block, "")
    except ImportDataError as error:
        reason = str(error).removeprefix(str(path)).lstrip(": ").replace(f", column '{name}'", "")
        remedy = error.remedy
    if not isinstance(reader, CsvColumns):
        return _Unreadable(reason, remedy)
    sample = reader.tolerant_sample(name)
    if sample is None or sample.unreadable > _MOST_UNREADABLE * len(sample.block.values):
        return _Unreadable(reason if sample is None else f"{reason}, {sample.unreadable} such cells", remedy)
    more = f", {sample.unreadable} such cells" if sample.unreadable > 1 else ""
    return sample.block, f"{sample.first}{more}"


def _main_rows(seen: Sequence[_Seen]) -> int:
    """Return the number of rows of most accelerations, or of the longest column where none is named."""
    named = Counter(len(column.values) for column in seen if column.says_acceleration)
    if named:
        return max(named, key=lambda rows: (named[rows], rows))
    return max((len(column.values) for column in seen), default=0)


def _names_axis(name: str, unit: str) -> bool:
    return _Seen(name, np.empty(0), unit, str).says_acceleration


def _sorted(seen: Sequence[_Seen], facts: FileFacts, text: TextLayout | None) -> _Guess:
    guess = _Guess()
    finite = [(column, column.values[np.isfinite(column.values)]) for column in seen]
    volts: list[_Seen] = []
    if facts.dates:
        guess.date_order = text.date_order if text is not None else "ymd"
        name = next(iter(facts.dates))
        dated = [(column, values) for column, values in finite if column.name == name]
        for column, _ in dated:
            column.unit = "s"
        _find_time(dated, guess)
        guess.time_doubt = guess.time_doubt or guess.no_time or ""
        guess.time, guess.time_unit, guess.no_time, guess.since_1970_s = name, ISO, None, None
        guess.is_dated = text is None or facts.dates[name] is not None
    else:
        _find_time(finite, guess)
    for column, values in finite:
        if column.name == guess.time:
            continue
        kind = _kind(column, values, guess)
        if kind is not None:
            guess.others.append((column.name, kind))
            volts += [column] if kind == f"unit {column.unit}" and column.unit in _VOLTS else []
    if not guess.candidates:
        guess.candidates = volts
        guess.others = [other for other in guess.others if other[0] not in {column.name for column in volts}]
    if guess.time_unit != ISO and guess.time is None and facts.time_column is not None:
        guess.time = facts.time_column
    _leave_unnamed(guess)
    _leave_magnitudes(guess)
    if guess.time is None:
        _take_rate({**facts.rates_hz, **(text.rates_hz if text is not None else {})}, guess)
    return guess


def _take_rate(rates_hz: Mapping[str, float], guess: _Guess) -> None:
    """Take the rate that the file states, where it states a single one."""
    likely = {name: hz for name, hz in rates_hz.items() if _LIKELY_HZ[0] <= hz <= _LIKELY_HZ[1]}
    if len(set(likely.values())) == 1:
        guess.stated_rate, guess.rate_hz = next(iter(likely.items()))


def _names_role(name: str, role: str) -> bool:
    """Return whether the name of an acceleration says its axis, also in a short form."""
    short = _SHORT_ROLES.get(role)
    return _ROLES[role].search(name) is not None or (short is not None and short.search(name) is not None)


def _leave_unnamed(guess: _Guess) -> None:
    """Leave columns out that nothing calls an acceleration, where others of their wheel are called so."""
    for columns in _by_wheel(guess.candidates).values():
        if any(column.says_acceleration for column in columns):
            unnamed = [
                column
                for column in columns
                if not (column.says_acceleration or any(_names_role(column.name, role) for role in _SHORT_ROLES))
            ]
            guess.others += [(column.name, "not named as an acceleration, as others are") for column in unnamed]
            guess.candidates = [column for column in guess.candidates if column not in unnamed]


def _leave_magnitudes(guess: _Guess) -> None:
    """Leave the column of a wheel out that is the magnitude of three others, row by row."""
    for columns in _by_wheel(guess.candidates).values():
        if 3 < len(columns) <= _MOST_COMPARED:
            column = min(columns, key=lambda column: _from_magnitude(column, columns))
            if _from_magnitude(column, columns) < _ROUNDED:
                guess.others.append((column.name, f"{A_MAGNITUDE} by its values"))
                guess.candidates.remove(column)


def _from_magnitude(column: _Seen, columns: Sequence[_Seen]) -> float:
    """Return the share by which a column misses the length of the vector of three others, of those that fit best."""
    squares = [other.values**2 for other in columns if other is not column]
    lengths = [np.sqrt(np.sum(three, axis=0)) for three in itertools.combinations(squares, 3)]
    misses = [np.nanmedian(np.abs(column.values - length)) / np.nanmedian(length) for length in lengths]
    return float(min(misses))


def _find_time(finite: Sequence[tuple[_Seen, FloatArray]], guess: _Guess) -> None:
    """Find the column of times, those with such a name or unit first; else say what is wrong with one."""
    ordered = sorted(finite, key=lambda pair: not _is_named_time(pair[0]))
    named = [(column, values) for column, values in finite if _is_named_time(column)]
    if any(_is_time(column, values, guess, _LIKELY_HZ) for column, values in ordered):
        return
    if any(_is_time(column, values, guess, (_SLOWEST_HZ, _LIKELY_HZ[0])) for column, values in named):
        return
    for column, values in named:
        fault = _time_fault(column, values)
        if fault is not None:
            guess.no_time, guess.rate_hz = fault
            return


def _is_named_time(column: _Seen) -> bool:
    return column.unit in TIME_UNITS_S or (not column.unit and _TIME.search(column.name) is not None)


def _time_units(column: _Seen, values: FloatArray) -> list[str]:
    """Return the units in which a column may count time: the stated one, that of times since 1970, or any."""
    if column.unit in TIME_UNITS_S:
        return [column.unit]
    for unit in ("s", "ms", "us", "ns"):
        if len(values) and _SINCE_1970_S[0] < values[0] * TIME_UNITS_S[unit] < _SINCE_1970_S[1]:
            return [unit]
    if len(values) and _since_1970_d(float(values[0])) is not None:
        return ["d", "s", "ms", "us"]
    return ["s", "ms", "us"]


def _since_1970_d(days: float) -> float | None:
    """Return a day number as days since 1970, None where it is none of the years 2000 to 2100."""
    return next((days - begin for (low, high), begin in _DAYS if low < days < high), None)


def _is_time(column: _Seen, values: FloatArray, guess: _Guess, rates_hz: tuple[float, float]) -> bool:
    """Note a column of uniform times, with its unit: as stated, or the first that gives a likely rate."""
    counter = TimeCounter()
    values = counter.look(values)
    steps = np.diff(values)
    if len(steps) < 2 or not (steps >= 0).all() or not steps.any():
        return False
    if np.mean(steps == 0.0) > _MOST_REPEATS:
        return False
    # Times may be rounded, but their trend is straight.
    trend = values[0] + (values[-1] - values[0]) * np.arange(len(values)) / (len(values) - 1)
    step = _usual_step(steps)
    if float(np.abs(values - trend).max()) > 3.0 * max(step, float(steps.max())):
        return False
    for unit in _time_units(column, values):
        rate_hz = 1.0 / (step * TIME_UNITS_S[unit])
        if rates_hz[0] <= rate_hz <= rates_hz[1] and (_TIME.search(column.name) or step != 1.0):
            guess.time, guess.time_unit, guess.rate_hz = column.name, unit, rate_hz
            if rate_hz < MIN_RATE_HZ:
                guess.time_doubt = f"too low: a contact edge takes {MIN_RATE_HZ:g} Hz or more"
            elif counter.restarts:
                guess.time_doubt = "its counter starts again"
            elif column.fault:
                guess.time_doubt = column.fault
            elif 0 < np.count_nonzero(steps == 0.0) < _FEW_REPEATS * len(steps):
                rows = np.flatnonzero(np.isfinite(column.values))
                guess.time_doubt = f"repeats in {column.where(int(rows[np.argmin(steps) + 1]))}"
            first = _since_1970_d(float(values[0])) if unit == "d" else float(values[0])
            since_1970_s = (first or 0.0) * TIME_UNITS_S[unit]
            if _SINCE_1970_S[0] < since_1970_s < _SINCE_1970_S[1]:
                guess.since_1970_s = since_1970_s
            return True
    return False


def _usual_step(steps: FloatArray) -> float:
    """Return the mean step of times, without those of gaps where most are alike."""
    typical = float(np.median(steps))
    regular = np.abs(steps - typical) <= 0.5 * typical
    return float(steps[regular].mean()) if typical > 0.0 and np.mean(regular) > 0.9 else float(steps.mean())


def _time_fault(column: _Seen, values: FloatArray) -> tuple[str, float | None] | None:
    """Return why a column of times cannot be used, and the rate by its regular steps; None where it is no time."""
    steps = np.diff(values)
    rows = np.flatnonzero(np.isfinite(column.values))
    if len(steps) > 2 and (steps >= 0.0).all() and np.mean(steps == 0.0) > _MOST_REPEATS:
        return _block_clock(column, values, steps)
    typical = float(np.median(steps)) if len(steps) > 2 else 0.0
    regular = np.abs(steps - typical) <= 0.5 * typical
    if typical <= 0.0 or np.mean(regular) < 0.5:
        return None
    wrong = np.flatnonzero(steps <= 0.0)
    what = "steps back" if len(wrong) and steps[wrong[0]] < 0.0 else "repeats"
    if not len(wrong):
        wrong, what = np.flatnonzero(~regular), "skips"
    if not len(wrong):
        return _rate_change(column, values, steps)
    reason = f"'{column.name}' {what} in {column.where(int(rows[wrong[0] + 1]))}"
    return _with_rate(reason, _likely_hz(column, values, float(steps[regular].mean())))


def _with_rate(reason: str, rate_hz: float | None) -> tuple[str, float | None]:
    return (reason if rate_hz is None else f"{reason}; {rate_hz:.6g} Hz by its other steps"), rate_hz


def _rate_change(column: _Seen, values: FloatArray, steps: FloatArray) -> tuple[str, float | None] | None:
    """Return that the rate of even times is another at the end than at the beginning, and that of the beginning."""
    part = max(1, len(steps) // 10)
    first_hz, last_hz = (
        _likely_hz(column, values, float(steps[at].mean())) for at in (slice(part), slice(-part, None))
    )
    if first_hz is None or last_hz is None:
        return None
    return (
        f"'{column.name}' goes from {first_hz:.6g} to {last_hz:.6g} Hz: cut the file where the rate changes",
        first_hz,
    )


def _block_clock(column: _Seen, values: FloatArray, steps: FloatArray) -> tuple[str, float | None] | None:
    """Return that times advance only from block to block, and the rate by whole blocks; None with less than three."""
    advances = np.flatnonzero(steps > 0.0)
    if len(advances) < 3:
        return None
    rows = int(advances[-1] - advances[0])
    span = float(values[advances[-1] + 1] - values[advances[0] + 1])
    each = rows / (len(advances) - 1)
    return _with_rate(f"'{column.name}' advances once in {each:.4g} rows", _likely_hz(column, values, span / rows))


def _likely_hz(column: _Seen, values: FloatArray, step: float) -> float | None:
    """Return the rate by a step of a column of times in the first unit that makes it likely, None without one."""
    rates_hz = (1.0 / (step * TIME_UNITS_S[unit]) for unit in _time_units(column, values))
    return next((rate_hz for rate_hz in rates_hz if _LIKELY_HZ[0] <= rate_hz <= _LIKELY_HZ[1]), None)


def _kind(column: _Seen, values: FloatArray, guess: _Guess) -> str | None:
    """Sort a column in; return the reason why it is left out, None when it is used."""
    if len(values) < _FEWEST_ROWS:
        return f"{len(values)} values only"
    unit, name, spread = column.unit, column.name, float(values.std())
    # The rounding of the mean gives a constant a spread.
    if not np.ptp(values) > 0.0 and unit not in _UNITS_OF_CONSTANTS:
        return f"constant, {values[0]:g}"
    other = other_quantity(name)
    if other is not None and (other == A_MAGNITUDE or not column.is_acceleration):
        return f"{other} by its name"
    if (np.diff(values) == 1.0).all():
        return "a counter"
    if unit in TIME_UNITS_S or (not unit and _TIME.search(name) and not column.says_acceleration):
        return "a time"
    if column.says_acceleration:
        guess.candidates.append(column)
        return None
    # A contact changes an acceleration by its whole size within milliseconds.
    rows = min(_SLOW_ROWS, len(values) // 100)
    step = max(1, rows if guess.rate_hz is None else round(_SLOW_S * guess.rate_hz))
    smooth = len(values) > step and float(np.abs(values[step:] - values[:-step]).mean()) < 0.05 * spread
    reference = _reference(column, values)
    if reference is not None:
        guess.references.append(reference)
        return None
    if unit in PRESSURE_UNITS_PA or (_PRESSURE.search(name) and not unit):
        if guess.pressure is not None:
            return f"a second pressure beside '{guess.pressure[0].name}'"
        guess.pressure = column, unit
        return None
    named = _TEMPERATURE.search(name) is not None and smooth
    if unit in _TEMPERATURE_UNITS or (named and not unit):
        if guess.temperature is not None:
            return f"a second temperature beside '{guess.temperature[0].name}'"
        guess.temperature = column, "" if unit == "degC" or (unit and named) else "by its name" if named else unit
        return None
    if unit:
        return f"unit {unit}"
    if _ANGLE.search(name) or smooth:
        return "a slow quantity"
    guess.candidates.append(column)
    return None


def _reference(column: _Seen, values: FloatArray) -> _Reference | None:
    """Return a column as a reference by its unit; without one by its name or its values; None where it is none."""
    unit, name = column.unit, column.name
    low, high = float(values.min()), float(values.max())
    for quantity, pattern in (("speed", _SPEED), ("rotation", _ROTATION)):
        stated = unit in REFERENCE_UNITS[quantity]
        if stated or (pattern.search(name) and not unit):
            # A frequency may be of anything.
            doubt = "" if stated and unit != "Hz" else "by its unit" if stated else "by its name"
            return _Reference(column, quantity, unit, "" if pattern.search(name) and stated else doubt)
    if unit in _VOLTAGES:
        at_ends = float(np.mean(np.minimum(values - low, high - values) < 0.1 * (high - low)))
        if _PULSES.search(name) or at_ends > _AT_ENDS:
            return _Reference(column, "pulses", "", "" if _PULSES.search(name) else "by its values")
    if _is_sawtooth(values) and (unit in REFERENCE_UNITS["angle"] or not unit):
        full = high - low
        by_size = "deg" if 300.0 < full < 361.0 else "rad" if 5.5 < full < 6.3 else "turns" if 0.8 < full <= 1.0 else ""
        return _Reference(column, "angle", unit or by_size, "" if unit else "by its values")
    return None


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
    axes = []
    for column in columns:
        values = _liveliest(column.values, rate_hz)
        scale = None
        lag = None if rate_hz is None else revolution_lag(values, rate_hz, ASSUMED_RADIUS_MM * 1e-3)
        steady = float(np.nanmean(values))
        if lag is not None:
            down, up = contact_depth(values, lag), contact_depth(-values, lag)
        else:
            low, middle, high = np.nanpercentile(values, (1.0, 50.0, 99.0))
            down, up = middle - low, high - middle
        depth = float(down if down >= up else -up)
        unit, why = (column.unit, "stated in the file") if column.is_acceleration else ("", "")
        doubt = column.fault
        if lag is not None and rate_hz is not None:
            expected = (2.0 * math.pi * rate_hz / lag) ** 2 * ASSUMED_RADIUS_MM * 1e-3
            largest = max(abs(steady), abs(depth))
            for name in () if column.unit else ("m/s^2", "g", "mg"):
                if largest > 0.0 and fits(largest * ACCELERATION_UNITS_MPS2[name], expected):
                    unit, why = name, f"by magnitude: V²/R of its revolutions is {expected:.0f} m/s²"
            size = largest * ACCELERATION_UNITS_MPS2.get(unit, 1.0)
            if not doubt and (not unit or not (size > 0.0 and fits(size, expected))):
                shown = f"its mean and contact are {size:.0f}" if unit else f"no unit makes {size:.4g} fit"
                doubt = f"V²/R of its revolutions is {expected:.0f} m/s², {shown}"
            # The contact's depth holds no reading at zero acceleration.
            in_unit = abs(depth) * ACCELERATION_UNITS_MPS2.get(unit, STANDARD_GRAVITY_MPS2)
            if in_unit > 0.0 and ((not unit and column.unit) or no_unit_fits(in_unit / expected)):
                scale = expected / in_unit
        axes.append(_Axis(column, unit, why, steady, depth, float(np.nanstd(values)), doubt, lag is not None, scale))
    named = _ROLES["radial"]
    return sorted(
        axes,
        key=lambda axis: (
            not named.search(axis.seen.name),
            # The mean of volts is their reading at zero acceleration.
            -max(abs(axis.steady) * (axis.seen.unit not in _VOLTS), abs(axis.depth), 1e-3 * axis.swing),
        ),
    )


def _liveliest(values: FloatArray, rate_hz: float | None) -> FloatArray:
    """Return the second with the largest scatter: over a longer time the speed may change."""
    rows = len(values) if rate_hz is None else min(len(values), round(_LAG_S * rate_hz))
    parts = [values[first : first + rows] for first in range(0, len(values) - rows + 1, rows)]
    measured_parts = [part for part in parts if np.isfinite(part).any()]
    return max(measured_parts, key=lambda part: float(np.nanstd(part)), default=values)


def _position(name: str) -> str:
    match = _POSITION.search(name)
    position = match[1].upper() if match else "W1"
    return _GERMAN.get(position, position)


def _by_wheel(columns: Sequence[_Seen]) -> dict[str, list[_Seen]]:
    """Return the columns by the wheel in their names; `W1` where there is none."""
    wheels: dict[str, list[_Seen]] = {}
    for column in columns:
        wheels.setdefault(_position(column.name), []).append(column)
    if "W1" in wheels and len(wheels) > 1 and not any(_POSITION.search(column.name) for column in wheels["W1"]):
        del wheels["W1"]
    return wheels


def _written(path: Path, layout: FileLayout, guess: _Guess, facts: FileFacts) -> str:
    lines = [
        f"# First import map for {_comment(path.name)}. Check every line marked with ?, and state what is missing.",
        "# Meaning of the keys: docs/how-to/import-measurements.md",
        "",
    ]
    sorted_in = [*guess.candidates, *(reference.seen for reference in guess.references)]
    lines += _file_lines(layout, [*filter(None, (column.fault for column in sorted_in))])
    rate_hz = guess.rate_hz
    lines += ["[sampling]"]
    if guess.time is not None:
        mark = "? " if guess.time_doubt else ""
        rate = f"{rate_hz:.6g} Hz in its first rows" if rate_hz else ""
        said = ", ".join(filter(None, (rate, _comment(guess.time_doubt))))
        seen = f"   # {mark}{said}" if said else ""
        lines += [f"time_column = {toml_string(guess.time)}{seen}", f"time_unit = {toml_string(guess.time_unit)}"]
        if guess.time_unit == ISO and guess.is_dated:
            lines.append('# time_zone = "Europe/Berlin"   # ? needed if the times state no offset')
        if guess.date_order != "ymd":
            order = guess.date_order.rstrip("?")
            other = "mdy" if order == "dmy" else "dmy"
            lines.append(f'date_order = "{order}"' + (f"   # ? or {other}" if order != guess.date_order else ""))
    elif guess.stated_rate:
        beside = f"; {_comment(guess.no_time)}" if guess.no_time is not None else ""
        lines.append(f"rate_hz = {rate_hz:.9g}   # ? stated in the file: {_comment(guess.stated_rate)}{beside}")
    elif guess.no_time is not None:
        lines.append(f"# rate_hz = {rate_hz or 10000.0:.6g}   # ? {_comment(guess.no_time)}")
    else:
        lines.append("# rate_hz = 10000.0   # ? not in the file: the sampling rate has to be stated")
    if guess.since_1970_s is not None and facts.start_ns is None:
        start = datetime.fromtimestamp(guess.since_1970_s, UTC).isoformat(timespec="milliseconds")
        lines.append(f"start_utc = {start.replace('+00:00', 'Z')}   # ? if its times count from 1970 in UTC")
    elif facts.start_ns is None and (guess.time_unit != ISO or not guess.is_dated):
        why = "not in the file" if guess.is_dated else "the times have no date"
        lines.append(f"# start_utc = 2024-05-01T12:00:00Z   # ? {why}; else its modification time")
    lines.append("")
    wheels = _by_wheel(guess.candidates)
    several = len(wheels) > 1
    used = {column.name for columns in wheels.values() for column in columns}
    guess.others += [
        (column.name, "names no wheel, as others do") for column in guess.candidates if column.name not in used
    ]
    axes = {position: _axes(columns, rate_hz) for position, columns in wheels.items()}
    for position, group in axes.items():
        if several:
            lines += ["[[wheel]]", f"position = {toml_string(position)}"]
            lines += ["# load_n = 4000.0   # ? vertical load", '# sensor_id = "0000a001"   # ?']
        missed = [name for name in guess.missed if not several or _position(name) == position]
        lines += _axis_lines("wheel.axis" if several else "axis", group, missed)
        lines += [f"# column {toml_string(axis.seen.name)}: more than three axes?" for axis in group[3:]]
        if several:
            lines.append("")
    first = next(iter(axes.values()))[0]
    lines += _sensor_lines(first)
    lines += _environment_lines(guess, several=several)
    lines += _reference_lines(guess)
    lines += [
        "# [mounting]         # ? of the sensor, as in the vehicle file",
        "# offset_mm = 0.0    # ? distance below the belt's neutral layer in mm",
        "",
        "[conditions]   # ? leave out what is not known",
        f"# radius_mm = {ASSUMED_RADIUS_MM:g}   # ? belt radius: rolling circumference / (2 pi); assumed if not stated",
    ]
    if not several:
        position = next(iter(axes))
        lines += [f"position = {toml_string(position)}" + ("   # ?" if position == "W1" else "")]
        lines += ["# load_n = 4000.0   # ? vertical load"]
    lines += ["# pressure_kpa = 220.0   # ? gauge pressure", '# tire = "205/55R16"']
    if guess.others:
        lines += ["", "# Columns that are not used:"]
        lines += [f"#   {_comment(name)}: {_comment(reason)}" for name, reason in guess.others[:_MOST_COLUMNS]]
        if len(guess.others) > _MOST_COLUMNS:
            lines.append(f"#   and {len(guess.others) - _MOST_COLUMNS} more")
    return "\n".join(lines) + "\n"


def _file_lines(layout: FileLayout, faults: Sequence[str]) -> list[str]:
    lines = [f"{key} = {json.dumps(value)}" for key, value in layout.model_dump(exclude_defaults=True).items()]
    if faults:
        lines.append(f'# unreadable = "missing"   # ? takes cells that are no numbers for gaps: {_comment(faults[0])}')
    return ["[file]", *lines, ""] if lines else []


def _axis_lines(prefix: str, group: Sequence[_Axis], missed: Sequence[str]) -> list[str]:
    lines = []
    ordered = _ordered(group)
    only_lateral = len(ordered) == 2 and _names_role(ordered[1].seen.name, "lateral")
    for name, axis in zip(("radial", "lateral") if only_lateral else _AXES, ordered, strict=False):
        lines += [
            f"[{prefix}.{name}]",
            f"column = {toml_string(axis.seen.name)}{_reason(name, axis, missed, len(group))}",
        ]
        # Only on the radial axis does V²/R say how large a value is.
        says_unit = axis is group[0] or axis.seen.is_acceleration
        unit = axis.unit if says_unit else group[0].unit
        why = axis.why if says_unit and axis.why else "as the radial axis" if unit and not says_unit else _NO_UNIT
        lines.append(f"unit = {toml_string(unit or 'g')}   # {why}")
        if group[0].scale is not None:
            size = f"# scale = {group[0].scale:.4g}"
            lines.append(f"{size}   # ? counts or volts? V²/R fits with about this size of 1: state the exact one")
            offset = axis.steady - (axis.depth if axis is group[0] else 0.0)
            if abs(offset) > 0.3 * abs(group[0].depth):
                lines.append(f"# offset = {offset:.3g}   # ? reading at zero acceleration")
        if name == "radial":
            # With a reading at zero acceleration, the mean says no direction.
            by_mean = axis.is_steady and axis.scale is None
            against = axis.steady < 0.0 if by_mean else axis.depth < 0.0
            by = "positive toward the wheel centre, by its mean and contact"
            by = by if axis.is_rolling else "? positive toward the wheel centre, by its mean and largest peaks"
            lines.append(f"sign = {-1 if against else 1}   # {by}")
        else:
            lines.append("# sign = -1   # ? positive " + _DIRECTIONS[name])
        lines.append("# full_scale = 500.0   # ? end of the sensor's range, in the column's unit")
    return [*lines, ""]


_NO_UNIT: Final = "? neither the file nor the magnitude says it"
_AXES: Final = ("radial", "circumferential", "lateral")
_DIRECTIONS: Final = {
    "circumferential": "in the direction in which the sensor travels",
    "lateral": "to the left of the vehicle",
}


def _ordered(group: Sequence[_Axis]) -> list[_Axis]:
    """Return the radial axis, then the others by their swing: that of the circumferential one is larger."""
    return [
        group[0],
        *sorted(group[1:3], key=lambda axis: (_names_role(axis.seen.name, "lateral"), -axis.swing)),
    ]


def _reason(name: str, axis: _Axis, missed: Sequence[str], count: int) -> str:
    """Return the comment that says why a column is an axis, with ? where that is not certain."""
    doubts = [axis.doubt if name == "radial" else axis.seen.fault]
    if name == "radial" and missed:
        doubts.append("not read: " + ", ".join(f"'{column}'" for column in missed))
    if name == "radial" and count > len(_AXES):
        doubts.append(f"{count} columns may be axes")
    if _names_role(axis.seen.name, name):
        why = "by its name"
    elif name != "radial":
        why = "by the size of its variation only"
    elif axis.is_rolling:
        why = f"mean {axis.steady:.4g}, contact {abs(axis.depth):.4g} deep"
    else:
        why = f"the largest mean, {axis.steady:.4g}; no revolutions are seen in the first rows"
    uncertain = any(doubts) or why.startswith(("by the size", "the largest"))
    said = "; ".join([why, *filter(None, doubts)])
    return f"   # {'? ' if uncertain else ''}{_comment(said)}"


def _sensor_lines(radial: _Axis) -> list[str]:
    why = "the radial axis has a steady part" if radial.is_steady else "the radial axis has no steady part"
    mark = "" if radial.is_steady and radial.is_rolling and radial.scale is None else "? "
    lines = ["[sensor]", f"coupling = {toml_string('DC' if radial.is_steady else 'AC')}   # {mark}{why}"]
    if not radial.is_steady:
        lines.append("# highpass_hz = 0.1   # ? corner of the coupling")
    return [*lines, ""]


def _environment_lines(guess: _Guess, *, several: bool) -> list[str]:
    if guess.pressure is None and guess.temperature is None:
        return []
    mark = "# " if several else ""
    lines = [f"{mark}[environment]" if not several else "# Columns for [wheel.environment] of a wheel:"]
    if guess.pressure is not None:
        column, unit = guess.pressure
        lines += [f"{mark}pressure_column = {toml_string(column.name)}"]
        lines += [f"{mark}pressure_unit = {toml_string(unit or 'kPa')}" + ("" if unit else "   # ?")]
    if guess.temperature is not None:
        column, doubt = guess.temperature
        why = f"? degC, {doubt}" if doubt else "degC"
        lines += [f"{mark}temperature_column = {toml_string(column.name)}   # {why}"]
    return [*lines, ""]


def _reference_lines(guess: _Guess) -> list[str]:
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
        lines.append("")
    return lines


def _name(column: str, number: int) -> str:
    """Return a name for a reference; the number makes it unique."""
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", column).strip("_.-")[:32]
    return f"{plain or 'reference'}_{number}" if number > 1 or not plain else plain


def _comment(text: str) -> str:
    return "".join(character if character.isprintable() else "?" for character in text)[:240]
