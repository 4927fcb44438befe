"""Running weighted mean, variance and covariance, one vector at a time."""

from __future__ import annotations

import math

import numpy as np

from gateway.types import FloatArray


class RunningMoments:
    """Weighted mean and variance of vectors, updated one vector at a time.

    Attributes:
        count: vectors taken in.
        mean: (size,), a new array at every update, so that results that were handed out stay as they were.
        weight_square: sum of the squared normalised weights, 1 over the effective count: a scalar, or one value per
            element when the weights were.
    """

    def __init__(self, size: int, *, covariance: bool = False) -> None:
        """Start empty; with `covariance` the whole matrix is kept, which needs scalar weights."""
        self.count = 0
        self.mean: FloatArray = np.zeros(size)
        self.weight_square: float | FloatArray = 1.0
        self._full = covariance
        self._spread: FloatArray = np.zeros((size, size) if covariance else size)

    def update(self, values: FloatArray, weight: float | FloatArray) -> None:
        """Take values in at `weight`, the share that they get in the new mean (0: left out)."""
        self.count += 1
        change = values - self.mean
        step = weight * change
        self.mean = self.mean + step
        self._spread = (1.0 - weight) * (self._spread + (np.outer(step, change) if self._full else step * change))
        self.weight_square = (1.0 - weight) ** 2 * self.weight_square + weight * weight

    def variance(self) -> FloatArray:
        """Return the unbiased variance (with `covariance`, matrix) of one value; NaN where only one was seen."""
        freedom = 1.0 - np.asarray(self.weight_square)
        known = freedom > 1e-12
        result: FloatArray = np.where(known, self._spread / np.where(known, freedom, 1.0), math.nan)
        return result
