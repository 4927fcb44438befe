"""Estimator of slip from the lateral axis: apparent slip angle, direction, and asymmetry between left and right.

The mean slope of the streamline in the first half of the contact, minus that of ply steer, is almost proportional to
the slip angle. The factor is the belt's share (a fifth to two fifths on the tires modelled in
docs/explanation/ply-steer.md; the tread takes the rest). So an apparent slip angle is measured. The true one needs the
share and the slope at zero slip, `SlipCalibration`. Without it zero slip is the mean of the latest revolutions, which
contains any constant slip.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import (
    Estimate,
    Status,
    TireConditions,
    sign_not_determined,
)
from gateway.core.reasons import Reason
from gateway.core.revolutions.synchronous_average import RunningMoments
from gateway.core.types import FloatArray
from gateway.forces.lateral_deformation import ORDERS, chord_row, lateral_waveform
from gateway.forces.lateral_shape import (
    FIRST_ORDER,
    LateralEstimator,
    LateralSteps,
)
from gateway.forces.reasons import ForceCode
from gateway.forces.slip_calibration import SlipCalibration

NAMES: Final = ("slip_apparent_rad", "slip_direction", "lateral_asymmetry", "left_right_asymmetry")
SLIP_NAME: Final = "slip_angle_rad"
MEAN_NAME: Final = "slip_angle_mean_rad"

# Memory of the learnt zero in revolutions: long compared with a bend, short compared with changes of temperature.
REFERENCE_HORIZON: Final = 500.0
REFERENCE_SETTLED: Final = 50.0
# Usual mean slip of a wheel on a straight road (toe, crown), times a usual share of the belt: error of a learnt zero.
_LEARNT_ZERO_STD_RAD: Final = math.radians(0.15) * 0.3
# Standard errors from zero beyond which slip has a direction.
_SIGNIFICANT: Final = 3.0
# Apparent slip from which a revolution counts as left or right.
_SIDE_RAD: Final = math.radians(0.1)
# Memory of scatter and of the left and right means.
_HORIZON: Final = 50.0
_GRID: Final = 512
# Largest of 80 normal values, in standard errors: what noise adds to an extreme of a waveform that is flat there.
_NOISE_PEAK: Final = 2.4
# Differences of neighbouring revolutions from which the scatter is known, and revolutions of either side from which
# left and right are compared.
_MIN_STEPS: Final = 3
_MIN_PER_SIDE: Final = 3


def lateral_asymmetry(waveform: FloatArray) -> float:
    """Return (max + min) / (max - min) of a lateral waveform: +1 or -1 when it has extrema of one sign only."""
    high, low = float(waveform.max()), float(waveform.min())
    return (high + low) / (high - low) if high > low else math.nan


def _asymmetry(coefficients_m: FloatArray) -> float:
    return lateral_asymmetry(lateral_waveform(coefficients_m, _GRID))


def _asymmetry_by_noise(waveform_m: FloatArray, peak_m: float) -> float:
    """Return what noise that stands on both extremes with a peak makes of the asymmetry; 1 if it hides them."""
    if peak_m >= abs(waveform_m).max():
        return 1.0
    return lateral_asymmetry(waveform_m) - lateral_asymmetry(waveform_m - np.clip(waveform_m, -peak_m, peak_m))


class SlipAngleEstimator(LateralEstimator):
    """Slip of each revolution, relative to a slope at zero slip that is calibrated or learnt; needs a lateral axis.

    Gives slip_apparent_rad, slip_direction, lateral_asymmetry, left_right_asymmetry, then the slip angles.

    Positive slip pulls the tire to the left. Without a `SlipCalibration` of the tire the zero is learnt: slip
    that is constant becomes part of it, so slip_apparent_rad and slip_direction stay provisional, and there are no
    slip angles. With it, slip_angle_rad is that of the revolution and slip_angle_mean_rad that of the mean of the
    latest ones. Outside the calibrated half angles, pressures and slip angles they are provisional.

    The error of lateral_asymmetry is its scatter, what the roll tilt's error makes, and what noise adds to extremes.
    slip_direction is 1, -1, or 0 when slip is within three standard errors of zero; a reason says so.
    left_right_asymmetry is the sum of the mean lateral_asymmetry at left and at right slip, 0 for a tire without
    ply steer and conicity. There are no estimates without a lateral axis.
    """

    name = "slip-angle"

    def __init__(self) -> None:
        super().__init__(REFERENCE_HORIZON)

    def reset(self) -> None:
        """Forget the zero, the calibration and both sides."""
        super().reset()
        # Slope, asymmetry and coefficients.
        self._last = np.full(2 + 2 * len(ORDERS), math.nan)
        self._steps = RunningMoments(len(self._last))
        # Asymmetry, and its errors by roll tilt and noise with their signs.
        self._sides = {1.0: RunningMoments(3), -1.0: RunningMoments(3)}

    def _names(self, conditions: TireConditions) -> Sequence[str]:
        return NAMES if conditions.tire.of(SlipCalibration) is None else (*NAMES, SLIP_NAME, MEAN_NAME)

    def _estimates(
        self, conditions: TireConditions, edges_rad: tuple[float, float], steps: LateralSteps, row: int
    ) -> tuple[Estimate, ...]:
        # The roll tilt is the same in both, so its error cancels in their difference.
        chord = chord_row(edges_rad[0], 0.5 * (edges_rad[0] + edges_rad[1]), conditions.radius_m)
        own_m = steps.own_m[row]
        slope = float(chord @ own_m)
        mean = float(chord @ steps.mean_m[row])
        count = steps.effective_counts[row]
        waveform_m = lateral_waveform(own_m, _GRID)
        asymmetry = lateral_asymmetry(waveform_m)
        scatter, asymmetry_scatter, peak_m = self._scatter(np.array([slope, asymmetry, *own_m]))
        law = conditions.tire.of(SlipCalibration)
        by_turn, by_turns = (
            math.hypot(*(chord[FIRST_ORDER] * std_m))
            for std_m in (steps.turns[row].remove_std_m, steps.turn_std_m[row])
        )
        if law is not None:
            zero, std = law.zero_rad, math.hypot(scatter, law.zero_std_rad, by_turn)
        else:
            zero, std = mean, math.hypot(scatter * math.sqrt(1.0 + 1.0 / count), _LEARNT_ZERO_STD_RAD, by_turn)
        apparent = slope - zero
        by_roll_m = steps.roll[row].std_rad * steps.own_radial_m[row]
        by_roll = 0.5 * (_asymmetry(own_m + by_roll_m) - _asymmetry(own_m - by_roll_m))
        by_noise = _asymmetry_by_noise(waveform_m, peak_m)
        if abs(apparent) > _SIDE_RAD and math.isfinite(by_noise):
            side = self._sides[math.copysign(1.0, apparent)]
            side.update(np.array([asymmetry, by_roll, by_noise]), max(1.0 / (side.count + 1), 1.0 / _HORIZON))
        outside: tuple[Reason, ...] = ()
        angles: tuple[Estimate, ...] = ()
        if law is not None:
            half = 0.5 * (edges_rad[1] - edges_rad[0])
            outside = law.outside(half, conditions.pressure_pa, law.slip_at(slope, 0.0)[0])
            outside_mean = law.outside(half, conditions.pressure_pa, law.slip_at(mean, 0.0)[0])
            angles = (
                _slip(SLIP_NAME, law, (slope, math.hypot(scatter, by_turn)), outside),
                _slip(MEAN_NAME, law, (mean, math.hypot(scatter / math.sqrt(count), by_turns)), outside_mean),
            )
        status, reasons = _status(scatter, count, law, outside)
        direction = math.copysign(1.0, apparent) if abs(apparent) > _SIGNIFICANT * std else 0.0
        unsigned = () if direction else (sign_not_determined(apparent, std),)
        # The asymmetry is a property of the waveform; which zero was learnt does not matter to it.
        is_settled = law is not None or count >= REFERENCE_SETTLED
        asymmetry_status, asymmetry_reasons = (
            (Status.VALID, ()) if is_settled and math.isfinite(scatter) else (status, reasons)
        )
        return (
            Estimate(NAMES[0], apparent, std, status, reasons, scatter if math.isfinite(scatter) else 0.0),
            Estimate(NAMES[1], direction, math.nan, status, (*reasons, *unsigned)),
            Estimate(
                NAMES[2],
                asymmetry,
                math.hypot(by_roll, by_noise, asymmetry_scatter),
                asymmetry_status,
                asymmetry_reasons,
                asymmetry_scatter if math.isfinite(asymmetry_scatter) else 0.0,
            ),
            self._left_right(),
            *angles,
        )

    def _scatter(self, latest: FloatArray) -> tuple[float, float, float]:
        """Return the scatter of slope and asymmetry in one revolution, and the peak of its noise in m.

        By differences of neighbours, which are free of slow changes of slip; NaN before there are some.
        """
        step, self._last = latest - self._last, latest
        if np.isfinite(step).all():
            self._steps.update(0.5 * step * step, max(1.0 / (self._steps.count + 1), 1.0 / _HORIZON))
        if self._steps.count < _MIN_STEPS:
            return math.nan, math.nan, math.nan
        slope, asymmetry, *coefficients = self._steps.mean.tolist()
        return math.sqrt(slope), math.sqrt(asymmetry), _NOISE_PEAK * math.sqrt(0.5 * sum(coefficients))

    def _left_right(self) -> Estimate:
        left_side, right_side = self._sides[1.0], self._sides[-1.0]
        if min(left_side.count, right_side.count) < _MIN_PER_SIDE:
            return Estimate.invalid(NAMES[3], Reason(ForceCode.NEEDS_BOTH_SLIPS, needed=_MIN_PER_SIDE))
        value, by_roll, by_noise = (left_side.mean + right_side.mean).tolist()
        variance = sum(float(side.variance()[0] * np.asarray(side.weight_square)) for side in (left_side, right_side))
        return Estimate(NAMES[3], value, math.hypot(math.sqrt(variance), by_roll, by_noise), Status.VALID)


def _status(
    scatter_rad: float, count: float, law: SlipCalibration | None, outside: tuple[Reason, ...]
) -> tuple[Status, tuple[Reason, ...]]:
    """Return the status of what is relative to zero slip."""
    if not math.isfinite(scatter_rad):
        return Status.PROVISIONAL, (Reason(ForceCode.SCATTER_UNKNOWN, needed=_MIN_STEPS + 1),)
    if law is not None:
        return Status.PROVISIONAL if outside else Status.VALID, (Reason(ForceCode.ZERO_SLIP_GIVEN), *outside)
    if count < REFERENCE_SETTLED:
        reason = Reason(ForceCode.ZERO_SLIP_NOT_SETTLED, revolutions=count, needed=REFERENCE_SETTLED)
        return Status.PROVISIONAL, (reason,)
    return Status.PROVISIONAL, (Reason(ForceCode.ZERO_SLIP_IS_MEAN),)


def _slip(name: str, law: SlipCalibration, slope_rad: tuple[float, float], outside: tuple[Reason, ...]) -> Estimate:
    """Return a slip angle from a slope and its standard error."""
    value, std = law.slip_at(*slope_rad)
    if not math.isfinite(value):
        return Estimate.invalid(name, Reason(ForceCode.SLIP_BEYOND_LAW))
    if not math.isfinite(std):
        unknown = Reason(ForceCode.SCATTER_UNKNOWN, needed=_MIN_STEPS + 1)
        return Estimate(name, value, std, Status.PROVISIONAL, (unknown,))
    constant_std = law.slip_at(slope_rad[0], 0.0)[1]
    scatter_std = math.sqrt(max(std * std - constant_std * constant_std, 0.0))
    status = Status.PROVISIONAL if outside else Status.VALID
    return Estimate(name, value, std, status, (Reason(ForceCode.ZERO_SLIP_GIVEN), *outside), scatter_std)
