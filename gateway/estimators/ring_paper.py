"""The ring paper's estimator: Eq. 28 and 29 as printed but for their misprints. The named reference.

It is what the paper describes, not the best that the signal allows: on the geometrically exact ring its numbers are off
by tens of percent, because a loaded belt is not a linear ring and contact pressure is not uniform. The equations, what
was repaired and the measured errors are in docs/ring-paper-estimator.md. Its standard errors cover noise, the fit's
residual, load, pressure and contact angle; they do not cover that model error.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gateway.estimators.base import AngleAverage, Conditions, Estimate, Revolution
from gateway.estimators.determination import (
    FittedNumbers,
    all_invalid,
    doubt_about,
    load_number,
    number_estimates,
    unusable,
)
from gateway.estimators.ring_fit import fit_ring_numbers
from gateway.reasons import Code, Reason
from gateway.types import FloatArray

# Share of the signal left over from which the ring is no description of it: 0.06 on the exact ring, 0.24 on the
# measured tire.
WORST_RESIDUAL: Final = 0.5

_MODEL_NOTE: Final = Reason(Code.LINEAR_RING)


class RingPaperEstimator:
    """Bs, Cw, Rs, Ts and their ratios to Cw from the running average's orders 1 to 60."""

    def __init__(self) -> None:
        """Start cold."""
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "ring-paper"

    def reset(self) -> None:
        """Forget the warm start."""
        self._updates = 0
        self._warm: FloatArray | None = None
        self._warm_force_m = math.nan

    def update(self, revolution: Revolution, average: AngleAverage, conditions: Conditions) -> tuple[Estimate, ...]:
        """Return Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw.

        Without load or pressure the four are invalid and the ratios stand, for all four are proportional to Q / p0.
        Provisional until the average has settled, and on a revolution with faults. Never raises on values.
        """
        reason = unusable(average, conditions)
        if reason:
            return all_invalid(reason)
        orders = np.flatnonzero(np.isfinite(average.orders_mps2))
        orders = orders[orders > 0]
        half_angle = 0.5 * (average.trailing_edge_rad - average.leading_edge_rad)
        force = load_number(conditions) * conditions.radius_m / (math.pi * half_angle)
        # Angle 0 is the middle of the contact here, wherever the segmentation has put it.
        centre = 0.5 * (average.trailing_edge_rad + average.leading_edge_rad)
        n = orders.astype(np.float64)
        coefficients = (average.orders_mps2[orders] * np.exp(1j * n * centre)).real / average.omega_radps**2
        stds = average.orders_std_mps2[orders] / average.omega_radps**2
        fit = fit_ring_numbers(n, coefficients, stds, force_m=force, half_angle_rad=half_angle, warm=self._start(force))
        if fit is None:
            self._warm = None
            return all_invalid(Reason(Code.ORDERS_UNUSABLE))
        if fit.residual > WORST_RESIDUAL:
            self._warm = None
            return all_invalid(Reason(Code.RING_DOES_NOT_FIT, residual=fit.residual, limit=WORST_RESIDUAL))
        self._warm, self._warm_force_m = fit.numbers, force

        # Both edges' definition may be off the same way, so their errors add without cancelling.
        angle_std = 0.5 * (average.leading_edge_std_rad + average.trailing_edge_std_rad)
        covariance = fit.covariance + np.outer(fit.angle_derivative, fit.angle_derivative) * _square(angle_std)
        fitted = FittedNumbers(fit.numbers, fit.free, covariance, np.zeros((4, 4)))
        return number_estimates(fitted, conditions, doubt_about(revolution, average), (_MODEL_NOTE,))

    def _start(self, force_m: float) -> FloatArray | None:
        """Return the last numbers, scaled to this force; None for a cold start, at updates 1, 2, 4, 8, ..."""
        self._updates += 1
        if self._warm is None or not self._updates & (self._updates - 1):
            return None
        result: FloatArray = self._warm * (force_m / self._warm_force_m)
        return result


def _square(value: float) -> float:
    return value * value if math.isfinite(value) else 0.0
