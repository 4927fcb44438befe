"""Files as issues of other projects describe them, rebuilt: what was wrong with them stays right."""

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
from tests.importing.test_formats_of_loggers import write_imu

RATE_HZ = 6400.0
WHEEL = rolling(RATE_HZ, 0.6, seed=13)
AXES = dict(zip("xyz", WHEEL.axes_mps2.T, strict=True))


@pytest.mark.parametrize("each", [6, 7, 40])
def test_repeated_stamps_are_no_other_rate(tmp_path: Path, each: int) -> None:
    first_ns, step_ns = 1_714_640_070_000_000_000, 125_000

    def stamp_of(log_ns: int) -> int:
        return log_ns - step_ns * ((log_ns - first_ns) // step_ns % each == 2)

    path = write_imu(tmp_path / "a.mcap", stamp_of=stamp_of)
    assert "# rate_hz = 8000   # ? 'imu/time' repeats in row 3" in guess_map(path)
    text = simple_map(**{
        "sampling": 'time_column = "imu/time"', "axis.radial": 'column = "imu/linear_acceleration.z"\nunit = "m/s^2"',
        "axis.lateral": "", "axis.circumferential": "",
    })  # fmt: skip
    with pytest.raises(ImportDataError, match="steps by") as caught:
        import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    assert "state rate_hz (about 8000" in caught.value.remedy


def test_stamps_that_are_all_zero_give_way_to_those_of_logging(tmp_path: Path) -> None:
    text = guess_map(write_imu(tmp_path / "a.mcap", stamp_of=lambda _: 0))
    assert 'time_column = "imu/time"   # 8000 Hz' in text
    assert "all stamps of /imu are 0 ns" in text


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
    assert stated_conditions({"line 1": line}) == [("date", day, place)]
