"""Path of a car by its wheels alone: speed and turn rate integrated revolution by revolution, with their errors.

A leg is a pose at its end relative to that at its begin, with a covariance of what its revolutions do not share, and
the change by one standard error of what all revolutions share: in the turn rate and in the speed. Legs are joined
exactly, so that the path does not depend on how many revolutions are drawn as one.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.text.readout import DISTANCE, SPEED
from gateway.core.trust.turn_verdict import TURN_RATE
from gateway.core.types import FloatArray

MAX_LEGS: Final = 960
"""Legs of a wheel that are kept."""
_NS: Final = 1e-9
# Yaw rate that a car can take up or lose within a second, for revolutions that were not measured.
_CHANGE_RADPS: Final = 0.3
# Share of a length that was not measured at all.
_UNKNOWN_LENGTH: Final = 0.5
# Of the variance of a turn rate that revolutions share, the part that lasts for a time, as of lane, bank and side
# force; the rest is of the tire and lasts for good.
_LASTING_SHARE, _LASTS_S = 0.7, 20.0
_LASTS: Final = 2
# Mean square of half the square of a normal number.
_SECOND_ORDER: Final = 0.75
# Standard error of a direction beyond which a path says nothing: a quarter of a turn.
_LOST_RAD: Final = 0.5 * math.pi
# Wheels that begin later are not of the same path.
_SAME_BEGIN_S: Final = 1.0
_EARTH_RADIUS_M: Final = 6_371_000.0
_FEWEST_FIXES: Final = 3
# Of a position, as data sheets state it.
_FIX_STD_M: Final = 2.1


class Leg(NamedTuple):
    """A part of a path, in the axes of its begin: x ahead, y to the left.

    Attributes:
        end_ns: its end, as `drive.Point.time_ns`.
        pose: (3,) x and y in m, heading in rad.
        covariance: (4, 4) of the pose, and of the turn rate's error that lasts, in standard errors; of its own.
        shared: (4, 3) change by one standard error that all legs share, of turn rate and speed, and by the turn rate's
            error that lasts, as it was at the begin.
        fix_deg: latitude and longitude of a receiver at its end, NaN without one.
    """

    end_ns: int
    pose: FloatArray
    covariance: FloatArray
    shared: FloatArray
    fix_deg: tuple[float, float] = (math.nan, math.nan)

    def then(self, after: "Leg") -> "Leg":
        """Return this leg and the one after it as one."""
        rotation = _rotation(self.pose[2])
        step = rotation[:3, :3] @ after.pose
        jacobian = np.array([[1.0, 0.0, -step[1], 0.0], [0.0, 1.0, step[0], 0.0], [0.0, 0.0, 1.0, 0.0], [0.0] * 4])
        after_shared = rotation @ after.shared
        jacobian[:, 3] = after_shared[:, _LASTS]
        after_shared[:, _LASTS] = 0.0
        covariance = jacobian @ self.covariance @ jacobian.T + rotation @ after.covariance @ rotation.T
        return Leg(after.end_ns, self.pose + step, covariance, jacobian @ self.shared + after_shared, after.fix_deg)

    def error(self) -> FloatArray:
        """Return the whole covariance of the pose, (3, 3)."""
        common_error = self.shared[:3]
        return self.covariance[:3, :3] + common_error @ common_error.T


def _rotation(heading_rad: float) -> FloatArray:
    rotation = np.eye(4)
    cosine, sine = math.cos(heading_rad), math.sin(heading_rad)
    rotation[:2, :2] = (cosine, -sine), (sine, cosine)
    return rotation


class _Span(NamedTuple):
    """Length in m and turn in rad of a leg: value, error of its own, and error that all legs share."""

    length: tuple[float, float, float]
    turn: tuple[float, float, float]

    def leg(self, end_ns: int, duration_s: float) -> Leg:
        """Return an arc of this length and turn."""
        length_m, turn_rad = self.length[0], self.turn[0]
        half = 0.5 * turn_rad
        chord = float(np.sinc(half / math.pi))
        by_length = np.array([chord * math.cos(half), chord * math.sin(half), 0.0, 0.0])
        by_turn = np.array([-0.5 * length_m * math.sin(half), 0.5 * length_m * math.cos(half), 1.0, 0.0])
        decay = math.exp(-duration_s / _LASTS_S)
        rows = np.stack([by_turn * self.turn[1], by_length * self.length[1]])
        covariance = rows.T @ rows
        covariance[3, 3] = 1.0 - decay**2
        constant, lasting = (math.sqrt(share) * self.turn[2] for share in (1.0 - _LASTING_SHARE, _LASTING_SHARE))
        common_error = np.stack([by_turn * constant, by_length * self.length[2], by_turn * lasting], axis=1)
        common_error[3, _LASTS] = decay
        return Leg(end_ns, length_m * by_length[:3] + [0.0, 0.0, turn_rad], covariance, common_error)


class _Rolled(NamedTuple):
    """What is known at the end of a measured revolution."""

    end_ns: int
    speed: Estimate
    turn: Estimate
    distance: Estimate | None


class WheelPath:
    """Path of a wheel in bounded memory.

    Attributes:
        legs: one after the other, each of `stride` revolutions; at most MAX_LEGS.
    """

    def __init__(self) -> None:
        self.legs: list[Leg] = []
        self._start_legs: list[Leg] = []
        self._stride, self._joined = 1, 0
        self._last: _Rolled | None = None

    def add(self, result: RevolutionResult, end_ns: int) -> None:
        """Take a revolution; what lies between it and the last one with a turn rate is bridged, with a wide error."""
        usable = {estimate.name: estimate for estimate in result.estimates if estimate.status is not Status.INVALID}
        speed, turn_rate = usable.get(SPEED), usable.get(TURN_RATE)
        if speed is None or turn_rate is None or not (math.isfinite(turn_rate.std) and math.isfinite(speed.std)):
            return
        current = _Rolled(end_ns, speed, turn_rate, usable.get(DISTANCE))
        period_s = result.revolution.period_s
        begin_ns = end_ns - round(period_s / _NS)
        if self._last is None:
            self._start_legs = [_Span((0.0, 0.0, 0.0), (0.0, 0.0, 0.0)).leg(begin_ns, 0.0)]
        elif (end_ns - self._last.end_ns) * _NS > 1.5 * period_s:
            self._join(_bridged(self._last, current, period_s).leg(begin_ns, (begin_ns - self._last.end_ns) * _NS))
        length = (speed.value * period_s, speed.scatter_std * period_s, speed.constant_std * period_s)
        angle = (turn_rate.value * period_s, turn_rate.scatter_std * period_s, turn_rate.constant_std * period_s)
        fix = [usable[name].value if name in usable else math.nan for name in ("latitude_deg", "longitude_deg")]
        self._join(_Span(length, angle).leg(end_ns, period_s)._replace(fix_deg=(fix[0], fix[1])))
        self._last = current

    def _join(self, leg: Leg) -> None:
        if self._joined % self._stride and self.legs:
            self.legs[-1] = self.legs[-1].then(leg)
        else:
            self.legs.append(leg)
        self._joined += 1
        if len(self.legs) > MAX_LEGS:
            pairs = zip(self.legs[::2], (*self.legs[1::2], None), strict=False)
            self.legs = [first if second is None else first.then(second) for first, second in pairs]
            self._stride *= 2

    def whole(self) -> list[Leg]:
        """Return the path up to its begin and the end of each leg, as far as its direction is known."""
        path = list(self._start_legs)
        for leg in self.legs:
            path.append(path[-1].then(leg))
            if path[-1].error()[2, 2] > _LOST_RAD**2:
                break
        return path


def _bridged(last: _Rolled, current: _Rolled, period_s: float) -> _Span:
    """Return what lies between two measured revolutions."""
    speed_mps = 0.5 * (last.speed.value + current.speed.value)
    gap_s = (current.end_ns - last.end_ns) * _NS - period_s
    length_m, std_m = speed_mps * gap_s, _UNKNOWN_LENGTH * speed_mps * gap_s
    if last.distance is not None and current.distance is not None:
        length_m = max(current.distance.value - last.distance.value - current.speed.value * period_s, 0.0)
        std_m = math.sqrt(max(current.distance.std**2 - last.distance.std**2, 0.0))
    # A car that stands does not turn.
    rolled_s = length_m / max(speed_mps, 1e-3)
    turn_rad = 0.5 * (last.turn.value + current.turn.value) * rolled_s
    turn_std = _CHANGE_RADPS * rolled_s * min(rolled_s, 1.0)
    return _Span((length_m, std_m, 0.0), (turn_rad, turn_std, current.turn.constant_std * rolled_s))


class CarPath(NamedTuple):
    """Path of a car as the mean of its wheels'.

    Attributes:
        wheels: that it rests on.
        position_m: (n, 2) from its begin: ahead of it and to the left.
        covariance_m2: (n, 2, 2); errors that wheels may share are not averaged.
        length_m: of it.
        received_m: (k, 2) positions of a receiver, moved and turned to fit; empty without.
        apart_m: root mean square distance from these, NaN without.
        is_lost: whether it ends before the drive, because its direction is not known any more.
    """

    wheels: tuple[str, ...]
    position_m: FloatArray
    covariance_m2: FloatArray
    length_m: float
    received_m: FloatArray
    apart_m: float
    is_lost: bool

    def ellipse(self, index: int) -> tuple[float, float, float]:
        """Return semi-axes of one standard error in m, the longer first, and the angle of the longer in rad."""
        values, vectors = np.linalg.eigh(self.covariance_m2[index])
        short, long = np.sqrt(np.maximum(values, 0.0)).tolist()
        return long, short, math.atan2(vectors[1, 1], vectors[0, 1])


def car_path(wheels: Mapping[str, WheelPath]) -> CarPath | None:
    """Return the path of a car; None where no wheel has a turn rate."""
    paths = {position: wheel.whole() for position, wheel in wheels.items()}
    paths = {position: path for position, path in paths.items() if len(path) > 1}
    if not paths:
        return None
    first_ns = min(path[0].end_ns for path in paths.values())
    paths = {name: path for name, path in paths.items() if (path[0].end_ns - first_ns) * _NS < _SAME_BEGIN_S}
    # The wheel that is known for the longest time gives the times; those that end before are left out.
    reference_wheel = max(paths, key=lambda name: paths[name][-1].end_ns)
    end_ns = paths[reference_wheel][-1].end_ns
    paths = {name: path for name, path in paths.items() if (end_ns - path[-1].end_ns) * _NS < _SAME_BEGIN_S}
    times = np.array([leg.end_ns - first_ns for leg in paths[reference_wheel]], np.float64)
    positions, errors = [], []
    for path in paths.values():
        leg_times = np.array([leg.end_ns - first_ns for leg in path], np.float64)
        rows = np.array([[*leg.pose[:2], *leg.error()[:2, :2].ravel(), leg.error()[2, 2]] for leg in path])
        # A direction that is off by d moves what follows also by -d^2/2 of itself.
        bent = np.cumsum(rows[:, 6:] * np.diff(rows[:, :2], axis=0, prepend=0.0), axis=0)
        rows[:, 2:6] += _SECOND_ORDER * (bent[:, :, np.newaxis] * bent[:, np.newaxis]).reshape(-1, 4)
        columns = np.stack([np.interp(times, leg_times, column) for column in rows.T], axis=1)
        positions.append(columns[:, :2] - columns[0, :2])
        errors.append(columns[:, 2:6].reshape(-1, 2, 2))
    weights = 1.0 / np.array([max(float(np.trace(error[-1])), 1e-6) for error in errors])
    weights /= weights.sum()
    position = np.tensordot(weights, np.array(positions), axes=1)
    covariance = np.tensordot(weights, np.array(errors), axes=1)
    received, apart_m = _received(position, covariance, paths[reference_wheel])
    return CarPath(
        tuple(paths),
        position,
        covariance,
        float(np.hypot(*np.diff(position, axis=0).T).sum()),
        received,
        apart_m,
        any(len(path) <= len(wheels[name].legs) for name, path in paths.items()),
    )


def _received(position_m: FloatArray, covariance_m2: FloatArray, path: Sequence[Leg]) -> tuple[FloatArray, float]:
    """Return positions of a receiver, (k, 2) m, turned and moved to fit a path, and how far they are from it.

    They count by the error of the path there, so that they leave it as the ellipses grow.
    """
    fixes = np.radians(np.array([leg.fix_deg for leg in path]))
    is_measured = np.isfinite(fixes).all(axis=1)
    if np.count_nonzero(is_measured) < _FEWEST_FIXES:
        return np.empty((0, 2)), math.nan
    north, east = (fixes[is_measured] - fixes[is_measured][0]).T
    # A longitude beyond 180 degrees goes on from -180.
    east = (east + math.pi) % (2.0 * math.pi) - math.pi
    fixed = _EARTH_RADIUS_M * (east * math.cos(fixes[is_measured][0, 0]) + 1j * north)
    estimated = position_m[is_measured] @ np.array([1.0, 1j])
    weights = 1.0 / (2.0 * _FIX_STD_M**2 + np.trace(covariance_m2[is_measured], axis1=1, axis2=2))
    middle_fixed, middle = np.average(fixed, weights=weights), np.average(estimated, weights=weights)
    rotation = np.vdot(fixed - middle_fixed, weights * (estimated - middle))
    aligned = (fixed - middle_fixed) * (rotation / abs(rotation) if rotation else 1.0) + middle
    apart_m = float(np.sqrt(np.mean(np.abs(aligned - estimated) ** 2)))
    return np.stack([aligned.real, aligned.imag], axis=1), apart_m
