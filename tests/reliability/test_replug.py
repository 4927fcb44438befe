"""A hub that is unplugged and plugged in again, on a real pseudo-terminal, through the whole session."""

from __future__ import annotations

from pathlib import Path

import pytest

from gateway.clock import SystemClock
from gateway.config.vehicle import parse_vehicle
from gateway.io.source import open_source
from gateway.session.core import SessionCore
from gateway.session.live import LiveSession
from gateway.views.session_summary import ResultSummary
from tests.reliability.streams import chunks_of, simulated
from tests.testkit.hub_ends import PtyPort

TIMEOUT_S = 20.0


@pytest.fixture
def port(tmp_path: Path):
    end = PtyPort(tmp_path / "ttyHUB")
    yield end
    end.close()


def until(live: LiveSession, seen: list[str], words: str) -> str:
    """Wait for a notice."""
    for _ in range(round(TIMEOUT_S / 0.02)):
        seen += live.notices()
        for text in seen:
            if words in text:
                return text
        assert not live.wait(0.02), seen
    raise AssertionError(f"not told: {words}; told: {seen}")


def test_unplugged_and_plugged_in_again(port: PtyPort) -> None:
    items, toml = simulated("sim:lab?speed=max&duration=12&seed=4")
    chunks = [chunk.data for chunk in chunks_of(items)]
    half = len(chunks) // 2
    core = SessionCore(parse_vehicle(toml, "lab"))
    source = open_source(f"serial://{port.path}", SystemClock())
    live = LiveSession([source], core, SystemClock(), patient=[False], summary=ResultSummary())
    live.start()
    seen: list[str] = []
    until(live, seen, "is open")
    for chunk in chunks[:half]:
        port.send(chunk)
    while live.snapshot().wheels[0].counters.revolutions < 45:
        assert not live.wait(0.02)
    port.unplug()
    assert "Plug the hub in again" in until(live, seen, "went away")
    until(live, seen, "there is no port")
    assert any(alarm.name == "link" for alarm in live.snapshot().alarms) or not live.wait(0.2)
    port.plug()
    assert "is back after" in until(live, seen, "is back after")
    before = live.snapshot().wheels[0].counters.revolutions
    for chunk in chunks[half:]:
        port.send(chunk)
    while live.snapshot().wheels[0].counters.revolutions < before + 40:
        assert not live.wait(0.02)
    live.request_stop()
    snapshot = live.close()
    assert snapshot.links[0].crc_errors <= 1
    assert snapshot.links[0].duplicates == 0
    assert sum("went away" in text for text in seen) == 1


def test_a_hub_that_restarts_meanwhile_is_taken_up_again(port: PtyPort) -> None:
    items, toml = simulated("sim:lab?speed=max&duration=10&seed=4&fault=reboot:at=5,gap=1")
    core = SessionCore(parse_vehicle(toml, "lab"))
    source = open_source(f"serial://{port.path}", SystemClock())
    live = LiveSession([source], core, SystemClock(), patient=[False], summary=ResultSummary())
    live.start()
    seen: list[str] = []
    until(live, seen, "is open")
    for chunk in chunks_of(items):
        port.send(chunk.data)
    assert "hub 0 has restarted" in until(live, seen, "has restarted")
    while live.snapshot().wheels[0].counters.revolutions < 60:
        assert not live.wait(0.02)
    live.request_stop()
    snapshot = live.close()
    assert snapshot.links[0].frames_lost == 0
