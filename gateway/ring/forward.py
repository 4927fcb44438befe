"""Forward estimator: the exact ring with tire-locked edge waves, fitted to the averaged waveform.

The weak form takes every repeating wave for a shape of the belt. This model has parameters for edge waves, and for a
shear-flexible, extensible belt, a soft tread, damping of sidewall, tread and bending, a stiffening sidewall, and a drum
in place of the road. All have priors, so that parameters that the data do not determine widen the errors. A fit takes
about a second, so fits are made at updates 1, 2, 4, ... 32 and then every 32; in between, the numbers follow the
current load and pressure. docs/evidence/accuracy.md gives their errors.
"""

import math
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions
from gateway.core.reasons import CoreCode, Reason
from gateway.ring.determination import FittedNumbers, all_invalid, doubt_about, load_number, number_estimates, unusable
from gateway.ring.forward_fit import ForwardFit, fit_forward
from gateway.ring.forward_model import ForwardModel, P
from gateway.ring.reasons import RingCode

SHAPE: Final = ("half_angle_rad", "edge_wave_before", "edge_wave_after")

REFIT_EVERY: Final = 32
# Residual, as a share of the signal, above which the ring is rejected; 0.08 on the measured tire.
MAX_RESIDUAL_SHARE: Final = 0.35
# Standard error assumed for orders without one, as a share of the mean.
_UNKNOWN_STD: Final = 1e-3
# Correlation from which bending and shear are reported as not separable.
_INSEPARABLE: Final = 0.7


class ForwardEstimator:
    """Bs, Cw, Rs, Ts, their ratios to Cw, the contact half angle and the amplitudes of the edge waves."""

    name = "forward"

    def __init__(self) -> None:
        """Start cold."""
        self.reset()

    def reset(self) -> None:
        """Forget the last fit."""
        self._updates = 0
        self._fit: ForwardFit | None = None
        self._failure = Reason(RingCode.NO_RING_EQUILIBRIUM)

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw, then `SHAPE`.

        Edge waves are amplitudes at the edges as a share of R omega^2. Without load or pressure the four numbers are
        invalid, but not the ratios. Estimates are provisional until the average has settled, on a revolution with
        faults, and where the data do not determine a number (noise, model error and priors included). Never raises on
        values.
        """
        reason = unusable(average, conditions)
        if reason:
            return _invalid(reason)
        if self._is_due():
            self._refit(revolution, average, conditions)
        fit = self._fit
        if fit is None:
            return _invalid(self._failure)
        doubts = doubt_about(revolution, average.effective_count, is_linear_ring=conditions.tire.is_linear_ring)
        if not fit.converged:
            doubts = doubts or (Reason(RingCode.FIT_NOT_CONVERGED),)
        number = load_number(conditions)
        values = fit.numbers(number)
        scale = np.outer(values, values)
        first = slice(P.BS, P.TS + 1)
        fitted = FittedNumbers(
            values, np.ones(4, dtype=np.bool_), fit.noise[first, first] * scale, fit.model[first, first] * scale
        )
        numbers = [
            _with_shear_doubt(estimate, fit) for estimate in number_estimates(self.name, fitted, conditions, doubts)
        ]
        return (*numbers, *_shape(fit, doubts))

    def _is_due(self) -> bool:
        self._updates += 1
        count = self._updates
        return self._fit is None or count % REFIT_EVERY == 0 or (count < REFIT_EVERY and not count & (count - 1))

    def _refit(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> None:
        max_order = int(np.flatnonzero(np.isfinite(average.orders_mps2))[-1])
        steady = conditions.radius_m * average.omega_radps**2
        orders = average.orders_mps2[: max_order + 1] / steady
        order_std = np.nan_to_num(average.orders_std_mps2[: max_order + 1] / steady, nan=_UNKNOWN_STD)
        half_angle = 0.5 * (average.trailing_edge_rad - average.leading_edge_rad)
        model = ForwardModel(
            max_order,
            shear=True,
            offset=conditions.sensor_offset_m / conditions.radius_m,
            offset_std=conditions.sensor_offset_std_m / conditions.radius_m,
            steady_std=conditions.steady_std_mps2 / steady,
        )
        if not np.isfinite(orders).all():
            self._fit, self._failure = None, Reason(RingCode.ORDERS_UNUSABLE)
            return
        use_mean = not revolution.ac_coupled
        start = None if self._fit is None else self._fit.parameters
        fit = fit_forward(orders, order_std, half_angle, model, start=start, use_mean=use_mean)
        if start is not None and (fit is None or fit.residual_share > MAX_RESIDUAL_SHARE):
            fit = fit_forward(orders, order_std, half_angle, model, use_mean=use_mean)
        if fit is None:
            self._fit, self._failure = None, Reason(RingCode.NO_RING_EQUILIBRIUM)
        elif fit.residual_share > MAX_RESIDUAL_SHARE:
            self._fit = None
            self._failure = Reason(RingCode.RING_DOES_NOT_FIT, residual=fit.residual_share, limit=MAX_RESIDUAL_SHARE)
        else:
            self._fit = fit


def _with_shear_doubt(estimate: Estimate, fit: ForwardFit) -> Estimate:
    """Add the reason when bending is not determined because shear has the same effect."""
    if estimate.status is not Status.PROVISIONAL or not estimate.name.startswith("Bs"):
        return estimate
    covariance = fit.noise + fit.model
    correlation = covariance[P.BS, P.SHEAR] / math.sqrt(covariance[P.BS, P.BS] * covariance[P.SHEAR, P.SHEAR])
    if abs(correlation) < _INSEPARABLE or not any(
        reason.code is CoreCode.NOT_DETERMINED for reason in estimate.reasons
    ):
        return estimate
    shear_doubt = Reason(RingCode.BENDING_LIKE_SHEAR, correlation=float(correlation))
    return estimate._replace(reasons=(*estimate.reasons, shear_doubt))


def _shape(fit: ForwardFit, doubts: tuple[Reason, ...]) -> list[Estimate]:
    """Return half angle and amplitudes of the edge waves."""
    std = np.sqrt(np.diagonal(fit.noise + fit.model))
    before, after = fit.solution.packets()
    values = (
        (fit.half_angle_rad, fit.half_angle_std_rad()),
        (before.amplitude, math.hypot(std[P.BEFORE_COSINE], std[P.BEFORE_SINE]) / math.sqrt(2.0)),
        (after.amplitude, math.hypot(std[P.AFTER_COSINE], std[P.AFTER_SINE]) / math.sqrt(2.0)),
    )
    status = Status.PROVISIONAL if doubts else Status.VALID
    return [Estimate(name, value, error, status, doubts) for name, (value, error) in zip(SHAPE, values, strict=True)]


def _invalid(reason: Reason) -> tuple[Estimate, ...]:
    return (*all_invalid(reason), *(Estimate.invalid(name, reason) for name in SHAPE))
