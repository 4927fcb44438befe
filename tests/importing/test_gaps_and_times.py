"""Empty cells as gaps, and time columns with rounded or missing times."""

import re
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from firmware_protocol.messages import SampleBlock
from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.columns import Block, number_table
from gateway.importing.commands.import_measurement import report_lines
from gateway.importing.csv_columns import CsvColumns
from gateway.importing.import_map import parse_map
from gateway.importing.importer import ImportReport, import_file
from gateway.importing.missing_rows import GapFilledColumns
from gateway.importing.reasons import ImportCode
from tests.importing.measurements import Decoded, simple_map

RADIAL_ONLY = {"axis.circumferential": "", "axis.lateral": ""}
RNG = np.random.default_rng(1)


def imported(tmp_path: Path, lines: list[str], sampling: str = "rate_hz = 10000") -> tuple[ImportReport, Decoded]:
    path, out = tmp_path / "run.csv", tmp_path / "out.mcap"
    path.write_text("\n".join(["t,z", *lines]) + "\n", encoding="utf-8")
    report = import_file(path, parse_map(simple_map(sampling=sampling, **RADIAL_ONLY), "map"), out)
    return report, Decoded(out)


def numbered(decoded: Decoded) -> dict[int, float]:
    """Return the samples by their number."""
    results = {}
    scale = decoded.hello.scale_mps2[2]
    for block in decoded.blocks:
        assert isinstance(block.message, SampleBlock)
        for k, count in enumerate(block.message.counts[:, 0]):
            results[block.message.first_sample + k] = float(count) * scale
    return results


@pytest.mark.parametrize("empty", ["", " ", "nan", '""'])
def test_empty_cells_keep_the_time_of_the_others(tmp_path: Path, empty: str) -> None:
    missing = {5, 6, 200, 399}
    report, decoded = imported(tmp_path, [f"{k},{empty if k in missing else k}" for k in range(400)])
    samples = numbered(decoded)
    assert set(samples) == set(range(400)) - missing
    step = decoded.hello.scale_mps2[2]
    assert all(abs(value - 9.80665 * k) <= 0.51 * step for k, value in samples.items())
    assert (report.samples, report.wheels[0].gaps) == (400, 4)
    assert any("4 rows without a value in an axis are gaps" in line for line in report_lines(report))
    first = next(frame for frame in decoded.blocks if frame.message.first_sample == 7)
    assert first.tick_us == 700


def test_rows_without_a_time_follow_their_neighbours(tmp_path: Path) -> None:
    lines = [f"{'' if k in (0, 7, 8, 399) else k / 5000:.10},{k}" for k in range(400)]
    report, decoded = imported(tmp_path, lines, 'time_column = "t"')
    assert report.rate_hz == pytest.approx(5000, rel=1e-9)
    assert set(numbered(decoded)) == set(range(400))


def rounded_times(rate_hz: float, step_s: float, rows: int, start_s: float = 0.0) -> FloatArray:
    return np.round((start_s + np.arange(rows) / rate_hz) / step_s) * step_s


@pytest.mark.parametrize("rate_hz", [9600.0, 9999.0, 10003.0, 8333.3, 5120.0, 4801.0])
def test_rounded_times_give_the_rate_of_the_whole_span(tmp_path: Path, rate_hz: float) -> None:
    times_s = rounded_times(rate_hz, 1e-4, 6000, start_s=1234.5)
    report, _ = imported(tmp_path, [f"{time:.4f},{k % 7}" for k, time in enumerate(times_s)], 'time_column = "t"')
    assert report.rounding_s == pytest.approx(1e-4)
    assert report.rate_std_hz is not None
    assert 0 < report.rate_std_hz < 1.0
    assert abs(report.rate_hz - rate_hz) < 3 * report.rate_std_hz
    line = report_lines(report)[0]
    assert "Hz by the time column, whose times are rounded to 0.1 ms" in line
    assert "+-" in line


def test_rate_errors_cover_their_spread(tmp_path: Path) -> None:
    pulls = []
    for number in range(40):
        rate_hz, folder = float(RNG.uniform(3000, 9900)), tmp_path / str(number)
        folder.mkdir()
        times_s = rounded_times(rate_hz, 1e-4, 1500, start_s=float(RNG.uniform(0, 10)))
        report, _ = imported(folder, [f"{time:.4f},{k % 7}" for k, time in enumerate(times_s)], 'time_column = "t"')
        assert report.rate_std_hz is not None
        pulls.append((report.rate_hz - rate_hz) / report.rate_std_hz)
    assert 0.6 < float(np.std(pulls)) < 1.4


@pytest.mark.parametrize(
    ("share", "sampling", "is_told"),
    [(0.014, "", True), (0.014, "\nrate_std_percent = 2", False), (0.00005, "", False)],
)
def test_rate_that_changes_by_more_than_its_error_is_told(
    tmp_path: Path, share: float, sampling: str, is_told: bool
) -> None:
    jitter = np.random.default_rng(5).uniform(-0.2, 0.2, 12_000)
    times_s = (np.cumsum(np.where(np.arange(12_000) < 9000, 1.0, 1.0 / (1.0 + share))) + jitter) * 1e-4
    lines = [f"{time_s!r},{k % 7}" for k, time_s in enumerate(times_s.tolist())]
    report, _ = imported(tmp_path, lines, f'time_column = "t"{sampling}')
    checks = [line for line in report_lines(report) if line.startswith("check: the time column")]
    assert len(checks) == is_told
    for finding in report.wheels[0].findings:
        if finding.code is ImportCode.RATE_CHANGES:
            assert (finding["low_hz"], finding["high_hz"]) == pytest.approx((1e4, 10140.0), rel=1e-3)
            assert finding["at_s"] == pytest.approx(0.9, abs=0.1)


def test_missing_sample_among_rounded_times_is_rejected(tmp_path: Path) -> None:
    times_s = np.delete(rounded_times(9600, 1e-4, 6000), slice(3000, 3003))
    with pytest.raises(ImportDataError, match=r"line 3002: the time steps by 3.* rounded to 0.1 ms") as caught:
        imported(tmp_path, [f"{time:.4f},{k % 7}" for k, time in enumerate(times_s)], 'time_column = "t"')
    assert "+- " in caught.value.remedy


@pytest.mark.parametrize("block_rows", [65536, 50])
def test_rows_that_are_left_out_are_gaps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block_rows: int) -> None:
    monkeypatch.setattr("gateway.importing.csv_columns.BLOCK_ROWS", block_rows)
    missing = {5, 6, 200, *range(300, 390)}
    lines = [f"{k / 9600:.7f},{k}" for k in range(400) if k not in missing]
    report, decoded = imported(tmp_path, lines, 'time_column = "t"')
    assert set(numbered(decoded)) == set(range(400)) - missing
    assert (report.samples, report.left_out) == (400, len(missing))
    assert report.rate_hz == pytest.approx(9600, rel=1e-4)
    assert any("93 samples that the time column skips are gaps" in line for line in report_lines(report))


def test_long_gap_between_rounded_times_is_filled(tmp_path: Path) -> None:
    """The median step of 9600 Hz in whole microseconds is 104, 0.16 % short: half a sample in 300."""
    missing = set(range(1200, 1500))
    lines = [f"{k / 9600:.6f},{k % 7}" for k in range(6000) if k not in missing]
    report, decoded = imported(tmp_path, lines, 'time_column = "t"')
    assert set(numbered(decoded)) == set(range(6000)) - missing
    assert report.rate_hz == pytest.approx(9600, rel=1e-5)


@pytest.mark.parametrize(("digits", "std"), [(7, ""), (6, ""), (4, r" \+- ")])
def test_advised_rate_does_not_contain_the_gap(tmp_path: Path, digits: int, std: str) -> None:
    lines = [f"{k / 9600 + (60.0 if k > 3000 else 0.0):.{digits}f},{k % 7}" for k in range(6000)]
    with pytest.raises(ImportDataError) as caught:
        imported(tmp_path, lines, 'time_column = "t"')
    stated = re.search(rf"rate_hz \((?:about )?([0-9.]+){std}", caught.value.remedy)
    assert stated is not None, caught.value.remedy
    assert float(stated[1]) == pytest.approx(9600, rel=1e-4)


def test_interruption_of_a_minute_is_rejected(tmp_path: Path) -> None:
    lines = [f"{k / 10000 + (60.0 if k > 300 else 0.0):.7f},{k % 7}" for k in range(600)]
    with pytest.raises(ImportDataError, match=r"line 303: the time steps by 6e\+05 sample intervals"):
        imported(tmp_path, lines, 'time_column = "t"')


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("time", ["4.391537091621493e+307", "-1e300", "inf", "-inf", "2e13"])
def test_unusable_time_names_line_and_column(tmp_path: Path, time: str) -> None:
    lines = [f"{time if k == 150 else k / 9600},{k % 7}" for k in range(400)]
    with pytest.raises(ImportDataError, match=r"line 152, column 't': \S+ cannot be measured") as caught:
        imported(tmp_path, lines, 'time_column = "t"')
    assert "leave the cell empty" in caught.value.remedy


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("unit", ["s", "us"])
@pytest.mark.parametrize("step", [1e-9, 1e-310])
def test_steps_too_short_to_be_times_are_rejected(tmp_path: Path, step: float, unit: str) -> None:
    lines = [f"{1e9 if k == 399 else k * step!r},{k % 7}" for k in range(400)]
    with pytest.raises(ImportDataError, match=r"from line 2 on the time steps by \S+ s, allowed: 1e-07 s") as caught:
        imported(tmp_path, lines, f'time_column = "t"\ntime_unit = "{unit}"')
    assert "Check the column and time_unit" in caught.value.remedy


def test_gap_of_too_many_samples_is_rejected(tmp_path: Path) -> None:
    lines = [f"{(k + (864_000 if k > 300 else 0)) / 96000!r},{k % 7}" for k in range(600)]
    with pytest.raises(ImportDataError, match=r"line 303: the time steps by 9.00001 s, which skips 864000 s") as caught:
        imported(tmp_path, lines, 'time_column = "t"')
    assert "allowed within 600 rows: 256000" in str(caught.value)
    assert "cut the file at the gap" in caught.value.remedy


def test_many_gaps_are_rejected_in_bounded_memory(tmp_path: Path) -> None:
    # Each time of 7 s is a gap of 67,000 samples, and the next time is back.
    lines = [f"{7 if k % 24 == 23 else k / 9600!r},{k % 7}" for k in range(6000)]
    tracemalloc.start()
    try:
        with pytest.raises(
            ImportDataError, match=r"line \d+: .* such gaps together skip \d+; allowed within 6000 rows"
        ):
            imported(tmp_path, lines, 'time_column = "t"')
        _, peak_bytes = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak_bytes < 30e6


def test_longest_gap_at_the_highest_rate_is_filled(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    path.write_text("t\n" + "\n".join(repr((k + (253_440 if k > 300 else 0)) / 25600) for k in range(600)) + "\n")
    import_map = parse_map(simple_map(sampling='time_column = "t"', **RADIAL_ONLY), "map")
    columns = GapFilledColumns(path, CsvColumns(path, import_map.file), import_map.sampling)
    (block,) = columns.blocks(["t"])
    assert columns.left_out == 253_440
    assert len(block.values) == 254_040
    assert block.where(253_741) == "line 303"


def test_a_block_without_times_is_no_gap() -> None:
    """Its rows are the samples that the step over it skips."""
    times = np.arange(300.0) * 1e-4
    times[100:200] = np.nan
    parts = [Block(first, times[first : first + 100, None], str, 0.0) for first in (0, 100, 200)]
    reader = SimpleNamespace(blocks=lambda names: iter(parts))
    sampling = parse_map(simple_map(sampling='time_column = "t"', **RADIAL_ONLY), "map").sampling
    columns = GapFilledColumns(Path("run.csv"), reader, sampling)
    assert [len(block.values) for block in columns.blocks(["t"])] == [100, 100, 100]


def test_faulty_line_of_a_table_is_named_whatever_follows_the_columns() -> None:
    with pytest.raises(ImportDataError, match="line 4"):
        number_table(Path("run.tdx"), [(3, "1 2 a remark"), (4, "3 b")], 2)


def test_coarse_rounding_advises_the_rate_with_its_error(tmp_path: Path) -> None:
    times_s = rounded_times(9600, 1e-3, 6000)
    with pytest.raises(ImportDataError, match="rounded to 1 ms, which is more than a sample interval") as caught:
        imported(tmp_path, [f"{time:.3f},{k % 7}" for k, time in enumerate(times_s)], 'time_column = "t"')
    assert "State rate_hz (960" in caught.value.remedy or "State rate_hz (959" in caught.value.remedy


def test_exact_times_are_not_called_rounded(tmp_path: Path) -> None:
    report, _ = imported(tmp_path, [f"{k / 5000:.4f},{k % 7}" for k in range(3000)], 'time_column = "t"')
    assert (report.rounding_s, report.rate_std_hz) == (None, None)
    assert report.rate_hz == pytest.approx(5000, rel=1e-9)


def bridged_lines(starts: range, length: int, decimals: int) -> list[str]:
    values = 100.0 + 20.0 * np.random.default_rng(3).standard_normal(9000)
    for position in starts:
        values[position : position + length] = np.linspace(values[position - 1], values[position + length], length + 2)[
            1:-1
        ]
    return [f"{k},{value:.{decimals}f}" for k, value in enumerate(values)]


@pytest.mark.parametrize("block_rows", [100, 65536])
@pytest.mark.parametrize("decimals", [3, 9])
def test_bridged_gaps_are_gaps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, block_rows: int, decimals: int) -> None:
    monkeypatch.setattr("gateway.importing.csv_columns.BLOCK_ROWS", block_rows)
    starts = range(200, 8000, 700)
    report, decoded = imported(tmp_path, bridged_lines(starts, 30, decimals))
    assert set(range(9000)) - set(numbered(decoded)) == {position + k for position in starts for k in range(30)}
    (wheel,) = report.wheels
    assert (wheel.gaps, wheel.bridged, wheel.bridges) == (0, 30 * len(starts), len(starts))
    assert any(line.startswith("360 samples on 12 straight lines") for line in report_lines(report))


def test_signal_that_was_interpolated_is_kept_and_reported(tmp_path: Path) -> None:
    values = np.interp(np.arange(9000) / 10.0, np.arange(901), RNG.normal(100.0, 20.0, 901))
    report, decoded = imported(tmp_path, [f"{k},{value:.9f}" for k, value in enumerate(values)])
    assert len(numbered(decoded)) == 9000
    (wheel,) = report.wheels
    assert wheel.bridged == 0
    assert [finding.code for finding in wheel.findings] == [ImportCode.SIGNAL_INTERPOLATED]
    assert any("the signal was interpolated" in line for line in report_lines(report))
