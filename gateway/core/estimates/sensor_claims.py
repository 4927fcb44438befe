"""What is stated about a sensor and how well it is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

# Standard errors where none is stated. Gain: a sensor calibrated by gravity or on a centrifuge. Zero: after the
# calibration in the hello, which leaves 0.1 g. Rate: the hub's quartz, against the computer's clock.
GAIN_STD: Final = 0.015
ZERO_G_STD_MPS2: Final = 1.0
RATE_STD: Final = 1e-4
HAND_MOUNTED_STD_M: Final = 1e-3
"""Accuracy of an offset that is measured by hand."""
HAND_MOUNTED_STD_RAD: Final = math.radians(1.0)
"""Accuracy of an angle of mounting by hand."""
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


class Tilt(NamedTuple):
    """How a sensor sits askew, as its axes show it.

    Attributes:
        roll_rad: about the circumferential axis.
        pitch_rad: about the lateral axis.
        yaw_std_rad: standard error of the yaw, which nothing measures, beyond that of a sensor mounted by hand.
    """

    roll_rad: float = 0.0
    pitch_rad: float = 0.0
    yaw_std_rad: float = 0.0

    @classmethod
    def of(cls, roll_rad: float, pitch_rad: float) -> Tilt:
        """Return the tilt of measured angles, NaN where one is not measured.

        A sensor that is askew about two axes is so about the third: the yaw is as large as they are.
        """
        has_roll, has_pitch = not math.isnan(roll_rad), not math.isnan(pitch_rad)
        roll, pitch = roll_rad if has_roll else 0.0, pitch_rad if has_pitch else 0.0
        square = (roll * roll + pitch * pitch) / max(has_roll + has_pitch, 1)
        return cls(roll, pitch, math.sqrt(max(square - HAND_MOUNTED_STD_RAD**2, 0.0)))

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
