"""Column of times of a measurement, for a first map: by name and unit first, then by its steps."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from firmware_protocol.wire import MIN_RATE_HZ
from gateway.core.types import FloatArray, IntArray
from gateway.importing.guessed_columns import TIME, Guess, Seen, is_rolling
from gateway.importing.import_map import TIME_UNITS_S
from gateway.importing.missing_rows import TOLERANCE
from gateway.importing.time_column import line_through
from gateway.importing.time_counter import TimeCounter

LIKELY_HZ: Final = (1500.0, 400_000.0)
# Rates of slower devices, whose times have a name.
_SLOWEST_HZ: Final = 5.0
# Seconds since 1970: of the years 2000 to 2100.
_SINCE_1970_S: Final = (0.95e9, 4.1e9)
# Day numbers of the same years, and the day of each on which 1970 began: of Excel and of MATLAB.
_DAYS: Final = (((36_500.0, 73_100.0), 25_569.0), ((730_500.0, 767_100.0), 719_529.0))
# Rounding repeats a larger share of the times, or none.
_MAX_COMPARED: Final = 4
# Share of steps that skip no sample in a column of times with gaps.
_REGULAR_SHARE: Final = 0.8
_FEW_REPEATS: Final = 0.01
# Steps by which rounding to the coarsest grid that an import takes moves a time.
_MAX_OFFSET_STEPS: Final = 0.7
# Times that repeat more often are coarser than an import takes, which is 1.2 sample intervals.
_MAX_REPEAT_SHARE: Final = 0.2


def find_time(finite: Sequence[tuple[Seen, FloatArray]], guess: Guess) -> None:
    """Find the column of times, those with such a name or unit first; else say what is wrong with one."""
    accelerations = [column for column, _ in finite if column.says_acceleration][:_MAX_COMPARED]
    ordered = sorted(finite, key=lambda pair: not _is_named_time(pair[0]))
    named = [(column, values) for column, values in finite if _is_named_time(column)]
    if any(_is_time(column, values, guess, LIKELY_HZ, accelerations) for column, values in ordered):
        return
    if any(_is_time(column, values, guess, (_SLOWEST_HZ, LIKELY_HZ[0]), accelerations) for column, values in named):
        return
    for column, values in named:
        stamped, fill = _without_fill(column, values)
        fault = _time_fault(stamped, stamped.values[np.isfinite(stamped.values)], fill)
        if fault is not None:
            guess.no_time, guess.rate_hz = fault
            return


def _without_fill(column: Seen, values: FloatArray) -> tuple[Seen, str]:
    """Return a column without the number that most rows have instead of a time, and what is said of that."""
    unique, counts = np.unique(values, return_counts=True)
    if not len(unique) or counts.max() <= _REGULAR_SHARE * len(values) or len(unique) < 3:
        return column, "unevenly"
    fill = unique[np.argmax(counts)]
    stamps = np.where(column.values == fill, np.nan, column.values)
    return replace(column, values=stamps), f"and {fill:g} between"


def _is_named_time(column: Seen) -> bool:
    return column.unit in TIME_UNITS_S or (not column.unit and TIME.search(column.name) is not None)


def _time_units(column: Seen, values: FloatArray) -> list[str]:
    """Return the units in which a column may count time: the stated one, that of times since 1970, or any."""
    if column.unit in TIME_UNITS_S:
        # A program may write another unit than it names.
        return [column.unit, *(unit for unit in ("s", "ms", "us") if unit != column.unit)]
    for unit in ("s", "ms", "us", "ns"):
        if len(values) and _SINCE_1970_S[0] < values[0] * TIME_UNITS_S[unit] < _SINCE_1970_S[1]:
            return [unit]
    if len(values) and _since_1970_d(float(values[0])) is not None:
        return ["d", "s", "ms", "us"]
    return ["s", "ms", "us"]


def _since_1970_d(days: float) -> float | None:
    """Return a day number as days since 1970, None where it is none of the years 2000 to 2100."""
    return next((days - epoch_d for (low, high), epoch_d in _DAYS if low < days < high), None)


@dataclass(frozen=True, slots=True)
class _Times:
    """A column whose values rise evenly.

    Attributes:
        column: the column.
        values: (n,) its finite values, which a counter that starts again continues.
        rows: (n,) their rows.
        skipped: (n-1,) samples that each step skips.
        step: usual step from row to row.
        has_restarts: whether its counter starts again.
    """

    column: Seen
    values: FloatArray
    rows: IntArray
    skipped: IntArray
    step: float
    has_restarts: bool

    @classmethod
    def of(cls, column: Seen, values: FloatArray) -> "_Times | None":
        """Return a column of times, None where it is none."""
        counter = TimeCounter()
        values = counter.look(values)
        rows = np.flatnonzero(np.isfinite(column.values))
        steps, spans = np.diff(values), np.diff(rows)
        if len(steps) < 2 or not (steps >= 0).all() or not steps.any() or np.mean(steps == 0.0) > _MAX_REPEAT_SHARE:
            return None
        skipped = _skipped(steps) if (spans == 1).all() else np.zeros(len(steps), dtype=np.intp)
        # Times may be rounded, but their trend is straight.
        places = np.concatenate(([0], np.cumsum(spans + skipped)))
        trend = values[0] + (values[-1] - values[0]) * places / places[-1]
        step = _usual_step(steps / (spans + skipped))
        farthest = 3.0 * max(step, float((steps / (spans + skipped)).max()))
        if float(np.abs(values - trend).max()) > farthest * float(spans.max()):
            return None
        # Rounding repeats times, but leaves them near their line.
        if not steps.all() and line_through(places, values)[1] > _MAX_OFFSET_STEPS * step:
            return None
        if np.median(spans) > 1.0 and float(np.abs(steps - step * spans).max()) > 0.5 * step:
            return None
        return cls(column, values, rows, skipped, step, counter.restarts > 0)

    def rate_hz(self, unit: str) -> float:
        """Return the rate where they count in a unit."""
        return 1.0 / (self.step * TIME_UNITS_S[unit])

    def unit(self, units: Sequence[str], rates_hz: tuple[float, float], beside: Sequence[Seen]) -> str | None:
        """Return the stated unit, or the first that gives a likely rate; None without one.

        Without a stated unit, a slow rate in a larger unit counts first: a smaller unit only where accelerations then
        show the revolutions of a wheel.
        """
        stated_unit = self.column.unit
        for unit in units:
            rate_hz = self.rate_hz(unit)
            # Another unit than the stated one counts where that allows no rate at all.
            if stated_unit in TIME_UNITS_S and unit != stated_unit and self.rate_hz(stated_unit) < LIKELY_HZ[1]:
                return None
            is_slow = unit not in (stated_unit, units[-1]) and _SLOWEST_HZ <= rate_hz < LIKELY_HZ[0]
            if is_slow and rates_hz == LIKELY_HZ and not _roll(beside, 1e3 * rate_hz):
                return None
            if rates_hz[0] <= rate_hz <= rates_hz[1] and (TIME.search(self.column.name) or self.step != 1.0):
                return unit
        return None

    def doubt(self, unit: str, likeliest: str) -> str:
        """Return what is doubtful where they count in a unit, empty where nothing is."""
        column, rate_hz, gaps = self.column, self.rate_hz(unit), int(np.count_nonzero(self.skipped))
        if rate_hz < MIN_RATE_HZ:
            return f"too low: a contact edge takes {MIN_RATE_HZ:g} Hz or more"
        if self.has_restarts:
            return "its counter starts again"
        if column.fault:
            return column.fault
        if (span := float(np.median(np.diff(self.rows)))) > 1.0:
            return f"stamps of blocks of {span:.4g} rows"
        if gaps:
            return f"{int(self.skipped.sum())} samples are missing in {gaps} gap{'s' * (gaps > 1)}"
        if unit != likeliest:
            remark = f"its name says {likeliest}, in which"
            remark = remark if column.unit in TIME_UNITS_S else f"no unit is stated: in {likeliest}"
            return f"{remark} it would be {rate_hz * TIME_UNITS_S[unit] / TIME_UNITS_S[likeliest]:.6g} Hz"
        steps = np.diff(self.values)
        if 0 < np.count_nonzero(steps == 0.0) < _FEW_REPEATS * len(steps):
            return f"repeats in {column.where(int(self.rows[np.argmin(steps) + 1]))}"
        return ""


def _is_time(
    column: Seen, values: FloatArray, guess: Guess, rates_hz: tuple[float, float], accelerations: Sequence[Seen]
) -> bool:
    """Note a column of uniform times, with its unit."""
    times = _Times.of(column, values)
    if times is None:
        return False
    units = _time_units(column, times.values)
    unit = times.unit(units, rates_hz, accelerations)
    if unit is None:
        return False
    guess.time, guess.time_unit, guess.rate_hz = column.name, unit, times.rate_hz(unit)
    guess.time_doubt = times.doubt(unit, units[0])
    guess.time_fault = column.fault if guess.time_doubt == column.fault else ""
    first = _since_1970_d(float(times.values[0])) if unit == "d" else float(times.values[0])
    since_1970_s = (first or 0.0) * TIME_UNITS_S[unit]
    if _SINCE_1970_S[0] < since_1970_s < _SINCE_1970_S[1]:
        guess.since_1970_s = since_1970_s
    return True


def _roll(accelerations: Sequence[Seen], rate_hz: float) -> bool:
    """Return whether an acceleration shows the revolutions of a wheel at a rate."""
    return any(is_rolling(column.values, rate_hz, column.unit_mps2) for column in accelerations)


def _skipped(steps: FloatArray) -> IntArray:
    """Return the number of samples that each step skips, where most skip none and the others whole numbers."""
    typical = float(np.median(steps))
    zeros: IntArray = np.zeros(len(steps), dtype=np.intp)
    if not typical > 0.0:
        return zeros
    multiples = np.rint(steps / typical)
    fits_whole = (np.abs(steps / typical - multiples) <= TOLERANCE) & (multiples >= 1.0)
    if not fits_whole.all() or np.mean(multiples == 1.0) < _REGULAR_SHARE or (multiples > 1.0).sum() == 0:
        return zeros
    return (multiples - 1.0).astype(np.intp)


def _usual_step(steps: FloatArray) -> float:
    """Return the mean step of times, without those of gaps where most are alike."""
    typical = float(np.median(steps))
    is_regular = np.abs(steps - typical) <= 0.5 * typical
    return float(steps[is_regular].mean()) if typical > 0.0 and np.mean(is_regular) > 0.9 else float(steps.mean())


def _time_fault(column: Seen, values: FloatArray, spacing: str) -> tuple[str, float | None] | None:
    """Return why a column of times cannot be used, and the rate by its regular steps; None where it is no time."""
    steps = np.diff(values)
    rows = np.flatnonzero(np.isfinite(column.values))
    if len(rows) > 2 and float(np.median(np.diff(rows))) > 1.0 and (steps > 0.0).all():
        rows_per_time = float(np.median(np.diff(rows)))
        rate_hz = _likely_hz(column, values, float(values[-1] - values[0]) / float(rows[-1] - rows[0]))
        return _with_rate(f"'{column.name}' has a time once in {rows_per_time:.4g} rows, {spacing}", rate_hz)
    if len(steps) > 2 and (steps >= 0.0).all() and np.mean(steps == 0.0) > _MAX_REPEAT_SHARE:
        return _block_clock(column, values, steps)
    typical = float(np.median(steps)) if len(steps) > 2 else 0.0
    is_regular = np.abs(steps - typical) <= 0.5 * typical
    if typical <= 0.0 or np.mean(is_regular) < 0.5:
        return None
    wrong = np.flatnonzero(steps <= 0.0)
    event = "steps back" if len(wrong) and steps[wrong[0]] < 0.0 else "repeats"
    if not len(wrong):
        wrong, event = np.flatnonzero(~is_regular), "skips"
    if not len(wrong):
        return _rate_change(column, values, steps)
    reason = f"'{column.name}' {event} in {column.where(int(rows[wrong[0] + 1]))}"
    return _with_rate(reason, _likely_hz(column, values, float(steps[is_regular].mean())))


def _with_rate(reason: str, rate_hz: float | None) -> tuple[str, float | None]:
    return (reason if rate_hz is None else f"{reason}; {rate_hz:.6g} Hz by its other steps"), rate_hz


def _rate_change(column: Seen, values: FloatArray, steps: FloatArray) -> tuple[str, float | None] | None:
    """Return that the rate of even times is another at the end than at the beginning, and that of the beginning."""
    part = max(1, len(steps) // 10)
    first_hz, last_hz = (
        _likely_hz(column, values, float(steps[section].mean())) for section in (slice(part), slice(-part, None))
    )
    if first_hz is None or last_hz is None:
        return None
    return (
        f"'{column.name}' goes from {first_hz:.6g} to {last_hz:.6g} Hz: cut the file where the rate changes",
        first_hz,
    )


def _block_clock(column: Seen, values: FloatArray, steps: FloatArray) -> tuple[str, float | None] | None:
    """Return that times advance only from block to block, and the rate by whole blocks; None with less than three."""
    advances = np.flatnonzero(steps > 0.0)
    if len(advances) < 3:
        return None
    rows = int(advances[-1] - advances[0])
    span = float(values[advances[-1] + 1] - values[advances[0] + 1])
    spacing = rows / (len(advances) - 1)
    return _with_rate(f"'{column.name}' advances once in {spacing:.4g} rows", _likely_hz(column, values, span / rows))


def _likely_hz(column: Seen, values: FloatArray, step: float) -> float | None:
    """Return the rate by a step of a column of times in the first unit that makes it likely, None without one."""
    rates_hz = (1.0 / (step * TIME_UNITS_S[unit]) for unit in _time_units(column, values))
    return next((rate_hz for rate_hz in rates_hz if LIKELY_HZ[0] <= rate_hz <= LIKELY_HZ[1]), None)
