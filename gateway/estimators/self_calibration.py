"""Self-calibration of a sensor: gain, zero-g offset, tilts and mounting offset from the rolling itself.

Gain and zero-g offset follow from two equations per revolution. A closed belt has mean(s) = R Omega^2 (1 - e/R
mean(k^2)). Gravity rotates through the sensor's axis with amplitude g; it is order 1 of the signal minus the order 1 of
the closed belt. With the unknowns gain G, offset z, change of gain with temperature G' and belt stretch a:

    mean(s)           = (G + G' dT) R Omega^2 (1 - e/R mean(k^2)) + z
    order 1 - closure = (G + G' dT) g q + a R Omega^2

Both are linear and are accumulated over revolutions, with prior errors as in a data sheet. Revolutions at different
speeds separate z from G, and a from g. Pitch tilt and mounting offset come from the circumferential axis,
roll tilt from the means of the lateral axis (`gateway.signal.sensor_mounting`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np

from gateway.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.estimators.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions, not_used
from gateway.estimators.sensor_claims import GAIN_STD, HAND_MOUNTED_STD_M
from gateway.reasons import Code, Reason
from gateway.signal.contact_edges import contact_interior
from gateway.signal.sensor_mounting import BeltKinematics, MountingRows, RollCalibration, belt_kinematics, mounting_rows
from gateway.types import FloatArray

NAMES: Final = (
    "gain",
    "zero_g_offset_mps2",
    "gain_per_degc",
    "roll_tilt_rad",
    "pitch_tilt_rad",
    "sensor_offset_m",
)
_CIRCUMFERENTIAL, _LATERAL, _RADIAL = range(3)

# Prior standard errors of G, z, G' and a: 10 %, 1 g and 0.05 % per degree as in a data sheet; belt stretch as order 1
# of R Omega^2, 2.4e-4 on a belt of 5 MN at 5000 N.
_PRIOR_STDS: Final = (0.1, STANDARD_GRAVITY_MPS2, 5e-4, 3e-4)
# Scatter of a revolution's mean without noise: road, speed within the revolution.
_MEAN_STD_MPS2: Final = 0.5
# Systematic error of the closure as a share of R Omega^2: 1.3e-4 on a belt of 5 MN.
_CLOSURE_STD: Final = 1.5e-4
# Signal in the middle of a flat contact as a share of R Omega^2, on the exact ring over loads, and its error.
_CONTACT_LEVEL: Final = (-0.025, 0.035)
# Errors from belt stretch and contact shear in the circumferential axis.
_OFFSET_MODEL_M: Final = 2e-5
_PITCH_MODEL_RAD: Final = 4e-4
_HORIZON_REVOLUTIONS: Final = 2000.0
# Share of its prior error below which the zero-g offset counts as determined.
_SEPARATED: Final = 0.3
# Relative error of the steady value that may go with the speed: the belt's shape and the sensor's offset, which the
# mean depends on, are known better from revolution to revolution, and the sensor warms up.
_MEAN_WITH_SPEED: Final = 4e-5
_ROLL_SEPARATED_RAD: Final = math.radians(0.2)
# Relative change of the speed within a revolution up to which gravity is separated from it. In a first revolution it is
# not known, and given as 0.
_STEADY_SPEED: Final = 0.03
_LEAST_REVOLUTIONS: Final = 8
# The equations of one revolution already overdetermine the mounting offset; three average out its jitter.
_LEAST_OF_OFFSET: Final = 3
_BELT_EVERY: Final = 8


class _Found(NamedTuple):
    value: float
    std: float


@dataclass(frozen=True, slots=True)
class Measured:
    """Quantities of the sensor that its own signal gives, for comparison with what is stated.

    Attributes:
        revolutions: used so far.
        ac_coupled: whether the sensor passes no steady value.
        rate_hz: sampling rate in use.
        steady_mps2: latest mean of the radial axis that a perfect sensor would read on a belt of the stated radius.
        mean_square: mean square of kappa R.
        by_mean: (2, 2) information and (2,) right-hand side of the relative error of the steady value and of the
            zero-g offset in m/s^2, from the means of the revolutions.
        by_gravity: (2, 2) and (2,) likewise of the relative error of the gain, and of belt stretch as order 1 of R
            Omega^2, from gravity in order 1.
        contact_gain: gain of an AC-coupled sensor and its standard error, from the depth of the contact; None without.
        offset_m: sensor below the neutral layer and its standard error; None without a circumferential axis.
    """

    revolutions: int
    ac_coupled: bool
    rate_hz: float
    steady_mps2: float
    mean_square: float
    by_mean: tuple[FloatArray, FloatArray]
    by_gravity: tuple[FloatArray, FloatArray]
    contact_gain: tuple[float, float] | None
    offset_m: tuple[float, float] | None


class SelfCalibrationEstimator:
    """Gain, zero-g offset, gain over temperature, roll, pitch and mounting offset, improved by every revolution."""

    def __init__(self) -> None:
        """Start from the priors."""
        self._roll = RollCalibration(offset_std_mps2=_PRIOR_STDS[1])
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "self-calibration"

    def reset(self) -> None:
        """Forget everything, as after a change of sensor."""
        self._roll.reset()
        self._keep = 1.0 - 1.0 / _HORIZON_REVOLUTIONS
        self._count = 0
        self._information = np.zeros((4, 4))
        self._weighted = np.zeros(4)
        self._steady = np.zeros(4)
        self._forget_means()
        self._is_calibrated = False
        self._is_ac, self._rate_hz = False, math.nan
        # Relative difference of the gains of two axes; tilts and mounting offset are ratios of axes.
        self._axes_std = math.sqrt(2.0) * GAIN_STD
        self._reference_degc: float | None = None
        self._warm = 0.0
        self._mounting: MountingRows | None = None
        self._ratio = 0.0
        self._belt: BeltKinematics | None = None
        self._floor: Estimate | None = None

    def _forget_means(self) -> None:
        self._by_mean = np.zeros((2, 2)), np.zeros(2)
        self._by_gravity = np.zeros((2, 2)), np.zeros(2)
        self._expected_mps2 = math.nan

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return the estimates of NAMES; a perfect sensor has gain 1.

        A revolution with faults, such as a clipped one, is not used; the estimates so far are returned with the reason.
        The error of the gain includes that of the belt radius. An AC-coupled sensor gives neither offsets nor roll,
        which need the lost means, and its gain only from the contact, which is flat on a flat road. Never raises on
        values.
        """
        refused = _refused(revolution, average, conditions)
        if refused is None:
            self._take(revolution, average, conditions)
        return (
            *self._gain_estimates(revolution, average, conditions, refused),
            self._roll_estimate(revolution, refused),
            *self._mounting_estimates(conditions, refused),
        )

    def _take(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> None:
        """Add one revolution without faults."""
        self._count += 1
        self._is_ac, self._rate_hz = revolution.ac_coupled, revolution.rate_hz
        self._axes_std = math.sqrt(2.0) * conditions.claims.gain_std
        belt = self._belt_of(average, conditions)
        axes = revolution.axes_mps2
        if np.isfinite(axes[_CIRCUMFERENTIAL]).all():
            rows = mounting_rows(
                axes[_CIRCUMFERENTIAL],
                axes[_RADIAL],
                belt,
                revolution.omega_radps,
                revolution.omega_dot_radps2,
                conditions.radius_m,
                revolution.order_max,
                with_mean=not revolution.ac_coupled,
            )
            self._mounting = rows if self._mounting is None else self._mounting.and_then(rows, self._keep)
        if revolution.ac_coupled:
            return
        self._roll.update(float(axes[_LATERAL].mean()), float(axes[_RADIAL].mean()))
        # Before that, the mounting offset, which the mean depends on, is not known.
        is_calibrated = (
            conditions.claims.offset_m is not None or self._mounting is None or self._count > _LEAST_REVOLUTIONS
        )
        self._take_gain(revolution, average, conditions, belt, is_calibrated=is_calibrated)

    def _belt_of(self, average: AngleAverage, conditions: TireConditions) -> BeltKinematics:
        """Return the belt's kinematics from the average, updated every few revolutions."""
        if self._belt is None or self._belt_is_due():
            self._ratio = self._offset_ratio(conditions)
            centre = 0.5 * (average.trailing_edge_rad + average.leading_edge_rad)
            self._belt = belt_kinematics(average.radial_mps2, self._ratio, centre)
        return self._belt

    def _belt_is_due(self) -> bool:
        return self._count <= _LEAST_REVOLUTIONS + 1 or self._count % _BELT_EVERY == 0

    def _take_gain(
        self,
        revolution: Revolution,
        average: AngleAverage,
        conditions: TireConditions,
        belt: BeltKinematics,
        *,
        is_calibrated: bool,
    ) -> None:
        """Add the two equations of one revolution; `is_calibrated` tells whether the sensor's offset is known."""
        degc = conditions.temperature_degc
        if degc is not None:
            self._reference_degc = degc if self._reference_degc is None else self._reference_degc
            self._warm = degc - self._reference_degc
        steady = conditions.radius_m * revolution.omega_radps**2
        expected = steady * (1.0 - self._ratio * belt.mean_square)
        mean = float(revolution.radial_mps2.mean())
        centre = 0.5 * (average.trailing_edge_rad + average.leading_edge_rad)
        order_1 = complex(revolution.orders_mps2[1]) * complex(math.cos(centre), math.sin(centre))
        # Gravity was subtracted with a gain of 1; the remainder is compared with the closure of the belt.
        gravity = STANDARD_GRAVITY_MPS2 * belt.gravity_order_1
        left = order_1.real - belt.signal_order_1 * mean
        change = abs(revolution.omega_dot_radps2 * revolution.period_s / revolution.omega_radps)
        is_steady = 0.0 < change < _STEADY_SPEED and average.count > 2
        scatter = float(average.orders_std_mps2[1]) * math.sqrt(average.effective_count)
        order_std = max(scatter, 1e-3)
        by_mean = np.array([expected, 1.0, expected * self._warm, 0.0]) / _MEAN_STD_MPS2
        by_gravity = np.array([gravity, 0.0, gravity * self._warm, steady]) / order_std * is_steady
        if not (np.isfinite(by_mean).all() and np.isfinite(by_gravity).all() and math.isfinite(left)):
            return
        if is_calibrated and not self._is_calibrated:
            self._forget_means()
        self._is_calibrated = is_calibrated
        self._expected_mps2 = expected
        self._by_mean = _added(self._by_mean, self._keep, by_mean[:2], (mean - expected) / _MEAN_STD_MPS2)
        by_order = is_steady * left / order_std
        self._by_gravity = _added(self._by_gravity, self._keep, by_gravity[[0, 3]], by_order)
        if not is_calibrated:
            return
        rows = np.stack([by_mean, by_gravity])
        found = np.array([(mean - expected) / _MEAN_STD_MPS2, by_order])
        self._information = self._keep * self._information + rows.T @ rows
        self._weighted = self._keep * self._weighted + found @ rows
        self._steady = self._keep * self._steady + by_mean * (expected / _MEAN_STD_MPS2)

    @property
    def measured(self) -> Measured | None:
        """Result of the revolutions so far; None before the first."""
        if self._belt is None:
            return None
        found = self._mounting_found() if self._count >= _LEAST_OF_OFFSET else None
        floor = self._floor
        return Measured(
            revolutions=self._count,
            ac_coupled=self._is_ac,
            rate_hz=self._rate_hz,
            steady_mps2=self._expected_mps2,
            mean_square=self._belt.mean_square,
            by_mean=self._by_mean,
            by_gravity=self._by_gravity,
            contact_gain=None if floor is None or floor.status is Status.INVALID else (floor.value, floor.std),
            offset_m=None if found is None else (found[1].value, found[1].std),
        )

    def _offset_ratio(self, conditions: TireConditions) -> float:
        """Return e / R: as measured once its error is below 1 mm, else as stated, else 0."""
        found = self._mounting_found()
        if found is None or not found[1].std < HAND_MOUNTED_STD_M:
            return (conditions.claims.offset_m or 0.0) / conditions.radius_m
        return float(np.clip(found[1].value / conditions.radius_m, -0.05, 0.15))

    def _mounting_found(self) -> tuple[_Found, _Found] | None:
        """Return pitch and mounting offset."""
        if self._mounting is None:
            return None
        solution, stds = self._mounting.solve()
        offset, tilt = float(solution[0]), float(solution[1])
        offset_std = math.hypot(float(stds[0]), self._axes_std * offset, _OFFSET_MODEL_M)
        if not (math.isfinite(offset_std) and math.isfinite(tilt)):
            return None
        return _Found(math.atan(tilt), math.hypot(float(stds[1]), self._axes_std * tilt, _PITCH_MODEL_RAD)), _Found(
            offset, offset_std
        )

    def _mounting_estimates(self, conditions: TireConditions, refused: Reason | None) -> tuple[Estimate, Estimate]:
        found = self._mounting_found()
        if found is None:
            reason = refused or Reason(Code.AXIS_MISSING, axis=AXIS_NAMES[_CIRCUMFERENTIAL])
            return Estimate.invalid(NAMES[4], reason), Estimate.invalid(NAMES[5], reason)
        doubt = refused or self._unsettled()
        offset = _estimate(NAMES[5], found[1], doubt)
        stated_m, stated_std_m = conditions.claims.offset_m, conditions.claims.offset_std_m
        if stated_m is not None and abs(stated_m - found[1].value) > 3.0 * math.hypot(stated_std_m, found[1].std):
            offset = replace(offset, reasons=(*offset.reasons, Reason(Code.OTHER_OFFSET_STATED, stated_m=stated_m)))
        return _estimate(NAMES[4], found[0], doubt), offset

    def _roll_estimate(self, revolution: Revolution, refused: Reason | None) -> Estimate:
        if not self._roll.count:
            lost = Reason(Code.AC_COUPLED) if revolution.ac_coupled else None
            return Estimate.invalid(NAMES[3], refused or lost or Reason(Code.AXIS_MISSING, axis=AXIS_NAMES[_LATERAL]))
        found = _Found(self._roll.roll_rad, math.hypot(self._roll.roll_std_rad, self._axes_std * self._roll.roll_rad))
        doubt = refused or self._unsettled()
        if doubt is None and self._roll.roll_std_rad > _ROLL_SEPARATED_RAD:
            doubt = Reason(Code.NEEDS_TWO_SPEEDS, quantity="roll tilt")
        return _estimate(NAMES[3], found, doubt)

    def _gain_estimates(
        self, revolution: Revolution, average: AngleAverage, conditions: TireConditions, refused: Reason | None
    ) -> tuple[Estimate, Estimate, Estimate]:
        if revolution.ac_coupled:
            lost = Reason(Code.AC_COUPLED)
            if self._floor is None or refused or self._belt_is_due():
                self._floor = _floor_gain(average, conditions, refused)
            return self._floor, Estimate.invalid(NAMES[1], lost), Estimate.invalid(NAMES[2], lost)
        if not self._information[0, 0] > 0.0:
            reason = refused or Reason(Code.NO_REVOLUTION_YET)
            first, second, third = (Estimate.invalid(name, reason) for name in NAMES[:3])
            return first, second, third
        stds = np.array(_PRIOR_STDS)
        covariance = np.linalg.inv(self._information + np.diag(stds**-2.0))
        change = covariance @ self._weighted
        steady = covariance @ self._steady * _CLOSURE_STD
        errors = np.sqrt(np.diag(covariance) + np.square(steady))
        by_speed = speed_errors(self._by_mean[0])
        errors[1] = math.hypot(errors[1], by_speed.zero_mps2)
        here = np.array([1.0, 0.0, self._warm, 0.0])
        gain = 1.0 + float(here @ change)
        radius = conditions.radius_std_m / conditions.radius_m
        gain_std = math.sqrt(float(here @ covariance @ here) + float(here @ steady) ** 2 + (gain * radius) ** 2)
        doubt = refused or self._unsettled()
        one_speed = Reason(Code.NEEDS_TWO_SPEEDS, quantity="gain")
        together = errors[1] > _SEPARATED * _PRIOR_STDS[1]
        if not together:
            gain_std = math.hypot(gain_std, by_speed.gain)
        return (
            _estimate(NAMES[0], _Found(gain, gain_std), doubt or (one_speed if together else None)),
            Estimate.invalid(NAMES[1], one_speed)
            if together
            else _estimate(NAMES[1], _Found(float(change[1]), float(errors[1])), doubt),
            Estimate.invalid(NAMES[2], Reason(Code.NEEDS_TEMPERATURE_CHANGE))
            if errors[2] > _SEPARATED * _PRIOR_STDS[2]
            else _estimate(NAMES[2], _Found(float(change[2]), float(errors[2])), doubt),
        )

    def _unsettled(self) -> Reason | None:
        if self._count >= _LEAST_REVOLUTIONS:
            return None
        return Reason(Code.NOT_SETTLED, revolutions=self._count, needed=_LEAST_REVOLUTIONS)


class SpeedErrors(NamedTuple):
    """Errors of the relative steady value and of the zero-g offset that means at different speeds share."""

    gain: float
    zero_mps2: float


def speed_errors(information: FloatArray) -> SpeedErrors:
    """Return the errors by a relative error of the steady value that goes with the speed.

    A steady value that is wrong in proportion to its deviation from its mean looks like a zero-g offset.

    Args:
        information: (2, 2) of `Measured.by_mean`.

    Returns:
        The errors; infinite at one speed.
    """
    mean = float(information[0, 1] / information[1, 1])
    spread2 = float(information[0, 0] / information[1, 1]) - mean**2
    if not spread2 > 1e-12 * mean**2:
        return SpeedErrors(math.inf, math.inf)
    gain = _MEAN_WITH_SPEED * abs(mean) / math.sqrt(spread2)
    return SpeedErrors(gain, gain * abs(mean))


def _refused(revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> Reason | None:
    """Return why a revolution must not be used; None when it may be."""
    if revolution.faults or revolution.saturated:
        return not_used(revolution.faults or (Reason(Code.RADIAL_SATURATED),))
    if not (np.isfinite(revolution.radial_mps2).all() and np.isfinite(average.radial_mps2).all()):
        return Reason(Code.AXIS_NOT_FINITE, axis=AXIS_NAMES[_RADIAL])
    if not conditions.radius_m > 0.0:
        return Reason(Code.SPEED_OR_RADIUS_UNKNOWN)
    if not float(average.radial_mps2.mean()) > 0.0:
        return Reason(Code.NO_STEADY_VALUE)
    if not math.isfinite(revolution.trailing_edge_rad - revolution.leading_edge_rad):
        return Reason(Code.NO_CONTACT_EDGES)
    if not math.isfinite(float(average.orders_std_mps2[1])):
        return Reason(Code.AVERAGE_ERRORS_UNKNOWN)
    return None


def _added(
    sums: tuple[FloatArray, FloatArray], keep: float, row: FloatArray, found: float
) -> tuple[FloatArray, FloatArray]:
    """Return information and right-hand side with one more equation."""
    information, weighted = sums
    return keep * information + np.outer(row, row), keep * weighted + found * row


def _floor_gain(average: AngleAverage, conditions: TireConditions, refused: Reason | None) -> Estimate:
    """Return the gain of an AC-coupled sensor from the depth of the contact below the mean."""
    interior = contact_interior(average.radial_mps2, 2.0 * average.radial_mps2.shape[0]) if refused is None else None
    if interior is None:
        return Estimate.invalid(NAMES[0], refused or Reason(Code.NO_CONTACT))
    steady = conditions.radius_m * average.omega_radps**2
    depth = float(average.radial_mps2.mean() - average.radial_mps2[interior].mean()) / steady
    gain = depth / (1.0 - _CONTACT_LEVEL[0])
    std = gain * math.hypot(_CONTACT_LEVEL[1], conditions.radius_std_m / conditions.radius_m)
    return Estimate(NAMES[0], gain, std, Status.PROVISIONAL, (Reason(Code.FLAT_CONTACT_ASSUMED),))


def _estimate(name: str, found: _Found, doubt: Reason | None) -> Estimate:
    if not (math.isfinite(found.value) and math.isfinite(found.std)):
        return Estimate.invalid(name, doubt or Reason(Code.NOT_FINITE))
    if doubt is not None:
        return Estimate(name, found.value, found.std, Status.PROVISIONAL, (doubt,))
    return Estimate(name, found.value, found.std, Status.VALID)
