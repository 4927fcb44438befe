"""Groups with deviations, from the independent simulator through the whole pipeline."""

from collections.abc import Sequence
from functools import lru_cache

from gateway.core.config.validation import parse_document
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.diagnosis.data.campaign_data import Group
from gateway.diagnosis.data.group_statistics import Declared, make_groups
from gateway.diagnosis.data.revolution_orders import RevolutionStore
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate
from tests.testkit.simulated_wheel import results_of

SETUP = WheelSetup("FL", 0, 0, 0.32)


@lru_cache(maxsize=64)
def simulated_groups(
    tables: str = "", speeds_kmh: Sequence[float] = (50.0, 80.0), duration_s: float = 20.0, seed: int = 1
) -> tuple[Group, ...]:
    """Return the groups of one recording per speed, of a scenario's tables."""
    groups: list[Group] = []
    for number, speed in enumerate(speeds_kmh):
        text = (
            f"[scenario]\nseed = {1000 * seed + number}\n[motion]\nspeed_kmh = {speed}\n{tables}\n"
            "[[wheel]]\nposition = 'FL'\nwheel = 0\n"
        )
        simulation = simulate(parse_document(Scenario, text, "test"), duration_s=duration_s)
        store = RevolutionStore()
        for result in results_of(simulation.chunks("link", 10**18), SETUP, ("kinematic",)):
            store.take(result.revolution, result.conditions, result.host_ns)
        groups += make_groups(store.table(), Declared(f"{speed:g} km/h", number, 0.32), 5, store.reject)
    return tuple(groups)
