"""The forward estimator: the exact ring, with tire-locked waves beside it, fitted to the averaged waveform.

Where the weak form takes every wave that repeats for shape of the belt, this one has a place for it, and for a
shear-flexible, extensible belt, a soft tread, damping and a sidewall that stiffens: with priors, so that what the data
do not tell widens the errors. A fit takes about a second, so there is one at updates 1, 2, 4, ... 32 and then every
32; in between the numbers stand, at the current load and pressure. docs/accuracy.md says what they are worth.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.estimators.base import AngleAverage, Conditions, Estimate, Revolution, Status
from gateway.estimators.determination import (
    FittedNumbers,
    all_invalid,
    doubt_about,
    load_number,
    number_estimates,
    unusable,
)
from gateway.estimators.forward_fit import ForwardFit, fit_forward
from gateway.estimators.forward_model import ForwardModel, P
from gateway.reasons import Code, Reason

SHAPE: Final = ("half_angle_rad", "edge_wave_before", "edge_wave_after")

REFIT_EVERY: Final = 32
# Share of the signal left over from which the ring is no description of it; 0.08 on the measured tire.
WORST_LEFT_OVER: Final = 0.35
# Standard errors of orders that are not known, as a share of the mean.
_UNKNOWN_STD: Final = 1e-3
# Correlation from which bending and shear are called one.
_ALIKE: Final = 0.7


class ForwardEstimator:
    """Bs, Cw, Rs, Ts, their ratios to Cw, the contact's half angle and the size of the waves at its edges."""

    def __init__(self) -> None:
        """Start cold."""
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "forward"

    def reset(self) -> None:
        """Forget the last fit."""
        self._updates = 0
        self._fit: ForwardFit | None = None
        self._failure = Reason(Code.NO_RING_EQUILIBRIUM)

    def update(self, revolution: Revolution, average: AngleAverage, conditions: Conditions) -> tuple[Estimate, ...]:
        """Return Bs, Cw, Rs, Ts, then Bs/Cw, Rs/Cw, Ts/Cw, then `SHAPE`.

        Waves are a share of R omega^2 at the edges. Without load or pressure the four numbers are invalid and the
        ratios stand. Provisional until the average has settled, on a revolution with faults, and where the data do not
        determine a number, model error and priors counted. Never raises on values.
        """
        reason = unusable(average, conditions)
        if reason:
            return _nothing(reason)
        if self._due():
            self._refit(revolution, average, conditions)
        fit = self._fit
        if fit is None:
            return _nothing(self._failure)
        doubts = doubt_about(revolution, average)
        if not fit.converged:
            doubts = doubts or (Reason(Code.FIT_NOT_CONVERGED),)
        number = load_number(conditions)
        values = fit.numbers(number)
        scale = np.outer(values, values)
        first = slice(P.BS, P.TS + 1)
        fitted = FittedNumbers(
            values, np.ones(4, dtype=np.bool_), fit.noise[first, first] * scale, fit.model[first, first] * scale
        )
        numbers = [_told(estimate, fit) for estimate in number_estimates(fitted, conditions, doubts)]
        return (*numbers, *_shape(fit, doubts))

    def _due(self) -> bool:
        self._updates += 1
        count = self._updates
        return self._fit is None or count % REFIT_EVERY == 0 or (count < REFIT_EVERY and not count & (count - 1))

    def _refit(self, revolution: Revolution, average: AngleAverage, conditions: Conditions) -> None:
        carried = int(np.flatnonzero(np.isfinite(average.orders_mps2))[-1])
        steady = conditions.radius_m * average.omega_radps**2
        orders = average.orders_mps2[: carried + 1] / steady
        order_std = np.nan_to_num(average.orders_std_mps2[: carried + 1] / steady, nan=_UNKNOWN_STD)
        half_angle = 0.5 * (average.trailing_edge_rad - average.leading_edge_rad)
        model = ForwardModel(carried, shear=True, offset=conditions.sensor_offset_m / conditions.radius_m)
        if not np.isfinite(orders).all():
            self._fit, self._failure = None, Reason(Code.ORDERS_UNUSABLE)
            return
        use_mean = not revolution.ac_coupled
        start = None if self._fit is None else self._fit.parameters
        found = fit_forward(orders, order_std, half_angle, model, start=start, use_mean=use_mean)
        if start is not None and (found is None or found.left_over > WORST_LEFT_OVER):
            found = fit_forward(orders, order_std, half_angle, model, use_mean=use_mean)
        if found is None:
            self._fit, self._failure = None, Reason(Code.NO_RING_EQUILIBRIUM)
        elif found.left_over > WORST_LEFT_OVER:
            self._fit = None
            self._failure = Reason(Code.RING_DOES_NOT_FIT, residual=found.left_over, limit=WORST_LEFT_OVER)
        else:
            self._fit = found


def _told(estimate: Estimate, fit: ForwardFit) -> Estimate:
    """Say so when bending is lost against shear."""
    if estimate.status is not Status.PROVISIONAL or not estimate.name.startswith("Bs"):
        return estimate
    covariance = fit.noise + fit.model
    correlation = covariance[P.BS, P.SHEAR] / math.sqrt(covariance[P.BS, P.BS] * covariance[P.SHEAR, P.SHEAR])
    if abs(correlation) < _ALIKE or not any(reason.code is Code.NOT_DETERMINED for reason in estimate.reasons):
        return estimate
    alike = Reason(Code.BENDING_LIKE_SHEAR, correlation=float(correlation))
    return replace(estimate, reasons=(*estimate.reasons, alike))


def _shape(fit: ForwardFit, doubts: tuple[Reason, ...]) -> list[Estimate]:
    """Return half angle and waves."""
    std = np.sqrt(np.diagonal(fit.noise + fit.model))
    before, after = fit.solution.packets()
    values = (
        (fit.half_angle_rad, fit.half_angle_std_rad()),
        (before.amplitude, math.hypot(std[P.BEFORE_COSINE], std[P.BEFORE_SINE]) / math.sqrt(2.0)),
        (after.amplitude, math.hypot(std[P.AFTER_COSINE], std[P.AFTER_SINE]) / math.sqrt(2.0)),
    )
    status = Status.PROVISIONAL if doubts else Status.VALID
    return [Estimate(name, value, error, status, doubts) for name, (value, error) in zip(SHAPE, values, strict=True)]


def _nothing(reason: Reason) -> tuple[Estimate, ...]:
    return (*all_invalid(reason), *(Estimate.invalid(name, reason) for name in SHAPE))
