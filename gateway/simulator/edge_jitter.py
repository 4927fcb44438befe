"""Contact edges that come a little early or late, another amount in every revolution."""

from __future__ import annotations

import math

import numpy as np

from gateway.types import FloatArray

# An edge takes its surroundings along, fading over this angle to either side.
_REACH_RAD = 0.5


class EdgeJitter:
    """Shifts the belt's shape about each edge by a normal angle drawn for each revolution."""

    def __init__(self, leading_rad: float, trailing_rad: float, rng: np.random.Generator) -> None:
        """Take the standard deviation of either edge."""
        self._deviations = np.array([leading_rad, trailing_rad])
        self._rng = rng
        self._from = 0
        self._shifts = np.empty((0, 2))

    def place(self, angle_rad: FloatArray, edges_rad: tuple[float, float]) -> FloatArray:
        """Return the angles at which to look the undisturbed shape up; calls go forward in angle.

        Args:
            angle_rad: unwrapped material angles, rising.
            edges_rad: undisturbed (leading, trailing) contact angle.
        """
        if not self._deviations.any() or not len(angle_rad):
            return angle_rad
        turn = np.floor(angle_rad / (2.0 * math.pi) + 0.5)
        turns = turn.astype(np.int64)
        self._draw(int(turns[0]), int(turns[-1]))
        within = angle_rad - 2.0 * math.pi * turn
        moved = angle_rad.copy()
        for edge in (0, 1):
            near = np.clip((within - edges_rad[edge]) / _REACH_RAD, -1.0, 1.0)
            moved += self._shifts[turns - self._from, edge] * 0.5 * (1.0 + np.cos(math.pi * near))
        return moved

    def _draw(self, first: int, last: int) -> None:
        """Have the shifts of revolutions `first` to `last` at hand; those before are not needed again."""
        known = self._from + len(self._shifts)
        if not len(self._shifts):
            self._from = known = first
        fresh = self._rng.standard_normal((max(0, last + 1 - known), 2)) * self._deviations
        self._shifts = np.concatenate([self._shifts[first - self._from :], fresh])
        self._from = first
