"""Slip calibration of a tire: slope of the streamline in the first half of the contact as a function of slip angle."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.estimates.calibrated_range import MARGIN, outside_calibration
from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.forces.reasons import ForceCode

LAW_STD: Final = 0.025
"""Error of the law relative to the change of the slope by slip, on the belts of tools/bench_lateral.py up to 2 deg:
with ply steer, left and right slip saturate at different angles."""


@dataclass(frozen=True, slots=True)
class SlipCalibration:
    """slope = zero_rad + belt_share alpha (1 - saturation_prad |alpha|), rolling forward.

    `slope` is the first-half slope (`ply_steer_first_half_rad`) and alpha the slip angle, positive to the left. The
    tread takes the rest of the slip; it starts to slide at larger slip angles, which is the saturation (first term of
    the brush model). `gateway.forces.slip_fit` makes the calibration from runs of known slip.

    Attributes:
        belt_share: slope per slip angle at zero slip, dimensionless.
        belt_share_std: one standard error.
        zero_rad: slope at zero slip: ply steer plus conicity.
        zero_std_rad: one standard error.
        saturation_prad: relative loss of the share per rad of slip.
        saturation_std_prad: one standard error.
        zero_share_correlation: correlation of the errors of zero_rad and belt_share.
        share_saturation_correlation: of belt_share and saturation_prad.
        slip_range_rad: lowest and highest slip angle of the runs.
        half_angle_range_rad: lowest and highest contact half angle of the runs.
        pressure_range_pa: likewise pressure.
        ply_steer_rad: part of zero_rad that changes sign with the direction of rolling; None without runs in both.
        ply_steer_std_rad: one standard error.
        conicity_rad: part of zero_rad that does not; None without runs in both.
        conicity_std_rad: one standard error.
    """

    belt_share: float
    belt_share_std: float
    zero_rad: float
    zero_std_rad: float
    saturation_prad: float
    saturation_std_prad: float
    zero_share_correlation: float
    share_saturation_correlation: float
    slip_range_rad: tuple[float, float]
    half_angle_range_rad: tuple[float, float]
    pressure_range_pa: tuple[float, float]
    ply_steer_rad: float | None = None
    ply_steer_std_rad: float = 0.0
    conicity_rad: float | None = None
    conicity_std_rad: float = 0.0

    def slope_at(self, slip_rad: float) -> float:
        """Return the slope at a slip angle."""
        return self.zero_rad + self.belt_share * slip_rad * (1.0 - self.saturation_prad * abs(slip_rad))

    def slip_at(self, slope_rad: float, slope_std_rad: float) -> tuple[float, float]:
        """Return the slip angle of a slope and its standard error, which includes those of calibration and law.

        Both are NaN for a slope beyond the largest that the law gives.
        """
        change = (slope_rad - self.zero_rad) / self.belt_share
        bend = self.saturation_prad
        root = 1.0 - 4.0 * bend * abs(change)
        if not root > 0.0:
            return math.nan, math.nan
        # The stable form of (1 - sqrt(root)) / (2 bend).
        slip = 2.0 * change / (1.0 + math.sqrt(root))
        # Derivatives of the slope by zero, share and saturation; by slip it is share times the square root.
        rows = np.array([1.0, slip * (1.0 - bend * abs(slip)), -self.belt_share * slip * abs(slip)])
        variance = float(rows @ self.covariance @ rows) + slope_std_rad**2 + (LAW_STD * self.belt_share * slip) ** 2
        return slip, math.sqrt(variance) / (abs(self.belt_share) * math.sqrt(root))

    @property
    def covariance(self) -> FloatArray:
        """Covariance of zero_rad, belt_share and saturation_prad, (3, 3)."""
        stds = np.array([self.zero_std_rad, self.belt_share_std, self.saturation_std_prad])
        first, last = self.zero_share_correlation, self.share_saturation_correlation
        # The product is the correlation of the outer two that keeps the matrix positive.
        correlations = np.array([[1.0, first, first * last], [first, 1.0, last], [first * last, last, 1.0]])
        result: FloatArray = correlations * np.outer(stds, stds)
        return result

    def outside(self, half_angle_rad: float, pressure_pa: float | None, slip_rad: float) -> tuple[Reason, ...]:
        """Return what lies outside the calibrated ranges."""
        reasons = outside_calibration(half_angle_rad, self.half_angle_range_rad, pressure_pa, self.pressure_range_pa)
        if math.isnan(slip_rad):
            return (*reasons, Reason(ForceCode.SLIP_BEYOND_LAW))
        low, high = self.slip_range_rad
        span = MARGIN * (high - low)
        if not low - span <= slip_rad <= high + span:
            reasons.append(Reason(ForceCode.SLIP_OUTSIDE_CALIBRATION, slip_rad=slip_rad, low_rad=low, high_rad=high))
        return tuple(reasons)
