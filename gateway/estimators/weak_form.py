"""The weak form: the four numbers from the belt's own shape, geometrically exact, whatever presses on the contact.

It needs neither the contact pressure nor a linear ring, only load, pressure and belt radius for the scale; the edges of
the contact only tell where the free belt begins. docs/estimators.md derives it and says what its numbers are worth.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.estimators.base import AngleAverage, Conditions, Estimate, Revolution
from gateway.estimators.determination import all_invalid, doubt_about, load_number, number_estimates, unusable
from gateway.estimators.order_errors import relative_std
from gateway.estimators.weak_form_fit import curvature_of, fits_of
from gateway.estimators.weak_form_rows import motion_begin
from gateway.estimators.weak_form_solve import WeakFormSolution, solve_balance
from gateway.physics.belt_shape import MAX_ORDER
from gateway.reasons import Code, Reason
from gateway.signal.order_spectrum import ORDER_COUNT

# The first revolution's solution is the next one's start: there is no need to converge on its noise.
_COLD_PASSES: Final = 2
# Curvature over the mean in the middle of a contact: below 0 on a drum, 0 on a road, towards 1 under hardly any load.
_FLAT_ENOUGH: Final = 0.9


class WeakFormEstimator:
    """Bs, Cw, Rs, Ts and their ratios to Cw from the running average, one pass a revolution."""

    def __init__(self) -> None:
        """Start cold."""
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "weak-form"

    def reset(self) -> None:
        """Forget the warm start."""
        self._warm: WeakFormSolution | None = None

    def update(self, revolution: Revolution, average: AngleAverage, conditions: Conditions) -> tuple[Estimate, ...]:
        """Return Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw.

        Without load or pressure the four are invalid and the ratios stand, for all four are proportional to
        Q / (p0 R^2). Provisional until the average has settled, on a revolution with faults, and where the data do not
        determine a number, model error counted. Never raises on values.
        """
        reason = unusable(average, conditions)
        if reason:
            return self._cold(reason)
        half_angle = 0.5 * (average.trailing_edge_rad - average.leading_edge_rad)
        centre = 0.5 * (average.trailing_edge_rad + average.leading_edge_rad)
        carried = int(np.flatnonzero(np.isfinite(average.orders_mps2))[-1])
        max_order = MAX_ORDER if carried >= ORDER_COUNT - 1 else carried
        offset = conditions.sensor_offset_m / conditions.radius_m
        orders, mean = curvature_of(average.radial_mps2[np.newaxis], centre, offset, max_order)
        if not np.isfinite(orders).all():
            return self._cold(Reason(Code.NO_STEADY_VALUE))
        if (curvature := float(orders[0].sum())) > _FLAT_ENOUGH:
            return self._cold(Reason(Code.NO_FLAT_CONTACT, curvature=curvature, limit=_FLAT_ENOUGH))
        std = relative_std(average.orders_std_mps2, float(mean[0]), orders[0], max_order)[np.newaxis]
        try:
            solution = solve_balance(
                orders, motion_begin(half_angle), std, self._warm, 1 if self._warm else _COLD_PASSES
            )
        except np.linalg.LinAlgError:
            return self._cold(Reason(Code.NO_BELT_SHAPE))
        if not (np.isfinite(solution.unknowns).all() and np.isfinite(solution.correction).all()):
            return self._cold(Reason(Code.NO_BELT_SHAPE))
        self._warm = solution
        fitted = fits_of(solution, std).numbers(0, load_number(conditions))
        return number_estimates(fitted, conditions, doubt_about(revolution, average))

    def _cold(self, reason: Reason) -> tuple[Estimate, ...]:
        self._warm = None
        return all_invalid(reason)
