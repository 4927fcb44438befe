"""Time columns of devices: counters of few bits that start again, and times since 1970."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import ImportDataError
from gateway.importing.columns import BLOCK_ROWS
from gateway.importing.import_map import parse_map
from gateway.importing.importer import ImportReport, import_file
from gateway.importing.time_counter import TimeCounter

RATE_HZ = 9600.0


def imported(tmp_path: Path, times: Sequence[object], unit: str) -> ImportReport:
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
    report = imported(tmp_path, times if unit == "us" else [f"{t * 1e-6:.6f}" for t in times], unit)
    assert (report.samples, report.left_out) == (count, 0)
    assert report.rate_hz == pytest.approx(RATE_HZ, rel=1e-6 + 1e-3 / count)


def test_samples_missing_where_a_counter_starts_again_are_a_gap(tmp_path: Path) -> None:
    times = counter_us(5000, 32, 2000)
    report = imported(tmp_path, times[:1997] + times[2004:], "us")
    assert (report.samples, report.left_out) == (5000, 7)


@pytest.mark.parametrize("back", [2**31, 10_000_000, 50_000])
def test_other_steps_back_are_errors_of_their_line(tmp_path: Path, back: int) -> None:
    times = [2**32 - 200_000 + round(k / RATE_HZ * 1e6) - (back if k >= 1500 else 0) for k in range(3000)]
    with pytest.raises(ImportDataError, match="line 1502: the time steps by -") as caught:
        imported(tmp_path, times, "us")
    assert "about 9600.0" in caught.value.remedy or "about 9599.9" in caught.value.remedy


def test_fault_after_a_restart_names_its_line(tmp_path: Path) -> None:
    times = counter_us(3000, 32, 1000)
    times[2000:] = [time + 760 for time in times[2000:]]
    with pytest.raises(ImportDataError, match=r"line 2002: the time steps by 8\.\d+ sample intervals"):
        imported(tmp_path, times, "us")


def test_nanoseconds_since_1970_keep_the_rate(tmp_path: Path) -> None:
    times = [1_764_000_000_000_000_000 + round(k / RATE_HZ * 1e9) for k in range(5000)]
    report = imported(tmp_path, times, "ns")
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
