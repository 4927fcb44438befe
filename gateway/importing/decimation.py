"""Decimation of measurements above the protocol's sampling rate, behind an anti-alias filter without delay."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import Final

import numpy as np

from firmware_protocol.wire import MAX_RATE_HZ
from gateway.core.types import BoolArray, FloatArray

PASSBAND: Final = 0.4
"""End of the pass band, as a share of the new rate."""
STOPBAND: Final = 0.5
"""Begin of the stop band, as a share of the new rate: nothing is folded into the spectrum."""
RIPPLE_DB: Final = 0.001
"""Largest deviation from 1 in the pass band."""
ATTENUATION_DB: Final = 80.0
"""Smallest attenuation in the stop band."""
# The design rule is an estimate; the test measures the response.
_DESIGN_DB: Final = ATTENUATION_DB + 2.0
# Relative; a measured rate this close to the limit is the limit.
_SAME_RATE: Final = 1e-5


def decimation_factor(rate_hz: float) -> int:
    """Return the smallest whole number that divides a rate down to what the protocol supports."""
    return max(1, math.ceil(rate_hz / MAX_RATE_HZ * (1.0 - _SAME_RATE)))


@cache
def _taps(factor: int) -> FloatArray:
    """Return the symmetric impulse response of a low-pass designed with a Kaiser window, of odd length and sum 1."""
    from scipy.signal import firwin, kaiserord

    # Frequencies relative to the old Nyquist frequency.
    count, beta = kaiserord(_DESIGN_DB, 2.0 * (STOPBAND - PASSBAND) / factor)
    raw = firwin(count | 1, (STOPBAND + PASSBAND) / factor, window=("kaiser", beta))
    taps: FloatArray = raw / raw.sum()
    return taps


@dataclass(frozen=True, slots=True)
class Decimation:
    """Description of a decimation.

    Attributes:
        factor: old over new rate.
        source_rate_hz: rate of the file.
        taps: length of the filter's impulse response.
    """

    factor: int
    source_rate_hz: float
    taps: int

    @classmethod
    def of(cls, factor: int, source_rate_hz: float) -> Decimation | None:
        """Return the decimation by a factor, None for 1."""
        return cls(factor, source_rate_hz, len(_taps(factor))) if factor > 1 else None

    @property
    def passband_hz(self) -> float:
        """Frequency up to which the spectrum is unchanged."""
        return PASSBAND * self.source_rate_hz / self.factor

    @property
    def stopband_hz(self) -> float:
        """Frequency from which on the spectrum is removed."""
        return STOPBAND * self.source_rate_hz / self.factor


class Decimator:
    """Decimation of consecutive rows: row j of the result is at row j * factor.

    The filter is symmetric, so it has no delay. Its half length is about 25 rows of the result: so far a gap widens in
    both directions. Before the first and after the last row the value is taken as constant.
    """

    def __init__(self, factor: int, filtered: int, limits: FloatArray) -> None:
        """Prepare the filter.

        Args:
            factor: 1 or more; with 1, rows pass unchanged.
            filtered: number of leading columns to filter; of the others the mean of `factor` rows is taken.
            limits: (filtered,) magnitude from which on a value is saturated, infinite where there is none.
        """
        self._factor = factor
        self._filtered = filtered
        self._limits = limits
        self._taps = _taps(factor) if factor > 1 else np.ones(1)
        self._half = len(self._taps) // 2
        self._rows = np.empty((0, 0))
        self._is_primed = False

    def feed(self, rows: FloatArray, *, last: bool = False) -> FloatArray:
        """Return the rows of the result that are complete; with `last`, all that remain.

        Args:
            rows: (n, columns) next rows, NaN where there is no value.
            last: whether these are the last ones; n may then be 0.
        """
        if self._factor == 1:
            return rows
        if not self._is_primed and len(rows):
            self._rows = np.repeat(rows[:1], self._half, axis=0)
            self._is_primed = True
        if not self._is_primed:
            return rows
        self._rows = np.concatenate((self._rows, rows)) if len(rows) else self._rows
        buffer = self._rows
        if last:
            buffer = np.concatenate((buffer, np.repeat(buffer[-1:], self._half, axis=0)))
        count = (len(buffer) - len(self._taps)) // self._factor + 1
        if count <= 0:
            return rows[:0]
        window = buffer[: (count - 1) * self._factor + len(self._taps)]
        self._rows = self._rows[count * self._factor :].copy()
        return self._decimated(window, count)

    def _decimated(self, window: FloatArray, count: int) -> FloatArray:
        """Return (count, columns) rows; the first is centred on row `half` of the window."""
        from scipy.signal import upfirdn

        centre = slice(self._half, self._half + (count - 1) * self._factor + 1, self._factor)
        result: FloatArray = window[centre].copy()
        begin = self._half - self._factor // 2
        groups = window[begin : begin + count * self._factor, self._filtered :].reshape(count, self._factor, -1)
        present = np.isfinite(groups)
        numbers, sums = present.sum(axis=1), np.where(present, groups, 0.0).sum(axis=1)
        result[:, self._filtered :] = np.where(numbers > 0, sums / np.maximum(numbers, 1), np.nan)
        # Of the full convolution upfirdn keeps each factor-th value, counted from the first.
        shift = -(len(self._taps) - 1) % self._factor
        first = (len(self._taps) - 1 + shift) // self._factor
        padding = np.zeros(shift)
        for column in range(self._filtered):
            values = window[:, column]
            absent = ~np.isfinite(values)
            padded = np.concatenate((padding, np.where(absent, 0.0, values)))
            filtered = upfirdn(self._taps, padded, down=self._factor)[first : first + count]
            # A filtered overload would look like a measured value.
            overloaded = np.abs(values) >= self._limits[column]
            if overloaded.any():
                sign = np.sign(result[:, column])
                affected = self._touched(overloaded, count, self._factor)
                filtered = np.where(affected, np.where(sign == 0, 1.0, sign) * self._limits[column], filtered)
            if absent.any():
                filtered = np.where(self._touched(absent, count, self._half), np.nan, filtered)
            result[:, column] = filtered
        return result

    def _touched(self, marked: BoolArray, count: int, reach: int) -> BoolArray:
        """Return for each row of the result whether a row within `reach` of it is marked."""
        sums = np.concatenate(([0], np.cumsum(marked)))
        centres = self._half + self._factor * np.arange(count)
        touched: BoolArray = sums[np.minimum(centres + reach + 1, len(marked))] > sums[np.maximum(centres - reach, 0)]
        return touched
