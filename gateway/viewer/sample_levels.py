"""Samples at any scale: the smallest and the largest of each bin of time, and their times."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.types import FloatArray
from gateway.exporting.recorded_signals import SignalBlock
from gateway.viewer.level_cache import Arrays

FINEST_S: Final = 0.02
"""Bin of a recording of up to three quarters of an hour; a longer one has as many bins, each longer."""
MAX_BINS: Final = 1 << 17
_MAX_WHEELS: Final = 64
_KNOT_S: Final = 0.5
_NEARBY_KNOTS: Final = 128
# Numbers of samples have 32 bits.
_NUMBERS: Final = 1 << 32
_SAME_COUNT_S: Final = 0.5


class Envelope(NamedTuple):
    """Samples over time: of each column the smallest and the largest, NaN where there is none.

    Attributes:
        time_s: (n,) middle of the columns, or times of the samples.
        low: (n, 3) of the circumferential, lateral and radial axis, m/s^2.
        high: (n, 3) likewise; equal to `low` where each column is a sample.
        lost: (n,) samples that were lost before the column's.
    """

    time_s: FloatArray
    low: FloatArray
    high: FloatArray
    lost: FloatArray


class _Bins(NamedTuple):
    low: NDArray[np.float32]
    high: NDArray[np.float32]
    lost: NDArray[np.float32]


class SampleLevels:
    """Bins of equal length; memory does not depend on the number of samples.

    Attributes:
        wheels: by position, in the order in which they came.
        bin_s: length of a bin.
    """

    def __init__(self, begin_s: float, bin_s: float, count: int) -> None:
        """Start without a sample."""
        self._begin_s, self.bin_s, self._count = begin_s, bin_s, count
        self.wheels: dict[str, _Bins] = {}

    @classmethod
    def over(cls, span_s: float) -> SampleLevels:
        """Return bins for a recording of a length."""
        bin_s = max(FINEST_S, span_s / MAX_BINS)
        return cls(0.0, bin_s, max(1, int(np.ceil(span_s / bin_s))))

    def add(self, wheel: str, time_s: FloatArray, axes_mps2: FloatArray, lost: int = 0) -> None:
        """Take samples of a wheel: times (n,) that do not decrease, and axes (n, 3)."""
        bins = self.wheels.get(wheel)
        if bins is None:
            if len(self.wheels) >= _MAX_WHEELS:
                return
            empty = np.full((self._count, 3), np.nan, np.float32)
            bins = self.wheels[wheel] = _Bins(empty, empty.copy(), np.zeros(self._count, np.float32))
        index = ((time_s - self._begin_s) / self.bin_s).astype(np.int64).clip(0, self._count - 1)
        firsts = np.flatnonzero(np.diff(index, prepend=-1))
        rows = index[firsts]
        bins.low[rows] = np.fmin(bins.low[rows], np.fmin.reduceat(axes_mps2, firsts, axis=0))
        bins.high[rows] = np.fmax(bins.high[rows], np.fmax.reduceat(axes_mps2, firsts, axis=0))
        bins.lost[rows[0]] += lost

    def arrays(self) -> Arrays:
        """Return all that it has learnt."""
        return {
            f"{name} {wheel}": part
            for wheel, bins in self.wheels.items()
            for name, part in zip(_Bins._fields, bins, strict=True)
        }

    def restore(self, arrays: Arrays) -> None:
        """Take what `arrays` returned; KeyError and ValueError where it is not whole, or of another recording."""
        for name in arrays:
            kind, _, wheel = name.partition(" ")
            if kind == "low":
                self.wheels[wheel] = _Bins(*(arrays[f"{part} {wheel}"] for part in _Bins._fields))
                if self.wheels[wheel].low.shape != (self._count, 3):
                    raise ValueError("of another length")

    def envelope(self, wheel: str, begin_s: float, end_s: float, columns: int) -> Envelope:
        """Return the samples of a wheel from one time to another in at most so many columns, and one more."""
        first = max(int((begin_s - self._begin_s) / self.bin_s), 0)
        end = min(int(np.ceil((end_s - self._begin_s) / self.bin_s)) + 1, self._count)
        width = max(1, -(-(end - first) // columns))
        # Columns stay where they are when the view moves.
        first -= first % width
        starts = np.arange(first, max(end, first + 1), width)
        end = min(int(starts[-1]) + width, self._count)
        firsts = starts - first
        low, high, lost = (part[first:end].astype(np.float64) for part in self.wheels[wheel])
        return Envelope(
            np.array(self._begin_s + (starts + 0.5 * width) * self.bin_s, np.float64),
            np.fmin.reduceat(low, firsts, axis=0),
            np.fmax.reduceat(high, firsts, axis=0),
            np.add.reduceat(lost, firsts),
        )


class SampleTimes:
    """Times of samples by their numbers, as a pass over the whole recording dates them.

    A part that is read alone learns less of the clocks, and would date the same samples otherwise each time.

    Attributes:
        tables: segment, number and time of some samples, (3, n) by wheel.
    """

    def __init__(self, tables: dict[str, FloatArray] | None = None) -> None:
        """Start with what was learnt before."""
        self._rows: dict[str, list[FloatArray]] = {}
        self.tables: dict[str, FloatArray] = tables or {}

    def add(self, block: SignalBlock, time_s: FloatArray) -> None:
        """Take the times of a block."""
        step = max(1, round(_KNOT_S * block.rate_hz))
        chosen = np.unique(np.append(np.arange(0, len(block), step), len(block) - 1))
        row = [np.full(len(chosen), float(block.segment)), float(block.first_sample) + chosen, time_s[chosen]]
        self._rows.setdefault(block.wheel, []).append(np.array(row))

    def finish(self) -> None:
        """Join what was learnt; it then dates samples."""
        self.tables = {wheel: np.concatenate(rows, axis=1) for wheel, rows in self._rows.items()}
        self._rows.clear()

    def dated(self, block: SignalBlock, time_s: FloatArray) -> FloatArray:
        """Return the times of a block's samples, (n,), instead of those that the part itself knows."""
        table = self.tables.get(block.wheel)
        if table is None or not table.size:
            return time_s
        knot_index = min(int(np.searchsorted(table[2], time_s[0])), table.shape[1] - 1)
        segment, knot, knot_s = table[:, knot_index]
        expected = knot + (time_s[0] - knot_s) * block.rate_hz
        first = block.first_sample + _NUMBERS * round((expected - block.first_sample) / _NUMBERS)
        if abs(first - expected) > _SAME_COUNT_S * block.rate_hz:
            return time_s
        numbers = first + np.arange(len(block))
        nearby = table[:, max(knot_index - _NEARBY_KNOTS, 0) : knot_index + _NEARBY_KNOTS]
        knots, times_s = nearby[1:, nearby[0] == segment]
        outside = np.minimum(numbers - knots[0], 0.0) + np.maximum(numbers - knots[-1], 0.0)
        dated: FloatArray = np.interp(numbers, knots, times_s) + outside / block.rate_hz
        return dated
