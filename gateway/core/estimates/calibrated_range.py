"""Range of half angles and pressures on which a calibration was fitted."""

from typing import Final

from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import Reason

MARGIN: Final = 0.1
"""Relative distance from the calibrated values at which a calibration still holds, as for loads."""


def outside_calibration(
    half_angle_rad: float,
    half_angle_range_rad: tuple[float, float],
    pressure_pa: float | None,
    pressure_range_pa: tuple[float, float] | None,
) -> list[Reason]:
    """Return what lies outside the calibrated range by more than a tenth; nothing of a pressure that is not known."""
    reasons = []
    low, high = half_angle_range_rad
    if not (1.0 - MARGIN) * low <= half_angle_rad <= (1.0 + MARGIN) * high:
        reasons.append(
            Reason(
                EstimateCode.HALF_ANGLE_OUTSIDE_CALIBRATION, half_angle_rad=half_angle_rad, low_rad=low, high_rad=high
            )
        )
    if pressure_pa is not None and pressure_range_pa is not None:
        low, high = pressure_range_pa
        if not (1.0 - MARGIN) * low <= pressure_pa <= (1.0 + MARGIN) * high:
            reasons.append(
                Reason(EstimateCode.PRESSURE_OUTSIDE_CALIBRATION, pressure_pa=pressure_pa, low_pa=low, high_pa=high)
            )
    return reasons
