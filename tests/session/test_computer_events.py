"""Events of this computer in a session: they are named, recorded and shown, and no link is blamed for them."""

from __future__ import annotations

import threading
import time

import pytest
from click.testing import CliRunner

from gateway.cli import treadlink
from gateway.clock import ManualClock, SystemClock
from gateway.io.source import Chunk, LinkEvent, LinkEventKind
from gateway.reasons import Code, Level, codes_of
from gateway.recording.inspection import inspect_recording
from gateway.recording.reader import RecordingReader
from gateway.recording.writer import RecordingWriter
from gateway.session.computer_watch import ComputerWatch
from gateway.session.core import SessionCore
from gateway.session.live import LiveSession
from gateway.views.session_summary import ResultSummary

S = 1_000_000_000
TIMEOUT_S = 20.0
LINK = "serial:hub"


class HeldClock(ManualClock):
    """A manual clock that sleeps do not move."""

    def sleep_until_ns(self, deadline_ns, stop=None):
        (stop or threading.Event()).wait(0.005)
        return stop is not None and stop.is_set()


class Device:
    """A source that is connected and sends nothing until it is closed."""

    vehicle_toml = None
    link = LINK

    def __init__(self, clock) -> None:
        self._clock = clock
        self._closed = threading.Event()

    def items(self, stop):
        yield LinkEvent(LINK, self._clock.now_ns(), LinkEventKind.CONNECTED)
        yield Chunk(LINK, self._clock.now_ns(), b"\0")
        while not stop.is_set() and not self._closed.is_set():
            self._closed.wait(0.005)

    def close(self) -> None:
        self._closed.set()


def until(condition) -> None:
    """Wait for what another thread does."""
    for _ in range(round(TIMEOUT_S / 0.01)):
        if condition():
            return
        threading.Event().wait(0.01)
    raise AssertionError("did not happen")


@pytest.fixture
def clock() -> HeldClock:
    return HeldClock()


@pytest.fixture
def recorded(clock, tmp_path):
    """A running session of a device, and the path of its recording."""
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, start_ns=clock.now_ns(), sources=[LINK])
    live = LiveSession([Device(clock)], None, clock, patient=[False], summary=ResultSummary(), recorder=writer)
    live.start()
    until(lambda: live.snapshot().links[0].connected)
    yield live, path
    live.close()


def computer_notices(live):
    return [notice for notice in live.notices() if notice.reason.code is Code.LINK_EVENT and notice.subject == ""]


def test_set_system_time_is_reported_recorded_and_inspected(recorded, clock) -> None:
    live, path = recorded
    clock.set_system_time(3600 * S)
    seen = []
    until(lambda: seen.extend(computer_notices(live)) or seen)
    clock.set_system_time(-2 * S)
    until(lambda: seen.extend(computer_notices(live)) or len(seen) == 2)
    live.close()
    assert [notice.level for notice in seen] == [Level.WARNING] * 2
    found = inspect_recording(path)
    events = [event for event in found.events if event.kind is LinkEventKind.COMPUTER]
    assert [dict(event.details[0].values) for event in events] == [
        {"step_s": 3600.0, "ahead_s": 3600.0},
        {"step_s": -2.0, "ahead_s": 3598.0},
    ]
    assert set(found.links) == {LINK}
    printed = CliRunner().invoke(treadlink, ["inspect", str(path)], catch_exceptions=False)
    assert "this computer: its system time was set by +3600.0 s" in printed.output
    core = SessionCore(None)
    for item in RecordingReader(path).items():
        core.take(item)
    assert [notice for notice in core.take_notices() if Code.SYSTEM_TIME_SET in codes_of((notice.reason,))]
    assert [link.link for link in core.snapshot(0.0).links] == [LINK]


def test_small_steps_add_up_and_are_then_reported() -> None:
    clock = ManualClock()
    watch = ComputerWatch(clock)
    for step in range(1, 6):
        clock.set_system_time(S // 10)
        assert bool(watch.events()) == (step == 5)
    assert watch.events() == []


def test_clock_of_the_system_sees_a_step_and_no_pause_between_its_readings(monkeypatch) -> None:
    clock = SystemClock()
    assert abs(clock.computer().ahead_ns) < S // 10
    real, real_monotonic = time.time_ns, time.monotonic_ns
    monkeypatch.setattr(time, "time_ns", lambda: real() + 7 * S)
    assert clock.computer().ahead_ns == pytest.approx(7 * S, abs=S // 10)
    paused_ns = iter([0, 3 * S])
    monkeypatch.setattr(time, "monotonic_ns", lambda: real_monotonic() + next(paused_ns, 3 * S))
    monkeypatch.setattr(time, "time_ns", lambda: real() + 3 * S)
    assert abs(clock.computer().ahead_ns) < S // 10
