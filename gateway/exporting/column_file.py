"""Temporary file of a table, for formats that store column after column and state their lengths first."""

import tempfile
from collections.abc import Iterator, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.table_columns import Column
from gateway.exporting.export_table import DTYPES, Block, ExportWriter, Target, WheelTable, length

# Rows that are stored together; a column of them is read at once.
_STORED_ROWS: Final = 1 << 14


class ColumnFile:
    """Table in a temporary file that is read column by column; it takes a few bytes of memory per 16384 rows.

    Attributes:
        columns: as given.
        rows: number of rows so far.
        longest_text: length in bytes of the longest UTF-8 text of each column of text.
    """

    def __init__(self, columns: Sequence[Column], folder: str | None) -> None:
        """Create the file in `folder`, None for the system's folder of temporary files; it has no name."""
        self.columns = tuple(columns)
        self.rows = 0
        self.longest_text = {column.name: 0 for column in columns if column.kind is str}
        self._file = tempfile.TemporaryFile(dir=folder)  # noqa: SIM115 - open until `close`
        self._pending: list[Block] = []
        self._pending_rows = 0
        # (columns + 1,) offsets of the columns of each stored block
        self._offsets: list[NDArray[np.int64]] = []

    def append(self, block: Block) -> None:
        """Append rows."""
        self._pending.append(block)
        self._pending_rows += length(block)
        self.rows += length(block)
        if self._pending_rows >= _STORED_ROWS:
            self._store()

    def stored(self, column: Column) -> Iterator[bytes]:
        """Yield the content of a column of numbers, little-endian, in pieces."""
        self._store()
        index = self.columns.index(column)
        for offsets in self._offsets:
            self._file.seek(int(offsets[index]))
            yield self._file.read(int(offsets[index + 1] - offsets[index]))

    def texts(self, column: Column) -> Iterator[bytes]:
        """Yield the cells of a column of text in UTF-8."""
        for data in self.stored(column):
            begin = 0
            while begin < len(data):
                end = begin + 4 + int.from_bytes(data[begin : begin + 4], "little")
                yield data[begin + 4 : end]
                begin = end

    def blocks(self) -> Iterator[Block]:
        """Yield the rows again; only for tables without text."""
        self._store()
        for offsets in self._offsets:
            self._file.seek(int(offsets[0]))
            parts = [self._file.read(size) for size in np.diff(offsets).tolist()]
            yield {
                column.name: np.frombuffer(part, DTYPES[column.kind].newbyteorder("<"))
                for column, part in zip(self.columns, parts, strict=True)
            }

    def close(self) -> None:
        """Close the file, which removes it."""
        self._file.close()

    def _store(self) -> None:
        pending, self._pending, self._pending_rows = self._pending, [], 0
        if not pending:
            return
        self._file.seek(0, 2)
        offsets = [self._file.tell()]
        for column in self.columns:
            data = b"".join(self._packed(column, block[column.name]) for block in pending)
            self._file.write(data)
            offsets.append(offsets[-1] + len(data))
        self._offsets.append(np.array(offsets, np.int64))

    def _packed(self, column: Column, values: NDArray[Any]) -> bytes:
        if column.kind is not str:
            return np.asarray(values, DTYPES[column.kind].newbyteorder("<")).tobytes()
        texts = [str(text).encode() for text in values]
        self.longest_text[column.name] = max(self.longest_text[column.name], max(map(len, texts), default=0))
        return b"".join(len(text).to_bytes(4, "little") + text for text in texts)


class ColumnwiseExport(ExportWriter):
    """Writer of a format that stores column after column: rows wait in a temporary file for each wheel."""

    def __init__(self, target: Target) -> None:
        """Take the open file."""
        self.target = target
        self.tables: tuple[WheelTable, ...] = ()
        self.files: dict[str, ColumnFile] = {}

    def begin(self, tables: Sequence[WheelTable]) -> None:
        """Open a temporary file for every wheel."""
        self.tables = tuple(tables)
        self.files = {table.wheel: ColumnFile(table.columns, self.target.scratch) for table in tables}

    def write(self, table: WheelTable, block: Block) -> None:
        """Append rows to the temporary file."""
        self.files[table.wheel].append(block)

    def discard(self) -> None:
        """Close the temporary files."""
        for file in self.files.values():
            file.close()
