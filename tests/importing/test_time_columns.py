"""Time columns: dates with zones and changes of the clock, counters that start again, and times since 1970."""

from collections.abc import Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from gateway.core.errors import ConfigError, ImportDataError
from gateway.importing.columns import BLOCK_ROWS, Block
from gateway.importing.import_map import parse_map
from gateway.importing.importer import ImportReport, import_file
from gateway.importing.missing_rows import GapFilledColumns
from gateway.importing.parquet_columns import ParquetColumns
from gateway.importing.time_counter import TimeCounter
from tests.importing.measurements import Decoded, simple_map

RADIAL_ONLY = {"axis.circumferential": "", "axis.lateral": ""}
ISO = 'time_column = "t"\ntime_unit = "iso"'


def texts(start: str, rows: int = 400, suffix: str = "", separator: str = "T") -> list[str]:
    begin = datetime.fromisoformat(start)
    times = [begin + timedelta(microseconds=200 * k) for k in range(rows)]
    return [time.isoformat(sep=separator, timespec="microseconds") + suffix for time in times]


def imported_dates(tmp_path: Path, times: list[str], sampling: str = ISO) -> tuple[ImportReport, Decoded]:
    path, out = tmp_path / "run.csv", tmp_path / "out.mcap"
    rows = [f"{time},{k % 7}" for k, time in enumerate(times)]
    path.write_text("\n".join(["t,z", *rows]) + "\n", encoding="utf-8")
    report = import_file(path, parse_map(simple_map(sampling=sampling, **RADIAL_ONLY), "map"), out)
    return report, Decoded(out)


def start_of(decoded: Decoded) -> datetime:
    return datetime.fromtimestamp(decoded.items[0].host_ns // 10**9, UTC)


@pytest.mark.parametrize(
    ("suffix", "separator", "zone", "utc_hour"),
    [
        ("Z", "T", "", 12),
        ("+02:00", " ", "", 10),
        ("-0530", "T", "", 17),
        ("", "T", '\ntime_zone = "Europe/Berlin"', 10),
        ("", " ", '\ntime_zone = "UTC"', 12),
        ("", "T", '\ntime_zone = "-03:00"', 15),
        ("Z", "T", '\ntime_zone = "Europe/Berlin"', 12),
    ],
)
def test_zones_of_file_and_map_give_the_start(
    tmp_path: Path, suffix: str, separator: str, zone: str, utc_hour: int
) -> None:
    times = texts("2024-05-01T12:00:00", suffix=suffix, separator=separator)
    report, decoded = imported_dates(tmp_path, times, ISO + zone)
    assert report.rate_hz == pytest.approx(5000.0, rel=1e-6)
    assert not report.start_is_file_date
    assert start_of(decoded).hour == utc_hour


def test_digits_may_be_missing_and_cells_empty(tmp_path: Path) -> None:
    times = texts("2024-05-01T12:00:00", suffix="Z")
    times[0], times[7], times[5] = "2024-05-01T12:00:00Z", "", times[5].replace("1000Z", "1Z")
    report, decoded = imported_dates(tmp_path, times)
    assert (report.samples, len(decoded.counts)) == (400, 400)


def test_times_without_a_zone_are_rejected(tmp_path: Path) -> None:
    with pytest.raises(ImportDataError, match="line 2, column 't': .* states no time zone") as caught:
        imported_dates(tmp_path, texts("2024-05-01T12:00:00"))
    assert 'time_zone, such as "Europe/Berlin"' in caught.value.remedy


@pytest.mark.parametrize(("start", "message"), [("2024-10-27T02:10:00", "twice"), ("2024-03-31T02:10:00", "not exist")])
def test_ambiguous_local_times_are_rejected(tmp_path: Path, start: str, message: str) -> None:
    with pytest.raises(ImportDataError, match=f"line 2, .* {message} in Europe/Berlin") as caught:
        imported_dates(tmp_path, texts(start), ISO + '\ntime_zone = "Europe/Berlin"')
    assert 'time_zone = "+02:00"' in caught.value.remedy
    report, _ = imported_dates(tmp_path, texts(start), ISO + '\ntime_zone = "+01:00"')
    assert report.samples == 400


@pytest.mark.parametrize("cell", ["12:00:00.0002", "2024-13-01T12:00:00Z", "yesterday", "1.5"])
def test_cell_that_is_no_iso_time_is_named(tmp_path: Path, cell: str) -> None:
    times = texts("2024-05-01T12:00:00", suffix="Z")
    times[3] = cell
    with pytest.raises(ImportDataError, match="line 5, column 't': .* is not an ISO time"):
        imported_dates(tmp_path, times)


def test_zone_that_does_not_exist_is_a_fault_of_the_map() -> None:
    with pytest.raises(ConfigError, match="did you mean Europe/Berlin"):
        parse_map(simple_map(sampling=ISO + '\ntime_zone = "Europe/Berln"'), "map")
    with pytest.raises(ConfigError, match='only for time_unit = "iso"'):
        parse_map(simple_map(sampling='time_column = "t"\ntime_zone = "UTC"'), "map")


@pytest.mark.parametrize("zone", [None, "Europe/Berlin"])
def test_timestamps_of_parquet_are_dates(tmp_path: Path, zone: str | None) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "run.parquet"
    begin_ns = int(datetime(2024, 5, 1, 12, tzinfo=UTC).timestamp()) * 10**9
    times = pa.array(begin_ns + 200_000 * np.arange(400), pa.timestamp("ns", tz=zone))
    pq.write_table(pa.table({"t": times, "z": np.sin(np.arange(400.0))}), path)
    report = import_file(path, parse_map(simple_map(sampling=ISO, **RADIAL_ONLY), "map"), tmp_path / "out.mcap")
    assert report.rate_hz == pytest.approx(5000.0, rel=1e-9)
    assert report.start_is_file_date == (zone is None)
    with pytest.raises(ImportDataError, match="contains dates"):
        import_file(
            path, parse_map(simple_map(sampling='time_column = "t"', **RADIAL_ONLY), "map"), tmp_path / "b.mcap"
        )


def test_start_of_parquet_is_that_of_the_first_row_where_it_has_no_time(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    begin = datetime(2024, 5, 1, 12, tzinfo=UTC)
    times = [None, None, *(begin + timedelta(microseconds=200 * row) for row in range(2, 400))]
    path, out = tmp_path / "run.parquet", tmp_path / "out.mcap"
    pq.write_table(pa.table({"t": pa.array(times, pa.timestamp("us", "UTC")), "z": np.sin(np.arange(400.0))}), path)
    assert ParquetColumns(path).facts.dates == {"t": int(begin.timestamp()) * 10**9 + 400_000}
    import_file(path, parse_map(simple_map(sampling=ISO, **RADIAL_ONLY), "map"), out)
    assert Decoded(out).items[0].host_ns * 1e-9 == pytest.approx(begin.timestamp(), abs=1e-5)


def test_rows_of_sensors_that_are_left_out_delay_the_start(tmp_path: Path) -> None:
    path, out = tmp_path / "run.csv", tmp_path / "out.mcap"
    rows = "".join(
        f"{time},{s},{row % 50}\n" for row, time in enumerate(texts("2024-05-01T12:00:00", suffix="Z")) for s in "ab"
    )
    path.write_text("t,node,z\n" + rows)
    wheels = "".join(
        f'\n[[wheel]]\nposition = "{s}"\nsensor = "{s}"\n[wheel.axis.radial]\ncolumn = "z"\nunit = "g"' for s in "ab"
    )
    text = f'[file]\nsensor_column = "node"\n[sampling]\n{ISO}\nstart_s = 0.02\n[sensor]\ncoupling = "DC"{wheels}'
    import_file(path, parse_map(text, "map"), out)
    start = datetime(2024, 5, 1, 12, 0, 0, 20_000, tzinfo=UTC)
    assert Decoded(out).items[0].host_ns * 1e-9 == pytest.approx(start.timestamp(), abs=1e-5)


RATE_HZ = 9600.0


def imported_counters(tmp_path: Path, times: Sequence[object], unit: str) -> ImportReport:
    path = tmp_path / "run.csv"
    rows = (f"{time},{np.sin(0.01 * k):.4f}" for k, time in enumerate(times))
    path.write_text("\n".join(("t,z", *rows)) + "\n")
    text = f"""
[sampling]
time_column = "t"
time_unit = "{unit}"
[axis.radial]
column = "z"
unit = "g"
[sensor]
coupling = "DC"
"""
    return import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")


def counter_us(count: int, bits: int, before: int) -> list[int]:
    """Return microseconds of a counter that starts again after `before` rows."""
    return [(2**bits + round((k - before) / RATE_HZ * 1e6)) % 2**bits for k in range(count)]


@pytest.mark.parametrize(("bits", "unit"), [(32, "us"), (32, "s"), (24, "us"), (16, "us")])
@pytest.mark.parametrize("before", [1, 500, BLOCK_ROWS, BLOCK_ROWS + 7])
def test_counter_that_starts_again_goes_on(tmp_path: Path, bits: int, unit: str, before: int) -> None:
    count = before + 3000
    times = counter_us(count, bits, before)
    report = imported_counters(tmp_path, times if unit == "us" else [f"{t * 1e-6:.6f}" for t in times], unit)
    assert (report.samples, report.left_out) == (count, 0)
    assert report.rate_hz == pytest.approx(RATE_HZ, rel=1e-6 + 1e-3 / count)


def test_counter_that_starts_again_leaves_the_array_of_the_reader() -> None:
    times = np.array(counter_us(40, 16, 20), dtype=float)[:, None]
    times.flags.writeable = False
    reader = SimpleNamespace(blocks=lambda names: iter([Block(0, times, str, 1.0)]))
    sampling = parse_map(simple_map(sampling='time_column = "t"\ntime_unit = "us"', **RADIAL_ONLY), "map").sampling
    (block,) = GapFilledColumns(Path("run.npz"), reader, sampling).blocks(["t"])
    assert np.diff(block.values[:, 0]) == pytest.approx(1e6 / RATE_HZ, abs=1.0)


def test_samples_missing_where_a_counter_starts_again_are_a_gap(tmp_path: Path) -> None:
    times = counter_us(5000, 32, 2000)
    report = imported_counters(tmp_path, times[:1997] + times[2004:], "us")
    assert (report.samples, report.left_out) == (5000, 7)


@pytest.mark.parametrize("back", [2**31, 10_000_000, 50_000])
def test_other_steps_back_are_errors_of_their_line(tmp_path: Path, back: int) -> None:
    times = [2**32 - 200_000 + round(k / RATE_HZ * 1e6) - (back if k >= 1500 else 0) for k in range(3000)]
    with pytest.raises(ImportDataError, match="line 1502: the time steps by -") as caught:
        imported_counters(tmp_path, times, "us")
    assert "about 9600.0" in caught.value.remedy or "about 9599.9" in caught.value.remedy


def test_fault_after_a_restart_names_its_line(tmp_path: Path) -> None:
    times = counter_us(3000, 32, 1000)
    times[2000:] = [time + 760 for time in times[2000:]]
    with pytest.raises(ImportDataError, match=r"line 2002: the time steps by 8\.\d+ sample intervals"):
        imported_counters(tmp_path, times, "us")


def test_nanoseconds_since_1970_keep_the_rate(tmp_path: Path) -> None:
    times = [1_764_000_000_000_000_000 + round(k / RATE_HZ * 1e9) for k in range(5000)]
    report = imported_counters(tmp_path, times, "ns")
    assert (report.samples, report.left_out) == (5000, 0)
    assert report.rate_hz == pytest.approx(RATE_HZ, rel=1e-6)


def test_rows_without_a_time_do_not_end_a_counter() -> None:
    counter = TimeCounter()
    times = np.array(counter_us(40, 16, 20), dtype=float)
    times[17:23] = np.nan
    continued = counter.look(times)
    assert counter.restarts == 1
    assert np.isnan(continued[17:23]).all()
    assert np.diff(continued[[16, 23]]) == pytest.approx(7e6 / RATE_HZ, abs=1.0)
