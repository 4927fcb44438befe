"""Rates above the protocol's limit: the filter, and imports that use it."""

from pathlib import Path

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.importing.commands.import_measurement import report_lines
from gateway.importing.decimation import (
    ATTENUATION_DB,
    PASSBAND,
    RIPPLE_DB,
    STOPBAND,
    Decimator,
    decimation_factor,
)
from gateway.importing.import_map import parse_map
from gateway.importing.importer import import_file
from tests.importing.measurements import Decoded, simple_map, write_csv

NO_LIMIT = np.array([np.inf])


def decimated(values: FloatArray, factor: int, cuts: tuple[int, ...] = (), limit: float = np.inf) -> FloatArray:
    decimator = Decimator(factor, 1, np.array([limit]))
    parts = [decimator.feed(part[:, None]) for part in np.split(values, cuts)]
    parts.append(decimator.feed(np.empty((0, 1)), last=True))
    return np.concatenate(parts)[:, 0]


@pytest.mark.parametrize("factor", [2, 3, 4, 8])
def test_filter_keeps_its_statement(factor: int) -> None:
    # The response to an impulse at each phase of the decimation is the whole impulse response.
    length = 300
    response = np.zeros(length * factor)
    for phase in range(factor):
        impulse = np.zeros(length * factor)
        impulse[length // 2 * factor - phase] = 1.0
        response[phase::factor] = decimated(impulse, factor)
    spectrum = np.fft.rfft(response, 1 << 16)
    share = np.arange(len(spectrum)) / (1 << 16) * factor
    gain_db = 20 * np.log10(np.abs(spectrum) + 1e-12)
    assert np.abs(gain_db[share <= PASSBAND]).max() < RIPPLE_DB
    assert gain_db[share >= STOPBAND].max() < -ATTENUATION_DB
    # No delay: about the impulse the response is symmetric.
    centre = length // 2 * factor
    half = 40 * factor
    np.testing.assert_allclose(response[centre - half : centre], response[centre + half : centre : -1], atol=1e-12)


def test_result_does_not_depend_on_blocks() -> None:
    values = np.random.default_rng(1).normal(size=5000)
    np.testing.assert_allclose(decimated(values, 3, (1, 17, 1200, 4999)), decimated(values, 3), atol=1e-12)
    assert len(decimated(values, 3)) == 1667


def test_gap_widens_by_the_filter_only() -> None:
    values = np.ones(4000)
    values[2000] = np.nan
    result = decimated(values, 4)
    missing = np.flatnonzero(np.isnan(result))
    assert 500 in missing
    assert missing[0] >= 500 - 27
    assert missing[-1] <= 500 + 27
    np.testing.assert_allclose(result[~np.isnan(result)], 1.0)


def test_overload_stays_an_overload() -> None:
    values = np.zeros(4000)
    values[2000:2003] = -100.0
    result = decimated(values, 4, limit=100.0)
    assert result[500] == -100.0
    assert np.abs(result).max() == 100.0
    assert np.count_nonzero(np.abs(result) == 100.0) <= 4


@pytest.mark.parametrize(
    ("rate_hz", "factor"), [(25_600, 1), (25_600.01, 1), (25_700, 2), (51_200, 2), (51_201, 3), (100_000, 4), (9600, 1)]
)
def test_factor_is_the_smallest_that_is_supported(rate_hz: float, factor: int) -> None:
    assert decimation_factor(rate_hz) == factor


@pytest.mark.parametrize("by_time", [False, True])
def test_import_of_a_fast_file_keeps_time_and_states_the_filter(tmp_path: Path, by_time: bool) -> None:
    times = np.arange(20_000) / 102_400.0
    # Above the new rate's half a tone must vanish; below it stays, in phase.
    columns = {"t": times, "z": 10 * np.sin(2 * np.pi * 1000 * times) + 5 * np.sin(2 * np.pi * 20_000 * times)}
    path = write_csv(tmp_path / "run.csv", columns)
    sampling = 'time_column = "t"' if by_time else "rate_hz = 102400.0"
    import_map = parse_map(simple_map(sampling=sampling, **{"axis.circumferential": "", "axis.lateral": ""}), "map")
    report = import_file(path, import_map, tmp_path / "out.mcap")
    decoded = Decoded(tmp_path / "out.mcap")
    assert (report.rate_hz, report.samples) == (pytest.approx(25_600.0), 5000)
    expected = 98.0665 * np.sin(2 * np.pi * 1000 * times[::4])
    np.testing.assert_allclose(decoded.samples_mps2[50:-50, 0], expected[50:-50], atol=0.02)
    (line,) = [line for line in report_lines(report) if "decimated" in line]
    assert "decimated 4 times from 102400 Hz" in line
    assert "flat within 0.001 dB up to 10240 Hz, 80 dB from 12800 Hz on" in line
    assert "decimated 4 times" in decoded.vehicle_toml


def test_pulses_and_sparse_pressure_are_taken_at_the_rate_of_the_file(tmp_path: Path) -> None:
    rows = np.arange(20_000)
    columns = {
        "z": np.sin(rows / 50.0),
        "pulse": np.where(rows % 1001 < 2, 5.0, 0.0),
        "p": np.where(rows % 1024 == 1, 220.0, np.nan),
    }
    text = simple_map(
        sampling="rate_hz = 102400.0",
        environment='pressure_column = "p"',
        **{"axis.circumferential": "", "axis.lateral": ""},
    )
    text += '\n[[reference]]\nname = "tacho"\ncolumn = "pulse"\nquantity = "pulses"\n'
    report = import_file(write_csv(tmp_path / "run.csv", columns), parse_map(text, "map"), tmp_path / "out.mcap")
    # The first pulse has no edge before it.
    assert report.references == {"tacho": 19}
    assert [entry.pressure_pa for entry in Decoded(report.recording).environments] == [220e3]
