"""Turn and camber rate of a wheel by the first order of its lateral axis and by the mean of that axis.

The belt passes the hub with V, so the lateral axis reads -2 V (turn cos(theta) + camber rate sin(theta)), and V times
the turn in its mean (`gateway.ring.turning_wheel`). A tire's own first order is, over the square of the speed, a
constant plus what side force makes, which is a constant factor times what the orders above predict
(`gateway.forces.free_belt`). Its mean is roll times the radial mean, plus an offset. A Kalman filter holds these
constants and separates them from the turn: cars drive straight most of the time. Each revolution is straight or turns,
by the likelihood of both; one that turns has a rate of its own, which no other revolution shares. A steady turn from
the first revolution on is known no better than the constants are before.
"""

import math
from collections import deque
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.core.compiled import core
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.revolutions.sensor_mounting import BANK_MPS2, MOUNTING_STD_RAD, OFFSET_STD_MPS2
from gateway.core.types import FloatArray
from gateway.forces.free_belt import FIRST_ORDER_SHARE, FIRST_ORDER_SHARE_STD, FIRST_ORDER_STD_M, first_order_rows
from gateway.forces.lateral_deformation import ORDERS
from gateway.forces.switching_step import SwitchingModel, stepped

# Yaw and camber rate of a wheel on straights, rad/s, and the revolutions over which they last: a lane is kept by
# steering, which turns a wheel faster than its path.
_STRAIGHT_RADPS: Final = 0.01
_STRAIGHT_REVOLUTIONS: Final = 5.0
# Revolutions over which the side force of straight driving lasts.
_FORCE_REVOLUTIONS: Final = 15.0
# Those of a wheel that turns.
_TURN_RADPS: Final = 0.3
_CAMBER_RADPS: Final = 0.1
# Where a curve begins or ends, the wheel turns on its path: rate of slip, and the revolutions over which it lasts.
_STEER_RADPS, _STEER_REVOLUTIONS = 0.12, 3.0
# Sine beyond its prediction over the change of the cosine by side force from one revolution to the next, both of the
# tire: the belt moves sideways while it turns, and the force grows from one contact to the next (40 random tires).
_SINE_OF_CHANGE: Final = 0.44
# Slip over the first order by its force: 4 to 50 rad/m on 30 random tires.
_SLIP_RADPM: Final = 15.0
# Camber rate over the rate of slip where side force changes: a car rolls by 3 to 6 deg/g, its tires slip by 6 to 8.
_CAMBER_OF_SLIP: Final = 0.3
# Revolutions over which the bank of the road lasts.
_BANK_REVOLUTIONS: Final = 60.0
# Errors within which a side force is usual on straights.
_USUAL_FORCES: Final = 2.0
# Factor of a usual rate below which any is as likely.
_ANY: Final = 10.0
# Change of a turn's rate from one revolution to the next, over a usual rate.
_CHANGE_OF_RATE: Final = 0.2
# Probability that a revolution turns: the first, one after a straight one, one after one that turns.
_FIRST_TURN, _TURN_BEGINS, _TURN_LASTS = 0.2, 0.01, 0.95
# Probability from which a revolution turns, or does not.
_CERTAIN: Final = 0.95
# Revolutions for which a straight or a turn lasts at least: where a curve ends, some may look like either.
_SHOWN_REVOLUTIONS: Final = 10
# Latest turns whose side force is compared with that of straights, and its least share of that: a recording that begins
# in a curve may take that for straight, and the straights after it for turns.
_COMPARED_TURNS, _MIN_FORCE_SHARE = 4, 0.7
# Probability that a recording begins in a steady curve, and the revolutions that one lasts at least.
_STEADY, _STEADY_REVOLUTIONS = 0.05, 27.0
# Revolutions over which the first is one of several.
_FIRST_REVOLUTIONS: Final = 4.0
# Prior of the roll.
_ROLL_STD_RAD: Final = math.radians(10.0)
# Constants change by a twentieth of their spread over tires and mountings in 500 revolutions.
_DRIFT: Final = 0.05 / math.sqrt(500.0)
# Noise of a first order and of a mean, m/s^2: least, and before it is known by differences of revolutions.
_MIN_NOISE_MPS2, _FIRST_NOISE_MPS2 = 0.02, 0.3
_NOISE_HORIZON: Final = 50.0
# Revolutions over which the level of straights is a mean.
_LEVEL_REVOLUTIONS: Final = 100.0
# Change of the first order by side force from one revolution to the next, straight and where the wheel turns.
_STEADY_FORCE_M, _TURNING_FORCE_M = 5e-6, 5e-5
# First order by side force of straight driving: by ply steer, conicity and toe; its change by wind and road; in curves.
_USUAL_FORCE_M, _STRAIGHT_FORCE_M, _CURVE_FORCE_M = 5e-4, 2e-4, 3e-3
# Variance of the first order of a revolution in which a curve begins or ends, over that of the change of its force.
_ONSET_FACTOR: Final = 4.0
# A difference beyond this many times the noise is a turn, not noise.
_STEP_OF_NOISE: Final = 3.0
# Places in the states.
_SHARE, _ROLL = 1, 2
# Logarithm of the largest odds of one revolution, of those by side force alone, and the least probability.
_LARGEST, _LARGEST_CHANGE, _TINY = 200.0, 10.0, 1e-100
_NUMBERS: Final[FloatArray] = np.asarray(ORDERS, dtype=np.float64)


class Turn(NamedTuple):
    """Turn of a wheel in one revolution.

    Attributes:
        turn_radps: yaw rate of the wheel, positive to the left.
        turn_std_radps: one standard error.
        turn_scatter_radps: the part of it that other revolutions do not share.
        camber_radps: rate of camber, positive where the left side rises.
        camber_std_radps: one standard error.
        camber_scatter_radps: as that of the turn.
        speed_mps: of the wheel.
        path_mps2: lateral acceleration, as far as the revolution turns; with its error.
        remove_m: (2,) cosine and sine over Omega^2 to subtract from the lateral axis; 0 on straights.
        remove_std_m: (2,) error of these that every revolution has in common.
        changes: from straights to a turn or back, so far; 0 where a turn had less side force than the straights.
    """

    turn_radps: float = 0.0
    turn_std_radps: float = math.inf
    turn_scatter_radps: float = 0.0
    camber_radps: float = 0.0
    camber_std_radps: float = math.inf
    camber_scatter_radps: float = 0.0
    speed_mps: float = 0.0
    path_mps2: tuple[float, float] = (0.0, 0.0)
    remove_m: tuple[float, float] = (0.0, 0.0)
    remove_std_m: tuple[float, float] = (0.0, 0.0)
    changes: int = 0


NO_TURN: Final = Turn()


class _Rate(NamedTuple):
    """A rate by one revolution.

    Attributes:
        value: mean.
        variance: of it.
        turning: mean where it turns.
        turning_variance: of that.
        probability: that it turns.
        shown: that it turns, as far as measurements say so: 0 where they say no more than is usual of cars.
    """

    value: float
    variance: float
    turning: float
    turning_variance: float
    probability: float
    shown: float


class _State(NamedTuple):
    """A state before the first revolution, and how it changes from one to the next.

    Attributes:
        mean: of the prior.
        std: of the prior.
        drift_std: of its change.
        decay: share that stays; the rest returns to the prior.
        of_the_road: whether it begins again where a curve begins or ends.
        begins_std: of it there, 0 for that of the prior.
    """

    mean: float
    std: float
    drift_std: float = 0.0
    decay: float = 1.0
    of_the_road: bool = False
    begins_std: float = 0.0


class _Noise:
    """Standard deviation of a measured value between revolutions, by how far each is from a line through those before.

    So a steady change, as of the side force in a slalom, is no noise.
    """

    def __init__(self) -> None:
        # Value and what a roll of 1 makes of it, of the last revolution and of the one before.
        self._last, self._older = (math.nan, 0.0), (math.nan, 0.0)
        self._square, self._count = _FIRST_NOISE_MPS2**2, 0

    def take(self, value: float, rolled: float = 0.0, roll: float = 0.0) -> float:
        """Add a value in m/s^2 of which a roll of 1 makes `rolled`, and return the variance so far."""
        (last, rolled_last), (older, rolled_older) = self._last, self._older
        if math.isfinite(older):
            self._count += 1
            # The first guess counts as one difference.
            change = value - 2.0 * last + older - roll * (rolled - 2.0 * rolled_last + rolled_older)
            step = min(change**2 / 6.0, _STEP_OF_NOISE**2 * self._square)
            self._square += (step - self._square) / min(self._count + 1, _NOISE_HORIZON)
        self._last, self._older = (value, rolled), self._last
        return self._square + _MIN_NOISE_MPS2**2


class _Filter:
    """Constants of a tire and the rate of its wheel: two Kalman filters, of straight driving and of a turn.

    Each goes on from both of the revolution before, by their probabilities. The last state is the rate.

    Attributes:
        turning: probability that the latest revolution turned.
    """

    def __init__(self, states: Sequence[_State], rate_radps: float, fixed: int = -1) -> None:
        """Start at a prior.

        Args:
            states: the last is the rate.
            rate_radps: standard deviation of the rate of a wheel that turns.
            fixed: index of a state that straights do not change, though what they know depends on it; -1 for none.
        """
        means, stds, changes, decays, _, onset_stds = np.array(states, dtype=np.float64).T
        self._means, self._covariances = np.stack([means, means]), np.stack([np.diag(np.square(stds))] * 2)
        self._covariances[1, -1, -1] = rate_radps**2
        # The rate of a turn does not return to 0.
        stays = np.stack([decays, np.append(decays[:-1], 1.0)])
        process_noise = np.square(changes) + (1.0 - decays**2) * np.square(stds)
        drift = np.stack([process_noise, np.append(process_noise[:-1], (_CHANGE_OF_RATE * rate_radps) ** 2)])
        # Where a curve begins or ends, the rate and the road are others.
        retain = np.array([0.0 if state.of_the_road else 1.0 for state in states])
        exits, entries = np.square(stds) * (1.0 - retain), np.square(np.maximum(onset_stds, stds)) * (1.0 - retain)
        entries = np.stack([exits, np.append(entries[:-1], rate_radps**2)])
        self._model = SwitchingModel(np.stack([stays, stays * retain, drift, entries]), (_ANY * rate_radps) ** 2, fixed)
        self.turning, self._onset = _FIRST_TURN, _FIRST_TURN
        # Probability of a turn without any measurement.
        self._blind = _FIRST_TURN

    def take(
        self, values: FloatArray, rows: FloatArray, noises: FloatArray, forces: tuple[float, float] = (1.0, 1.0)
    ) -> _Rate:
        """Update by one or two measured values.

        Args:
            values: (m,).
            rows: (m, n) their change with the states.
            noises: (m,) their variances.
            forces: likelihoods of side force on a straight and where a turn begins, over that of a turn that goes on.
        """
        straight, onset = 1.0 - self.turning, self._onset
        self._blind = _TURN_LASTS * self._blind + self._onset * (1.0 - self._blind)
        self._onset += (_TURN_BEGINS - self._onset) / _FIRST_REVOLUTIONS
        on_straight, on_onset = forces
        rests, ends = straight * (1.0 - onset) * on_straight, self.turning * (1.0 - _TURN_LASTS) * on_straight
        continues, starts = self.turning * _TURN_LASTS, straight * onset * on_onset
        prior = rests + ends + _TINY, continues + starts + _TINY
        switched = ends / prior[0], starts / prior[1]
        # How far a rate is from that before tells of a turn, and nothing of the constants: that of a turn is free.
        exponent = stepped(self._model, switched, (values, rows, noises), self._means, self._covariances)
        odds = prior[1] / prior[0] * math.exp(min(max(exponent, -_LARGEST), _LARGEST))
        self.turning = turning = odds / (1.0 + odds)
        certainty = max(turning - self._blind, 0.0) / (1.0 - self._blind)
        turn_rate, turn_variance = float(self._means[1, -1]), float(self._covariances[1, -1, -1])
        return _Rate(self.mean(-1), self.variance(-1), turn_rate, turn_variance, turning, certainty)

    def mean(self, index: int) -> float:
        """Return the mean of a state."""
        straight, turn = self._means[:, index].tolist()
        return float((1.0 - self.turning) * straight + self.turning * turn)

    def straight(self, index: int) -> float:
        """Return a state, were the latest revolution straight."""
        return float(self._means[0, index])

    def variance(self, index: int) -> float:
        """Return the variance of a state."""
        straight, turn = self._covariances[:, index, index].tolist()
        difference = float(self._means[1, index] - self._means[0, index])
        variance = (1.0 - self.turning) * (straight + self.turning * difference**2) + self.turning * turn
        return float(variance)


class _Level:
    """First order of straights beyond what is predicted: where it is unusual, it may be a steady turn."""

    def __init__(self, usual_m: float) -> None:
        self._usual_m = usual_m
        self._mean_m, self._weight = 0.0, 0.0

    def take(self, beyond_m: float, straight: float) -> None:
        """Add a revolution by its probability to be straight."""
        self._weight = (1.0 - 1.0 / _LEVEL_REVOLUTIONS) * self._weight + straight
        self._mean_m += straight / max(self._weight, 1.0) * (beyond_m - self._mean_m)

    def turn_m(self, error_m: float, by_turn_m: float) -> float:
        """Return the root mean square of a steady turn in it, by its probability.

        Args:
            error_m: of a prediction.
            by_turn_m: first order that a usual turn makes.
        """
        background = self._usual_m**2 + error_m**2
        total = background + by_turn_m**2
        by_turn = self._mean_m * (1.0 - background / total)
        exponent = min(0.5 * self._mean_m * by_turn / background, _LARGEST)
        persistence = _STEADY * _TURN_LASTS ** max(self._weight - _STEADY_REVOLUTIONS, 0.0)
        odds = persistence / (1.0 - persistence) * math.sqrt(background / total) * math.exp(exponent)
        return math.sqrt(odds / (1.0 + odds) * (by_turn**2 + background * (1.0 - background / total)))


class _Force:
    """First order that side force makes by its prediction, smoothed.

    Noise of a prediction is in what the first order has beyond it, with the opposite sign. The error of a smoothed one
    does not depend on its value, so that it does not look like a factor of side force.

    Attributes:
        change_m: of the latest revolution, beyond what is usual and noise.
        step_m: change of the smoothed prediction.
        latest_m: without what the roll of the sensor makes of it.
        usual_m: the same on straights.
    """

    def __init__(self) -> None:
        self._noise, self.change_m, self.step_m = _Noise(), 0.0, 0.0
        self._value, self._variance, self._error_m2 = 0.0, math.inf, 0.0
        # On straights.
        self.latest_m, self.usual_m, self._usual_variance = 0.0, 0.0, _USUAL_FORCE_M**2

    def take(self, predicted_m: float, square_radps2: float, turning: float) -> tuple[float, float]:
        """Add a prediction; return the smoothed one and its variance, m/s^2 both.

        Args:
            predicted_m: over the square of the speed.
            square_radps2: square of the speed.
            turning: probability that the revolution before turned.
        """
        noise = self._noise.take(predicted_m * square_radps2) / square_radps2**2
        change = predicted_m - self._value
        variance = self._variance + _STEADY_FORCE_M**2 + turning * _TURNING_FORCE_M**2
        self.change_m = math.sqrt(max(change**2 - variance - noise, 0.0))
        is_jump = change**2 > _STEP_OF_NOISE**2 * (variance + noise)
        if is_jump:
            variance = change**2
        gain = 1.0 if math.isinf(variance) else variance / (variance + noise)
        self.step_m = 0.0 if math.isinf(variance) else gain * change
        self._value += gain * change
        self._variance = gain * noise
        # A force that changes within the revolution is not that of its first order; one that goes on to change is wrong
        # the same way each time, which must not be learned as the tire's factor.
        self._error_m2 = self._variance + (_ONSET_FACTOR if is_jump else 0.25) * max(change**2 - noise, 0.0)
        return self._value * square_radps2, self._error_m2 * square_radps2**2

    def evidence(self, by_roll_m: float) -> tuple[float, float]:
        """Return how likely the latest force is on a straight and where a turn begins, over a turn that goes on.

        Args:
            by_roll_m: what the roll of the sensor makes of the prediction.
        """
        self.latest_m = self._value - by_roll_m
        straight = self._usual_variance + self._variance + _STRAIGHT_FORCE_M**2
        square = (self.latest_m - self.usual_m) ** 2 / straight
        # Wind and bank make a usual force of straights last.
        unusual = max(0.5 * (square - _USUAL_FORCES**2), 0.0)
        return math.exp(-min(unusual, _LARGEST_CHANGE)), math.sqrt(straight / (straight + _CURVE_FORCE_M**2))

    def learn(self, straight: float) -> None:
        """Take the latest force for one of straights, by their probability."""
        lasting = _FORCE_REVOLUTIONS * (self._error_m2 + _STRAIGHT_FORCE_M**2)
        gain = straight * self._usual_variance / (self._usual_variance + lasting)
        self.usual_m += gain * (self.latest_m - self.usual_m)
        self._usual_variance = (1.0 - gain) * self._usual_variance + (_DRIFT * _USUAL_FORCE_M) ** 2


def _decay(revolutions: float) -> float:
    return math.exp(-1.0 / revolutions)


class TurnTracker:
    """Turn of each revolution of a wheel, one after the other; deterministic."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        cosine, sine = (_State(0.0, std, _DRIFT * std) for std in FIRST_ORDER_STD_M)
        share = _State(FIRST_ORDER_SHARE, FIRST_ORDER_SHARE_STD, _DRIFT * FIRST_ORDER_SHARE_STD)
        yaw_mps2 = STANDARD_GRAVITY_MPS2 * MOUNTING_STD_RAD
        # First order, factor of side force, roll, offset, bank, rate of slip, yaw rate.
        self._turning = _Filter(
            [
                cosine,
                share,
                _State(0.0, _ROLL_STD_RAD, _DRIFT * MOUNTING_STD_RAD),
                _State(0.0, OFFSET_STD_MPS2, _DRIFT * OFFSET_STD_MPS2),
                _State(0.0, BANK_MPS2, decay=_decay(_BANK_REVOLUTIONS), of_the_road=True),
                _State(0.0, 0.0, decay=_decay(_STEER_REVOLUTIONS), of_the_road=True, begins_std=_STEER_RADPS),
                _State(0.0, _STRAIGHT_RADPS, decay=_decay(_STRAIGHT_REVOLUTIONS), of_the_road=True),
            ],
            _TURN_RADPS,
            # Noise of side force looks like its factor.
            _SHARE,
        )
        # First order, gravity by the yaw of the sensor, camber rate; the factor of side force is that of the turn.
        self._cambering = _Filter(
            [
                sine,
                _State(0.0, yaw_mps2, _DRIFT * yaw_mps2),
                _State(0.0, _STRAIGHT_RADPS, decay=_decay(_STRAIGHT_REVOLUTIONS), of_the_road=True),
            ],
            _CAMBER_RADPS,
        )
        self._forces = _Force(), _Force()
        self._levels = tuple(_Level(std) for std in FIRST_ORDER_STD_M)
        self._noises, self._mean_noise = (_Noise(), _Noise()), _Noise()
        # Whether the latest certain revolution turned and since how many, the same of what lasted, and its changes.
        self._latest: bool | None = None
        self._run_length = 0
        self._was_turning: bool | None = None
        self._changes = 0
        self._turn_forces_m: deque[float] = deque(maxlen=_COMPARED_TURNS)

    def take(
        self,
        lateral_m: FloatArray,
        radial_m: FloatArray,
        edges_rad: tuple[float, float],
        omega_radps: float,
        radius_m: float,
        means_mps2: tuple[float, float] | None,
    ) -> Turn:
        """Return the turn of the next revolution.

        Args:
            lateral_m: (2 k,) its coefficients over Omega^2 as measured.
            radial_m: (2 k,) what a roll of 1 adds to them.
            edges_rad: of the contact.
            omega_radps: angular speed.
            radius_m: belt radius.
            means_mps2: of its lateral and radial axis; None for an AC-coupled sensor.
        """
        square, speed = omega_radps**2, omega_radps * radius_m
        leading, trailing = edges_rad
        rows_m = first_order_rows(0.5 * (trailing - leading))
        *predicted, cosine_by_roll_m, sine_by_roll_m = _predicted(
            lateral_m, radial_m, rows_m, 0.5 * (trailing + leading)
        )
        # A turn that is not known moves the roll; that of straights is near enough for what is linear in it.
        roll, share = self._turning.straight(_ROLL), self._turning.mean(_SHARE)
        per_rate = -2.0 * speed
        # Equations in m/s^2; cosines, then sines.
        k = len(_NUMBERS)
        lateral_first = float(lateral_m[0]) * square, float(lateral_m[k]) * square
        by_roll = float(radial_m[0]) * square, float(radial_m[k]) * square
        force_by_roll = cosine_by_roll_m * square, sine_by_roll_m * square
        by_force, values, noises = [], [], []
        for part, (force, noise) in enumerate(zip(self._forces, self._noises, strict=True)):
            smooth, variance = force.take(predicted[part], square, self._turning.turning)
            by_force.append(smooth - roll * force_by_roll[part])
            values.append(lateral_first[part] - smooth)
            noises.append(noise.take(values[-1], by_roll[part], roll) + (1.0 + share) ** 2 * variance)
        # The prediction is of the lateral axis as measured; force times factor is linear about its latest value.
        measured, variances = [values[0] - share * roll * force_by_roll[0]], noises[:1]
        # A wheel is steered before its side force is the new one, and turns on its path by the rate of slip.
        slip_radps = _SLIP_RADPM * self._forces[0].change_m * omega_radps / (2.0 * math.pi)
        roll_row = by_roll[0] - (1.0 + share) * force_by_roll[0]
        rows = [[square, by_force[0], roll_row, 0.0, 0.0, 0.0, per_rate]]
        if means_mps2 is not None:
            lateral, radial = means_mps2
            measured.append(lateral)
            variances.append(self._mean_noise.take(lateral, radial, roll) + (speed * slip_radps) ** 2)
            rows.append([0.0, 0.0, radial, 1.0, 1.0, speed, speed])
        likelihoods = self._forces[0].evidence(roll * cosine_by_roll_m)
        turn = self._turning.take(np.array(measured), np.array(rows), np.array(variances), likelihoods)
        self._forces[0].learn(1.0 - turn.probability)
        self._count_changes(turn.probability)
        share_variance = self._turning.variance(_SHARE)
        sine = values[1] - roll * (by_roll[1] - force_by_roll[1]) - share * by_force[1]
        sine -= _SINE_OF_CHANGE * (1.0 + share) * self._forces[0].step_m * square
        camber = self._cambering.take(
            np.array([sine]),
            np.array([[square, 1.0, per_rate]]),
            np.array([noises[1] + share_variance * by_force[1] ** 2]),
        )
        residuals = measured[0] - roll_row * roll - share * by_force[0], sine
        remove, remove_std = [], []
        for part, rate in enumerate((turn, camber)):
            removed_m, common_m = _removal(rate, noises[part] / per_rate**2, per_rate / square)
            level = self._levels[part]
            level.take(residuals[part] / square, 1.0 - rate.probability)
            steady_m = (1.0 - rate.probability) * level.turn_m(
                math.sqrt(share_variance * by_force[part] ** 2 + noises[part]) / square,
                abs(per_rate) * (_TURN_RADPS, _CAMBER_RADPS)[part] / square,
            )
            remove.append(removed_m)
            remove_std.append(math.hypot(common_m, steady_m))
        threshold_m = _MIN_FORCE_SHARE * abs(self._forces[0].usual_m)
        return Turn(
            turn.value,
            math.hypot(math.sqrt(turn.variance), slip_radps),
            math.hypot(math.sqrt(min(noises[0] / per_rate**2, turn.variance)), slip_radps),
            camber.value,
            math.hypot(math.sqrt(camber.variance), _CAMBER_OF_SLIP * slip_radps),
            math.hypot(math.sqrt(min(noises[1] / per_rate**2, camber.variance)), _CAMBER_OF_SLIP * slip_radps),
            speed,
            (
                turn.shown * turn.turning * speed,
                turn.shown * math.sqrt(turn.turning_variance) * speed,
            ),
            (remove[0], remove[1]),
            (remove_std[0], remove_std[1]),
            self._changes if min(self._turn_forces_m, default=math.inf) >= threshold_m else 0,
        )

    def _count_changes(self, turning: float) -> None:
        """Take whether a revolution turned, where that is certain."""
        if max(turning, 1.0 - turning) < _CERTAIN:
            return
        is_turning = turning > 0.5
        self._run_length = self._run_length + 1 if is_turning is self._latest else 1
        self._latest = is_turning
        if self._run_length == _SHOWN_REVOLUTIONS:
            self._changes += self._was_turning is (not is_turning)
            self._was_turning = is_turning
            if is_turning:
                self._turn_forces_m.append(abs(self._forces[0].latest_m))


def _removal(rate: _Rate, noise_radps: float, per_m: float) -> tuple[float, float]:
    """Return the first order of a turn over Omega^2 with the error that revolutions share."""
    common_variance = max(rate.turning_variance - noise_radps, 0.0)
    variance = rate.shown * (common_variance + (1.0 - rate.shown) * rate.turning**2)
    return rate.shown * rate.turning * per_m, math.sqrt(variance) * abs(per_m)


def _predicted_by_numpy(
    lateral_m: FloatArray, radial_m: FloatArray, rows: FloatArray, centre_rad: float
) -> tuple[float, float, float, float]:
    """Return cosine and sine of the first order that the orders above predict, of the lateral and the radial record.

    Args:
        lateral_m: (2 k,) coefficients.
        radial_m: (2 k,) coefficients.
        rows: (2, 2 k) of `first_order_rows`.
        centre_rad: of the contact.
    """
    k = len(_NUMBERS)
    phasors = np.exp(1j * _NUMBERS * centre_rad)
    records = np.stack([lateral_m, radial_m])
    centred = (records[:, :k] - 1j * records[:, k:]) * phasors
    parts = np.concatenate([centred.real, -centred.imag], axis=1) @ rows.T
    lateral, radial = ((parts[:, 0] - 1j * parts[:, 1]) / phasors[0]).tolist()
    return lateral.real, -lateral.imag, radial.real, -radial.imag


def _predicted_by_core(
    lateral_m: FloatArray, radial_m: FloatArray, rows: FloatArray, centre_rad: float
) -> tuple[float, float, float, float]:
    """As `_predicted_by_numpy`, of C-contiguous arrays."""
    assert core is not None
    cosine, sine, by_roll, sine_by_roll = core.first_orders(lateral_m, radial_m, _NUMBERS, rows, centre_rad)
    return cosine, sine, by_roll, sine_by_roll


_predicted = _predicted_by_numpy if core is None else _predicted_by_core
