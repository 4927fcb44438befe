"""A positioning receiver: recorded beside the wheels, joined to revolutions, watched, and a witness for the radius."""

import csv
import gzip
import json
import math
import socket
import threading
from itertools import pairwise

import pytest
from click.testing import CliRunner
from mcap.writer import Writer

from gateway.core.cli import treadlink
from gateway.core.clock import ManualClock, SystemClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.errors import RecordingError, SourceError
from gateway.core.links.nmea_sentences import SentenceReader, has_position
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import LinkEvent, LinkEventKind, Sentences, is_live, open_source
from gateway.core.links.tcp_link import HostPort
from gateway.core.reasons import CoreCode, Reason, codes_of
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
from gateway.core.trust.reasons import TrustCode
from gateway.simulator.receiver import EARTH_RADIUS_M, LINK, START_DEG, rmc
from gateway.upkeep.set_clock import set_clock
from gateway.vehicle.nmea_source import GpsdLink
from gateway.vehicle.reasons import VehicleCode
from gateway.vehicle.signal_decoding import SignalDecoder
from tests.testkit.commands import invoked, run
from tests.testkit.hub_ends import PtyPort, Reader, TcpHub

pytest.importorskip("pynmeagps")

S = 1_000_000_000
START_NS = 1_700_000_000 * S
FEW = ("kinematic",)
SPEED_MPS = 65.0 / 3.6
BRAKING = """
[scenario]
name = "braking"
duration_s = 12.0

[motion]
speed_kmh = [[0, 120], [12, 20]]

[[wheel]]
position = "FL"
wheel = 0
"""


class Recorded:
    def __init__(self, items) -> None:
        self._items = items

    def items(self):
        return iter(self._items)


def simulated(uri):
    source = open_source(uri, ManualClock(START_NS))
    return list(source.items(threading.Event())), source.vehicle_toml


@pytest.fixture(scope="module")
def drive():
    """Items of one wheel and a receiver at constant speed, and the vehicle file."""
    return simulated("sim:lab?speed=max&duration=12&seed=2&receiver=1")


def vehicle_of(toml, radius_mm=None):
    vehicle = parse_vehicle(toml, "lab")
    if radius_mm is None:
        return vehicle
    wheels = tuple(
        wheel.model_copy(update={"tire": vehicle.tire_of(wheel).model_copy(update={"radius_mm": radius_mm})})
        for wheel in vehicle.wheel
    )
    return vehicle.model_copy(update={"wheel": wheels})


def live(items, vehicle):
    core = SessionCore(vehicle, estimators=FEW)
    return [result for item in items for result in core.take(item)] + core.finish(), core


def values(result):
    return {estimate.name: estimate for estimate in result.estimates}


def contradictions(result):
    return [
        codes_of((reason["why"],))[0]
        for reason in values(result)["speed_mps"].reasons
        if reason.code is TrustCode.MAY_CHANGE_BY
    ]


def test_revolutions_have_position_and_ground_speed(drive) -> None:
    items, toml = drive
    results, _ = live(items, vehicle_of(toml))
    assert len(results) > 80
    for result in results[20:]:
        estimates = values(result)
        at_s = (result.host_ns - START_NS) * 1e-9 - 0.5 * result.revolution.period_s
        north_m = math.radians(estimates["latitude_deg"].value - START_DEG[0]) * EARTH_RADIUS_M
        # Delay 0.1 s, and a position error of 2.1 m that wanders.
        assert north_m == pytest.approx(SPEED_MPS * (at_s - 0.1), abs=10.0)
        assert estimates["latitude_deg"].std * 111_200.0 == pytest.approx(2.1, abs=0.1)
        assert estimates["longitude_deg"].value == pytest.approx(START_DEG[1], abs=2e-4)
        assert estimates["ground_speed_mps"].value == pytest.approx(SPEED_MPS, abs=0.25)
        assert estimates["ground_speed_age_s"].value < 1.1
        assert estimates["speed_mps"].status == "valid"


def test_live_and_batch_give_the_same_positions(drive) -> None:
    items, toml = drive
    of_live, _ = live(items, vehicle_of(toml))
    batch = RecordingPass(OpenedRecording(Recorded(items), vehicle_of(toml)), FEW, signals=SignalDecoder())
    of_batch = list(batch)
    names = ("latitude_deg", "longitude_deg", "ground_speed_mps", "latitude_age_s")
    first, other = (
        [[values(result)[name].value for name in names if name in values(result)] for result in results]
        for results in (of_live, of_batch)
    )
    assert first == other


def test_revolutions_before_the_first_sentence_have_no_position(drive) -> None:
    items, toml = drive
    late = [item for item in items if not isinstance(item, Sentences) or item.host_ns > START_NS + 5 * S]
    results, _ = live(late, vehicle_of(toml))
    assert "latitude_deg" not in values(results[10])
    assert "latitude_deg" in values(results[-1])


def test_wrong_radius_is_contradicted_by_the_ground_speed(drive) -> None:
    items, toml = drive
    right_mm = vehicle_of(toml).tire_of(vehicle_of(toml).wheel[0]).radius_m * 1e3
    results, core = live(items, vehicle_of(toml, 1.12 * right_mm))
    whys = [r["why"] for r in values(results[-1])["speed_mps"].reasons if r.code is TrustCode.MAY_CHANGE_BY]
    (why,) = [why for why in whys if why.code is VehicleCode.CAR_CONTRADICTED]
    assert why["causes"][0]["radius_m"] == pytest.approx(right_mm * 1e-3, rel=0.01)
    assert "vehicle speed" in {record.name for record in core.snapshot(12.0).alarm_records}


@pytest.mark.parametrize("rate_hz", [1, 10])
def test_braking_is_no_contradiction_and_in_the_error_of_the_ground_speed(tmp_path, rate_hz: int) -> None:
    path = tmp_path / "braking.toml"
    path.write_text(BRAKING)
    items, toml = simulated(f"sim:{path}?speed=max&seed=4&receiver={rate_hz}")
    results, _ = live(items, parse_vehicle(toml, "braking"))
    assert len(results) > 80
    assert not any(contradictions(result) for result in results)
    both = [(values(result)["ground_speed_mps"], values(result)["speed_mps"].value) for result in results[20:]]
    assert max(abs(ground.value - speed_mps) / ground.std for ground, speed_mps in both) < 3.0


def test_receiver_without_position_and_silent_receiver_are_alarms(drive) -> None:
    items, toml = drive
    begin, lost, silent = START_NS, START_NS + 4 * S, START_NS + 8 * S

    def received(item):
        if not isinstance(item, Sentences) or item.host_ns < lost:
            return item
        return Sentences(LINK, item.host_ns, rmc(item.host_ns, 0.0, 0.0, 0.0, has_fix=False))

    heard = [received(item) for item in items if not isinstance(item, Sentences) or item.host_ns < silent]
    core = SessionCore(vehicle_of(toml), estimators=FEW)
    alarms = {}
    for item in heard:
        core.take(item)
        core.tick(item.host_ns)
        for alarm in core.snapshot(0.0).alarms:
            if alarm.position == LINK:
                alarms.setdefault(alarm.reason.code, (item.host_ns - begin) / S)
    assert alarms[SessionCode.POSITION_MISSING] == pytest.approx(6.2, abs=0.3)
    assert alarms[SessionCode.RECEIVER_SILENT] == pytest.approx(10.2, abs=0.3)
    batch = RecordingPass(OpenedRecording(Recorded(heard), vehicle_of(toml)), FEW, signals=SignalDecoder())
    list(batch)
    of_live = [(a.position, a.name, a.first_s) for a in core.snapshot(0.0).alarm_records if a.position == LINK]
    assert [(a.position, a.name, a.first_s) for a in batch.alarms() if a.position == LINK] == of_live
    assert len(of_live) == 1


def test_damaged_sentences_give_no_position() -> None:
    good = rmc(START_NS, 48.5, -11.25, 10.0)
    reader = SentenceReader()
    (fix,) = reader.read(good)
    assert (fix.latitude_deg, fix.longitude_deg) == (pytest.approx(48.5), pytest.approx(-11.25))
    assert fix.ground_speed_mps == pytest.approx(10.0, abs=1e-3)
    assert fix.utc_ns == START_NS
    damaged = [
        good.replace(b"48", b"49"),
        good[:-5] + b"\r\n",
        good[:20] + b"\r\n",
        b"$GNRMC,,,,,,*00\r\n",
        b"$GNRMC" + b"," * 300 + b"*00\r\n",
        b"$\xff\xfeRMC,\x00*00\r\n",
    ]
    assert not [fix for fix in reader.read(b"".join(damaged)) if fix.has_position]
    assert reader.fixes == 1
    (none,) = reader.read(rmc(START_NS, 0.0, 0.0, 0.0, has_fix=False))
    assert not none.has_position
    assert not list(reader.read(b'{"class":"VERSION"}\r\n$GNGGA,1*00\r\n'))


@pytest.mark.parametrize(
    ("line", "is_read"),
    [
        # NMEA 0183 before 2.3 has no mode, from 4.1 on a status follows it.
        (b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,E*78\r\n", True),
        (b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,E,D,V*6A\r\n", True),
        (b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,E,E*11\r\n", False),
        (b"$GPRMC,123519,A,4807.038,N,01131.000,E,022.4,084.4,230394,003.1,E\r\n", False),
    ],
)
def test_position_that_is_not_read_is_no_sign_of_one(line: bytes, is_read: bool) -> None:
    reader = SentenceReader()
    fixes = [fix for fix in reader.read(line) if fix.has_position]
    assert len(fixes) == reader.fixes == is_read
    assert has_position(line) == is_read
    if is_read:
        assert fixes[0].latitude_deg == pytest.approx(48.1173)
        assert fixes[0].ground_speed_mps == pytest.approx(22.4 * 1852.0 / 3600.0)


def sentences_of(reader: Reader, count: int) -> bytes:
    data = b""
    while data.count(b"\n") < count:
        item = reader.next()
        assert isinstance(item, Sentences), item
        assert item.data.endswith(b"\n")
        data += item.data
    return data


def test_serial_receiver_is_read_in_lines_and_reconnected(tmp_path) -> None:
    port = PtyPort(tmp_path / "ttyGPS")
    reader = Reader(open_source(f"nmea:{port.path}?baudrate=9600", SystemClock()))
    lines = [rmc(START_NS + k * S, 48.0, 11.0, 1.0) for k in range(3)]
    try:
        reader.event(LinkEventKind.CONNECTED)
        stream = b"".join(lines)
        for begin in range(0, len(stream), 17):
            port.send(stream[begin : begin + 17])
        assert sentences_of(reader, 3) == stream
        port.send(lines[0][:30])
        port.unplug()
        reader.event(LinkEventKind.LOST)
        port.plug()
        item = reader.next()
        while item.kind is LinkEventKind.RETRYING:
            item = reader.next()
        assert item.kind is LinkEventKind.RESTORED
        port.send(lines[1])
        assert sentences_of(reader, 1) == lines[1], "what was cut off is no line"
    finally:
        reader.finish()
        port.close()


def test_absent_receiver_is_called_so() -> None:
    server = socket.create_server(("127.0.0.1", 0))
    port = server.getsockname()[1]
    server.close()
    for uri in (f"nmea:127.0.0.1:{port}", "nmea:/dev/ttyNone"):
        with pytest.raises(SourceError) as error:
            next(open_source(uri, SystemClock()).items(threading.Event()))
        assert "receiver" in error.value.remedy
        assert "hub" not in error.value.remedy


def test_gpsd_is_asked_for_sentences() -> None:
    hub = TcpHub()
    link = GpsdLink(HostPort("127.0.0.1", hub.port))
    try:
        link.open()
        with hub.accept() as connection:
            asked = connection.recv(100)
            assert asked.startswith(b"?WATCH=")
            assert json.loads(asked.partition(b"=")[2].rstrip(b";\n")) == {"enable": True, "nmea": True}
    finally:
        link.close()
        hub.close()


def test_receiver_behind_tcp_is_sent_nothing() -> None:
    hub = TcpHub()
    reader = Reader(open_source(f"nmea:127.0.0.1:{hub.port}", SystemClock()))
    try:
        with hub.accept() as connection:
            reader.event(LinkEventKind.CONNECTED)
            connection.sendall(b'{"class":"VERSION"}\r\n' + rmc(START_NS, 48.0, 11.0, 1.0))
            sentences_of(reader, 2)
            connection.settimeout(0.05)
            with pytest.raises(TimeoutError):
                connection.recv(1)
    finally:
        reader.finish()
        hub.close()


def test_log_file_is_played_at_its_times(tmp_path) -> None:
    lines = [rmc(START_NS + k * S, 48.0 + k * 1e-4, 11.0, 11.1) for k in range(5)]
    for name, opened in (("drive.nmea", open), ("drive.nmea.gz", gzip.open)):
        with opened(tmp_path / name, "wb") as file:
            file.write(b"$GPTXT,01,01,02,hello*00\r\n" + b"".join(lines))
        uri = f"nmea:{tmp_path / name}?speed=max&offset_s=0.5"
        assert not is_live(uri)
        items = list(open_source(uri, ManualClock()).items(threading.Event()))
        assert [item.host_ns for item in items[:-1]] == [START_NS + k * S + S // 2 for k in range(5)]
        assert b"".join(item.data for item in items[:-1]).endswith(b"".join(lines))
        assert items[-1].kind is LinkEventKind.ENDED


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("empty.nmea", b"", "no sentence RMC"),
        ("other.log", b"nothing\n" * 9, "no sentence RMC"),
        ("cut.nmea.gz", gzip.compress(rmc(START_NS, 48.0, 11.0, 1.0) * 50, mtime=0)[:40], "cannot read"),
        ("none.nmea", None, "does not exist"),
    ],
)
def test_log_file_without_times_is_refused(tmp_path, name, content, words) -> None:
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(SourceError, match=words):
        list(open_source(f"nmea:{tmp_path / name}?speed=max", ManualClock()).items(threading.Event()))


def test_options_of_receivers_are_checked(tmp_path) -> None:
    (tmp_path / "a.nmea").write_bytes(rmc(START_NS, 48.0, 11.0, 1.0))
    for uri, words in (
        (f"nmea:{tmp_path}/a.nmea?sped=1", "Did you mean"),
        ("nmea:localhost:99999", "Give nmea:host:port"),
        ("sim:demo?receiver=1000", "Give a number from 0.01 to 100"),
        ("sim:demo?receiver=no", "Give a number from 0.01 to 100"),
    ):
        with pytest.raises(SourceError) as error:
            open_source(uri, ManualClock())
        assert words in f"{error.value} {error.value.remedy}"


def test_missing_package_is_named(drive, monkeypatch) -> None:
    items, toml = drive
    for module in (
        "gateway.core.links.nmea_sentences",
        "gateway.vehicle.nmea_source",
        "gateway.vehicle.signal_decoding",
    ):
        monkeypatch.setattr(f"{module}.can_read_sentences", lambda: False)
    with pytest.raises(SourceError, match="pynmeagps"):
        open_source("nmea:/dev/ttyX", ManualClock())
    _, core = live(items[:400], vehicle_of(toml))
    assert [n.subject for n in core.take_notices() if n.reason.code is CoreCode.SENTENCES_UNREAD] == [LINK]


# --- recordings


def written(items, toml, path, ahead_s=0.0):
    """Write the items as a computer whose clock lacks `ahead_s` would, with the receiver's right time."""
    writer = RecordingWriter(path, start_ns=START_NS, vehicle_toml=toml, sources=["sim:lab", "nmea:/dev/gps"])
    for item in items:
        if isinstance(item, Sentences) and ahead_s:
            (fix,) = SentenceReader().read(item.data)
            data = rmc(fix.utc_ns + round(ahead_s * 1e9), fix.latitude_deg, fix.longitude_deg, fix.ground_speed_mps)
            item = Sentences(item.link, item.host_ns, data)
        writer.write(item)
    writer.close()
    return path


def test_recording_keeps_the_lines_and_shows_them(drive, tmp_path) -> None:
    items, toml = drive
    path = written(items, toml, tmp_path / "r.mcap")
    assert [i for i in RecordingReader(path).items() if isinstance(i, Sentences)] == [
        i for i in items if isinstance(i, Sentences)
    ]
    run = invoked("inspect", path)
    assert "12 sentences of a receiver, 12 with a position, 0 without, 0 damaged" in run.output
    assert "from 47.9999" in run.output
    content = json.loads(invoked("inspect", "--json", path).output)
    assert content["links"][LINK]["receiver"]["with_position"] == 12
    assert content["links"][LINK]["receiver"]["ahead_s"] is None


def test_position_is_in_tables_and_exports(drive, tmp_path) -> None:
    items, toml = drive
    path = written(items, toml, tmp_path / "r.mcap")
    for command in (
        ["estimate", str(path), "--csv", str(tmp_path / "e.csv")],
        ["export", str(path), str(tmp_path / "x.csv"), "--what", "estimates"],
    ):
        assert CliRunner().invoke(treadlink, command).exit_code == 0
    for name in ("e.csv", "x.csv"):
        lines = [line for line in (tmp_path / name).read_text().splitlines() if not line.startswith("#")]
        rows = list(csv.DictReader(lines))
        latitudes = [float(row["latitude_deg"]) for row in rows if row["latitude_deg"]]
        assert len(latitudes) > 80
        assert all(0.0 < after - before < 1e-4 for before, after in pairwise(latitudes[15:])), "every revolution moves"
        assert float(rows[-1]["ground_speed_mps"]) == pytest.approx(SPEED_MPS, abs=0.3)


def test_wrong_clock_is_named_and_set_afterwards(drive, tmp_path) -> None:
    items, toml = drive
    ahead_s = 56 * 86_400.0
    path = written(items, toml, tmp_path / "r.mcap", ahead_s)
    before = path.read_bytes()
    runner = CliRunner()
    assert "set-clock" in runner.invoke(treadlink, ["inspect", str(path)]).output
    run = runner.invoke(treadlink, ["set-clock", str(path)])
    assert run.exit_code == 0, run.output
    assert path.read_bytes() == before
    dated = tmp_path / "r.dated.mcap"
    moved_ns = RecordingReader(dated).info.start_ns - START_NS
    assert moved_ns == pytest.approx(ahead_s * 1e9, abs=0.3e9)
    assert "set-clock" not in runner.invoke(treadlink, ["inspect", str(dated)]).output
    again = runner.invoke(treadlink, ["set-clock", str(dated), "--out", str(tmp_path / "b.mcap")])
    assert "agree with its receiver's" in str(again.exception)
    first, other = (list(RecordingPass(OpenedRecording(RecordingReader(p)), FEW)) for p in (path, dated))
    assert [b.host_ns - a.host_ns for a, b in zip(first, other, strict=True)] == [moved_ns] * len(first)


def test_clock_is_set_by_the_step_of_the_system_time(drive, tmp_path) -> None:
    items, toml = drive
    step = LinkEvent(
        "",
        START_NS + 2 * S,
        LinkEventKind.COMPUTER,
        details=(Reason(LinkCode.SYSTEM_TIME_SET, step_s=3600.0, ahead_s=3600.0),),
    )
    wheel = [item for item in items if item.link != LINK]
    path = written([*wheel[:50], step, *wheel[50:]], toml, tmp_path / "r.mcap")
    run("set-clock", path)
    dated = tmp_path / "r.dated.mcap"
    assert RecordingReader(dated).info.start_ns == START_NS + 3600 * S
    (remaining,) = [
        i for i in RecordingReader(dated).items() if isinstance(i, LinkEvent) and i.kind is LinkEventKind.COMPUTER
    ]
    assert remaining.details[0]["ahead_s"] == 0.0
    assert invoked("set-clock", dated, "--out", tmp_path / "b.mcap").exit_code != 0
    far = invoked("set-clock", path, "--ahead=-4e9", "--out", tmp_path / "c.mcap")
    assert "1970" in str(far.exception)
    assert not (tmp_path / "c.mcap").exists()


def test_files_of_other_programs_get_no_other_time(tmp_path) -> None:
    path, target = tmp_path / "other.mcap", tmp_path / "dated.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start("ros2", "other")
        writer.finish()
    with pytest.raises(RecordingError, match="nothing of a hub") as error:
        set_clock(path, target, 5.0)
    assert "another program" in error.value.remedy
    assert not target.exists()


def test_copy_with_another_time_has_its_name_when_it_is_whole(drive, tmp_path) -> None:
    items, toml = drive
    path = written(items, toml, tmp_path / "r.mcap")
    target = tmp_path / "dated.mcap"

    def stops(position: int, _total: int) -> None:
        assert not target.exists()
        if position > 20_000:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        set_clock(path, target, 60.0, stops)
    assert [entry.name for entry in tmp_path.iterdir()] == ["r.mcap"]
