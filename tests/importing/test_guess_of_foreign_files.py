"""First import maps of files as rigs and loggers write them: rates beside the columns, gaps, short names, counts."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.importing.column_names import names_rate, rate_in_text
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from gateway.importing.reasons import ImportCode
from tests.importing.measurements import Decoded, write_csv
from tests.importing.rolling_wheel import rolling

G = 9.80665
WHEEL = rolling(9600.0, 2.0)
X, Y, Z = WHEEL.axes_mps2.T


def guessed(path: Path) -> tuple[str, dict[str, Any]]:
    text = guess_map(path)
    return text, tomllib.loads(text)


def line_of(text: str, start: str) -> str:
    return next(line for line in text.splitlines() if line.startswith(start))


def test_rate_by_the_times_is_that_between_gaps(tmp_path: Path) -> None:
    is_present = np.ones(len(Z), bool)
    is_present[3000:6000] = False
    text, _ = guessed(write_csv(tmp_path / "gap.csv", {"t": WHEEL.times_s[is_present], "az": Z[is_present]}))
    assert "9600 Hz in its first rows, 3000 samples are missing in 1 gap" in line_of(text, "time_column")


def test_short_names_beside_a_named_axis_are_axes(tmp_path: Path) -> None:
    columns = {"t": WHEEL.times_s, "radial": Z, "tang": X, "lat": Y}
    text, document = guessed(write_csv(tmp_path / "short.csv", columns))
    chosen = {axis: keys["column"] for axis, keys in document["axis"].items()}
    assert chosen == {"radial": "radial", "circumferential": "tang", "lateral": "lat"}
    assert 'column = "lat"   # by its name' in text


def test_unit_of_counts_is_not_known_on_any_axis(tmp_path: Path) -> None:
    # The circumferential axis in counts happens to fit V²/R in g.
    counts = {"t": WHEEL.times_s, "ch1": 10.0 * X, "ch2": 10.0 * Y, "ch3": 400.0 * Z}
    path = write_csv(tmp_path / "counts.csv", counts)
    text, _ = guessed(path)
    assert text.count("# ? neither the file nor the magnitude says it") == 3
    (finding,) = import_file(path, parse_map(text, "map"), tmp_path / "wrong.mcap").wheels[0].findings
    assert finding.code is ImportCode.SCALE_UNLIKELY
    sizes = [line for line in text.splitlines() if line.startswith("# scale = ")]
    assert [float(line.split()[3]) for line in sizes] == pytest.approx([1 / (400.0 * G)] * 3, rel=0.2)
    report = import_file(path, parse_map(text.replace("# scale", "scale"), "map"), tmp_path / "out.mcap")
    assert not report.wheels[0].findings


def test_volts_are_taken_where_nothing_else_is_an_acceleration(tmp_path: Path) -> None:
    volts = {f"CH{number} [V]": 2.5 + 0.005 * values / G for number, values in enumerate((X, Y, -Z), 1)}
    text, document = guessed(write_csv(tmp_path / "volts.csv", {"Time [s]": WHEEL.times_s, **volts}))
    assert (document["axis"]["radial"]["column"], document["axis"]["radial"]["sign"]) == ("CH3 [V]", -1)
    assert "# ? " in line_of(text, "coupling")
    assert float(line_of(text, "# scale").split()[3]) == pytest.approx(200.0, rel=0.2)
    assert float(line_of(text, "# offset").split()[3]) == pytest.approx(2.5, abs=0.1)
    columns = {"Time [s]": WHEEL.times_s, "mic [V]": volts["CH1 [V]"], "acc z [g]": Z / G}
    text, _ = guessed(write_csv(tmp_path / "both.csv", columns))
    assert "#   mic [V]: unit V" in text
    assert "# scale" not in text


def test_offset_scale_and_full_scale_are_those_of_the_column(tmp_path: Path) -> None:
    volts = {"t": WHEEL.times_s, "z": 2.5 + 0.01 * np.clip(Z / G, None, 120.0)}
    path = write_csv(tmp_path / "volts.csv", volts)
    axis = 'column = "z"\nunit = "g"\nscale = 100\noffset = 2.5\nfull_scale = 1.2'
    map_text = f'[sampling]\nrate_hz = 9600\n[axis.radial]\n{axis}\n[sensor]\ncoupling = "DC"\n'
    report = import_file(path, parse_map(map_text, "map"), tmp_path / "out.mcap")
    decoded = Decoded(tmp_path / "out.mcap")
    assert np.abs(decoded.samples_mps2[:, 0] - np.minimum(Z, 120.0 * G)).max() < 0.1
    assert decoded.hello.range_mps2[2] == pytest.approx(120.0 * G, rel=1e-3)
    assert not report.wheels[0].findings


def test_times_that_change_their_rate_are_named(tmp_path: Path) -> None:
    steps = np.where(np.arange(len(Z)) < 9000, 1 / 9600, 1 / 9000)
    text, _ = guessed(write_csv(tmp_path / "rate.csv", {"time (s)": np.cumsum(steps), "az": Z}))
    assert "'time (s)' goes from 9600 to 9000 Hz: cut the file" in line_of(text, "# rate_hz = 9600 ")


def test_sign_and_coupling_are_doubtful_where_no_revolution_is_seen(tmp_path: Path) -> None:
    text, document = guessed(write_csv(tmp_path / "ac.csv", {"x_g": X / G, "z_g": (Z - Z.mean() - 5.0) / G}))
    radial = document["axis"]["radial"]
    assert (radial["column"], radial["unit"], radial["sign"]) == ("z_g", "g", 1)
    assert document["sensor"]["coupling"] == "AC"
    assert "# ? " in line_of(text, "sign")
    assert "# ? " in line_of(text, "coupling")


@pytest.mark.parametrize("name", ["Fs", "run.fs", "acc@sample_rate", "Abtastrate", "sampling frequency", "rate_hz"])
def test_names_of_rates(name: str) -> None:
    assert names_rate(name)


@pytest.mark.parametrize("name", ["offs", "strata", "rate of turn", "frequent", "Yaw"])
def test_names_of_other_numbers(name: str) -> None:
    assert not names_rate(name)


@pytest.mark.parametrize(
    ("line", "rate_hz"),
    [
        ("# sample rate: 9600 Hz", 9600.0), ("Abtastrate;9600;Hz", 9600.0), ("Sampling Frequency [kHz],9.6", 9600.0),
        ("fs=9600.0 S/s", 9600.0), ("rate 9600", None), ("run 12 of 9600 Hz", None), ("corner: 50 Hz", None),
    ],
)  # fmt: skip
def test_rates_in_lines_above_the_columns(line: str, rate_hz: float | None) -> None:
    assert rate_in_text(line) == rate_hz


@pytest.mark.parametrize("kind", ["csv", "mat", "h5", "attribute"])
def test_rate_beside_the_columns_is_taken(tmp_path: Path, kind: str) -> None:
    path = tmp_path / f"run.{'h5' if kind == 'attribute' else kind}"
    if kind == "csv":
        rows = "\n".join(f"{x:.4f},{z:.4f}" for x, z in zip(X, Z, strict=True))
        path.write_text(f"# drum, sample rate: 9600 Hz\nx,z\n{rows}\n")
    elif kind == "mat":
        pytest.importorskip("scipy.io").savemat(path, {"Fs": 9600.0, "acc": np.column_stack((X, Z))})
    else:
        with pytest.importorskip("h5py").File(path, "w") as file:
            file["acc"] = np.column_stack((X, Z))
            file["acc"].attrs["note"] = "rate unknown"
            if kind == "h5":
                file["fs"] = 9600.0
            else:
                file["acc"].attrs["sample_rate"] = 9600
    text, document = guessed(path)
    assert document["sampling"] == {"rate_hz": 9600.0}
    assert "# ? stated in the file: " in line_of(text, "rate_hz")
    assert document["axis"]["radial"]["unit"] == "m/s^2"
    assert import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").samples == len(Z)


def test_rates_that_differ_are_not_taken(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    pytest.importorskip("scipy.io").savemat(path, {"fs": 9600.0, "b": {"fs": 4800.0}, "acc": np.column_stack((X, Z))})
    assert "rate_hz" not in guessed(path)[1].get("sampling", {})


def test_constant_conditions_are_kept(tmp_path: Path) -> None:
    ones = np.ones(len(Z))
    columns = {"t": WHEEL.times_s, "az": Z, "p [bar]": 2.2 * ones, "T [°C]": 30.0 * ones, "v [km/h]": 65.0 * ones}
    text, document = guessed(write_csv(tmp_path / "run.csv", {**columns, "k": 2.1 * ones}))
    assert document["environment"] == {
        "pressure_column": "p [bar]", "pressure_unit": "bar", "temperature_column": "T [°C]",
    }  # fmt: skip
    assert [item["column"] for item in document["reference"]] == ["v [km/h]"]
    assert "#   k: constant, 2.1" in text


def test_slower_channels_of_an_mdf_file_are_used(tmp_path: Path) -> None:
    asammdf = pytest.importorskip("asammdf")
    path, slow_s = tmp_path / "run.mf4", np.linspace(0.0, 2.0, 30)

    def signal(name: str, unit: str, values: Any, times_s: Any = WHEEL.times_s) -> Any:
        return asammdf.Signal(samples=values, timestamps=times_s, name=name, unit=unit)

    with asammdf.MDF(version="4.10") as mdf:
        mdf.append([signal("AccX", "g", X / G), signal("AccZ", "g", Z / G)])
        mdf.append([signal("p_tire", "kPa", 210.0 + slow_s, slow_s), signal("v", "km/h", 64.8 + slow_s, slow_s)])
        mdf.save(path)
    text, document = guessed(path)
    assert document["environment"] == {"pressure_column": "p_tire", "pressure_unit": "kPa"}
    assert [(item["column"], item["unit"]) for item in document["reference"]] == [("v", "km/h")]
    assert "not used" not in text
    assert import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").references


def test_header_of_labview_ends_above_the_names(tmp_path: Path) -> None:
    head = ["LabVIEW Measurement\t", "***End_of_Header***\t", "Channels\t1\t\t", "Delta_X\t0.000104\t0.000104\t"]
    rows = [f"{t:.7f}\t{z:.4f}\t" for t, z in zip(WHEEL.times_s, Z / G, strict=True)]
    (tmp_path / "run.lvm").write_text("\n".join([*head, "***End_of_Header***\t\t", "X_Value\taz\tComment", *rows]))
    _, document = guessed(tmp_path / "run.lvm")
    assert document["sampling"] == {"time_column": "X_Value", "time_unit": "s"}
    assert document["axis"] == {"radial": {"column": "az", "unit": "g", "sign": 1}}
