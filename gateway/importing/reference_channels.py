"""Measured speeds, rotations and angles beside the acceleration, as values of a reference over time."""

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from gateway.core.types import FloatArray
from gateway.importing.import_map import ReferenceColumn

_MEAN_S: Final = 0.1
"""Interval over which speeds and rotations are averaged."""
_ANGLE_S: Final = 0.02
# Share of the range on both sides of the threshold that a pulse has to cross, so that noise makes no pulses.
_HYSTERESIS: Final = 0.1


class ReferenceChannel:
    """Values of one reference: means of a speed in m/s or a rotation in Hz, or turns so far."""

    def __init__(self, reference: ReferenceColumn, rate_hz: float, lowest: float, highest: float) -> None:
        """Prepare the conversion.

        Args:
            reference: the reference as the map states it.
            rate_hz: sampling rate of the file.
            lowest: smallest value of the column in the whole file.
            highest: largest value of it.
        """
        self.reference = reference
        self._rate_hz = rate_hz
        midpoint = 0.5 * (lowest + highest)
        self._threshold = midpoint if reference.threshold is None else reference.threshold
        self._margin = _HYSTERESIS * (highest - lowest)
        self._row = 0
        self._turns = 0.0
        self._last: float | None = None
        self._high: bool | None = None
        self._sum, self._places, self._count, self._begin = 0.0, 0, 0, 0
        self._next_angle = 0

    def feed(self, values: FloatArray) -> Iterator[tuple[float, float]]:
        """Yield (time in s from the first row, value) of what n more rows reveal.

        Args:
            values: (n,) column, NaN where there is no value.
        """
        quantity = self.reference.quantity
        if quantity == "pulses":
            yield from self._pulses(values)
        elif quantity == "angle":
            yield from self._angles(values)
        else:
            yield from self._means(values)
        self._row += len(values)

    @property
    def value_std(self) -> float:
        """Standard error of a value in m/s, Hz or turns."""
        return self.reference.std * self.reference.factor

    def _pulses(self, values: FloatArray) -> Iterator[tuple[float, float]]:
        """Yield the time of each rising edge, between rows where the column crosses the threshold."""
        if not self._margin > 0.0:
            return
        valid_rows = np.flatnonzero(np.isfinite(values))
        levels = values[valid_rows]
        state = np.where(levels > self._threshold + self._margin, 1, 0)
        state[levels < self._threshold - self._margin] = -1
        decided_rows = np.flatnonzero(state)
        previous = np.concatenate(([0 if self._high is None else (1 if self._high else -1)], state[decided_rows][:-1]))
        for k in decided_rows[(state[decided_rows] == 1) & (previous == -1)]:
            crossing = int(k)
            while crossing > 0 and levels[crossing - 1] > self._threshold:
                crossing -= 1
            above, below = float(levels[crossing]), self._last if crossing == 0 else float(levels[crossing - 1])
            edge_row = float(valid_rows[crossing])
            if below is not None and above > below:
                # Between rows at most one apart; beyond a gap the time of the edge is that of its first row.
                edge_row -= (above - self._threshold) / (above - below)
            yield (self._row + edge_row) / self._rate_hz, self._turns
            self._turns += self.reference.factor
        if len(decided_rows):
            self._high = bool(state[decided_rows][-1] == 1)
        if len(levels):
            self._last = float(levels[-1])

    def _angles(self, values: FloatArray) -> Iterator[tuple[float, float]]:
        """Yield the turns so far at equal intervals; the column may wrap at whole turns."""
        turns = values * self.reference.factor
        valid_rows = np.flatnonzero(np.isfinite(turns))
        if not len(valid_rows):
            return
        first = turns[valid_rows[0]] if self._last is None else self._last
        steps = np.diff(np.concatenate(([first], turns[valid_rows])))
        total_turns = self._turns + np.cumsum(steps - np.rint(steps))
        if self._last is None:
            total_turns += first
        step = max(1, round(_ANGLE_S * self._rate_hz))
        for row, value in zip(valid_rows, total_turns, strict=True):
            if self._row + row >= self._next_angle:
                yield (self._row + int(row)) / self._rate_hz, float(value)
                self._next_angle = self._row + int(row) + step
        self._turns, self._last = float(total_turns[-1]), float(turns[valid_rows[-1]])

    def _means(self, values: FloatArray) -> Iterator[tuple[float, float]]:
        """Yield the mean of each interval with values, at the mean of their times."""
        width = max(1, round(_MEAN_S * self._rate_hz))
        first = 0
        while first < len(values):
            end = min(first + width - (self._row + first - self._begin), len(values))
            part = values[first:end]
            places = np.flatnonzero(np.isfinite(part))
            self._sum += float(part[places].sum())
            self._places += int((places + (self._row + first - self._begin)).sum())
            self._count += len(places)
            first = end
            if self._row + first - self._begin >= width:
                if self._count and math.isfinite(self._sum):
                    mean = self._sum / self._count * self.reference.factor
                    yield (self._begin + self._places / self._count) / self._rate_hz, mean
                self._sum, self._places, self._count, self._begin = 0.0, 0, 0, self._row + first
