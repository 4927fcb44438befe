"""The schema of the revolution topic lists every field that a session records."""

import itertools
import math
from pathlib import Path

import numpy as np
import pytest

from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.estimator import TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.registry import ESTIMATORS, make_estimator
from gateway.core.reasons import Reason
from gateway.core.recording.reader import RecordingInfo
from gateway.core.recording.revolution_fields import estimate_descriptions
from gateway.core.recording.schemas import schema_of
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.session.recording_pass import OpenedRecording
from gateway.core.text.recording_topics import revolution_payload
from gateway.exporting.recorded_signals import revolutions
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from gateway.simulator.simulation import simulate
from tests.testkit.revolution_data import make_revolution, settled

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
# What the estimates of the slip angle and of the laminate need.
STATED = Path(__file__).with_name("all_estimates.toml").read_text()


class Held:
    info = RecordingInfo(Path("held"), size_bytes=0, finished=True)

    def __init__(self, items):
        self._items = list(items)

    def items(self):
        yield from self._items


@pytest.fixture(scope="module")
def payloads():
    scenario = parse_scenario(SCENARIO, "test")
    items = Held(simulate(scenario, duration_s=0.8).chunks("sim:test", 10**18))
    vehicle = parse_vehicle(vehicle_toml(scenario) + STATED, "test")
    # The forward model needs seconds.
    results = revolutions(OpenedRecording(items, vehicle), [name for name in ESTIMATORS if name != "forward"])
    return [revolution_payload(result) for result in itertools.islice(results, 3)]


def test_every_recorded_field_is_listed(payloads):
    listed = schema_of("/wheel/FL/revolution").schema["properties"]
    recorded = set().union(*payloads)
    assert recorded - set(listed) == set()
    statuses = {name for name in recorded if name.endswith("_status")}
    of_forward = {f"forward:{name}_status" for name in estimate_descriptions(["forward"])}
    of_forward |= {name.removeprefix("forward:") for name in of_forward}
    assert {name for name in listed if name.endswith("_status")} - statuses - of_forward == set()


def test_estimates_of_the_forward_model_are_listed():
    wave = np.cos(angle_grid())
    revolution = make_revolution(wave, edges=(-0.2, 0.2), faults=(Reason(EstimateCode.SAMPLES_LOST),))
    made = make_estimator("forward").update(revolution, settled(revolution, 1), TireConditions(radius_m=math.nan))
    assert {estimate.name.replace("/", "_over_") for estimate in made} == set(estimate_descriptions(["forward"]))


def test_recorded_values_have_the_listed_types(payloads):
    listed = schema_of("/wheel/FL/revolution").schema["properties"]
    types = {"number": (int, float), "integer": int, "string": str, "array": list}
    for name, value in payloads[-1].items():
        assert isinstance(value, types[listed[name]["type"]]), name
