"""Estimator `rotation`: rotational speed of the wheel."""

from __future__ import annotations

import math

from gateway.estimators.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions, not_used


class RotationEstimator:
    """Rotational speed of each revolution; follows `gateway.estimators.estimator.Estimator`."""

    name = "rotation"

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return rotation_rpm, with the error of the period."""
        if revolution.faults:
            return (Estimate.invalid("rotation_rpm", not_used(revolution.faults)),)
        rpm = revolution.omega_radps * 30.0 / math.pi
        std = rpm * revolution.period_std_s / revolution.period_s
        status = Status.VALID if math.isfinite(std) else Status.PROVISIONAL
        return (Estimate("rotation_rpm", rpm, std, status),)

    def reset(self) -> None:
        """Do nothing: the estimator has no memory."""
