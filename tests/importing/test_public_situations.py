"""Files as issues of other projects describe them, rebuilt: what was wrong with them stays right."""

import struct
import tomllib
from pathlib import Path

import numpy as np
import pytest

from gateway.core.errors import ImportDataError
from gateway.importing.header_conditions import stated_conditions
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from tests.importing.measurements import simple_map, write_csv
from tests.importing.rolling_wheel import rolling

RATE_HZ = 6400.0
WHEEL = rolling(RATE_HZ, 0.6, seed=13)
AXES = dict(zip("xyz", WHEEL.axes_mps2.T, strict=True))


def write_imu(path: Path, stamps_ns: list[int]) -> Path:
    writer_module = pytest.importorskip("mcap.writer")
    with path.open("wb") as file:
        writer = writer_module.Writer(file)
        writer.start("ros2", "test")
        channel = writer.register_channel("/a", "cdr", writer.register_schema("sensor_msgs/msg/Imu", "ros2msg", b""))
        for row, (stamp_ns, axes) in enumerate(zip(stamps_ns, WHEEL.axes_mps2, strict=True)):
            body = struct.pack("<iII", *divmod(stamp_ns, 10**9), 4) + b"imu\0"
            body += struct.pack("<37d", *[0.0] * 25, *axes, *[0.0] * 9)
            writer.add_message(channel, 10**18 + round(row * 1e9 / RATE_HZ), b"\0\1\0\0" + body, stamp_ns, row)
        writer.finish()
    return path


@pytest.mark.parametrize("each", [6, 7, 40])
def test_repeated_stamps_are_no_other_rate(tmp_path: Path, each: int) -> None:
    rows = np.arange(len(WHEEL.times_s))
    stamps = 10**18 + np.round((rows - (rows % each == 2)) * 1e9 / RATE_HZ).astype(int)
    path = write_imu(tmp_path / "a.mcap", stamps.tolist())
    assert "# rate_hz = 6400   # ? 'a/time' repeats in row 3" in guess_map(path)
    text = simple_map(**{
        "sampling": 'time_column = "a/time"', "axis.radial": 'column = "a/linear_acceleration.z"\nunit = "m/s^2"',
        "axis.lateral": "", "axis.circumferential": "",
    })  # fmt: skip
    with pytest.raises(ImportDataError, match="steps by") as caught:
        import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    assert "state rate_hz (about 6400" in caught.value.remedy


def test_stamps_that_are_all_zero_give_way_to_those_of_logging(tmp_path: Path) -> None:
    text = guess_map(write_imu(tmp_path / "a.mcap", [0] * len(WHEEL.times_s)))
    assert 'time_column = "a/time"   # 6400 Hz' in text
    assert "all stamps of /a are 0 ns" in text


def test_unit_of_time_that_cannot_be_is_marked(tmp_path: Path) -> None:
    text = guess_map(write_csv(tmp_path / "run.csv", {"tow (msec)": WHEEL.times_s, **AXES}))
    assert 'time_unit = "s"' in text
    assert "? 6400 Hz in its first rows, its name says ms, in which it would be 6.4e+06 Hz" in text


def test_size_shows_millimetres(tmp_path: Path) -> None:
    columns = {"#time": WHEEL.times_s, **{f"accel_{axis}": values * 1e3 for axis, values in AXES.items()}}
    radial = tomllib.loads(guess_map(write_csv(tmp_path / "run.csv", columns)))["axis"]["radial"]
    assert (radial["column"], radial["unit"], radial["scale"]) == ("accel_z", "m/s^2", 0.001)


def test_names_units_and_sources_stand_in_three_lines(tmp_path: Path) -> None:
    rows = [";".join(f"{value:.6f}" for value in row) for row in np.column_stack((WHEEL.times_s, WHEEL.axes_mps2))]
    path = tmp_path / "run.csv"
    path.write_text("\n".join(["TIME;ACCX;ACCY;ACCZ", "S;m/s2;m/s2;m/s2", ";b1;b1;b1", *rows]) + "\n")
    report = import_file(path, parse_map(guess_map(path), "map"), tmp_path / "out.mcap")
    assert (report.samples, report.rate_hz) == (len(rows), pytest.approx(RATE_HZ))


def test_times_of_day_of_parquet_are_times(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    of_day_us = 43_200_000_000 + np.round(WHEEL.times_s * 1e6).astype(np.int64)
    pq.write_table(pa.table({"t": pa.array(of_day_us, pa.time64("us")), **AXES}), tmp_path / "run.parquet")
    assert 'time_column = "t"   # 6400 Hz' in guess_map(tmp_path / "run.parquet")


@pytest.mark.parametrize(
    ("line", "day", "place"),
    [
        ('"Log Date","17/05/2024"', "2024-05-17", "line 1"), ('"Log Date","05/17/2024"', "2024-05-17", "line 1"),
        ('"Log Date","05/07/2024"', "2024-07-05", "line 1, day first"), ("# May 7, 2024", "2024-05-07", "line 1"),
    ],
)  # fmt: skip
def test_dates_of_loggers_are_read(line: str, day: str, place: str) -> None:
    assert stated_conditions([line]) == [("date", day, place)]
