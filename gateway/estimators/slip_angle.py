"""Estimator of slip from the lateral axis: apparent slip angle, direction, and asymmetry between left and right.

The mean slope of the streamline in the first half of the contact, minus that of ply steer, is almost proportional to
the slip angle. The factor is the belt's share (a fifth to two fifths on the tires modelled in
docs/explanation/ply-steer.md; the tread takes the rest). So an apparent slip angle is measured; the true one needs the
share, from driving at a known slip angle.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gateway.estimators.estimator import AngleAverage, Estimate, Revolution, Status, TireConditions
from gateway.estimators.lateral_shape import (
    ORDERS,
    LateralAverage,
    LateralSteps,
    contact_edges,
    has_lateral,
    why_unusable,
)
from gateway.estimators.revolution_block import RevolutionBlock, one_revolution
from gateway.reasons import Code, Reason
from gateway.signal.lateral_deformation import chord_row, lateral_waveform
from gateway.signal.sensor_mounting import RollCalibration
from gateway.signal.synchronous_average import RunningMoments
from gateway.types import FloatArray

NAMES: Final = ("slip_apparent_rad", "slip_direction", "lateral_asymmetry", "left_right_asymmetry")
SLIP_NAME: Final = "slip_angle_rad"

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
# Differences of neighbouring revolutions from which the scatter is known, and revolutions of either side from which
# left and right are compared.
_LEAST_STEPS: Final = 3
_LEAST_OF_SIDE: Final = 3


def slip_asymmetry(left_mps2: FloatArray, right_mps2: FloatArray) -> float:
    """Return the asymmetry of two lateral waveforms at equal left and right slip.

    It is rms(left + right) / rms(left - right): 0 for mirror images, larger with more ply steer and conicity.
    """
    together = float(np.sqrt(np.mean(np.square(left_mps2 + right_mps2))))
    apart = float(np.sqrt(np.mean(np.square(left_mps2 - right_mps2))))
    return together / apart if apart > 0.0 else math.nan


def lateral_asymmetry(waveform: FloatArray) -> float:
    """Return (max + min) / (max - min) of a lateral waveform: +1 or -1 when it has extrema of one sign only."""
    high, low = float(waveform.max()), float(waveform.min())
    return (high + low) / (high - low) if high > low else math.nan


class SlipAngleEstimator:
    """Slip of each revolution, relative to a slope at zero slip that is given or learnt; needs a lateral axis."""

    def __init__(self, zero_slope_rad: float | None = None, belt_share: float | None = None) -> None:
        """Start empty.

        Args:
            zero_slope_rad: first-half slope at zero slip (`ply_steer_first_half_rad`); None: the mean of the latest
                revolutions, which assumes that the car runs straight on average.
            belt_share: first-half slope per slip angle, of this tire; None: only the apparent slip angle is estimated.
        """
        self._given = zero_slope_rad
        self._share = belt_share
        self._reference = LateralAverage(REFERENCE_HORIZON, RollCalibration())
        self.reset()

    @property
    def name(self) -> str:
        """Name in the registry."""
        return "slip-angle"

    def reset(self) -> None:
        """Forget the zero, the calibration and both sides."""
        self._reference.reset()
        self._reference.roll.reset()
        self._last_slope = math.nan
        self._steps = RunningMoments(1)
        self._sides = {1.0: RunningMoments(1), -1.0: RunningMoments(1)}

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return slip_apparent_rad, slip_direction, lateral_asymmetry, left_right_asymmetry, then slip_angle_rad.

        Positive slip pulls the tire to the left. Slip that is constant while the zero is learnt becomes part of the
        zero, so the standard error includes a usual mean slip. slip_direction is 1, -1, or 0 when slip is within three
        standard errors of zero; a reason says so. left_right_asymmetry is the sum of the mean lateral_asymmetry at left
        and at right slip, 0 for a tire without ply steer and conicity. slip_angle_rad needs the belt's share. There are
        no estimates without a lateral axis. Never raises on values.
        """
        return self.update_block(one_revolution(revolution, average, conditions))[0]

    def update_block(self, block: RevolutionBlock) -> list[tuple[Estimate, ...]]:
        """Take revolutions and return the estimates after each."""
        lateral = [has_lateral(revolution) for revolution in block.revolutions]
        unusable = [why_unusable(block, index) if has else None for index, has in enumerate(lateral)]
        taken = [index for index, has in enumerate(lateral) if has and unusable[index] is None]
        steps = self._reference.update(block, taken) if taken else None
        found: list[tuple[Estimate, ...]] = []
        for index, has in enumerate(lateral):
            why = unusable[index]
            if why is not None:
                found.append(self._invalid(why))
            elif has and steps is not None:
                found.append(self._estimates(block, index, steps, taken.index(index)))
            else:
                found.append(())
        return found

    def _estimates(self, block: RevolutionBlock, index: int, steps: LateralSteps, place: int) -> tuple[Estimate, ...]:
        conditions = block.conditions[index]
        edges = contact_edges(block.averages.edges_rad[index], conditions)
        if isinstance(edges, Reason):
            return self._invalid(edges)
        # The roll tilt is the same in both, so its error cancels in their difference.
        row = chord_row(edges[0], 0.5 * (edges[0] + edges[1]), ORDERS, conditions.radius_m)
        own_m = steps.own_m[place]
        slope = float(row @ own_m)
        reference = self._given if self._given is not None else float(row @ steps.mean_m[place])
        count = steps.effective_counts[place]
        std = self._scatter(slope)
        if self._given is None and count > 1.0:
            std *= math.sqrt(1.0 + 1.0 / count)
            std = math.hypot(std, _LEARNT_ZERO_STD_RAD)
        apparent = slope - reference
        asymmetry = lateral_asymmetry(lateral_waveform(own_m, ORDERS, 512))
        if abs(apparent) > _SIDE_RAD:
            side = self._sides[math.copysign(1.0, apparent)]
            side.update(np.array([asymmetry]), max(1.0 / (side.count + 1), 1.0 / _HORIZON))
        status, reason = self._status(std, count)
        reasons = (reason,)
        direction = math.copysign(1.0, apparent) if abs(apparent) > _SIGNIFICANT * std else 0.0
        unsigned = () if direction else (Reason(Code.SIGN_NOT_DETERMINED, errors=abs(apparent) / std if std else 0.0),)
        estimates = [
            Estimate(NAMES[0], apparent, std, status, reasons),
            Estimate(NAMES[1], direction, math.nan, status, (*reasons, *unsigned)),
            Estimate(NAMES[2], asymmetry, math.nan, status, reasons),
            self._left_right(),
        ]
        if self._share is not None:
            estimates.append(Estimate(SLIP_NAME, apparent / self._share, std / abs(self._share), status, reasons))
        return tuple(estimates)

    def _scatter(self, slope_rad: float) -> float:
        """Return the scatter of one revolution's slope from differences of neighbours, free of slow changes of slip."""
        step, self._last_slope = slope_rad - self._last_slope, slope_rad
        if math.isfinite(step):
            self._steps.update(np.array([0.5 * step * step]), max(1.0 / (self._steps.count + 1), 1.0 / _HORIZON))
        return math.sqrt(self._steps.mean[0]) if self._steps.count >= _LEAST_STEPS else math.nan

    def _status(self, std: float, count: float) -> tuple[Status, Reason]:
        if not math.isfinite(std):
            return Status.PROVISIONAL, Reason(Code.SCATTER_UNKNOWN, needed=_LEAST_STEPS + 1)
        if self._given is not None:
            return Status.VALID, Reason(Code.ZERO_SLIP_GIVEN)
        if count < REFERENCE_SETTLED:
            return Status.PROVISIONAL, Reason(Code.ZERO_SLIP_NOT_SETTLED, revolutions=count, needed=REFERENCE_SETTLED)
        return Status.VALID, Reason(Code.ZERO_SLIP_IS_MEAN)

    def _left_right(self) -> Estimate:
        left, right = self._sides[1.0], self._sides[-1.0]
        if min(left.count, right.count) < _LEAST_OF_SIDE:
            return Estimate.invalid(NAMES[3], Reason(Code.NEEDS_BOTH_SLIPS, needed=_LEAST_OF_SIDE))
        variance = sum(float(side.variance()[0] * np.asarray(side.weight_square)) for side in (left, right))
        return Estimate(NAMES[3], float(left.mean[0] + right.mean[0]), math.sqrt(variance), Status.VALID)

    def _invalid(self, reason: Reason) -> tuple[Estimate, ...]:
        names = NAMES if self._share is None else (*NAMES, SLIP_NAME)
        return tuple(Estimate.invalid(name, reason) for name in names)
