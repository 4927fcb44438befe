"""First import map for a measurement: what its columns show, with the rest as comments."""

import contextlib
import itertools
import math
import re
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.column_names import A_MAGNITUDE, AN_ERROR, MICROSECONDS, other_quantity, parts_of_time, unit_of
from gateway.importing.columns import Block, ColumnReader, FileFacts
from gateway.importing.csv_columns import CsvColumns
from gateway.importing.csv_layout import TextLayout, recognise_layout
from gateway.importing.file_formats import open_columns, recognised_format
from gateway.importing.guessed_columns import (
    ANGLE,
    MOST_COLUMNS,
    PRESSURE,
    PULSES,
    RIG,
    ROTATION,
    SHORT_ROLES,
    SPEED,
    TEMPERATURE,
    TIME,
    VOLTS,
    Guess,
    Reference,
    Seen,
    by_wheel,
    names_role,
)
from gateway.importing.guessed_time import LIKELY_HZ, find_time
from gateway.importing.import_map import (
    ISO,
    PRESSURE_UNITS_PA,
    REFERENCE_UNITS,
    TEMPERATURE_UNITS,
    TIME_UNITS_S,
    Axes,
    AxisColumn,
    FileFormat,
    ImportMap,
    Sampling,
    Sensor,
)
from gateway.importing.importer import parts_of
from gateway.importing.map_text import map_text
from gateway.importing.reader_process import ReaderProcesses

_SLOW_S: Final = 0.005
_SLOW_ROWS: Final = 50
# Samples of a pulse are near its ends; those of a tire are not.
_END_SHARE: Final = 0.97
_MIN_ROWS: Final = 200
# With a larger share of unreadable cells, a column is no column of numbers.
_MAX_UNREADABLE: Final = 0.1
# Columns of a wheel among which a magnitude is searched.
_MAX_COMPARED: Final = 9
# Share of a magnitude by which columns that are rounded apart may miss it.
_ROUNDING_SHARE: Final = 1e-3
# Relative; steps of MDF channels are means of their times.
_SAME_STEP: Final = 0.01
_VOLTAGES: Final = VOLTS | {""}
# A constant column of these states a condition of the test.
_UNITS_OF_CONSTANTS: Final = (
    TEMPERATURE_UNITS | PRESSURE_UNITS_PA.keys() | REFERENCE_UNITS["speed"].keys() | REFERENCE_UNITS["rotation"].keys()
) - {"Hz"}
_LOADS_N: Final = {"N": 1.0, "kN": 1e3, "kg": 9.80665}
_LOAD: Final = re.compile(r"load|last|fz|force|kraft", re.IGNORECASE)
_LISTED_REASONS: Final = 40
# Span of an angle over a turn in each unit.
_FULL_TURNS: Final = {"deg": (300.0, 361.0), "rad": (5.5, 6.3), "turns": (0.8, 1.0)}
_SET_VALUE: Final = re.compile(
    r"(?:^|[^a-z])(?:cmd|command(?:ed)?|set(?:point)?|soll|target|demand)(?:[^a-z]|$)", re.IGNORECASE
)


def guess_map(
    path: Path, progress: Callable[[float], None] = lambda _: None, processes: ReaderProcesses | None = None
) -> str:
    """Return a first import map in TOML; keys that cannot be known are comments.

    Args:
        path: measurement.
        progress: called with the share done, 0 to 1.
        processes: supply of processes for formats that need one; None for a new process.

    Raises:
        ImportDataError: the file cannot be read, or none of its columns can be an acceleration.
    """
    path = parts_of(path)[0]
    is_text = path.is_file() and recognised_format(path) is FileFormat.CSV
    text = recognise_layout(path) if is_text else TextLayout()
    # The columns are known only after the file is open; a map needs one. The zone of dates does not change their steps.
    sampling = Sampling(rate_hz=1e4)
    if text.dates:
        order: Any = text.date_order.rstrip("?")
        sampling = Sampling(time_column=min(text.dates), time_unit=ISO, time_zone="UTC", date_order=order)
    probe = ImportMap(
        file=text.layout,
        sampling=sampling,
        axis=Axes(radial=AxisColumn(column="?", unit="g")),
        sensor=Sensor(coupling="DC"),
    )
    identities = text.identities
    rows_of = None if identities is None else (identities[0], identities[1][0])
    with contextlib.closing(open_columns(path, probe, processes, rows_of)) as reader:
        facts = reader.facts
        columns, unused, remedies = _columns(reader, path, facts, text, progress)
        if identities is not None:
            columns = [column for column in columns if column.name != identities[0]]
            unused = [(identities[0], "the sensor of each row"), *(item for item in unused if item[0] != identities[0])]
        guess = _sorted(columns, reader.facts, text)
        guess.identities = identities
    guess.others = unused + guess.others
    guess.missed = [name for name, _ in unused if _names_axis(name, unit_of(name, facts.units.get(name, "")))]
    if not guess.candidates:
        reasons = [f"  {name}: {reason}" for name, reason in guess.others[:_LISTED_REASONS]]
        omitted = len(guess.others) - len(reasons)
        raise ImportDataError(
            "\n".join(
                (
                    f"{path}: no column looks like the acceleration of a tire",
                    *([f"  {guess.time}: the time"] if guess.time is not None else []),
                    *(f"  {reference.seen.name}: taken for {reference.quantity}" for reference in guess.references),
                    *reasons,
                    *([f"  and {omitted} more"] if omitted > 0 else []),
                )
            ),
            next(filter(None, remedies), f"It takes at least {_MIN_ROWS} rows of numbers that vary."),
        )
    return map_text(path, text.layout, guess, facts)


def _columns(
    reader: ColumnReader, path: Path, facts: FileFacts, text: TextLayout, progress: Callable[[float], None]
) -> tuple[list[Seen], list[tuple[str, str]], list[str]]:
    """Return the first rows of every column of numbers, (name, reason) of the others, and remedies for these."""
    columns: list[Seen] = []
    remedies: list[str] = []
    skipped = [(name, f"{reason}. {remedy}".strip()) for name, (reason, remedy) in facts.unusable.items()]
    names = list(facts.names)
    skipped += [(name, f"text, such as '{text.texts[name][:40]}'") for name in names if name in text.texts]
    further_dates = text.dates - set(facts.dates)
    skipped += [(name, "further dates") for name in sorted(further_dates)]
    names = [name for name in names if name not in text.texts and name not in further_dates]
    skipped += [(name, "not looked at") for name in names[MOST_COLUMNS:]]
    for k, name in enumerate(names[:MOST_COLUMNS]):
        progress(k / len(names))
        stated_unit = facts.units.get(name, "") or text.units.get(name, "")
        first_rows = _first_rows(reader, path, name)
        if first_rows is None:
            # The time of an MDF file has rows only beside a channel.
            skipped += [] if name == facts.time_column else [(name or "(no name)", "no rows")]
        elif isinstance(first_rows, _Unreadable):
            skipped.append((name or "(no name)", first_rows.reason))
            remedies.append(first_rows.remedy)
        else:
            block, fault = first_rows
            columns.append(Seen(name, block.values[:, 0], unit_of(name, stated_unit), block.where, fault))
    main, others = _at_one_rate(columns, reader, facts)
    return main, skipped + others, remedies


def _at_one_rate(
    columns: Sequence[Seen], reader: ColumnReader, facts: FileFacts
) -> tuple[list[Seen], list[tuple[str, str]]]:
    """Return columns at the rows of most accelerations, and (name, reason) of those that have no value there."""
    rows = _main_rows(columns)
    main = [column for column in columns if len(column.values) == rows]
    if not main:
        return [], []
    skipped: list[tuple[str, str]] = []
    base = next((column for column in main if column.says_acceleration), main[0])
    if facts.time_column is not None and all(column.name != facts.time_column for column in main):
        main = [*_at_rows_of(base, Seen(facts.time_column, base.values, "s", base.where), reader), *main]
    for column in [column for column in columns if len(column.values) != rows]:
        step_s, base_step_s = (facts.steps_s.get(name, 0.0) for name in (column.name, base.name))
        is_in_step = not column.says_acceleration or math.isclose(step_s, base_step_s, rel_tol=_SAME_STEP)
        if is_in_step and column.name in facts.cut:
            main = _at_common_rows(main, column, reader, facts)
            continue
        resampled = _at_rows_of(base, column, reader) if is_in_step else []
        main += resampled
        skipped += [] if resampled else [(column.name, f"{len(column.values)} rows, others {rows}")]
    return main, skipped


def _at_rows_of(base: Seen, column: Seen, reader: ColumnReader) -> list[Seen]:
    """Return a column with the rows of another, as MDF files give their time and slower channels; nothing elsewhere."""
    try:
        block = reader.sample([base.name, column.name])
    except ImportDataError:  # the import says why, if the map states that column
        return []
    return [] if block is None else [Seen(column.name, block.values[:, 1], column.unit, block.where)]


def _at_common_rows(main: Sequence[Seen], short_column: Seen, reader: ColumnReader, facts: FileFacts) -> list[Seen]:
    """Return columns with the rows that they share with one that ends early, which comes last."""
    names = [column.name for column in main if column.name != facts.time_column]
    block = reader.sample([*names, short_column.name])
    if block is None:
        return list(main)
    rows = len(block.values)
    columns = {name: block.values[:, k] for k, name in enumerate((*names, short_column.name))}
    return [replace(column, values=columns.get(column.name, column.values[:rows])) for column in (*main, short_column)]


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
    if sample is None or sample.unreadable > _MAX_UNREADABLE * len(sample.block.values):
        return _Unreadable(reason if sample is None else f"{reason}, {sample.unreadable} such cells", remedy)
    count_note = f", {sample.unreadable} such cells" if sample.unreadable > 1 else ""
    return sample.block, f"{sample.first}{count_note}"


def _main_rows(columns: Sequence[Seen]) -> int:
    """Return the number of rows of most accelerations, or of the longest column where none is named."""
    named = Counter(len(column.values) for column in columns if column.says_acceleration)
    if named:
        return max(named, key=lambda rows: (named[rows], rows))
    return max((len(column.values) for column in columns), default=0)


def _names_axis(name: str, unit: str) -> bool:
    return Seen(name, np.empty(0), unit, str).says_acceleration


def _sorted(columns: Sequence[Seen], facts: FileFacts, text: TextLayout) -> Guess:
    conditions = [*text.stated, *((key, value, origin) for key, value, origin in facts.stated)]
    guess = Guess(groups=facts.groups, stated=conditions, mv_per_g=text.mv_per_g)
    parts = parts_of_time([column.name for column in columns])
    time_parts = [column for column in columns if column.name in parts]
    guess.others = [(column.name, "a part of the time of day") for column in time_parts]
    finite = [(column, column.values[np.isfinite(column.values)]) for column in columns if column.name not in parts]
    if facts.dates:
        _take_dates(finite, facts, text, guess)
    else:
        find_time(finite, guess)
    for column, values in finite:
        reason = None if column.name == guess.time else _classify(column, values, guess)
        guess.others += [] if reason is None else [(column.name, reason)]
    if not guess.candidates:
        left_out = {(column.name, f"unit {column.unit}"): column for column, _ in finite if column.unit in VOLTS}
        guess.candidates = [left_out[entry] for entry in guess.others if entry in left_out]
        guess.others = [entry for entry in guess.others if entry not in left_out]
    if guess.time is None and facts.time_column is not None:
        guess.time = facts.time_column
    if guess.time is None and guess.no_time is None and time_parts:
        _take_part(time_parts, guess)
    _leave_other_times(columns, guess)
    _leave_unnamed(guess)
    _leave_magnitudes(guess)
    if guess.time is None:
        _take_rate({**facts.rates_hz, **text.rates_hz}, guess)
    return guess


def _take_dates(finite: Sequence[tuple[Seen, FloatArray]], facts: FileFacts, text: TextLayout, guess: Guess) -> None:
    """Take the column of dates for the time."""
    guess.date_order = text.date_order
    name, first_ns = next(iter(facts.dates.items()))
    dated = [(replace(column, unit="s"), values) for column, values in finite if column.name == name]
    find_time(dated, guess)
    guess.time_doubt = guess.time_doubt or guess.no_time or ""
    guess.time, guess.time_unit, guess.no_time, guess.since_1970_s = name, ISO, None, None
    guess.is_dated = not text.dates or first_ns is not None


def _take_part(parts: Sequence[Seen], guess: Guess) -> None:
    """Take the rate by the microseconds of a time of day that has a column for each part."""
    guess.no_time = "the time of day is in parts: " + ", ".join(f"'{column.name}'" for column in parts)
    micros = [column.values for column in parts if MICROSECONDS.fullmatch(column.name.strip())]
    steps = np.mod(np.diff(micros[0][np.isfinite(micros[0])]), 1e6) if micros else np.empty(0)
    typical = float(np.median(steps)) if len(steps) else 0.0
    if typical > 0.0 and LIKELY_HZ[0] <= 1e6 / typical <= LIKELY_HZ[1]:
        guess.rate_hz = 1e6 / float(steps[np.abs(steps - typical) <= 0.5 * typical].mean())
        guess.no_time += f"; {guess.rate_hz:.6g} Hz by the last"


def _take_rate(rates_hz: Mapping[str, float], guess: Guess) -> None:
    """Take the rate that the file states, where it states a single one."""
    likely = {name: hz for name, hz in rates_hz.items() if LIKELY_HZ[0] <= hz <= LIKELY_HZ[1]}
    slow = {name: hz for name, hz in rates_hz.items() if 0.0 < hz < LIKELY_HZ[0]}
    for rates in (likely, slow):
        if len({f"{hz:.6g}" for hz in rates.values()}) == 1:
            guess.stated_rate, guess.rate_hz = next(iter(rates.items()))
            return
    if likely:
        guess.no_time = "the file states several rates: " + ", ".join(
            f"{hz:.6g} Hz in {name}" for name, hz in likely.items()
        )


def _leave_other_times(columns: Sequence[Seen], guess: Guess) -> None:
    """Leave columns out whose group has times of its own: they are not in step with those of the map's time."""
    base = guess.groups.get(guess.time or "")
    if base is None:
        return
    times = {
        guess.groups[column.name][0]: column.values
        for column in columns
        if guess.groups.get(column.name, ("", ""))[1:] == base[1:]
    }
    others = {group for group, values in times.items() if not np.array_equal(values, times[base[0]], equal_nan=True)}
    for column in list(guess.candidates):
        if (group := guess.groups.get(column.name, ("",))[0]) in others:
            guess.candidates.remove(column)
            guess.others.append((column.name, f"{group} has times of its own: import it by another map"))


def _leave_unnamed(guess: Guess) -> None:
    """Leave columns out that nothing calls an acceleration, where others of their wheel are called so."""
    for columns in by_wheel(guess.candidates, guess.groups).values():
        if any(column.says_acceleration for column in columns):
            unnamed = [
                column
                for column in columns
                if not (column.says_acceleration or any(names_role(column.name, role) for role in SHORT_ROLES))
            ]
            guess.others += [(column.name, "not named as an acceleration, as others are") for column in unnamed]
            guess.candidates = [column for column in guess.candidates if column not in unnamed]


def _leave_magnitudes(guess: Guess) -> None:
    """Leave the column of a wheel out that is the magnitude of three others, row by row."""
    for columns in by_wheel(guess.candidates, guess.groups).values():
        if 3 < len(columns) <= _MAX_COMPARED and len({len(column.values) for column in columns}) == 1:
            column = min(columns, key=lambda column: _from_magnitude(column, columns))
            if _from_magnitude(column, columns) < _ROUNDING_SHARE:
                guess.others.append((column.name, f"{A_MAGNITUDE} by its values"))
                guess.candidates.remove(column)


def _from_magnitude(column: Seen, columns: Sequence[Seen]) -> float:
    """Return the share by which a column misses the length of the vector of three others, of those that fit best."""
    squares = [other.values**2 for other in columns if other is not column]
    lengths = [np.sqrt(np.sum(triple, axis=0)) for triple in itertools.combinations(squares, 3)]
    misses = [np.nanmedian(np.abs(column.values - length)) / np.nanmedian(length) for length in lengths]
    return float(min(misses))


def _classify(column: Seen, values: FloatArray, guess: Guess) -> str | None:
    """Sort a column in; return the reason why it is left out, None when it is used."""
    reason = _unused(column, values, guess)
    if reason is not None:
        return reason
    if column.says_acceleration:
        guess.candidates.append(column)
        return None
    # A contact changes an acceleration by its whole size within milliseconds.
    rows = min(_SLOW_ROWS, len(values) // 100)
    step = max(1, rows if guess.rate_hz is None else round(_SLOW_S * guess.rate_hz))
    change = float(np.abs(values[step:] - values[:-step]).mean()) if len(values) > step else math.inf
    is_smooth = change < 0.05 * float(values.std())
    reference = _reference(column, values)
    if reference is not None:
        guess.references.append(reference)
        return None
    for quantity, doubt in _environment(column, is_smooth=is_smooth):
        if quantity in guess.environment:
            return f"a second {quantity} beside '{guess.environment[quantity][0].name}'"
        guess.environment[quantity] = column, doubt
        return None
    if column.unit:
        return f"unit {column.unit}"
    if ANGLE.search(column.name) or is_smooth:
        return "a slow quantity"
    guess.candidates.append(column)
    return None


def _unused(column: Seen, values: FloatArray, guess: Guess) -> str | None:
    """Return why a column can be nothing of a map but a time or a stated load, which is noted; None where it can."""
    if len(values) < _MIN_ROWS:
        return f"{len(values)} values only"
    unit, name = column.unit, column.name
    if AN_ERROR.search(name) and not column.says_acceleration:
        return "an error by its name"
    # The rounding of the mean gives a constant a spread.
    is_constant = not np.ptp(values) > 0.0
    if is_constant and unit in _LOADS_N and _LOAD.search(name):
        guess.stated.append(("load_n", f"{values[0] * _LOADS_N[unit]:.6g}", f"column {name}"))
        return f"constant, {values[0]:g} {unit}"
    if is_constant and unit not in _UNITS_OF_CONSTANTS:
        return f"constant, {values[0]:g}"
    quantity = other_quantity(name)
    if quantity is not None and (quantity == A_MAGNITUDE or not column.is_acceleration):
        return f"{quantity} by its name"
    if (np.diff(values) == 1.0).all():
        return "a counter"
    is_time = unit in TIME_UNITS_S or (not unit and TIME.search(name) and not column.says_acceleration)
    return "a time" if is_time else None


def _environment(column: Seen, *, is_smooth: bool) -> Iterator[tuple[str, str]]:
    """Yield pressure or temperature where a column is one: with its unit, or with what is doubtful."""
    unit, name = column.unit, column.name
    if unit in PRESSURE_UNITS_PA or (PRESSURE.search(name) and not unit):
        yield "pressure", unit
    is_named = is_smooth and TEMPERATURE.search(name) is not None
    if unit in TEMPERATURE_UNITS:
        yield "temperature", "" if unit == "degC" or is_named else unit
    elif is_named and not unit:
        yield "temperature", "by its name"


def _reference(column: Seen, values: FloatArray) -> Reference | None:
    """Return a column as a reference by its unit; without one by its name or its values; None where it is none."""
    unit, name = column.unit, column.name
    for quantity, pattern in (("speed", SPEED), ("rotation", ROTATION)):
        is_named = pattern.search(name) is not None
        if unit in REFERENCE_UNITS[quantity] or (is_named and not unit):
            if _SET_VALUE.search(name):
                doubt = "its name says a set value, which is not measured"
            elif not unit:
                doubt = "by its name"
            else:
                # A frequency may be of anything.
                doubt = "by its unit" if unit == "Hz" and not is_named else ""
            return Reference(column, quantity, unit, doubt)
    for quantity, pattern in RIG.items():
        if unit in REFERENCE_UNITS[quantity] and pattern.search(name):
            return Reference(column, quantity, unit, "")
    return _reference_by_values(column, values)


def _reference_by_values(column: Seen, values: FloatArray) -> Reference | None:
    """Return pulses or the angle of an encoder by the shape of its values, None where a column is neither."""
    unit, low, high = column.unit, float(values.min()), float(values.max())
    if unit in _VOLTAGES:
        is_named = PULSES.search(column.name) is not None
        end_share = float(np.mean(np.minimum(values - low, high - values) < 0.1 * (high - low)))
        if is_named or end_share > _END_SHARE:
            return Reference(column, "pulses", "", "" if is_named else "by its values")
    if (unit in REFERENCE_UNITS["angle"] or not unit) and _is_sawtooth(values):
        likely_unit = next((name for name, span in _FULL_TURNS.items() if span[0] < high - low <= span[1]), "")
        return Reference(column, "angle", unit or likely_unit, "" if unit else "by its values")
    return None


def _is_sawtooth(values: FloatArray) -> bool:
    """Return whether values rise or fall evenly and jump back."""
    steps, full = np.diff(values), float(np.ptp(values))
    jumps = np.abs(steps) > 0.7 * full
    ramp_steps = steps[~jumps]
    if not jumps.any() or np.count_nonzero(jumps) > 0.1 * len(steps):
        return False
    one_way_share = max(float(np.mean(ramp_steps >= 0)), float(np.mean(ramp_steps <= 0)))
    return one_way_share > 0.98 and float(np.abs(ramp_steps).max()) < 0.3 * full
