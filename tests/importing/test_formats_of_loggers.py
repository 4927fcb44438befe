"""Files of loggers and programs, after their public descriptions: channels, units, rates and starts arrive."""

import struct
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gateway.core.errors import ImportDataError
from gateway.importing.import_map import parse_map
from gateway.importing.importer import ImportReport, import_file
from gateway.importing.map_guess import guess_map
from gateway.importing.reasons import ImportCode
from tests.importing.measurements import Decoded, write_csv
from tests.importing.rolling_wheel import rolling

G = 9.80665
RATE_HZ = 8000.0
WHEEL = rolling(RATE_HZ, 0.5, seed=7)
AXES_G = WHEEL.axes_mps2 / G
NAMES = ("acc_x", "acc_y", "acc_z")


def write_famos(path: Path, *, rows: int | None = None, repeated: bool = False) -> Path:
    """Write float channels; with `repeated`, all data have the number 1."""

    def key(name: str, content: str) -> bytes:
        return f"|{name},1,{len(content)},{content};\r\n".encode()

    parts = [b"|CF,2,1,1;|CK,1,3,1,1;\r\n"]
    for k, name in enumerate(NAMES):
        number = 1 if repeated else k + 1
        counts = np.round(AXES_G[:, k] / 0.01).astype("<i2").tobytes()
        stored = counts if rows is None or k < 2 else counts[: 2 * rows]
        parts += [
            key("CG", "1,1,1"), key("CD", f"{1.0 / RATE_HZ!r},1,1,s,0,0,0"), key("NT", "1,5,2024,12,0,0.25"),
            key("CC", "1,1"), key("CP", "1,2,4,16,0,0,1,0"),
            key("Cb", f"1,0,1,{number},0,{len(counts)},0,{len(counts)},1,0.0,0.0,"),
            key("CR", "1,0.01,0.0,1,1,g"), key("CN", f"0,0,0,{len(name)},{name},0,"),
            f"|CS,1,{len(stored) + 2},{number},".encode() + stored + b";\r\n",
        ]  # fmt: skip
    path.write_bytes(b"".join(parts))
    return path


def write_imu(
    path: Path,
    topics: tuple[str, ...] = ("/imu",),
    stamp_of: Callable[[int], int] = lambda log_ns: log_ns,
    apart_ns: int = 0,
) -> Path:
    """Write a message for each sample; `stamp_of` returns its stamp by the time of logging, ns.

    Each topic is `apart_ns` later than the one before.
    """
    writer_module = pytest.importorskip("mcap.writer")
    with path.open("wb") as file:
        writer = writer_module.Writer(file)
        writer.start("ros2", "rosbag2")
        schema = writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b"")
        for number, topic in enumerate(topics):
            channel = writer.register_channel(topic, "cdr", schema)
            for row, axes in enumerate(WHEEL.axes_mps2):
                log_ns = 1_714_640_070_000_000_000 + round(row * 1e9 / RATE_HZ)
                body = struct.pack("<iII", *divmod(stamp_of(log_ns) + number * apart_ns, 10**9), 5) + b"base\0"
                body += b"\0" * (-len(body) % 8) + struct.pack("<37d", *[0.0] * 25, *axes, *[0.0] * 9)
                writer.add_message(channel, log_ns, b"\0\1\0\0" + body, log_ns, row)
        writer.finish()
    return path


def write_vbo(path: Path) -> Path:
    heads = ["satellites", "time", "latitude", "longitude", "velocity knots", "heading", "Acc X", "Acc Y", "Acc Z"]
    rows = [
        f"004 {72148 + int(t):06d}.{round(t % 1 * 1e6):06d} +3119.4 +00062.6 035.0 356.06 "
        + " ".join(f"{v:.6E}" for v in a)
        for t, a in zip(WHEEL.times_s, AXES_G, strict=True)
    ]
    path.write_text("\r\n".join([
        "File created on 15/04/2024 @ 08:21", "", "[header]", *heads, "", "[channel units]", "g", "g", "g", "",
        "[comments]", "Log Rate (Hz) : 8000", "", "[column names]", "sats time lat long velocity heading ax ay az", "",
        "[data]", *rows, "",
    ]))  # fmt: skip
    return path


def write_parquet_lists(path: Path) -> Path:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    blocks = AXES_G.reshape(-1, 40, 3)
    stamps = np.round(WHEEL.times_s[::40] * 1e9).astype("timedelta64[ns]")
    columns = {"time": pa.array(stamps), **{name: pa.array(list(blocks[:, :, k])) for k, name in enumerate(NAMES)}}
    pq.write_table(pa.table(columns), path)
    return path


def write_wav(path: Path) -> Path:
    from scipy.io import wavfile

    wavfile.write(path, int(RATE_HZ), AXES_G.astype(np.float32))
    return path


def write_npz(path: Path) -> Path:
    np.savez(path, acc=AXES_G, fs=RATE_HZ)
    return path


def write_motec(path: Path) -> Path:
    head = ['"Format","MoTeC CSV File"', '"Venue","Rig"', '"Sample Rate","8000.000","Hz"', "", ""]
    names = ['"Time","Acc X","Acc Y","Acc Z"', '"s","G","G","G"', "", ""]
    rows = [
        ",".join(f'"{value:.6f}"' for value in (time, *axes)) for time, axes in zip(WHEEL.times_s, AXES_G, strict=True)
    ]
    path.write_text("\r\n".join([*head, *names, *rows]) + "\r\n")
    return path


def write_aim(path: Path) -> Path:
    head = ['"Format","AiM CSV File"', '"Date","Wednesday, May 1, 2024"', '"Time","2:30 PM"', '"Sample Rate","8000"',
            '"Segment","Session"', '"Beacon Markers","0.2","0.4"', ""]  # fmt: skip
    names = ['"Time","VerticalAcc","InlineAcc","LateralAcc"', '"s","g","g","g"', ""]
    rows = [
        ",".join(f'"{value:.6f}"' for value in (time, *axes[[2, 0, 1]]))
        for time, axes in zip(WHEEL.times_s, AXES_G, strict=True)
    ]
    path.write_text("\r\n".join([*head, *names, *rows]) + "\r\n")
    return path


def write_tydex(path: Path) -> Path:
    """Write measured values in steps with a factor and both offsets."""
    lines = ["**HEADER", *(f"{key:<50}{value}" for key, value in (
        ("RELEASE", "1.3"), ("MEASID", "rig 7"), ("DATE", "01.05.2024"), ("CLCKTIME", "12:00:05"),
    )), "**CONSTANTS", f"{'FZW':<10}{'wheel load':<30}{'kN':<10}4.2", "**MEASURCHANNELS"]  # fmt: skip
    lines += [f"{'RUNTIME':<10}{'time':<30}{'s':<10}{1:<10}{0:<10}{0}"]
    lines += [f"{name.upper():<10}{'acceleration':<30}{'g':<10}{0.01:<10}{-5:<10}{0.25}" for name in NAMES]
    lines += ["**MEASURDATA"]
    for time, axes in zip(WHEEL.times_s, AXES_G, strict=True):
        lines.append(f"{time:.6f} " + " ".join(f"{(value - 0.25) / 0.01 + 5:.1f}" for value in axes))
    path.write_text("\r\n".join([*lines, "**END", ""]))
    return path


def write_xlsx(path: Path) -> Path:
    openpyxl = pytest.importorskip("openpyxl")
    book = openpyxl.Workbook(write_only=True)
    notes, data = book.create_sheet("Notes"), book.create_sheet("Run 7")
    notes.append(["tire", "205/55R16"])
    for row in (["Drum", "north"], ["Range", 50], [], ["t", *NAMES, "pass"], ["s", "g", "g", "g", "-"]):
        data.append(row)
    for time, axes in zip(WHEEL.times_s, AXES_G, strict=True):
        data.append([float(time), *map(float, axes), "ok"])
    book.save(path)
    return path


def write_wav_to_a_pipe(path: Path) -> Path:
    """Write the open sizes of a program that cannot go back, and a text before the samples."""
    content = bytearray(write_wav(path).read_bytes())
    place = content.index(b"data")
    text = b"LIST" + struct.pack("<I", 18) + b"INFOISFT\x06\0\0\0rec 1\0"
    content[place : place + 8] = text + b"data" + b"\xff" * 4
    content[4:8] = b"\xff" * 4
    path.write_bytes(content)
    return path


def write_parquet_by_duckdb(path: Path) -> Path:
    """Write decimals, as data bases do."""
    duckdb, pl = pytest.importorskip("duckdb"), pytest.importorskip("polars")
    frame = pl.DataFrame({"t_s": WHEEL.times_s, **dict(zip(NAMES, AXES_G.T, strict=True))})
    columns = ", ".join(f"cast({name} as decimal(14, 7)) as {name}" for name in frame.columns)
    duckdb.connect().register("run", frame.to_arrow()).sql(f"copy (select {columns} from run) to '{path}'")
    return path


def write_parquet_by_polars(path: Path) -> Path:
    """Write durations and lists of one length."""
    pl = pytest.importorskip("polars")
    blocks = AXES_G.reshape(-1, 40, 3)
    span = pl.Series(np.rint(WHEEL.times_s[::40] * 1e6).astype(np.int64)).cast(pl.Duration("us"))
    lists = {name: pl.Series(blocks[:, :, k], dtype=pl.Array(pl.Float32, 40)) for k, name in enumerate(NAMES)}
    pl.DataFrame({"elapsed": span, **lists}).write_parquet(path)
    return path


def write_npz_with_objects(path: Path) -> Path:
    np.savez_compressed(path, acc=np.asfortranarray(AXES_G), fs=[RATE_HZ], notes=np.array({"tire": 1}, dtype=object))
    return path


WRITERS = {
    "famos.raw": write_famos, "famos.dat": write_famos, "imu.mcap": write_imu, "log.vbo": write_vbo,
    "lists.parquet": write_parquet_lists, "daq.wav": write_wav, "run.npz": write_npz, "motec.csv": write_motec,
    "aim.csv": write_aim, "rig.tdx": write_tydex, "rig.xlsx": write_xlsx,
    "pipe.wav": write_wav_to_a_pipe, "duck.parquet": write_parquet_by_duckdb, "polars.parquet": write_parquet_by_polars,
    "objects.npz": write_npz_with_objects,
}  # fmt: skip


def imported(path: Path, text: str | None = None) -> ImportReport:
    out = path.parent / "out.mcap"
    out.unlink(missing_ok=True)
    return import_file(path, parse_map(text or guess_map(path), "map"), out)


@pytest.mark.parametrize("name", WRITERS)
def test_samples_and_rate_arrive(tmp_path: Path, name: str) -> None:
    path = WRITERS[name](tmp_path / name)
    report = imported(path)
    assert report.rate_hz == pytest.approx(RATE_HZ, rel=1e-4)
    assert report.samples == len(AXES_G)
    radial = Decoded(tmp_path / "out.mcap").samples_mps2[:, -1]
    np.testing.assert_allclose(radial, WHEEL.axes_mps2[:, 2], atol=0.15)


@pytest.mark.parametrize(
    ("name", "start"),
    [
        ("famos.raw", 1714564800.25), ("imu.mcap", 1714640070.0), ("rig.tdx", 1714564805.0),
        ("log.vbo", 1713139200.0 + 7 * 3600 + 21 * 60 + 48),
    ],
)  # fmt: skip
def test_start_of_the_file_is_that_of_the_recording(tmp_path: Path, name: str, start: float) -> None:
    report = imported(WRITERS[name](tmp_path / name))
    assert not report.start_is_file_date
    assert Decoded(report.recording).items[0].host_ns * 1e-9 == pytest.approx(start, abs=1e-3)


def test_channels_with_data_of_one_number_stay_apart(tmp_path: Path) -> None:
    text = guess_map(write_famos(tmp_path / "a.raw", repeated=True))
    assert 'column = "acc_z"   # mean' in text


def test_cut_channel_of_famos_is_told(tmp_path: Path) -> None:
    report = imported(write_famos(tmp_path / "cut.raw", rows=3000))
    assert report.samples == 3000
    assert any("'acc_z' has 3000 of 4000 samples" in text for text in report.assumed)


def test_topics_with_the_same_times_are_wheels_of_one_map(tmp_path: Path) -> None:
    path = write_imu(tmp_path / "two.mcap", ("/front/imu", "/rear/imu"))
    assert guess_map(path).count("[[wheel]]") == 2
    report = imported(path)
    assert (report.samples, len(report.wheels)) == (len(AXES_G), 2)


def test_topics_with_times_of_their_own_are_never_mixed(tmp_path: Path) -> None:
    path = write_imu(tmp_path / "two.mcap", ("/front/imu", "/rear/imu"), apart_ns=31_000)
    text = guess_map(path)
    assert "[[wheel]]" not in text
    assert 'column = "front/imu/linear_acceleration.z"' in text
    assert "rear/imu/linear_acceleration.z: rear/imu has times of its own: import it by another map" in text
    assert imported(path).samples == len(AXES_G)
    rear = text.replace('"front/imu/', '"rear/imu/')
    assert imported(path, rear).samples == len(AXES_G)
    mixed = text.replace("front/imu/linear_acceleration.x", "rear/imu/linear_acceleration.x")
    with pytest.raises(ImportDataError, match=r"of several sensors|times of their own"):
        imported(path, mixed)


def test_recording_starts_with_its_own_topic(tmp_path: Path) -> None:
    path = write_imu(tmp_path / "two.mcap", ("/front/imu", "/rear/imu"), apart_ns=5_000_000_000)
    rear = guess_map(path).replace('"front/imu/', '"rear/imu/')
    start_s = Decoded(imported(path, rear).recording).items[0].host_ns * 1e-9
    assert start_s == pytest.approx(1714640075.0, abs=1e-3)


def test_stamps_go_on_in_the_next_file_of_a_bag(tmp_path: Path) -> None:
    part_ns = round(len(AXES_G) * 1e9 / RATE_HZ)
    first = write_imu(tmp_path / "bag_0.mcap")
    second = write_imu(tmp_path / "bag_1.mcap", stamp_of=lambda log_ns: log_ns + part_ns)
    report = import_file([first, second], parse_map(guess_map(first), "map"), tmp_path / "out.mcap")
    assert (report.samples, report.left_out) == (2 * len(AXES_G), 0)


@pytest.mark.parametrize(
    ("name", "alias"),
    [("famos.raw", "x.bin"), ("run.npz", "x.raw"), ("daq.wav", "x"), ("rig.xlsx", "x.bin"), ("rig.tdx", "x.txt")],
)
def test_content_decides_the_format(tmp_path: Path, name: str, alias: str) -> None:
    path = WRITERS[name](tmp_path / name)
    if name == "run.npz":
        np.save(tmp_path / "run.npy", AXES_G)
        path = tmp_path / "run.npy"
    renamed = path.rename(tmp_path / alias)
    assert "[axis.radial]" in guess_map(renamed)


def test_bus_frames_of_mdf_are_sent_to_their_source(tmp_path: Path) -> None:
    can = pytest.importorskip("can")
    pytest.importorskip("asammdf")
    path = tmp_path / "bus.mf4"
    with can.Logger(path) as log:
        for k in range(10):
            log.on_message_received(can.Message(timestamp=1.7e9 + k, arbitration_id=0x204, data=[k]))
    with pytest.raises(ImportDataError, match="frames of a CAN bus") as caught:
        guess_map(path)
    assert "can:bus.mf4" in caught.value.remedy


def test_folder_of_parts_is_one_measurement(tmp_path: Path) -> None:
    folder = tmp_path / "parts"
    folder.mkdir()
    for number in range(12):
        rows = slice(number * 300, (number + 1) * 300)
        columns = {"time_s": WHEEL.times_s[rows], **{name: AXES_G[rows, k] for k, name in enumerate(NAMES)}}
        write_csv(folder / f"part_{number}.csv", columns)
    report = imported(folder)
    assert report.samples == 3600
    again = import_file([folder], parse_map(guess_map(folder), "map"), tmp_path / "again.mcap")
    assert again.samples == 3600
    (folder / "notes.pdf").write_text("no measurement")
    with pytest.raises(ImportDataError, match="several kinds of files"):
        imported(folder)


def test_unit_of_parts_that_are_shorter_than_a_revolution_is_checked(tmp_path: Path) -> None:
    folder = tmp_path / "parts"
    folder.mkdir()
    (folder / "_SUCCESS").touch()
    for part, first in enumerate(range(0, len(AXES_G), 400)):
        rows = slice(first, first + 400)
        columns = {"t": WHEEL.times_s[rows], **{name: AXES_G[rows, k] for k, name in enumerate(NAMES)}}
        write_csv(folder / f"part-{part}.csv", columns)
    text = guess_map(folder)
    assert text.count('unit = "g"') == 3
    for unit, is_fitting in (("g", True), ("m/s^2", False)):
        map_text = text.replace('unit = "g"', f'unit = "{unit}"')
        report = import_file(folder, parse_map(map_text, "map"), tmp_path / f"{is_fitting}.mcap")
        assert (report.wheels[0].findings == ()) is is_fitting


def test_day_and_time_above_the_columns_are_proposed(tmp_path: Path) -> None:
    assert "# start_utc = 2024-05-01T14:30:00Z   # ? date by line 2; time by line 3" in guess_map(
        write_aim(tmp_path / "a.csv")
    )


def test_constant_of_tydex_is_the_load(tmp_path: Path) -> None:
    assert "load_n = 4200   # ? stated in the file: column FZW" in guess_map(write_tydex(tmp_path / "rig.tdx"))


def test_cut_tydex_is_told(tmp_path: Path) -> None:
    path = write_tydex(tmp_path / "rig.tdx")
    path.write_bytes(path.read_bytes()[:100_000])
    assert any("no **END" in text for text in imported(path).assumed)


def test_sheet_is_the_group_of_its_columns_and_texts_are_told(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    path = write_xlsx(tmp_path / "rig.xlsx")
    book = openpyxl.load_workbook(path)
    book["Run 7"]["D900"] = "#DIV/0!"
    other = book.copy_worksheet(book["Run 7"])
    other.title = "Run 8"
    book.save(path)
    text = guess_map(path)
    assert 'column = "Run 7/acc_z"' in text
    assert 'column = "Run 8/acc_z"' in text
    assert text.count("[[wheel]]") == 2
    assert "sheet Run 7: 4001 cells are no numbers and left empty" in text


def test_formulas_without_values_are_no_gaps(tmp_path: Path) -> None:
    openpyxl = pytest.importorskip("openpyxl")
    path = write_xlsx(tmp_path / "rig.xlsx")
    book = openpyxl.load_workbook(path)
    for (cell,) in book["Run 7"]["D6:D4005"]:
        cell.value = f"=0.1*{cell.value}"
    book.save(path)
    assert "Run 7/acc_z: has no numbers. Formulas need to be saved with values." in guess_map(path)


@pytest.mark.parametrize("name", ["famos.raw", "daq.wav", "run.npz", "rig.xlsx"])
@pytest.mark.parametrize("held", [0.0, 3.5])
def test_samples_that_repeat_exactly_are_reported(tmp_path: Path, monkeypatch, name: str, held: float) -> None:
    dropped = AXES_G.copy()
    dropped[1500:1560] = held
    monkeypatch.setitem(globals(), "AXES_G", dropped)
    (finding,) = imported(WRITERS[name](tmp_path / name)).wheels[0].findings
    values = dict(finding.values)
    assert finding.code is ImportCode.VALUES_REPEATED
    assert (values["samples"], values["axes"]) == (60, "circumferential, lateral, radial")
    assert values["first_s"] == pytest.approx(1500 / RATE_HZ)


def test_single_axis_that_stops_is_reported(tmp_path: Path, monkeypatch) -> None:
    dropped = AXES_G.copy()
    dropped[1500:1560, 1] = 0.0
    monkeypatch.setitem(globals(), "AXES_G", dropped)
    (finding,) = imported(write_npz(tmp_path / "run.npz")).wheels[0].findings
    assert dict(finding.values)["axes"] == "lateral"


def test_coarse_steps_and_saturation_are_no_dropouts(tmp_path: Path, monkeypatch) -> None:
    coarse = np.round(AXES_G / 4.0) * 4.0
    coarse[:, 2] = np.minimum(AXES_G[:, 2], 125.0)
    monkeypatch.setitem(globals(), "AXES_G", coarse)
    findings = imported(write_npz(tmp_path / "run.npz")).wheels[0].findings
    assert ImportCode.VALUES_REPEATED not in [finding.code for finding in findings]
