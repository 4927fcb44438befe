"""Readings of a sensor that no tire can have, which nothing may rest on."""

from typing import Final

from firmware_protocol.messages import Environment
from gateway.core.constants import TIRE_DEGC

# A vacuum, and ten times the pressure of a truck tire.
_PRESSURE_PA: Final = (-101_325.0, 1e7)


def is_possible_pressure(pressure_pa: float) -> bool:
    """Return whether a tire can have this gauge pressure."""
    return _PRESSURE_PA[0] <= pressure_pa <= _PRESSURE_PA[1]


def is_possible_temperature(temperature_degc: float) -> bool:
    """Return whether the inner liner of a tire can have this temperature."""
    return TIRE_DEGC[0] <= temperature_degc <= TIRE_DEGC[1]


def possible_reading(reading: Environment) -> Environment | None:
    """Return a reading without an impossible temperature; None where its pressure is impossible.

    The last possible pressure then grows old, which the estimates that rest on it say.
    """
    if reading.pressure_pa is not None and not is_possible_pressure(reading.pressure_pa):
        return None
    if reading.temperature_degc is not None and not is_possible_temperature(reading.temperature_degc):
        return reading._replace(temperature_degc=None)
    return reading
