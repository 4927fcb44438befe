"""HDF5 files and MATLAB 7.3 files made by h5py: names, layouts, and what cannot be imported."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.errors import ImportDataError
from gateway.importing.columns import require_columns
from gateway.importing.import_map import FileFormat, parse_map
from gateway.importing.importer import import_file
from gateway.importing.reader_process import ProcessColumns, ReaderProcesses
from gateway.types import FloatArray
from tests.importing.measurements import Decoded, simple_map, waveform

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
