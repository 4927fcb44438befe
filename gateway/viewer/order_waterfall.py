"""Magnitude of the orders of a wheel over time and over speed, in bounded memory."""

from __future__ import annotations

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.estimates.estimator import Revolution
from gateway.core.types import FloatArray

ORDERS: Final = 61
_COLUMNS: Final = 512
_SPEED_STEP_MPS: Final = 0.5
_SPEEDS: Final = 200


def magnitudes(revolution: Revolution) -> FloatArray:
    """Return the amplitudes of orders 0 to 60 of each axis as measured, (3, 61), m/s^2; NaN where unknown."""
    axes = revolution.axes_mps2
    result = np.full((3, ORDERS), np.nan)
    end = min(ORDERS, axes.shape[1] // 2, revolution.order_max + 1)
    result[:, :end] = np.abs(np.fft.rfft(axes, axis=1)[:, :end]) * 2.0 / axes.shape[1]
    result[:, 0] *= 0.5
    return result


class OrderColumns(NamedTuple):
    """Columns of a picture of orders.

    Attributes:
        x: (n,) times in s or speeds in m/s.
        width: of a column; 0 where each is as wide as its revolution.
        orders_mps2: (n, 61) mean amplitudes.
    """

    x: FloatArray
    width: float
    orders_mps2: FloatArray


class OrderWaterfall:
    """Mean amplitudes of a wheel's revolutions in columns of time and of speed.

    Attributes:
        learnt: (2, columns, 3, 61) their sums and counts.
    """

    def __init__(self, span_s: float, learnt: NDArray[np.float32] | None = None) -> None:
        """Start for a recording of a length, with what was learnt of it before."""
        self._width_s = max(span_s, 1.0) / _COLUMNS
        empty = np.zeros((2, _COLUMNS + _SPEEDS, 3, ORDERS), np.float32)
        self.learnt = empty if learnt is None else learnt

    def add(self, time_s: float, speed_mps: float, orders_mps2: FloatArray) -> None:
        """Take the amplitudes of a revolution, (3, 61)."""
        by_time = min(max(int(time_s / self._width_s), 0), _COLUMNS - 1)
        by_speed = _COLUMNS + min(int(speed_mps / _SPEED_STEP_MPS), _SPEEDS - 1)
        is_finite = np.isfinite(orders_mps2)
        self.learnt[:, [by_time, by_speed]] += np.stack([np.where(is_finite, orders_mps2, 0.0), is_finite])[:, None]

    def columns(self, axis: int, *, is_over_speed: bool) -> OrderColumns:
        """Return the columns that have a revolution."""
        part = slice(_COLUMNS, None) if is_over_speed else slice(0, _COLUMNS)
        width = _SPEED_STEP_MPS if is_over_speed else self._width_s
        sums, counts = self.learnt[:, part, axis]
        used = np.flatnonzero(counts.any(axis=1))
        with np.errstate(invalid="ignore"):
            return OrderColumns(
                np.array((used + 0.5) * width, np.float64), width, np.array(sums[used] / counts[used], np.float64)
            )
