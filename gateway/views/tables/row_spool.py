"""Rows of a table in a temporary file, on their way from the process that makes them to the one that writes the table.

The file is read by the program that wrote it, in a folder of its own.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Final, Protocol, Self

from gateway.errors import OutputError
from gateway.views.tables.result_table import ColumnRows, JsonRows, Row, RowMaker, TableFormat

_BUFFER_BYTES: Final = 1 << 18


class RowSpool(RowMaker, Protocol):
    """Takes rows; all methods raise OutputError when the file cannot be written."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...


class _Spool:
    def __init__(self, path: Path) -> None:
        self._path = path
        self._file = path.open("xb", buffering=_BUFFER_BYTES)

    def put(self, row: Row) -> None:
        try:
            pickle.dump(row, self._file, pickle.HIGHEST_PROTOCOL)
        except OSError as error:
            raise _full(self._path, error) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            self._file.close()
        except OSError as failed:
            raise _full(self._path, failed) from failed


class _JsonSpool(_Spool, JsonRows):
    pass


class _ColumnSpool(_Spool, ColumnRows):
    pass


def open_spool(path: Path, table_format: TableFormat, coverage_factor: float | None = None) -> RowSpool:
    """Open a new file for the rows of a table; it is a context manager, and a `RowMaker` of the format."""
    spool = _JsonSpool(path) if table_format is TableFormat.JSON else _ColumnSpool(path)
    spool.coverage_factor = coverage_factor
    return spool


def spooled_rows(path: Path) -> Iterator[Row]:
    """Yield the rows of a file."""
    with path.open("rb", buffering=_BUFFER_BYTES) as file, suppress(EOFError):
        while True:
            row: Row = pickle.load(file)
            yield row


def _full(path: Path, error: OSError) -> OutputError:
    return OutputError(
        f"rows cannot be kept in '{path.parent}': {error.strerror}", "Free some space, or use one process: --jobs 1."
    )
