"""First import maps: read from the data what they show, and leave open what they cannot."""

import shlex
import tomllib
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.commands.import_measurement import import_
from gateway.importing.csv_layout import recognise_layout
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from tests.importing.measurements import write_csv
from tests.importing.rolling_wheel import RollingWheel, rolling

G = 9.80665


def columns_of(wheel: RollingWheel) -> dict[str, FloatArray]:
    turns = wheel.angle_rad / (2 * np.pi)
    return {
        "time": wheel.times_s * 1e3,
        "a1": wheel.axes_mps2[:, 1] / G,
        "a2": -wheel.axes_mps2[:, 2] / G,
        "a3": wheel.axes_mps2[:, 0] / G,
        "Tacho": np.where(turns % 1 < 0.1, 5.0, 0.0),
        "encoder": (turns * 360) % 360,
        "v_ref (km/h)": wheel.speed_mps * 3.6,
        "n [rpm]": wheel.speed_mps * 30,
        "p [bar]": 2.2 + 0.01 * np.sin(wheel.times_s),
        "constant": np.ones(len(turns)),
    }


def test_axes_units_rate_and_references_are_recognised(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", columns_of(rolling(9600.0, 2.0)))
    text = guess_map(path)
    document = tomllib.loads(text)
    assert document["sampling"] == {"time_column": "time", "time_unit": "ms"}
    assert {axis: keys["column"] for axis, keys in document["axis"].items()} == {
        "radial": "a2",
        "circumferential": "a3",
        "lateral": "a1",
    }
    assert (document["axis"]["radial"]["unit"], document["axis"]["radial"]["sign"]) == ("g", -1)
    assert document["sensor"]["coupling"] == "DC"
    references = [(item["column"], item["quantity"], item.get("unit")) for item in document["reference"]]
    assert references == [
        ("Tacho", "pulses", None),
        ("encoder", "angle", "deg"),
        ("v_ref (km/h)", "speed", "km/h"),
        ("n [rpm]", "rotation", "rpm"),
    ]
    assert document["environment"] == {"pressure_column": "p [bar]", "pressure_unit": "bar"}
    assert "constant: constant, 1" in text
    assert "# load_n" in text
    report = import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    assert not report.wheels[0].findings


@pytest.mark.parametrize(("factor", "unit"), [(1.0, "m/s^2"), (1 / G, "g"), (1e3 / G, "mg")])
@pytest.mark.parametrize("coupling", ["DC", "AC"])
def test_unit_and_coupling_follow_from_the_revolutions(tmp_path: Path, factor: float, unit: str, coupling: str) -> None:
    wheel = rolling(9600.0, 2.0)
    radial = wheel.axes_mps2[:, 2] - (wheel.axes_mps2[:, 2].mean() if coupling == "AC" else 0.0)
    path = write_csv(tmp_path / "run.csv", {"t": wheel.times_s, "sensor": radial * factor})
    document = tomllib.loads(guess_map(path))
    assert document["axis"]["radial"] == {"column": "sensor", "unit": unit, "sign": 1}
    assert document["sensor"]["coupling"] == coupling


def test_wheels_are_sorted_by_their_names(tmp_path: Path) -> None:
    first, second = rolling(9600.0, 2.0), rolling(9600.0, 2.0, seed=2)
    columns = {"t": first.times_s}
    for position, wheel in (("VL", first), ("HR", second)):
        columns |= {f"{position}_x": wheel.axes_mps2[:, 0], f"{position}_z": wheel.axes_mps2[:, 2]}
    path = write_csv(tmp_path / "run.csv", columns)
    text = guess_map(path)
    document = tomllib.loads(text)
    assert [wheel["position"] for wheel in document["wheel"]] == ["FL", "RR"]
    assert [wheel["axis"]["radial"]["column"] for wheel in document["wheel"]] == ["VL_z", "HR_z"]
    assert len(import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").wheels) == 2


def test_layout_of_a_text_file_is_recognised(tmp_path: Path) -> None:
    wheel = rolling(9600.0, 1.0)
    lines = ["Prüfstand 3", "", "Zeit;acc z;Bemerkung", "s;g;-"]
    rows = zip(wheel.times_s, wheel.axes_mps2[:, 2] / G, strict=True)
    lines += [f"{time:.6f};{value:.4f};ok".replace(".", ",") for time, value in rows]
    path = tmp_path / "run.txt"
    path.write_bytes("\r\n".join(lines).encode("latin-1"))
    text = guess_map(path)
    document = tomllib.loads(text)
    assert document["file"] == {
        "delimiter": "semicolon",
        "decimal": ",",
        "encoding": "latin-1",
        "skip_rows": 2,
        "skip_rows_after_header": 1,
    }
    assert document["axis"]["radial"]["unit"] == "g"
    assert "Bemerkung: text" in text
    assert import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").samples == 9600


@pytest.mark.parametrize(
    ("text", "delimiter", "header"),
    [
        ("a,b\n1,2\n3,4\n", "comma", True),
        ("1;2,5\n3;4,5\n", "semicolon", False),
        ("a\tb\n1\t2\n3\t\n", "tab", True),
        ("# x\na b c\n1 2 3\n4 5 6\n", "space", True),
        ("2024-05-01 12:00:00.1,5\n2024-05-01 12:00:00.2,6\n", "comma", False),
    ],
)
def test_delimiters_and_headers(tmp_path: Path, text: str, delimiter: str, header: bool) -> None:
    path = tmp_path / "run.csv"
    path.write_text(text, encoding="utf-8")
    result = recognise_layout(path)
    assert (result.layout.delimiter, result.layout.header) == (delimiter, header)


def test_unknown_rate_stays_open(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", {"z": rolling(9600.0, 1.0).axes_mps2[:, 2]})
    text = guess_map(path)
    assert "# rate_hz = 10000.0   # ? not in the file" in text
    assert "rate_hz" not in tomllib.loads(text)["sampling"]


@pytest.mark.parametrize("suffix", [".mat", ".h5", ".mf4", ".parquet"])
def test_binary_files_are_guessed_alike(tmp_path: Path, suffix: str) -> None:
    wheel = rolling(9600.0, 1.0)
    columns = {"t": wheel.times_s, "x": wheel.axes_mps2[:, 0], "z": wheel.axes_mps2[:, 2]}
    path = tmp_path / f"run{suffix}"
    if suffix == ".mat":
        pytest.importorskip("scipy.io").savemat(path, {**columns, "note": "text"})
    elif suffix == ".h5":
        with pytest.importorskip("h5py").File(path, "w") as file:
            file.update(columns)
            file["note"] = "text"
    elif suffix == ".mf4":
        asammdf = pytest.importorskip("asammdf")
        with asammdf.MDF(version="4.10") as mdf:
            axes = [asammdf.Signal(columns[name], columns["t"], name=name, unit="m/s²") for name in "xz"]
            notes = asammdf.Signal(np.array([b"a", b"b"]), np.array([0.0, 0.5]), name="note", encoding="utf-8")
            mdf.append(axes)
            mdf.append(notes)
            mdf.save(path, overwrite=True)
    else:
        pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
        pq.write_table(pa.table({**columns, "note": ["a"] * len(wheel.times_s)}), path)
    text = guess_map(path)
    document = tomllib.loads(text)
    assert document["sampling"]["time_column"] == ("time" if suffix == ".mf4" else "t")
    assert (document["axis"]["radial"]["column"], document["axis"]["circumferential"]["column"]) == (
        "z",
        "x",
    )
    assert document["axis"]["radial"]["unit"] == "m/s^2"
    assert import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").samples == 9600


def test_file_without_acceleration_is_rejected(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run.csv", {"a": np.ones(500), "b": np.arange(500.0) ** 2})
    with pytest.raises(ImportDataError, match="no column looks like the acceleration of a tire") as caught:
        guess_map(path)
    assert "a: constant, 1" in str(caught.value)
    assert "b: a slow quantity" in str(caught.value)


def test_command_writes_the_map_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    path = write_csv(tmp_path / "run.csv", columns_of(rolling(9600.0, 1.0)))
    result = CliRunner().invoke(import_, ["--guess", str(path)], catch_exceptions=False)
    assert result.exit_code == 0
    assert "next: check what it assumes, then treadlink import" in result.output
    assert parse_map((tmp_path / "run.map.toml").read_text(encoding="utf-8"), "map").reference
    again = CliRunner().invoke(import_, ["--guess", str(path)])
    assert "already exists" in str(again.exception)
    assert CliRunner().invoke(import_, ["--guess", str(path), "--force"]).exit_code == 0
    printed = CliRunner().invoke(import_, ["--guess", str(path), "--out", "-"]).output
    assert printed == (tmp_path / "run.map.toml").read_text(encoding="utf-8")
    both = CliRunner().invoke(import_, ["--guess", str(path), "--map", "run.map.toml"])
    assert both.exit_code == 2
    assert "either --map" in both.output


def test_next_command_can_be_copied_with_a_space_in_a_name(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "run 1.csv", columns_of(rolling(9600.0, 2.0)))
    said = CliRunner().invoke(import_, ["--guess", str(path), "--out", str(tmp_path / "map 1.toml")]).output
    words = shlex.split(said[said.index("treadlink") :])
    assert words == ["treadlink", "import", str(path), "--map", str(tmp_path / "map 1.toml")]
    said = CliRunner().invoke(import_, [*words[2:], "--out", str(tmp_path / "run 1.mcap")]).output
    assert shlex.split(said[said.index("treadlink estimate") :])[2] == f"{tmp_path / 'run 1.mcap'},"
