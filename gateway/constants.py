"""Physical constants and the names of the sensor's axes."""

from __future__ import annotations

from typing import Final

STANDARD_GRAVITY_MPS2: Final = 9.80665
STANDARD_ATMOSPHERE_PA: Final = 101_325.0
ZERO_CELSIUS_K: Final = 273.15

AXIS_NAMES: Final = ("circumferential", "lateral", "radial")
"""Names of the sensor's axes, in the order of `firmware_protocol.messages.Axis`."""
