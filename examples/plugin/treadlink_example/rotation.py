"""Estimator `rotation`: turns of the wheel in a second."""

from __future__ import annotations

import math

from gateway.core.estimates.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions, not_used
from gateway.core.quantity import Basis, Quantity

FREQUENCY = Quantity(
    "wheel_hz", "turns in a second", "Omega / (2 pi)", powers={Basis.RATE: 1.0}, possible=(0.0, math.inf)
)


class RotationEstimator:
    """Frequency of the wheel in each revolution; follows `gateway.core.estimates.estimator.Estimator`."""

    name = "rotation"
    quantities = (FREQUENCY,)

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return wheel_hz, with the error of the period."""
        if revolution.faults:
            return (Estimate.invalid(FREQUENCY.name, not_used(revolution.faults)),)
        frequency_hz = revolution.omega_radps / (2.0 * math.pi)
        std = frequency_hz * revolution.period_std_s / revolution.period_s
        status = Status.VALID if math.isfinite(std) else Status.PROVISIONAL
        return (Estimate(FREQUENCY.name, frequency_hz, std, status),)

    def reset(self) -> None:
        """Do nothing: the estimator has no memory."""
