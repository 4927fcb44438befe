"""Shape of the lateral signal: coefficients of a revolution, their average, and slopes with their errors."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from gateway.constants import AXIS_NAMES
from gateway.estimators.estimator import AngleAverage, Revolution, TireConditions, not_used
from gateway.reasons import Code, Reason
from gateway.signal.angle_resampling import Phase, angle_grid
from gateway.signal.lateral_deformation import (
    HIGHEST_ORDER,
    chord_row,
    lateral_coefficients,
    line_row,
    remove_roll,
    slope_row,
    streamline_slope,
    trusted_orders,
)
from gateway.signal.sensor_mounting import RollCalibration
from gateway.signal.synchronous_average import RunningMoments
from gateway.types import FloatArray

# Rows of `Revolution.axes_mps2`.
CIRCUMFERENTIAL, LATERAL, RADIAL = range(3)

ORDERS: Final = trusted_orders(HIGHEST_ORDER)
# Shorter contacts span too few grid points for a slope.
_LEAST_CONTACT_RAD: Final = 0.08

_SIZE: Final = 2 * len(ORDERS)
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
    """Slope of the streamline in the contact, in three definitions, and their rows.

    Attributes:
        values_rad: (3,) peak, first_half, adhesion_line.
        rows: (3, 2 k) linear maps from the coefficients of a record to the slopes.
        stretch_rad: first and last angle of the adhesion line.
        parity_rad: (2,) slope of the least-squares line through the whole contact, which an even displacement does not
            change; half the difference of the mean slopes in its second and first half, which an odd displacement that
            is straight in the contact does not change.
        parity_rows: (2, 2 k) likewise.
    """

    values_rad: FloatArray
    rows: FloatArray
    stretch_rad: tuple[float, float]
    parity_rad: FloatArray
    parity_rows: FloatArray


DEFINITIONS: Final = ("peak", "first_half", "adhesion_line")


class LateralAverage:
    """Running average of lateral records, with calibration of the roll tilt."""

    def __init__(self, horizon_revolutions: float, roll: RollCalibration) -> None:
        """Start empty; `roll` is updated by every revolution and may be shared."""
        self._floor = 1.0 / horizon_revolutions
        self.roll = roll
        self.reset()

    def reset(self) -> None:
        """Forget everything but the calibration, which is reset separately."""
        self._lateral = RunningMoments(_SIZE, covariance=True)
        # Radial, circumferential, and the tilt that each revolution was corrected with.
        self._others = RunningMoments(2 * _SIZE + 1)
        self._noise = 0.0
        self._order_max = 0

    @property
    def effective_count(self) -> float:
        """Number of revolutions of equal weight that would have the same variance."""
        return float(1.0 / np.asarray(self._lateral.weight_square)) if self._lateral.count else 0.0

    def update(self, revolution: Revolution) -> LateralRecord:
        """Add a revolution; return its record, corrected with the present tilt."""
        axes = revolution.axes_mps2
        if not revolution.ac_coupled:
            self.roll.update(float(axes[LATERAL].mean()), float(axes[RADIAL].mean()))
        roll_rad = self.roll.roll_rad
        record = lateral_record(revolution, roll_rad)
        self._order_max = max(self._order_max, record.order_max)
        weight = max(1.0 / (self._lateral.count + 1), self._floor)
        # Orders that the sampling does not carry at this speed keep their average.
        absent = np.tile(np.asarray(ORDERS) > record.order_max, 2)
        self._lateral.update(np.where(absent, self._lateral.mean, record.lateral_m), weight)
        others = np.concatenate([record.radial_m, record.along_m, [roll_rad]])
        self._others.update(np.where([*absent, *absent, False], self._others.mean, others), weight)
        self._noise += weight * (float(record.covariance[0, 0]) - self._noise)
        return record

    def record(self) -> LateralRecord:
        """Return the average with the latest tilt; its covariance is that of the mean, without that of the tilt."""
        radial, along = self._others.mean[:_SIZE], self._others.mean[_SIZE:-1]
        late = self.roll.roll_rad - float(self._others.mean[-1])
        # With less than three revolutions the noise above the tire's orders is a better estimate than their scatter.
        scatter = self._lateral.variance() if self._lateral.count >= 3 else self._noise * np.eye(_SIZE)
        covariance = scatter * np.asarray(self._lateral.weight_square)
        return LateralRecord(self._lateral.mean - late * radial, radial, along, covariance, self._order_max)


def lateral_record(revolution: Revolution, roll_rad: float) -> LateralRecord:
    """Return one revolution's coefficients, corrected for its angular acceleration.

    The revolution must have a lateral axis (`has_lateral`). Raises nothing.
    """
    axes = revolution.axes_mps2
    n = axes.shape[1]
    lateral = remove_roll(axes[LATERAL], axes[RADIAL], roll_rad)
    # Offset and camber do not grow with the speed, so they are removed before the acceleration is corrected.
    waveforms = np.stack([lateral - lateral.mean(), axes[RADIAL], np.nan_to_num(axes[CIRCUMFERENTIAL])])
    waveforms *= _acceleration_gain(revolution, n) / revolution.omega_radps**2
    orders = trusted_orders(revolution.order_max)
    coefficients = np.zeros((3, 2, len(ORDERS)))
    coefficients[:, :, : len(orders)] = lateral_coefficients(waveforms, orders).reshape(3, 2, -1)
    # The noise of the radial axis of the same sensor stands for that of the lateral axis until the scatter is known.
    noise = revolution.noise_mps2 * math.sqrt(2.0 / n) / revolution.omega_radps**2
    variance = noise**2 if math.isfinite(noise) else 0.0
    flat = coefficients.reshape(3, -1)
    return LateralRecord(flat[0], flat[1], flat[2], variance * np.eye(_SIZE), len(orders))


def has_lateral(revolution: Revolution) -> bool:
    """Return whether the sensor has a lateral axis."""
    return not bool(np.isnan(revolution.axes_mps2[LATERAL]).all())


def why_unusable(revolution: Revolution) -> Reason | None:
    """Return why a revolution must not be averaged; None when it may be."""
    if revolution.faults:
        return not_used(revolution.faults)
    for axis in (LATERAL, RADIAL):
        if not np.isfinite(revolution.axes_mps2[axis]).all():
            return not_used((Reason(Code.AXIS_NOT_FINITE, axis=AXIS_NAMES[axis]),))
    if not (revolution.omega_radps > 0.0 and revolution.order_max >= 1):
        return not_used((Reason(Code.SPEED_UNUSABLE),))
    return None


def contact_edges(average: AngleAverage, conditions: TireConditions) -> tuple[float, float] | Reason:
    """Return the contact edges that slopes are taken between, or why there are none."""
    leading, trailing = average.leading_edge_rad, average.trailing_edge_rad
    if not (-math.pi < leading < trailing < math.pi and trailing - leading > _LEAST_CONTACT_RAD):
        return Reason(Code.NO_CONTACT_EDGES)
    return (leading, trailing) if conditions.radius_m > 0.0 else Reason(Code.SPEED_OR_RADIUS_UNKNOWN)


def slopes(record: LateralRecord, edges_rad: tuple[float, float], radius_m: float) -> Slopes:
    """Return the slopes between two contact edges.

    peak: the steepest slope with the sign of the least-squares line through the whole contact. first_half: mean slope
    from the leading edge to the middle of the contact. adhesion_line: least-squares line through the lateral
    displacement over the range around the peak in which the slope keeps its sign, like a ruler laid on the rising part
    of the plotted deformation.
    """
    leading, trailing = edges_rad
    angles = _ANGLES
    parity_rows = _parity_rows(leading, trailing, radius_m)
    sign = np.sign(parity_rows[0] @ record.lateral_m) or 1.0
    slope = sign * streamline_slope(record.lateral_m, ORDERS, radius_m, _GRID)
    start, end = np.searchsorted(angles, edges_rad)
    steep = int(start + slope[start:end].argmax())
    before = np.flatnonzero(slope[start:steep] <= 0.0)
    after = np.flatnonzero(slope[steep:end] <= 0.0)
    first = leading if not len(before) else _zero(angles, slope, int(start + before[-1]))
    last = trailing if not len(after) else _zero(angles, slope, int(steep + after[0] - 1))
    peak = min(max(_vertex(angles, slope, steep), leading), trailing)
    rows = np.stack(
        [
            slope_row(peak, ORDERS, radius_m),
            chord_row(leading, 0.5 * (leading + trailing), ORDERS, radius_m),
            line_row(first, last, ORDERS, radius_m),
        ]
    )
    return Slopes(rows @ record.lateral_m, rows, (first, last), parity_rows @ record.lateral_m, parity_rows)


def _parity_rows(leading_rad: float, trailing_rad: float, radius_m: float) -> FloatArray:
    middle = 0.5 * (leading_rad + trailing_rad)
    first = chord_row(leading_rad, middle, ORDERS, radius_m)
    second = chord_row(middle, trailing_rad, ORDERS, radius_m)
    return np.stack([line_row(leading_rad, trailing_rad, ORDERS, radius_m), 0.5 * (second - first)])


def edge_errors(
    record: LateralRecord,
    found: Slopes,
    edges_rad: tuple[float, float],
    edges_std_rad: tuple[float, float],
    radius_m: float,
) -> FloatArray:
    """Return the errors of the three slopes and the two of `parity_rad` from those of the contact edges, (5,) rad.

    The peak does not depend on the edges. The adhesion line depends on them only where it ends at one; where it ends at
    a zero of the slope, noise moves its end.
    """
    total = np.zeros(len(DEFINITIONS) + len(found.parity_rad))
    for edge, std in enumerate(edges_std_rad):
        at_edge = found.stretch_rad[edge] == edges_rad[edge]
        end_std = std if at_edge else _zero_std(record, found.stretch_rad[edge], radius_m)
        if math.isfinite(end_std) and end_std > 0.0:
            ends = [end + end_std * (place == edge) for place, end in enumerate(found.stretch_rad)]
            total[2] += (line_row(ends[0], ends[1], ORDERS, radius_m) @ record.lateral_m - found.values_rad[2]) ** 2
        if not (math.isfinite(std) and std > 0.0):
            continue
        leading, trailing = edges_rad[0] + std * (edge == 0), edges_rad[1] + std * (edge == 1)
        chord = chord_row(leading, 0.5 * (leading + trailing), ORDERS, radius_m) @ record.lateral_m
        total[1] += (chord - found.values_rad[1]) ** 2
        parity = _parity_rows(leading, trailing, radius_m) @ record.lateral_m
        total[len(DEFINITIONS) :] += np.square(parity - found.parity_rad)
    return np.sqrt(total)


def _zero_std(record: LateralRecord, zero_rad: float, radius_m: float) -> float:
    """Return the error by noise of the angle at which the slope of the streamline is zero; infinite without one."""
    row = slope_row(zero_rad, ORDERS, radius_m)
    step = _ANGLES[1] - _ANGLES[0]
    bend = (slope_row(zero_rad + step, ORDERS, radius_m) - row) @ record.lateral_m / step
    noise = math.sqrt(max(float(row @ record.covariance @ row), 0.0))
    return noise / abs(float(bend)) if bend else math.inf


def _acceleration_gain(revolution: Revolution, n: int) -> FloatArray:
    """Return (mean speed / speed)^2 on the angle grid; 1 when the acceleration is not known."""
    period, acceleration = revolution.period_s, revolution.omega_dot_radps2
    rate = 2.0 * math.pi / period - 0.5 * acceleration * period
    if not (math.isfinite(acceleration) and rate > 0.0 and rate + acceleration * period > 0.0):
        return np.ones(n)
    result: FloatArray = Phase(0.0, period, rate, acceleration).relative_speed(n) ** -2.0
    return result


def _vertex(angles: FloatArray, height: FloatArray, at: int) -> float:
    """Return the vertex angle of the parabola through a maximum and its two neighbours."""
    left, middle, right = height[at - 1], height[at], height[(at + 1) % len(height)]
    bend = left - 2.0 * middle + right
    shift = 0.5 * (left - right) / bend if bend < 0.0 else 0.0
    return float(angles[at] + np.clip(shift, -1.0, 1.0) * (angles[1] - angles[0]))


def _zero(angles: FloatArray, slope: FloatArray, before: int) -> float:
    """Return the angle at which the slope crosses zero between a grid point and the next."""
    share = slope[before] / (slope[before] - slope[before + 1])
    return float(angles[before] + share * (angles[before + 1] - angles[before]))
