"""What is stated about a sensor and how well it is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

from gateway.core.estimates.disagreement import CONTRADICTION

# Standard errors where none is stated. Gain: a sensor calibrated by gravity or on a centrifuge. Zero: after the
# calibration in the hello, which leaves 0.1 g. Rate: the hub's quartz, against the computer's clock.
GAIN_STD: Final = 0.015
ZERO_G_STD_MPS2: Final = 1.0
AXIS_GAIN_STD: Final = 0.06
"""The same of an axis whose gain nothing compares with the steady value: data sheets allow 10 % either way."""
NONLINEARITY_STD: Final = 0.005
"""Of full scale; data sheets say 0.1 to 2 %."""
RATE_STD: Final = 1e-4
HAND_MOUNTED_STD_M: Final = 1e-3
"""Accuracy of an offset that is measured by hand."""
HAND_MOUNTED_STD_RAD: Final = math.radians(1.0)
"""Accuracy of an angle of mounting by hand."""
HAND_MOUNTED_YAW_STD_RAD: Final = math.radians(1.0)
"""The same about the radial axis: the liner levels a sensor about the others, and nothing about this one."""
UNKNOWN_OFFSET_STD_M: Final = 5e-3
"""A sensor on the inner liner is 0 to 10 mm below the neutral layer."""
RADIUS_STD: Final = 0.01
"""Relative standard error of a belt radius from a data sheet."""
CORNER_TOLERANCE: Final = 0.1
"""Relative standard error of the corner of an AC coupling: of its capacitor."""
LOAD_STD: Final = 0.1
"""Relative standard error of a wheel load that was not weighed: passengers and luggage, and left against right."""
PRESSURE_STD: Final = 0.05
"""Relative standard error of a gauge pressure. A sensor measures an absolute one within 2 %, and weather and altitude
change the ambient pressure that is subtracted by 5 kPa, three times that in the mountains."""


# Yaw beyond which the axis along the belt is another one.
_STEEPEST_RAD: Final = math.radians(60.0)


class Tilt(NamedTuple):
    """How a sensor sits askew, as its axes show it.

    Attributes:
        roll_rad: about the circumferential axis.
        pitch_rad: about the lateral axis.
        yaw_std_rad: standard error of the yaw, as it is mounted by hand or as it is measured.
    """

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_std_rad: float = HAND_MOUNTED_YAW_STD_RAD

    @classmethod
    def of(cls, roll_rad: float, pitch_rad: float, yaw: tuple[float, float] = (math.nan, math.nan)) -> Tilt:
        """Return the tilt of measured angles, NaN where one is not measured; the yaw has a standard error.

        The three are of their own, but a sensor that is askew about two axes may be so about the third as much.
        """
        has_roll, has_pitch = not math.isnan(roll_rad), not math.isnan(pitch_rad)
        roll, pitch = roll_rad if has_roll else 0.0, pitch_rad if has_pitch else 0.0
        tilt2 = (roll * roll + pitch * pitch) / max(has_roll + has_pitch, 1)
        mounting_std = math.hypot(HAND_MOUNTED_YAW_STD_RAD, math.sqrt(max(tilt2 - HAND_MOUNTED_STD_RAD**2, 0.0)))
        yaw_rad, std_rad = yaw
        # Not a number contradicts nothing.
        is_askew = abs(yaw_rad) > CONTRADICTION * math.hypot(std_rad, mounting_std)
        return cls(roll, pitch, math.hypot(yaw_rad, std_rad) if is_askew else mounting_std)

    def offset_error_m(self, offset_m: float, by_yaw_m: float) -> float:
        """Return the error of a mounting offset by the yaw.

        Args:
            offset_m: as measured.
            by_yaw_m: its change by a yaw, as a sine, which mixes the lateral axis into that along the belt.
        """
        yaw = min(self.yaw_std_rad, _STEEPEST_RAD)
        return abs(by_yaw_m) * math.tan(yaw) + abs(offset_m) * (1.0 / math.cos(yaw) - 1.0)

    @property
    def mixed(self) -> float:
        """Standard error of a roll by a pitch and a yaw, which turn the axes into each other."""
        return max(abs(self.pitch_rad) * self.yaw_std_rad, HAND_MOUNTED_STD_RAD**2)


@dataclass(frozen=True, slots=True)
class SensorClaims:
    """Statements about one sensor, each with its standard error.

    Attributes:
        offset_m: distance of the sensor below the belt's neutral layer; None when it is not stated.
        offset_std_m: its standard error.
        gain_std: relative standard error of the scale that the hub states.
        zero_g_std_mps2: standard error of its zero.
        along_gain_std: as `gain_std`, of the circumferential axis beside the others.
        lateral_gain_std: likewise of the lateral one.
        lateral_zero_g_std_mps2: standard error of the zero of the lateral axis; None for that of the others.
        nonlinearity_std: standard error of a reading at full scale that a gain does not explain, over full scale.
        rate_std: relative standard error of its sampling rate.
        roll_rad: rotation about the circumferential axis; None when it is not stated.
        roll_std_rad: its standard error.
        bandwidth_hz: end of its band, -3 dB; None when it is not stated.
        lateral_is_left: whether the lateral axis is verified to point to the left.
    """

    offset_m: float | None = None
    offset_std_m: float = HAND_MOUNTED_STD_M
    gain_std: float = GAIN_STD
    zero_g_std_mps2: float = ZERO_G_STD_MPS2
    rate_std: float = RATE_STD
    roll_rad: float | None = None
    roll_std_rad: float = HAND_MOUNTED_STD_RAD
    bandwidth_hz: float | None = None
    lateral_is_left: bool = False
    along_gain_std: float = AXIS_GAIN_STD
    lateral_gain_std: float = AXIS_GAIN_STD
    lateral_zero_g_std_mps2: float | None = None
    nonlinearity_std: float = NONLINEARITY_STD

    @property
    def lateral_zero_mps2(self) -> float:
        """Standard error of the zero of the lateral axis."""
        return self.zero_g_std_mps2 if self.lateral_zero_g_std_mps2 is None else self.lateral_zero_g_std_mps2

    def nonlinear_offset_m(self, steady_mps2: float, full_scale_mps2: float, radius_m: float) -> float:
        """Return the error of the mounting offset that a nonlinear radial axis looks like.

        A reading s (1 + q s / F) of full scale F is that of a sensor q R Omega^2 / F of the radius above its place, as
        both go with the square of the curvature. It is 0 where the full scale is not known.
        """
        share = steady_mps2 / full_scale_mps2 if full_scale_mps2 > 0.0 else 0.0
        return self.nonlinearity_std * min(share, 1.0) * radius_m
