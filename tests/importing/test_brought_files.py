"""Files as people bring them: unreadable cells, day numbers, clocks of blocks, and measurements in several files."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from gateway.core.errors import ImportDataError
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from tests.importing.measurements import Decoded, simple_map, write_csv
from tests.importing.rolling_wheel import rolling
from tests.testkit.commands import invoked

G = 9.80665
RATE_HZ = 9600.0
WHEEL = rolling(RATE_HZ, 1.0)
ROWS = len(WHEEL.times_s)
AXES = {name: WHEEL.axes_mps2[:, k] / G for k, name in enumerate("xyz")}


def with_bad_cells(path: Path) -> Path:
    write_csv(path, AXES)
    lines = path.read_text().splitlines()
    for line, cell in ((100, "#N/A"), (101, "err"), (5000, "")):
        cells = lines[line].split(",")
        cells[2] = cell
        lines[line] = ",".join(cells)
    lines[7000] = lines[7000].split(",")[0]
    path.write_text("\n".join(lines) + "\n")
    return path


def test_unreadable_cells_are_missing_only_on_request(tmp_path: Path) -> None:
    path = with_bad_cells(tmp_path / "run.csv")
    with pytest.raises(ImportDataError, match="line 101, column 'z': '#N/A'") as caught:
        import_file(path, parse_map(simple_map(), "map"), tmp_path / "a.mcap")
    assert 'unreadable = "missing"' in caught.value.remedy
    text = simple_map(file='unreadable = "missing"')
    report = import_file(path, parse_map(text, "map"), tmp_path / "b.mcap")
    # The last line lacks two cells; an empty cell is a gap anyway.
    assert (report.unreadable, report.wheels[0].gaps, report.samples) == (4, 4, ROWS)


def test_summary_counts_unreadable_cells(tmp_path: Path) -> None:
    path = with_bad_cells(tmp_path / "run.csv")
    (tmp_path / "map.toml").write_text(simple_map(file='unreadable = "missing"'))
    done = invoked("import", path, "--map", tmp_path / "map.toml", "--out", tmp_path / "o.mcap")
    assert "4 cells that are no numbers are gaps" in done.output


def test_first_map_offers_to_take_unreadable_cells_for_gaps(tmp_path: Path) -> None:
    text = guess_map(with_bad_cells(tmp_path / "run.csv"))
    assert '# unreadable = "missing"   # ?' in text


@pytest.mark.parametrize(("begin_d", "program"), [(45413.5, "Excel"), (739373.5, "MATLAB")])
def test_day_numbers_are_times(tmp_path: Path, begin_d: float, program: str) -> None:
    path = write_csv(tmp_path / "run.csv", {"Time": begin_d + WHEEL.times_s / 86400.0, **AXES})
    text = guess_map(path)
    assert 'time_unit = "d"' in text
    assert "start_utc = 2024-05-01T12:00:00.000Z   # ?" in text
    report = import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    assert report.rate_hz == pytest.approx(RATE_HZ, rel=1e-4)
    noon = datetime(2024, 5, 1, 12, tzinfo=UTC).timestamp()
    assert Decoded(report.recording).items[0].host_ns == pytest.approx(noon * 1e9, abs=1e6)


def test_clock_of_blocks_is_named_with_the_rate_of_whole_blocks(tmp_path: Path) -> None:
    blocks = np.floor(np.arange(ROWS) / 100) * 100 / RATE_HZ
    text = guess_map(write_csv(tmp_path / "run.csv", {"Time (s)": blocks, **AXES}))
    assert "# rate_hz = 9600   # ? 'Time (s)' advances once in 100 rows; 9600 Hz by its other steps" in text
    assert "Time (s): a time" in text


def parts(folder: Path, count: int, columns: dict[str, np.ndarray]) -> list[Path]:
    bounds = np.linspace(0, ROWS, count + 1).astype(int)
    return [
        write_csv(folder / f"part{k}.csv", {name: values[first:end] for name, values in columns.items()})
        for k, (first, end) in enumerate(zip(bounds[:-1], bounds[1:], strict=True))
    ]


def test_several_files_are_one_measurement(tmp_path: Path) -> None:
    columns = {"t": WHEEL.times_s, **AXES}
    text = simple_map(sampling='time_column = "t"')
    whole = import_file(write_csv(tmp_path / "all.csv", columns), parse_map(text, "map"), tmp_path / "all.mcap")
    report = import_file(parts(tmp_path, 3, columns), parse_map(text, "map"), tmp_path / "parts.mcap")
    assert (report.samples, report.rate_hz, report.left_out) == (ROWS, whole.rate_hz, 0)
    np.testing.assert_array_equal(Decoded(report.recording).samples_mps2, Decoded(whole.recording).samples_mps2)


def test_dates_of_several_files_go_on_and_what_is_missing_between_is_a_gap(tmp_path: Path) -> None:
    begin = np.datetime64("2024-05-01T12:00:00", "ns")
    paths = []
    for k, first in enumerate((0, 5000)):
        rows = slice(first, first + 4600)
        stamps = begin + np.round(WHEEL.times_s[rows] * 1e9).astype("timedelta64[ns]")
        cells = zip(stamps, *(values[rows].tolist() for values in AXES.values()), strict=True)
        lines = [f"{stamp}Z,{x!r},{y!r},{z!r}" for stamp, x, y, z in cells]
        paths.append(tmp_path / f"{k}.csv")
        paths[-1].write_text("\n".join(["t,x,y,z", *lines]) + "\n")
    text = simple_map(sampling='time_column = "t"\ntime_unit = "iso"')
    report = import_file(paths, parse_map(text, "map"), tmp_path / "out.mcap")
    assert (report.samples, report.left_out) == (9600, 400)
    with pytest.raises(ImportDataError, match=r"0\.csv, line 2: the time steps by"):
        import_file(paths[::-1], parse_map(text, "map"), tmp_path / "backward.mcap")


def test_several_files_must_fit_together(tmp_path: Path) -> None:
    first, second = parts(tmp_path, 2, AXES)
    with pytest.raises(ImportDataError, match=r"part0\.csv is given twice"):
        import_file([first, second, first], parse_map(simple_map(), "map"), tmp_path / "out.mcap")
    other = write_csv(tmp_path / "other.csv", {"x": AXES["x"], "y": AXES["y"], "zz": AXES["z"]})
    with pytest.raises(ImportDataError, match=r"other\.csv: there is no column 'z'"):
        import_file([first, other], parse_map(simple_map(), "map"), tmp_path / "out.mcap")
    assert not (tmp_path / "out.mcap").exists()


def test_first_map_takes_one_of_several_files(tmp_path: Path) -> None:
    done = invoked("import", "--guess", "a.csv", "b.csv")
    assert done.exit_code == 2
    assert "one of the files" in done.output


def dated(path: Path, texts: list[str]) -> Path:
    rows = zip(texts, *(values.tolist() for values in AXES.values()), strict=True)
    path.write_text("\n".join(["when,x,y,z", *(f"{s},{x!r},{y!r},{z!r}" for s, x, y, z in rows)]) + "\n")
    return path


@pytest.mark.parametrize(
    ("order", "date", "form"),
    [
        ("mdy", "5/31/2024", "%I:%M:%S.{} %p"), ("dmy", "31.5.2024", "%H:%M:%S.{}"),
        ("ymd", "2024-05-31", "%I:%M:%S.{} %p"), ("mdy", "05-31-2024", "%I:%M:%S.{} p.m."),
    ],
)  # fmt: skip
def test_dates_of_other_countries_and_halves_of_the_day(tmp_path: Path, order: str, date: str, form: str) -> None:
    begin = datetime(2024, 5, 31, 12, 59, 59, 500_000)
    stamps = [begin + timedelta(seconds=time_s) for time_s in WHEEL.times_s]
    texts = [f"{date} {stamp.strftime(form.format(f'{stamp.microsecond:06}'))}" for stamp in stamps]
    path = dated(tmp_path / "run.csv", texts)
    text = guess_map(path).replace('# time_zone = "Europe/Berlin"', 'time_zone = "UTC"')
    assert (f'date_order = "{order}"' in text) == (order != "ymd")
    report = import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    assert report.rate_hz == pytest.approx(RATE_HZ, rel=1e-5)
    assert Decoded(report.recording).items[0].host_ns == int(begin.replace(tzinfo=UTC).timestamp() * 1e6) * 1000


@pytest.mark.parametrize(("half", "order", "other"), [("", "dmy", "mdy"), (" PM", "mdy", "dmy")])
def test_day_and_month_that_look_alike_have_a_mark(tmp_path: Path, half: str, order: str, other: str) -> None:
    texts = [f"1/2/2024 1:00:0{time_s:.6f}{half}" for time_s in WHEEL.times_s]
    assert f'date_order = "{order}"   # ? or {other}' in guess_map(dated(tmp_path / "run.csv", texts))


@pytest.mark.parametrize(
    ("form", "begin"),
    [
        ("%d-%b-%Y %H:%M:%S.%f", datetime(2024, 5, 1, 8, 30)), ("%H:%M:%S.%f", datetime(2024, 5, 1, 8, 30)),
        ("%H:%M:%S.%f", datetime(2024, 5, 1, 23, 59, 59, 500_000)),
    ],
)  # fmt: skip
def test_names_of_months_and_times_of_day_are_times(tmp_path: Path, form: str, begin: datetime) -> None:
    texts = [(begin + timedelta(seconds=time_s)).strftime(form) for time_s in WHEEL.times_s]
    path = dated(tmp_path / "run.csv", texts)
    text = guess_map(path)
    assert f'time_column = "when"   # {RATE_HZ:g} Hz in its first rows' in text
    assert ("the times have no date" in text) == form.startswith("%H")
    report = import_file(path, parse_map(text.replace("# time_zone", "time_zone"), "map"), tmp_path / "out.mcap")
    assert report.rate_hz == pytest.approx(RATE_HZ, rel=1e-5)
    assert (report.samples, report.start_is_file_date) == (ROWS, form.startswith("%H"))


def test_dates_of_a_slow_device_have_a_note_that_it_is_too_slow(tmp_path: Path) -> None:
    begin = datetime(2024, 5, 1, 8, 30)
    texts = [(begin + timedelta(seconds=0.01 * k)).isoformat(timespec="microseconds") for k in range(ROWS)]
    assert "100 Hz in its first rows, too low" in guess_map(dated(tmp_path / "run.csv", texts))


@pytest.mark.parametrize("cell", ["13/1/2024 13:00:00 PM", "2024/13/13 1:00:00", "1/2/24 1:00:00"])
def test_impossible_dates_are_refused(tmp_path: Path, cell: str) -> None:
    path = dated(tmp_path / "run.csv", [cell] * ROWS)
    sampling = 'time_column = "when"\ntime_unit = "iso"\ntime_zone = "UTC"\ndate_order = "mdy"'
    with pytest.raises(ImportDataError, match="is not an ISO time"):
        import_file(path, parse_map(simple_map(sampling=sampling), "map"), tmp_path / "out.mcap")


def write_parts(folder: Path, *parts: tuple[str, int]) -> list[Path]:
    """Write TDMS files of 2400 rows of z and the stated number of x, in a unit."""
    nptdms = pytest.importorskip("nptdms")
    folder.mkdir()
    paths = []
    for k, (unit, rows) in enumerate(parts):
        paths.append(folder / f"run{k}.tdms")
        stamp = np.datetime64("2024-05-01T12:00:00", "us") + np.timedelta64(250_000 * k, "us")
        clock = {"wf_increment": 1 / RATE_HZ, "wf_start_time": stamp, "wf_start_offset": 0.0, "unit_string": unit}
        begin = 2400 * k
        axes = {"z": AXES["z"][begin : begin + 2400], "x": AXES["x"][begin : begin + rows]}
        with nptdms.TdmsWriter(str(paths[-1]), index_file=True) as writer:
            writer.write_segment([nptdms.ChannelObject("g", name, data, clock) for name, data in axes.items()])
    return paths


AXES_OF_PARTS = {
    "axis.circumferential": 'column = "g/x"\nunit = "g"',
    "axis.lateral": "",
    "axis.radial": 'column = "g/z"\nunit = "g"',
}


def test_units_and_cuts_of_every_file_count(tmp_path: Path) -> None:
    by_time = parse_map(simple_map(sampling='time_column = "time"', **AXES_OF_PARTS), "map")
    by_rate = parse_map(simple_map(sampling="rate_hz = 9600", **AXES_OF_PARTS), "map")
    write_parts(tmp_path / "cut", ("g", 2400), ("g", 1400), ("g", 2400))
    # Of a folder, with the index that LabVIEW keeps beside each file.
    report = import_file(tmp_path / "cut", by_time, tmp_path / "cut.mcap")
    assert (report.samples, report.left_out) == (7200, 1000)
    assert any("run1.tdms: 'g/x' has 1400 of 2400 samples" in line for line in report.assumed)
    with pytest.raises(ImportDataError, match=r"run1.tdms is cut: 'g/x' has 1400 of 2400 samples"):
        import_file(tmp_path / "cut", by_rate, tmp_path / "out.mcap")
    last = write_parts(tmp_path / "last", ("g", 2400), ("g", 1400))
    assert import_file(last, by_rate, tmp_path / "last.mcap").samples == 3800
    mixed = write_parts(tmp_path / "mixed", ("g", 2400), ("m/s^2", 2400))
    with pytest.raises(ImportDataError, match=r"run1.tdms: 'g/[xz]' is in m/s\^2, in run0.tdms in g"):
        import_file(mixed, by_time, tmp_path / "out.mcap")


def test_axes_in_several_files_are_of_one_sensor(tmp_path: Path) -> None:
    columns = {f"S{k}_{name}": values for k in (1, 2) for name, values in AXES.items()}
    text = simple_map(
        **{
            "axis.circumferential": 'column = "S1_x"\nunit = "g"',
            "axis.lateral": "",
            "axis.radial": 'column = "S2_z"\nunit = "g"',
        }
    )
    with pytest.raises(ImportDataError, match="are of several sensors"):
        import_file(parts(tmp_path, 2, columns), parse_map(text, "map"), tmp_path / "out.mcap")
