"""HDF5, MATLAB and MDF files: columns, units, and what is refused with a remedy."""

import warnings
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.columns import require_columns
from gateway.importing.import_map import FileFormat, parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
from gateway.importing.reader_process import ProcessColumns, ReaderProcesses
from tests.importing.measurements import Decoded, simple_map, waveform
from tests.importing.rolling_wheel import rolling

h5py = pytest.importorskip("h5py")


@pytest.fixture(scope="module")
def processes() -> Iterator[ReaderProcesses]:
    supply = ReaderProcesses(keep=True)
    yield supply
    supply.end()


def values(path: Path, processes: ReaderProcesses, *names: str) -> FloatArray:
    reader = ProcessColumns(path, FileFormat.HDF5, processes)
    try:
        require_columns(reader, path, names)
        return np.concatenate([block.values for block in reader.blocks(names)])
    finally:
        reader.close()


def test_packed_numbers_of_netcdf_are_unpacked(tmp_path: Path, processes: ReaderProcesses) -> None:
    path, stored = tmp_path / "run.nc4", np.array([-32767, 0, 10, 20, -1], dtype=np.int16)
    with h5py.File(path, "w") as file:
        data = file.create_dataset("z", data=stored)
        attributes = {"scale_factor": 0.5, "add_offset": 3.0, "_FillValue": stored[:1], "missing_value": stored[4]}
        data.attrs.update(attributes)
    np.testing.assert_array_equal(values(path, processes, "z")[:, 0], [np.nan, 3.0, 8.0, 13.0, np.nan])


@pytest.mark.parametrize(("attribute", "first"), [("offset", 0.0), ("offset_s", 1000.0), ("wf_start_offset", 1000.0)])
def test_offset_of_a_calibration_is_no_start(
    tmp_path: Path, processes: ReaderProcesses, attribute: str, first: float
) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        for name, start in (("x", 0.0), ("z", 1.0)):
            file[name] = np.arange(2000.0)
            file[name].attrs.update({attribute: start, "dt": 1e-3})
    assert values(path, processes, "x", "z")[0].tolist() == [first, 0.0]


def as_matlab(path: Path) -> None:
    """Give a file that has a user block the header of MATLAB 7.3."""
    data = path.read_bytes()
    path.write_bytes(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM" + data[128:])


@pytest.fixture
def plain(tmp_path: Path) -> Path:
    path, data = tmp_path / "run.h5", waveform(500)
    with h5py.File(path, "w") as file:
        file["run/z"] = data[:, 2]
        file["run/z"].attrs["units"] = "g"
        file.create_dataset("packed", data=data, chunks=(64, 2), compression="gzip", shuffle=True)
        file.create_dataset("counts", data=(data[:, 2] * 10).astype(">i2"))
        file["table"] = np.array(list(zip(range(500), data[:, 2], strict=True)), dtype=[("n", "i4"), ("z", "f8")])
        file["digital"] = data[:, 2] > 0
        file["link"] = h5py.SoftLink("/run/z")
    return path


def test_columns_of_groups_matrices_tables_and_links(plain: Path, processes: ReaderProcesses) -> None:
    data = waveform(500)
    names = ("run/z", "packed(:,2)", "counts", "table.z", "digital", "link")
    estimates = values(plain, processes, *names)
    expected = [data[:, 2], data[:, 1], np.trunc(data[:, 2] * 10), data[:, 2], data[:, 2] > 0, data[:, 2]]
    np.testing.assert_array_equal(estimates, np.column_stack(expected))


def test_import_gives_the_samples_of_the_file(plain: Path, tmp_path: Path) -> None:
    axes = {"axis.circumferential": "", "axis.lateral": "", "axis.radial": 'column = "run/z"\nunit = "g"'}
    import_file(plain, parse_map(simple_map(**axes), "map"), tmp_path / "out.mcap")
    decoded = Decoded(tmp_path / "out.mcap")
    step = decoded.hello.scale_mps2[2]
    np.testing.assert_allclose(decoded.samples_mps2[:, 0], waveform(500)[:, 2] * 9.80665, atol=0.51 * step)


def test_matlab_73_has_the_names_of_matlab(tmp_path: Path, processes: ReaderProcesses) -> None:
    path, data = tmp_path / "run.mat", waveform(300)
    with h5py.File(path, "w", userblock_size=512) as file:
        # MATLAB stores a column vector as one row, and a matrix with its columns as rows.
        file["t"] = np.arange(300.0)[None, :]
        file["data"] = data.T
        file["run/acc"] = data.T
        file["run"].attrs["MATLAB_class"] = np.bytes_("struct")
        file["#refs#/a"] = data[:, 2][None, :]
        file["cell"] = np.array([[file["#refs#/a"].ref]], dtype=h5py.ref_dtype)
        file["cell"].attrs["MATLAB_class"] = np.bytes_("cell")
        file["empty"] = np.array([0, 0], dtype="u8")
        file["empty"].attrs["MATLAB_empty"] = np.uint8(1)
    as_matlab(path)
    estimates = values(path, processes, "t", "data(:,2)", "run.acc(:,3)", "cell{1}")
    np.testing.assert_array_equal(estimates, np.column_stack((np.arange(300.0), data[:, 1], data[:, 2], data[:, 2])))
    text = simple_map(
        **{"axis.circumferential": "", "axis.lateral": "", "axis.radial": 'column = "run.acc(:,3)"\nunit = "g"'}
    )
    assert import_file(path, parse_map(text, "map"), tmp_path / "out.mcap").samples == 300


def _unusable(file: Any) -> None:
    numbers = np.arange(10.0)
    file["complex"] = numbers + 1j
    file["text"] = "abc"
    file["words"] = ["a", "b"]
    file["cube"] = np.zeros((2, 3, 4))
    file["wide"] = np.zeros((3, 2000))
    file["far"] = h5py.ExternalLink("/etc/other.h5", "/a")
    file["dangling"] = h5py.SoftLink("/nothing")
    file["list"] = np.array([file["cube"].ref], dtype=h5py.ref_dtype)
    file.create_dataset("bomb", (10**12,), dtype="f8", chunks=(1000,), compression="gzip")
    file.create_dataset("chunk", (10**9,), dtype="f8", chunks=(5 * 10**8,))
    file["circle"] = file["/"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("complex", "is complex"),
        ("text", "is text"),
        ("words", "is text"),
        ("cube", "has 3 dimensions"),
        ("wide", "has 3 rows and 2000 columns"),
        ("far", "is a link to another file"),
        ("dangling", "is damaged"),
        ("list", "is a list of references"),
        ("bomb", "claims .* values, but the file stores 0 bytes"),
        ("chunk", "is stored in chunks of 4000 MB"),
        ("circle/bomb", "there is no column"),
    ],
)
def test_unusable_columns_are_named_with_a_remedy(
    tmp_path: Path, processes: ReaderProcesses, name: str, message: str
) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        _unusable(file)
    with pytest.raises(ImportDataError, match=message) as caught:
        values(path, processes, name)
    assert caught.value.remedy


def test_matlab_objects_are_named_with_a_remedy(tmp_path: Path, processes: ReaderProcesses) -> None:
    path = tmp_path / "run.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        file["T"] = np.zeros((1, 6), dtype="u4")
        file["T"].attrs["MATLAB_class"] = np.bytes_("timetable")
        file["#subsystem#/MCOS"] = np.zeros(3)
        file["s/data"] = np.zeros(3)
        file["s"].attrs["MATLAB_sparse"] = np.uint64(3)
    as_matlab(path)
    with pytest.raises(ImportDataError, match="'T' is a MATLAB object of class timetable") as caught:
        values(path, processes, "T")
    assert "seconds(T.Time)" in caught.value.remedy
    with pytest.raises(ImportDataError, match="'s' is a sparse matrix"):
        values(path, processes, "s")


def test_columns_of_different_lengths_are_rejected(tmp_path: Path, processes: ReaderProcesses) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["a"], file["b"] = np.arange(10.0), np.arange(9.0)
    with pytest.raises(ImportDataError, match="a has 10, b has 9"):
        values(path, processes, "a", "b")


def test_reader_serves_the_next_file_after_an_error(plain: Path, tmp_path: Path, processes: ReaderProcesses) -> None:
    bad = tmp_path / "bad.h5"
    bad.write_bytes(plain.read_bytes()[:3000])
    first = processes.take(FileFormat.HDF5)
    processes.give_back(first, in_order=True)
    with pytest.raises(ImportDataError):
        values(bad, processes, "run/z")
    assert len(values(plain, processes, "run/z")) == 500
    again = processes.take(FileFormat.HDF5)
    assert again is first
    processes.give_back(again, in_order=True)


def test_damaged_index_of_chunks_is_an_error(tmp_path: Path, processes: ReaderProcesses) -> None:
    # Found by fuzzing: asking for the stored size raised an error of another kind than reading.
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file.create_dataset("z", data=np.arange(500.0), chunks=(50,), compression="gzip")
    data = path.read_bytes()
    path.write_bytes(data[: data.rindex(b"TREE")] + b"BUSH" + data[data.rindex(b"TREE") + 4 :])
    with pytest.raises(ImportDataError, match="is damaged"):
        values(path, processes, "z")


asammdf = pytest.importorskip("asammdf")
RATE_HZ = 10_000.0
START = datetime(2024, 5, 1, 12, 0, 0, tzinfo=UTC)


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


def test_slower_acceleration_of_another_group_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "two.mf4"
    with asammdf.MDF() as mdf:
        for name, step in (("z", 1), ("y", 2)):
            times = np.arange(0, 4000, step) / RATE_HZ
            mdf.append([asammdf.Signal(np.sin(50 * times), times, name=name, unit="g")])
        mdf.save(path, overwrite=True)
    text = simple_map(sampling='time_column = "time"', **{"axis.circumferential": ""})
    with pytest.raises(ImportDataError, match="differ in their step: y has 0.0002 s, z has 0.0001 s"):
        import_file(path, parse_map(text, "map"), tmp_path / "out.mcap")


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
