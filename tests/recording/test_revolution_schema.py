"""The schema of the revolution topic lists every field that a session records."""

from __future__ import annotations

import itertools

import pytest

from gateway.config.vehicle import parse_vehicle
from gateway.estimators.registry import ESTIMATORS
from gateway.recording.schemas import TOPICS, schema_of
from gateway.session.recorded_signals import revolutions
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from gateway.simulator.simulation import simulate
from gateway.views.recording_topics import revolution_payload

SCENARIO = """
[scenario]
seed = 3
[sensor]
rate_hz = 3200.0
[[wheel]]
position = "FL"
wheel = 0
load_n = 4000.0
"""


class Held:
    def __init__(self, items):
        self._items = list(items)

    def items(self):
        yield from self._items


@pytest.fixture(scope="module")
def payloads():
    scenario = parse_scenario(SCENARIO, "test")
    items = Held(simulate(scenario, duration_s=0.8).chunks("sim:test", 10**18))
    vehicle = parse_vehicle(vehicle_toml(scenario), "test")
    results = revolutions(items, vehicle, estimators=tuple(ESTIMATORS))
    return [revolution_payload(result) for result in itertools.islice(results, 3)]


def test_every_recorded_field_is_listed(payloads):
    listed = schema_of("/wheel/FL/revolution").schema["properties"]
    recorded = set().union(*payloads)
    assert recorded - set(listed) == set()
    statuses = {name for name in recorded if name.endswith("_status")}
    # The slip angle needs a share of the belt that no configuration states.
    assert {name for name in listed if name.endswith("_status")} - statuses == {"slip_angle_rad_status"}


def test_recorded_values_have_the_listed_types(payloads):
    listed = schema_of("/wheel/FL/revolution").schema["properties"]
    types = {"number": (int, float), "integer": int, "string": str, "array": list}
    for name, value in payloads[-1].items():
        assert isinstance(value, types[listed[name]["type"]]), name


def test_schemas_have_only_types_that_foxglove_takes():
    plain = {"number", "integer", "string", "boolean", "object"}
    for topic in TOPICS:
        for field, schema in topic.schema["properties"].items():
            inner = schema["items"] if schema["type"] == "array" else schema
            assert inner["type"] in plain, f"{topic.name}.{field}"
