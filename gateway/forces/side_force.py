"""Estimator of side force and aligning moment from the displacement of the belt against the wheel.

The lateral axis gives the belt's shift and yaw; they are proportional to side force and aligning
moment, by factors and zeros that a calibration at known forces gives. The zeros contain ply steer and conicity.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import DETERMINED, SETTLED_REVOLUTIONS, Estimate, Status, TireConditions
from gateway.core.reasons import CoreCode, Reason
from gateway.core.trust.reasons import TrustCode
from gateway.core.types import FloatArray
from gateway.forces.free_belt import displacement_rows
from gateway.forces.lateral_deformation import ORDERS
from gateway.forces.lateral_shape import LateralEstimator, LateralSteps
from gateway.forces.reasons import ForceCode
from gateway.forces.side_force_calibration import LinearLaw, SideForceCalibration

NAMES: Final = ("belt_shift_m", "belt_yaw_rad", "side_force_n", "aligning_moment_nm")

# Memory of the forces in revolutions, as that of the longitudinal force.
HORIZON_REVOLUTIONS: Final = 16.0
# Largest standard error of a valid force near zero, over the load, and of a moment over load and belt radius: a slip of
# 0.1 deg makes about 2 % of the load, with a trail of a tenth of the radius.
_USEFUL_STD: Final = 0.02
_USEFUL_LEVER: Final = 0.1
# Load of a wheel whose load is not known, for these two only: a quarter of a small car.
_USUAL_LOAD_N: Final = 3000.0


_Displacement = tuple[float, float, float]
"""Value, standard error and its scattering part."""


class SideForceEstimator(LateralEstimator):
    """Shift and yaw of the belt, side force and aligning moment; no estimates without a lateral axis.

    Gives belt_shift_m, belt_yaw_rad, side_force_n and aligning_moment_nm.

    Displacement and force are positive to the left, the force being that of the road on the tire; a positive moment
    turns the tire to the left. All are means over the latest revolutions. Force and moment need a calibration.
    There are no estimates without a lateral axis.
    """

    name = "side-force"

    def __init__(self) -> None:
        super().__init__(HORIZON_REVOLUTIONS)

    def _names(self, conditions: TireConditions) -> Sequence[str]:  # noqa: ARG002 - part of the interface
        return NAMES

    def _estimates(
        self, conditions: TireConditions, edges_rad: tuple[float, float], steps: LateralSteps, row: int
    ) -> tuple[Estimate, ...]:
        half, centre = 0.5 * (edges_rad[1] - edges_rad[0]), 0.5 * (edges_rad[1] + edges_rad[0])
        record = steps.records[row]()
        rows = displacement_rows(half) @ _rotation(centre)
        values = rows @ record.lateral_m
        covariance = rows @ record.covariance @ rows.T
        # The tilt that is left reads the radial axis into the lateral one.
        by_roll = rows @ record.radial_m * steps.roll[row].std_rad
        variance = np.diagonal(covariance) + np.square(by_roll)
        lever = np.array([1.0, 1.0 / conditions.radius_m])
        shift, yaw = (values * lever).tolist()
        shift_std, yaw_std = (np.sqrt(variance) * lever).tolist()
        shift_scale_std, yaw_scale_std = scale_stds(conditions)
        scatters = tuple((np.sqrt(np.maximum(np.diagonal(covariance), 0.0)) * lever).tolist())
        count = steps.effective_counts[row]
        doubts: tuple[Reason, ...] = ()
        if count < SETTLED_REVOLUTIONS * (1.0 - 1e-9):
            doubts = (Reason(CoreCode.NOT_SETTLED, revolutions=count, needed=SETTLED_REVOLUTIONS),)
        return (
            _plain(NAMES[0], shift, math.hypot(shift_std, shift * shift_scale_std), scatters[0], doubts),
            _plain(NAMES[1], yaw, math.hypot(yaw_std, yaw * yaw_scale_std), scatters[1], doubts),
            *_forces(conditions, half, ((shift, shift_std, scatters[0]), (yaw, yaw_std, scatters[1])), doubts),
        )


def scale_stds(conditions: TireConditions) -> tuple[float, float]:
    """Return the relative errors of what scales shift and yaw: a calibration of this sensor and tire contains them."""
    gain_std = conditions.lateral_gain_std
    return gain_std, math.hypot(gain_std, conditions.radius_std_m / conditions.radius_m)


def _forces(
    conditions: TireConditions,
    half_angle_rad: float,
    displacements: tuple[_Displacement, _Displacement],
    doubts: tuple[Reason, ...],
) -> tuple[Estimate, Estimate]:
    calibration = conditions.tire.of(SideForceCalibration)
    if calibration is None:
        missing = Reason(ForceCode.NEEDS_SIDE_FORCE_CALIBRATION)
        return Estimate.invalid(NAMES[2], missing), Estimate.invalid(NAMES[3], missing)
    doubts = (*doubts, *calibration.outside(half_angle_rad, conditions.pressure_pa))
    by_pressure = calibration.factor_std(conditions.pressure_pa)
    load = conditions.load_n or _USUAL_LOAD_N
    unit = _USEFUL_LEVER * load * conditions.radius_m
    return (
        _force(NAMES[2], calibration.side, displacements[0], load, by_pressure, doubts),
        Estimate.invalid(NAMES[3], Reason(ForceCode.NEEDS_SIDE_FORCE_CALIBRATION))
        if calibration.moment is None
        else _force(NAMES[3], calibration.moment, displacements[1], unit, by_pressure, doubts),
    )


def _rotation(centre_rad: float) -> FloatArray:
    """Return the matrix that takes the coefficients of a record to those about its contact centre, (2 k, 2 k)."""
    phase = np.asarray(ORDERS) * centre_rad
    cosine, sine = np.diag(np.cos(phase)), np.diag(np.sin(phase))
    result: FloatArray = np.block([[cosine, sine], [-sine, cosine]])
    return result


def _plain(name: str, value: float, std: float, scatter_std: float, doubts: tuple[Reason, ...]) -> Estimate:
    if not (math.isfinite(value) and math.isfinite(std)):
        return Estimate.invalid(name, Reason(TrustCode.NOT_FINITE))
    return Estimate(name, value, std, Status.PROVISIONAL if doubts else Status.VALID, doubts, scatter_std)


def _force(
    name: str,
    law: LinearLaw,
    displacement: _Displacement,
    unit: float,
    by_pressure: float,
    doubts: tuple[Reason, ...],
) -> Estimate:
    """Return a force, valid where it is known to a share of the load, or to a third of itself."""
    shift, error, scatter = displacement
    value, std = law.force(shift, error)
    std = math.hypot(std, by_pressure * value)
    if math.isfinite(std) and std > max(_USEFUL_STD * unit, abs(value) / DETERMINED):
        doubts = (*doubts, Reason(TrustCode.FORCE_NOT_DETERMINED, share=std / unit, limit=_USEFUL_STD))
    return _plain(name, value, std, abs(law.factor) * scatter, doubts)
