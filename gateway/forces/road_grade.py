"""Estimator of the grade of the road, by the specific force of the hub along its heading.

A hub that accelerates with a on a grade feels a + g sin(grade) along its heading. The belt rolls under it, so that the
circumferential axis reads -cos(psi) of it, psi the inclination of the belt (`gateway.ring.turning_wheel`): a first
order. That of level gravity is a sine; those of the sensor's depth and pitch go with the square of the speed and with
the radial axis. The wheel's own speed gives a, and the rest is the grade. A Kalman filter takes the force as the input
of the speed, so that neither is differentiated:

    dV/dt = force - g sin(grade) - c Omega^2 - d - yaw times the first order of the lateral axis

c and d are constant in the tire. The grade is a short process, of single hills, and a long one, of mountains: only
changes of the speed separate the latter from the constants. That there is a hill is shown by the force less the gain of
speed over a stretch of the road, which differs between two stretches by more than noise makes of so many.
"""

import math
from statistics import NormalDist
from typing import Final, NamedTuple

import numpy as np

from gateway.core.constants import AXIS_NAMES, STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import (
    DETERMINED,
    SETTLED_REVOLUTIONS,
    Estimate,
    Revolution,
    Status,
    TireConditions,
    not_used,
)
from gateway.core.estimates.pace import is_due
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import RevolutionBlock, RevolutionEstimator
from gateway.core.estimates.sensor_claims import HAND_MOUNTED_YAW_STD_RAD
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.revolutions.sensor_mounting import BeltKinematics, belt_kinematics
from gateway.core.types import FloatArray
from gateway.forces.lateral_shape import CIRCUMFERENTIAL, LATERAL, RADIAL, acceleration_gains
from gateway.forces.reasons import ForceCode
from gateway.ring.determination import positive

NAME: Final = "road_grade_rad"
_G: Final = STANDARD_GRAVITY_MPS2
# Hills and mountains: g sin(grade), m/s^2, and the length over which it lasts.
_HILL_MPS2, _HILL_M = 0.3, 150.0
_MOUNTAIN_MPS2, _MOUNTAIN_M = 0.3, 3000.0
# First order that is constant in a tire, over the square of the speed, and in m/s^2: simulated tires have a fifth.
_CONSTANT_M, _CONSTANT_MPS2 = 1e-5, 0.02
# Share of a slip in the speed for 1 g along the heading, between that of a wheel that rolls freely and one that drives.
_SLIP, _SLIP_STD = 0.04, 0.03
# Gain beside that of level gravity, and torque at the axle: 0.3 of the load changes the force by 1.5 % of it.
_GAIN_STD: Final = 0.02
# Slip angle of a tire in a curve, rad for 1 m/s^2: it turns the heading into the curve.
_SLIP_ANGLE, _SLIP_ANGLE_STD = 0.0087, 0.005
# Lateral acceleration of a curve where no estimator gives it.
_CURVE_MPS2: Final = 2.0
# Relative error of a speed where that of its times is not known, and its least.
_SPEED_STD, _MIN_SPEED_STD = 4e-4, 1e-5
# Noise of the force before it is known by the differences of neighbours, and its memory.
_FIRST_NOISE_MPS2, _HORIZON = 0.5, 50.0
# A difference beyond this many times the noise, and a speed this many errors off, are of a wheel that slides or hops.
_STEP_OF_NOISE, _OUTLIER = 3.0, 5.0
# Acceleration between revolutions that do not follow each other.
_UNSEEN_MPS2: Final = 3.0
# Steps over the period from which they do not.
_FOLLOWS: Final = 1.5
# Share of the latest revolution in the acceleration that slip goes with.
_LATEST: Final = 0.3
# Level gravity in the axis, over its own, below which the axis is not the one along the belt.
_MIN_GRAVITY: Final = 0.5
# Stretch of the road over which the force is averaged: a third of a hill.
_STRETCH_M: Final = 50.0
# Share of steady grades that may seem to change.
_BY_CHANCE: Final = math.erfc(DETERMINED / math.sqrt(2.0))
# States.
_SPEED, _HILL, _MOUNTAIN, _SQUARE, _CONSTANT, _YAW, _GAIN, _IN_CURVE, _BY_SLIP = range(9)
_SIZE: Final = 9
_GRADE: Final = [_HILL, _MOUNTAIN]
# Their errors count, and nothing is learned of them: noise of the force and of the speed would look like them.
_CONSIDERED: Final = [_GAIN, _IN_CURVE, _BY_SLIP]


# Errors of what stretches of the road differ by beside the grade, by state.
_BIAS_STDS: Final[FloatArray] = np.zeros(_SIZE)
_BIAS_STDS[[_SQUARE, _YAW, *_CONSIDERED]] = _CONSTANT_M, HAND_MOUNTED_YAW_STD_RAD, _GAIN_STD, _SLIP_ANGLE_STD, _SLIP_STD


class _Force(NamedTuple):
    """Specific force of the hub along its heading, in one revolution.

    Attributes:
        time_s: middle of the revolution.
        speed_mps: of the wheel.
        speed_std_mps: its standard error.
        acceleration_mps2: of the wheel.
        force_mps2: by the circumferential axis.
        row: (9,) change of dV/dt with the states.
        noise_mps2: what the curve adds to that of the axis.
        gravity: level gravity in the axis, over g.
    """

    time_s: float
    speed_mps: float
    speed_std_mps: float
    acceleration_mps2: float
    force_mps2: float
    row: FloatArray
    noise_mps2: float
    gravity: float


class _Change:
    """Whether the grade changes, by the force of stretches of the road less their gain of speed."""

    def __init__(self) -> None:
        self._start: _Force | None = None
        self._slip_mps, self._square, self._stretches = 0.0, math.nan, 0
        self._sums, self._force_mps, self._noise, self._steps = np.zeros(_SIZE), 0.0, 0.0, 0
        # Highest and lowest force so far, each less half of what is a change.
        self._highest, self._lowest = -math.inf, math.inf

    @property
    def is_shown(self) -> bool:
        """Whether two stretches differ beyond their errors."""
        return self._highest > self._lowest

    def interrupt(self) -> None:
        """Begin a new stretch with the next revolution."""
        self._start = None

    def take(self, last: _Force, now: _Force, accelerations_mps2: tuple[float, float], noise_mps2: float) -> None:
        """Add the way from the middle of a revolution to that of the next one.

        Args:
            last: the revolution before.
            now: this revolution.
            accelerations_mps2: with which slip goes, at both.
            noise_mps2: of a force.
        """
        if self._start is None:
            self._start, self._slip_mps = last, last.speed_mps * accelerations_mps2[0] / _G
            self._sums, self._force_mps, self._noise, self._steps = np.zeros(_SIZE), 0.0, 0.0, 0
        step_s = now.time_s - last.time_s
        self._sums = self._sums + 0.5 * step_s * (last.row + now.row)
        self._force_mps += 0.5 * step_s * (last.force_mps2 + now.force_mps2)
        self._noise += step_s * now.noise_mps2
        self._steps += 1
        duration_s = now.time_s - self._start.time_s
        if duration_s * now.speed_mps < _STRETCH_M:
            return
        row = self._sums / duration_s
        row[_BY_SLIP] = (now.speed_mps * accelerations_mps2[1] / _G - self._slip_mps) / duration_s
        if math.isnan(self._square):
            self._square = float(row[_SQUARE])
        row[_SQUARE] -= self._square
        gain_mps = now.speed_mps - self._start.speed_mps
        force = (self._force_mps - gain_mps) / duration_s + _SLIP * float(row[_BY_SLIP])
        by_speed = math.hypot(now.speed_std_mps, self._start.speed_std_mps) / duration_s
        noise = math.hypot(noise_mps2 / math.sqrt(self._steps), self._noise / duration_s, by_speed)
        self._compare(force, math.hypot(noise, *(row * _BIAS_STDS).tolist()))
        self._start = None

    def _compare(self, force_mps2: float, std_mps2: float) -> None:
        """Compare a stretch with those before it: the more there are, the more they differ by chance."""
        self._stretches += 1
        pairs = max(0.5 * self._stretches * (self._stretches - 1), 1.0)
        half = -NormalDist().inv_cdf(0.5 * _BY_CHANCE / pairs) * std_mps2 / math.sqrt(2.0)
        self._highest, self._lowest = max(self._highest, force_mps2 - half), min(self._lowest, force_mps2 + half)


class _Belt:
    """First orders of the circumferential axis by the shape of the belt, about the contact's centre.

    Attributes:
        sine: (n,) of the belt's inclination, on the angle grid.
        cosine: (n,) likewise.
        force_row: (n,) gives the force along the heading.
        gravity_row: (n,) gives level gravity.
        by_depth: force over e Omega^2 that a sensor e below the neutral layer reads.
    """

    def __init__(self, belt: BeltKinematics, centre_rad: float) -> None:
        self.sine, self.cosine = np.sin(belt.inclination_rad), np.cos(belt.inclination_rad)
        theta = angle_grid(len(self.sine)) - centre_rad
        sines = np.sin(theta)
        self.force_row: FloatArray = -2.0 / len(theta) / belt.gravity_order_1 * np.cos(theta)
        self.gravity_row: FloatArray = sines / float(sines @ self.sine)
        # The sums of `BeltKinematics` begin at -pi.
        circumferential = -belt.along[1] * complex(math.cos(centre_rad), math.sin(centre_rad))
        self.by_depth = -float(circumferential.real) / belt.gravity_order_1


class RoadGradeEstimator(RevolutionEstimator):
    """Grade of the road in the direction of rolling; no estimates without a circumferential axis.

    Gives road_grade_rad, of the latest revolution. It takes the curve from the estimator `turning`; without that, the
    error contains a usual one. A steady grade looks like a first order that is constant in the tire, so it is
    provisional until the grade has changed beyond the errors of stretches of the road.
    """

    name = "grade"

    def reset(self) -> None:
        """Forget the road and the tire."""
        self._belt: _Belt | None = None
        self._count, self._differences = 0, 0
        self._last: _Force | None = None
        self._acceleration_mps2, self._gravity = 0.0, 0.0
        self._noise_square, self._last_excess_mps2 = _FIRST_NOISE_MPS2**2, math.nan
        self._mean: FloatArray = np.zeros(_SIZE)
        self._covariance: FloatArray = np.zeros((_SIZE, _SIZE))
        self._change = _Change()

    def _estimates(self, block: RevolutionBlock, index: int) -> tuple[Estimate, ...]:
        revolution, conditions = block.revolutions[index], block.conditions[index]
        if math.isnan(revolution.axes_mps2[CIRCUMFERENTIAL, 0]):
            return ()
        reason = self._unusable(revolution, conditions) or self._renewed(block, index)
        if reason is not None:
            return (Estimate.invalid(NAME, reason),)
        assert self._belt is not None
        current = _force(revolution, conditions, self._belt)
        self._gravity += (current.gravity - self._gravity) / min(self._count, _HORIZON)
        if self._gravity < _MIN_GRAVITY:
            self._last = None
            return (Estimate.invalid(NAME, Reason(ForceCode.NO_GRAVITY_ALONG, share=self._gravity)),)
        # A hub that restarts begins its time again.
        if self._last is None or current.time_s <= self._last.time_s:
            self._start(current, conditions)
        else:
            previous_mps2 = self._acceleration_mps2
            self._predict(self._last, current, conditions.radius_m)
            self._correct(current)
            if current.time_s - self._last.time_s < _FOLLOWS * revolution.period_s:
                accelerations = previous_mps2, self._acceleration_mps2
                self._change.take(self._last, current, accelerations, math.sqrt(self._noise_square))
        self._last = current
        return (self._estimate(revolution),)

    @staticmethod
    def _unusable(revolution: Revolution, conditions: TireConditions) -> Reason | None:
        if revolution.faults:
            return not_used(revolution.faults)
        if not (positive(conditions.radius_m) and positive(revolution.omega_radps)):
            return Reason(EstimateCode.SPEED_OR_RADIUS_UNKNOWN)
        for axis in (CIRCUMFERENTIAL, RADIAL):
            if not np.isfinite(revolution.axes_mps2[axis]).all():
                return Reason(RevolutionCode.AXIS_NOT_FINITE, axis=AXIS_NAMES[axis])
        return None

    def _renewed(self, block: RevolutionBlock, index: int) -> Reason | None:
        """Take the belt's shape from the average where that is due; return why there is none."""
        self._count += 1
        if self._belt is not None and not is_due(self._count):
            return None
        average, conditions = block.averages.at(index), block.conditions[index]
        centre = 0.5 * (average.leading_edge_rad + average.trailing_edge_rad)
        if not math.isfinite(centre):
            return Reason(EstimateCode.NO_CONTACT_EDGES)
        if not (np.isfinite(average.radial_mps2).all() and average.radial_mps2.mean() > 0.0):
            return Reason(CoreCode.NO_STEADY_VALUE)
        belt = belt_kinematics(average.radial_mps2, conditions.sensor_offset_m / conditions.radius_m, centre)
        self._belt = _Belt(belt, centre)
        return None

    def _start(self, current: _Force, conditions: TireConditions) -> None:
        """Start the filter at its prior."""
        self._change.interrupt()
        self._last_excess_mps2 = math.nan
        yaw = conditions.tilt.yaw_std_rad
        stds = [_SPEED_STD * current.speed_mps, _HILL_MPS2, _MOUNTAIN_MPS2, _CONSTANT_M, _CONSTANT_MPS2, yaw]
        self._covariance = np.diag(np.square([*stds, _GAIN_STD, _SLIP_ANGLE_STD, _SLIP_STD]))
        self._mean = np.zeros(_SIZE)
        self._mean[_SPEED], self._mean[_BY_SLIP] = current.speed_mps, _SLIP
        self._acceleration_mps2 = current.acceleration_mps2

    def _predict(self, last: _Force, current: _Force, radius_m: float) -> None:
        """Move the filter from the middle of the last revolution to that of this one."""
        step_s, period_s = current.time_s - last.time_s, 2.0 * math.pi * radius_m / current.speed_mps
        excess_mps2 = current.force_mps2 - current.acceleration_mps2
        unseen_mps = 0.0
        if step_s > _FOLLOWS * period_s:
            unseen_mps, self._last_excess_mps2 = _UNSEEN_MPS2 * (step_s - period_s), math.nan
            self._change.interrupt()
        if math.isfinite(self._last_excess_mps2):
            self._differences += 1
            step = min(0.5 * (excess_mps2 - self._last_excess_mps2) ** 2, _STEP_OF_NOISE**2 * self._noise_square)
            self._noise_square += (step - self._noise_square) / min(self._differences + 1, _HORIZON)
        self._last_excess_mps2 = excess_mps2
        transition, process_noise = np.eye(_SIZE), np.zeros(_SIZE)
        for state, std_mps2, length_m in ((_HILL, _HILL_MPS2, _HILL_M), (_MOUNTAIN, _MOUNTAIN_MPS2, _MOUNTAIN_M)):
            decay = math.exp(-current.speed_mps * step_s / length_m)
            transition[state, state], process_noise[state] = decay, (1.0 - decay**2) * std_mps2**2
        transition[_SPEED] = 0.5 * step_s * (last.row + current.row)
        transition[_SPEED, _SPEED] = 1.0
        process_noise[_SPEED] = step_s**2 * (self._noise_square + current.noise_mps2**2) + unseen_mps**2
        self._mean = transition @ self._mean
        self._mean[_SPEED] += 0.5 * step_s * (last.force_mps2 + current.force_mps2)
        self._covariance = transition @ self._covariance @ transition.T + np.diag(process_noise)

    def _correct(self, current: _Force) -> None:
        """Take the speed of a revolution."""
        self._acceleration_mps2 += _LATEST * (current.acceleration_mps2 - self._acceleration_mps2)
        row = np.zeros(_SIZE)
        row[_SPEED], row[_BY_SLIP] = 1.0, current.speed_mps * self._acceleration_mps2 / _G
        gains = self._covariance @ row
        variance = float(row @ gains)
        innovation = current.speed_mps - float(row @ self._mean)
        noise = max(current.speed_std_mps**2, (innovation / _OUTLIER) ** 2 - variance)
        gains /= variance + noise
        gains[_CONSIDERED] = 0.0
        self._mean = self._mean + gains * innovation
        complement = np.eye(_SIZE) - np.outer(gains, row)
        self._covariance = complement @ self._covariance @ complement.T + noise * np.outer(gains, gains)

    def _estimate(self, revolution: Revolution) -> Estimate:
        assert self._last is not None
        sine = min(max(float(self._mean[_GRADE].sum()) / _G, -1.0), 1.0)
        grade = math.asin(sine)
        per_mps2 = 1.0 / (_G * max(math.cos(grade), 0.1))
        std = per_mps2 * math.sqrt(max(float(self._covariance[np.ix_(_GRADE, _GRADE)].sum()), 0.0))
        # What is constant in the tire, all revolutions share.
        square = -float(self._last.row[_SQUARE])
        by_tire = np.zeros(_SIZE)
        by_tire[[_SQUARE, _CONSTANT]] = square, 1.0
        shared_std = per_mps2 * math.sqrt(max(float(by_tire @ self._covariance @ by_tire), 0.0))
        doubts: list[Reason] = []
        if self._count < SETTLED_REVOLUTIONS:
            doubts.append(Reason(CoreCode.NOT_SETTLED, revolutions=self._count, needed=SETTLED_REVOLUTIONS))
        elif not self._change.is_shown:
            doubts.append(Reason(ForceCode.GRADE_NOT_CHANGED, shared_std_rad=shared_std))
        if revolution.ac_coupled and not revolution.corner:
            doubts.append(Reason(ForceCode.AC_CORNER_NOT_STATED))
        status = Status.PROVISIONAL if doubts else Status.VALID
        return Estimate(NAME, grade, std, status, tuple(doubts), math.sqrt(max(std**2 - shared_std**2, 0.0)))


def _force(revolution: Revolution, conditions: TireConditions, belt: _Belt) -> _Force:
    """Return the force of a revolution, less what depth, pitch and a curve's slip angle make of it."""
    axes, square = revolution.axes_mps2, revolution.omega_radps**2
    speed, period_s = revolution.omega_radps * conditions.radius_m, revolution.period_s
    spin = revolution.omega_dot_radps2 * conditions.radius_m
    # What the belt's shape makes goes with the square of the speed; gravity and acceleration do not.
    gains = acceleration_gains([revolution], len(belt.sine))[0]
    circumferential = (axes[CIRCUMFERENTIAL] - _G * belt.sine - spin * (1.0 - belt.cosine)) * gains
    by_pitch = float(belt.force_row @ (axes[RADIAL] * gains))
    lateral = axes[LATERAL] * gains
    by_yaw = float(belt.force_row @ lateral) if np.isfinite(lateral).all() else 0.0
    force = float(belt.force_row @ circumferential) + spin - conditions.sensor_offset_m * square * belt.by_depth
    force -= math.tan(conditions.tilt.pitch_rad) * by_pitch
    curve = conditions.given.get("turning", {}).get("lateral_acceleration_mps2")
    is_unknown = curve is None or curve.status is Status.INVALID
    curve_mps2, curve_std = (0.0, _CURVE_MPS2) if curve is None or is_unknown else (curve.value, curve.std)
    force -= _SLIP_ANGLE * curve_mps2**2
    noise = _SLIP_ANGLE * (2.0 * abs(curve_mps2) * curve_std + is_unknown * curve_std**2)
    row = np.zeros(_SIZE)
    row[[*_GRADE, _SQUARE, _CONSTANT, _YAW, _GAIN]] = -1.0, -1.0, -square, -1.0, -by_yaw, -force
    row[_IN_CURVE] = -(curve_mps2**2)
    std = revolution.period_std_s / period_s
    gravity = 1.0 + float(belt.gravity_row @ circumferential) / _G
    return _Force(
        revolution.start_s + 0.5 * period_s,
        speed,
        speed * (max(std, _MIN_SPEED_STD) if math.isfinite(std) else _SPEED_STD),
        spin,
        force,
        row,
        noise,
        gravity,
    )
