"""Shape of the lateral signal: coefficients of a revolution, their average, and slopes with their errors."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Final, Generic, NamedTuple, TypeVar

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.estimates.estimator import Estimate, Revolution, TireConditions, not_used
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import BlockEstimator, RevolutionArrays, RevolutionBlock, measured_shares
from gateway.core.reasons import Reason
from gateway.core.revolutions.angle_resampling import angle_grid, elapsed_angles
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.revolutions.sensor_mounting import RollCalibration
from gateway.core.revolutions.synchronous_average import running_shares
from gateway.core.types import FloatArray
from gateway.forces.lateral_deformation import (
    ORDERS,
    chord_row,
    lateral_coefficients,
    line_row,
    remove_roll,
    slope_row,
    streamline_slope,
)
from gateway.forces.reasons import ForceCode
from gateway.forces.turn_tracker import NO_TURN, Turn, TurnTracker

# Rows of `Revolution.axes_mps2`.
CIRCUMFERENTIAL, LATERAL, RADIAL = range(3)

# Reach ahead of the leading edge in which the belt turns: several times its bending length.
_AHEAD_RAD: Final = 0.8
# Shorter contacts span too few grid points for a slope.
_MIN_CONTACT_RAD: Final = 0.08

_SIZE: Final = 2 * len(ORDERS)
# Names of what estimators of a block share.
_COEFFICIENTS_KEY, _TURNS_KEY = "lateral coefficients", "turns"
FIRST_ORDER: Final = [0, len(ORDERS)]
"""Places of cosine and sine of the first order in a record."""
# The grid starts at -pi, so odd orders change sign.
_SIGNS: Final[FloatArray] = np.where(np.asarray(ORDERS) % 2, -1.0, 1.0)
_GRID: Final = 512
_ANGLES: Final = angle_grid(_GRID)
_ANGLES.setflags(write=False)


class LateralRecord(NamedTuple):
    """One revolution, or the average of many.

    Attributes:
        lateral_m: (2 k,) coefficients of the lateral axis over Omega^2, roll tilt removed.
        radial_m: (2 k,) of the radial axis: the change of `lateral_m` per rad of further roll tilt.
        along_m: (2 k,) of the circumferential axis: the change of `lateral_m` per rad of yaw.
        covariance: (2 k, 2 k) of `lateral_m`.
        order_max: highest order that the sampling carried.
    """

    lateral_m: FloatArray
    radial_m: FloatArray
    along_m: FloatArray
    covariance: FloatArray
    order_max: int


class Slopes(NamedTuple):
    """Slope of the streamline in the contact, in three definitions, and ahead of it, with their rows.

    Attributes:
        values_rad: (3,) peak, first_half, adhesion_line.
        rows: (3, 2 k) linear maps from the coefficients of a record to the slopes.
        stretch_rad: first and last angle of the adhesion line.
        parity_rad: (2,) slope of the least-squares line through the whole contact, which an even displacement does not
            change; half the difference of the mean slopes in its second and first half, which an odd displacement that
            is straight in the contact does not change.
        parity_rows: (2, 2 k) likewise.
        ahead_row: (2 k,) minus the steepest slope of the opposite sign ahead of the contact.
    """

    values_rad: FloatArray
    rows: FloatArray
    stretch_rad: tuple[float, float]
    parity_rad: FloatArray
    parity_rows: FloatArray
    ahead_row: FloatArray


DEFINITIONS: Final = ("peak", "first_half", "adhesion_line")


class LateralSteps(NamedTuple):
    """Lateral records of k revolutions and their average after each.

    Attributes:
        own_m: (k, 2 k) coefficients of each revolution, corrected with the roll tilt known then.
        own_radial_m: (k, 2 k) of the radial axis: the change of `own_m` per rad of further roll tilt, but for the sign.
        mean_m: (k, 2 k) of the average, corrected with the latest roll tilt.
        roll: calibration after each.
        effective_counts: number of revolutions of equal weight that would have the same variance, after each.
        order_max: highest order that the sampling has carried so far, after each.
        records: the average with its covariance, by place; computed on demand.
        turns: of each revolution; what they make is removed from all coefficients.
        turn_std_m: error of the first order of the average, cosine and sine, that turns leave, after each.
    """

    own_m: FloatArray
    own_radial_m: FloatArray
    mean_m: FloatArray
    roll: Sequence[Roll]
    effective_counts: list[float]
    order_max: list[int]
    records: list[Callable[[], LateralRecord]]
    turns: Sequence[Turn]
    turn_std_m: list[tuple[float, float]]


@dataclass(frozen=True, slots=True)
class Roll:
    """Roll tilt, the constant in the mean of the lateral axis, and the number of revolutions that they rest on."""

    rad: float
    std_rad: float
    count: int
    offset_mps2: float = 0.0
    offset_std_mps2: float = math.inf


class _Part:
    """Average over revolutions that carry the same orders, after each of them.

    The mean and the spread are those of weighted sums, so they need no loop; deviations are taken from the mean before.
    """

    def __init__(
        self,
        mean: FloatArray,
        spread: FloatArray,
        values: FloatArray,
        weights: Sequence[float],
        measured: Sequence[float] | None,
    ) -> None:
        self._spread, self._shares = spread, running_shares(tuple(weights))
        self._change = values - mean
        self.means: FloatArray = mean + self._shares.values @ self._change
        self._scatter: tuple[FloatArray, FloatArray] | None = None
        if measured is not None:
            # What is filled of a revolution does not scatter: the rest stands for it too.
            previous_means = np.concatenate([mean[np.newaxis], self.means[:-1]])
            self._scatter = (values - previous_means)[:, :_SIZE], (1.0 - np.array(weights)) / np.array(measured)

    def spread(self, row: int) -> FloatArray:
        """Return the spread of the lateral coefficients after a revolution, (2 k, 2 k)."""
        shares = self._shares.values[row]
        if self._scatter is not None:
            change, factors = self._scatter
            result: FloatArray = (change.T * (shares * factors)) @ change
        else:
            change = self._change[:, :_SIZE]
            mean = shares @ change
            result = (change.T * shares) @ change
            result -= np.multiply.outer(mean, mean)
        prior = float(self._shares.prior[row])
        if prior:
            result += prior * self._spread
        return result


class LateralAverage:
    """Running average of lateral records, with calibration of the roll tilt."""

    def __init__(self, horizon_revolutions: float, roll: RollCalibration) -> None:
        """Start empty; `roll` is updated by every revolution, less the lateral acceleration of its turn."""
        self._floor = 1.0 / horizon_revolutions
        self.roll = roll
        self._tracker = TurnTracker()
        self.reset()

    def reset(self) -> None:
        """Forget everything, the calibration too."""
        self.roll.reset()
        # Lateral, radial, circumferential coefficients, and the tilt that each revolution was corrected with.
        self._mean: FloatArray = np.zeros(3 * _SIZE + 1)
        self._spread: FloatArray = np.zeros((_SIZE, _SIZE))
        self.count = 0
        self._weight_square = 1.0
        self._noise = 0.0
        self._order_max = 0
        self._tracker.reset()
        # Mean error of the first order by turns, cosine and sine.
        self._turn_std_m = (0.0, 0.0)

    @property
    def effective_count(self) -> float:
        """Number of revolutions of equal weight that would have the same variance."""
        return 1.0 / self._weight_square if self.count else 0.0

    def update(self, block: RevolutionBlock, taken: Sequence[int]) -> LateralSteps:
        """Add the revolutions `taken` of a block, at least one; none of them may be `why_unusable`."""
        revolutions = [block.revolutions[index] for index in taken]
        raw_m, turns = _shared_coefficients(block, taken), turns_of(block, taken, self._tracker)
        rolls = []
        for index, revolution, turn in zip(taken, revolutions, turns, strict=True):
            if not revolution.ac_coupled:
                _, lateral, radial = block.arrays.means_mps2[index].tolist()
                path, std = turn.path_mps2
                self.roll.update(lateral - path, radial, std)
            rolls.append(
                Roll(
                    self.roll.roll_rad,
                    self.roll.roll_std_rad,
                    self.roll.count,
                    self.roll.offset_mps2,
                    self.roll.offset_std_mps2,
                )
            )
        tilts = np.array([roll.rad for roll in rolls])
        values = np.concatenate([_unrolled(raw_m, tilts), tilts[:, np.newaxis]], axis=1)
        values[:, FIRST_ORDER] -= [turn.remove_m for turn in turns]
        max_orders = [min(revolution.order_max, ORDERS.stop - 1) for revolution in revolutions]
        own_m, own_radial_m = values[:, :_SIZE], values[:, _SIZE : 2 * _SIZE]
        steps = LateralSteps(own_m, own_radial_m, np.empty((len(taken), _SIZE)), rolls, [], [], [], turns, [])
        first = 0
        for end in range(1, len(taken) + 1):
            if end == len(taken) or max_orders[end] != max_orders[first]:
                self._add(values, revolutions, slice(first, end), max_orders[first], steps)
                first = end
        return steps

    def _add(
        self, values: FloatArray, revolutions: Sequence[Revolution], rows: slice, max_order: int, steps: LateralSteps
    ) -> None:
        """Add revolutions that carry orders up to `max_order`."""
        part_values = values[rows]
        if max_order < ORDERS.stop - 1:
            # Orders that the sampling does not carry at this speed keep their average.
            absent = np.append(np.tile(np.asarray(ORDERS) > max_order, 6), False)
            part_values = np.where(absent, self._mean, part_values)
        self._order_max = max(self._order_max, max_order)
        scalars = []
        measured = measured_shares(revolutions[rows])
        for revolution, share in zip(revolutions[rows], measured or (1.0,) * len(part_values), strict=True):
            self.count += 1
            weight = max(1.0 / self.count, self._floor)
            self._weight_square = (1.0 - weight) ** 2 * self._weight_square + weight * weight / share
            self._noise += weight * (_noise_variance(revolution) - self._noise)
            scalars.append((self.count, weight, self._weight_square, self._noise))
            previous, latest = self._turn_std_m, steps.turns[len(steps.turn_std_m)].remove_std_m
            self._turn_std_m = (
                previous[0] + weight * (latest[0] - previous[0]),
                previous[1] + weight * (latest[1] - previous[1]),
            )
            steps.turn_std_m.append(self._turn_std_m)
        part = _Part(self._mean, self._spread, part_values, [weight for _, weight, *_ in scalars], measured)
        roll_lag = np.array([roll.rad for roll in steps.roll[rows]]) - part.means[:, -1]
        steps.mean_m[rows] = part.means[:, :_SIZE] - roll_lag[:, np.newaxis] * part.means[:, _SIZE : 2 * _SIZE]
        for row, state in enumerate(scalars):
            steps.order_max.append(self._order_max)
            steps.effective_counts.append(1.0 / state[2])
            steps.records.append(partial(_record, part, row, steps.mean_m[rows][row], state, self._order_max))
        last = len(scalars) - 1
        self._mean, self._spread = part.means[last], part.spread(last)


def _record(
    part: _Part, row: int, lateral_m: FloatArray, scalars: tuple[int, float, float, float], order_max: int
) -> LateralRecord:
    """Return an average; its covariance is that of the mean, without that of the tilt."""
    count, _, weight_square, noise = scalars
    if count >= 3:
        covariance = part.spread(row) * (weight_square / (1.0 - weight_square))
    else:
        # The noise above the tire's orders is a better estimate than the scatter of two revolutions.
        covariance = np.eye(_SIZE) * (noise * weight_square)
    means = part.means[row]
    return LateralRecord(lateral_m, means[_SIZE : 2 * _SIZE], means[2 * _SIZE : -1], covariance, order_max)


def turns_of(block: RevolutionBlock, taken: Sequence[int], tracker: TurnTracker) -> Sequence[Turn]:
    """Return the turns of the revolutions `taken` of a block, the same ones to all of its estimators."""
    turns: list[Turn] | None = block.shared.get(_TURNS_KEY)
    if turns is None:
        raw_m = _shared_coefficients(block, taken)
        turns = [_tracked_turn(block, index, raw_m[row], tracker) for row, index in enumerate(taken)]
        block.shared[_TURNS_KEY] = turns
    return turns


def _tracked_turn(block: RevolutionBlock, index: int, raw_m: FloatArray, tracker: TurnTracker) -> Turn:
    """Return the turn of a revolution by its raw coefficients."""
    revolution, conditions = block.revolutions[index], block.conditions[index]
    edges = contact_edges(block.averages.edges_rad[index], conditions)
    if isinstance(edges, Reason):
        return NO_TURN
    _, lateral, radial = block.arrays.means_mps2[index].tolist()
    means = None if revolution.ac_coupled else (lateral, radial)
    return tracker.take(
        raw_m[:_SIZE], raw_m[_SIZE : 2 * _SIZE], edges, revolution.omega_radps, conditions.radius_m, means
    )


def _shared_coefficients(block: RevolutionBlock, selected: Sequence[int]) -> FloatArray:
    """Return the raw coefficients of a block, which all of its estimators share."""
    raw_m: FloatArray | None = block.shared.get(_COEFFICIENTS_KEY)
    if raw_m is None:
        raw_m = _coefficients(block.arrays, selected, [block.revolutions[index] for index in selected])
        raw_m.setflags(write=False)
        block.shared[_COEFFICIENTS_KEY] = raw_m
    return raw_m


def lateral_record(revolution: Revolution, roll_rad: float) -> LateralRecord:
    """Return one revolution's coefficients, corrected for its angular acceleration.

    The revolution must have a lateral axis (`has_lateral`). Raises nothing.
    """
    raw_m = _coefficients(RevolutionArrays([revolution]), [0], [revolution])
    flat = _unrolled(raw_m, np.array([roll_rad]))[0]
    lateral, radial, circumferential = flat.reshape(3, _SIZE)
    order_max = min(revolution.order_max, ORDERS.stop - 1)
    return LateralRecord(lateral, radial, circumferential, _noise_variance(revolution) * np.eye(_SIZE), order_max)


def _coefficients(arrays: RevolutionArrays, selected: Sequence[int], revolutions: Sequence[Revolution]) -> FloatArray:
    """Return raw coefficients, (m, 8 k) m: lateral, what a roll adds, radial and circumferential axis.

    The last two are for errors and small corrections only, for which the change of speed within a revolution does not
    matter.
    """
    indices = np.array(selected)
    is_whole_block = len(selected) == len(arrays.axes_mps2)
    axes = arrays.axes_mps2 if is_whole_block else arrays.axes_mps2[indices]
    in_plane = arrays.in_plane_mps2 if is_whole_block else arrays.in_plane_mps2[indices]
    lateral_radial = axes[:, [LATERAL, RADIAL]]
    # Offset and camber do not grow with the speed, so they are removed before the acceleration is corrected.
    lateral_radial -= lateral_radial.mean(axis=2, keepdims=True)
    lateral_radial *= acceleration_gains(revolutions, axes.shape[2])[:, np.newaxis]
    others = in_plane[:, ::-1, ORDERS.start : ORDERS.stop] * _SIGNS
    others[np.isnan(others)] = 0.0
    result = np.empty((len(selected), 8, len(ORDERS)))
    result[:, :4] = lateral_coefficients(lateral_radial).reshape(-1, 4, len(ORDERS))
    result[:, 4::2] = others.real
    result[:, 5::2] = -others.imag
    result /= np.square([revolution.omega_radps for revolution in revolutions])[:, np.newaxis, np.newaxis]
    max_orders = np.array([revolution.order_max for revolution in revolutions])
    if max_orders.min() < ORDERS.stop - 1:
        result *= np.asarray(ORDERS) <= max_orders[:, np.newaxis, np.newaxis]
    return result.reshape(len(selected), -1)


def _unrolled(raw_m: FloatArray, tilts_rad: FloatArray) -> FloatArray:
    """Return coefficients of the lateral axis, roll removed, and of the other axes, (m, 6 k), from the raw ones."""
    lateral_m, radial_m = raw_m[:, :_SIZE], raw_m[:, _SIZE : 2 * _SIZE]
    corrected = remove_roll(lateral_m, radial_m, tilts_rad[:, np.newaxis])
    return np.concatenate([corrected, raw_m[:, 2 * _SIZE :]], axis=1)


def _noise_variance(revolution: Revolution) -> float:
    """Return the variance of a coefficient by noise.

    The noise of the radial axis of the same sensor stands for that of the lateral axis until the scatter is known.
    """
    noise = revolution.noise_mps2 / revolution.omega_radps**2
    return 2.0 / revolution.axes_mps2.shape[1] * noise * noise if math.isfinite(noise) else 0.0


def has_lateral(revolution: Revolution) -> bool:
    """Return whether the sensor has a lateral axis."""
    lateral = revolution.axes_mps2[LATERAL]
    return not (math.isnan(lateral[0]) and bool(np.isnan(lateral).all()))


def why_unusable(block: RevolutionBlock, index: int) -> Reason | None:
    """Return why a revolution must not be averaged; None when it may be."""
    revolution = block.revolutions[index]
    if revolution.faults:
        return not_used(revolution.faults)
    for axis in (LATERAL, RADIAL):
        # The mean is finite only if all samples are.
        if not math.isfinite(block.arrays.means_mps2[index, axis]):
            return not_used((Reason(RevolutionCode.AXIS_NOT_FINITE, axis=AXIS_NAMES[axis]),))
    if not (revolution.omega_radps > 0.0 and revolution.order_max >= 1):
        return not_used((Reason(ForceCode.SPEED_UNUSABLE),))
    return None


def lateral_rows(block: RevolutionBlock) -> tuple[list[bool], list[Reason | None], list[int]]:
    """Return which revolutions have a lateral axis, why they must not be averaged, and indices of those that may."""
    lateral = [has_lateral(revolution) for revolution in block.revolutions]
    unusable = [why_unusable(block, index) if has_axis else None for index, has_axis in enumerate(lateral)]
    return lateral, unusable, [index for index, has_axis in enumerate(lateral) if has_axis and unusable[index] is None]


def contact_edges(edges_rad: tuple[float, float], conditions: TireConditions) -> tuple[float, float] | Reason:
    """Return the contact edges that slopes are taken between, or why there are none."""
    leading, trailing = edges_rad
    if not (-math.pi < leading < trailing < math.pi and trailing - leading > _MIN_CONTACT_RAD):
        return Reason(EstimateCode.NO_CONTACT_EDGES)
    return (leading, trailing) if conditions.radius_m > 0.0 else Reason(EstimateCode.SPEED_OR_RADIUS_UNKNOWN)


def slopes(record: LateralRecord, edges_rad: tuple[float, float], radius_m: float) -> Slopes:
    """Return the slopes between two contact edges.

    peak: the steepest slope with the sign of the least-squares line through the whole contact. first_half: mean slope
    from the leading edge to the middle of the contact. adhesion_line: least-squares line through the lateral
    displacement over the range around the peak in which the slope keeps its sign, like a ruler laid on the rising part
    of the plotted deformation. Ahead of the contact the free belt leans the other way: there the steepest slope is that
    of the side force on a belt under tension, which the slopes inside the contact hardly contain.
    """
    leading, trailing = edges_rad
    angles = _ANGLES
    parity_rows = _parity_rows(leading, trailing, radius_m)
    sign = np.sign(parity_rows[0] @ record.lateral_m) or 1.0
    slope = sign * streamline_slope(record.lateral_m, radius_m, _GRID)
    start, end = np.searchsorted(angles, edges_rad)
    steep = int(start + slope[start:end].argmax())
    before = np.flatnonzero(slope[start:steep] <= 0.0)
    after = np.flatnonzero(slope[steep:end] <= 0.0)
    first = leading if not len(before) else _zero(angles, slope, int(start + before[-1]))
    last = trailing if not len(after) else _zero(angles, slope, int(steep + after[0] - 1))
    peak = min(max(_vertex(angles, slope, steep), leading), trailing)
    rows = np.stack(
        [
            slope_row(peak, radius_m),
            chord_row(leading, 0.5 * (leading + trailing), radius_m),
            line_row(first, last, radius_m),
        ]
    )
    before_edge = int(np.searchsorted(angles, max(leading - _AHEAD_RAD, -math.pi)))
    lean = before_edge + int(slope[before_edge : start + 1].argmin())
    lean_rad = min(_vertex(angles, -slope, lean), leading)
    ahead_row = -slope_row(lean_rad, radius_m)
    return Slopes(rows @ record.lateral_m, rows, (first, last), parity_rows @ record.lateral_m, parity_rows, ahead_row)


def _parity_rows(leading_rad: float, trailing_rad: float, radius_m: float) -> FloatArray:
    middle = 0.5 * (leading_rad + trailing_rad)
    first = chord_row(leading_rad, middle, radius_m)
    second = chord_row(middle, trailing_rad, radius_m)
    return np.stack([line_row(leading_rad, trailing_rad, radius_m), 0.5 * (second - first)])


def edge_errors(
    record: LateralRecord,
    measured: Slopes,
    edges_rad: tuple[float, float],
    edges_std_rad: tuple[float, float],
    radius_m: float,
) -> FloatArray:
    """Return the errors of the three slopes and the two of `parity_rad` from those of the contact edges, (5,) rad.

    The peak does not depend on the edges. The adhesion line depends on them only where it ends at one; where it ends at
    a zero of the slope, noise moves its end.
    """
    total = np.zeros(len(DEFINITIONS) + len(measured.parity_rad))
    for edge, std in enumerate(edges_std_rad):
        at_edge = measured.stretch_rad[edge] == edges_rad[edge]
        end_std = std if at_edge else _zero_std(record, measured.stretch_rad[edge], radius_m)
        if math.isfinite(end_std) and end_std > 0.0:
            ends = [end + end_std * (side == edge) for side, end in enumerate(measured.stretch_rad)]
            total[2] += (line_row(ends[0], ends[1], radius_m) @ record.lateral_m - measured.values_rad[2]) ** 2
        if not (math.isfinite(std) and std > 0.0):
            continue
        leading, trailing = edges_rad[0] + std * (edge == 0), edges_rad[1] + std * (edge == 1)
        chord = chord_row(leading, 0.5 * (leading + trailing), radius_m) @ record.lateral_m
        total[1] += (chord - measured.values_rad[1]) ** 2
        parity = _parity_rows(leading, trailing, radius_m) @ record.lateral_m
        total[len(DEFINITIONS) :] += np.square(parity - measured.parity_rad)
    return np.sqrt(total)


def _zero_std(record: LateralRecord, zero_rad: float, radius_m: float) -> float:
    """Return the error by noise of the angle at which the slope of the streamline is zero; infinite without one."""
    row = slope_row(zero_rad, radius_m)
    step = _ANGLES[1] - _ANGLES[0]
    bend = (slope_row(zero_rad + step, radius_m) - row) @ record.lateral_m / step
    noise = math.sqrt(max(float(row @ record.covariance @ row), 0.0))
    return noise / abs(float(bend)) if bend else math.inf


def acceleration_gains(revolutions: Sequence[Revolution], n: int) -> FloatArray:
    """Return (mean speed / speed)^2 on the angle grid, (k, n); 1 where the acceleration is not known."""
    rows = []
    for revolution in revolutions:
        period, acceleration = revolution.period_s, revolution.omega_dot_radps2
        s_per_rad = period / (2.0 * math.pi)
        rate = 1.0 / s_per_rad - 0.5 * acceleration * period
        if math.isfinite(acceleration) and rate > 0.0 and rate + acceleration * period > 0.0:
            rows.append(((rate * s_per_rad) ** 2, 2.0 * acceleration * s_per_rad**2))
        else:
            rows.append((1.0, 0.0))
    # The square of the speed over the mean speed is linear in the angle.
    offset, slope = np.array(rows).T[:, :, np.newaxis]
    square: FloatArray = slope * elapsed_angles(n)
    square += offset
    return np.divide(1.0, square, out=square)


def _vertex(angles: FloatArray, height: FloatArray, top: int) -> float:
    """Return the vertex angle of the parabola through a maximum and its two neighbours."""
    before, middle, after = height[top - 1], height[top], height[(top + 1) % len(height)]
    bend = before - 2.0 * middle + after
    shift = 0.5 * (before - after) / bend if bend < 0.0 else 0.0
    return float(angles[top] + np.clip(shift, -1.0, 1.0) * (angles[1] - angles[0]))


def _zero(angles: FloatArray, slope: FloatArray, index: int) -> float:
    """Return the angle at which the slope crosses zero between a grid point and the next."""
    share = slope[index] / (slope[index] - slope[index + 1])
    return float(angles[index] + share * (angles[index + 1] - angles[index]))


_Steps = TypeVar("_Steps")


class LateralAxisEstimator(BlockEstimator, Generic[_Steps]):
    """Estimator of the lateral axis; no estimates without the axis."""

    def update_block(self, block: RevolutionBlock) -> list[tuple[Estimate, ...]]:
        """Take revolutions and return the estimates after each."""
        lateral, unusable, selected = lateral_rows(block)
        steps = self._taken(block, selected) if selected else None
        results: list[tuple[Estimate, ...]] = []
        for index, has_axis in enumerate(lateral):
            conditions = block.conditions[index]
            edges = unusable[index] or contact_edges(block.averages.edges_rad[index], conditions)
            if not has_axis:
                results.append(())
            elif isinstance(edges, Reason):
                results.append(self._unused(conditions, edges))
            elif steps is not None:
                results.append(self._estimates(conditions, edges, steps, selected.index(index)))
        return results

    @abstractmethod
    def _taken(self, block: RevolutionBlock, selected: Sequence[int]) -> _Steps:
        """Take the revolutions `selected` of a block, at least one."""

    @abstractmethod
    def _names(self, conditions: TireConditions) -> Sequence[str]:
        """Return the names of the estimates under these conditions."""

    def _unused(self, conditions: TireConditions, reason: Reason) -> tuple[Estimate, ...]:
        """Return the estimates of a revolution that is not taken."""
        return tuple(Estimate.invalid(name, reason) for name in self._names(conditions))

    @abstractmethod
    def _estimates(
        self, conditions: TireConditions, edges_rad: tuple[float, float], steps: _Steps, row: int
    ) -> tuple[Estimate, ...]:
        """Return the estimates of a revolution: the row of what was taken."""


class LateralEstimator(LateralAxisEstimator[LateralSteps]):
    """Estimator of the lateral axis and its running average."""

    def __init__(self, horizon_revolutions: float) -> None:
        self._average = LateralAverage(horizon_revolutions, RollCalibration())
        super().__init__()

    def reset(self) -> None:
        """Forget the average and the roll tilt."""
        self._average.reset()

    def _taken(self, block: RevolutionBlock, selected: Sequence[int]) -> LateralSteps:
        return self._average.update(block, selected)
