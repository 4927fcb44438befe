"""Tables, timetables, datetimes and durations of MATLAB, written by mat-io in both versions of the format."""

import warnings
from pathlib import Path

import numpy as np
import pytest

from gateway.importing.import_map import FileFormat, parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from gateway.importing.reader_process import ProcessColumns
from tests.importing.measurements import Decoded
from tests.importing.rolling_wheel import rolling

matio = pytest.importorskip("matio")
pandas = pytest.importorskip("pandas")
WHEEL = rolling(9600.0, 1.0)
AXES = {f"acc_{name}": WHEEL.axes_mps2[:, k] / 9.80665 for k, name in enumerate("xyz")}
BEGIN = np.datetime64("2024-05-01T12:00:00", "ns")
STAMPS = BEGIN + np.round(WHEEL.times_s * 1e9).astype("timedelta64[ns]")


def saved(path: Path, version: str, **variables: object) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        matio.save_to_mat(str(path), variables, version=version)
    return path


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_table_is_imported_with_its_times(tmp_path: Path, version: str) -> None:
    table = pandas.DataFrame({"t": WHEEL.times_s, **AXES, "note": ["x"] * len(WHEEL.times_s)})
    path = saved(tmp_path / "run.mat", version, T=table, fs=9600.0)
    text = guess_map(path)
    assert 'column = "T.acc_z"' in text
    assert 'time_column = "T.t"' in text
    report = import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")
    assert report.samples == len(WHEEL.times_s)
    assert np.abs(Decoded(report.recording).samples_mps2[:, 2] - WHEEL.axes_mps2[:, 2]).max() < 0.1


@pytest.mark.parametrize("version", ["v7", "v7.3"])
def test_row_times_of_a_timetable_are_dates(tmp_path: Path, version: str) -> None:
    table = pandas.DataFrame(AXES, index=pandas.DatetimeIndex(STAMPS, name="Time"))
    path = saved(tmp_path / "run.mat", version, TT=table)
    kind = FileFormat.HDF5 if version == "v7.3" else FileFormat.MAT
    reader = ProcessColumns(path, kind)
    assert dict(reader.facts.dates) == {"TT.Time": None}
    block = reader.sample(["TT.Time", "TT.acc_z"])
    reader.close()
    # MATLAB keeps datetimes as ms.
    np.testing.assert_allclose(block.values[:, 0], WHEEL.times_s, atol=2e-6)
    np.testing.assert_allclose(block.values[:, 1], AXES["acc_z"])


def test_missing_package_is_named(tmp_path: Path, monkeypatch) -> None:
    from gateway.importing import mat_columns

    path = saved(tmp_path / "run.mat", "v7", T=pandas.DataFrame(AXES), t=WHEEL.times_s)
    monkeypatch.setattr(mat_columns, "can_read_objects", lambda: False)
    facts = mat_columns.MatColumns(path).facts
    assert facts.names == ("t",)
    assert "mat-io" in facts.unusable["tables and times"][1]
