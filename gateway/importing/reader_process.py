"""Readers that run in a process of their own, where a crash of a foreign parser is an error message.

The parsers of MATLAB, HDF5, MDF and Parquet files are compiled code. A damaged file can make them write anywhere, ask
for any amount of memory, or never end. Their process has a limit of memory and of time. Plain numbers return over a
pipe.
"""

import contextlib
import itertools
import json
import logging
import os
import signal
import sys
import warnings
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np

from gateway.core.errors import ImportDataError, reading_remedy
from gateway.core.worker_pool import main_module_hidden
from gateway.importing.columns import Block, BlockReader, FileFacts, row_places
from gateway.importing.import_map import FileFormat


@dataclass(frozen=True, slots=True)
class _Parser:
    """Reader of a format.

    Attributes:
        module: module of the reader's class.
        reader: name of the class.
        kind: name of the format in messages.
        preload: module that the processes are forked with.
        package: package of an extra, None when it belongs to the program.
        extra: name of the extra.
    """

    module: str
    reader: str
    kind: str
    preload: str
    package: str | None = None
    extra: str = ""


_PARSERS: Final = {
    FileFormat.MAT: _Parser("gateway.importing.mat_columns", "MatColumns", "MATLAB", "scipy.io"),
    FileFormat.HDF5: _Parser("gateway.importing.hdf5_columns", "Hdf5Columns", "HDF5", "h5py", "h5py", "formats"),
    FileFormat.FAMOS: _Parser("gateway.importing.famos_columns", "FamosColumns", "FAMOS", "numpy"),
    FileFormat.IMU: _Parser("gateway.importing.imu_columns", "ImuColumns", "MCAP", "mcap.reader"),
    FileFormat.NPZ: _Parser("gateway.importing.npz_columns", "NpzColumns", "numpy", "numpy"),
    FileFormat.VBO: _Parser("gateway.importing.vbo_columns", "VboColumns", "VBO", "numpy"),
    FileFormat.TYDEX: _Parser("gateway.importing.tydex_columns", "TydexColumns", "TYDEX", "numpy"),
    FileFormat.XLSX: _Parser(
        "gateway.importing.xlsx_columns", "XlsxColumns", "Excel", "openpyxl", "openpyxl", "formats"
    ),
    FileFormat.WAV: _Parser("gateway.importing.wav_columns", "WavColumns", "WAV", "scipy.io.wavfile"),
    FileFormat.IDE: _Parser("gateway.importing.ide_columns", "IdeColumns", "IDE", "idelib", "idelib", "formats"),
    FileFormat.MF4: _Parser("gateway.importing.mdf_columns", "MdfColumns", "MDF", "asammdf", "asammdf", "formats"),
    FileFormat.PARQUET: _Parser(
        "gateway.importing.parquet_columns", "ParquetColumns", "Parquet", "pyarrow.parquet", "pyarrow", "parquet"
    ),
    FileFormat.TDMS: _Parser("gateway.importing.tdms_columns", "TdmsColumns", "TDMS", "nptdms", "nptdms", "formats"),
    FileFormat.UFF: _Parser("gateway.importing.uff_columns", "UffColumns", "UFF", "pyuff", "pyuff", "formats"),
}
_SPARE_BYTES: Final = 384 << 20
_BYTES_PER_FILE_BYTE: Final = 64
_SPARE_S: Final = 60.0
_FILE_BYTES_PER_S: Final = 2e6
_END_S: Final = 5.0
_MAX_WARNINGS: Final = 4
_WARNING_LENGTH: Final = 200
_T = TypeVar("_T")


class ReaderProcess:
    """Process that reads files of one format, one after the other."""

    def __init__(self, file_format: FileFormat) -> None:
        """Start the process."""
        parser = _PARSERS[file_format]
        self.file_format = file_format
        # A fork of this process would copy its threads and locks; a fork of a fresh one starts faster than a spawn.
        context: Any = get_context("forkserver" if "forkserver" in get_all_start_methods() else "spawn")
        if hasattr(context, "set_forkserver_preload"):
            context.set_forkserver_preload([__name__, parser.module, parser.preload])
        self.pipe, child_pipe = context.Pipe()
        self.process = context.Process(target=_serve, args=(child_pipe, str(file_format)), daemon=True)
        with main_module_hidden():
            self.process.start()
        child_pipe.close()

    def end(self) -> None:
        """End the process."""
        self.pipe.close()
        self.process.kill()
        self.process.join(_END_S)


class ReaderProcesses:
    """Supply of reader processes: a new one for each file, or a kept one for many files."""

    def __init__(self, *, keep: bool = False) -> None:
        """Prepare the supply; with `keep`, a process that is returned in order serves the next file."""
        self._keep = keep
        self._idle: dict[FileFormat, ReaderProcess] = {}

    def take(self, file_format: FileFormat) -> ReaderProcess:
        """Return a process for a format."""
        return self._idle.pop(file_format, None) or ReaderProcess(file_format)

    def give_back(self, process: ReaderProcess, *, in_order: bool) -> None:
        """Take a process back; it ends unless it is in order and kept."""
        if self._keep and in_order and process.file_format not in self._idle:
            self._idle[process.file_format] = process
        else:
            process.end()

    def end(self) -> None:
        """End the idle processes."""
        while self._idle:
            self._idle.popitem()[1].end()


class ProcessColumns:
    """Columns of a file that another process reads.

    Attributes:
        facts: the file's statements about its columns.
    """

    def __init__(self, path: Path, file_format: FileFormat, processes: ReaderProcesses | None = None) -> None:
        """Let a process open the file.

        Raises:
            ImportDataError: the package of the format is missing, or the file cannot be read.
        """
        parser = _PARSERS[file_format]
        if parser.package is not None and find_spec(parser.package) is None:
            raise ImportDataError(
                f"{path}: {parser.kind} files need the package {parser.package}",
                f"Run: pip install 'treadlink[{parser.extra}]'",
            )
        self._path = path
        self._kind = parser.kind
        size = path.stat().st_size
        self._limit_s = _SPARE_S + size / _FILE_BYTES_PER_S
        self._processes = processes or ReaderProcesses()
        self._process: ReaderProcess | None = self._processes.take(file_format)
        # Between an opened file and its end the process expects requests; elsewhere it must not be used again.
        self._in_order = False
        try:
            self._ask(open=str(path), limit_bytes=_SPARE_BYTES + _BYTES_PER_FILE_BYTE * size)
            self.facts = FileFacts(**self._answer()["facts"])
        except BaseException:
            self.close()
            raise
        self._in_order = True

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns."""
        return tuple(self.facts.names)

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns.

        Raises:
            ImportDataError: the columns do not fit together, or the file is damaged.
        """
        yield from self._blocks(names, None)

    def _blocks(self, names: Sequence[str], max_blocks: int | None) -> Iterator[Block]:
        self._in_order = False
        self._ask(names=list(names), most=max_blocks)
        while (answer := self._answer())["rows"]:
            values = np.frombuffer(self._received()).reshape(answer["rows"], len(names))
            yield Block(answer["first"], values, row_places(answer["first"]), answer["progress"])
        self._in_order = True

    def sample(self, names: Sequence[str]) -> Block | None:
        """Return the first block of the named columns, None without rows.

        Raises:
            ImportDataError: as `blocks`.
        """
        return next(iter(list(self._blocks(names, 1))), None)

    def close(self) -> None:
        """Release the process."""
        process, self._process = self._process, None
        if process is None:
            return
        if self._in_order:
            with contextlib.suppress(OSError):
                process.pipe.send_bytes(b"{}")
        self._processes.give_back(process, in_order=self._in_order)

    def _ask(self, **request: Any) -> None:
        assert self._process is not None
        with contextlib.suppress(BrokenPipeError, ConnectionResetError):  # the answer tells of the crash
            self._process.pipe.send_bytes(json.dumps(request).encode())

    def _answer(self) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(self._received())
        if "error" in answer:
            if answer.get("is_open"):
                self._in_order = True
            else:
                # The process has closed the file and expects the next one.
                assert self._process is not None
                process, self._process = self._process, None
                self._processes.give_back(process, in_order=True)
            raise ImportDataError(answer["error"], answer["remedy"])
        return answer

    def _received(self) -> bytes:
        assert self._process is not None
        remedy = "The file is probably damaged. Save it again, or export its columns as CSV."
        if not self._process.pipe.poll(self._limit_s):
            raise ImportDataError(
                f"{self._path}: the reader of {self._kind} files did not answer within {self._limit_s:.0f} s", remedy
            )
        try:
            received: bytes = self._process.pipe.recv_bytes()
        except (EOFError, OSError) as error:
            self._process.process.join(_END_S)
            raise ImportDataError(
                f"{self._path}: the reader of {self._kind} files crashed ({_end_text(self._process.process.exitcode)})",
                remedy,
            ) from error
        return received


def _end_text(exit_code: int | None) -> str:
    if exit_code is None or exit_code >= 0:
        return f"exit code {exit_code}"
    with contextlib.suppress(ValueError):
        return signal.Signals(-exit_code).name
    return f"signal {-exit_code}"


def _serve(pipe: Connection, file_format: str) -> None:
    """Read files until the pipe closes or the process is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the parent, which ends this process
    with Path(os.devnull).open("wb") as sink:
        os.dup2(sink.fileno(), sys.__stderr__.fileno() if sys.__stderr__ else 2)  # an aborting parser prints there
    parser = _PARSERS[FileFormat(file_format)]
    # The library itself is not part of what a file may take.
    import_module(parser.preload)
    reader_class = getattr(import_module(parser.module), parser.reader)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        while True:
            request = json.loads(pipe.recv_bytes())
            _serve_file(pipe, reader_class, parser.kind, request["open"], request["limit_bytes"])


def _serve_file(pipe: Connection, reader_class: type[BlockReader], kind: str, path: str, limit_bytes: int) -> None:
    """Answer the requests for columns of one file until an empty request or an error."""
    reader: BlockReader | None = None
    try:
        with _limited_memory(limit_bytes):
            with _collected_warnings() as warned:
                reader = _opened(reader_class, kind, Path(path))
                facts = reader.facts
            _send(pipe, facts=asdict(replace(facts, warnings=(*facts.warnings, *warned))))
            while names := (request := json.loads(pipe.recv_bytes())).get("names"):
                blocks = itertools.islice(reader.blocks(names), request["most"])
                try:
                    _send_blocks(pipe, _named_damage(blocks, f"{path} is damaged"))
                except ImportDataError as error:
                    # Other columns of the file may be in order.
                    _send(pipe, error=str(error), remedy=error.remedy, is_open=True)
    except (EOFError, BrokenPipeError, ConnectionResetError):
        raise
    except ImportDataError as error:
        _send(pipe, error=str(error), remedy=error.remedy)
    except MemoryError:
        _send(
            pipe,
            error=f"{path}: reading it needs more than {limit_bytes / 1e6:.0f} MB of memory",
            remedy="If it is not damaged, save it without compression (in MATLAB with -v6), or in parts.",
        )
    except OSError as error:
        _send(pipe, error=f"{path} cannot be read: {error.strerror or error}", remedy=reading_remedy(error))
    finally:
        if reader is not None:
            with contextlib.suppress(Exception):  # a damaged file; nothing was written
                reader.close()


@contextlib.contextmanager
def _collected_warnings() -> Iterator[list[str]]:
    """Collect what the package of a format warns of: nobody sees its log. The list is complete afterwards."""
    messages: list[str] = []

    class Collector(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            text = f"{record.name.partition('.')[0]}: {record.getMessage()}"[:_WARNING_LENGTH]
            if len(messages) < _MAX_WARNINGS and text not in messages:
                messages.append(text)

    collector = Collector(logging.WARNING)
    packages = [
        logger
        for logger in map(logging.getLogger, (name for name in logging.root.manager.loggerDict if "." not in name))
        if not logger.name.startswith(("gateway", "asyncio", "concurrent"))
    ]
    for logger in packages:
        logger.addHandler(collector)
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("ignore")
            warnings.simplefilter("always", UserWarning)
            yield messages
        messages += [str(warning.message)[:_WARNING_LENGTH] for warning in caught[: _MAX_WARNINGS - len(messages)]]
    finally:
        for logger in packages:
            logger.removeHandler(collector)


def _opened(reader_class: Any, kind: str, path: Path) -> BlockReader:
    """Return the reader of a file.

    Raises:
        ImportDataError: the file is empty, or not of this format.
        OSError: it cannot be read.
    """
    with path.open("rb") as file:
        if not file.read(1):
            raise ImportDataError(f"{path} is empty", "Check the file.")
    readers: Iterator[BlockReader] = _named_damage(map(reader_class, [path]), f"{path} is not a readable {kind} file")
    return next(readers)


def _named_damage(items: Iterable[_T], fault: str) -> Iterator[_T]:
    """Yield what a parser reads.

    Raises:
        ImportDataError: the parser raised an error. A damaged file can make it raise any.
    """
    try:
        yield from items
    except (MemoryError, ImportDataError):
        raise
    except Exception as error:
        cause = next(iter(str(error).splitlines()), "")[:200] or type(error).__name__
        raise ImportDataError(
            f"{fault}: {cause}", "It may be cut or damaged: compare its size, or copy it again."
        ) from error


def _send_blocks(pipe: Connection, blocks: Iterable[Block]) -> None:
    for block in blocks:
        if len(block.values):
            _send(pipe, rows=len(block.values), first=block.first_row, progress=block.progress)
            values = np.array(block.values, dtype=np.float64, order="C")
            # A damaged file can contain signalling NaN, on which any calculation warns.
            values[np.isnan(values)] = np.nan
            pipe.send_bytes(values.tobytes())
    _send(pipe, rows=0)


def _send(pipe: Connection, **answer: Any) -> None:
    pipe.send_bytes(json.dumps(answer).encode())


@contextlib.contextmanager
def _limited_memory(limit_bytes: int) -> Iterator[None]:
    """Limit the memory of this process beyond what it has; Windows has no such limit."""
    try:
        import resource
    except ImportError:
        yield
        return
    memory_limits = resource.getrlimit(resource.RLIMIT_AS)
    with contextlib.suppress(OSError, ValueError):  # macOS refuses some limits
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        status = Path("/proc/self/statm")
        used_bytes = int(status.read_text().split()[0]) * resource.getpagesize() if status.exists() else 0
        resource.setrlimit(resource.RLIMIT_AS, (used_bytes + limit_bytes, memory_limits[1]))
    try:
        yield
    finally:
        with contextlib.suppress(OSError, ValueError):
            resource.setrlimit(resource.RLIMIT_AS, memory_limits)
