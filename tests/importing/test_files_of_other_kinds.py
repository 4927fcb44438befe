"""Files of each kind once more: names in other languages, starts, fills, and what a file is."""

import tomllib
from pathlib import Path
from typing import Any

import asammdf
import h5py
import nptdms
import numpy as np
import pytest
import scipy.io

from gateway.core.errors import ImportDataError
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from tests.importing.measurements import Decoded, write_csv
from tests.importing.rolling_wheel import rolling
from tests.importing.test_stranger_files import line_of

RATE_HZ = 6400.0
WHEEL = rolling(RATE_HZ, 1.5, speed_mps=15.0, seed=31)
OTHER = rolling(RATE_HZ, 1.5, speed_mps=11.0, seed=32)
NAMES = ("b_tang", "b_lat", "b_rad")


def axes_of(text: str) -> dict[str, str]:
    return {name: axis["column"] for name, axis in tomllib.loads(text).get("axis", {}).items()}


def text_file(path: Path, columns: dict[str, Any], encoding: str = "utf-8", above: str = "") -> Path:
    rows = zip(*columns.values(), strict=True)
    lines = [";".join(columns), *(";".join(str(cell) for cell in row) for row in rows)]
    path.write_bytes((above + "\n".join(lines) + "\n").encode(encoding))
    return path


@pytest.mark.parametrize(
    ("name", "unit", "per_s"),
    [("tiempo (seg)", "s", 1.0), ("horloge_us", "us", 1e6), ("temps_ms", "ms", 1e3), ("t_min", "min", 1 / 60),
     ("mSec", "ms", 1e3), ("时间(ms)", "ms", 1e3), ("tick_us", "us", 1e6)],
)  # fmt: skip
def test_time_is_named_in_other_words(tmp_path: Path, name: str, unit: str, per_s: float) -> None:
    slow = rolling(80.0, 12.0, seed=4)
    path = write_csv(tmp_path / "slow.csv", {name: slow.times_s * per_s, "ax": slow.axes_mps2[:, 0],
                                             "az": slow.axes_mps2[:, 2]})  # fmt: skip
    text = guess_map(path)
    assert f'time_unit = "{unit}"' in text
    assert "? 80 Hz in its first rows, too low" in line_of(text, "time_column")


@pytest.mark.parametrize("code_page", ["gb18030", "shift_jis", "cp1251"])
def test_names_of_another_code_page_are_one_line(tmp_path: Path, code_page: str) -> None:
    word = {"gb18030": "加速度", "shift_jis": "加速度", "cp1251": "ускорение"}[code_page]
    columns = {"t (s)": WHEEL.times_s, **{f"{word}{k}": WHEEL.axes_mps2[:, k] for k in range(3)}}
    path = text_file(tmp_path / "run.csv", columns, code_page)
    text = guess_map(path)
    assert 'time_column = "t (s)"' in text
    assert import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").samples == len(WHEEL.times_s)


def starts_in_hdf5(path: Path, starts: tuple[int, int, int]) -> Path:
    with h5py.File(path, "w") as file:
        for name, first, axis in zip(NAMES, starts, WHEEL.axes_mps2.T, strict=True):
            data = file.create_dataset(f"cell/{name}", data=axis[first:])
            data.attrs.update(dt=1 / RATE_HZ, t0=first / RATE_HZ, units="m/s^2")
    return path


def starts_in_mdf(path: Path, starts: tuple[int, int, int]) -> Path:
    with asammdf.MDF() as file:
        for name, first, axis in zip(NAMES, starts, WHEEL.axes_mps2.T, strict=True):
            file.append([asammdf.Signal(axis[first:], WHEEL.times_s[first:], name=name, unit="m/s^2")])
        file.save(path)
    return path


def starts_in_famos(path: Path, starts: tuple[int, int, int]) -> Path:
    """Write the keys as imc describes them; version 2 of CD has the start, and says that it counts."""

    def key(name: str, version: int, content: str) -> bytes:
        return f"|{name},{version},{len(content)},{content};".encode()

    head, body = b"|CF,2,1,1;|CK,1,3,1,1;", b""
    for number, (name, first, axis) in enumerate(zip(NAMES, starts, WHEEL.axes_mps2.T, strict=True), 1):
        data = axis[first:].astype("<f8").tobytes()
        head += key("CG", 1, "1,1,1") + key("CD", 2, f"{1 / RATE_HZ!r},1,1,s,0,0,0,{first / RATE_HZ!r},2")
        head += key("CC", 1, "1,1") + key("CP", 1, f"{number},8,8,64,0,0,1,0")
        head += key("Cb", 1, f"1,0,{number},1,{len(body)},{len(data)},0,{len(data)},1,0,0,")
        head += key("CR", 1, "0,1,0,1,5,m/s^2") + key("CN", 1, f"0,0,0,{len(name)},{name},0,")
        body += data
    path.write_bytes(head + f"|CS,1,{len(body) + 2},1,".encode() + body + b";")
    return path


@pytest.mark.parametrize(
    ("write", "name", "common"),
    [(starts_in_hdf5, "run.h5", True), (starts_in_mdf, "run.mf4", False), (starts_in_famos, "run.raw", True)],
)
def test_channels_that_start_apart_are_aligned(tmp_path: Path, write: Any, name: str, common: bool) -> None:
    path = write(tmp_path / name, (0, 40, 90))
    text = guess_map(path)
    assert {column.rpartition("/")[2] for column in axes_of(text).values()} == set(NAMES)
    report = import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    assert report.samples == len(WHEEL.times_s) - 90 * common
    decoded = Decoded(tmp_path / "out.mcap")
    sizes = np.abs(WHEEL.axes_mps2).max(axis=0)
    assert np.abs(decoded.samples_mps2[-5000:] - WHEEL.axes_mps2[-5000:]).max(axis=0) == pytest.approx(
        0, abs=1e-3 * sizes.max()
    )


def test_starts_between_the_steps_are_refused(tmp_path: Path) -> None:
    path = starts_in_hdf5(tmp_path / "run.h5", (0, 40, 90))
    text = guess_map(path)
    with h5py.File(path, "a") as file:
        file["cell/b_rad"].attrs["t0"] = 90.4 / RATE_HZ
    with pytest.raises(ImportDataError, match="no whole number of steps"):
        import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")


@pytest.mark.parametrize("fill", ["0", "-1", "-", "n/a"])
def test_rows_without_a_stamp_have_a_fill(tmp_path: Path, fill: str) -> None:
    stamps = [f"{9.0 + time:.6f}" if row % 20 == 0 else fill for row, time in enumerate(WHEEL.times_s)]
    columns = {"clock time (s)": stamps, **dict(zip(("ax", "ay", "az"), WHEEL.axes_mps2.T, strict=True))}
    text = guess_map(text_file(tmp_path / "run.csv", columns))
    if fill[-1].isdigit():
        assert f"has a time once in 20 rows, and {fill} between; 6400 Hz" in line_of(text, "# rate_hz")
    else:
        assert "6400 Hz in its first rows" in line_of(text, "time_column")
        assert f"'{fill}' is not a number" in line_of(text, 'unreadable = "missing"')
    assert axes_of(text)["radial"] == "az"


def test_time_of_day_in_parts_gives_the_rate(tmp_path: Path) -> None:
    micros = np.rint(WHEEL.times_s * 1e6 + 700_000).astype(int)
    columns = {"Hour": np.full(len(micros), 9), "Min": np.full(len(micros), 5), "Sec": 7 + micros // 10**6,
               "Micros": micros % 10**6, "AccRad": WHEEL.axes_mps2[:, 2]}  # fmt: skip
    text = guess_map(text_file(tmp_path / "run.csv", columns))
    assert "rate_hz = 6400 " in text
    assert "reference" not in tomllib.loads(text)


@pytest.mark.parametrize("name", ["run.h5", "run.tdms", "run.mat"])
def test_conditions_in_attributes_are_taken(tmp_path: Path, name: str) -> None:
    path, said = tmp_path / name, {"Reifen": "235/40 R18", "wheel_load_kN": 4.9, "inflation_bar": "2.6"}
    if name == "run.h5":
        with h5py.File(path, "w") as file:
            file.attrs.update(said, fs=RATE_HZ)
            file["acc_rad"] = WHEEL.axes_mps2[:, 2]
    elif name == "run.tdms":
        with nptdms.TdmsWriter(path) as writer:
            channel = nptdms.ChannelObject("a", "acc_rad", WHEEL.axes_mps2[:, 2], {"wf_increment": 1 / RATE_HZ})
            writer.write_segment([nptdms.RootObject(said), channel])
    else:
        scipy.io.savemat(path, {"test": {**said, "acc_rad": WHEEL.axes_mps2[:, 2], "fs": RATE_HZ}})
    conditions = tomllib.loads(guess_map(path))["conditions"]
    assert (conditions["tire"], conditions["load_n"], conditions["pressure_kpa"]) == ("235/40 R18", 4900, 260)


def test_channels_that_name_no_sensor_are_not_mixed(tmp_path: Path) -> None:
    both = np.column_stack((WHEEL.axes_mps2, OTHER.axes_mps2))
    path = write_csv(tmp_path / "run.csv", {"t_s": WHEEL.times_s, **{f"AI{k}": both[:, k] for k in range(6)}})
    text = guess_map(path)
    assert axes_of(text) == {"radial": "AI2"}
    assert "it may be of another sensor" in line_of(text, "# column = ")


def test_one_value_in_a_row_is_refused(tmp_path: Path) -> None:
    count = 900
    columns = {"time": np.repeat(WHEEL.times_s[:count], 3), "direction": np.tile(["X", "Y", "Z"], count),
               "acc": WHEEL.axes_mps2[:count].ravel()}  # fmt: skip
    with pytest.raises(ImportDataError, match="one value, of the axis in its column 'direction'"):
        guess_map(text_file(tmp_path / "run.csv", columns))


def test_set_value_is_no_measured_rotation(tmp_path: Path) -> None:
    columns = {"t_s": WHEEL.times_s, "n_soll_rpm": np.full(len(WHEEL.times_s), 500.0), "az": WHEEL.axes_mps2[:, 2]}
    assert "? its name says a set value" in guess_map(write_csv(tmp_path / "run.csv", columns))


@pytest.mark.parametrize("suffix", [".dat", ".unknown"])
@pytest.mark.parametrize(
    ("start", "what", "remedy"),
    [(b"LOGG\x90\0\0\0", "log of a CAN bus", "treadlink record"), (b"#ROSBAG V2.0\n", "bag of ROS 1", "mcap convert"),
     (b"SQLite format 3\0", "SQLite database", "mcap convert"), (b"TDSh\x0e\0", "index of a TDMS file", ".tdms file"),
     (b"\x1f\x8b\x08", "packed", "Unpack"), (b'VERSION "1"', "signals of a CAN bus", "dbc=")],
)  # fmt: skip
def test_what_is_no_measurement_is_named(tmp_path: Path, suffix: str, start: bytes, what: str, remedy: str) -> None:
    path = tmp_path / f"x{suffix}"
    path.write_bytes(start + bytes(200))
    with pytest.raises(ImportDataError, match=what) as caught:
        guess_map(path)
    assert remedy in caught.value.remedy
