"""Sensors of tires that rtl_433 hears: sources, units, identities, and the pressure that estimates rest on."""

import gzip
import json
import os
import threading
from pathlib import Path

import pytest

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import MessageType
from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import ConfigError, SourceError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, SensorLines, open_source
from gateway.core.reasons import Reason, codes_of
from gateway.core.recording.inspection import inspect_recording
from gateway.core.recording.recorded_file import open_recorded_file
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.recording_pass import RecordingPass, open_recording
from gateway.core.text.wording import text
from gateway.core.wheels.reasons import WheelCode
from gateway.vehicle.reasons import VehicleCode
from gateway.vehicle.tire_sensors import measured, open_tire_sensors
from tests.testkit.hub_ends import TcpHub

S = 1_000_000_000
START_NS = 1_700_000_000 * S
# Lines as rtl_433 prints them, by its test records and READMEs of programs that read it.
PUBLIC = [
    (
        b'{"time" : "2022-06-22 12:50:16", "model" : "PMV-107J", "type" : "TPMS", "id" : "0ceb28a2", "status" : 16, '
        b'"battery" : "OK", "counter" : 2, "failed" : "OK", "pressure_kPa" : 205.840, "temperature_C" : 19.000, '
        b'"mic" : "CRC", "mod" : "FSK", "freq1" : 315.015, "rssi" : -10.028, "snr" : 7.316, "noise" : -17.359}',
        (205_840.0, 19.0),
    ),
    (
        b'{"time" : "2026-10-02 19:01:04", "model" : "Toyota", "type" : "TPMS", "id" : "d8609be2", "status" : 128, '
        b'"pressure_PSI" : 31.750, "temperature_C" : 17.000, "mic" : "CRC"}',
        (31.75 * 6894.757, 17.0),
    ),
    (
        b'{"time": "@0.075335s", "model": "EezTire-E618", "type": "TPMS", "id": "54e328", "battery_ok": 1, '
        b'"pressure_kPa": 340.0, "temperature_C": 23.0, "flags": "7000", "fast_leak": 0, "inflate": 1, '
        b'"mic": "CHECKSUM"}',
        (340_000.0, 23.0),
    ),
    (b'{"id" : 918346460, "temperature_C" : 18, "pressure_kPa" : 170.000, "mic" : "CRC"}', (170_000.0, 18.0)),
    (b'{"id": 1, "pressure_bar": 2.2, "temperature_F": 75.2, "mic": "CRC"}', (220_000.0, 24.0)),
    (b'{"id": 1, "pressure_hPa": 2200, "temperature_C": true, "pressure_kPa_std": 3}', (220_000.0, None)),
    (b'{"id": 1, "pressure_kPa": 1' + b"0" * 400 + b', "temperature_C": -1' + b"0" * 400 + b"}", (None, None)),
    (b'{"id": 1, "pressure_kPa": NaN, "temperature_C": -Infinity}', (None, None)),
    (
        b'{"time" : "@0.184300s", "model" : "Ford", "type" : "TPMS", "id" : "45bb320f", "code" : "6ad446", '
        b'"mic" : "CHECKSUM"}',
        (None, None),
    ),
]
FEW = ("kinematic", "load")
VEHICLE = """
[vehicle]
name = "v"
[tire]
radius_mm = 320
[[wheel]]
position = "FL"
hub = 0
wheel = 0
"""
TPMS = """
[tpms]
max_age_s = 8

[[tpms.sensor]]
wheel = "{position}"
id = "0CEB28A2"
"""


def line(pressure_kpa=230.0, identity="0ceb28a2", **other):
    message = {"type": "TPMS", "model": "PMV-107J", "id": identity, "pressure_kPa": pressure_kpa, "mic": "CRC"}
    message |= {key: value for key, value in other.items() if value is not None}
    return json.dumps({key: value for key, value in message.items() if value != "-"}).encode() + b"\n"


def lines(at_s, *args, **other):
    return SensorLines("rtl433:pipe", START_NS + round(at_s * S), line(*args, **other))


def items_of(uri, stop=None):
    return list(open_source(uri, ManualClock(0)).items(stop or threading.Event()))


@pytest.mark.parametrize(("public", "expected"), PUBLIC)
def test_units_of_public_messages_are_converted(public, expected) -> None:
    values = measured(json.loads(public))
    assert (values.get("pressure"), values.get("temperature")) == pytest.approx(expected)


@pytest.fixture(scope="module")
def drive():
    """Chunks of one wheel whose sensor measures no pressure, and the vehicle file."""
    source = open_source("sim:lab?speed=max&duration=20&seed=2", ManualClock(START_NS))
    return list(source.items(threading.Event())), source.vehicle_toml


def without_pressure(items):
    """Return items as of a sensor that measures neither pressure nor temperature."""
    decoder, sent = FrameDecoder(), 0
    for item in items:
        if isinstance(item, Chunk) and item.data:
            frames = [frame for frame in decoder.feed(item.data) if frame.type != MessageType.ENVIRONMENT]
            frames = [frame._replace(seq=sent + number) for number, frame in enumerate(frames)]
            sent += len(frames)
            item = Chunk(item.link, item.host_ns, b"".join(map(encode_frame, frames)))
        yield item


def live(items, toml):
    core = SessionCore(parse_vehicle(toml, "lab"), estimators=FEW)
    results = [result for item in items for result in core.take(item)] + core.finish()
    return results, core


def recorded(tmp_path, items, toml):
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=START_NS, vehicle_toml=toml)
    for item in items:
        writer.write(item)
    writer.close()
    return writer.path


def estimated(path):
    estimation = RecordingPass(open_recording(open_recorded_file(path)), FEW)
    return list(estimation), estimation


def in_order(*streams):
    return sorted((item for stream in streams for item in stream), key=lambda item: item.host_ns)


def test_pressure_from_outside_is_that_of_each_revolution_with_its_error(drive, tmp_path) -> None:
    items, toml = drive
    position = parse_vehicle(toml, "lab").wheel[0].position
    toml += TPMS.format(position=position)
    heard = [lines(2.0, 230.0, temperature_C=41.0), lines(2.5, 230.0, temperature_C=41.0), lines(7.0, 232.5)]
    items = in_order(without_pressure(items), heard)
    path = recorded(tmp_path, items, toml)
    for results in (live(items, toml)[0], estimated(path)[0]):
        for result in results:
            at_s = (result.host_ns - START_NS) / S
            conditions = result.conditions
            if at_s < 2.0:
                assert conditions.temperature_degc != 41.0
                continue
            expected_pa = 230_000.0 if at_s < 7.0 else 232_500.0
            assert conditions.pressure_pa == expected_pa
            assert conditions.pressure_std_pa >= 5800.0
            old = [reason for estimate in result.estimates for reason in estimate.reasons if is_old(reason)]
            assert bool(old) is (at_s > 15.0), at_s
            assert not old or old[0]["age_s"] == pytest.approx(at_s - 7.0, abs=0.01)
    assert estimated(path)[1].sensors.measures_pressure(position)


def is_old(reason: Reason) -> bool:
    return reason.code is WheelCode.PRESSURE_OLD


def test_live_and_recorded_results_are_the_same(drive, tmp_path) -> None:
    items, toml = drive
    toml += TPMS.format(position=parse_vehicle(toml, "lab").wheel[0].position)
    items = in_order(without_pressure(items), [lines(at_s, 225.0 + at_s) for at_s in range(0, 20, 3)])
    path = recorded(tmp_path, items, toml)
    both = [
        [(result.host_ns, pressure_of(result)) for result in results]
        for results in (live(items, toml)[0], estimated(path)[0])
    ]
    assert both[0] == both[1]
    assert len({pressure for _, pressure in both[0]}) >= 7


def pressure_of(result):
    return result.conditions.pressure_pa, result.conditions.pressure_std_pa


def test_the_sensor_of_the_wheel_goes_first(drive) -> None:
    items, toml = drive
    toml += TPMS.format(position=parse_vehicle(toml, "lab").wheel[0].position)
    results, core = live(in_order(items, [lines(2.0, 300.0)]), toml)
    assert all(result.conditions.pressure_pa != 300_000.0 for result in results[10:])
    assert core.snapshot(1.0).wheels[0].pressure_pa != 300_000.0


def test_old_pressure_is_an_alarm_of_the_wheel(drive) -> None:
    items, toml = drive
    toml += TPMS.format(position=parse_vehicle(toml, "lab").wheel[0].position)
    core = SessionCore(parse_vehicle(toml, "lab"), estimators=FEW)
    for item in in_order(without_pressure(items), [lines(2.0)]):
        core.take(item)
    (wheel,) = core.snapshot(20.0).wheels
    assert wheel.pressure_pa == 230_000.0
    assert "pressure_pa" not in wheel.stated
    assert wheel.old_environment is not None
    assert 8.0 < wheel.old_environment.age_s < 18.5
    assert not wheel.has_current_environment


def test_estimate_has_the_alarm_of_an_old_pressure_as_a_session_has(drive, tmp_path) -> None:
    items, toml = drive
    position = parse_vehicle(toml, "lab").wheel[0].position
    toml += TPMS.format(position=position)
    items = in_order(without_pressure(items), [lines(2.0), lines(14.0)])
    results, estimation = estimated(recorded(tmp_path, items, toml))
    old = [record for record in estimation.alarms() if record.name == "old environment"]
    standing = [(result.host_ns - START_NS) / S for result in results if result.alarms]
    assert [(record.position, record.count, record.is_standing) for record in old] == [(position, 1, False)]
    assert standing[0] == pytest.approx(10.0, abs=0.3)
    assert standing[-1] == pytest.approx(14.0, abs=0.3)


@pytest.mark.parametrize(
    ("message", "why"),
    [
        (line(identity="d8609be2"), "unknown"),
        (line(mic="-"), "unchecked"),
        (PUBLIC[-1][0].replace(b"45bb320f", b"0ceb28a2"), "empty"),
        (line()[:40], "unread"),
        (b"[1, 2]", "unread"),
        (b"\xff{", "unread"),
    ],
)
def test_what_is_not_used_is_said_once(message, why) -> None:
    decoder = open_tire_sensors(parse_vehicle(VEHICLE + TPMS.format(position="FL"), "v"))
    item = SensorLines("rtl433:pipe", START_NS, message + b"\n" + message)
    assert not list(decoder.take(item))
    ((link, reason),) = decoder.take_notices()
    assert link == "rtl433:pipe"
    assert reason.code is VehicleCode.TPMS_NOT_USED
    assert reason["why"] == why
    assert text(reason)
    assert not decoder.take_notices()


def test_sensors_of_passing_cars_are_not_listed_for_ever() -> None:
    decoder = open_tire_sensors(parse_vehicle(VEHICLE, "v"))
    many = b"".join(line(identity=f"{number:08x}") for number in range(100))
    assert not list(decoder.take(SensorLines("rtl433:pipe", START_NS, many)))
    assert len(decoder.take_notices()) == 8
    weather = b'{"model": "Acurite-Tower", "id": 5, "temperature_C": 20.5, "mic": "CHECKSUM"}'
    fresh = open_tire_sensors(None)
    assert not list(fresh.take(SensorLines("rtl433:pipe", START_NS, weather)))
    assert not fresh.take_notices()


def test_offset_error_and_resolution_are_those_of_the_reading() -> None:
    table = TPMS.format(position="FL") + "std_kpa = 1.0\noffset_kpa = -101.3\n"
    decoder = open_tire_sensors(parse_vehicle(VEHICLE + table, "v"))
    values = [330.0, 330.0, 332.5, 335.0]
    readings = [
        reading for number, value in enumerate(values) for _, reading in decoder.take(lines(60.0 * number, value))
    ]
    assert [reading.reading.pressure_pa for reading in readings] == pytest.approx([228.7e3, 228.7e3, 231.2e3, 233.7e3])
    assert readings[0].pressure_std_pa == 1000.0
    assert readings[-1].pressure_std_pa == pytest.approx((1000.0**2 + 2500.0**2 / 12.0) ** 0.5)


def test_bursts_count_once_and_impossible_pressures_not_at_all(drive) -> None:
    decoder = open_tire_sensors(parse_vehicle(VEHICLE + TPMS.format(position="FL"), "v"))
    burst = [lines(at_s) for at_s in (0.0, 0.3, 0.6, 60.0)]
    assert [reading.host_ns for item in burst for _, reading in decoder.take(item)] == [START_NS, START_NS + 60 * S]
    items, toml = drive
    toml += TPMS.format(position=parse_vehicle(toml, "lab").wheel[0].position)
    results, _ = live(in_order(without_pressure(items), [lines(2.0, 1e6), lines(2.1, 1e-6, temperature_C=900)]), toml)
    assert all(abs(result.conditions.pressure_pa or 0.0) < 1e6 for result in results)


def test_unknown_wheel_is_a_fault_of_the_vehicle_file() -> None:
    with pytest.raises(ConfigError, match=r"tpms\.sensor\[#1\]\.wheel.*no wheel has this position"):
        parse_vehicle(VEHICLE + TPMS.format(position="XX"), "v")


def test_two_sensors_of_a_wheel_and_a_sensor_of_two_wheels_are_faults_of_the_vehicle_file() -> None:
    entry = TPMS.format(position="FL").partition("\n\n")[2]
    again = (entry.replace("0CEB28A2", "1"), entry.replace("FL", "FR").replace("0CEB28A2", "0ceb28a2"))
    wheels = VEHICLE + '[[wheel]]\nposition = "FR"\nhub = 0\nwheel = 1\n'
    with pytest.raises(ConfigError) as error:
        parse_vehicle("".join((wheels, TPMS.format(position="FL"), *again)), "v")
    faults = str(error.value).splitlines()
    for fault, key in zip(faults, ("tpms.sensor[#2].wheel", "tpms.sensor[#3].id"), strict=True):
        assert key in fault
        assert "tpms.sensor[#1] has the same" in fault


@pytest.mark.parametrize(
    ("stated", "options", "utc_ns"),
    [
        ("2024-07-01 14:00:00", "?time_zone=Europe/Berlin", 1_719_835_200_000_000_000),
        ("2024-07-01T12:00:00.250000+0000", "", 1_719_835_200_250_000_000),
        ("2024-07-01T14:00:00+02:00", "?offset_s=1.5", 1_719_835_201_500_000_000),
        ("1719835200.500000", "", 1_719_835_200_500_000_000),
        (1719835200, "", 1_719_835_200_000_000_000),
    ],
)
def test_times_of_a_log_are_those_of_its_messages(tmp_path, stated, options, utc_ns) -> None:
    path = tmp_path / "tpms.json.gz"
    path.write_bytes(gzip.compress(line(time=stated)))
    message, end = items_of(f"rtl433:{path}{options}")
    assert message == SensorLines("rtl433:tpms.json.gz", utc_ns, line(time=stated))
    assert end.kind is LinkEventKind.ENDED


@pytest.mark.parametrize(
    ("stated", "options", "said"),
    [
        ("2024-07-01 14:00:00", "", "states no time zone"),
        ("2024-10-27 02:30:00", "?time_zone=Europe/Berlin", "comes twice"),
        ("@0.174840s", "", "without a time of day"),
        (None, "", "without a time of day"),
        ("2024-07-01 14:00:00", "?time_zone=Mars", "time_zone=Mars"),
        ("2024-07-01 14:00:00", "?tz=UTC", "no option 'tz'"),
    ],
)
def test_times_that_say_nothing_are_refused(tmp_path, stated, options, said) -> None:
    path = tmp_path / "tpms.json"
    path.write_bytes(line(time=stated))
    with pytest.raises(SourceError, match=said):
        items_of(f"rtl433:{path}{options}")


def test_what_a_log_begins_with_comes_with_its_first_message(tmp_path) -> None:
    """At a time of its own, 1970, the first message would wait for half a century."""
    path = tmp_path / "tpms.json"
    banner = b"rtl_433 version 23.11\n"
    path.write_bytes(banner + line(time="1719835200") + line(time="1719835201"))
    first, second, _ = items_of(f"rtl433:{path}?speed=max")
    assert (first.host_ns // S, first.data) == (1719835200, banner + line(time="1719835200"))
    assert second.host_ns // S == 1719835201


def test_damaged_packed_log_plays_what_it_has(tmp_path) -> None:
    path, whole = tmp_path / "tpms.json.gz", gzip.compress(line(time="1719835200") + line(time="1719835260"))
    damaged = whole[:10] + b"\xff" * 99
    path.write_bytes(whole + damaged)
    *items, lost, ended = items_of(f"rtl433:{path}?speed=max")
    assert items[0].host_ns // S == 1719835200
    assert (lost.kind, ended.kind) == (LinkEventKind.LOST, LinkEventKind.ENDED)
    path.write_bytes(damaged)
    with pytest.raises(SourceError, match="cannot read .* invalid block type"):
        items_of(f"rtl433:{path}?speed=max")


def test_cut_log_plays_what_it_has(tmp_path) -> None:
    path = tmp_path / "tpms.json"
    whole = line(time="1719835200") + line(time="1719835260") + line(time="1719835230")
    path.write_bytes(whole + line(time="1719835320")[:50])
    *items, end = items_of(f"rtl433:{path}?speed=max")
    assert [item.host_ns // S for item in items] == [1719835200, 1719835260, 1719835230, 1719835230]
    assert codes_of(end.details) == (VehicleCode.LOG_STEPS_BACK,)
    packed = tmp_path / "tpms.json.gz"
    packed.write_bytes(gzip.compress(whole * 50)[:-20])
    assert items_of(f"rtl433:{packed}?speed=max")[-2].kind is LinkEventKind.LOST
    path.write_bytes(b"\n\nnothing\n")
    with pytest.raises(SourceError, match="no message with a time"):
        items_of(f"rtl433:{path}")


def test_pipe_growing_file_and_server_are_read_live(tmp_path, read) -> None:
    pipe, growing, server = tmp_path / "tpms.json", tmp_path / "grows", TcpHub()
    os.mkfifo(pipe)
    growing.write_bytes(line(100.0))
    for target in (str(pipe), str(growing), f"127.0.0.1:{server.port}"):
        reader = read(open_source(f"rtl433:{target}", ManualClock(START_NS)))
        first = reader.next()
        assert isinstance(first, LinkEvent)
        assert first.kind is LinkEventKind.CONNECTED
        if target.startswith("127"):
            connection = server.accept()
            connection.sendall(line()[:30])
            connection.sendall(line()[30:])
        else:
            with Path(target).open("ab") as file:
                file.write(line())
        assert reader.next() == SensorLines(f"rtl433:{target}", START_NS, line())
        reader.finish()
        assert reader.error is None
    connection.close()
    server.close()


@pytest.mark.parametrize("is_begun_late", [False, True])
def test_log_that_is_rotated_goes_on(tmp_path, read, is_begun_late) -> None:
    path, before, after = tmp_path / "tpms", line(210.0), line(220.0)
    path.write_bytes(b"")
    reader = read(open_source(f"rtl433:{path}", ManualClock(START_NS)))
    assert reader.next().kind is LinkEventKind.CONNECTED
    with path.open("ab", buffering=0) as file:
        file.write(before)
        assert reader.next().data == before
        path.rename(tmp_path / "tpms.1")
        file.write(before)  # a writer goes on until it opens the new one
    data = reader.next().data if is_begun_late else b""
    path.write_bytes(after)
    while after not in data:
        data += reader.next().data
    assert data == before + after
    reader.finish()
    assert reader.error is None


def test_missing_pipe_is_named(tmp_path) -> None:
    with pytest.raises(SourceError, match="cannot open '.*nothing'"):
        items_of(f"rtl433:{tmp_path}/nothing")


def test_recording_has_the_lines_and_inspect_counts_them(tmp_path) -> None:
    path = recorded(tmp_path, [lines(0.0), lines(60.0)], VEHICLE)
    assert inspect_recording(path).links["rtl433:pipe"].sensor_lines == 2
