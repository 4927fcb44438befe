"""Events of this computer in a session: they are named, recorded and shown, and no link is blamed for them."""

import threading
import time
from dataclasses import replace

import pytest
from click.testing import CliRunner

from gateway.core.cli import treadlink
from gateway.core.clock import ComputerTime, ManualClock, SystemClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, open_source
from gateway.core.reasons import Level, Reason, codes_of
from gateway.core.recording.inspection import inspect_recording
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.computer_watch import ComputerWatch
from gateway.core.session.core import SessionCore
from gateway.core.session.live import LiveSession, Recordings
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.core.text.wording import notice_text
from gateway.fleet.history_reading import read_histories
from tests.testkit.commands import invoked
from tests.testkit.waiting import TIMEOUT_S, HeldClock, until

S = 1_000_000_000
START_NS = 1_700_000_000_000_000_000
LINK = "serial:hub"


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


class Sending(Device):
    """A device that sends some items and then nothing until it is closed."""

    link = "sim:lab"

    def __init__(self, items) -> None:
        self._items = items
        self._closed = threading.Event()
        self.waits = threading.Event()

    def items(self, stop):
        yield from self._items
        self.waits.set()
        self._closed.wait(TIMEOUT_S)


@pytest.fixture
def clock() -> HeldClock:
    return HeldClock()


@pytest.fixture
def recorded(clock, tmp_path):
    """A running session of a device, and the path of its recording."""
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, start_ns=clock.now_ns(), sources=[LINK])
    live = LiveSession([Device(clock)], SessionCore(None), clock, patient=[False], recordings=Recordings(writer))
    live.start()
    until(lambda: live.snapshot().links[0].connected)
    yield live, path
    live.close()


def computer_notices(live):
    return [notice for notice in live.notices() if notice.reason.code is LinkCode.LINK_EVENT and notice.subject == ""]


def test_set_system_time_is_reported_recorded_and_inspected(recorded, clock) -> None:
    live, path = recorded
    clock.set_system_time(3600 * S)
    seen = []
    until(lambda: seen.extend(computer_notices(live)) or seen)
    clock.set_system_time(-2 * S)
    until(lambda: seen.extend(computer_notices(live)) or len(seen) == 2)
    live.close()
    assert [notice.level for notice in seen] == [Level.WARNING] * 2
    result = inspect_recording(path)
    events = [event for event in result.events if event.kind is LinkEventKind.COMPUTER]
    assert [dict(event.details[0].values) for event in events] == [
        {"step_s": 3600.0, "ahead_s": 3600.0},
        {"step_s": -2.0, "ahead_s": 3598.0},
    ]
    assert set(result.links) == {LINK}
    printed = CliRunner().invoke(treadlink, ["inspect", str(path)], catch_exceptions=False)
    assert "this computer: its system time jumped by +3600.0 s" in printed.output
    core = SessionCore(None)
    for item in RecordingReader(path).items():
        core.take(item)
    assert [notice for notice in core.take_notices() if LinkCode.SYSTEM_TIME_SET in codes_of((notice.reason,))]
    assert [link.link for link in core.snapshot(0.0).links] == [LINK]


def test_small_steps_add_up_and_are_then_reported() -> None:
    clock = ManualClock()
    watch = ComputerWatch(clock)
    for step in range(1, 6):
        clock.set_system_time(S // 10)
        assert bool(watch.events()) == (step == 5)
    assert watch.events() == []


@pytest.mark.parametrize("rate", [500e-6, -500e-6, 0.08])
def test_time_that_a_service_slews_is_no_jump(rate: float) -> None:
    class SlewedClock(ManualClock):
        def computer(self) -> ComputerTime:
            return super().computer()._replace(now_ns=self.now_ns())

    clock, told = SlewedClock(), []
    watch = ComputerWatch(clock)
    for _ in range(12_000):
        clock.advance_ns(S // 5)
        clock.set_system_time(round(rate * S / 5))
        told += [detail for event in watch.events() for detail in event.details]
    assert {detail.code for detail in told} == {LinkCode.SYSTEM_TIME_SLEWED}
    assert told[-1]["ahead_s"] == pytest.approx(rate * 2400.0, abs=0.6)
    assert told[0]["span_s"] == pytest.approx(0.5 / abs(rate), rel=0.05)
    clock.set_system_time(3600 * S)
    assert [detail.code for event in watch.events() for detail in event.details] == [LinkCode.SYSTEM_TIME_SET]


def test_a_change_of_the_system_time_places_the_recording_in_estimates_and_datasets(tmp_path) -> None:
    path, dataset = tmp_path / "drive.mcap", tmp_path / "dataset"
    items, vehicle = frames_until(3.0)
    writer = RecordingWriter(path, start_ns=START_NS, vehicle_toml=vehicle.to_toml())
    for number, item in enumerate(items):
        if number == len(items) // 2:
            step = Reason(LinkCode.SYSTEM_TIME_SET, step_s=4_838_400.0, ahead_s=4_838_400.0)
            writer.write(LinkEvent("", item.host_ns, LinkEventKind.COMPUTER, details=(step,)))
        writer.write(item)
    writer.close()
    printed = CliRunner().invoke(treadlink, ["estimate", str(path), "--estimator", "kinematic"], catch_exceptions=False)
    assert "this computer: its system time jumped by +4838400.0 s" in printed.output
    order = ["campaign", str(path), "--out", str(dataset), "--jobs", "1", "--estimator", "kinematic"]
    assert CliRunner().invoke(treadlink, order, catch_exceptions=False).exit_code == 0
    (history,) = read_histories(dataset).tires
    assert history.time_ns.tolist() == [START_NS + 4_838_400 * S]


@pytest.mark.skipif(not hasattr(time, "tzset"), reason="this system has no time zone of a process")
def test_no_view_changes_with_the_time_zone_or_at_the_end_of_summer_time(tmp_path, monkeypatch) -> None:
    # Summer time ends in Berlin at 01:00 UTC, within this recording.
    change_ns = 1_792_890_000 * S
    items, vehicle = frames_until(2.0)
    writer = RecordingWriter(tmp_path, start_ns=change_ns - S, vehicle_toml=vehicle.to_toml())
    path = writer.path
    assert path.name == "treadlink-20261025T005959Z.mcap"
    for item in items:
        writer.write(replace(item, host_ns=item.host_ns - START_NS + change_ns - S))
    writer.close()
    orders = (["inspect"], ["estimate", "--estimator", "kinematic", "--csv", "-"], ["export", "-", "--format", "csv"])
    shown = {}
    for zone in ("UTC0", "CET-1CEST,M3.5.0,M10.5.0/3"):
        monkeypatch.setenv("TZ", zone)
        time.tzset()
        runs = [invoked(command, path, *rest) for command, *rest in orders]
        assert [run.exit_code for run in runs] == [0, 0, 0], [run.stderr for run in runs]
        shown[zone] = [run.stdout for run in runs]
    monkeypatch.undo()
    time.tzset()
    ours, theirs = shown.values()
    assert ours == theirs
    assert "2026-10-25T00:59:59" in ours[0]
    assert "2026-10-25T01:00:00" in ours[1]


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


def frames_until(end_s: float):
    """Return the items of a simulated wheel up to a time, and its vehicle."""
    source = open_source("sim:lab?speed=max&duration=6&seed=4", ManualClock(START_NS))
    items = [item for item in list(source.items(threading.Event()))[:-1] if item.host_ns < START_NS + end_s * S]
    return items, parse_vehicle(source.vehicle_toml, "lab")


def paused_event(host_ns: int, pause_s: float) -> LinkEvent:
    detail = Reason(LinkCode.COMPUTER_PAUSED, paused_s=pause_s)
    return LinkEvent("", host_ns, LinkEventKind.COMPUTER, details=(detail,))


def test_pause_of_this_computer_is_named_and_no_silence() -> None:
    items, vehicle = frames_until(3.0)
    held_clock = HeldClock(items[-1].host_ns)
    source = Sending(items)
    live = LiveSession([source], SessionCore(vehicle), held_clock, patient=[False])
    live.start()
    until(lambda: source.waits.is_set() and not live._items)
    held_clock.pause_computer(20 * S)
    notices = []
    until(
        lambda: (
            notices.extend(live.notices()) or any(LinkCode.COMPUTER_PAUSED in codes_of((n.reason,)) for n in notices)
        )
    )
    before_s = live.snapshot().elapsed_s
    until(lambda: held_clock.advance_ns(S // 100) or live.snapshot().elapsed_s > before_s + 0.2)
    assert live.snapshot().alarms == ()
    assert live.snapshot().alarm_records == ()
    until(lambda: held_clock.advance_ns(S // 10) or live.snapshot().alarms)
    source.close()
    (record,) = live.close().alarm_records
    assert record.name == "silent", "a hub that sends nothing after the pause is silent"
    (words,) = [notice_text(notice) for notice in notices if LinkCode.COMPUTER_PAUSED in codes_of((notice.reason,))]
    assert words.startswith("this computer: it paused for 20.0 s")


def test_pause_is_told_from_work_and_from_short_delays() -> None:
    class Scripted(ManualClock):
        times = iter(
            ComputerTime(0, *entry)
            for entry in ((0, 0, 0), (S // 2, 0, 0), (4 * S, 3 * S, 0), (6 * S, 3 * S, 0), (6 * S, 3 * S, 60 * S))
        )

        def computer(self):
            return next(self.times)

    watch = ComputerWatch(Scripted())
    assert watch.events() == []
    assert watch.events() == [], "3 s of work"
    ((pause,),) = [event.details for event in watch.events()]
    assert dict(pause.values) == pytest.approx({"paused_s": 2.0})
    ((suspension,),) = [event.details for event in watch.events()]
    assert dict(suspension.values) == pytest.approx({"suspended_s": 60.0})
    assert paused_event(START_NS, 2.0).pause_ns == 2 * S
    assert LinkEvent("", START_NS, LinkEventKind.COMPUTER, details=(suspension,)).pause_ns == 0


@pytest.mark.parametrize("is_named", [True, False])
def test_recording_with_a_pause_blames_no_hub(is_named, tmp_path) -> None:
    items, vehicle = frames_until(6.0)
    path = tmp_path / "r.mcap"
    writer = RecordingWriter(path, start_ns=START_NS, sources=["sim:lab"])
    middle_ns, pause_ns = START_NS + 3 * S, 5 * S
    before = [item for item in items if item.host_ns < middle_ns]
    after = [replace(item, host_ns=item.host_ns + pause_ns) for item in items if item.host_ns >= middle_ns + S // 2]
    event = [paused_event(middle_ns + pause_ns, 5.0)] if is_named else []
    for item in [*before, *event, *after]:
        writer.write(item)
    writer.close()
    core = SessionCore(vehicle, estimators=("kinematic",))
    batch = RecordingPass(OpenedRecording(RecordingReader(path), vehicle), ("kinematic",))
    for item in RecordingReader(path).items():
        core.take(item)
    assert list(batch)
    for records in (core.snapshot(0.0).alarm_records, batch.alarms()):
        assert bool(records) != is_named


def test_what_was_silent_before_a_pause_stays_so() -> None:
    items, vehicle = frames_until(2.0)
    core = SessionCore(vehicle, estimators=("kinematic",))
    for item in items:
        core.take(item)
    core.tick(START_NS + 8 * S)
    core.take(paused_event(START_NS + 12 * S, 4.0))
    core.tick(START_NS + 12 * S)
    assert [alarm.name for alarm in core.snapshot(0.0).alarms] == ["silent"]
    (record,) = core.snapshot(0.0).alarm_records
    assert record.count == 1


def test_what_was_read_before_a_pause_and_taken_after_it_is_no_silence() -> None:
    items, vehicle = frames_until(3.0)
    core = SessionCore(vehicle, estimators=("kinematic",))
    for item in items[:-1]:
        core.take(item)
    resumed_ns = items[-1].host_ns + 10 * S
    core.take(paused_event(resumed_ns, 10.0))
    core.take(items[-1])
    core.tick(resumed_ns + S // 10)
    assert core.snapshot(0.0).alarm_records == ()
    core.tick(resumed_ns + 5 * S)
    assert [record.name for record in core.snapshot(0.0).alarm_records] == ["silent"]
