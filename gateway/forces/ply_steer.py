"""Estimator of the ply steer angle: the slope of the streamline in the contact, in four definitions, and of conicity.

Conicity displaces the belt evenly about the contact centre, so it adds nothing to the line through the whole contact.
This line alone decides the sign of the ply steer. The other definitions contain conicity. docs/explanation/ply-steer.md
has the meaning of the angles, their errors and their limits.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.disagreement import disagreement_std
from gateway.core.estimates.estimator import (
    SETTLED_REVOLUTIONS,
    Estimate,
    Revolution,
    Status,
    TireConditions,
    estimate_of,
    sign_not_determined,
)
from gateway.core.estimates.pace import LONGEST, SHARE_OF_STD, differ, is_due
from gateway.core.estimates.revolution_block import BlockEstimator, RevolutionBlock
from gateway.core.estimates.sensor_claims import SensorClaims
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.sensor_mounting import MOUNTING_STD_RAD, OFFSET_STD_MPS2, RollCalibration
from gateway.core.trust.reasons import TrustCode
from gateway.core.types import BoolArray, FloatArray
from gateway.forces.belt_laminate import BeltLaminate, coupling_law
from gateway.forces.lateral_deformation import ORDERS, slope_row
from gateway.forces.lateral_shape import (
    CIRCUMFERENTIAL,
    DEFINITIONS,
    LateralAverage,
    LateralRecord,
    Roll,
    contact_edges,
    edge_errors,
    lateral_rows,
    slopes,
)
from gateway.forces.reasons import ForceCode
from gateway.ring.reasons import RingCode

NAMES: Final = tuple(f"ply_steer_{definition}_rad" for definition in DEFINITIONS)
LINE_NAME: Final = "ply_steer_contact_line_rad"
AHEAD_NAME: Final = "ply_steer_ahead_rad"
CONICITY_NAME: Final = "conicity_slope_rad"
ROLL_NAME: Final = "sensor_roll_rad"
OFFSET_NAME: Final = "lateral_offset_mps2"
# Estimates of the shape of the lateral signal, in the order of the first six maps, and the places of two of them. The
# map of conicity is that of the difference of the halves.
_OF_SHAPE: Final = (*NAMES, LINE_NAME, CONICITY_NAME, AHEAD_NAME)
_LINE: Final = _OF_SHAPE.index(LINE_NAME)
_CONICITY: Final = _OF_SHAPE.index(CONICITY_NAME)
# The first half is a fixed part of the contact, so that it has its own sign.
_SIGN_OF_LINE: Final = frozenset({*NAMES, AHEAD_NAME} - {"ply_steer_first_half_rad"})
LAMINATE_NAMES: Final = ("ply_steer_laminate_rad", "laminate_b16_n", "laminate_a66_npm")

# Memory of the average: ply steer changes only with load, pressure and temperature.
HORIZON_REVOLUTIONS: Final = 100.0
# Standard errors from zero beyond which a sign is reported.
_SIGNIFICANT: Final = 3.0
# Ply steer's share of the difference between second and first half of a rolling contact, over the contact line and the
# square of the half angle, and its standard deviation over belts and treads (docs/explanation/ply-steer.md).
_ROLLING_DIFFERENCE: Final = 2.9
_ROLLING_DIFFERENCE_STD: Final = 1.4
# Change of that share by rolling resistance, which moves the pressure forward: 0.09 +- 0.02 of the contact line per
# percent on 19 random tires, at half angles of 0.16 to 0.31. Tires have about one percent, which is not known here.
_RESISTANCE_DIFFERENCE_STD: Final = 0.09
PEAK_OVER_LAMINATE: Final = 0.91
"""Steepest slope of a rolling belt over that of a belt bent flat, 2 phi_z, on the belts of tools/bench_lateral.py."""
PEAK_OVER_LAMINATE_STD: Final = 0.06
# A16 / A66 from which tension shears the belt noticeably: a tension strain of 0.1 % then turns it by 0.01 deg.
_UNBALANCED: Final = 0.2
# Change of each estimate of the shape by a slip angle over what that slip adds to the conicity's slope, sign apart: the
# contact line 0.67 +- 0.06 on 14 random tires up to 2 deg, the first half 1.5, adhesion line and peak by shape.
_BY_SLIP: Final[FloatArray] = np.array([1.2, 1.5, 0.75, 0.67, 0.0, 1.2])
# Share of the expected error of the lateral constant below which it counts as measured.
_OFFSET_MEASURED: Final = 0.5
# Least number of orders that the errors have been checked for. With 10 the contact line is up to a fifth short, with 8
# up to a third.
ENOUGH_ORDERS: Final = 10
# Relative error of the steepest slope at the highest order of the first number; it falls with the third power of the
# order. On 16 random tires it is 7.8 % at order 12, 6.2 % at 14, 4.9 % at 16, 3.5 % at 18. Lines smooth it away.
_PEAK_TRUNCATION: Final = (18.0, 0.035)
# Product of the highest order and the half angle at which slopes are wholly unknown, and its change for a factor of e
# in the error: slopes of 20 random tires are 14 % short at 2.0, 6 to 11 % at 2.35, 2 to 3 % at 2.6, 1 % at 3.
_TRUNCATION: Final = (1.46, 0.35)
# Standard errors by which a slope may follow the average until its place in the contact is renewed.
_RENEWAL_STDS: Final = 0.5
# Relative change of the belt radius that does not matter to a slope.
_NEGLIGIBLE_RADIUS: Final = 1e-3
# Relative change of the speed that does not matter to the errors. Only that of the mounting depends on it, by gravity,
# where there is no circumferential axis.
_SPEED_CHANGE: Final = 0.5
# Relative changes of highest order, radius, gain error and speed from which the maps are renewed.
_STATE_SHARES: Final[FloatArray] = np.array([0.0, _NEGLIGIBLE_RADIUS, SHARE_OF_STD, _SPEED_CHANGE])
_NOT_SEPARATED: Final = Reason(ForceCode.CONICITY_NOT_SEPARATED)
_FROM_MEANS: Final = (Reason(ForceCode.FROM_AXIS_MEANS),)


class PlySteerEstimator(BlockEstimator):
    """Ply steer angle of the running average; no estimates when the sensor has no lateral axis.

    Estimates: the estimates of NAMES, contact line, conicity, roll and the slope ahead of the contact.

    Those of NAMES and the slope ahead include conicity, and a reason says so. Peak, adhesion line and slope ahead take
    their sign from the contact line; they are invalid where its sign is not significant. conicity_slope_rad is half the
    change of the slope from the first to the second half of the contact, less what ply steer contributes to it in a
    rolling contact; as a slip angle bends the contact alike, it is provisional. The standard errors cover scatter, roll
    calibration, the yaw of the mounting, the contact edges and a slip that looks like the conicity, but not the
    definition of the slope, in which the angles differ.

    Where the plies are stated (a `BeltLaminate` of the tire), LAMINATE_NAMES follow, with errors from the stated
    tolerances. The angle is provisional where the measured peak differs from it by more than three errors.

    The slopes are linear in the average, which they follow in every revolution. Their places in the contact and
    their standard errors are renewed at the pace of `gateway.core.estimates.pace`.
    """

    name = "ply-steer"

    def __init__(self) -> None:
        self._average = LateralAverage(HORIZON_REVOLUTIONS, RollCalibration(OFFSET_STD_MPS2))
        super().__init__()

    def reset(self) -> None:
        """Forget the average and the roll calibration."""
        self._average.reset()
        self._followed: _Followed | None = None
        self._renewed: _Renewed | None = None

    def update_block(self, block: RevolutionBlock) -> list[tuple[Estimate, ...]]:
        """Take revolutions and return the estimates after each."""
        lateral, unusable, selected = lateral_rows(block)
        count = self._average.count
        if selected:
            expected = block.conditions[selected[0]].claims.lateral_zero_mps2
            self._average.roll.expect_offset(max(OFFSET_STD_MPS2, expected))
        steps = self._average.update(block, selected) if selected else None
        results: list[tuple[Estimate, ...]] = [()] * len(block)
        measured: list[_Measured] = []
        for index, has_axis in enumerate(lateral):
            if not has_axis:
                continue
            if steps is not None and unusable[index] is None:
                row = selected.index(index)
                count += 1
                self._followed = _Followed(
                    count,
                    steps.effective_counts[row],
                    steps.mean_m[row],
                    steps.roll[row],
                    steps.order_max[row],
                    steps.records[row],
                    steps.turn_std_m[row],
                )
            edges = contact_edges(block.averages.edges_rad[index], block.conditions[index])
            if isinstance(edges, Reason):
                results[index] = _all_invalid(unusable[index] or edges)
            elif self._followed is None:
                results[index] = _all_invalid(unusable[index] or Reason(TrustCode.NO_REVOLUTION_YET))
            else:
                measured.append(_Measured(index, self._followed, edges, unusable[index]))
        if measured:
            for measurement, estimates in zip(measured, self._measured(block, measured), strict=True):
                results[measurement.index] = estimates
        return [
            _definition_first(
                (*shape_estimates, *_laminate_estimates(laminate, condition, shape_estimates[0]))
                if shape_estimates and (laminate := condition.tire.of(BeltLaminate)) is not None
                else shape_estimates,
                condition.tire.ply_steer_definition,
            )
            for shape_estimates, condition in zip(results, block.conditions, strict=True)
        ]

    def _measured(self, block: RevolutionBlock, measured: Sequence[_Measured]) -> list[tuple[Estimate, ...]]:
        """Return the estimates of revolutions with contact edges, at least one."""
        lateral_m = np.stack([measurement.followed.lateral_m for measurement in measured])
        states = _states(block, measured)
        turn_std_m = np.array([measurement.followed.turn_std_m for measurement in measured])
        roll_std_rad = np.array(
            [_roll_error(measurement.followed.roll, block.conditions[measurement.index]) for measurement in measured]
        )
        values_rad, stds_rad = np.empty((2, len(measured), len(_OF_SHAPE)))
        notes: list[tuple[tuple[Reason, ...], ...]] = []
        scatters_rad: list[list[float]] = []
        while (first := len(notes)) < len(measured):
            counts = [measurement.followed.count for measurement in measured[first:]]
            values = self._followed_values(lateral_m[first:], states[first:], counts)
            if not len(values):
                self._renewed = _renew(measured[first], block, states[first])
                values = self._renewed.values_rad[np.newaxis]
            assert self._renewed is not None
            rows = slice(first, first + len(values))
            values_rad[rows] = values[:, : len(_OF_SHAPE)]
            stds_rad[rows] = self._renewed.stds_rad(roll_std_rad[rows], turn_std_m[rows])
            notes += [self._renewed.notes] * len(values)
            scatters_rad += [self._renewed.scatter_rad.tolist()] * len(values)
        square = np.square(0.5 * (states[:, 1] - states[:, 0]))
        values_rad[:, _CONICITY], stds_rad[:, _CONICITY] = _conicity(
            values_rad[:, _LINE], values_rad[:, _CONICITY], stds_rad[:, _LINE], stds_rad[:, _CONICITY], square
        )
        # A slip angle bends the contact as conicity does: what looks like that may be slip, which moves the rest.
        by_slip = [
            disagreement_std(value, std)
            for value, std in zip(values_rad[:, _CONICITY].tolist(), stds_rad[:, _CONICITY].tolist(), strict=True)
        ]
        stds_rad = np.hypot(stds_rad, np.multiply.outer(by_slip, _BY_SLIP))
        is_significant = np.abs(values_rad) > _SIGNIFICANT * stds_rad
        is_sound = is_significant & np.isfinite(values_rad) & np.isfinite(stds_rad)
        return [
            _estimates(measurement, block.conditions[measurement.index], shape_notes, *numbers)
            for measurement, shape_notes, *numbers in zip(
                measured,
                notes,
                values_rad.tolist(),
                stds_rad.tolist(),
                scatters_rad,
                is_sound.tolist(),
                is_significant[:, _LINE].tolist(),
                strict=True,
            )
        ]

    def _followed_values(self, lateral_m: FloatArray, states: FloatArray, counts: Sequence[int]) -> FloatArray:
        """Return the values of the maps, (m, 8), of the first of the given revolutions that need no renewal before."""
        renewed = self._renewed
        if renewed is None:
            return np.empty((0, 0))
        values = lateral_m @ renewed.rows.T
        outdated = renewed.are_outdated(values, states, counts)
        return values[: int(outdated.argmax())] if outdated.any() else values


@dataclass(frozen=True, slots=True)
class _Followed:
    """The average after the latest revolution.

    Attributes:
        count: revolutions averaged.
        effective_count: number of revolutions of equal weight that would have the same variance.
        lateral_m: (2 k,) coefficients, corrected with the latest roll tilt.
        roll: latest calibration.
        order_max: highest order that the sampling has carried.
        record: returns all of the average.
        turn_std_m: error of its first order, cosine and sine, by turns of the wheel.
    """

    count: int
    effective_count: float
    lateral_m: FloatArray
    roll: Roll
    order_max: int
    record: Callable[[], LateralRecord]
    turn_std_m: tuple[float, float]


@dataclass(frozen=True, slots=True)
class _Measured:
    """A revolution with a lateral axis and contact edges.

    Attributes:
        index: in its block.
        followed: the average after it.
        edges_rad: of the contact.
        unusable: why it was not averaged, None when it was.
    """

    index: int
    followed: _Followed
    edges_rad: tuple[float, float]
    unusable: Reason | None


def _states(block: RevolutionBlock, measured: Sequence[_Measured]) -> FloatArray:
    """Return what maps rest on besides the average: edges, orders, radius, gain and speed, (k, 6)."""
    indices = [measurement.index for measurement in measured]
    conditions = block.condition_arrays
    result = np.empty((len(measured), 6))
    result[:, :2] = [measurement.edges_rad for measurement in measured]
    result[:, 2] = [measurement.followed.order_max for measurement in measured]
    for column, values in enumerate((conditions.radius_m, conditions.gain_std, block.arrays.omega_radps), start=3):
        result[:, column] = values[indices]
    return result


@dataclass(frozen=True, slots=True)
class _Renewed:
    """Linear maps from the average to the slopes, and their errors, at the latest renewal.

    Attributes:
        rows: (8, 2 k) maps to the slopes of NAMES, the contact line, the difference of the halves, the slope ahead, and
            the slopes at both ends of the adhesion line.
        variance_rad2: (6,) of the first six, without that of the roll.
        scatter_rad: (6,) the part of their errors by the scatter of the averaged revolutions; 0 of conicity.
        by_roll: (6,) their derivatives by the roll.
        values_rad: what the maps gave then.
        limits_rad: how far the values may move until the maps are renewed: by a share of a standard error, and at an
            end of the adhesion line by the slope's, beyond which it ends elsewhere.
        notes: of each estimate of _OF_SHAPE.
        count: revolutions averaged then.
        state: (6,) what else the maps rest on, as in `_states`.
        allowed: (6,) by how much each of these may change.
    """

    rows: FloatArray
    variance_rad2: FloatArray
    scatter_rad: FloatArray
    by_roll: FloatArray
    values_rad: FloatArray
    limits_rad: FloatArray
    notes: tuple[tuple[Reason, ...], ...]
    count: int
    state: FloatArray
    allowed: FloatArray

    def stds_rad(self, roll_std_rad: FloatArray, turn_std_m: FloatArray) -> FloatArray:
        """Return the standard errors of the first six with k errors of the roll and (k, 2) of the first order."""
        by_turn = np.square(turn_std_m) @ np.square(self.rows[: len(_OF_SHAPE), [0, len(ORDERS)]]).T
        by_roll = np.square(np.multiply.outer(roll_std_rad, self.by_roll))
        result: FloatArray = np.sqrt(self.variance_rad2 + by_roll + by_turn)
        return result

    def are_outdated(self, values_rad: FloatArray, states: FloatArray, counts: Sequence[int]) -> BoolArray:
        """Return for each of k revolutions whether to renew, (k,), by the values of the maps, (k, 8), and what else."""
        has_changed = (np.abs(values_rad - self.values_rad) > self.limits_rad).any(axis=1)
        stale = [count != self.count and (is_due(count) or count - self.count > LONGEST) for count in counts]
        outdated: BoolArray = has_changed | differ(states, self.state, self.allowed) | stale
        return outdated


def _renew(measured: _Measured, block: RevolutionBlock, state: FloatArray) -> _Renewed:
    """Return the maps and standard errors of the present average."""
    index, followed, edges = measured.index, measured.followed, measured.edges_rad
    revolution, conditions = block.revolutions[index], block.conditions[index]
    record = followed.record()
    measured_slopes = slopes(record, edges, conditions.radius_m)
    rows = np.concatenate([measured_slopes.rows, measured_slopes.parity_rows, measured_slopes.ahead_row[np.newaxis]])
    ends = np.stack([slope_row(end, conditions.radius_m) for end in measured_slopes.stretch_rad])
    ends_std = np.sqrt(np.maximum(np.sum((ends @ record.covariance) * ends, axis=1), 0.0))
    variance = np.sum((rows @ record.covariance) * rows, axis=1)
    # Peak and slope ahead are the largest of several places: their noise counts once more.
    variance[[0, -1]] *= 2.0
    scatter = np.sqrt(np.maximum(variance, 0.0))
    scatter[_CONICITY] = 0.0
    variance += np.square(rows @ _circumferential(record, revolution, conditions) * conditions.tilt.yaw_std_rad)
    # The slopes scale with the lateral axis's gain over the radius.
    too_short = _truncation_std(record.order_max, edges)
    scale_std = math.hypot(conditions.lateral_gain_std, conditions.radius_std_m / conditions.radius_m, too_short)
    variance += np.square(rows @ record.lateral_m * scale_std)
    reference_order, error = _PEAK_TRUNCATION
    variance[[0, -1]] += np.square(
        rows[[0, -1]] @ record.lateral_m * (error * (reference_order / max(record.order_max, 1)) ** 3)
    )
    edges_std = block.averages.edges_std_rad(index)
    variance[:-1] += np.square(edge_errors(record, measured_slopes, edges, edges_std, conditions.radius_m))
    orders = Reason(ForceCode.ORDERS_USED, first=ORDERS.start, last=record.order_max)
    conical = Reason(ForceCode.INCLUDES_CONICITY), orders
    by_roll = rows @ record.radial_m
    stds = np.sqrt(variance + np.square(by_roll * _roll_error(followed.roll, conditions)))
    # Where the line ends at an edge of the contact, the slope there does not matter.
    ends_std[np.array(measured_slopes.stretch_rad) == np.array(edges)] = math.inf
    rows = np.concatenate([rows, ends])
    return _Renewed(
        rows,
        variance,
        scatter,
        by_roll,
        rows @ record.lateral_m,
        np.concatenate([_RENEWAL_STDS * stds, ends_std]),
        (*[conical] * len(NAMES), (orders,), (), conical),
        followed.count,
        state,
        np.concatenate([SHARE_OF_STD * np.array(edges_std), _STATE_SHARES * state[2:]]),
    )


def _truncation_std(order_max: int, edges_rad: tuple[float, float]) -> float:
    """Return the relative error of the slopes because the orders end before the contact's own."""
    resolved = order_max * 0.5 * (edges_rad[1] - edges_rad[0])
    return math.exp(min(_TRUNCATION[0] - resolved, 0.0) / _TRUNCATION[1])


def _doubt(followed: _Followed, claims: SensorClaims) -> Reason | None:
    """Return why the angle is provisional; None when it is not."""
    roll = followed.roll
    if followed.effective_count < SETTLED_REVOLUTIONS:
        return Reason(CoreCode.NOT_SETTLED, revolutions=followed.effective_count, needed=SETTLED_REVOLUTIONS)
    if followed.order_max < ENOUGH_ORDERS:
        return Reason(RingCode.TOO_FEW_ORDERS, orders=followed.order_max, needed=ENOUGH_ORDERS)
    if not roll.count:
        return Reason(ForceCode.ROLL_NOT_CALIBRATED, assumed_rad=MOUNTING_STD_RAD)
    if not _zero_is_measured(roll, claims):
        # At one speed a zero of the lateral axis looks like a roll, and a roll like conicity.
        return _unlikely_roll(roll, claims)
    return None


def _unlikely_roll(roll: Roll, claims: SensorClaims) -> Reason | None:
    """Return why a roll is not what the sensor was mounted with; None where it may be."""
    expected = claims.roll_rad or 0.0
    if not _differs_from_roll(roll, claims, expected):
        return None
    return Reason(
        ForceCode.ROLL_UNLIKELY, roll_rad=roll.rad, expected_rad=expected, expected_std_rad=claims.roll_std_rad
    )


def _differs_from_roll(roll: Roll, claims: SensorClaims, expected_rad: float) -> bool:
    """Return whether the measured roll differs significantly from an expected one."""
    return abs(roll.rad - expected_rad) > _SIGNIFICANT * math.hypot(roll.std_rad, claims.roll_std_rad)


def _roll_error(roll: Roll, conditions: TireConditions) -> float:
    """Return the error of the roll, with the chance that a zero of the lateral axis looks like a part of it."""
    claims = conditions.claims
    if not roll.count or _zero_is_measured(roll, claims):
        return roll.std_rad
    difference = roll.rad - (claims.roll_rad or 0.0)
    excess_std = disagreement_std(difference, math.hypot(roll.std_rad, claims.roll_std_rad))
    return math.hypot(roll.std_rad, max(excess_std, conditions.roll_std_rad))


def _zero_is_measured(roll: Roll, claims: SensorClaims) -> bool:
    """Return whether different speeds have separated the constant of the lateral mean from the roll."""
    return roll.offset_std_mps2 <= _OFFSET_MEASURED * max(claims.lateral_zero_mps2, OFFSET_STD_MPS2)


def _definition_first(estimates: tuple[Estimate, ...], definition: str) -> tuple[Estimate, ...]:
    """Return estimates with the ply steer angle of a definition first; as they are without one."""
    name = f"ply_steer_{definition}_rad"
    return tuple(sorted(estimates, key=lambda estimate: estimate.name != name)) if definition else estimates


def _estimates(
    measured: _Measured,
    conditions: TireConditions,
    notes: tuple[tuple[Reason, ...], ...],
    values_rad: list[float],
    stds_rad: list[float],
    scatters_rad: list[float],
    is_sound: list[bool],
    has_sign: bool,
) -> tuple[Estimate, ...]:
    """Return the estimates of one revolution.

    Args:
        measured: the average after it.
        conditions: of its tire.
        notes: of each estimate of _OF_SHAPE, as the next three.
        values_rad: values.
        stds_rad: standard errors.
        scatters_rad: their scattering parts.
        is_sound: whether value and error are finite, and the value is significant.
        has_sign: whether the sign of the contact line is significant.
    """
    roll, unusable, claims = measured.followed.roll, measured.unusable, conditions.claims
    doubt = unusable or _doubt(measured.followed, claims)
    estimates = [
        estimate_of((name, value, std, Status.VALID, estimate_notes, scatter))
        if sound and doubt is None and name != CONICITY_NAME
        else _doubted(name, value, std, estimate_notes, doubt)
        for name, value, std, scatter, estimate_notes, sound in zip(
            _OF_SHAPE, values_rad, stds_rad, scatters_rad, notes, is_sound, strict=True
        )
    ]
    if not has_sign:
        chance = sign_not_determined(values_rad[_LINE], stds_rad[_LINE])
        estimates = [
            Estimate.invalid(estimate.name, chance) if estimate.name in _SIGN_OF_LINE else estimate
            for estimate in estimates
        ]
    *of_contact, slope = estimates
    return (*of_contact, _roll_estimate(roll, conditions, unusable), slope, _offset_estimate(roll, claims, unusable))


def _doubted(name: str, value: float, std: float, notes: tuple[Reason, ...], doubt: Reason | None) -> Estimate:
    """Return an estimate that is not known, not significant, or in doubt for another reason."""
    if not (math.isfinite(value) and math.isfinite(std)):
        return Estimate.invalid(name, Reason(TrustCode.NOT_FINITE))
    if doubt is None and name == CONICITY_NAME:
        doubt = _NOT_SEPARATED
    elif doubt is None:
        doubt = Reason(CoreCode.NOT_DETERMINED, relative_error=std / abs(value) if value else math.inf)
    return Estimate(name, value, std, Status.PROVISIONAL, (*notes, doubt))


def _circumferential(record: LateralRecord, revolution: Revolution, conditions: TireConditions) -> FloatArray:
    """Return the coefficients of the circumferential axis over Omega^2, (2 k,) m.

    Without that axis it is -(e / R) ds/dtheta and gravity, which a sensor e below the neutral layer would read.
    """
    if not np.isnan(revolution.axes_mps2[CIRCUMFERENTIAL]).all():
        return record.along_m
    depth = math.hypot(conditions.sensor_offset_m, conditions.sensor_offset_std_m)
    cosine, sine = record.radial_m.reshape(2, -1) * np.asarray(ORDERS)
    result: FloatArray = np.concatenate([-sine, cosine]) * (depth / conditions.radius_m)
    result[len(ORDERS)] += STANDARD_GRAVITY_MPS2 / revolution.omega_radps**2
    return result


def _conicity(
    line_rad: FloatArray,
    difference_rad: FloatArray,
    line_std_rad: FloatArray,
    difference_std_rad: FloatArray,
    square_rad2: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return conicity's part of the change of slope in the contact, and its standard error, (k,) each.

    Args:
        line_rad: slope of the contact line.
        difference_rad: half the difference of the mean slopes in the second and the first half.
        line_std_rad: one standard error.
        difference_std_rad: one standard error.
        square_rad2: square of the half angle.
    """
    factor = _ROLLING_DIFFERENCE * square_rad2
    variance = np.square(difference_std_rad) + np.square(factor * line_std_rad)
    variance += np.square(_ROLLING_DIFFERENCE_STD * square_rad2 * line_rad)
    variance += np.square(_RESISTANCE_DIFFERENCE_STD * line_rad)
    return difference_rad - factor * line_rad, np.sqrt(variance)


def _roll_estimate(roll: Roll, conditions: TireConditions, unusable: Reason | None) -> Estimate:
    """Return the measured roll, against the stated one, or against what gluing by hand makes likely."""
    if not roll.count:
        return Estimate.invalid(ROLL_NAME, Reason(TrustCode.AC_COUPLED))
    claims, stated_rad = conditions.claims, conditions.claims.roll_rad
    by_gains = math.hypot(conditions.gain_std, conditions.claims.lateral_gain_std) * roll.rad
    std = math.hypot(_roll_error(roll, conditions), by_gains, conditions.tilt.mixed)
    doubt = unusable
    if doubt is None and roll.count < SETTLED_REVOLUTIONS:
        # A zero that is not as stated, or another axis, takes as many to show.
        doubt = Reason(CoreCode.NOT_SETTLED, revolutions=roll.count, needed=SETTLED_REVOLUTIONS)
    elif doubt is None and stated_rad is None and not _zero_is_measured(roll, claims):
        doubt = _unlikely_roll(roll, claims)
    elif doubt is None and stated_rad is not None and _differs_from_roll(roll, claims, stated_rad):
        doubt = Reason(ForceCode.ROLL_CONTRADICTED, stated_rad=stated_rad, stated_std_rad=claims.roll_std_rad)
    if doubt is not None:
        return Estimate(ROLL_NAME, roll.rad, std, Status.PROVISIONAL, (*_FROM_MEANS, doubt))
    return Estimate(ROLL_NAME, roll.rad, std, Status.VALID, _FROM_MEANS)


def _offset_estimate(roll: Roll, claims: SensorClaims, unusable: Reason | None) -> Estimate:
    """Return the constant in the mean of the lateral axis, zero-g offset and camber, against the stated zero."""
    if not roll.count:
        return Estimate.invalid(OFFSET_NAME, Reason(TrustCode.AC_COUPLED))
    value, std = roll.offset_mps2, roll.offset_std_mps2
    expected = max(claims.lateral_zero_mps2, OFFSET_STD_MPS2)
    if unusable is not None:
        return Estimate(OFFSET_NAME, value, std, Status.PROVISIONAL, (unusable,))
    if not _zero_is_measured(roll, claims):
        doubt = Reason(TrustCode.NEEDS_TWO_SPEEDS, quantity="roll tilt")
        return Estimate(OFFSET_NAME, value, std, Status.PROVISIONAL, (doubt,))
    if abs(value) > _SIGNIFICANT * math.hypot(std, expected):
        reason = Reason(ForceCode.LATERAL_ZERO_CONTRADICTED, stated_std_mps2=claims.lateral_zero_mps2)
        return Estimate(OFFSET_NAME, value, std, Status.PROVISIONAL, (reason,))
    return Estimate(OFFSET_NAME, value, std, Status.VALID)


def _all_invalid(reason: Reason) -> tuple[Estimate, ...]:
    names = (*NAMES, LINE_NAME, CONICITY_NAME, ROLL_NAME, AHEAD_NAME, OFFSET_NAME)
    return tuple(Estimate.invalid(name, reason) for name in names)


def _laminate_estimates(belt: BeltLaminate, conditions: TireConditions, peak: Estimate) -> tuple[Estimate, ...]:
    """Return the angle that the stated plies give, compared with the measured peak, and B16 and A66."""
    law = coupling_law(belt)
    angle = law.slope(conditions.radius_m, conditions.radius_std_m)
    reasons = [Reason(ForceCode.FROM_LAMINATE, length_m=law.length_m.value, length_std_m=law.length_m.std)]
    status = Status.VALID
    if abs(law.imbalance) > _UNBALANCED:
        reasons.append(Reason(ForceCode.LAMINATE_NOT_BALANCED, share=law.imbalance))
        status = Status.PROVISIONAL
    if peak.status is Status.VALID:
        expected = PEAK_OVER_LAMINATE * angle.value
        std = math.hypot(PEAK_OVER_LAMINATE * angle.std, PEAK_OVER_LAMINATE_STD * angle.value, peak.std)
        errors = abs(peak.value - expected) / std
        if errors > _SIGNIFICANT:
            reasons.append(
                Reason(ForceCode.LAMINATE_DIFFERS, measured_rad=peak.value, measured_std_rad=peak.std, errors=errors)
            )
            status = Status.PROVISIONAL
    values = (angle, law.b16_n, law.a66_npm)
    first = Estimate(LAMINATE_NAMES[0], *values[0], status, tuple(reasons))
    others = (Estimate(name, *value, Status.VALID) for name, value in zip(LAMINATE_NAMES[1:], values[1:], strict=True))
    return (first, *others)
