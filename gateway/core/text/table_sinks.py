"""Table formats with columns: CSV and Parquet, and what the columns mean."""

import csv
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime
from typing import IO, Any, Final, Protocol

import numpy as np

from gateway.core.optional_packages import require_packages
from gateway.core.table_columns import Column
from gateway.core.text.result_columns import Cells, in_text, values_of
from gateway.core.text.text import escaped, json_text

Cell = str | int | float | bool | None

_ROW_GROUP: Final = 8192
# A spreadsheet takes text that begins so for a formula, and runs it.
_FORMULA_STARTS: Final = ("=", "+", "-", "@", "\t", "\r", "\n")


class ColumnSink(Protocol):
    """A format with columns, which are given once before their cells."""

    def begin(self, columns: Sequence[Column], metadata: Mapping[str, str] | None = None) -> None:
        """Set the columns, before the first row, and the metadata of the file where the format has a place for it."""
        ...

    def rows(self, cells: Mapping[str, Cells]) -> None:
        """Add rows, by the names of the columns and in their order."""
        ...

    def end(self) -> None:
        """Write what is left; the file stays open."""
        ...


class CsvSink:
    """RFC 4180 with a header line; unknown values are empty, booleans 0 or 1, floats keep every digit.

    Text that a spreadsheet would run as a formula gets an apostrophe in front: names come from files and hubs.
    """

    def __init__(self, file: IO[bytes]) -> None:
        """Take the open file."""
        self._rows = csv.writer(_Utf8(file))

    def begin(self, columns: Sequence[Column], metadata: Mapping[str, str] | None = None) -> None:  # noqa: ARG002
        """Write the header; CSV has no place for metadata."""
        self.header(column.name for column in columns)

    def header(self, names: Iterable[str]) -> None:
        """Write the header."""
        self._rows.writerow([harmless(name) for name in names])

    def row(self, cells: Iterable[Cell]) -> None:
        """Add a row; None for unknown values."""
        self._rows.writerow(map(harmless, cells))

    def rows(self, cells: Mapping[str, Cells]) -> None:
        """Add rows."""
        columns = map(values_of, in_text(cells).values())
        printed = [values if type(values[0]) is float else map(harmless, values) for values in columns]
        self._rows.writerows(zip(*printed, strict=True))

    def end(self) -> None:
        """Do nothing: every row is in the file."""


class MetadataSink:
    """What the columns of a table mean, for formats without a place for it: JSON, as CSV on the Web (W3C, csvw)."""

    _DATATYPES: Final[Mapping[type, str]] = {str: "string", int: "integer", float: "double", bool: "boolean"}

    def __init__(self, file: IO[bytes]) -> None:
        """Take the open file."""
        self._file = file

    def begin(self, columns: Sequence[Column], metadata: Mapping[str, str] | None = None) -> None:
        """Write all of it: name, type, description and unit of each column, and how to read the table."""
        described = [
            {
                "name": column.name,
                "datatype": self._DATATYPES.get(column.kind, "dateTime"),
                "dc:description": column.description,
                **({"schema:unitText": column.unit} if column.unit else {}),
            }
            for column in columns
        ]
        notes = [{"treadlink": dict(metadata or {})}]
        document = {"@context": "http://www.w3.org/ns/csvw", "tableSchema": {"columns": described}, "notes": notes}
        self._file.write(json_text(document, indent=1).encode() + b"\n")

    def rows(self, cells: Mapping[str, Cells]) -> None:
        """Do nothing: rows are in the table."""

    def end(self) -> None:
        """Do nothing: all of it is in the file."""


class _Utf8:
    """Text file of a binary one that does not close it."""

    def __init__(self, file: IO[bytes]) -> None:
        self._file = file

    def write(self, text: str) -> int:
        return self._file.write(text.encode())


def harmless(cell: Cell) -> Cell:
    """Return a cell of CSV: booleans as 0 or 1, text escaped, an apostrophe before what a spreadsheet would run."""
    if isinstance(cell, bool):
        return int(cell)
    if not isinstance(cell, str):
        return cell
    return f"'{escaped(cell)}" if cell.startswith(_FORMULA_STARTS) else escaped(cell)


def arrow_schema(
    columns: Iterable[Column], metadata: Mapping[str, str] | None = None, *, is_brief: bool = False
) -> Any:
    """Return the Arrow schema of columns.

    Args:
        columns: in order.
        metadata: of the whole table.
        is_brief: whether the fields have no metadata; otherwise they have `unit` and `description`.
    """
    import pyarrow as pa

    types = {str: pa.string(), int: pa.int64(), float: pa.float64(), bool: pa.bool_()}
    types[datetime] = pa.timestamp("ns", tz="UTC")
    return pa.schema(
        [
            pa.field(
                column.name,
                pa.float32() if column.is_short else types[column.kind],
                metadata=None if is_brief else {"unit": column.unit, "description": column.description},
            )
            for column in columns
        ],
        metadata=metadata,
    )


def require_pyarrow() -> None:
    """Raise OutputError, naming the extra to install, when Parquet's package is missing."""
    require_packages("Parquet", "parquet", "pyarrow")


class ParquetSink:
    """Columns with unit and description, in row groups."""

    def __init__(self, file: IO[bytes]) -> None:
        """Take the open file."""
        self._file = file
        self._writer: Any = None
        self._schema: Any = None
        self._blocks: list[Sequence[Cells]] = []
        self._buffered_rows = 0

    def begin(self, columns: Sequence[Column], metadata: Mapping[str, str] | None = None) -> None:
        """Write the header."""
        import pyarrow.parquet as pq

        self._schema = arrow_schema(columns, {f"treadlink.{key}": text for key, text in (metadata or {}).items()})
        self._writer = pq.ParquetWriter(self._file, self._schema)

    def rows(self, cells: Mapping[str, Cells]) -> None:
        """Add rows."""
        block = list(cells.values())
        self._blocks.append(block)
        self._buffered_rows += len(block[0])
        if self._buffered_rows >= _ROW_GROUP:
            self._flush()

    def repeat(self, metadata: Mapping[str, str]) -> None:
        """Add to the metadata of the whole table."""
        self._writer.add_key_value_metadata({f"treadlink.{key}": text for key, text in metadata.items()})

    def end(self) -> None:
        """Write what is left and the index."""
        self._flush()
        self._writer.close()

    def _flush(self) -> None:
        import pyarrow as pa

        if not self._blocks:
            return
        columns = [np.concatenate(parts) for parts in zip(*self._blocks, strict=True)]
        self._blocks, self._buffered_rows = [], 0
        arrays = [_arrow_array(column, field.type) for column, field in zip(columns, self._schema, strict=True)]
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))


def _arrow_array(cells: Cells, arrow_type: Any) -> Any:
    """Return cells as an Arrow array of text, booleans, or numbers and times; null where unknown.

    Of its buffers, since `pyarrow.array` imports pandas where it is installed, which takes longer than a second of
    samples does.
    """
    import pyarrow as pa

    is_known = np.array([cell is not None for cell in cells.tolist()]) if cells.dtype.kind == "O" else cells == cells
    validity = None if is_known.all() else pa.py_buffer(np.packbits(is_known, bitorder="little"))
    if pa.types.is_string(arrow_type):
        # Most texts are those of other rows too.
        words = dict.fromkeys(cells.tolist())
        texts = [b"" if word is None else word.encode() for word in words]
        ends = np.cumsum([0, *map(len, texts)], dtype=np.int32)
        dictionary = pa.Array.from_buffers(
            arrow_type, len(texts), [None, pa.py_buffer(ends), pa.py_buffer(b"".join(texts))]
        )
        code_by_word = {word: index for index, word in enumerate(words)}
        codes = np.fromiter(map(code_by_word.__getitem__, cells.tolist()), np.int32, len(cells))
        indices = pa.Array.from_buffers(pa.int32(), len(cells), [validity, pa.py_buffer(codes)])
        return pa.DictionaryArray.from_arrays(indices, dictionary).dictionary_decode()
    if cells.dtype.kind == "M":
        cells = cells.view(np.int64)
    if pa.types.is_boolean(arrow_type):
        values = np.packbits(cells, bitorder="little")
    else:
        values = np.ascontiguousarray(cells, np.float64 if pa.types.is_floating(arrow_type) else np.int64)
    return pa.Array.from_buffers(arrow_type, len(cells), [validity, pa.py_buffer(values)])
