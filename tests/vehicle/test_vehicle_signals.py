"""Signals of the vehicle's bus: recorded beside the wheels, joined to revolutions, witnesses for rate and radius."""

import csv
import itertools
import json
import math
import threading
from dataclasses import replace
from pathlib import Path

import can
import pytest

from gateway.core.clock import ManualClock, SystemClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import ConfigError, SourceError
from gateway.core.links.bus_frames import BusFrame, pack, unpack
from gateway.core.links.source import BusFrames, LinkEventKind, is_live, open_source
from gateway.core.reasons import codes_of
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.core.text.wording import text
from gateway.core.trust.reasons import TrustCode
from gateway.vehicle.bus_decoding import BusDecoder
from gateway.vehicle.reasons import VehicleCode
from gateway.vehicle.signal_decoding import SignalDecoder, open_decoder
from gateway.vehicle.vehicle_signals import (
    RECEIVER_SIGNALS,
    Quantity,
    SignalHistory,
    SignalSetup,
    VehicleSignal,
)
from tests.testkit import vehicle_bus
from tests.testkit.commands import invoked, run
from tests.testkit.vehicle_bus import DBC, angle_rad, blocks, frames, merged, with_signals

SPEED_MPS = 65.0 / 3.6
FAST = ("kinematic",)


class Recorded:
    def __init__(self, items) -> None:
        self._items = items

    def items(self):
        return iter(self._items)


@pytest.fixture(scope="module")
def wheel():
    """Items of one simulated wheel, its configuration, and its position."""
    source = open_source("sim:lab?speed=max&duration=3.5&seed=2", ManualClock())
    items = list(source.items(threading.Event()))
    vehicle = parse_vehicle(source.vehicle_toml, "lab")
    return items, source.vehicle_toml, vehicle.wheel[0].position, vehicle.tire_of(vehicle.wheel[0]).radius_m


def drive(wheel, quantities=None, **false):
    """Return the items of wheel and bus, and the configuration, which maps all signals or some."""
    items, toml, position, radius_m = wheel
    omega = SPEED_MPS / radius_m
    result = frames(items[0].host_ns, items[-1].host_ns, omega, SPEED_MPS, **false)
    return merged(items, blocks(result)), with_signals(toml, position, quantities)


def decoder(vehicle) -> SignalDecoder:
    result = open_decoder(vehicle, None, [DBC.read_text()], [])
    assert result is not None
    return result


def estimated(items, vehicle):
    return list(RecordingPass(OpenedRecording(Recorded(items), vehicle), FAST, signals=decoder(vehicle)))


def values(result):
    return {estimate.name: estimate for estimate in result.estimates}


def test_revolutions_get_the_signals_of_their_time(wheel) -> None:
    items, vehicle = drive(wheel)
    results = estimated(items, vehicle)
    begin_ns = items[0].host_ns
    assert len(results) > 20
    for result in results[2:]:
        estimates = values(result)
        middle_s = (result.host_ns - begin_ns) * 1e-9 - 0.5 * result.revolution.period_s
        # Angle each 20 ms: interpolation of a sine of 0.4 Hz, one count of 0.04 deg.
        assert estimates["steering_angle_rad"].value == pytest.approx(angle_rad(middle_s), abs=1.2e-3)
        assert 0.0 <= estimates["steering_angle_age_s"].value < 0.021
        assert estimates["brake_pressure_pa"].value == pytest.approx(12.5e5)
        assert estimates["acceleration_x_mps2"].value == pytest.approx(-0.25 * 9.80665, abs=0.05)
        assert estimates["car_acceleration_z_mps2"].value == pytest.approx(1.5)
        assert estimates["vehicle_speed_mps"].value == pytest.approx(SPEED_MPS, abs=2e-3)
        assert estimates["car_wheel_speed_radps"].value == pytest.approx(result.revolution.omega_radps, rel=0.01)
        assert estimates["speed_mps"].status == "valid"


def test_live_and_batch_join_the_same(wheel) -> None:
    items, vehicle = drive(wheel)
    core = SessionCore(vehicle, signals=decoder(vehicle), estimators=FAST)
    live = [result for item in items for result in core.take(item)] + core.finish()
    batch = estimated(items, vehicle)
    assert len(live) == len(batch)
    for first, other in zip(live, batch, strict=True):
        assert {n: e.value for n, e in values(first).items() if n.startswith(("steering", "car_"))} == {
            n: e.value for n, e in values(other).items() if n.startswith(("steering", "car_"))
        }
    link = next(link for link in core.snapshot(3.0).links if link.link == vehicle_bus.LINK)
    assert link.frames == sum(1 for item in items if isinstance(item, BusFrames) for _ in unpack(item.data, 0))


def test_wrong_rate_is_contradicted_by_the_wheel_speed(wheel) -> None:
    items, vehicle = drive(wheel, rotation=1.05, speed=1.05)
    results = estimated(items, vehicle)
    speed = values(results[-1])["speed_mps"]
    assert speed.status == "provisional"
    (why,) = [reason["why"] for reason in speed.reasons if reason.code is TrustCode.MAY_CHANGE_BY]
    assert why.code is VehicleCode.CAR_CONTRADICTED
    assert why["ratio"] == pytest.approx(1.05, abs=0.005)
    cause = why["causes"][0]
    assert cause.kind == (TrustCode.WOULD_FIT, "rate")
    assert cause["rate_hz"] == pytest.approx(1.05 * cause["stated_hz"], rel=0.01)
    assert values(results[3])["speed_mps"].status == "valid", "a few revolutions prove nothing"


def test_contradiction_is_an_alarm_in_estimate_as_live(wheel) -> None:
    items, vehicle = drive(wheel, rotation=1.05, speed=1.05)
    batch = RecordingPass(OpenedRecording(Recorded(items), vehicle), FAST, signals=decoder(vehicle))
    results = list(batch)
    actual = {record.name: record for record in batch.alarms() if record.name == "wheel speed"}
    assert actual["wheel speed"].position == results[0].position
    core = SessionCore(vehicle, signals=decoder(vehicle), estimators=FAST)
    for item in items:
        core.take(item)
    assert "wheel speed" in {alarm.name for alarm in core.snapshot(3.0).alarms}


def test_contradicted_recording_has_the_alarm_in_its_summary(wheel, tmp_path) -> None:
    path = written(wheel, tmp_path, rotation=1.05, speed=1.05)
    run = invoked("estimate", path)
    alarms = run.output.partition("alarms")[2]
    assert "wheel speed" in alarms, run.output


def test_wrong_radius_is_contradicted_by_the_vehicle_speed(wheel) -> None:
    items, vehicle = drive(wheel, speed=1.08)
    core = SessionCore(vehicle, signals=decoder(vehicle), estimators=FAST)
    results = [result for item in items for result in core.take(item)]
    speed = values(results[-1])["speed_mps"]
    (why,) = [reason["why"] for reason in speed.reasons if reason.code is TrustCode.MAY_CHANGE_BY]
    assert why.code is VehicleCode.CAR_CONTRADICTED
    (cause,) = why["causes"]
    assert cause.kind == (TrustCode.WOULD_FIT, "radius")
    assert cause["radius_m"] == pytest.approx(1.08 * cause["stated_m"], rel=0.01)
    assert ("vehicle speed", VehicleCode.CAR_CONTRADICTED) in {
        (alarm.name, alarm.reason.code) for alarm in core.snapshot(3.0).alarms
    }


OTHERS = ("steering_angle", "brake_pressure", "acceleration_x", "acceleration_z")


@pytest.mark.parametrize("others", [(), *itertools.combinations(OTHERS, 1), *itertools.combinations(OTHERS, 2), OTHERS])
def test_signals_that_are_no_speed_do_not_end_the_check_of_the_speed(wheel, others) -> None:
    items, vehicle = drive(wheel, ("vehicle_speed", *others), speed=1.08)
    speed = values(estimated(items, vehicle)[-1])["speed_mps"]
    assert speed.status == "provisional"
    assert TrustCode.MAY_CHANGE_BY in codes_of(speed.reasons)


@pytest.mark.parametrize("is_sent", [True, False])
def test_dead_wheel_speed_does_not_end_the_check_of_the_radius(wheel, is_sent: bool) -> None:
    items, vehicle = drive(wheel, rotation=0.0, speed=1.08)
    number = vehicle_bus.database().get_message_by_name("ESP_Wheels").frame_id
    bus = [frame for item in items if isinstance(item, BusFrames) for frame in unpack(item.data, item.host_ns)]
    heard = blocks(frame for frame in bus if is_sent or frame.can_id != number)
    speed = values(estimated(merged(wheel[0], heard), vehicle)[-1])["speed_mps"]
    (why,) = [reason["why"] for reason in speed.reasons if reason.code is TrustCode.MAY_CHANGE_BY]
    assert [cause.kind[1] for cause in why["causes"]] == ["radius", "rate"]


def test_car_that_agrees_contradicts_nothing(wheel) -> None:
    items, vehicle = drive(wheel, rotation=1.005, speed=0.99)
    assert values(estimated(items, vehicle)[-1])["speed_mps"].status == "valid"


def test_silent_bus_leaves_its_signals_unknown(wheel) -> None:
    items, toml, position, radius_m = wheel
    begin_ns = items[0].host_ns
    bus = blocks(frames(begin_ns, begin_ns + 1_000_000_000, SPEED_MPS / radius_m, SPEED_MPS))
    results = estimated(merged(items, bus), with_signals(toml, position))
    assert values(results[3])["steering_angle_rad"].status == "valid"
    late = values(results[-1])["steering_angle_rad"]
    assert (late.status, late.reasons[0].code) == ("invalid", VehicleCode.SIGNAL_MISSING)


@pytest.mark.parametrize(
    ("days", "said"), [(-67, "67.00 days before the recording"), (3, "3.00 days after the recording")]
)
def test_log_of_another_date_says_how_far_it_is_and_offers_the_offset(wheel, days: int, said: str) -> None:
    items, vehicle = drive(wheel)
    bus = [item for item in items if isinstance(item, BusFrames)]
    moved = [replace(item, host_ns=item.host_ns + days * 86_400 * 10**9) for item in bus]
    # As live: the log plays beside the wheel, whatever its times are.
    beside = dict(zip(map(id, bus), moved, strict=True))
    results = estimated([beside.get(id(item), item) for item in items], vehicle)
    signal = values(results[-1])["steering_angle_rad"]
    (reason,) = signal.reasons
    assert (signal.status, reason.code) == ("invalid", VehicleCode.SIGNAL_OUTSIDE_RECORDING)
    assert said in text(reason)
    assert values(results[-1])["brake_pressure_pa"].reasons == (reason,), "one line for the whole log"
    assert reason["shift_s"] == pytest.approx(-days * 86_400, abs=1)
    assert f"{reason['shift_s']:+d} s to `offset_s`" in text(reason)
    shifted = [replace(item, host_ns=item.host_ns + reason["shift_s"] * 10**9) for item in moved]
    again = estimated(merged(wheel[0], shifted), vehicle)
    assert values(again[3])["steering_angle_rad"].status == "valid"


def test_log_that_is_read_after_the_revolutions_of_another_date_is_named_once(wheel) -> None:
    items, vehicle = drive(wheel)
    bus = [replace(item, host_ns=item.host_ns + 3 * 86_400 * 10**9) for item in items if isinstance(item, BusFrames)]
    core = SessionCore(vehicle, signals=decoder(vehicle), estimators=FAST)
    for item in [*wheel[0], *bus]:
        core.take(item)
    said = [notice for notice in core.take_notices() if notice.reason.code is VehicleCode.SIGNAL_OUTSIDE_RECORDING]
    assert [notice.subject for notice in said] == [vehicle_bus.LINK]
    assert "3.00 days after the recording's first revolution" in text(said[0].reason)


@pytest.fixture
def recording(wheel, tmp_path) -> Path:
    return written(wheel, tmp_path)


def written(wheel, tmp_path, **false) -> Path:
    items, vehicle = drive(wheel, **false)
    path = tmp_path / "drive.mcap"
    writer = RecordingWriter(path, start_ns=items[0].host_ns, vehicle_toml=vehicle.to_toml(), dbc_text=DBC.read_text())
    for item in items:
        writer.write(item)
    writer.close()
    return path


def test_recording_keeps_frames_and_dbc_for_estimate(recording, wheel, tmp_path) -> None:
    reader = RecordingReader(recording)
    assert reader.info.dbc_text == DBC.read_text()
    remaining = [item for item in reader.items() if isinstance(item, BusFrames)]
    assert remaining == [item for item in drive(wheel)[0] if isinstance(item, BusFrames)]
    table = tmp_path / "t.csv"
    run = invoked("estimate", recording, "--csv", table)
    assert run.exit_code == 0, run.output
    with table.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[-1]["brake_pressure_pa"]) == pytest.approx(12.5e5)
    assert 0.0 <= float(rows[-1]["brake_pressure_age_s"]) < 0.05
    run = invoked("inspect", recording, "--json")
    assert json.loads(run.output)["links"][vehicle_bus.LINK]["bus_frames"] > 300


def test_repair_and_compact_keep_the_frames_of_the_bus(recording, tmp_path) -> None:
    remaining = [item for item in RecordingReader(recording).items() if isinstance(item, BusFrames)]
    cut, whole, small = tmp_path / "cut.mcap", tmp_path / "whole.mcap", tmp_path / "small.mcap"
    data = recording.read_bytes()
    cut.write_bytes(data[: len(data) * 9 // 10])
    for line in (f"repair {cut} --out {whole}", f"compact {recording} --out {small}"):
        run(line)
    repaired = [item for item in RecordingReader(whole).items() if isinstance(item, BusFrames)]
    assert len(repaired) > 0.8 * len(remaining)
    assert repaired == remaining[: len(repaired)]
    assert RecordingReader(whole).info.dbc_text == DBC.read_text()
    assert [item for item in RecordingReader(small).items() if isinstance(item, BusFrames)] == remaining
    assert RecordingReader(small).info.dbc_text == DBC.read_text()


def test_another_dbc_can_be_applied_later(recording, tmp_path) -> None:
    other = DBC.read_text().replace("(0.1,-30)", "(0.2,-30)")
    (tmp_path / "other.dbc").write_text(other)
    toml = (RecordingReader(recording).vehicle_toml or "").replace('dbc = "car.dbc"', 'dbc = "other.dbc"')
    (tmp_path / "car.toml").write_text(toml)
    table = tmp_path / "t.csv"
    run("estimate", recording, "--config", tmp_path / "car.toml", "--csv", table)
    with table.open(encoding="utf-8") as file:
        last = list(csv.DictReader(file))[-1]
    assert float(last["brake_pressure_pa"]) == pytest.approx((12.5 + 30.0) * 2.0e5 - 30e5)


def test_bus_and_wheels_share_one_recording(wheel, tmp_path) -> None:
    _, toml, position, _ = wheel
    config = tmp_path / "car.toml"
    config.write_text(with_signals(toml, position).to_toml())
    (tmp_path / "car.dbc").write_text(DBC.read_text())
    log = tmp_path / "drive.asc"
    with can.ASCWriter(log) as writer:
        for message in vehicle_bus.messages(frames(10**18, 10**18 + 500_000_000, 56.0, SPEED_MPS)):
            writer.on_message_received(message)
    out = tmp_path / "out.mcap"
    run(f"live sim:lab?speed=max&duration=1.5 can:{log}?speed=max --plain --config {config} --record {out}")
    reader = RecordingReader(out)
    topics = {message.channel.topic for message in reader.messages()}
    assert {"/link/can:drive.asc/can", "/vehicle/signals"} <= topics
    assert any(topic.endswith("/revolution") for topic in topics)
    assert reader.info.dbc_text == DBC.read_text()


def test_bus_that_the_vehicle_file_does_not_map_is_named_once(wheel) -> None:
    items, toml, _, _ = wheel
    begin_ns = items[0].host_ns
    bus = blocks(frames(begin_ns, begin_ns + 500_000_000, 56.0, SPEED_MPS))
    core = SessionCore(parse_vehicle(toml, "car"), estimators=FAST)
    for item in merged(items, bus):
        core.take(item)
    results = [notice for notice in core.take_notices() if notice.reason.code is SessionCode.BUS_NOT_MAPPED]
    assert [notice.subject for notice in results] == [vehicle_bus.LINK]
    items, vehicle = drive(wheel)
    mapped = SessionCore(vehicle, signals=decoder(vehicle), estimators=FAST)
    for item in items:
        mapped.take(item)
    assert not any(notice.reason.code is SessionCode.BUS_NOT_MAPPED for notice in mapped.take_notices())


@pytest.mark.parametrize("suffix", [".blf", ".asc", ".log"])
def test_log_files_replay_their_frames(suffix: str, tmp_path) -> None:
    sent = list(frames(1_700_000_000_000_000_000, 1_700_000_000_300_000_000, 56.0, SPEED_MPS))
    path = tmp_path / f"drive{suffix}"
    with can.Logger(path) as logger:
        for message in vehicle_bus.messages(sent):
            logger.on_message_received(message)
    uri = f"can:{path}?speed=max&offset_s=10"
    assert not is_live(uri)
    items = list(open_source(uri, ManualClock()).items(threading.Event()))
    assert items[-1].kind is LinkEventKind.ENDED
    got = [frame for item in items[:-1] for frame in unpack(item.data, item.host_ns)]
    assert [(frame.can_id, frame.is_extended, frame.data) for frame in got] == [
        (frame.can_id, frame.is_extended, frame.data) for frame in sent
    ]
    assert got[-1].host_ns - got[0].host_ns == pytest.approx(290e6, abs=2e6)
    if suffix != ".asc":  # its times begin with the file
        assert got[0].host_ns == pytest.approx(1_700_000_010e9, abs=1e6)


def test_virtual_bus_delivers_frames_and_stops() -> None:
    source = open_source("can:virtual:live-test", SystemClock())
    assert is_live("can:virtual:live-test")
    stop = threading.Event()
    items = source.items(stop)
    assert next(items).kind is LinkEventKind.CONNECTED
    with can.Bus(interface="virtual", channel="live-test") as bus:
        bus.send(can.Message(arbitration_id=0x123, is_extended_id=False, data=b"\x01\x02"))
        bus.send(can.Message(arbitration_id=0x1ABCDEF, is_extended_id=True, data=b"\x03"))
        got: list[BusFrame] = []
        while len(got) < 2:
            item = next(items)
            got += unpack(item.data, item.host_ns)
    stop.set()
    assert list(items) == []
    assert [(frame.can_id, frame.is_extended, frame.data) for frame in got] == [
        (0x123, False, b"\x01\x02"), (0x1ABCDEF, True, b"\x03"),
    ]  # fmt: skip


def test_packed_frames_survive_and_damage_is_left_out() -> None:
    sent = [
        BusFrame(1000, 0x7FF, False, b""),
        BusFrame(5000, 0x1FFFFFFF, True, bytes(range(64)), is_fd=True),
        BusFrame(9000, 5, False, b"\x01", is_remote=True, is_error=True),
    ]
    data = pack(sent, 1000)
    assert list(unpack(data, 1000)) == sent
    assert list(unpack(data[:-1], 1000)) == sent[:2]
    assert list(unpack(b"\xff" * 40, 0)) == []


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        ("can:nosuch:x", "names neither"),
        ("can:/nosuch.blf", "does not exist"),
        ("can:virtual:x?dbc=/nosuch.dbc", "cannot read the DBC file"),
        ("can:{}?bitrate=5", "no option 'bitrate'"),
        ("can:{}?offset_s=soon", "invalid option offset_s"),
    ],
)
def test_wrong_can_sources_are_refused(uri: str, message: str, tmp_path) -> None:
    path = tmp_path / "x.log"
    path.write_text("")
    with pytest.raises(SourceError, match=message):
        open_source(uri.format(path), ManualClock())


def test_broken_log_file_is_an_error(tmp_path) -> None:
    path = tmp_path / "x.blf"
    path.write_bytes(b"not a log file")
    with pytest.raises(SourceError, match="cannot read the CAN log file"):
        list(open_source(f"can:{path}", ManualClock()).items(threading.Event()))


def test_mapping_that_does_not_fit_the_dbc_lists_every_fault() -> None:
    setups = [
        SignalSetup(Quantity.STEERING_ANGLE, "SAS_Angel", "SteeringWheelAngle"),
        SignalSetup(Quantity.BRAKE_PRESSURE, "ESP_Dynamics", "Pressure"),
        SignalSetup(Quantity.VEHICLE_SPEED, "CCVS1", "WheelBasedVehicleSpeed", unit="mph"),
        SignalSetup(Quantity.YAW_RATE, "CCVS1", "WheelBasedVehicleSpeed"),
    ]
    with pytest.raises(ConfigError) as result:
        BusDecoder(setups, 1.0, DBC.read_text(), "car.dbc")
    lines = str(result.value).splitlines()
    assert len(lines) == 4
    assert "no message 'SAS_Angel'; it has SAS_Angle" in lines[0]
    assert "no signal 'Pressure' in ESP_Dynamics" in lines[1]
    assert "unit 'mph' is not known" in lines[2]
    assert "does not fit yaw_rate" in lines[3]
    with pytest.raises(ConfigError, match="cannot be read as a DBC file"):
        BusDecoder((), 1.0, "BO_ what", "car.dbc")


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('wheel = "{wheel}"\nmessage = "ESP', 'message = "ESP', "wheel: missing, required for wheel_speed"),
        ('wheel = "{wheel}"\nmessage = "ESP', 'wheel = "XX"\nmessage = "ESP', "no wheel has this position"),
        ('"acceleration_x"', '"brake_pressure"', "is the same quantity"),
        ('"acceleration_x"', '"acceleration"', "quantity"),
    ],
)
def test_faults_of_the_mapping_are_named(wheel, old: str, new: str, message: str) -> None:
    _, toml, position, _ = wheel
    text = vehicle_bus.MAPPING.replace(old, new, 1).format(wheel=position)
    with pytest.raises(ConfigError, match=message):
        parse_vehicle(toml + text, "car.toml")


def test_published_j1939_file_gives_wheel_speeds() -> None:
    canmatrix = pytest.importorskip("canmatrix")
    text = (Path(canmatrix.__file__).parent / "j1939.dbc").read_text("utf-8", errors="replace")
    # This file states neither scale nor unit; SPN 904 has 1/256 km/h.
    setup = SignalSetup(
        Quantity.WHEEL_SPEED, "HRW", "Front_Axle__Left_Wheel_Speed", wheel="FL", unit="km/h", factor=1.0 / 256.0
    )
    result = SignalDecoder(BusDecoder([setup], 1.0, text, "j1939.dbc", is_j1939=True))
    data = round(65.0 * 256).to_bytes(2, "little") + bytes(6)
    for source, expected in ((0x18FE6E0B, {"FL.car_wheel_speed_mps": 65.0 / 3.6}), (0x18FE6F0B, {})):
        item = BusFrames("can:x", 0, pack([BusFrame(0, source, True, data)], 0))
        assert result.take(item) == pytest.approx(expected)


def test_messages_of_one_parameter_group_are_told_apart_by_their_source() -> None:
    signal = ' SG_ Speed : {}|16@1+ (0.01,0) [0|0] "m/s" ECU\n'
    names = ((0x98FE6E0B, "Front", 0, "FL"), (0x98FE6E0C, "Rear", 16, "RL"))
    dbc = "".join(f"BO_ {number} {name}: 8 ECU\n{signal.format(bit)}" for number, name, bit, _ in names)
    setups = [SignalSetup(Quantity.WHEEL_SPEED, name, "Speed", wheel=wheel) for _, name, _, wheel in names]
    result = SignalDecoder(BusDecoder(setups, 1.0, f'VERSION ""\nBU_: ECU\n{dbc}', "x.dbc", is_j1939=True))
    data = (1000).to_bytes(2, "little") + (2000).to_bytes(2, "little") + bytes(4)
    for number, expected in ((0x18FE6E0B, {"FL": 10.0}), (0x0CFE6E0C, {"RL": 20.0}), (0x18FE6E0D, {})):
        item = BusFrames("can:x", 0, pack([BusFrame(0, number, True, data)], 0))
        assert result.take(item) == {f"{wheel}.car_wheel_speed_mps": value for wheel, value in expected.items()}


def test_history_interpolates_within_what_is_known() -> None:
    signal = VehicleSignal("x_mps", Quantity.VEHICLE_SPEED, "mps", None, None, 1.0)
    history = SignalHistory([signal])
    assert history.at("x_mps", 0, 10**9) is None
    for at_ns, value in ((0, 1.0), (10**8, 2.0), (10**8, 9.0), (2 * 10**8, math.nan), (3 * 10**9, 5.0)):
        history.add("x_mps", at_ns, value)
    assert history.at("x_mps", 5 * 10**7, 10**8)[:2] == (1.5, 0.05)
    assert history.at("x_mps", 5 * 10**7, 9 * 10**7)[:2] == (1.0, 0.05), "the later value is not known yet"
    assert history.at("x_mps", 5 * 10**8, 4 * 10**9)[:2] == (2.0, 0.4), "no line across a silence"
    assert history.at("x_mps", 2 * 10**9, 4 * 10**9) is None


def test_position_and_course_go_on_between_fixes_and_the_short_way_round() -> None:
    history = SignalHistory(RECEIVER_SIGNALS)
    for at_s, longitude, course in ((0, 179.998, 6.1), (1, 179.999, 6.2), (2, -180.0, 0.1), (3, -179.999, 0.2)):
        history.add("longitude_deg", at_s * 10**9, longitude)
        history.add("course_rad", at_s * 10**9, course)

    def value_at(at_s: float, known_s: float, key: str = "longitude_deg") -> float:
        return history.at(key, round(at_s * 1e9), round(known_s * 1e9)).value

    assert value_at(0.5, 1.0) == pytest.approx(179.9985)
    assert value_at(1.5, 1.5) == pytest.approx(179.9995), "on the line through the two before"
    assert value_at(1.25, 2.0) == pytest.approx(179.99925)
    assert value_at(2.5, 2.5) == pytest.approx(-179.9995)
    assert value_at(3.5, 3.5) == pytest.approx(-179.9985)
    assert value_at(1.0 + 1e-3, 2.0, "course_rad") == pytest.approx(6.2, abs=1e-3)
    assert value_at(1.9, 2.0, "course_rad") == pytest.approx(0.1, abs=0.02)


def test_position_of_the_bus_replaces_that_of_the_receiver() -> None:
    dbc = 'VERSION ""\nNS_ :\nBS_:\nBU_: ECU\nBO_ 769 Gps: 8 ECU\n SG_ Lat : 0|32@1- (0.00001,0) [0|0] "Minutes" ECU\n'
    setup = SignalSetup(Quantity.LATITUDE, "Gps", "Lat")
    decoder = SignalDecoder(BusDecoder([setup], 1.0, dbc, "logger.dbc"))
    data = (48 * 60 * 100_000).to_bytes(4, "little") + bytes(4)
    assert decoder.take(BusFrames("can:x", 0, pack([BusFrame(0, 769, False, data)], 0))) == pytest.approx(
        {"latitude_deg": 48.0}
    )
    keys = [signal.key for signal in decoder.history.signals]
    assert keys == ["latitude_deg", "longitude_deg", "ground_speed_mps", "course_rad"]
    with pytest.raises(ConfigError, match="unit 'km/h' is not known; give unit, one of deg"):
        BusDecoder([SignalSetup(Quantity.LATITUDE, "Gps", "Lat", unit="km/h")], 1.0, dbc, "logger.dbc")
