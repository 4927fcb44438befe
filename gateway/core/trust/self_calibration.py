"""Self-calibration of a sensor: gain, zero-g offset, tilts and mounting offset from the rolling itself.

Gain and zero-g offset follow from two equations per revolution. A closed belt has mean(s) = R Omega^2 (1 - e/R
mean(k^2)). Gravity rotates through the sensor's axis with amplitude g; it is order 1 of the signal minus the order 1 of
the closed belt. With the unknowns gain G, offset z, change of gain with temperature G' and belt stretch a:

    mean(s)           = (G + G' dT) R Omega^2 (1 - e/R mean(k^2)) + z
    order 1 - closure = (G + G' dT) g q + a R Omega^2

Both are linear and are accumulated over revolutions, with prior errors as in a data sheet. Revolutions at different
speeds separate z from G, and a from g. Pitch tilt and mounting offset come from the circumferential axis,
roll tilt from the means of the lateral axis (`gateway.core.revolutions.sensor_mounting`).
"""

import math
from collections import deque
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.core.estimates.disagreement import error_of
from gateway.core.estimates.estimator import (
    Estimate,
    Revolution,
    Status,
    TireConditions,
    is_evidence,
    not_used,
)
from gateway.core.estimates.lost_steady_value import LostSteadyValue, SteadyValueCheck
from gateway.core.estimates.pace import is_due
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import BlockEstimator, RevolutionBlock, measured_shares
from gateway.core.estimates.sensor_claims import HAND_MOUNTED_STD_M, Tilt
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.axis_relations import AxisRelations, axis_relations
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.revolutions.sensor_mounting import (
    HUB_SIZE,
    MOUNTING_SIZE,
    BeltKinematics,
    MountingRows,
    RollCalibration,
    belt_kinematics,
    hub_motion_mps2,
    mounting_rows,
    offset_by_yaw_m,
    yaw_by_shape,
)
from gateway.core.revolutions.synchronous_average import DEFAULT_HORIZON_REVOLUTIONS
from gateway.core.trust.calibration_estimates import (
    LEAST_REVOLUTIONS,
    PRIOR_STDS,
    floor_gain,
    gain_estimates,
    mounting_estimates,
    roll_estimate,
    steady_value_lost,
)
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.refuted_sums import Equations, are_at_odds, are_silent, contradicted, is_refuted
from gateway.core.trust.sensor_measurement import (
    GRAVITY,
    MATRIX,
    MEAN,
    MOUNTING,
    RIGHT,
    STEADY,
    SUMS,
    AlongGravity,
    CalibrationStep,
    Measured,
    Measurement,
)
from gateway.core.types import BoolArray, ComplexArray, FloatArray

_CIRCUMFERENTIAL, _LATERAL, _RADIAL = range(3)

# Scatter of a revolution's mean without noise: road, speed within the revolution.
_MEAN_STD_MPS2: Final = 0.5
# Error of a revolution's mean over its value, per difference of the relative changes of speed in two revolutions: a
# wheel that brakes or spins does not turn with the constant acceleration that the mean is freed from. Such a difference
# counts in so many revolutions, and beyond what a usual drive and the timing of contacts make of it.
_MEAN_BY_JERK: Final = 0.15
_JERK_REVOLUTIONS: Final = 3
_NORMAL_JERK: Final = 0.005
# The same, per square of the relative change of speed in a revolution.
_MEAN_BY_CHANGE: Final = 0.1
# Errors from belt stretch and contact shear in the circumferential axis.
OFFSET_MODEL_M: Final = 2e-5
PITCH_MODEL_RAD: Final = 4e-4
_HORIZON_REVOLUTIONS: Final = 2000.0
_RETENTION: Final = 1.0 - 1.0 / _HORIZON_REVOLUTIONS
# Order 2 of the circumferential axis that the mounting leaves on belts of random tires, over R Omega^2.
_HUB_FLOOR: Final = 1e-4
# Memory of the hub's motion, as that of the running average that contains it.
_HUB_RETENTION: Final = 1.0 - 1.0 / DEFAULT_HORIZON_REVOLUTIONS
# Memory of depth and pitch by the latest revolutions alone, and their standard errors beyond which they are not those
# of all: the sensor moves, or another axis is read.
_LATEST_RETENTION: Final = 1.0 - 1.0 / 8.0
_LATEST_TOLERANCE: Final = 2.0
# Latest revolutions that may refute what all of them say of gain and zero-g offset; more where these have hardly
# changed their speed.
_REFUTING_COUNTS: Final = (128, 1024)
_GROUPS: Final = 3
# Relative change of the speed within a revolution up to which gravity is separated from it. In a first revolution it is
# not known, and given as 0.
_STEADY_SPEED: Final = 0.03
# Longest pause between renewals, which look for a change of direction too.
_MAX_PAUSE: Final = 32
# Ratio of squared residuals from which the circumferential axis points against the rolling direction: gravity of twice
# its size then remains in order 1.
_REVERSAL_RATIO: Final = 4.0
# Of gravity, motion of the hub and the closure of the belt.
_GRAVITY_MODEL: Final = 0.01
# R Omega^2 up to which gravity is looked for: belt stretch and drive add order 1 of up to 1e-3 of it.
_GRAVITY_LIMIT_MPS2: Final = 1500.0
# Of earlier revolutions in which gravity was looked for, at each further one.
_GRAVITY_RETENTION: Final = 0.9
# Largest order of an axis that stands still.
_INACTIVE_AXIS_MPS2: Final = 1e-6
# Mean square of kappa R from which the waveform is not that of a belt: 1.06 on a car tire. Nothing that rests on the
# shape or on gravity can be told from it.
GREATEST_MEAN_SQUARE: Final = 1.5
# The equations of one revolution already overdetermine the mounting offset; three average out its jitter.
_OFFSET_MIN_COUNT: Final = 3
# Revolutions in the average whose axes are compared with each other.
_RELATIONS_MIN_COUNT: Final = 2.5
# Those from which their lags are compared with those of other wheels: before, acceleration looks like a lag.
_LAGS_MIN_COUNT: Final = 12.0
_UNKNOWN_YAW: Final = (math.nan, math.nan)

# Sums of both equations, and of the normal equations, with their places in the products of factors and left-hand sides.
_EQUATIONS: Final = slice(MEAN.start, GRAVITY.stop)
_NORMAL: Final = slice(MATRIX.start, RIGHT.stop)
_EQUATION_PRODUCTS: Final = np.array(
    [5 * row + column for row, column in ((0, 0), (0, 1), (1, 1), (0, 4), (1, 4))]
    + [25 + 5 * row + column for row, column in ((0, 0), (0, 3), (3, 3), (0, 4), (3, 4))]
)
_NORMAL_PRODUCTS: Final = np.array([5 * row + column for row in range(4) for column in range(4)] + [4, 9, 14, 19])

_INITIAL_STEP: Final = CalibrationStep(None, 0, np.zeros(SUMS), None, None, 0.0, None, None)
# Factors of the circumferential and the radial axis.
_REVERSED_SIGNS: Final = np.array([[-1.0], [1.0]])


class SelfCalibrationEstimator(BlockEstimator):
    """Gain, zero-g offset, gain over temperature, roll, pitch and mounting offset, improved by every revolution.

    Estimates: those of `gateway.core.trust.calibration_estimates.NAMES`; a perfect sensor has gain 1.

    A revolution with faults, such as a clipped one, is not used; the estimates so far are returned with the reason.
    The error of the gain includes that of the belt radius. An AC-coupled sensor gives neither offsets nor roll,
    which need the lost means, and its gain only from the contact, which is flat on a flat road.
    """

    name = "self-calibration"

    def __init__(self) -> None:
        """Start from the priors."""
        self._roll = RollCalibration(offset_std_mps2=PRIOR_STDS[1])
        self._steady = SteadyValueCheck()
        self.reset()

    def reset(self) -> None:
        """Forget everything, as after a change of sensor."""
        self._roll.reset()
        self._steady.reset()
        # Whether the revolution before each of a block has faults.
        self._after_fault: BoolArray = np.zeros(1, np.bool_)
        # Relative change of the speed in each of the last revolutions before a block, and in its own; NaN where it is
        # not known. Relative errors of the means of its own.
        self._changes: FloatArray = np.full(_JERK_REVOLUTIONS, math.nan)
        self._mean_errors: FloatArray = np.zeros(0)
        self._has_along = False
        self._is_calibrated = False
        self._reference_degc: float | None = None
        self._ratio = 0.0
        self._belt: BeltKinematics | None = None
        self._centre_rad = self._scatter_mps2 = math.nan
        # Squared residuals with gravity ahead, with gravity back and without any, and the number of equations.
        self._with_gravity: FloatArray = np.zeros(4)
        self._along_gravity: AlongGravity | None = None
        # Whether the direction waits for a revolution that shows it.
        self._is_direction_due = False
        self._hub: FloatArray = np.zeros(HUB_SIZE)
        # Equations of the mounting, of the latest revolutions.
        self._latest: FloatArray = np.zeros(MOUNTING_SIZE)
        # All sums, of the latest revolutions, and the number of these.
        self._refuting: FloatArray = np.zeros(SUMS)
        self._refuting_count = 0
        # Sums of the means of the latest groups of so many revolutions whose speeds separated the zero-g offset.
        self._groups: deque[Equations] = deque(maxlen=_GROUPS)
        # Sums of the axes, and of 1, the square of the speed and the reaction to angular acceleration; what the
        # relations of the axes said at the last renewal.
        self._axes: FloatArray = np.zeros((0, 0))
        self._axes_moments: FloatArray = np.zeros(3)
        self._relations = AxisRelations()
        self._yaw_offset_m, self._yaw = 0.0, _UNKNOWN_YAW
        self._roll_by_mean = math.nan
        self._last = _INITIAL_STEP
        self._steps: list[CalibrationStep] = []

    def update_block(self, block: RevolutionBlock) -> list[tuple[Estimate, ...]]:
        """Take revolutions and return the estimates after each."""
        self.measure(block)
        return self.estimates(block)

    def measure(self, block: RevolutionBlock) -> list[tuple[Measured | None, LostSteadyValue | None]]:
        """Take revolutions; return what is measured after each, None before the first, and of a lost steady value.

        Curvature of the belt, contact centre and scatter are those of the average at the last renewal. Revolutions
        whose steady value is lost are not used.
        """
        lost_values = self._steady.update_block(block)
        faulty = [bool(revolution.faults) for revolution in block.revolutions]
        self._after_fault = np.array([self._after_fault[-1], *faulty])
        self._update_mean_errors(block)
        steps: list[CalibrationStep] = []
        pending: list[int] = []
        for index, revolution in enumerate(block.revolutions):
            lost = lost_values[index]
            refused = _refusal(revolution, block.conditions[index]) if lost is None else steady_value_lost(lost)
            count = self._last.revolutions + len(pending) + 1
            is_stale = self._belt is None or is_due(count) or count == LEAST_REVOLUTIONS + 1 or count % _MAX_PAUSE == 0
            is_stale = is_stale or (self._is_direction_due and is_evidence(revolution))
            if refused is not None or is_stale:
                steps += self._accumulate(block, pending)
                pending = []
            if refused is None and is_stale:
                refused = self._renew_belt(block, index)
            if refused is None:
                pending.append(index)
            else:
                steps.append(self._last._replace(refused=refused))
        steps += self._accumulate(block, pending)
        self._steps = steps
        return [(step.measured, lost) for step, lost in zip(steps, lost_values, strict=True)]

    def _update_mean_errors(self, block: RevolutionBlock) -> None:
        """Take the error that a change of acceleration makes in the mean of each revolution of a block."""
        changes = block.arrays.omega_dot_radps2 * (2.0 * math.pi) / np.square(block.arrays.omega_radps)
        changes[[revolution.assumed_steady for revolution in block.revolutions]] = math.nan
        self._changes = np.concatenate([self._changes[-_JERK_REVOLUTIONS:], changes])
        jumps = np.nan_to_num(np.abs(np.diff(self._changes)))
        jerks = np.lib.stride_tricks.sliding_window_view(jumps, _JERK_REVOLUTIONS).max(axis=1)
        by_change = _MEAN_BY_CHANGE * np.square(np.nan_to_num(changes))
        self._mean_errors = _MEAN_BY_JERK * np.maximum(jerks - _NORMAL_JERK, 0.0) + by_change

    def estimates(self, block: RevolutionBlock, unsure: Sequence[float] | None = None) -> list[tuple[Estimate, ...]]:
        """Return the estimates after each revolution of the block that was measured last.

        The roll, which is no evidence, is followed here: call it for every block or for none.

        Args:
            block: as measured.
            unsure: relative error of gain or rate of each revolution beyond what is stated; None for none.
        """
        return [
            (
                *gain_estimates(revolution, conditions, step),
                roll_estimate(revolution, conditions, step, roll),
                *mounting_estimates(conditions, step, further),
            )
            for revolution, conditions, step, roll, further in zip(
                block.revolutions,
                block.conditions,
                self._steps,
                self._rolls(block),
                unsure or (0.0,) * len(block),
                strict=True,
            )
        ]

    def _rolls(self, block: RevolutionBlock) -> list[Measurement | None]:
        """Return the roll after each revolution of the block that was measured last; None before its first."""
        rolls: list[Measurement | None] = []
        for index, step in enumerate(self._steps):
            if step.refused is None and not block.revolutions[index].ac_coupled:
                means = block.arrays.means_mps2[index]
                self._roll.update(float(means[_LATERAL]), float(means[_RADIAL]))
            rolls.append(Measurement(self._roll.roll_rad, self._roll.roll_std_rad) if self._roll.count else None)
        return rolls

    def _renew_belt(self, block: RevolutionBlock, index: int) -> Reason | None:
        """Take the belt's shape from the average; return why the average is not usable, None when it is."""
        average, conditions = block.averages.at(index), block.conditions[index]
        if not np.isfinite(average.radial_mps2).all():
            return Reason(RevolutionCode.AXIS_NOT_FINITE, axis=AXIS_NAMES[_RADIAL])
        if not float(average.radial_mps2.mean()) > 0.0:
            return Reason(CoreCode.NO_STEADY_VALUE)
        if not math.isfinite(float(average.orders_std_mps2[1])):
            return Reason(TrustCode.AVERAGE_ERRORS_UNKNOWN)
        self._restart_if_refuted(conditions)
        self._ratio = self._offset_ratio(conditions)
        self._centre_rad = 0.5 * (average.trailing_edge_rad + average.leading_edge_rad)
        self._scatter_mps2 = max(float(average.orders_std_mps2[1]) * math.sqrt(average.effective_count), 1e-3)
        self._belt = belt_kinematics(average.radial_mps2, self._ratio, self._centre_rad)
        if block.revolutions[index].ac_coupled:
            self._last = self._last._replace(floor=floor_gain(average, conditions))
        self._is_direction_due = not is_evidence(block.revolutions[index])
        if not self._is_direction_due:
            self._check_direction(block, index)
        if not block.revolutions[index].ac_coupled:
            self._update_relations(block, index, (average.leading_edge_rad, average.trailing_edge_rad))
        return None

    def _restart_if_refuted(self, conditions: TireConditions) -> None:
        """Forget the older revolutions where the latest ones agree with a statement that all of them contradict."""
        if self._refuting_count < _REFUTING_COUNTS[0]:
            return
        claims = conditions.claims
        steady_std = math.hypot(claims.gain_std, 2.0 * claims.rate_std, conditions.radius_std_m / conditions.radius_m)
        means = [Equations(*sums[MEAN].tolist()) for sums in (self._last.sums, self._refuting)]
        overall, latest = (
            contradicted(mean, Equations(*sums[GRAVITY].tolist()), steady_std, claims.gain_std, claims.zero_g_std_mps2)
            for mean, sums in zip(means, (self._last.sums, self._refuting), strict=True)
        )
        at_odds = are_at_odds(self._groups, means[1], claims.zero_g_std_mps2)
        if is_refuted(overall, latest, at_odds=at_odds):
            self._groups.clear()
            sums = self._last.sums.copy()
            sums[MEAN.start :] = self._refuting[MEAN.start :]
            self._last = self._last._replace(sums=sums)
        elif are_silent(overall, latest) and self._refuting_count < _REFUTING_COUNTS[1]:
            return
        elif latest[1].is_certain:
            self._groups.append(means[1])
        self._refuting, self._refuting_count = np.zeros(SUMS), 0

    def _update_relations(self, block: RevolutionBlock, index: int, edges_rad: tuple[float, float]) -> None:
        """Compare the axes with each other, over the latest revolutions."""
        weight, square, reaction = self._axes_moments.tolist()
        if weight < _RELATIONS_MIN_COUNT:
            return
        assert self._belt is not None
        axes = self._axes / weight
        if self._last.against:
            axes[_CIRCUMFERENTIAL] = -axes[_CIRCUMFERENTIAL]
        self._relations = axis_relations(
            axes,
            self._belt,
            edges_rad,
            square / weight,
            reaction / weight,
            block.revolutions[index].order_max,
        )
        if weight < _LAGS_MIN_COUNT:
            self._relations = self._relations._replace(lags=(None, None))
        order_max = block.revolutions[index].order_max
        self._yaw_offset_m = offset_by_yaw_m(axes, self._belt, square / weight, order_max)
        self._yaw = yaw_by_shape(axes, self._belt, square / weight, reaction / weight, order_max)
        means = axes.mean(axis=1)
        self._roll_by_mean = math.atan2(float(means[_LATERAL]), float(means[_RADIAL]))

    def _check_direction(self, block: RevolutionBlock, index: int) -> None:
        """Start again where a revolution shows that the circumferential axis points elsewhere than assumed.

        A tire that rolls in reverse, or an axis of the wrong sign, turns gravity and the reading of the offset round.
        An axis that is not connected, or not the one along the belt, has no gravity.
        """
        spectra = block.arrays.in_plane_mps2[index]
        if not (np.isfinite(spectra[0, 0].real) and _is_active(spectra[0])):
            return
        belt, radius_m = self._belt, block.conditions[index].radius_m
        assert belt is not None
        if belt.mean_square > GREATEST_MEAN_SQUARE:
            return
        revolution = block.revolutions[index]
        weightless = spectra.copy()
        weightless[0] += STANDARD_GRAVITY_MPS2 * belt.known_spectra[0]
        rows = mounting_rows(
            np.stack([spectra, spectra * _REVERSED_SIGNS, weightless]),
            belt,
            np.full(3, revolution.omega_radps),
            np.full(3, revolution.omega_dot_radps2),
            radius_m,
            np.full(3, revolution.order_max),
            with_mean=not revolution.ac_coupled,
        )
        forward, backward, no_gravity = rows.squared_residuals().tolist()
        was_reversed, was_absent = self._last.against, self._is_absent
        is_flipped = _REVERSAL_RATIO * (forward if was_reversed else backward) < (backward if was_reversed else forward)
        if not revolution.ac_coupled and radius_m * revolution.omega_radps**2 < _GRAVITY_LIMIT_MPS2:
            self._with_gravity *= 0.0 if is_flipped else _GRAVITY_RETENTION
            self._with_gravity += (forward, backward, no_gravity, float(rows.sums[0, -1]))
            self._along_gravity = AlongGravity.of_squares(*self._with_gravity.tolist())
        if is_flipped or self._is_absent is not was_absent:
            self._last = _INITIAL_STEP._replace(against=was_reversed is not is_flipped, floor=self._last.floor)
            self._is_calibrated = self._has_along = False
            self._hub, self._axes, self._axes_moments = np.zeros(HUB_SIZE), np.zeros((0, 0)), np.zeros(3)
            self._latest = np.zeros(MOUNTING_SIZE)
            self._refuting, self._refuting_count = np.zeros(SUMS), 0
            self._groups.clear()
            self._relations = AxisRelations()
            self._yaw_offset_m, self._yaw = 0.0, _UNKNOWN_YAW
            self._ratio = self._offset_ratio(block.conditions[index])
            average = block.averages.at(index)
            self._belt = belt_kinematics(average.radial_mps2, self._ratio, self._centre_rad)

    @property
    def _is_absent(self) -> bool:
        return self._along_gravity is not None and self._along_gravity.is_absent

    def _offset_ratio(self, conditions: TireConditions) -> float:
        """Return e / R: as measured once its error is below 1 mm, else as stated, else 0."""
        offset = self._last.offset
        if offset is None or not offset.std < HAND_MOUNTED_STD_M:
            return (conditions.claims.offset_m or 0.0) / conditions.radius_m
        return min(max(offset.value / conditions.radius_m, -0.05), 0.15)

    def _accumulate(self, block: RevolutionBlock, indices: Sequence[int]) -> list[CalibrationStep]:
        """Add revolutions without faults on one shape of the belt; return the state after each."""
        if not indices:
            return []
        belt = self._belt
        assert belt is not None
        first, first_conditions = block.revolutions[indices[0]], block.conditions[indices[0]]
        rows = np.zeros((len(indices), SUMS))
        # Without a copy where all are taken, as nearly always.
        selection = slice(None) if len(indices) == len(block) else np.array(indices)
        spectra = block.arrays.in_plane_mps2[selection]
        if self._last.against:
            spectra = spectra * _REVERSED_SIGNS
        omega, omega_dot = block.arrays.omega_radps[selection], block.arrays.omega_dot_radps2[selection]
        is_active = np.isfinite(spectra[:, 0, 0].real) & _is_active(spectra[:, 0])
        if self._is_absent:
            is_active[:] = False
        self._has_along |= bool(is_active.any())
        revolutions = [block.revolutions[index] for index in indices]
        mounting = _mounting_terms(revolutions, spectra, belt, is_active, (omega, omega_dot), first_conditions.radius_m)
        hub, rows[:, MOUNTING] = mounting.hub, mounting.sums
        rise_k, expected = [self._last.warm] * len(indices), [math.nan] * len(indices)
        is_calibrated = False
        if not first.ac_coupled:
            # Before that, the mounting offset, which the mean depends on, is not known.
            is_calibrated = (
                first_conditions.claims.offset_m is not None
                or not self._has_along
                or self._last.revolutions + 1 > LEAST_REVOLUTIONS
            )
            rise_k = [self._temperature_rise_k(block.conditions[index]) for index in indices]
            steady = self._gain_rows(block, indices, belt, np.array(rise_k), rows, is_calibrated=is_calibrated)
            expected = steady.tolist()
        if (measured := measured_shares(revolutions)) is not None:
            rows *= np.array(measured)[:, np.newaxis]
        previous_sums = self._last.sums
        if is_calibrated and not self._is_calibrated:
            previous_sums = previous_sums.copy()
            previous_sums[MEAN] = previous_sums[GRAVITY] = 0.0
            self._refuting, self._refuting_count = np.zeros(SUMS), 0
        self._is_calibrated |= is_calibrated
        powers, decay = _decay(len(indices), _RETENTION)
        sums = powers[:, np.newaxis] * previous_sums + decay @ rows
        self._refuting = self._refuting + rows.sum(axis=0)
        self._refuting_count += int(np.count_nonzero(rows[:, MEAN.start]))
        powers, decay = _decay(len(indices), _HUB_RETENTION)
        hub = powers[:, np.newaxis] * self._hub + decay @ hub
        self._hub = hub[-1]
        self._add_axes(block, [index for index in indices if is_evidence(block.revolutions[index])])
        powers, decay = _decay(len(indices), _LATEST_RETENTION)
        latest = powers[:, np.newaxis] * self._latest + decay @ rows[:, MOUNTING]
        self._latest = latest[-1]
        return self._record(block, indices, belt, sums, hub, latest, rise_k, expected)

    def _add_axes(self, block: RevolutionBlock, evident: Sequence[int]) -> None:
        """Add the axes of revolutions to those whose relations are looked at."""
        if not evident:
            return
        powers, decay = _decay(len(evident), _HUB_RETENTION)
        selection = slice(None) if len(evident) == len(block) else np.array(evident)
        is_timed = np.array([not block.revolutions[index].assumed_steady for index in evident])
        axes, weights = block.arrays.axes_mps2[selection], decay[-1] * is_timed
        total = (weights @ axes.reshape(len(evident), -1)).reshape(axes.shape[1:])
        self._axes = total + powers[-1] * self._axes if self._axes.size else total
        omega = block.arrays.omega_radps[selection]
        reaction = block.arrays.omega_dot_radps2[selection] * block.conditions[evident[0]].radius_m
        self._axes_moments = (
            powers[-1] * self._axes_moments + weights @ np.array([np.ones(len(evident)), omega**2, reaction]).T
        )

    def _temperature_rise_k(self, conditions: TireConditions) -> float:
        degc = conditions.temperature_degc
        if degc is None:
            return self._last.warm
        self._reference_degc = degc if self._reference_degc is None else self._reference_degc
        return degc - self._reference_degc

    def _gain_rows(
        self,
        block: RevolutionBlock,
        indices: Sequence[int],
        belt: BeltKinematics,
        rise_k: FloatArray,
        rows: FloatArray,
        *,
        is_calibrated: bool,
    ) -> FloatArray:
        """Set the two equations of each revolution; return the steady value that is expected of each, (k,)."""
        selection = slice(None) if len(indices) == len(block) else np.array(indices)
        orders = block.arrays.orders_mps2[selection, :2]
        omega = block.arrays.omega_radps[selection]
        steady = block.conditions[indices[0]].radius_m * omega * omega
        expected: FloatArray = steady * (1.0 - self._ratio * belt.mean_square)
        mean = orders[:, 0].real
        order_1 = orders[:, 1] * complex(math.cos(self._centre_rad), math.sin(self._centre_rad))
        # Gravity was subtracted with a gain of 1; the remainder is compared with the closure of the belt.
        gravity = STANDARD_GRAVITY_MPS2 * belt.gravity_order_1
        remainder = order_1.real - belt.signal_order_1 * mean
        change = np.nan_to_num(np.abs(self._changes[_JERK_REVOLUTIONS:][selection]))
        is_settled = self._last.revolutions + 1 + np.arange(len(indices)) > 2
        is_steady = (change > 0.0) & (change < _STEADY_SPEED) & is_settled & (belt.mean_square <= GREATEST_MEAN_SQUARE)
        is_resumed = np.isnan(self._changes[_JERK_REVOLUTIONS:][selection]) & (self._last.revolutions > 0)
        # Behind a revolution with faults, neither the time of the contact between them nor the acceleration is sure.
        is_usable = np.isfinite(remainder) & np.isfinite(expected) & ~self._after_fault[:-1][selection]
        is_usable &= [is_evidence(block.revolutions[index]) for index in indices]
        # Factors of G, z, G' and a, then the left-hand side, of both equations.
        equations = np.zeros((len(indices), 2, 5))
        by_mean, by_gravity = equations[:, 0], equations[:, 1]
        by_mean[:, 0], by_mean[:, 1], by_mean[:, 2], by_mean[:, 4] = expected, 1.0, expected * rise_k, mean - expected
        by_gravity[:, 0], by_gravity[:, 2], by_gravity[:, 3], by_gravity[:, 4] = (
            gravity,
            gravity * rise_k,
            steady,
            remainder,
        )
        by_mean /= np.hypot(_MEAN_STD_MPS2, self._mean_errors[selection] * expected)[:, np.newaxis]
        # Behind a pause, the acceleration is not known.
        by_mean[is_resumed] = 0.0
        by_gravity /= self._scatter_mps2
        by_gravity[~is_steady] = 0.0
        if block.conditions[indices[0]].tire.is_linear_ring:
            by_gravity[:] = 0.0
        if not is_usable.all():
            equations[~is_usable] = 0.0
        products = equations[:, :, :, np.newaxis] * equations[:, :, np.newaxis, :]
        rows[:, _EQUATIONS] = products.reshape(-1, 50)[:, _EQUATION_PRODUCTS]
        if is_calibrated:
            total = products[:, 0] + products[:, 1]
            rows[:, _NORMAL] = total.reshape(-1, 25)[:, _NORMAL_PRODUCTS]
            rows[:, STEADY] = products[:, 0, 0, :4]
        return expected

    def _record(
        self,
        block: RevolutionBlock,
        indices: Sequence[int],
        belt: BeltKinematics,
        sums: FloatArray,
        hub: FloatArray,
        latest: FloatArray,
        rise_k: Sequence[float],
        expected: Sequence[float],
    ) -> list[CalibrationStep]:
        solutions = stds = None
        hub_mps2 = [0.0] * len(indices)
        if self._has_along:
            mountings, mounting_stds = MountingRows(sums[:, MOUNTING], hub).solve()
            latest_mountings, latest_stds = MountingRows(latest, hub).solve()
            excess = np.abs(latest_mountings - mountings) - _LATEST_TOLERANCE * latest_stds
            solutions, stds = mountings.tolist(), np.hypot(mounting_stds, np.fmax(excess, 0.0)).tolist()
            # What a belt without any such motion leaves does not count.
            motion = hub_motion_mps2(hub, mountings[:, 0], mountings[:, 1])
            motion[np.isnan(motion)] = 0.0
            baseline = _HUB_FLOOR * block.conditions[indices[0]].radius_m * np.square(block.arrays.omega_radps[indices])
            hub_mps2 = np.maximum(motion - np.square(baseline) / np.maximum(motion, 1e-12), 0.0).tolist()
        floor = self._last.floor
        contact = None if floor is None or floor.status is Status.INVALID else (floor.value, floor.std)
        equations = sums[:, _EQUATIONS].tolist()
        count, is_reversed, steps = self._last.revolutions, self._last.against, []
        for row, index in enumerate(indices):
            revolution, claims = block.revolutions[index], block.conditions[index].claims
            count += 1
            # Relative difference of the gains of two axes; tilts and mounting offset are ratios of axes.
            axes_std = math.hypot(claims.gain_std, _along_gain_std(self._along_gravity, claims.along_gain_std))
            offset = pitch = None
            if solutions is not None and stds is not None:
                pitch, offset = _mounting(solutions[row], stds[row], axes_std)
                if is_reversed and pitch is not None:
                    # Of the sensor, not of its turned axis.
                    pitch = Measurement(-pitch.value, pitch.std)
            tilt = Tilt.of(self._roll_by_mean, math.nan if pitch is None else pitch.value, self._yaw)
            if offset is not None and pitch is not None:
                yaw_offset_std_m = tilt.offset_error_m(offset.value, self._yaw_offset_m)
                offset = Measurement(offset.value, math.hypot(offset.std, yaw_offset_std_m))
            measured = Measured(
                revolutions=count,
                ac_coupled=revolution.ac_coupled,
                rate_hz=revolution.rate_hz,
                steady_mps2=expected[row],
                mean_square=belt.mean_square,
                by_mean=Equations(*equations[row][:5]),
                by_gravity=Equations(*equations[row][5:]),
                contact_gain=contact,
                offset_m=offset if count >= _OFFSET_MIN_COUNT else None,
                along_gravity=self._along_gravity,
                hub_mps2=hub_mps2[row],
                relations=self._relations,
                roll_by_mean_rad=self._roll_by_mean,
                tilt=tilt,
            )
            steps.append(
                CalibrationStep(
                    None, count, sums[row], pitch, offset, rise_k[row], floor, measured, is_reversed, self._has_along
                )
            )
        self._last = steps[-1]
        return steps


def _mounting_terms(
    revolutions: Sequence[Revolution],
    spectra: ComplexArray,
    belt: BeltKinematics,
    is_active: BoolArray,
    speeds: tuple[FloatArray, FloatArray],
    radius_m: float,
) -> MountingRows:
    """Return the equations of the mounting, zero for revolutions whose circumferential axis is no evidence.

    Args:
        revolutions: (n,) of one shape of the belt.
        spectra: (n, 2, orders) of their circumferential and radial axes.
        belt: kinematics of the belt.
        is_active: (n,) whether the circumferential axis measures.
        speeds: (n,) angular speed, rad/s, and angular acceleration, rad/s^2.
        radius_m: belt radius.
    """
    # The circumferential axis reads the acceleration of wheel and car; what fills a gap says nothing of the sensor.
    is_evident = is_active & np.array([is_evidence(each) and not each.assumed_steady for each in revolutions])
    if not is_evident.any():
        count = len(revolutions)
        return MountingRows(np.zeros((count, MOUNTING_SIZE)), np.zeros((count, HUB_SIZE)))
    order_max = np.array([revolution.order_max for revolution in revolutions])
    with_mean = not revolutions[0].ac_coupled
    mounting = mounting_rows(spectra, belt, *speeds, radius_m, order_max, with_mean=with_mean)
    if not is_evident.all():
        mounting.hub[~is_evident] = 0.0
        mounting.sums[~is_evident] = 0.0
    return mounting


def _is_active(spectra: ComplexArray) -> BoolArray:
    """Return which spectra (..., orders) are not those of an axis that stands still."""
    moving: BoolArray = np.abs(spectra[..., 1:]).max(axis=-1) > _INACTIVE_AXIS_MPS2
    return moving


@lru_cache(maxsize=64)
def _decay(count: int, retention: float) -> tuple[FloatArray, FloatArray]:
    """Return the shares of the sums before, (k,), and of each new row, (k, k), in the sums after k rows."""
    index: FloatArray = np.arange(count, dtype=np.float64)
    powers: FloatArray = retention ** (index + 1.0)
    ages: FloatArray = np.maximum(index[:, np.newaxis] - index, 0.0)
    rows: FloatArray = np.tril(np.power(retention, ages))
    for array in (powers, rows):
        array.setflags(write=False)
    return powers, rows


def _along_gain_std(gravity: AlongGravity | None, stated_std: float) -> float:
    """Return the relative error of the circumferential gain beside the others, as stated or as gravity shows it."""
    if gravity is None or gravity.is_absent:
        return stated_std
    return error_of(abs(gravity.share) - 1.0, math.hypot(gravity.std, _GRAVITY_MODEL), stated_std)


def _mounting(
    solution: Sequence[float], stds: Sequence[float], axes_std: float
) -> tuple[Measurement | None, Measurement | None]:
    """Return pitch and mounting offset; None where they are not finite."""
    offset, tilt = solution[0], solution[1]
    offset_std = math.hypot(stds[0], axes_std * offset, OFFSET_MODEL_M)
    if not (math.isfinite(offset_std) and math.isfinite(tilt)):
        return None, None
    pitch = Measurement(math.atan(tilt), math.hypot(stds[1], axes_std * tilt, PITCH_MODEL_RAD))
    return pitch, Measurement(offset, offset_std)


def _refusal(revolution: Revolution, conditions: TireConditions) -> Reason | None:
    """Return why a revolution must not be used; None when it may be."""
    if revolution.faults or revolution.saturated:
        return not_used(revolution.faults or (Reason(EstimateCode.RADIAL_SATURATED),))
    if not math.isfinite(revolution.orders_mps2[0].real):
        return Reason(RevolutionCode.AXIS_NOT_FINITE, axis=AXIS_NAMES[_RADIAL])
    if not conditions.radius_m > 0.0:
        return Reason(EstimateCode.SPEED_OR_RADIUS_UNKNOWN)
    if not math.isfinite(revolution.trailing_edge_rad - revolution.leading_edge_rad):
        return Reason(EstimateCode.NO_CONTACT_EDGES)
    return None
