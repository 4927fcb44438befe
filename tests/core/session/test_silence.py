"""Silence of hubs, sensors, parts of their streams and the bus: a state with a time, live and in recordings."""

import threading

import pytest

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Axis, MessageType, SampleBlock
from gateway.core.clock import ManualClock, SystemClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import SilentPart, WheelState
from gateway.core.links.bus_frames import BusFrame, pack
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import BusFrames, Chunk, LinkEvent, LinkEventKind, open_source
from gateway.core.links.time_limit import limited
from gateway.core.reasons import Reason, codes_of
from gateway.core.recording.inspection import inspect_recording
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.alarms import AlarmName
from gateway.core.session.core import SessionCore
from gateway.core.session.live import LiveSession, Recordings
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.core.session.silence import Limit, SilenceWatch, _Stream
from gateway.core.text.wording import text
from gateway.core.wheels.reasons import WheelCode
from tests.testkit.waiting import TIMEOUT_S

S = 1_000_000_000
FEW = ("kinematic",)
START_NS = 1_700_000_000_000_000_000


def lab(fault="", duration_s=14, scenario="lab"):
    """Return the items of a simulated wheel and its vehicle."""
    suffix = f"&fault={fault}" if fault else ""
    source = open_source(f"sim:{scenario}?speed=max&duration={duration_s}&seed=4{suffix}", ManualClock(START_NS))
    items = list(source.items(threading.Event()))
    return items[:-1], parse_vehicle(source.vehicle_toml, "lab")


def run(items, vehicle, **kwargs):
    core = SessionCore(vehicle, estimators=FEW, **kwargs)
    for item in items:
        core.take(item)
    return core


def changed(items, change):
    """Return items with every frame replaced by the frames that `change` returns."""
    decoder, remaining = FrameDecoder(), []
    for item in items:
        if not isinstance(item, Chunk):
            remaining.append(item)
            continue
        frames = [new for frame in decoder.feed(item.data) for new in change(frame, (item.host_ns - START_NS) / S)]
        if frames:
            remaining.append(Chunk(item.link, item.host_ns, b"".join(map(encode_frame, frames))))
    return remaining


def alarms_of(core: SessionCore) -> dict[tuple[str, str], Reason]:
    return {(alarm.position, alarm.name): alarm.reason for alarm in core.snapshot(0.0).alarms}


@pytest.fixture(scope="module")
def hub():
    return lab(duration_s=6)


def test_stopped_hub_shows_no_live_numbers(hub) -> None:
    items, vehicle = hub
    core = run(items, vehicle)
    before = core.snapshot(0.0)
    assert before.wheels[0].state is WheelState.ROLLING
    assert before.links[0].latency_s is not None
    last_ns = items[-1].host_ns
    for tenth in range(201):
        core.tick(last_ns + tenth * S // 10)
    after = core.snapshot(0.0)
    (wheel,), (link,) = after.wheels, after.links
    assert wheel.state is WheelState.SILENT
    assert wheel.silence.part is SilentPart.HUB
    assert wheel.silence.age_s == pytest.approx(20.0, abs=0.1)
    assert link.silent_s == pytest.approx(20.0, abs=0.1)
    assert link.latency_s is None
    reason = alarms_of(core)["hub 0", AlarmName.SILENT]
    assert reason["wheels"] == ("W1",)
    assert reason["silence_s"] == pytest.approx(20.0, abs=0.1)


def test_silence_is_raised_once_and_its_end_reported(hub) -> None:
    items, vehicle = hub
    gone = [item for item in items if not 2.2 * S < item.host_ns - START_NS < 5.7 * S]
    core = run(gone, vehicle)
    results = [notice.reason for notice in core.take_notices() if notice.subject == "hub 0"]
    raised, over = (reason for reason in results if reason.code is not SessionCode.HUB_LOG)
    assert raised.code is SessionCode.ALARM_RAISED
    # The last message other than samples came at 2 s: 3 s later the hub is known to be silent.
    assert raised["alarm"]["silence_s"] == pytest.approx(2.8, abs=0.05)
    assert over.code is SessionCode.ALARM_CLEARED
    assert over["what"].code is SessionCode.SENDS_AGAIN
    assert over["what"]["away_s"] == pytest.approx(3.5, abs=0.15)


def test_samples_that_stop_are_named_although_no_frame_is_lost() -> None:
    items, vehicle = lab("silence:part=2,at=4")
    core = run(items, vehicle)
    snapshot = core.snapshot(0.0)
    assert snapshot.links[0].frames_lost == 0
    assert snapshot.links[0].silent_s is None
    assert snapshot.wheels[0].state is WheelState.SILENT
    assert snapshot.wheels[0].silence.part is SilentPart.SAMPLES
    assert alarms_of(core)["W1", AlarmName.SILENT].code is SessionCode.SAMPLES_SILENT


def test_silence_says_what_to_check_of_the_sensor() -> None:
    assert text(Reason(SessionCode.SAMPLES_MISSING, silence_s=10.2)) == (
        "no samples for 10 s. Check its sensor's battery, distance and antenna"
    )


def test_silent_sensor_is_told_from_a_silent_hub() -> None:
    items, vehicle = lab("silence:part=1,at=4")
    core = run(items, vehicle)
    assert core.snapshot(0.0).wheels[0].silence.part is SilentPart.SENSOR
    assert set(alarms_of(core)) == {("W1", AlarmName.SILENT)}
    assert alarms_of(core)["W1", AlarmName.SILENT].code is SessionCode.SENSOR_SILENT


def test_missing_axis_is_named() -> None:
    items, vehicle = lab(duration_s=6)

    def without_lateral(frame, at_s):
        block = frame.message
        if not isinstance(block, SampleBlock) or at_s < 3.0:
            return [frame]
        return [frame._replace(message=block._replace(axes=0b101, counts=block.counts[:, [0, 2]]))]

    core = run(changed(items, without_lateral), vehicle)
    silence = core.snapshot(0.0).wheels[0].silence
    assert silence.part is SilentPart.AXIS
    assert silence.reason["axis"] == Axis.LATERAL.name.lower()
    assert silence.age_s == pytest.approx(3.0, abs=0.1)


def test_old_pressure_is_named_and_doubts_what_rests_on_it() -> None:
    items, vehicle = lab("silence:part=3,at=3", duration_s=9)
    core = SessionCore(vehicle)
    results = [result for item in items for result in core.take(item)]
    wheel = core.snapshot(0.0).wheels[0]
    assert wheel.state is WheelState.ROLLING
    assert wheel.silence is None
    assert wheel.old_environment.age_s > 5.0
    assert alarms_of(core)["W1", AlarmName.ENVIRONMENT].code is WheelCode.ENVIRONMENT_SILENT
    last = {estimate.name: estimate for estimate in results[-1].estimates}
    assert results[0].conditions.sources == {"load_source": "stated", "pressure_source": "measured"}
    assert results[-1].conditions.sources == results[0].conditions.sources
    assert last["Cw"].status is Status.PROVISIONAL
    assert WheelCode.PRESSURE_OLD in codes_of(last["Cw"].reasons)
    assert last["speed_mps"].status is Status.VALID


def test_standing_wheel_is_not_silent() -> None:
    items, vehicle = lab(scenario="standstill_restart", duration_s=20)
    core, states = SessionCore(vehicle, estimators=FEW), set()
    for number, item in enumerate(items):
        core.take(item)
        if number % 20 == 0:
            states |= {wheel.state for wheel in core.snapshot(0.0).wheels}
    assert WheelState.STANDSTILL in states
    assert WheelState.SILENT not in states
    assert core.snapshot(0.0).alarm_records == ()


def test_sensor_that_never_sends_is_an_alarm() -> None:
    items, vehicle = lab(duration_s=12)
    absent = vehicle.wheel[0].model_copy(update={"position": "W2", "wheel": 1, "sensor_id": None})
    core = run(items, vehicle.model_copy(update={"wheel": (*vehicle.wheel, absent)}))
    assert alarms_of(core)["W2", AlarmName.SILENT].code is SessionCode.SENSOR_NEVER_HEARD
    assert ("W1", AlarmName.SILENT) not in alarms_of(core)


def test_wheel_of_a_lost_link_is_silent(hub) -> None:
    items, vehicle = hub
    core = run([*items, LinkEvent("sim:lab", items[-1].host_ns, LinkEventKind.LOST)], vehicle)
    (wheel,) = core.snapshot(0.0).wheels
    assert wheel.state is WheelState.SILENT
    assert wheel.silence.part is SilentPart.LINK
    assert "connection lost" in text(wheel.silence.reason)


def test_link_that_is_down_has_the_age_of_its_last_frame(hub) -> None:
    items, vehicle = hub
    core = run(items, vehicle)
    last_ns = items[-1].host_ns
    core.take(LinkEvent("sim:lab", last_ns + 2 * S, LinkEventKind.LOST, "unplugged"))
    core.take(LinkEvent("serial:never", last_ns + 4 * S, LinkEventKind.RETRYING, "no such port"))
    core.tick(last_ns + 30 * S)
    ages_s = {link.link: link.silent_s for link in core.snapshot(0.0).links}
    assert ages_s == {"sim:lab": pytest.approx(30.0, abs=0.1), "serial:never": pytest.approx(26.0, abs=0.1)}
    core.take(LinkEvent("sim:lab", last_ns + 31 * S, LinkEventKind.RESTORED))
    assert core.snapshot(0.0).links[0].silent_s is None


def test_silent_hub_of_a_lost_link_is_not_over(hub) -> None:
    items, vehicle = hub
    core = run(items, vehicle)
    core.tick(items[-1].host_ns + 5 * S)
    core.take(LinkEvent("sim:lab", items[-1].host_ns + 6 * S, LinkEventKind.LOST))
    core.tick(items[-1].host_ns + 7 * S)
    assert SessionCode.ALARM_CLEARED not in {notice.reason.code for notice in core.take_notices()}
    assert [(alarm_record.position, alarm_record.is_standing) for alarm_record in core.snapshot(0.0).alarm_records] == [
        ("hub 0", True),
        ("sim:lab", True),
    ]


def test_ended_session_keeps_the_last_numbers(hub) -> None:
    items, vehicle = hub
    core = run([*items, LinkEvent("sim:lab", items[-1].host_ns, LinkEventKind.ENDED)], vehicle)
    core.finish()
    (wheel,) = core.snapshot(0.0, ended=True).wheels
    assert (wheel.state, wheel.silence) == (WheelState.ENDED, None)
    assert wheel.last is not None
    assert core.snapshot(0.0, ended=True).alarm_records == ()


def test_limit_follows_the_pace_of_the_stream() -> None:
    bursts = _Stream(Limit(5.0, 1.0, 0.1), 0)
    for burst in range(12):
        for frame in range(20):
            bursts.arrived(burst * 2 * S + frame * S // 1000)
    assert bursts.limit_ns == 10 * S
    steady = _Stream(Limit(5.0, 1.0, 0.1), 0)
    for frame in range(400):
        steady.arrived(frame * S // 40)
    assert steady.limit_ns == S
    steady.arrived(60 * S)
    assert steady.limit_ns == S, "one silence is not a pace"


def test_time_until_silence_is_configurable(hub) -> None:
    items, vehicle = hub
    limits = vehicle.thresholds.model_copy(update={"silent_after_s": 4.0})
    core = run(items, vehicle.model_copy(update={"thresholds": limits}))
    core.tick(items[-1].host_ns + 7 * S // 2)
    assert core.snapshot(0.0).wheels[0].silences == ()
    core.tick(items[-1].host_ns + 9 * S // 2)
    assert core.snapshot(0.0).wheels[0].state is WheelState.SILENT


def test_links_without_a_time_stand_still(hub) -> None:
    items, vehicle = hub
    core = run(items, vehicle)
    core.tick(items[-1].host_ns + 60 * S, {"sim:lab": items[-1].host_ns})
    core.tick(items[-1].host_ns + 60 * S, {})
    assert core.snapshot(0.0).wheels[0].state is WheelState.ROLLING


def test_times_that_are_set_back_are_no_silence(hub) -> None:
    items, vehicle = hub
    chunks = [item for item in items if isinstance(item, Chunk)]
    half = len(chunks) // 2
    again = [Chunk(chunk.link, chunk.host_ns - 3600 * S, chunk.data) for chunk in chunks[half:]]
    assert run([*chunks[:half], *again], vehicle).snapshot(0.0).alarm_records == ()


def test_link_lost_after_the_last_frame_is_an_alarm_of_its_recording(hub, tmp_path) -> None:
    items, vehicle = hub
    path = tmp_path / "r.mcap"
    core = run(
        [*items, LinkEvent("sim:lab", items[-1].host_ns + 2 * S, LinkEventKind.LOST, "unplugged")],
        vehicle,
        recorder=RecordingWriter(path, start_ns=START_NS, vehicle_toml=vehicle.to_toml()),
    )
    core.finish()
    batch = RecordingPass(OpenedRecording(RecordingReader(path), vehicle), FEW)
    assert list(batch)
    assert ("sim:lab", AlarmName.LINK) in {(record.position, record.name) for record in batch.alarms()}


@pytest.mark.parametrize("part", range(4))
def test_live_replay_and_batch_report_the_same_alarms(part: int, tmp_path) -> None:
    simulated, vehicle = lab(f"silence:part={part},at=2,for=7.5", duration_s=11)
    # Reviews between the frames, as those of a clock, may see a silence earlier.
    items = [item for item in simulated if isinstance(item, LinkEvent) or item.data]
    path = tmp_path / "r.mcap"
    core = run(items, vehicle, recorder=RecordingWriter(path, start_ns=START_NS, vehicle_toml=vehicle.to_toml()))
    core.finish()
    live = core.snapshot(0.0, ended=True).alarm_records
    assert live
    replay = open_source(f"replay:{path}?speed=max", ManualClock()).items(threading.Event())
    played = run(replay, vehicle)
    played.finish()
    batch = RecordingPass(OpenedRecording(RecordingReader(path), vehicle), FEW)
    results = list(batch)
    for others in (played.snapshot(0.0, ended=True).alarm_records, batch.alarms()):
        assert [(other.position, other.name, other.reason.code, other.count) for other in others] == [
            (item.position, item.name, item.reason.code, item.count) for item in live
        ]
        assert [other.first_s for other in others] == pytest.approx([item.first_s for item in live], abs=1e-6)
        assert [other.total_s for other in others] == pytest.approx([item.total_s for item in live], abs=0.2)
    silent_s = max(result.silent_before_s for result in results)
    assert silent_s == pytest.approx(7.5, abs=0.1) if part < 3 else silent_s == 0.0
    if part == 3:
        named = [result for result in results if any(alarm.name == AlarmName.ENVIRONMENT for alarm in result.alarms)]
        assert 0 < len(named) < len(results)


def test_alarm_of_a_frozen_hub_ends_with_a_frame_and_not_with_a_connection(hub) -> None:
    items, vehicle = hub
    core = run(items, vehicle)
    link, at_ns = items[-1].link, items[-1].host_ns

    def ticked(seconds: int) -> None:
        nonlocal at_ns
        for _ in range(10 * seconds):
            at_ns += S // 10
            core.tick(at_ns)

    def silences() -> list[tuple[str, int, bool]]:
        return [
            (record.position, record.count, record.is_standing)
            for record in core.snapshot(0.0).alarm_records
            if record.name == AlarmName.SILENT
        ]

    ticked(20)
    before = silences()
    assert before
    assert all(is_standing for _, _, is_standing in before)
    for _ in range(3):
        core.take(LinkEvent(link, at_ns, LinkEventKind.LOST, ""))
        ticked(2)
        core.take(LinkEvent(link, at_ns, LinkEventKind.CONNECTED))
        ticked(10)
    assert silences() == before
    shift_ns = at_ns + S - items[0].host_ns
    for item in items[: len(items) // 2]:
        if isinstance(item, Chunk):
            core.take(Chunk(link, item.host_ns + shift_ns, item.data))
    assert not any(is_standing for _, _, is_standing in silences())


def test_silent_axis_needs_a_hello() -> None:
    items, vehicle = lab(duration_s=4)
    core = run(changed(items, lambda frame, _: [frame] if frame.type != MessageType.HELLO else []), vehicle)
    assert core.snapshot(0.0).alarm_records == ()


def test_watch_without_frames_is_quiet() -> None:
    watch = SilenceWatch(lambda link, hub, wheel: "W1")
    assert watch.of_wheels() == {}
    assert list(watch.silent_hubs()) == []
    assert watch.silent_s("x") is None
    assert watch.elapsed_s() == 0.0
    watch.turned("x", 0, Reason(LinkCode.LINK_LOST))
    assert list(watch.down_links()) == [("x", Reason(LinkCode.LINK_LOST))]


BUS = "can:virtual:car"


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


def run_ticking(core: SessionCore, items) -> None:
    """Take items with a tick every 0.1 s, as a live session does."""
    tick_ns = 0
    for item in sorted(items, key=lambda item: item.host_ns):
        core.take(item)
        if item.host_ns >= tick_ns:
            tick_ns = item.host_ns + S // 10
            core.tick(item.host_ns)


def test_silent_bus_is_an_alarm_until_frames_come_again(drive) -> None:
    items, vehicle = drive
    core = SessionCore(vehicle, estimators=FEW)
    run_ticking(core, [*items, *blocks(0.0, 3.0)])
    reason = alarms_of(core)[(BUS, "silent")]
    assert reason.code is SessionCode.BUS_SILENT
    assert reason["silence_s"] == pytest.approx(6.0, abs=0.1)
    assert text(reason).startswith("no frame of the vehicle's bus for 6 s")
    of_bus = next(link for link in core.snapshot(0.0).links if link.link == BUS)
    assert of_bus.silent_s == pytest.approx(6.0, abs=0.1)
    run_ticking(core, blocks(9.0, 9.2, is_error=True))
    assert (BUS, "silent") in alarms_of(core), "errors of the bus are no frames"
    core.take(LinkEvent(BUS, START_NS + 9 * S + S // 4, LinkEventKind.LOST, "unplugged"))
    core.tick(START_NS + 9 * S + S // 2)
    core.take_notices()
    core.take(LinkEvent(BUS, START_NS + 9 * S + S // 2, LinkEventKind.RESTORED))
    run_ticking(core, blocks(9.5, 9.8))
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
    run_ticking(core, blocks(0.0, 11.0))
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
    run_ticking(core, RecordingReader(recording).items())
    (live,) = [record for record in core.snapshot(0.0).alarm_records if record.position == BUS]
    batch = RecordingPass(OpenedRecording(RecordingReader(recording), vehicle), FEW)
    assert list(batch)
    (results,) = [record for record in batch.alarms() if record.position == BUS]
    assert (results.name, results.reason.code, results.count, results.is_standing) == (
        "silent",
        SessionCode.BUS_SILENT,
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


@pytest.mark.parametrize(
    "fault", ["silence:part=0,at=1", "silence:part=0,at=1;duplicate:rate=0.5", "reboot:at=1,gap=30"]
)
def test_time_goes_on_in_a_simulated_silence(fault):
    items, vehicle = lab(fault)
    core = run(items, vehicle)
    assert max(item.host_ns for item in items) > START_NS + 13 * S
    (wheel,) = core.snapshot(0.0).wheels
    assert (wheel.state, wheel.silence.part) == (WheelState.SILENT, SilentPart.HUB)
    assert wheel.silence.age_s > 12.0
    assert {alarm.name for alarm in core.snapshot(0.0).alarms} == {AlarmName.SILENT}


def test_simulated_silence_ends_with_its_session_and_leaves_nothing_in_the_recording(tmp_path):
    clock = SystemClock()
    source = open_source("sim:lab?speed=max&fault=silence:part=0,at=1", clock)
    vehicle = parse_vehicle(source.vehicle_toml, "lab")
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=clock.now_ns())
    live = LiveSession(
        [limited(source, 20.0)], SessionCore(vehicle), clock, patient=[True], recordings=Recordings(writer)
    )
    live.start()
    assert live.wait(TIMEOUT_S), "its own time ends an endless simulation"
    (record,) = live.close().alarm_records
    assert (record.name, record.is_standing) == (AlarmName.SILENT, True)
    assert record.reason["silence_s"] > 18.0
    chunks = [item for item in RecordingReader(tmp_path / "r.mcap").items() if isinstance(item, Chunk)]
    assert chunks[-1].host_ns - chunks[0].host_ns < 1.1 * S
    assert all(chunk.data for chunk in chunks)
