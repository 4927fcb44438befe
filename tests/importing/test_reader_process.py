"""Files whose parser crashes, hangs, or asks for too much memory."""

import multiprocessing
import os
import signal
import struct
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from gateway.errors import ImportDataError
from gateway.importing import reader_process
from gateway.importing.columns import require_columns
from gateway.importing.import_map import FileFormat, parse_map
from gateway.importing.importer import import_file
from gateway.importing.reader_process import ProcessColumns
from tests.importing.measurements import simple_map

CRASHES_SCIPY = Path(__file__).parent / "data" / "crashes_scipy.mat"


def opened(tmp_path: Path, rows: int = 100) -> ProcessColumns:
    scipy_io = pytest.importorskip("scipy.io")
    path = tmp_path / "run.mat"
    scipy_io.savemat(path, {"z": np.arange(float(rows))})
    return ProcessColumns(path, FileFormat.MAT)


def pid_of(reader: ProcessColumns) -> int:
    assert reader._process is not None
    return reader._process.process.pid


def test_file_that_crashes_its_parser_is_an_error(tmp_path: Path) -> None:
    text = simple_map(**{"axis.circumferential": "", "axis.lateral": ""})
    with pytest.raises(
        ImportDataError, match=r"crashes_scipy\.mat: the reader of MATLAB files crashed \(SIG"
    ) as caught:
        import_file(CRASHES_SCIPY, parse_map(text, "map"), tmp_path / "out.mcap")
    assert "export its columns as CSV" in caught.value.remedy


def test_parser_killed_while_reading_is_an_error(tmp_path: Path) -> None:
    reader = opened(tmp_path)
    os.kill(pid_of(reader), signal.SIGKILL)
    with pytest.raises(ImportDataError, match=r"crashed \(SIGKILL\)"):
        list(reader.blocks(["z"]))
    reader.close()


def test_parser_that_hangs_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reader_process, "_SPARE_S", 1.0)
    before = multiprocessing.active_children()
    reader = opened(tmp_path)
    os.kill(pid_of(reader), signal.SIGSTOP)
    reader._limit_s = 0.05
    with pytest.raises(ImportDataError, match="did not answer within 0 s"):
        list(reader.blocks(["z"]))
    reader.close()
    assert multiprocessing.active_children() == before


def test_absurd_size_is_an_error_about_memory(tmp_path: Path) -> None:
    path = tmp_path / "run.mat"
    # Version 4: type, rows, columns, imaginary, length of the name; then far fewer numbers than stated.
    path.write_bytes(struct.pack("<5I", 0, 20_000, 20_000, 0, 2) + b"z\0" + bytes(800))
    with pytest.raises(ImportDataError, match=r"needs more than 4\d\d MB of memory|not a readable MATLAB file"):
        ProcessColumns(path, FileFormat.MAT)


def test_failing_file_leaves_no_process(tmp_path: Path) -> None:
    path, before = tmp_path / "run.mat", multiprocessing.active_children()
    path.write_bytes(b"no MATLAB file" * 20)
    with pytest.raises(ImportDataError, match="not a readable MATLAB file"):
        ProcessColumns(path, FileFormat.MAT)
    assert multiprocessing.active_children() == before


def test_wide_matrix_is_named_with_the_remedy(tmp_path: Path) -> None:
    scipy_io = pytest.importorskip("scipy.io")
    path = tmp_path / "run.mat"
    scipy_io.savemat(path, {"acc": np.ones((3, 5000))})
    with closing(ProcessColumns(path, FileFormat.MAT)) as reader:
        for name in ("acc", "acc(:,2)"):
            with pytest.raises(ImportDataError, match="'acc' has 3 rows and 5000 columns") as caught:
                require_columns(reader, path, [name])
            assert "transpose" in caught.value.remedy


def test_signalling_nan_is_a_gap(tmp_path: Path) -> None:
    pa, pq = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "run.parquet"
    values = np.arange(10.0)
    values[3:4].view(np.uint64)[:] = 0x7FF4_0000_0000_0001
    pq.write_table(pa.table({"z": pa.array(values)}), path)
    reader = ProcessColumns(path, FileFormat.PARQUET)
    (block,) = reader.blocks(["z"])
    reader.close()
    assert block.values[3:4, 0].view(np.uint64)[0] == np.array([np.nan]).view(np.uint64)[0]
