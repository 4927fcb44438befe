"""MDF files made by asammdf: channels, groups of other rates, invalid values, and the file's own time."""

from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import ImportDataError
from gateway.importing.import_map import FileFormat, parse_map
from gateway.importing.importer import import_file
from gateway.importing.reader_process import ProcessColumns, ReaderProcesses
from tests.importing.measurements import Decoded, simple_map

asammdf = pytest.importorskip("asammdf")
RATE_HZ = 10_000.0
START = datetime(2024, 5, 1, 12, 0, 0, tzinfo=UTC)


@pytest.fixture(scope="module")
def processes() -> Iterator[ReaderProcesses]:
    supply = ReaderProcesses(keep=True)
    yield supply
    supply.end()


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    times = np.arange(70_000) / RATE_HZ
    path = tmp_path_factory.mktemp("mdf") / "run.mf4"
    with asammdf.MDF(version="4.10") as mdf:
        mdf.header.start_time = START
        counts = (100 * np.sin(50 * times)).astype("<i2")
        invalid = np.zeros(len(times), dtype=bool)
        invalid[1000:1010] = True
        mdf.append(
            [
                asammdf.Signal(np.sin(50 * times), times, name="z", unit="g", invalidation_bits=invalid),
                asammdf.Signal(counts, times, name="x", conversion={"a": 0.01, "b": 1.0}),
            ]
        )
        slow = np.arange(8) / 1.0
        mdf.append(
            [
                asammdf.Signal(220.0 + slow, slow, name="p", unit="kPa"),
                asammdf.Signal(np.array([b"on"] * 8), slow, name="state", encoding="utf-8"),
            ]
        )
        mdf.append([asammdf.Signal(times, times + 2e-5, name="x")])
        mdf.save(path, overwrite=True, compression=2)
    return path


def test_channels_are_scaled_and_invalid_values_missing(measured: Path, processes: ReaderProcesses) -> None:
    reader = ProcessColumns(measured, FileFormat.MF4, processes)
    result = np.concatenate([block.values for block in reader.blocks(["z", "x (group 0)", "time"])])
    assert reader.facts.units["z"] == "g"
    reader.close()
    times = np.arange(70_000) / RATE_HZ
    np.testing.assert_allclose(result[:, 2], times, atol=1e-12)
    np.testing.assert_allclose(result[:, 1], np.trunc(100 * np.sin(50 * times)) * 0.01 + 1.0)
    assert np.flatnonzero(np.isnan(result[:, 0])).tolist() == list(range(1000, 1010))


def test_slow_channel_is_interpolated_to_the_axes(measured: Path, processes: ReaderProcesses) -> None:
    reader = ProcessColumns(measured, FileFormat.MF4, processes)
    result = np.concatenate([block.values for block in reader.blocks(["z", "p"])])
    with pytest.raises(ImportDataError, match="'state' is text"):
        list(reader.blocks(["z", "state"]))
    with pytest.raises(ImportDataError, match=r"'x \(group 2\)' has 70000 samples at times of its own"):
        list(reader.blocks(["z", "x (group 2)"]))
    reader.close()
    assert result[25_000, 1] == pytest.approx(222.5)


def test_import_takes_time_start_and_gaps_from_the_file(measured: Path, tmp_path: Path) -> None:
    text = simple_map(
        sampling='time_column = "time"',
        environment='pressure_column = "p"',
        **{"axis.circumferential": "", "axis.lateral": 'column = "x (group 0)"\nunit = "g"'},
    )
    report = import_file(measured, parse_map(text, "map"), tmp_path / "out.mcap")
    assert (report.rate_hz, report.samples) == (pytest.approx(RATE_HZ), 70_000)
    assert (report.wheels[0].gaps, report.start_is_file_date) == (10, False)
    decoded = Decoded(tmp_path / "out.mcap")
    assert len(decoded.counts) == 69_990
    assert decoded.items[0].host_ns == int(START.timestamp()) * 10**9
    assert decoded.environments[-1].pressure_pa == pytest.approx(226_500, abs=600)
