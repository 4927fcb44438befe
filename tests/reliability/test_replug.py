"""A hub unplugged and plugged in again, on a pseudo-terminal, through the whole session."""

from pathlib import Path

import pytest

from gateway.core.clock import SystemClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import open_source
from gateway.core.reasons import Code, Notice
from gateway.core.session.core import SessionCore
from gateway.core.session.live import LiveSession
from gateway.core.session.reasons import SessionCode
from gateway.core.text.wording import notice_text
from tests.reliability.streams import chunks_of, simulated
from tests.testkit.hub_ends import PtyPort

TIMEOUT_S = 20.0


@pytest.fixture
def port(tmp_path: Path):
    end = PtyPort(tmp_path / "ttyHUB")
    yield end
    end.close()


def until(live: LiveSession, seen: list[Notice], code: Code) -> Notice:
    """Wait for a notice with a code, at any depth of its reason."""
    for _ in range(round(TIMEOUT_S / 0.02)):
        seen += live.notices()
        for notice in seen:
            if code in codes_in(notice):
                return notice
        assert not live.wait(0.02), seen
    raise AssertionError(f"no notice {code} in {seen}")


def codes_in(notice: Notice) -> list[Code]:
    return [reason.code for reason in notice.reason]


def test_unplugged_hub_is_reconnected(port: PtyPort) -> None:
    items, toml = simulated("sim:lab?speed=max&duration=12&seed=4")
    chunks = [chunk.data for chunk in chunks_of(items)]
    half = len(chunks) // 2
    source = open_source(f"serial://{port.path}", SystemClock())
    vehicle = parse_vehicle(toml, "lab")
    live = LiveSession([source], SessionCore(vehicle), SystemClock(), patient=[False])
    live.start()
    seen: list[Notice] = []
    until(live, seen, LinkCode.LINK_CONNECTED)
    for chunk in chunks[:half]:
        port.send(chunk)
    while live.snapshot().wheels[0].counters.revolutions < 45:
        assert not live.wait(0.02)
    port.unplug()
    assert "Plug it in again" in notice_text(until(live, seen, LinkCode.LINK_LOST))
    assert "there is no port" in notice_text(until(live, seen, LinkCode.LINK_RETRYING))
    assert any(alarm.name == "link" for alarm in live.snapshot().alarms) or not live.wait(0.2)
    port.plug()
    assert LinkCode.LINK_AWAY in codes_in(until(live, seen, LinkCode.LINK_RESTORED))
    before = live.snapshot().wheels[0].counters.revolutions
    for chunk in chunks[half:]:
        port.send(chunk)
    while live.snapshot().wheels[0].counters.revolutions < before + 40:
        assert not live.wait(0.02)
    live.request_stop()
    snapshot = live.close()
    assert snapshot.links[0].crc_errors <= 1
    assert snapshot.links[0].duplicates == 0
    assert sum(LinkCode.LINK_LOST in codes_in(notice) for notice in seen) == 1


def test_restarted_hub_is_decoded_again(port: PtyPort) -> None:
    items, toml = simulated("sim:lab?speed=max&duration=10&seed=4&fault=reboot:at=5,gap=1")
    source = open_source(f"serial://{port.path}", SystemClock())
    vehicle = parse_vehicle(toml, "lab")
    live = LiveSession([source], SessionCore(vehicle), SystemClock(), patient=[False])
    live.start()
    seen: list[Notice] = []
    until(live, seen, LinkCode.LINK_CONNECTED)
    for chunk in chunks_of(items):
        port.send(chunk.data)
    assert until(live, seen, SessionCode.HUB_RESTARTED).subject == "hub 0"
    while live.snapshot().wheels[0].counters.revolutions < 60:
        assert not live.wait(0.02)
    live.request_stop()
    snapshot = live.close()
    assert snapshot.links[0].frames_lost == 0
