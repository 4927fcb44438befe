"""Physical constants and the names of the sensor's axes."""

from typing import Final

STANDARD_GRAVITY_MPS2: Final = 9.80665
STANDARD_ATMOSPHERE_PA: Final = 101_325.0
ZERO_CELSIUS_K: Final = 273.15

TIRE_DEGC: Final = (-70.0, 150.0)
"""Temperatures that the inner liner of a tire can have: rubber reverts above, and no road is colder."""

LATENCY_S: Final = 0.5
"""Longest time that a result waits in a session nobody watches, so that several revolutions are worked on at once."""
LONGEST_LATENCY_S: Final = 2.0
"""Longest such time that can be chosen: less than the memory of the samples."""

AXIS_NAMES: Final = ("circumferential", "lateral", "radial")
"""Names of the sensor's axes, in the order of `firmware_protocol.messages.Axis`."""
