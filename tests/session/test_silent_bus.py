"""Silence of a vehicle bus: an alarm as that of a hub, live and in recordings, and a gap in the inspection."""

import threading

import pytest

from gateway.clock import ManualClock
from gateway.config.vehicle import parse_vehicle
from gateway.io.bus_frames import BusFrame, pack
from gateway.io.source import BusFrames, LinkEvent, LinkEventKind, open_source
from gateway.reasons import Code, Reason, codes_of
from gateway.recording.inspection import inspect_recording
from gateway.recording.reader import RecordingReader
from gateway.recording.writer import RecordingWriter
from gateway.session.core import SessionCore
from gateway.session.recording_pass import OpenedRecording, RecordingPass
from gateway.views.wording import text

S = 1_000_000_000
START_NS = 1_700_000_000_000_000_000
BUS = "can:virtual:car"
FEW = ("kinematic",)


def block(at_ns: int, **kind: bool) -> BusFrames:
    return BusFrames(BUS, at_ns, pack([BusFrame(at_ns, 291, False, bytes(8), **kind)], at_ns))


def blocks(begin_s: float, end_s: float, **kind: bool) -> list[BusFrames]:
    return [
        block(START_NS + hundredth * S // 100, **kind) for hundredth in range(round(begin_s * 100), round(end_s * 100))
    ]


@pytest.fixture(scope="module")
def drive():
    """Items of a wheel for 9 s and its vehicle."""
    source = open_source("sim:lab?speed=max&duration=9&seed=4", ManualClock(START_NS))
    items = list(source.items(threading.Event()))[:-1]
    return items, parse_vehicle(source.vehicle_toml, "lab")


def run(core: SessionCore, items) -> None:
    """Take items with a tick every 0.1 s, as a live session does."""
    tick_ns = 0
    for item in sorted(items, key=lambda item: item.host_ns):
        core.take(item)
        if item.host_ns >= tick_ns:
            tick_ns = item.host_ns + S // 10
            core.tick(item.host_ns)


def alarms_of(core: SessionCore) -> dict[tuple[str, str], Reason]:
    return {(alarm.position, alarm.name): alarm.reason for alarm in core.snapshot(0.0).alarms}


def test_silent_bus_is_an_alarm_until_frames_come_again(drive) -> None:
    items, vehicle = drive
    core = SessionCore(vehicle, estimators=FEW)
    run(core, [*items, *blocks(0.0, 3.0)])
    reason = alarms_of(core)[(BUS, "silent")]
    assert reason.code is Code.BUS_SILENT
    assert reason["silence_s"] == pytest.approx(6.0, abs=0.1)
    assert text(reason).startswith("no frame of the vehicle's bus for 6 s")
    of_bus = next(link for link in core.snapshot(0.0).links if link.link == BUS)
    assert of_bus.silent_s == pytest.approx(6.0, abs=0.1)
    run(core, blocks(9.0, 9.2, is_error=True))
    assert (BUS, "silent") in alarms_of(core), "errors of the bus are no frames"
    core.take(LinkEvent(BUS, START_NS + 9 * S + S // 4, LinkEventKind.LOST, "unplugged"))
    core.tick(START_NS + 9 * S + S // 2)
    core.take_notices()
    core.take(LinkEvent(BUS, START_NS + 9 * S + S // 2, LinkEventKind.RESTORED))
    run(core, blocks(9.5, 9.8))
    assert (BUS, "silent") not in alarms_of(core)
    (record,) = [
        record for record in core.snapshot(0.0).alarm_records if (record.position, record.name) == (BUS, "silent")
    ]
    assert record.count == 1, "a lost link tells nothing new of its bus"
    assert record.first_s == pytest.approx(6.0, abs=0.2)


def test_frames_of_a_bus_are_no_sign_that_a_sensor_was_never_heard(drive) -> None:
    _, vehicle = drive
    core = SessionCore(vehicle, estimators=FEW)
    core.take(LinkEvent("serial:x", START_NS, LinkEventKind.LOST, "unplugged"))
    run(core, blocks(0.0, 11.0))
    assert not [codes_of((reason,)) for (position, _), reason in alarms_of(core).items() if position == "FL"]


@pytest.fixture
def recording(drive, tmp_path):
    items, _ = drive
    path = tmp_path / "bus.mcap"
    writer = RecordingWriter(path, start_ns=START_NS, sources=["sim:lab", BUS])
    for item in sorted([*items, *blocks(0.0, 3.0), *blocks(8.0, 8.1)], key=lambda item: item.host_ns):
        writer.write(item)
    writer.close()
    return path


def test_recording_has_the_alarm_of_the_session(drive, recording) -> None:
    _, vehicle = drive
    core = SessionCore(vehicle, estimators=FEW)
    run(core, RecordingReader(recording).items())
    (live,) = [record for record in core.snapshot(0.0).alarm_records if record.position == BUS]
    batch = RecordingPass(OpenedRecording(RecordingReader(recording), vehicle), FEW)
    assert list(batch)
    (results,) = [record for record in batch.alarms() if record.position == BUS]
    assert (results.name, results.reason.code, results.count, results.is_standing) == (
        "silent",
        Code.BUS_SILENT,
        1,
        False,
    )
    assert (results.first_s, results.total_s) == pytest.approx((live.first_s, live.total_s), abs=0.2)
    assert results.first_s == pytest.approx(6.0, abs=0.2)


def test_gap_reaches_to_the_end_of_the_recording(recording, drive, tmp_path) -> None:
    assert inspect_recording(recording).links[BUS].longest_silence_s == pytest.approx(5.01, abs=0.001)
    items, _ = drive
    bus = [*blocks(0.0, 3.0), *blocks(3.0, 9.0, is_error=True)]
    path = tmp_path / "silent.mcap"
    for end, silence_s in (([], 6.0), ([LinkEvent(BUS, START_NS + 9 * S, LinkEventKind.ENDED)], 0.01)):
        writer = RecordingWriter(path, start_ns=START_NS, sources=["sim:lab", BUS])
        for item in sorted([*items, *(bus if not end else blocks(0.0, 3.0)), *end], key=lambda item: item.host_ns):
            writer.write(item)
        writer.close()
        assert inspect_recording(path).links[BUS].longest_silence_s == pytest.approx(silence_s, abs=0.05)
        path.unlink()
