"""What is stated about a sensor and how well it is known."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

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
LOAD_STD: Final = 0.1
"""Relative standard error of a wheel load that was not weighed: passengers and luggage, and left against right."""
PRESSURE_STD: Final = 0.05
"""Relative standard error of a gauge pressure. A sensor measures an absolute one within 2 %, and weather and altitude
change the ambient pressure that is subtracted by 5 kPa, three times that in the mountains."""


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
    """

    offset_m: float | None = None
    offset_std_m: float = HAND_MOUNTED_STD_M
    gain_std: float = GAIN_STD
    zero_g_std_mps2: float = ZERO_G_STD_MPS2
    rate_std: float = RATE_STD
    roll_rad: float | None = None
    roll_std_rad: float = HAND_MOUNTED_STD_RAD
