"""The alarm of wheels that slip to opposite sides begins live and in batch at the same revolution."""

from collections.abc import Iterator

import pytest

from gateway.config.vehicle import parse_vehicle
from gateway.io.source import Chunk
from gateway.pipeline.wheel_pairs import ALARM
from gateway.session.core import SessionCore
from gateway.session.recording_pass import OpenedRecording, RecordingPass
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from gateway.simulator.simulation import simulate

START_NS = 1_700_000_000_000_000_000
SCENARIO = """
[scenario]
seed = 3
[motion]
speed_kmh = 65.0
[sensor]
noise_mg_rthz = 5.0
[[wheel]]
position = "FL"
wheel = 0
slip_angle_deg = [[0, 0], [2, 1], [6, -1]]
[[wheel]]
position = "FR"
wheel = 1
slip_angle_deg = [[0, 0], [2, -1], [6, 1]]
"""
ESTIMATORS = ("kinematic", "slip-angle")


class Recorded:
    """Chunks in memory."""

    def __init__(self, chunks: list[Chunk]) -> None:
        self._chunks = chunks
        self.position = 0

    def items(self) -> Iterator[Chunk]:
        return iter(self._chunks)


def test_pair_alarm_begins_with_its_revolution() -> None:
    scenario = parse_scenario(SCENARIO, "test")
    chunks = list(simulate(scenario, duration_s=6.0).chunks("sim:test", START_NS))
    vehicle = parse_vehicle(vehicle_toml(scenario), "test")
    core = SessionCore(vehicle, estimators=ESTIMATORS)
    raised: dict[str, float] = {}
    for chunk in chunks:
        core.take(chunk)
        core.tick(chunk.host_ns)
        for change in core.take_alarm_changes():
            if change.alarm.name == ALARM:
                raised.setdefault(change.alarm.position, change.at_s)
    batch = RecordingPass(OpenedRecording(Recorded(chunks), vehicle), ESTIMATORS)
    rows = [result for result in batch if any(alarm.name == ALARM for alarm in result.alarms)]
    recorded = {alarm.position: alarm.first_s for alarm in batch.alarms() if alarm.name == ALARM}
    assert set(recorded) == set(raised) == {"FL", "FR"}
    # Live shows a revolution a little after its end.
    assert recorded == pytest.approx(raised, abs=0.6)
    assert min(recorded.values()) < 5.2
    assert any(row.position == "FR" for row in rows)
