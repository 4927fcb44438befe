import re
import sys
from pathlib import Path

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import ConfigError, ImportDataError
from gateway.importing.import_map import load_map, parse_map
from gateway.importing.importer import import_file
from tests.importing.measurements import simple_map, waveform, write_csv


def refusal(path: Path, map_text: str) -> ImportDataError:
    out = path.parent / "out.mcap"
    with pytest.raises(ImportDataError) as caught:
        import_file(path, parse_map(map_text, "map"), out)
    assert not out.exists()
    assert caught.value.remedy
    assert str(path) in str(caught.value)
    return caught.value


def text_file(tmp_path: Path, text: str, name: str = "run.csv") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


ROW = "1.0,2.0,3.0\n"


def test_missing_columns_are_reported_with_suggestions(tmp_path: Path) -> None:
    error = refusal(text_file(tmp_path, "X_acc,y,radial acc\n" + ROW * 10), simple_map())
    assert "no column 'x'" in str(error)
    assert "no column 'z'" in str(error)
    assert "'y'" not in str(error)
    assert "X_acc, y, radial acc" in error.remedy
    error = refusal(text_file(tmp_path, "x,y,Z\n" + ROW * 10), simple_map())
    assert "did you mean 'Z'?" in str(error)


@pytest.mark.parametrize(
    ("text", "message", "remedy"),
    [
        (
            "x,y,z\n" + ROW * 3 + "1.0,abc,3.0\n" + ROW,
            r"line 5, column 'y': 'abc' is not a number",
            "no row of",
        ),
        ("x,y,z\n" + ROW + "\n\n1.0,2.0,--\n" + ROW, r"line 5, column 'z': '--' is not", "leave the cell empty"),
        ("x,y,z\n" + ROW + "1.0,2.0,3.0.1\n" + ROW, r"line 3, column 'z': '3.0.1' is not", "leave it empty"),
        ("x,y,z\n" + ROW * 2 + "1.0,2.0", r"line 4 has 2 cells, but column 'z' is number 3", "cut off"),
        ("x,y,z\n2024-05-01T12:00:00.0001,2,3\n", r"line 2, column 'x': '2024", 'time_unit = "iso".*seconds.*rate_hz'),
        ("x,y,z\n12:00:00.0001,2,3\n", r"line 2, column 'x': '12:00", 'time_unit = "iso".*seconds.*rate_hz'),
        ("x,y,z\n[g],[g],[g]\n" + ROW, r"line 2, column 'x': '\[g\]' is not a number", "skip_rows_after_header"),
        ('x,y,z\n"1,5","2,5","3,5"\n', r"line 2, column 'x': '1,5' is not a number", "decimal"),
        ("x,y,z\n" + ROW * 2 + "1.0,nan,inf\n" + ROW, r"line 4, column 'z': inf cannot be measured", "cell empty"),
        ("x,y,z\n" + ROW + ",2.0,3.0\n" * 2, r"in 2 of 3 rows an axis has no value", "Leave the axis out"),
        ('x,y,z\n1.0,2.0,"' + "-" * 131_073 + '"\n', "a cell has more than 131072 characters", "quotation"),
        ("x,y,z\n", "contains no rows of data", "Check"),
        ("x,y,z\n" + ROW, "contains 1 rows", "Check"),
        ("", "is empty", "Check"),
        ("\n\n\n", "has nothing in line 1", "skip_rows"),
    ],
)
def test_csv_faults_name_the_line(tmp_path: Path, text: str, message: str, remedy: str) -> None:
    error = refusal(text_file(tmp_path, text), simple_map())
    assert re.search(message, str(error)), str(error)
    assert re.search(remedy, error.remedy), error.remedy


def test_bad_cell_in_a_later_block_is_reported(tmp_path: Path) -> None:
    path = text_file(tmp_path, "x,y,z\n" + ROW * 70_000 + "1.0,2.0,??\n" + ROW)
    assert "line 70002, column 'z': '??'" in str(refusal(path, simple_map()))


@pytest.mark.parametrize("end", ['end"', ""])
def test_quotation_marks_join_no_lines(tmp_path: Path, end: str) -> None:
    notes = ['"start' if row == 100 else end if row == 200 else "" for row in range(600)]
    path = text_file(tmp_path, "x,y,z,note\n" + "".join(f"1.0,2.0,{row}.0,{note}\n" for row, note in enumerate(notes)))
    assert import_file(path, parse_map(simple_map(), "map"), tmp_path / "out.mcap").samples == 600


def test_layouts_of_text_files(tmp_path: Path) -> None:
    data = waveform(50)
    columns = dict(zip("xyz", data.T, strict=True))
    path = write_csv(tmp_path / "run.txt", columns, ";", ",")
    body = path.read_text(encoding="utf-8").splitlines()
    path.write_bytes("\n".join(["Prüfstand 3", "", body[0], "g;g;g", *body[1:]]).encode("latin-1"))
    layout = 'delimiter = "semicolon"\ndecimal = ","\nskip_rows = 2\nskip_rows_after_header = 1\nencoding = "latin-1"'
    report = import_file(path, parse_map(simple_map(file=layout), "map"), tmp_path / "a.mcap")
    assert report.samples == 50
    assert 'encoding = "latin-1"' in refusal(path, simple_map(file=layout.rsplit("\n", 1)[0])).remedy
    assert "unknown encoding 'klingon'" in str(refusal(path, simple_map(file='encoding = "klingon"')))


@pytest.mark.parametrize("delimiter", ["tab", "space"])
def test_file_without_header_and_with_byte_order_mark(tmp_path: Path, delimiter: str) -> None:
    separator = {"tab": "\t", "space": "  "}[delimiter]
    path = tmp_path / "run.dat"
    path.write_text("\ufeff" + (separator.join(["1.5", "2", "3"]) + "\n") * 30, encoding="utf-8")
    text = simple_map(
        file=f'header = false\ndelimiter = "{delimiter}"',
        **{
            "axis.circumferential": 'column = "1"\nunit = "g"',
            "axis.lateral": 'column = "2"\nunit = "g"',
            "axis.radial": 'column = "3"\nunit = "g"',
        },
    )
    report = import_file(path, parse_map(text, "map"), tmp_path / "a.mcap")
    assert (report.samples, report.wheels[0].axes[0].high_mps2) == (30, pytest.approx(1.5 * STANDARD_GRAVITY_MPS2))


def test_unsupported_rate_is_rejected(tmp_path: Path) -> None:
    path = text_file(tmp_path, "x,y,z\n" + ROW * 10)
    error = refusal(path, simple_map(sampling="rate_hz = 1000"))
    assert "a rate of 1000 Hz, allowed: 2000 Hz or more" in str(error)
    assert "in Hz" in error.remedy


TIMES = np.arange(5000) / 5000.0


@pytest.mark.parametrize(
    ("times", "message"),
    [
        (np.where(np.arange(5000) > 2000, TIMES + 0.0101, TIMES), "line 2003: the time steps by 51.5 sample intervals"),
        (np.where(np.arange(5000) > 2000, TIMES - 0.01, TIMES), "line 2003: the time steps by -49 sample intervals"),
        (np.round(TIMES, 3), "rounded to 1 ms, which is more than a sample interval"),
        (np.zeros(5000), "the time does not advance"),
        (np.round(TIMES * 1.4, 3) + TIMES * 0.3, "the time steps by"),
        (TIMES * 10.0, "a rate of 500 Hz"),
    ],
)
def test_nonuniform_times_are_rejected(tmp_path: Path, times: np.ndarray, message: str) -> None:
    data = waveform(5000)
    path = write_csv(tmp_path / "run.csv", {"t": times, **dict(zip("xyz", data.T, strict=True))})
    assert message in str(refusal(path, simple_map(sampling='time_column = "t"')))


def test_slowly_changing_rate_is_rejected(tmp_path: Path) -> None:
    steps = np.linspace(1.0, 1.02, 150_000) / 5000.0
    path = write_csv(tmp_path / "run.csv", {"t": np.cumsum(steps), "z": np.sin(np.arange(150_000))})
    text = simple_map(sampling='time_column = "t"', **{"axis.circumferential": "", "axis.lateral": ""})
    assert "the rate changes" in str(refusal(path, text))


def test_start_after_the_end_is_rejected(tmp_path: Path) -> None:
    path = text_file(tmp_path, "x,y,z\n" + ROW * 10)
    assert "contains 0 rows after start_s" in str(refusal(path, simple_map(sampling="rate_hz = 10000\nstart_s = 5")))


def test_files_of_another_format_are_rejected(tmp_path: Path) -> None:
    for name, content, message in [
        ("run.mat", b"no matlab here, only text that is long enough to look at" * 9, "not a readable MATLAB file"),
        ("run.mat", b"MATLAB 7.3 MAT-file, Platform: GLNXA64" + bytes(100), "not a readable HDF5 file"),
        ("run.h5", b"no HDF5", "not a readable HDF5 file"),
        ("run.h5", b"", "is empty"),
        ("run.mf4", b"no MDF" * 20, "not a readable MDF file"),
        ("run.mf4", b"", "is empty"),
        ("run.mat", b"", "is empty"),
        ("run.parquet", b"no parquet", "not a readable Parquet file"),
        ("run.parquet", b"", "is empty"),
        ("run.xlsx", b"PK", "not a readable Excel file"),
    ]:
        path = tmp_path / name
        path.write_bytes(content)
        assert message in str(refusal(path, simple_map()))


@pytest.mark.parametrize(
    ("name", "message", "remedy"),
    [
        ("none.csv", "does not exist", "path"),
        ("folder", "is an empty folder", "order of time"),
        ("run.tar", "unknown file format '.tar'", "Unpack"),
        ("run.ods", "unknown file format '.ods'", "Export the columns as CSV"),
        ("run.mcap", "unknown file format '.mcap'", "treadlink estimate run.mcap"),
        ("run", "without a suffix", r'If it is text, state \[file\] format = "csv"'),
    ],
)
def test_remedy_fits_the_file(tmp_path: Path, name: str, message: str, remedy: str) -> None:
    path = tmp_path / name
    if name == "folder":
        path.mkdir()
    elif name != "none.csv":
        path.write_bytes(b"\x00\x01\x02")
    error = refusal(path, simple_map())
    assert message in str(error)
    assert re.search(remedy, error.remedy), error.remedy


def test_damaged_files_are_rejected(tmp_path: Path) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    columns = dict(zip("xyz", waveform(2000).T, strict=True))
    mat, parquet = tmp_path / "run.mat", tmp_path / "run.parquet"
    scipy_io.savemat(mat, columns, do_compression=True)
    pq.write_table(pa.table(columns), parquet)
    for path, position in ((mat, 5000), (parquet, 4)):
        good = path.read_bytes()
        for damaged in (good[: len(good) // 2], good[:position] + bytes(300) + good[position + 300 :]):
            path.write_bytes(damaged)
            refusal(path, simple_map())


def test_mat_columns_need_equal_lengths(tmp_path: Path) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    path = tmp_path / "run.mat"
    scipy_io.savemat(path, {"x": np.arange(10.0), "y": np.arange(9.0), "z": np.arange(10.0), "name": "text"})
    error = refusal(path, simple_map())
    assert "x has 10, y has 9" in str(error)
    scipy_io.savemat(path, {"data": np.ones((10, 2))})
    assert "data(:,1), data(:,2)" in refusal(path, simple_map()).remedy


def test_text_columns_in_parquet_are_rejected(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "run.parquet"
    pq.write_table(pa.table({"x": ["a"] * 5, "y": [1.0] * 5, "z": [1.0] * 5}), path)
    assert "column 'x' contains string" in str(refusal(path, simple_map()))
    pq.write_table(pa.table({"x": [1.0, float("inf"), 3.0], "y": [1.0] * 3, "z": [1.0] * 3}), path)
    assert "row 2, column 'x': inf cannot" in str(refusal(path, simple_map()))


def test_missing_pyarrow_names_the_extra(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "run.parquet"
    path.write_bytes(b"PAR1")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    assert "treadlink[parquet]" in refusal(path, simple_map()).remedy


def test_all_faults_of_a_map_are_listed() -> None:
    text = (Path(__file__).parent / "data" / "every_fault.toml").read_text()
    with pytest.raises(ConfigError) as caught:
        parse_map(text, "m.toml")
    lines = str(caught.value).splitlines()
    expected = [
        ('file.format: "xls" found', '"csv" or "famos" or'),
        ('file.delimiter: "," found', "one of comma, semicolon"),
        ('file.decimal: ";" found', '"." or ","'),
        ("sampling.rate_hz: -5 found", "above 0"),
        ("sampling: both rate_hz and time_column found", "keep only one"),
        ('sampling.start_utc: "yesterday" found', "date and time with time zone"),
        ('axis.circumferential.unit: "G" found', "did you mean g?"),
        ("axis.circumferential.sign: 2 found", "1 or -1"),
        ('axis.lateral.unit: "furlong" found', "one of m/s^2"),
        ('axis.lateral.column: "x" found', "axis.circumferential has the same column"),
        ("axis.vertical: a table found", "known keys: circumferential"),
        ("axis.radial: missing", "required"),
        ("sensor.highpass_hz: 5.0 found", "AC"),
        ('environment.pressure_unit: "kpa" found', "did you mean kPa?"),
        ("conditions.radius_mm: 0.3 found", "write 300"),
        ("conditions.load_std_n: 5 found", "needs load_n"),
    ]
    for parts in expected:
        assert any(line.startswith("m.toml: ") and all(part in line for part in parts) for line in lines), parts
    assert len(lines) == len(expected), lines


def test_missing_map_is_reported(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="import map cannot be read"):
        load_map(tmp_path / "none.toml")


def test_decimal_comma_requires_another_delimiter() -> None:
    with pytest.raises(ConfigError, match="decimal comma requires another delimiter"):
        parse_map(simple_map(file='decimal = ","'), "m.toml")


def test_rate_or_time_column_is_required() -> None:
    with pytest.raises(ConfigError, match="rate_hz or time_column is required"):
        parse_map(simple_map(sampling="start_s = 0.5"), "m.toml")
