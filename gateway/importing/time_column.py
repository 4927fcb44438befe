"""Rate of a time column, and proof that its times are uniform, also where they are rounded."""

import math
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.columns import Block

# The ten-thousandfold of the time since 1970.
MAX_TIME_S: Final = 1e13
# About 400 times the highest rate of the protocol; a higher one is a wrong unit.
MAX_SOURCE_HZ: Final = 1e7
# Share of a sample interval; a step that deviates by more may miss or repeat a sample.
_STEP_TOLERANCE: Final = 0.5
# Relative; the protocol has one rate for the whole file.
_RATE_TOLERANCE: Final = 1e-3
_MIN_ROWS_FOR_RATE: Final = 1000
# Sample intervals by which times at one rate, also uneven or rounded ones, may stray from a straight line.
_LARGEST_STRAY: Final = 3.0
_PARTS: Final = 10
# Share of the rounding step; rounding moves a time by half a step, and the fitted line by a little more.
ROUNDING_TOLERANCE: Final = 0.6
# Share of the rounding step; times on the grid itself leave less.
_EXACT: Final = 1e-3
# Sample intervals; behind coarser rounding a missing sample is not seen.
_COARSEST: Final = 1.2
# Share of a sample interval; finer rounding is not worth mentioning.
_COARSE: Final = 0.02
_MAX_DIGITS: Final = 9
_LEARNED_ROWS: Final = 2000
_ROUNDING_STD: Final = 1.0 / math.sqrt(12.0)


class TimeColumn:
    """Check of a time column, block by block. Rows without a time follow the rows before them.

    Attributes:
        first_s: time of the first row.
        interval_s: sample interval in the first block, 0 before it.
        jitter_s: largest deviation of a step from the sample interval.
    """

    def __init__(self, column: int, unit_s: float) -> None:
        """Prepare the check.

        Args:
            column: index of the time column.
            unit_s: its unit.
        """
        self.first_s = 0.0
        self.jitter_s = 0.0
        self._column = column
        self._unit_s = unit_s
        self._last_s = math.nan
        self.interval_s = 0.0
        self._grid_s: float | None = None
        self._rounded = False
        self._rows = 0
        self._rates: list[tuple[float, float, str]] = []
        self._spaced_s: list[float] = []
        self._fault_count = 0
        self._fault = ""
        # Steps without a missing row, and their time.
        self._steps, self._stepped_s, self._pieces = 0, 0.0, 1

    def look(self, path: Path, block: Block) -> FloatArray:
        """Check the times of a block and return them in s, those of rows without a time filled in."""
        column = block.values[:, self._column]
        timed_rows = np.flatnonzero(np.isfinite(column))
        if not self._rows:
            self._learn_interval(path, block, column, timed_rows)
        times_s = self._filled(column * self._unit_s, timed_rows)
        joined_s = times_s if math.isnan(self._last_s) else np.concatenate(([self._last_s], times_s))
        self._check_steps(block, joined_s, len(times_s) - len(joined_s) + 1)
        self._last_s = float(times_s[-1])
        self._spaced_s += times_s[-self._rows % _MIN_ROWS_FOR_RATE :: _MIN_ROWS_FOR_RATE].tolist()
        self._rows += len(times_s)
        span_s = float(times_s[-1] - times_s[0])
        if len(times_s) >= _MIN_ROWS_FOR_RATE and span_s > 0:
            rounding = 2.0 * (self._grid_s or 0.0) / span_s
            self._rates.append(((len(times_s) - 1) / span_s, rounding, block.where(0)))
        return times_s

    @property
    def rounding_s(self) -> float | None:
        """Step to which the times are rounded, None when they are not, or so finely that it does not matter."""
        if self._grid_s is None or not self._rounded or self._grid_s < _COARSE * self.interval_s:
            return None
        return self._grid_s

    def rate_hz(self, path: Path) -> tuple[float, float | None]:
        """Return the rate over the whole span, and its standard error where the times are rounded.

        Raises:
            ImportDataError: the times are not uniform.
        """
        span_s = self._last_s - self.first_s
        if span_s <= 0 and self._fault and self._stepped_s > 0.0:
            span_s = self._stepped_s * (self._rows - 1) / self._steps
        if span_s <= 0:
            raise ImportDataError(
                f"{path}: the time does not advance over the file", "Check the column, or state rate_hz instead."
            )
        rate_hz = (self._rows - 1) / span_s
        rounding_s = self.rounding_s
        std_hz = None if rounding_s is None else rate_hz * math.sqrt(2.0) * _ROUNDING_STD * rounding_s / span_s
        advice = self._advice(rate_hz)
        if rounding_s is not None and rounding_s > _COARSEST * self.interval_s:
            raise ImportDataError(
                f"{path}: the times are rounded to {rounding_s * 1e3:g} ms, which is more than a sample interval",
                f"State rate_hz ({advice}) instead of time_column, if no sample is missing.",
            )
        if self._fault:
            count_note = f" ({self._fault_count} such steps in the file)" if self._fault_count > 1 else ""
            rounded = "" if rounding_s is None else f", and the times are rounded to {rounding_s * 1e3:g} ms"
            raise ImportDataError(
                f"{path}: {self._fault}{count_note}{rounded}",
                "If samples are missing, cut the file there. If no sample is missing, state rate_hz "
                f"({advice}) instead of time_column.",
            )
        for part_hz, tolerance, where in self._rates:
            if abs(part_hz / rate_hz - 1.0) > _RATE_TOLERANCE + tolerance:
                raise ImportDataError(
                    f"{path}: the rate changes: {part_hz:.6g} Hz from {where} on, {rate_hz:.6g} Hz overall",
                    "Resample the file to one rate before importing.",
                )
        return rate_hz, std_hz

    def rate_change(self) -> tuple[float, float, float] | None:
        """Return lowest and highest rate, and the time after the first row of the largest stray; None near a line."""
        times_s = np.array(self._spaced_s)
        if len(times_s) < 3:
            return None
        strays_s = np.abs(times_s - np.linspace(times_s[0], times_s[-1], len(times_s)))
        farthest = int(np.argmax(strays_s))
        if strays_s[farthest] <= _LARGEST_STRAY * self.interval_s:
            return None
        edges = np.linspace(0, len(times_s) - 1, min(len(times_s), _PARTS + 1)).astype(np.intp)
        rates_hz = _MIN_ROWS_FOR_RATE * np.diff(edges) / np.diff(times_s[edges])
        return float(rates_hz.min()), float(rates_hz.max()), float(times_s[farthest] - times_s[0])

    def _advice(self, rate_hz: float) -> str:
        """Return the rate to state instead, from the steps that skip no sample; `rate_hz` where there are none."""
        if self._fault and self._steps and self._stepped_s > 0.0:
            rate_hz = self._steps / self._stepped_s
        rounding_s = self.rounding_s
        if rounding_s is None:
            return f"about {rate_hz:.8g}"
        # Each piece between gaps has the rounding of its two ends.
        ends_s = math.sqrt(2.0 * self._pieces) * _ROUNDING_STD * rounding_s
        std_hz = rate_hz * rate_hz * ends_s / max(self._steps, 1)
        where = "the steps without a gap" if self._fault else "the whole file"
        return f"{rate_hz:.8g} +- {std_hz:.1g} by {where}"

    def _learn_interval(self, path: Path, block: Block, column: FloatArray, timed_rows: NDArray[np.intp]) -> None:
        """Learn the sample interval and the rounding from the first block."""
        times_s = column[timed_rows] * self._unit_s
        span_s = float(times_s[-1] - times_s[0]) if len(times_s) > 1 else 0.0
        self.interval_s = float(np.median(np.diff(times_s) / np.diff(timed_rows))) if len(times_s) > 1 else 0.0
        # Times that advance and step back once are a fault of that row.
        if len(times_s) > 1 and not span_s > 0 and not self.interval_s > 0:
            raise ImportDataError(
                f"{path}: the time does not advance from {block.where(0)} on",
                "Check the column and its unit, or state rate_hz instead of time_column.",
            )
        first = slice(min(len(timed_rows), _LEARNED_ROWS))
        grid = decimal_grid(column[timed_rows[first]])
        if grid is not None:
            slope_s, residual_s = line_through(timed_rows[first].astype(np.float64), times_s[first])
            if residual_s <= ROUNDING_TOLERANCE * grid * self._unit_s:
                # The median of rounded steps would be a multiple of the rounding.
                self.interval_s = slope_s
                self._grid_s = grid * self._unit_s
                self._rounded = residual_s > _EXACT * self._grid_s
        if len(times_s) > 1 and self.interval_s <= 0.0:
            raise ImportDataError(
                f"{path}: the time does not advance from {block.where(0)} on",
                "Check the column. If its times are rounded, state rate_hz instead of time_column.",
            )
        if 0.0 < self.interval_s < 1.0 / MAX_SOURCE_HZ:
            raise ImportDataError(
                f"{path}: from {block.where(0)} on the time steps by {self.interval_s:.3g} s, allowed: "
                f"{1.0 / MAX_SOURCE_HZ:g} s or more",
                "Check the column and time_unit, or state rate_hz instead of time_column.",
            )
        self.first_s = float(times_s[0] - timed_rows[0] * self.interval_s) if len(times_s) else 0.0

    def _filled(self, times_s: FloatArray, timed_rows: NDArray[np.intp]) -> FloatArray:
        if len(timed_rows) == len(times_s):
            return times_s
        rows = np.arange(len(times_s))
        last_s = self.first_s - self.interval_s if math.isnan(self._last_s) else self._last_s
        support_rows = np.concatenate(([-1], timed_rows, [len(times_s)]))
        timed_s = np.concatenate(([last_s], times_s[timed_rows]))
        end_s = timed_s[-1] + (len(times_s) - support_rows[-2]) * self.interval_s
        filled_s: FloatArray = np.interp(rows, support_rows, np.concatenate((timed_s, [end_s])))
        return filled_s

    def _check_steps(self, block: Block, times_s: FloatArray, first_row: int) -> None:
        """Note steps that miss or repeat a sample; `times_s` may begin with the last time of the block before."""
        steps_s = np.diff(times_s)
        if not len(steps_s) or self.interval_s <= 0:
            return
        deviations_s = np.abs(steps_s - self.interval_s)
        self.jitter_s = max(self.jitter_s, float(deviations_s.max()))
        # Rounding alone moves a step by up to the grid.
        is_regular = deviations_s <= _STEP_TOLERANCE * self.interval_s + (self._grid_s or 0.0)
        self._steps += int(np.count_nonzero(is_regular))
        self._stepped_s += float(steps_s[is_regular].sum())
        self._pieces += int(np.count_nonzero(~is_regular))
        faulty_rows = np.flatnonzero(deviations_s > _STEP_TOLERANCE * self.interval_s)
        if not len(faulty_rows):
            return
        if self._only_rounded(times_s):
            self._rounded = True
            return
        self._fault_count += len(faulty_rows)
        if not self._fault:
            # Where times are rounded, many steps deviate and the largest one is the gap.
            row = int(faulty_rows[0]) if self._grid_s is None else int(np.argmax(deviations_s))
            step = steps_s[row] / self.interval_s
            self._fault = f"{block.where(row + first_row)}: the time steps by {step:.3g} sample intervals"

    def _only_rounded(self, times_s: FloatArray) -> bool:
        """Return whether rounding explains all deviations from uniform times."""
        if self._grid_s is None or self._grid_s > _COARSEST * self.interval_s:
            return False
        return line_through(np.arange(len(times_s), dtype=np.float64), times_s)[1] <= ROUNDING_TOLERANCE * self._grid_s


def line_through(rows: FloatArray, times_s: FloatArray) -> tuple[float, float]:
    """Return slope and largest residual of the line through (n,) times at rows."""
    centred = rows - rows.mean()
    mean_s = float(times_s.mean())
    slope_s = float(centred @ (times_s - mean_s) / max(float(centred @ centred), 1.0))
    return slope_s, float(np.abs(times_s - mean_s - slope_s * centred).max())


def decimal_grid(values: FloatArray) -> float | None:
    """Return the largest decimal step of which all differences of the values are multiples, None without one."""
    if not len(values):
        return None
    largest = float(np.abs(values).max())
    for digits in range(_MAX_DIGITS + 1):
        scaled = values * 10.0**digits
        tolerance = max(1e-6, 16 * np.finfo(np.float64).eps * largest * 10.0**digits)
        if tolerance > 0.05:
            return None
        rounded = np.rint(scaled)
        if float(np.abs(scaled - rounded).max()) <= tolerance:
            step = int(np.gcd.reduce(np.abs(np.diff(rounded)).astype(np.int64)))
            return step * 10.0**-digits if step else None
    return None
