"""Budgets of a vehicle before it has been driven: what its statements add to the errors that a good sensor will have.

A tire that is as stated is simulated, so that nothing but the errors of the statements counts.
"""

from collections.abc import Iterator
from typing import Any, Final

from gateway.core.config.toml_writer import toml_text
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import TreadlinkError
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.quantity_catalogue import CATALOGUE
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.planner.accelerometer import Accelerometer
from gateway.planner.planned_errors import ESTIMATORS, driven
from gateway.planner.uncertainty_budget import REVOLUTIONS, Budget, budgets
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingNotConvergedError
from gateway.simulator.scenario import parse_scenario

MAIN_QUANTITIES: Final = tuple(CATALOGUE[estimator][0].name for estimator in ESTIMATORS)
"""The first quantity of each estimator that is planned."""
SPEED_MPS: Final = 80.0 / 3.6
_USUAL_PA: Final = 2.3e5
# Load over pressure and radius squared, in the middle of what tires carry.
_USUAL_LOAD_NUMBER: Final = 0.22
# A good sensor: the errors are then those of the statements.
_RATE_HZ: Final = 4000.0
_NOISE_MG_RTHZ: Final = 5.0
# Peak over the steady value.
_PEAK: Final = 2.5


class NoTireError(TreadlinkError):
    """No tire is as stated."""


def vehicle_budgets(setup: WheelSetup) -> dict[str, Budget]:
    """Return the budgets of the main quantities of a wheel that a vehicle file describes, driven at `SPEED_MPS`.

    Raises:
        NoTireError: no tire is as stated.
        ConfigError: a value is beyond what can be simulated.
    """
    pressure_pa = setup.pressure_pa or _USUAL_PA
    load_n = setup.load_n or _USUAL_LOAD_NUMBER * pressure_pa * setup.radius_m**2
    numbers = [getattr(setup.tire.reference, name) for name in RING_NUMBERS]
    ring_numbers = numbers if all(number is not None for number in numbers) else TABLE_3_NUMBERS
    tire: dict[str, Any] = {
        "radius_mm": 1e3 * setup.radius_m,
        "reference_pressure_kpa": 1e-3 * (setup.tire.reference.pressure_pa or pressure_pa),
        # The contact of a tire is as stiff as its pressure.
        "tread_stiffness_mpa": 70.0 * pressure_pa / 2.1e5,
        **dict(zip(RING_NUMBERS, map(float, ring_numbers), strict=True)),
    }
    wheel = {"position": setup.position, "wheel": 0, "load_n": load_n, "pressure_kpa": 1e-3 * pressure_pa}
    text = toml_text({"tire": tire, "sensor": {"offset_mm": 1e3 * (setup.sensor.offset_m or 0.0)}, "wheel": [wheel]})
    range_g = _PEAK * SPEED_MPS**2 / setup.radius_m / STANDARD_GRAVITY_MPS2
    sensor = Accelerometer(name="good", range_g=range_g, rate_hz=_RATE_HZ, noise_mg_rthz=_NOISE_MG_RTHZ)
    try:
        _, (drive,) = driven(
            parse_scenario(text, "the vehicle"), sensor, SPEED_MPS, wheels=1, statements=lambda _: setup
        )
    except RingNotConvergedError:
        drive = []
    if not drive:
        raise NoTireError(
            f"no tire with these numbers rolls under {load_n:.0f} N at {1e-3 * pressure_pa:.0f} kPa",
            "Check radius, load and pressure.",
        )
    by_name = {budget.estimate.name: budget for budget in budgets(setup, drive[:REVOLUTIONS])}
    return {name: by_name[name] for name in MAIN_QUANTITIES if name in by_name}


def largest_errors(setup: WheelSetup) -> Iterator[str]:
    """Yield the sentence of each main quantity: its error, the largest part, and which statement makes it better.

    Raises:
        NoTireError: no tire is as stated.
        ConfigError: a value is beyond what can be simulated.
    """
    for budget in vehicle_budgets(setup).values():
        yield f"{budget.summary} (a good sensor at {3.6 * SPEED_MPS:.0f} km/h)"
