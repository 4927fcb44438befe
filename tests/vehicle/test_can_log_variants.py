"""CAN logs as other programs write them: times, channels and ends."""

import threading
from pathlib import Path

import pytest

from gateway.core.clock import ManualClock
from gateway.core.errors import SourceError
from gateway.core.links.bus_frames import BusFrame, pack, unpack
from gateway.core.links.source import BusFrames, LinkEvent, open_source
from gateway.vehicle.bus_decoding import BusDecoder
from gateway.vehicle.reasons import VehicleCode
from gateway.vehicle.vehicle_signals import SignalSetup

can = pytest.importorskip("can")
BYTES = "64 19 FF 00"


def frames_of(path: Path, options: str = "") -> list[BusFrame]:
    items = open_source(f"can:{path}?speed=max{options}", ManualClock()).items(threading.Event())
    return [frame for item in items if isinstance(item, BusFrames) for frame in unpack(item.data, item.host_ns)]


def written(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize(
    ("header", "stamps"),
    [
        (["base hex  timestamps relative", "no internal events logged"], [0.05] * 40),
        (["base hex  timestamps absolute", "no internal events logged"], [0.05 * (k + 1) for k in range(40)]),
        (["base hex  no internal events logged", "// version 7.1.0"], [0.05 * (k + 1) for k in range(40)]),
        (["base hex  timestamps absolute", "Begin Triggerblock", "   0.000000 CANFD   Start of measurement"],
         [0.05 * (k + 1) for k in range(40)]),
    ],
)  # fmt: skip
def test_stamps_of_asc_logs_count_from_their_start(tmp_path: Path, header: list[str], stamps: list[float]) -> None:
    lines = [f"   {stamp:.6f} 2  204             Rx   d 4 {BYTES}" for stamp in stamps]
    frames = frames_of(written(tmp_path / "a.asc", ["date Mon Dec 6 11:21:13 am 2021", *header, *lines]))
    assert [frame.host_ns for frame in frames] == [50_000_000 * (k + 1) for k in range(40)]
    assert {frame.channel for frame in frames} == {2}


def test_stamps_before_the_trigger_are_kept(tmp_path: Path) -> None:
    lines = [f"   {0.05 * k - 1.0:.6f} 1  204             Rx   d 4 {BYTES}" for k in range(40)]
    frames = frames_of(written(tmp_path / "a.asc", ["base hex  timestamps absolute", *lines]), "&offset_s=100")
    assert len(frames) == 40
    assert frames[0].host_ns == pytest.approx(99e9, abs=1e3)


@pytest.mark.parametrize("stamp", ["(1795697700.250000)", "(2026-11-26 12:15:00.250000)"])
def test_console_of_candump_is_read(tmp_path: Path, stamp: str) -> None:
    lines = [f" {stamp}  can{k % 2}  204   [4]  {BYTES}" for k in range(6)]
    lines.insert(3, f" {stamp}  can0  20000004   [8]  00 00 00 00 00 00 00 00   ERRORFRAME")
    lines.insert(4, f" {stamp}  can0  18FF0204   [2]  01 02")
    frames = frames_of(written(tmp_path / "c.log", lines))
    assert [frame.is_error for frame in frames].count(True) == 1
    assert [frame.can_id for frame in frames if frame.is_extended] == [0x18FF0204]
    assert [(frame.channel, frame.data) for frame in frames if frame.can_id == 0x204] == [
        (k % 2, bytes.fromhex(BYTES)) for k in range(6)
    ]
    assert frames[0].host_ns % 1_000_000_000 == 250_000_000


@pytest.mark.parametrize("line", ["  can0  204   [4]  64 19 FF 00", " (12) can0 204 [1] 00", "hello world"])
def test_line_that_is_none_is_named(tmp_path: Path, line: str) -> None:
    with pytest.raises(SourceError, match="line 1"):
        frames_of(written(tmp_path / "c.log", [line]))


@pytest.mark.parametrize("head", ["Time Stamp,ID,Extended,Dir,Bus,LEN,D1,D2", "Time Stamp,ID,Extended,Bus,LEN,D1,D2"])
def test_csv_of_savvycan_is_read(tmp_path: Path, head: str) -> None:
    direction = "Rx," if "Dir" in head else ""
    lines = [f"{166064000 + 1000 * k},00000204,false,{direction}{k % 2},2,64,{k:02X}," for k in range(8)]
    frames = frames_of(written(tmp_path / "s.csv", [head, *lines]))
    assert [(frame.host_ns, frame.channel, frame.data) for frame in frames] == [
        ((166064000 + 1000 * k) * 1000, k % 2, bytes([0x64, k])) for k in range(8)
    ]


def test_channel_of_a_log_is_chosen(tmp_path: Path) -> None:
    path = written(tmp_path / "two.log", [f"({1795697700 + 0.05 * k:.6f}) can{k % 2} 204#6419" for k in range(10)])
    assert len(frames_of(path)) == 10
    assert {frame.channel for frame in frames_of(path, "&channel=can1")} == {1}
    with pytest.raises(SourceError, match="no channel 7"):
        frames_of(path, "&channel=7")


def test_cut_blf_is_told(tmp_path: Path) -> None:
    path = tmp_path / "cut.blf"
    with can.BLFWriter(str(path), compression_level=0, max_container_size=400) as log:
        for k in range(60):
            log(can.Message(timestamp=1.7e9 + 0.1 * k, arbitration_id=0x204, data=[k], is_extended_id=False))
    path.write_bytes(path.read_bytes()[:-500])
    items = list(open_source(f"can:{path}?speed=max", ManualClock()).items(threading.Event()))
    told = [item.text for item in items if isinstance(item, LinkEvent)]
    assert any("the file is cut" in text for text in told)


def test_message_of_two_buses_is_decoded_from_the_first_and_told_once() -> None:
    dbc = 'VERSION ""\nBU_: E\nBO_ 516 S: 8 E\n SG_ V : 0|16@1+ (0.01,0) [0|300] "km/h" E\n'
    decoder = BusDecoder([SignalSetup("vehicle_speed", "S", "V")], 1.0, dbc, "s.dbc")
    frames = [
        BusFrame(k * 10**7, 516, False, (6500 if k % 2 == 0 else 12000).to_bytes(2, "little") + bytes(6), channel=k % 2)
        for k in range(10)
    ]
    values = [value.value for value in decoder.values(BusFrames("can:x", 0, pack(frames, 0)))]
    assert values == pytest.approx([65.0 / 3.6] * 5)
    ((link, reason),) = decoder.take_notices()
    assert (link, reason.code) == ("can:x", VehicleCode.BUS_MESSAGE_TWICE)
    assert decoder.take_notices() == []


def test_escape_in_the_name_of_a_file_is_part_of_it(tmp_path: Path) -> None:
    lines = [f"({1795697700 + 0.05 * k:.6f}) can0 204#6419" for k in range(4)]
    assert len(frames_of(written(tmp_path / "my%20run.log", lines))) == 4
    written(tmp_path / "other run.log", lines)
    assert len(frames_of(tmp_path / "other%20run.log")) == 4


@pytest.mark.parametrize("suffix", ["log", "asc"])
def test_log_without_frames_is_refused(tmp_path: Path, suffix: str) -> None:
    with pytest.raises(SourceError):
        frames_of(written(tmp_path / f"none.{suffix}", ["// nothing"]))


def test_lines_out_of_order_and_cut_are_told(tmp_path: Path) -> None:
    lines = [f"({1795697700 + 0.05 * (k % 20):.6f}) can0 204#6419" for k in range(40)]
    path = tmp_path / "twice.log"
    path.write_text("\n".join(lines))
    items = list(open_source(f"can:{path}?speed=max", ManualClock()).items(threading.Event()))
    told = [item.text for item in items if isinstance(item, LinkEvent)]
    codes = [reason.code for item in items if isinstance(item, LinkEvent) for reason in item.details]
    assert codes == [VehicleCode.LOG_STEPS_BACK]
    assert any("last line has no end" in text for text in told)


@pytest.mark.parametrize("is_apart", [True, False])
def test_times_of_candump_since_the_last_frame_add_up(tmp_path: Path, is_apart: bool) -> None:
    steps_s = [0.0, *(0.01 + 0.004 * (k % 3) for k in range(40))]
    times_s = [sum(steps_s[: k + 1]) for k in range(len(steps_s))]
    rows = [
        f" ({step if is_apart else time:010.6f})  can0  RX B -  204  [02]  {k:02X} 10"
        for k, (step, time) in enumerate(zip(steps_s, times_s, strict=True))
    ]
    frames = frames_of(written(tmp_path / "console.log", rows))
    assert [frame.host_ns * 1e-9 for frame in frames] == pytest.approx(times_s)
    assert all(frame.is_fd and frame.data[1] == 0x10 for frame in frames)


@pytest.mark.parametrize("end", ["     41    0.0410 DT 1 0204 Rx - 2  1", "     41    0.0410 DT 1 02"])
def test_cut_trc_is_told_and_keeps_its_frames(tmp_path: Path, end: str) -> None:
    head = [";$FILEVERSION=2.1", ";$STARTTIME=45415.25", ";$COLUMNS=N,O,T,B,I,d,R,L,D"]
    rows = [f"{k:7} {k * 1e-3:9.4f} DT 1 0204 Rx - 2  19 {k:02X}" for k in range(1, 41)]
    path = tmp_path / "cut.trc"
    path.write_text("\n".join([*head, *rows, end]))
    items = list(open_source(f"can:{path}?speed=max", ManualClock()).items(threading.Event()))
    assert sum(len(list(unpack(item.data, item.host_ns))) for item in items if isinstance(item, BusFrames)) == 40
    said = " ".join(item.text for item in items if isinstance(item, LinkEvent))
    assert "cannot be read" in said or "may be cut" in said
