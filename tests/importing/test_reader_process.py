"""Readers in a process of their own: crashes, hangs, memory, and readers of plug-ins."""

import multiprocessing
import os
import signal
import struct
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest

from gateway.core.errors import ImportDataError
from gateway.importing import file_formats
from gateway.importing.columns import Block, FileFacts, require_columns, row_places
from gateway.importing.import_map import FileFormat, parse_map
from gateway.importing.importer import import_file
from gateway.importing.map_guess import guess_map
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


def test_parser_that_hangs_is_ended(tmp_path: Path) -> None:
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


ROWS = np.random.default_rng(0).normal(size=(4000, 3))


class Sound:
    """A reader that works."""

    facts = FileFacts(("x", "y", "z"))

    def __init__(self, path: Path) -> None:
        pass

    def values(self, names):
        return ROWS[:, : len(names)]

    def blocks(self, names):
        yield Block(0, self.values(names), row_places(0), 1.0)

    def sample(self, names):
        return next(iter(self.blocks(names)))

    def close(self) -> None:
        pass


def raising(error: BaseException) -> Callable[..., None]:
    def fail(*_: object) -> None:
        raise error

    return fail


FAULTS: dict[str, dict[str, object]] = {
    "opening": {"__init__": raising(ValueError("x" * 100_000))},
    "ends the program": {"__init__": raising(SystemExit(0))},
    "facts raise": {"facts": property(raising(ZeroDivisionError()))},
    "facts are none": {"facts": None},
    "blocks raise": {"blocks": raising(RuntimeError("b"))},
    "reading ends the program": {"values": raising(SystemExit(0))},
    "no blocks": {"blocks": lambda _self, _names: None},
    "numbers for blocks": {"blocks": lambda _self, _names: iter([3])},
    "another number of columns": {"values": lambda _self, _names: ROWS[:, :1]},
    "one dimension": {"values": lambda _self, _names: ROWS[:, 0]},
    "texts": {"values": lambda _self, names: np.full((9, len(names)), "x")},
    "complex": {"values": lambda _self, names: ROWS[:, : len(names)] * 1j},
}


@pytest.mark.parametrize("fault", FAULTS)
def test_fault_of_a_reader_is_a_message(fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    reader = type("Faulty", (Sound,), FAULTS[fault])
    monkeypatch.setattr(file_formats, "load", lambda *_: reader)
    (tmp_path / "run.evil").write_bytes(b"1")
    with pytest.raises(ImportDataError, match=r"run\.evil cannot be read") as caught:
        import_file(tmp_path / "run.evil", parse_map(simple_map(), "map"), tmp_path / "out.mcap")
    assert "plug-in" in caught.value.remedy
    assert len(str(caught.value)) < 3000
    assert [path.name for path in tmp_path.iterdir()] == ["run.evil"]


@pytest.mark.parametrize("changes", [{}, {"close": raising(RuntimeError("c"))}], ids=["sound", "close fails"])
def test_sound_reader_is_used(changes: dict[str, object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(file_formats, "load", lambda *_: type("Reader", (Sound,), changes))
    (tmp_path / "run.evil").write_bytes(b"1")
    report = import_file(tmp_path / "run.evil", parse_map(simple_map(), "map"), tmp_path / "out.mcap")
    assert report.samples == len(ROWS)
    assert "rate_hz" in guess_map(tmp_path / "run.evil")
