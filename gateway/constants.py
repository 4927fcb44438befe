"""Physical constants and the names of the sensor's axes."""

from __future__ import annotations

from typing import Final

STANDARD_GRAVITY_MPS2: Final = 9.80665
STANDARD_ATMOSPHERE_PA: Final = 101_325.0
ZERO_CELSIUS_K: Final = 273.15

TIRE_DEGC: Final = (-70.0, 150.0)
"""Temperatures that the inner liner of a tire can have: rubber reverts above, and no road is colder."""

AXIS_NAMES: Final = ("circumferential", "lateral", "radial")
"""Names of the sensor's axes, in the order of `firmware_protocol.messages.Axis`."""
