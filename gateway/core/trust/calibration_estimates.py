"""Estimates of a sensor after each revolution of its self-calibration, and what contradicts its statements."""

import math
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.core.estimates.disagreement import CONTRADICTION
from gateway.core.estimates.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.lost_steady_value import LostSteadyValue
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.contact_edges import contact_interior
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.refuted_sums import Equations, speed_errors
from gateway.core.trust.sensor_measurement import (
    MATRIX,
    MEAN,
    RIGHT,
    STEADY,
    AlongGravity,
    CalibrationStep,
    Measurement,
)

NAMES: Final = (
    "gain",
    "zero_g_offset_mps2",
    "gain_per_degc",
    "roll_tilt_rad",
    "pitch_tilt_rad",
    "sensor_offset_m",
)
_ALONG_NAME, _LATERAL_NAME = AXIS_NAMES[:2]

# Prior standard errors of G, z, G' and a: 10 %, 1 g and 0.05 % per degree as in a data sheet; belt stretch as order 1
# of R Omega^2, 2.4e-4 on a belt of 5 MN at 5000 N.
PRIOR_STDS: Final = (0.1, STANDARD_GRAVITY_MPS2, 5e-4, 3e-4)
# Systematic error of the closure as a share of R Omega^2: 1.3e-4 on a belt of 5 MN.
_CLOSURE_STD: Final = 1.5e-4
# Signal in the middle of a flat contact as a share of R Omega^2, on the exact ring over loads, and its error.
_CONTACT_LEVEL: Final = (-0.025, 0.035)
# Share of its prior error below which the zero-g offset counts as determined, and of a stated error below which a
# measured value stands against a statement that contradicts it.
_SEPARATION_SHARE: Final = 0.3
_ROLL_SEPARATED_RAD: Final = math.radians(0.2)
# Revolutions from which the estimates are settled.
LEAST_REVOLUTIONS: Final = 8


def mounting_estimates(conditions: TireConditions, step: CalibrationStep, unsure: float) -> tuple[Estimate, Estimate]:
    """Return pitch tilt and mounting offset.

    Args:
        conditions: of the revolution.
        step: after it.
        unsure: relative error of gain or rate beyond what is stated.
    """
    if step.pitch is None or step.offset is None:
        reason = step.refused or _missing_reason(step)
        return Estimate.invalid(NAMES[4], reason), Estimate.invalid(NAMES[5], reason)
    doubt = step.refused or _settling_reason(step)
    value, std = step.offset
    offset = _estimate(NAMES[5], Measurement(value, math.hypot(std, unsure * value)) if unsure else step.offset, doubt)
    if step.against:
        offset = offset._replace(reasons=(*offset.reasons, Reason(TrustCode.AXIS_AGAINST_ROLLING, axis=_ALONG_NAME)))
    stated_m, stated_std_m = conditions.claims.offset_m, conditions.claims.offset_std_m
    if stated_m is not None and abs(stated_m - step.offset.value) > 3.0 * math.hypot(stated_std_m, step.offset.std):
        is_worse = offset.status is Status.VALID and step.offset.std > _SEPARATION_SHARE * stated_std_m
        status = Status.PROVISIONAL if is_worse else offset.status
        contradiction = Reason(TrustCode.OTHER_OFFSET_STATED, stated_m=stated_m)
        offset = offset._replace(status=status, reasons=(*offset.reasons, contradiction))
    return _estimate(NAMES[4], step.pitch, doubt), offset


def _missing_reason(step: CalibrationStep) -> Reason:
    """Return why there is no estimate from the circumferential axis after a revolution that was used."""
    gravity = None if step.measured is None else step.measured.along_gravity
    if gravity is not None and gravity.is_absent:
        return gravity_absent(gravity)
    if step.has_along:
        # The acceleration is not known in the first revolution, so the axis says nothing of the mounting yet.
        return Reason(TrustCode.NEEDS_REVOLUTIONS, needed=step.revolutions + 1.0, count=float(step.revolutions))
    return Reason(TrustCode.AXIS_MISSING, axis=_ALONG_NAME)


def gravity_absent(gravity: AlongGravity) -> Reason:
    """Return the statement that the circumferential axis does not turn in gravity."""
    return Reason(TrustCode.GRAVITY_ABSENT, axis=_ALONG_NAME, share=abs(gravity.share), std=gravity.std)


def steady_value_lost(lost: LostSteadyValue) -> Reason:
    """Return the statement that the sensor is not DC-coupled as stated."""
    return Reason(TrustCode.COUPLING_CONTRADICTED, share=lost.share, std=lost.std)


def zero_contradicted(value_mps2: float, std_mps2: float, stated_std_mps2: float) -> Reason | None:
    """Return that a measured zero-g offset of the radial axis contradicts its statement; None where it does not."""
    if abs(value_mps2) <= CONTRADICTION * math.hypot(std_mps2, stated_std_mps2):
        return None
    return Reason(TrustCode.ZERO_CONTRADICTED, zero_mps2=value_mps2, std_mps2=std_mps2, stated_std_mps2=stated_std_mps2)


def roll_estimate(
    revolution: Revolution, conditions: TireConditions, step: CalibrationStep, roll: Measurement | None
) -> Estimate:
    """Return the roll tilt by the measured one, None before the first."""
    if roll is None:
        lost = Reason(TrustCode.AC_COUPLED) if revolution.ac_coupled else None
        return Estimate.invalid(NAMES[3], step.refused or lost or Reason(TrustCode.AXIS_MISSING, axis=_LATERAL_NAME))
    roll_rad, roll_std_rad = roll
    mixed = 0.0 if step.measured is None else step.measured.tilt.mixed
    by_gains = math.hypot(conditions.claims.gain_std, conditions.claims.lateral_gain_std) * roll_rad
    widened = Measurement(roll_rad, math.hypot(roll_std_rad, by_gains, mixed))
    doubt = step.refused or _settling_reason(step)
    if doubt is None and roll_std_rad > _ROLL_SEPARATED_RAD:
        doubt = Reason(TrustCode.NEEDS_TWO_SPEEDS, quantity="roll tilt")
    return _estimate(NAMES[3], widened, doubt)


def gain_estimates(
    revolution: Revolution, conditions: TireConditions, step: CalibrationStep
) -> tuple[Estimate, Estimate, Estimate]:
    """Return gain, zero-g offset and gain over temperature."""
    refused = step.refused
    if revolution.ac_coupled:
        lost = Reason(TrustCode.AC_COUPLED)
        gain = step.floor
        if gain is None or refused is not None:
            gain = Estimate.invalid(NAMES[0], refused or Reason(RevolutionCode.NO_CONTACT))
        return gain, Estimate.invalid(NAMES[1], lost), Estimate.invalid(NAMES[2], lost)
    information = step.sums[MATRIX].reshape(4, 4)
    if not information[0, 0] > 0.0:
        reason = refused or Reason(TrustCode.NO_REVOLUTION_YET)
        first, second, third = (Estimate.invalid(name, reason) for name in NAMES[:3])
        return first, second, third
    stds = np.array(PRIOR_STDS)
    covariance = np.linalg.inv(information + np.diag(stds**-2.0))
    corrections = covariance @ step.sums[RIGHT]
    steady = covariance @ step.sums[STEADY] * _CLOSURE_STD
    errors = np.sqrt(np.diag(covariance) + np.square(steady))
    by_speed = speed_errors(Equations(*step.sums[MEAN].tolist()))
    errors[1] = math.hypot(errors[1], by_speed.zero_mps2)
    gradient = np.array([1.0, 0.0, step.warm, 0.0])
    gain_value = 1.0 + float(gradient @ corrections)
    radius_error = conditions.radius_std_m / conditions.radius_m
    gain_std = math.sqrt(
        float(gradient @ covariance @ gradient) + float(gradient @ steady) ** 2 + (gain_value * radius_error) ** 2
    )
    doubt = refused or _settling_reason(step)
    one_speed = Reason(TrustCode.NEEDS_TWO_SPEEDS, quantity="gain")
    is_unseparated = errors[1] > _SEPARATION_SHARE * PRIOR_STDS[1]
    if not is_unseparated:
        gain_std = math.hypot(gain_std, by_speed.gain)
    zero, stated_std = Measurement(float(corrections[1]), float(errors[1])), conditions.claims.zero_g_std_mps2
    contradiction = zero_contradicted(*zero, stated_std) if zero.std > _SEPARATION_SHARE * stated_std else None
    return (
        _estimate(NAMES[0], Measurement(gain_value, gain_std), doubt or (one_speed if is_unseparated else None)),
        Estimate.invalid(NAMES[1], one_speed) if is_unseparated else _estimate(NAMES[1], zero, doubt or contradiction),
        Estimate.invalid(NAMES[2], Reason(TrustCode.NEEDS_TEMPERATURE_CHANGE))
        if errors[2] > _SEPARATION_SHARE * PRIOR_STDS[2]
        else _estimate(NAMES[2], Measurement(float(corrections[2]), float(errors[2])), doubt),
    )


def _settling_reason(step: CalibrationStep) -> Reason | None:
    if step.revolutions >= LEAST_REVOLUTIONS:
        return None
    return Reason(CoreCode.NOT_SETTLED, revolutions=step.revolutions, needed=LEAST_REVOLUTIONS)


def floor_gain(average: AngleAverage, conditions: TireConditions) -> Estimate:
    """Return the gain of an AC-coupled sensor from the depth of the contact below the mean."""
    interior = contact_interior(average.radial_mps2, 2.0 * average.radial_mps2.shape[0])
    if interior is None:
        return Estimate.invalid(NAMES[0], Reason(RevolutionCode.NO_CONTACT))
    steady = conditions.radius_m * average.omega_radps**2
    depth = float(average.radial_mps2.mean() - average.radial_mps2[interior].mean()) / steady
    gain = depth / (1.0 - _CONTACT_LEVEL[0])
    std = gain * math.hypot(_CONTACT_LEVEL[1], conditions.radius_std_m / conditions.radius_m)
    return Estimate(NAMES[0], gain, std, Status.PROVISIONAL, (Reason(TrustCode.FLAT_CONTACT_ASSUMED),))


def _estimate(name: str, measurement: Measurement, doubt: Reason | None) -> Estimate:
    if not (math.isfinite(measurement.value) and math.isfinite(measurement.std)):
        return Estimate.invalid(name, doubt or Reason(TrustCode.NOT_FINITE))
    if doubt is not None:
        return Estimate(name, measurement.value, measurement.std, Status.PROVISIONAL, (doubt,))
    return Estimate(name, measurement.value, measurement.std, Status.VALID)
