"""Turn and camber rate of a wheel by the first order of its lateral axis, and by the mean of that axis.

The belt passes the hub with V, so the lateral axis reads -2 V (turn cos(theta) + camber rate sin(theta)), and V times
the turn in its mean (`gateway.ring.turning_wheel`). The tire's own first order is constant over the square of the
speed: ply steer, conicity, gravity by the sensor's yaw; side force changes it, and changes the orders above with it
(`gateway.forces.free_belt`). So what a revolution has beyond what its higher orders predict is compared with the same
of all: cars drive straight most of the time, and revolutions that turn hardly count. Without straights a turn is known
no better than that prediction.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from gateway.core.estimates.disagreement import disagreement_std
from gateway.core.revolutions.sensor_mounting import RollCalibration
from gateway.core.types import FloatArray
from gateway.forces.free_belt import FIRST_ORDER_SHARE, FIRST_ORDER_STD_M, first_order_rows
from gateway.forces.lateral_deformation import ORDERS

# Turn and camber rate that straight driving has, rad/s: a lane that is kept, a road's crown.
_STRAIGHT_RADPS: Final = 0.008
# Error of a first order or a mean by the road, m/s^2, that revolutions one after the other share, and their number.
_ROAD_MPS2: Final = 0.15
_SHARED_REVOLUTIONS: Final = 4.0
# Revolutions of a curve, which share bank and camber.
_CURVE_REVOLUTIONS: Final = 60.0
# Error of the mean of the lateral axis as an acceleration of the path: 2 deg of bank and camber.
_BANK_MPS2: Final = 0.35
# Errors by which a turn must differ from straight driving.
_CLEAR: Final = 3.0
_MEMORY_REVOLUTIONS: Final = 500.0
_HORIZON_OF_SCATTER: Final = 50.0
_NUMBERS: Final[FloatArray] = np.asarray(ORDERS, dtype=np.float64)
_FIRST: Final = [0, len(ORDERS)]


class Turn(NamedTuple):
    """Turn of a wheel in one revolution.

    Attributes:
        turn_radps: yaw rate of the wheel, positive to the left.
        turn_std_radps: one standard error.
        camber_radps: rate of camber, positive where the left side rises.
        camber_std_radps: one standard error.
        speed_mps: of the wheel.
        remove_m: (2,) cosine and sine over Omega^2 to subtract from the lateral axis; 0 on straights.
        remove_std_m: (2,) error that every revolution has in common.
    """

    turn_radps: float = 0.0
    turn_std_radps: float = math.inf
    camber_radps: float = 0.0
    camber_std_radps: float = math.inf
    speed_mps: float = 0.0
    remove_m: tuple[float, float] = (0.0, 0.0)
    remove_std_m: tuple[float, float] = (0.0, 0.0)


NO_TURN: Final = Turn()


class _Part:
    """What the first order has beyond its prediction, cosine or sine: level of the straights and scatter."""

    def __init__(self, prior_std_m: float) -> None:
        self._prior_std_m = prior_std_m
        self.level_m, self._information, self.usual_m = 0.0, 0.0, 0.0
        self._weight = 0.0
        self._last_m, self._square_m2, self._count = math.nan, 0.0, 0

    @property
    def level_std_m(self) -> float:
        """Error of the level, with the chance that the level itself is a steady turn."""
        return math.hypot(1.0 / math.sqrt(self._prior_std_m**-2 + self._information), self.steady_m)

    @property
    def steady_m(self) -> float:
        """Error by the chance that the level, which is not as predicted, is itself a steady turn."""
        expected = math.hypot(self._prior_std_m, FIRST_ORDER_SHARE * self.usual_m)
        return disagreement_std(self.level_m, expected)

    @property
    def scatter_m(self) -> float:
        """Scatter of a revolution, by the differences of neighbours."""
        return math.sqrt(self._square_m2)

    def departure(self, beyond_m: float, straight_m: float) -> tuple[float, float]:
        """Return the departure from the level and its share that is a turn: 0 on straights, 1 in turns."""
        away = beyond_m - self.level_m
        spread = math.hypot(straight_m, _CLEAR * self.scatter_m, _CLEAR * self.level_std_m)
        return away, _share(away, spread)

    def take(self, beyond_m: float, predicted_m: float, road_m: float, share: float) -> None:
        """Add a revolution to the level as far as it does not turn."""
        if math.isfinite(self._last_m):
            self._count += 1
            step = 0.5 * (beyond_m - self._last_m) ** 2
            # A step into a turn is no scatter.
            step = min(step, 9.0 * self._square_m2) if self._count > _SHARED_REVOLUTIONS else step
            self._square_m2 += (step - self._square_m2) / min(self._count, _HORIZON_OF_SCATTER)
        self._last_m = beyond_m
        keep = 1.0 - 1.0 / _MEMORY_REVOLUTIONS
        still = (1.0 - share) ** 2
        added = still / (_SHARED_REVOLUTIONS * (road_m**2 + self._square_m2))
        self._information = keep * self._information + added
        self.level_m += added / (self._prior_std_m**-2 + self._information) * (beyond_m - self.level_m)
        self._weight = keep * self._weight + still
        if self._weight:
            self.usual_m += still / self._weight * (predicted_m - self.usual_m)


class TurnTracker:
    """Turn of each revolution of a wheel, one after the other; deterministic."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Forget everything."""
        self._parts = tuple(_Part(std) for std in FIRST_ORDER_STD_M)
        # Mean of what the first order shows of turns and the means do not: their zero may contain a steady turn.
        self._hidden_mps2, self._count = 0.0, 0
        # Share of the predicted change of the cosine by side force that it really has, less 1: information and sum.
        self._share = (FIRST_ORDER_SHARE**-2, 0.0)

    def take(
        self,
        lateral_m: FloatArray,
        edges_rad: tuple[float, float],
        omega_radps: float,
        radius_m: float,
        means_mps2: tuple[float, float] | None,
        roll: RollCalibration,
    ) -> Turn:
        """Return the turn of the next revolution.

        Args:
            lateral_m: (2 k,) its coefficients over Omega^2, roll removed.
            edges_rad: of the contact.
            omega_radps: angular speed.
            radius_m: belt radius.
            means_mps2: of its lateral and radial axis; None for an AC-coupled sensor.
            roll: calibration by the revolutions before, which is not changed.
        """
        square, speed = omega_radps**2, omega_radps * radius_m
        predicted = _predicted(lateral_m, edges_rad)
        beyond = lateral_m[_FIRST] - predicted
        straight_m, road_m = 2.0 * radius_m * _STRAIGHT_RADPS / omega_radps, _ROAD_MPS2 / square
        information, total = self._share
        share, share_std = total / information, 1.0 / math.sqrt(information)
        cosine, sine = self._parts
        change_m = float(predicted[0]) - cosine.usual_m
        # What the side force makes beyond its prediction, as far as turns before have shown it.
        beyond_force = float(beyond[0]) - share * change_m, float(beyond[1])
        force_std_m = share_std * abs(change_m), 0.0
        lateral, lateral_std, fit_std = _of_mean(means_mps2, roll)
        lateral_std = math.hypot(lateral_std, self._hidden_mps2)
        # A turn by each of them.
        per_m = square / (2.0 * speed)
        away, moves, stds = [], [], []
        for part, value, by_force in zip(self._parts, beyond_force, force_std_m, strict=True):
            departure, moved = part.departure(value, math.hypot(straight_m, by_force))
            away.append(departure)
            moves.append(moved)
            stds.append(math.hypot(part.level_std_m, road_m, part.scatter_m, by_force))
        turn, turn_std = -away[0] * per_m, stds[0] * per_m
        if math.isfinite(lateral):
            turn, turn_std = _joined((turn, turn_std), (lateral / speed, lateral_std / speed))
            if part_of_mean := min(abs(turn) / _STRAIGHT_RADPS, 1.0):
                noise = 2.0 * math.hypot(_BANK_MPS2, fit_std) / square
                weight = part_of_mean * change_m / (noise**2 * _CURVE_REVOLUTIONS)
                # The first order and the mean of a turn cancel: what is left of both is of the side force.
                left = float(beyond[0]) - cosine.level_m + 2.0 * lateral / square
                self._share = information + weight * change_m, total + weight * left
        # A turn shows in both; a first order alone may be of a side force that no curve makes, and widens errors.
        moved = moves[0] if math.isnan(lateral) else 0.0
        if lateral * away[0] < 0.0:
            moved = moves[0] * _share(lateral, _CLEAR * lateral_std)
        cosine.take(beyond_force[0], float(predicted[0]), road_m, max(moves[0], moved))
        sine.take(beyond_force[1], float(predicted[1]), road_m, moves[1])
        unexplained = (moves[0] - moved) * away[0]
        self._count += 1
        hidden = 0.5 * square * abs(unexplained)
        self._hidden_mps2 += (hidden - self._hidden_mps2) / min(self._count, _HORIZON_OF_SCATTER)
        return Turn(
            turn,
            turn_std,
            -away[1] * per_m,
            stds[1] * per_m,
            speed,
            (-moved * turn / per_m, moves[1] * away[1]),
            (
                math.hypot(moved * turn_std / per_m, unexplained, cosine.steady_m),
                math.hypot(moves[1] * sine.level_std_m, sine.steady_m),
            ),
        )


def _share(departure: float, spread: float) -> float:
    """Return the share of a departure that is one: 0 well within the spread, 1 well beyond."""
    power = (departure / spread) ** 8
    return power / (1.0 + power)


def _predicted(lateral_m: FloatArray, edges_rad: tuple[float, float]) -> FloatArray:
    """Return the first order that the orders above give, (2,) cosine and sine in m."""
    leading, trailing = edges_rad
    half, centre = 0.5 * (trailing - leading), 0.5 * (trailing + leading)
    turns = np.exp(1j * _NUMBERS * centre)
    k = len(_NUMBERS)
    about = (lateral_m[:k] - 1j * lateral_m[k:]) * turns
    cosine, sine = first_order_rows(half) @ np.concatenate([about.real, -about.imag])
    back = (cosine - 1j * sine) / turns[0]
    return np.array([back.real, -back.imag])


def _of_mean(means_mps2: tuple[float, float] | None, roll: RollCalibration) -> tuple[float, float, float]:
    """Return the lateral acceleration by the mean, its error as one of the path, and that of the fit alone."""
    if means_mps2 is None or not roll.count:
        return math.nan, math.nan, math.nan
    lateral, radial = means_mps2
    expected, fit_std = roll.expected(radial)
    return lateral - expected, math.hypot(_BANK_MPS2, fit_std), fit_std


def _joined(first: tuple[float, float], second: tuple[float, float]) -> tuple[float, float]:
    """Return the weighted mean of two values, with an error that covers their disagreement."""
    weights = first[1] ** -2, second[1] ** -2
    value = (weights[0] * first[0] + weights[1] * second[0]) / sum(weights)
    apart = disagreement_std(first[0] - second[0], math.hypot(first[1], second[1]))
    return value, math.hypot(sum(weights) ** -0.5, 0.5 * apart)
