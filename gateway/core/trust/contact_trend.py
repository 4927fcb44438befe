"""Trend of the contact at a stated load, by which load or pressure are no longer what is stated of the drive."""

import math
from typing import Final

from gateway.core.estimates.disagreement import disagreement_std
from gateway.core.estimates.estimator import Revolution

# Memory of the numbers' averages.
_MEMORY: Final = 50
_MIN_REVOLUTIONS: Final = 8
# Revolutions over which a swinging load or the road move successive contacts alike.
_CORRELATED_REVOLUTIONS: Final = 3.0
# Change of the logarithm of the squared speed below which the contact's change by speed is not to be seen.
_LEAST_SPEED_CHANGE: Final = 0.02


class ContactTrend:
    """Follows the contacts of one wheel; deterministic, one revolution at a time.

    Load over pressure goes with the square of the contact's half angle. Its logarithm is a line over the revolutions,
    and another over that of the squared speed, which lengthens or shortens a contact under the same load.
    """

    def __init__(self) -> None:
        """Start without revolutions."""
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of tire."""
        self._count, self._last = 0, 0.0
        self._means = (0.0, 0.0, 0.0)
        # Of revolution number, speed and contact with each other.
        self._nn = self._nv = self._nc = self._vv = self._vc = self._cc = 0.0

    def take(self, revolution: Revolution, pressure_pa: float | None) -> float:
        """Take the next revolution; return one standard error of the load over pressure by its trend, relative."""
        angle_rad = revolution.trailing_edge_rad - revolution.leading_edge_rad
        if revolution.faults or not (angle_rad > 0.0 and revolution.omega_radps > 0.0):
            return self._last
        self._count += 1
        weight = 1.0 / min(self._count, _MEMORY)
        number, speed, contact = self._means
        n = self._count - number
        v = 2.0 * math.log(revolution.omega_radps) - speed
        c = math.log(max(pressure_pa or 1.0, 1.0) * angle_rad * angle_rad) - contact
        self._means = number + weight * n, speed + weight * v, contact + weight * c
        retained = 1.0 - weight
        self._nn = retained * (self._nn + weight * n * n)
        self._nv = retained * (self._nv + weight * n * v)
        self._nc = retained * (self._nc + weight * n * c)
        self._vv = retained * (self._vv + weight * v * v)
        self._vc = retained * (self._vc + weight * v * c)
        self._cc = retained * (self._cc + weight * c * c)
        self._last = self._error() if self._count >= _MIN_REVOLUTIONS else 0.0
        return self._last

    def _error(self) -> float:
        vv = self._vv + _LEAST_SPEED_CHANGE**2
        number_residual = self._nn - self._nv * self._nv / vv
        slope = (self._nc - self._nv * self._vc / vv) / number_residual
        scatter = max(self._cc - self._vc * self._vc / vv - slope * slope * number_residual, 0.0)
        # Of evenly many revolutions; a fading memory has the like of it.
        span = math.sqrt(12.0 * self._nn)
        std = span * math.sqrt(_CORRELATED_REVOLUTIONS * scatter / (min(self._count, _MEMORY) * number_residual))
        return disagreement_std(span * slope, max(std, 1e-6))
