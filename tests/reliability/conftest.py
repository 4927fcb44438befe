import pytest

from gateway.core.config.vehicle import VehicleConfig, parse_vehicle
from gateway.core.links.source import LinkItem
from tests.reliability.streams import simulated


@pytest.fixture(scope="session")
def lab() -> tuple[list[LinkItem], VehicleConfig]:
    """Six seconds of a simulated wheel, and its vehicle."""
    items, toml = simulated("sim:lab?speed=max&duration=6&seed=4")
    return items, parse_vehicle(toml, "lab")
