"""Side force calibration of a tire: force per shift of the belt and moment per yaw, and its fit to known forces."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.estimates.calibrated_range import outside_calibration
from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.forces.reasons import ForceCode

# Error of the linear law at another distribution of the contact's forces than the calibration's, over models of belts
# with and without twist (docs/explanation/forces.md).
LAW_STD: Final = 0.01


@dataclass(frozen=True, slots=True)
class LinearLaw:
    """force = factor (displacement - zero).

    Attributes:
        factor: side force per shift in N/m, or aligning moment per yaw in N m/rad.
        factor_std: one standard error.
        zero: displacement without force, m or rad.
        zero_std: one standard error.
    """

    factor: float
    factor_std: float
    zero: float
    zero_std: float

    def force(self, displacement: float, std: float) -> tuple[float, float]:
        """Return the force of a displacement and its standard error, calibration included."""
        distance = displacement - self.zero
        force = self.factor * distance
        return force, math.hypot(
            self.factor * std, self.factor * self.zero_std, self.factor_std * distance, LAW_STD * force
        )


@dataclass(frozen=True, slots=True)
class SideForceCalibration:
    """Laws of side force and aligning moment.

    Attributes:
        side: side force, N, of the belt's shift.
        moment: aligning moment, N m, of its yaw; None when it was not calibrated.
        half_angle_range_rad: lowest and highest contact half angle of the runs.
        pressure_range_pa: lowest and highest gauge pressure of the runs; None where it is not known.
    """

    side: LinearLaw
    moment: LinearLaw | None
    half_angle_range_rad: tuple[float, float]
    pressure_range_pa: tuple[float, float] | None

    def outside(self, half_angle_rad: float, pressure_pa: float | None) -> tuple[Reason, ...]:
        """Return what lies outside the calibrated ranges, or is not known of them."""
        reasons = outside_calibration(half_angle_rad, self.half_angle_range_rad, pressure_pa, self.pressure_range_pa)
        if pressure_pa is None or self.pressure_range_pa is None:
            reasons.append(Reason(ForceCode.SIDE_FORCE_PRESSURE_UNKNOWN))
        return tuple(reasons)

    def factor_std(self, pressure_pa: float | None) -> float:
        """Return the relative error of the factors at another pressure than those of the runs.

        The stiffness of the sidewalls that carry the belt is k = k_s + k_p p. The share of the pressure in it, between
        0 and 1, is not known: a root mean square of 1 / sqrt(3).
        """
        if pressure_pa is None or self.pressure_range_pa is None or not pressure_pa > 0.0:
            return 0.0
        low, high = self.pressure_range_pa
        nearest = min(max(pressure_pa, low), high)
        return abs(math.log(pressure_pa / nearest)) / math.sqrt(3.0)


def fit_linear_law(
    displacements: Sequence[float],
    displacement_stds: Sequence[float],
    forces: Sequence[float],
    force_stds: Sequence[float],
) -> LinearLaw:
    """Fit a law to at least two points of different force; both coordinates have errors.

    The standard errors are those stated, enlarged where the points scatter more.

    Raises:
        ValueError: fewer than two points, or all displacements equal.
    """
    x, x_std = np.asarray(displacements, dtype=np.float64), np.asarray(displacement_stds, dtype=np.float64)
    y, y_std = np.asarray(forces, dtype=np.float64), np.asarray(force_stds, dtype=np.float64)
    if len(x) < 2 or not float(np.ptp(x)) > 0.0:
        raise ValueError("a law needs at least two points of different displacement")
    factor = float(np.polyfit(x, y, 1)[0])
    # The weight contains the factor; three passes settle it.
    for _ in range(3):
        weight = 1.0 / np.maximum(np.hypot(y_std, factor * x_std), 1e-9)
        rows = np.stack([x, -np.ones(len(x))], axis=1) * weight[:, np.newaxis]
        solution, *_rest = np.linalg.lstsq(rows, y * weight, rcond=None)
        factor = float(solution[0])
    covariance: FloatArray = np.asarray(np.linalg.inv(rows.T @ rows), dtype=np.float64)
    residuals = y * weight - rows @ solution
    if len(x) > 2:
        covariance = covariance * max(1.0, float(residuals @ residuals) / (len(x) - 2))
    zero = float(solution[1]) / factor
    by_zero = np.array([-zero, 1.0]) / factor
    return LinearLaw(factor, math.sqrt(covariance[0, 0]), zero, math.sqrt(float(by_zero @ covariance @ by_zero)))
