import threading

import pytest

from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.source import open_source
from tests.testkit.agreement import values_of


@pytest.fixture(scope="session")
def by_wheel():
    def sort(results):
        wheels = {}
        for result in results:
            wheels.setdefault(result.position, []).append(values_of(result))
        return wheels

    return sort


@pytest.fixture(scope="session")
def demo():
    """Items of four simulated wheels on a slightly bad link, and their vehicle."""
    source = open_source(
        "sim:demo?speed=max&duration=4&seed=3&fault=flip:rate=0.005;drop:rate=0.005;duplicate:rate=0.005",
        ManualClock(),
    )
    return list(source.items(threading.Event())), parse_vehicle(source.vehicle_toml, "demo")
