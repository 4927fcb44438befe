"""First import maps choose nothing silently: a doubt has its mark, and a column that is left out its reason."""

import tomllib
from pathlib import Path

import numpy as np
import pytest

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.column_names import names_acceleration, other_quantity, unit_of
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from tests.importing.measurements import write_csv
from tests.importing.rolling_wheel import rolling

G = 9.80665
WHEEL = rolling(9600.0, 1.0)
AXES = {"acc x": WHEEL.axes_mps2[:, 0] / G, "acc y": WHEEL.axes_mps2[:, 1] / G, "acc z": WHEEL.axes_mps2[:, 2] / G}
NOISE = np.random.default_rng(4).normal(size=len(WHEEL.times_s)) * 1000.0


def chosen(text: str) -> dict[str, str]:
    return {axis: keys["column"] for axis, keys in tomllib.loads(text)["axis"].items()}


def line_of(text: str, start: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(start))


def named(suffix: str) -> dict[str, FloatArray]:
    return {"t": WHEEL.times_s, **{f"{name}{suffix}": values for name, values in AXES.items()}}


@pytest.mark.parametrize("suffix", [" (FL)", "[2]", " (group 0)", " (left)", " [sensor 4]", " (1)", " (A)"])
def test_brackets_that_hold_no_unit_are_part_of_the_name(tmp_path: Path, suffix: str) -> None:
    path = write_csv(tmp_path / "run.csv", named(suffix))
    text = guess_map(path)
    assert chosen(text) == {
        "radial": f"acc z{suffix}", "circumferential": f"acc x{suffix}", "lateral": f"acc y{suffix}",
    }  # fmt: skip
    assert tomllib.loads(text)["axis"]["radial"]["unit"] == "g"
    assert import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").samples == len(WHEEL.times_s)


@pytest.mark.parametrize(
    ("name", "stated", "unit"),
    [
        ("acc z (g)", "", "g"), ("acc z [m/s²] (FL)", "", "m/s^2"), ("a (m s-2)", "", "m/s^2"), ("acc(:,3)", "", ""),
        ("F (kN)", "", "kN"), ("M [N·m]", "", "N·m"), ("gyro (deg/s)", "", "deg/s"), ("mic (mV)", "", "mV"),
        ("acc z (G)", "", "g"), ("T (°C)", "", "degC"), ("acc", "[-]", ""), ("acc", "m/s^2", "m/s^2"),
        ("acc (N)", "", ""), ("force (N)", "", "N"), ("p (mbar)", "", "mbar"), ("wheel (FR)", "", ""),
        ("k (N/mm)", "", "N/mm"), ("B (uT)", "", "uT"), ("w (rad/s^2)", "", "rad/s^2"), ("n [rpm]", "", "rpm"),
    ],
)  # fmt: skip
def test_unit_is_the_stated_one_or_one_in_brackets(name: str, stated: str, unit: str) -> None:
    assert unit_of(name, stated) == unit


def test_columns_of_a_matrix_come_before_a_larger_vector(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    content = {"t": WHEEL.times_s, "acc": np.column_stack(list(AXES.values())), "extra": 30.0 * AXES["acc z"]}
    pytest.importorskip("scipy.io").savemat(path, content)
    text = guess_map(path)
    assert chosen(text) == {"radial": "acc(:,3)", "circumferential": "acc(:,1)", "lateral": "acc(:,2)"}
    assert "extra: not named as an acceleration" in text


def test_columns_of_one_name_are_told_apart_by_their_number(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", named(""))
    path.write_text(path.read_text().replace(",".join(AXES), "acc,acc,acc", 1))
    text = guess_map(path)
    assert chosen(text) == {"radial": "acc (column 4)", "circumferential": "acc", "lateral": "acc (column 3)"}
    assert import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").samples == len(WHEEL.times_s)


def test_radial_axis_of_more_than_three_columns_is_marked(tmp_path: Path) -> None:
    columns = {**named(" (1)"), "acc z (2)": np.roll(AXES["acc z"], 40)}
    text = guess_map(write_csv(tmp_path / "run.csv", columns))
    line = line_of(text, f'column = "{chosen(text)["radial"]}"')
    assert "# ? " in line
    assert "4 columns may be axes" in line


@pytest.mark.parametrize("largest", [0, 2])
def test_column_that_is_the_length_of_three_others_is_no_axis(tmp_path: Path, largest: int) -> None:
    axes = np.roll(np.column_stack(list(AXES.values())), largest, axis=1).round(4)
    length = np.linalg.norm(axes, axis=1).round(4)
    columns = {f"Ch{k}": values for k, values in enumerate((length, *axes.T), 1)}
    text = guess_map(write_csv(tmp_path / "run.csv", {"t": WHEEL.times_s, **columns}))
    assert "Ch1: a magnitude by its values" in text
    assert len(chosen(text)) == 3


@pytest.mark.parametrize("cell", ["#N/A", "−0.5", "acc z (g)", "\0\0\0"])
@pytest.mark.parametrize("row", [3, 3000])
def test_one_unreadable_cell_keeps_its_column_with_a_mark(tmp_path: Path, cell: str, row: int) -> None:
    path = write_csv(tmp_path / "run.csv", named(" (g)"))
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[row] = ",".join((*lines[row].split(",")[:-1], cell))
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = guess_map(path)
    assert chosen(text)["radial"] == "acc z (g)"
    line = line_of(text, 'column = "acc z (g)"')
    assert "# ? " in line
    assert f"line {row + 1}: " + ("NUL bytes" if "\0" in cell else f"'{cell}' is not a number") in line
    with pytest.raises(ImportDataError, match=f"line {row + 1}"):
        import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")


def test_file_that_is_cut_off_keeps_its_columns(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", named(" (g)"))
    text = path.read_text(encoding="utf-8")
    path.write_text(text[: text.rindex(",") - 4], encoding="utf-8")
    result = guess_map(path)
    assert chosen(result)["radial"] == "acc z (g)"
    assert f"line {len(WHEEL.times_s) + 1}: has 3 cells" in line_of(result, 'column = "acc z (g)"')


def test_no_axis_is_chosen_in_place_of_one_that_cannot_be_read(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", named(" (g)"))
    lines = path.read_text(encoding="utf-8").splitlines()
    lines[2:] = [line.rpartition(",")[0] + (",over" if k % 3 else f",{k}") for k, line in enumerate(lines[2:])]
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    text = guess_map(path)
    assert "radial" not in tomllib.loads(text).get("axis", {})
    assert "not read: 'acc z (g)'" in line_of(text, "# column = ")
    assert "acc z (g): text, such as 'over'" in text


def test_radial_axis_that_does_not_fit_its_revolutions_is_marked(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", {"t": WHEEL.times_s, "z (mg)": AXES["acc z"]})
    assert "# ? " in line_of(guess_map(path), 'column = "z (mg)"')
    path = write_csv(tmp_path / "right.csv", {"t": WHEEL.times_s, "z (mg)": AXES["acc z"] * 1e3})
    assert "?" not in line_of(guess_map(path), 'column = "z (mg)"')


@pytest.mark.parametrize(
    ("change", "what"),
    [(lambda t, k: t - 0.05 * (k >= 6000), "steps back"), (lambda t, k: t - 0.01 * (k == 6000), "steps back")],
)
def test_time_that_steps_back_is_named_and_no_temperature(tmp_path: Path, change, what: str) -> None:
    rows = np.arange(len(WHEEL.times_s))
    columns = {"t (s)": change(WHEEL.times_s, rows), **AXES}
    text = guess_map(write_csv(tmp_path / "run.csv", columns))
    assert f"# rate_hz = 9600   # ? 't (s)' {what} in line 6002; 9600 Hz by its other steps" in text
    assert "environment" not in tomllib.loads(text)
    assert "t (s): a time" in text


def test_time_that_repeats_is_marked(tmp_path: Path) -> None:
    rows = np.arange(len(WHEEL.times_s))
    columns = {"t (s)": WHEEL.times_s[rows - (rows >= 6000)], **AXES}
    text = guess_map(write_csv(tmp_path / "run.csv", columns))
    assert "# ? " in line_of(text, "time_column")
    assert "repeats in line 6002" in line_of(text, "time_column")


@pytest.mark.parametrize("unit", ["s", "Hz", "V", "N", "m", "K", "1/s"])
@pytest.mark.parametrize("name", ["T", "temp", "p", "v", "n"])
def test_unit_of_another_quantity_beats_the_name(tmp_path: Path, unit: str, name: str) -> None:
    slow = 20.0 + np.sin(WHEEL.times_s)
    columns = {"time": WHEEL.times_s, f"{name} ({unit})": slow, **AXES}
    document = tomllib.loads(guess_map(write_csv(tmp_path / "run.csv", columns)))
    assert "environment" not in document
    quantities = [item["quantity"] for item in document.get("reference", [])]
    assert quantities == (["rotation"] if unit == "Hz" else [])


def test_temperature_by_its_name_is_marked_and_a_second_one_is_listed(tmp_path: Path) -> None:
    slow = 20.0 + np.sin(WHEEL.times_s)
    columns = {"time": WHEEL.times_s, "temp": slow, **AXES, "T (degC)": slow, "p (bar)": slow, "p2 (bar)": slow}
    text = guess_map(write_csv(tmp_path / "run.csv", columns))
    assert line_of(text, "temperature_column").endswith('"temp"   # ? degC, by its name')
    assert "T (degC): a second temperature beside 'temp'" in text
    assert "p2 (bar): a second pressure beside 'p (bar)'" in text
    del columns["temp"]
    text = guess_map(write_csv(tmp_path / "other.csv", columns))
    assert line_of(text, "temperature_column").endswith('"T (degC)"   # degC')


def test_references_by_name_or_values_are_marked(tmp_path: Path) -> None:
    turns = WHEEL.angle_rad / (2 * np.pi)
    square = np.where(turns % 1 < 0.1, 5.0, 0.0)
    columns = {"time": WHEEL.times_s, **AXES, "digital": square, "speed": WHEEL.speed_mps, "enc": (turns * 360) % 360}
    text = guess_map(write_csv(tmp_path / "run.csv", columns))
    assert 'quantity = "pulses"   # ? by its values' in text
    assert 'quantity = "speed"   # ? by its name' in text
    assert 'unit = "deg"   # ?' in text


def test_column_without_a_wheel_beside_those_of_wheels_is_listed(tmp_path: Path) -> None:
    columns = {"t": WHEEL.times_s, "FL_z": AXES["acc z"], "RR_z": AXES["acc z"], "z": NOISE}
    assert "z: names no wheel, as others do" in guess_map(write_csv(tmp_path / "run.csv", columns))


CAUSES = {
    "decimal comma": (lambda v: f'"{v:.4f}"'.replace(".", ","), "is not a number", "another delimiter"),
    "minus": (lambda v: f"\u2212{abs(v):.4f}", "is not a number", "minus sign"),
    "thousands": (lambda v: f'"{v * 1000:,.3f}"', "is not a number", "thousands"),
}


@pytest.mark.parametrize("cause", CAUSES)
def test_file_without_axes_lists_the_reason_of_every_column(tmp_path: Path, cause: str) -> None:
    written, reason, remedy = CAUSES[cause]
    path = tmp_path / "run.csv"
    rows = zip(WHEEL.times_s, *AXES.values(), strict=True)
    lines = [f"{t:.6f},{written(x)},{written(y)},{written(z)}" for t, x, y, z in rows]
    path.write_text("\n".join(("t (s),acc x (g),acc y (g),acc z (g)", *lines)) + "\n", encoding="utf-8")
    with pytest.raises(ImportDataError) as caught:
        guess_map(path)
    listed = str(caught.value).splitlines()[1:]
    for name in ("acc x (g)", "acc y (g)", "acc z (g)"):
        assert any(line.startswith(f"  {name}: line ") and reason in line for line in listed), listed
    assert "  t (s): the time" in listed
    assert remedy in caught.value.remedy


@pytest.mark.parametrize("suffix", [".mat", ".h5"])
def test_matrix_with_channels_in_rows_leaves_the_other_columns(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"run{suffix}"
    wide = np.array(list(AXES.values()))

    def write(content: dict[str, FloatArray]) -> None:
        if suffix == ".mat":
            pytest.importorskip("scipy.io").savemat(path, content)
        else:
            with pytest.importorskip("h5py").File(path, "w") as file:
                file.update(content)

    write({"t": WHEEL.times_s, "acc": wide})
    with pytest.raises(ImportDataError, match="acc: has 3 rows and 9600 columns") as caught:
        guess_map(path)
    assert "transpose it" in str(caught.value)
    write({"t": WHEEL.times_s, "matrix": wide, "acc z": AXES["acc z"]})
    text = guess_map(path)
    assert chosen(text) == {"radial": "acc z"}
    assert "matrix: has 3 rows and 9600 columns" in text


def test_missing_filter_of_a_dataset_is_named(tmp_path: Path) -> None:
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["t"] = WHEEL.times_s
        space = h5py.h5s.create_simple((len(NOISE),))
        properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        properties.set_chunk((100,))
        # LZ4, which h5py does not contain; an optional filter can be stated without it.
        properties.set_filter(32004, h5py.h5z.FLAG_OPTIONAL)
        h5py.h5d.create(file.id, b"acc z", h5py.h5t.NATIVE_DOUBLE, space, properties)
    with pytest.raises(ImportDataError, match=r"acc z: is packed by the HDF5 filter .*32004|acc z: .*lz4") as caught:
        guess_map(path)
    assert "h5repack" in str(caught.value)


@pytest.mark.parametrize(
    ("name", "quantity"),
    [
        ("Gyr_Z", "a rate of rotation"), ("gyroX", "a rate of rotation"), ("Euler_Y", "an angle"), ("Roll", "an angle"),
        ("Mag_X", "a magnetic field"), ("magnetometer y", "a magnetic field"), ("Quat_W", "an angle"),
        ("yaw rate", "a rate of rotation"), ("omega_z", "a rate of rotation"), ("Acc magnitude", "a magnitude"),
        ("Acc_Z", None), ("FreeAcc_X", None), ("magnification", None), ("Beschl. Z", None), ("image", None),
    ],
)  # fmt: skip
def test_names_of_other_sensors_are_recognised(name: str, quantity: str | None) -> None:
    assert other_quantity(name) == quantity
    assert names_acceleration(name) == (name in ("Acc_Z", "FreeAcc_X", "Beschl. Z"))


@pytest.mark.parametrize("name", ["Gyr_Z", "Mag_Z", "Euler_Z", "Acc_abs"])
def test_other_sensors_of_a_device_are_left_out_by_name(tmp_path: Path, name: str) -> None:
    columns = {"t": WHEEL.times_s, "Acc_Z": AXES["acc z"], name: 40.0 * AXES["acc z"]}
    text = guess_map(write_csv(tmp_path / "run.csv", columns))
    assert chosen(text) == {"radial": "Acc_Z"}
    assert f"{name}: a" in text
    assert "by its name" in line_of(text, f"#   {name}")


def test_slow_device_has_its_time_and_a_note_that_it_is_too_slow(tmp_path: Path) -> None:
    rows = np.arange(400)
    noise = np.random.default_rng(2).normal(size=(400, 3))
    columns = {
        "Packet": rows + 7.0, "SampleTimeFine": 173454368.0 + np.rint(rows / 120 * 1e6),
        "Acc_X": noise[:, 0], "Acc_Y": noise[:, 1] * 9, "Gyr_X": noise[:, 2] * 500,
    }  # fmt: skip
    text = guess_map(write_csv(tmp_path / "run.csv", columns))
    assert tomllib.loads(text)["sampling"] == {"time_column": "SampleTimeFine", "time_unit": "us"}
    assert "# ? 120" in line_of(text, "time_column")
    assert "2000 Hz or more" in line_of(text, "time_column")
    assert set(chosen(text).values()) == {"Acc_X", "Acc_Y"}
    assert "Packet: a counter" in text


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
def test_times_since_1970_have_their_unit_and_a_start(tmp_path: Path, unit: str, factor: float) -> None:
    path = tmp_path / "run.csv"
    start = 1_764_000_000
    digits = {"s": 6, "ms": 3}.get(unit, 0)
    times = [start * factor + t * factor for t in WHEEL.times_s]
    lines = (f"{t:.{digits}f},{z:.4f}" for t, z in zip(times, AXES["acc z"], strict=True))
    path.write_text("\n".join(("stamp,acc z", *lines)) + "\n", encoding="utf-8")
    text = guess_map(path)
    assert tomllib.loads(text)["sampling"]["time_unit"] == unit
    assert line_of(text, "start_utc").startswith("start_utc = 2025-11-24T16:00:00.000Z   # ?")
    assert import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").samples == len(WHEEL.times_s)


def test_error_of_a_condition_is_not_taken_for_the_condition(tmp_path: Path) -> None:
    times = WHEEL.times_s
    constants = {"Fz [N]": 5000.0, "Fz std [N]": 25.0, "sigma_p [kPa]": 2.0, "p [kPa]": 210.0, "v err [km/h]": 0.1}
    columns = {"t": times, **AXES, **{name: np.full(len(times), value) for name, value in constants.items()}}
    document = tomllib.loads(text := guess_map(write_csv(tmp_path / "run.csv", columns)))
    assert document["conditions"]["load_n"] == 5000
    assert document["environment"]["pressure_column"] == "p [kPa]"
    assert "reference" not in document
    assert "Fz std [N]: an error by its name" in text


def test_error_in_attributes_is_not_taken_for_the_condition(tmp_path: Path) -> None:
    conditions = {"load_n": 5000.0, "load_std_n": 25.0, "pressure_pa": 210e3, "pressure_std_pa": 2e3}
    path = tmp_path / "run.mat"
    wheel = {"t": WHEEL.times_s, "acc": np.column_stack(list(AXES.values())), "Conditions": conditions}
    pytest.importorskip("scipy.io").savemat(path, {"W1": wheel})
    stated = tomllib.loads(guess_map(path))["conditions"]
    assert (stated["load_n"], stated["pressure_kpa"]) == (5000, 210)
