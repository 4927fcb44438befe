"""A pressure that falls from reading to reading has gone on falling since the latest."""

import math

import pytest

from firmware_protocol.messages import Environment
from gateway.pipeline.old_pressure import change_since_reading_pa
from gateway.pipeline.tire_estimates import TireEstimates
from gateway.pipeline.wheel_setup import WheelSetup

SETUP = WheelSetup("FL", 0, 0, 0.32, load_n=4200.0, pressure_std_pa=1000.0)


def reading(pressure_pa: float | None) -> Environment:
    return Environment(pressure_pa, 30.0, None)


def test_error_of_a_falling_pressure_is_that_of_its_fall_until_the_next_reading() -> None:
    tire = TireEstimates(SETUP, ("kinematic",))
    for second, pressure_pa in enumerate((210e3, 209e3, 197e3, 185e3)):
        tire.environment(1_000_000 * second, reading(pressure_pa), 0.0)
    stds = [tire.conditions(1e6 * at_s).pressure_std_pa for at_s in (0.5, 1.5, 2.5, 3.5)]
    fall = 12e3 / math.sqrt(3.0)
    assert stds == pytest.approx([1000.0, 1000.0, fall, fall])
    # The pressure at the end of each interval is within two of these errors.
    assert 2.0 * fall > 12e3


def test_readings_without_a_pressure_say_nothing_of_its_change() -> None:
    readings = [(3, reading(None), 0.0), (2, reading(200e3), 0.0), (1, reading(None), 0.0), (0, reading(203e3), 0.0)]
    assert change_since_reading_pa(readings) == pytest.approx(3e3 / math.sqrt(3.0))
    assert change_since_reading_pa(readings[:2]) == 0.0
