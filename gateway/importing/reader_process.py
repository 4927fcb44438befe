"""Readers that run in a process of their own, where a crash of a foreign parser is an error message.

The parsers of MATLAB and Parquet files are compiled code. A damaged file can make them write anywhere, ask for any
amount of memory, or never end. Their process has a limit of memory and of time. Plain numbers return over a pipe.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from importlib.util import find_spec
from multiprocessing import get_all_start_methods, get_context
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

import numpy as np

from gateway.errors import ImportDataError
from gateway.importing.columns import Block, ColumnReader, row_places
from gateway.importing.import_map import FileFormat

_READERS: Final = {
    FileFormat.MAT: ("gateway.importing.mat_columns", "MatColumns", "MATLAB", "scipy.io"),
    FileFormat.PARQUET: ("gateway.importing.parquet_columns", "ParquetColumns", "Parquet", "pyarrow.parquet"),
}
_SPARE_BYTES: Final = 384 << 20
_BYTES_PER_FILE_BYTE: Final = 64
_SPARE_S: Final = 60.0
_FILE_BYTES_PER_S: Final = 2e6
_END_S: Final = 5.0


class ProcessColumns:
    """Columns of a file that another process reads.

    Attributes:
        names: names of all columns.
    """

    def __init__(self, path: Path, file_format: FileFormat) -> None:
        """Start the process and let it open the file.

        Raises:
            ImportDataError: the package of the format is missing, or the file cannot be read.
        """
        if file_format is FileFormat.PARQUET and find_spec("pyarrow") is None:
            raise ImportDataError(
                f"{path}: Parquet files need the package pyarrow", "Run: pip install 'treadlink[parquet]'"
            )
        self._path = path
        module, _, self._kind, parser = _READERS[file_format]
        size = path.stat().st_size
        self._limit_s = _SPARE_S + size / _FILE_BYTES_PER_S
        limit_bytes = _SPARE_BYTES + _BYTES_PER_FILE_BYTE * size
        # A fork of this process would copy its threads and locks; a fork of a fresh one starts faster than a spawn.
        context: Any = get_context("forkserver" if "forkserver" in get_all_start_methods() else "spawn")
        if hasattr(context, "set_forkserver_preload"):
            context.set_forkserver_preload(["__main__", __name__, module, parser])
        self._pipe, theirs = context.Pipe()
        self._process = context.Process(
            target=_serve, args=(theirs, str(path), str(file_format), limit_bytes), daemon=True
        )
        self._process.start()
        theirs.close()
        try:
            self.names: tuple[str, ...] = tuple(self._answer()["names"])
        except BaseException:
            self.close()
            raise

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns.

        Raises:
            ImportDataError: the columns do not fit together, or the file is damaged.
        """
        self._pipe.send_bytes(json.dumps(list(names)).encode())
        while (answer := self._answer())["rows"]:
            values = np.frombuffer(self._received()).reshape(answer["rows"], len(names))
            yield Block(answer["first"], values, row_places(answer["first"]), answer["progress"])

    def close(self) -> None:
        """End the process."""
        self._pipe.close()
        self._process.kill()
        self._process.join(_END_S)

    def _answer(self) -> dict[str, Any]:
        answer: dict[str, Any] = json.loads(self._received())
        if "error" in answer:
            raise ImportDataError(answer["error"], answer["remedy"])
        return answer

    def _received(self) -> bytes:
        remedy = "The file is probably damaged. Save it again, or export its columns as CSV."
        if not self._pipe.poll(self._limit_s):
            raise ImportDataError(
                f"{self._path}: the reader of {self._kind} files did not answer within {self._limit_s:.0f} s", remedy
            )
        try:
            received: bytes = self._pipe.recv_bytes()
        except (EOFError, OSError) as error:
            self._process.join(_END_S)
            raise ImportDataError(
                f"{self._path}: the reader of {self._kind} files crashed ({_end(self._process.exitcode)})", remedy
            ) from error
        return received


def _end(exit_code: int | None) -> str:
    if exit_code is None or exit_code >= 0:
        return f"exit code {exit_code}"
    with contextlib.suppress(ValueError):
        return signal.Signals(-exit_code).name
    return f"signal {-exit_code}"


def _serve(pipe: Connection, path: str, file_format: str, limit_bytes: int) -> None:
    """Answer requests for columns until the pipe closes or the process is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C ends the parent, which ends this process
    with Path(os.devnull).open("wb") as nothing:
        os.dup2(nothing.fileno(), sys.__stderr__.fileno() if sys.__stderr__ else 2)  # an aborting parser prints there
    module, name, *_ = _READERS[FileFormat(file_format)]
    reader_class = getattr(import_module(module), name)
    _limit_memory(limit_bytes)
    with contextlib.suppress(EOFError, BrokenPipeError, ConnectionResetError):
        try:
            reader: ColumnReader = reader_class(Path(path))
            _send(pipe, names=list(reader.names))
            while True:
                names = json.loads(pipe.recv_bytes())
                for block in reader.blocks(names):
                    if len(block.values):
                        _send(pipe, rows=len(block.values), first=block.first_row, progress=block.progress)
                        pipe.send_bytes(np.ascontiguousarray(block.values, dtype=np.float64).tobytes())
                _send(pipe, rows=0)
        except ImportDataError as error:
            _send(pipe, error=str(error), remedy=error.remedy)
        except MemoryError:
            _send(
                pipe,
                error=f"{path}: reading it needs more than {limit_bytes / 1e6:.0f} MB of memory",
                remedy="If it is not damaged, save it without compression (in MATLAB with -v6), or in parts.",
            )
        except OSError as error:
            _send(pipe, error=f"{path} cannot be read: {error.strerror or error}", remedy="Check its permissions.")


def _send(pipe: Connection, **answer: Any) -> None:
    pipe.send_bytes(json.dumps(answer).encode())


def _limit_memory(limit_bytes: int) -> None:
    """Limit the memory of this process beyond what it has; Windows has no such limit."""
    try:
        import resource
    except ImportError:
        return
    with contextlib.suppress(OSError, ValueError):  # macOS refuses some limits
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        status = Path("/proc/self/statm")
        used_bytes = int(status.read_text().split()[0]) * resource.getpagesize() if status.exists() else 0
        resource.setrlimit(resource.RLIMIT_AS, (used_bytes + limit_bytes, used_bytes + limit_bytes))
