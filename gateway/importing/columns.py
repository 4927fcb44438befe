"""Readers of numeric columns in CSV, MATLAB and Parquet files, block by block so that memory use stays constant."""

from __future__ import annotations

import csv
import itertools
import os
import zlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Protocol, TextIO

import numpy as np
from numpy.typing import NDArray

from gateway.config.validation import nearest
from gateway.errors import ImportDataError
from gateway.importing.import_map import DELIMITERS, SUFFIXES, FileFormat, FileLayout
from gateway.types import FloatArray

BLOCK_ROWS: Final = 65536
_LISTED_COLUMNS: Final = 40


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive rows.

    Attributes:
        first_row: number of the first row, counted from 0.
        values: (n, columns), in the order of the requested names.
        where: returns the place of a row of this block (0 to n-1) for messages, such as `line 17`.
        progress: share of the file read so far, 0 to 1.
    """

    first_row: int
    values: FloatArray
    where: Callable[[int], str]
    progress: float


class ColumnReader(Protocol):
    """A file with named columns."""

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all columns."""
        ...

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns from the first row on; may be called again.

        Raises:
            ImportDataError: a column is not numeric, or the file is damaged.
        """
        ...


def open_columns(path: Path, layout: FileLayout) -> ColumnReader:
    """Open a measurement file in the format stated by the map, or else given by the suffix.

    Raises:
        ImportDataError: the format is unknown, its package is missing, or the file cannot be read.
    """
    file_format = layout.format or SUFFIXES.get(path.suffix.lower())
    if file_format is None:
        raise ImportDataError(
            f"{path}: unknown file format '{path.suffix}'", 'State the format in the map: [file] format = "csv".'
        )
    try:
        return _READERS[file_format](path, layout)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ImportDataError(f"{path} cannot be read: {reason}", "Check the path and its permissions.") from error


def require_columns(reader: ColumnReader, path: Path, names: Sequence[str]) -> None:
    """Check that a file has all the named columns.

    Raises:
        ImportDataError: naming every missing column with the most similar one, and the columns of the file.
    """
    missing = [name for name in names if name not in reader.names]
    if not missing:
        return
    lines = []
    for name in missing:
        guess = nearest(name, reader.names)
        lines.append(f"{path}: there is no column '{name}'" + (f"; did you mean '{guess}'?" if guess else ""))
    shown = ", ".join(reader.names[:_LISTED_COLUMNS]) + (", ..." if len(reader.names) > _LISTED_COLUMNS else "")
    raise ImportDataError("\n".join(lines), f"Columns of the file: {shown or 'none'}.")


class CsvColumns:
    """Reader of delimited text. Without a header the columns are named 1, 2, 3, ..."""

    def __init__(self, path: Path, layout: FileLayout) -> None:
        """Read the header.

        Raises:
            ImportDataError: the encoding is wrong or the file is empty.
            OSError: the file cannot be read.
        """
        self._path = path
        self._layout = layout
        self._delimiter = DELIMITERS[layout.delimiter]
        self._lines_before_data = layout.skip_rows + (1 + layout.skip_rows_after_header if layout.header else 0)
        with self._open() as file:
            line = next(itertools.islice(self._lines(file), layout.skip_rows, None), None)
        if line is None or not line.strip():
            found = "is empty" if path.stat().st_size == 0 else f"has nothing in line {layout.skip_rows + 1}"
            raise ImportDataError(f"{path} {found}", "Check the file, and skip_rows in [file] of the map.")
        cells = [cell.strip() for cell in self._cells(line)]
        self._names = tuple(cells) if layout.header else tuple(str(k + 1) for k in range(len(cells)))

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the header, or their numbers."""
        return self._names

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns; blank lines are skipped."""
        use = [self._names.index(name) for name in names]
        size_bytes = max(self._path.stat().st_size, 1)
        row, line_number = 0, self._lines_before_data + 1
        with self._open() as file:
            source = self._lines(file)
            for _ in itertools.islice(source, self._lines_before_data):
                pass
            while lines := list(itertools.islice(source, BLOCK_ROWS)):
                numbers = list(range(line_number, line_number + len(lines)))
                line_number += len(lines)
                if any(not line.strip() for line in lines):
                    kept = [(line, number) for line, number in zip(lines, numbers, strict=True) if line.strip()]
                    lines, numbers = [line for line, _ in kept], [number for _, number in kept]
                if not lines:
                    continue
                values = self._parse(lines, numbers, use, names)
                progress = min(os.lseek(file.fileno(), 0, os.SEEK_CUR) / size_bytes, 1.0)
                yield Block(row, values, lambda k, numbers=numbers: f"line {numbers[k]}", progress)  # type: ignore[misc]
                row += len(lines)

    def _open(self) -> TextIO:
        encoding = "utf-8-sig" if self._layout.encoding.lower().replace("_", "-") in ("utf-8", "utf8") else None
        try:
            return self._path.open(encoding=encoding or self._layout.encoding, newline=None)
        except LookupError as error:
            raise ImportDataError(
                f"{self._path}: unknown encoding '{self._layout.encoding}'", 'Try [file] encoding = "latin-1".'
            ) from error

    def _lines(self, file: TextIO) -> Iterator[str]:
        try:
            yield from file
        except UnicodeDecodeError as error:
            raise ImportDataError(
                f"{self._path}: the text is not {self._layout.encoding}", 'Try [file] encoding = "latin-1" in the map.'
            ) from error
        except OSError as error:
            raise ImportDataError(
                f"{self._path}: reading failed: {error.strerror}", "Check that the disk is still connected."
            ) from error

    def _cells(self, line: str) -> list[str]:
        if self._layout.delimiter == "space":
            return line.split()
        return next(csv.reader([line], delimiter=self._delimiter))

    def _parse(self, lines: list[str], numbers: list[int], use: list[int], names: Sequence[str]) -> FloatArray:
        if self._layout.decimal == ",":
            lines = [line.replace(",", ".") for line in lines]
        delimiter = None if self._layout.delimiter == "space" else self._delimiter
        try:
            return np.loadtxt(lines, delimiter=delimiter, usecols=use, ndmin=2, comments=None, quotechar='"')
        except ValueError as error:
            raise self._bad_cell(lines, numbers, use, names) from error

    def _bad_cell(self, lines: list[str], numbers: list[int], use: list[int], names: Sequence[str]) -> ImportDataError:
        """Find the first cell that is not a number. This is slow, but the fast parser reports no line of the file."""
        for line, number in zip(lines, numbers, strict=True):
            cells = self._cells(line)
            for column, name in zip(use, names, strict=True):
                if column >= len(cells):
                    return ImportDataError(
                        f"{self._path}: line {number} has {len(cells)} cells, but column '{name}' is number "
                        f"{column + 1}",
                        "Correct or remove the line, or check the delimiter. Is the file cut off?",
                    )
                try:
                    float(cells[column])
                except ValueError:
                    found = (
                        f"'{cells[column].strip()}' is not a number" if cells[column].strip() else "the cell is empty"
                    )
                    return ImportDataError(
                        f"{self._path}: line {number}, column '{name}': {found}", self._remedy(cells[column])
                    )
        return ImportDataError(f"{self._path}: the lines from {numbers[0]} on cannot be read", "Check their quotes.")

    def _remedy(self, cell: str) -> str:
        if "," in cell and self._layout.decimal == ".":
            return 'If this is a decimal comma, state [file] decimal = "," in the map.'
        if cell.strip() and not cell.strip()[0].isdigit():
            return "If this is a line of units, state [file] skip_rows_after_header in the map; else correct the cell."
        return "Correct the cell or remove the line."


class MatColumns:
    """Reader of MATLAB files up to version 7.2; the whole file must fit into memory.

    Columns are vectors `x`, columns of matrices `data(:,2)`, and both inside structs `run.acc(:,2)`.
    """

    def __init__(self, path: Path, layout: FileLayout) -> None:  # noqa: ARG002 - the readers' common signature
        """Load the file.

        Raises:
            ImportDataError: it is not a readable MATLAB file, or contains no numbers.
            OSError: the file cannot be read.
        """
        from scipy.io import loadmat
        from scipy.io.matlab import MatReadError

        with path.open("rb") as file:
            start = file.read(128)
        self._path = path
        if not start:
            raise ImportDataError(f"{path} is empty", "Check the file.")
        if b"MATLAB 7.3" in start or start.startswith(b"\x89HDF"):
            raise ImportDataError(
                f"{path} is a MATLAB 7.3 (HDF5) file, which is not supported", "Save it with save('file.mat', '-v7')."
            )
        try:
            content = loadmat(str(path), squeeze_me=True, struct_as_record=False)
        except (MatReadError, ValueError, TypeError, NotImplementedError, IndexError, OSError, zlib.error) as error:
            raise ImportDataError(f"{path} is not a readable MATLAB file: {error}", "Save it again.") from error
        self._columns: dict[str, NDArray[Any]] = {}
        for name, value in content.items():
            if not name.startswith("__"):
                self._add(name, value)

    @property
    def names(self) -> tuple[str, ...]:
        """Every numeric vector and matrix column."""
        return tuple(self._columns)

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns, which must have equal lengths."""
        columns = [self._columns[name] for name in names]
        lengths = {name: len(column) for name, column in zip(names, columns, strict=True)}
        if len(set(lengths.values())) > 1:
            found = ", ".join(f"{name} has {length}" for name, length in lengths.items())
            raise ImportDataError(
                f"{self._path}: the columns differ in length: {found}", "Resample them to one rate before importing."
            )
        count = len(columns[0]) if columns else 0
        for first in range(0, count, BLOCK_ROWS):
            values = np.column_stack([column[first : first + BLOCK_ROWS] for column in columns]).astype(np.float64)
            yield Block(
                first,
                values,
                lambda k, first=first: f"row {first + k + 1}",  # type: ignore[misc]
                min(first + BLOCK_ROWS, count) / count,
            )

    def _add(self, name: str, value: object) -> None:
        fields = getattr(value, "_fieldnames", None)
        if fields is not None:
            for field in fields:
                self._add(f"{name}.{field}", getattr(value, field))
        elif isinstance(value, np.ndarray) and value.dtype.kind in "iuf":
            if value.ndim == 1:
                self._columns[name] = value
            elif value.ndim == 2:
                self._columns.update({f"{name}(:,{k + 1})": value[:, k] for k in range(value.shape[1])})


class ParquetColumns:
    """Reader of Parquet files; needs the optional package pyarrow."""

    def __init__(self, path: Path, layout: FileLayout) -> None:  # noqa: ARG002 - the readers' common signature
        """Read the schema.

        Raises:
            ImportDataError: pyarrow is missing, or the file is not Parquet.
            OSError: the file cannot be read.
        """
        try:
            import pyarrow as pa
            import pyarrow.parquet as pq
        except ImportError as error:
            raise ImportDataError(
                f"{path}: Parquet files need the package pyarrow", "Run: pip install 'treadlink[parquet]'"
            ) from error
        self._path = path
        if path.stat().st_size == 0:
            raise ImportDataError(f"{path} is empty", "Check the file.")
        try:
            # Buffering ahead would hold every row group of the file in memory.
            self._file = pq.ParquetFile(path, pre_buffer=False)
        except pa.ArrowInvalid as error:
            raise ImportDataError(f"{path} is not a Parquet file: {error}", "Check the file and its format.") from error
        self._types = {field.name: field.type for field in self._file.schema_arrow}

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the schema."""
        return tuple(self._types)

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns; an empty cell is NaN."""
        import pyarrow as pa

        try:
            yield from self._blocks(names)
        except (pa.ArrowException, OSError) as error:
            raise ImportDataError(f"{self._path} is damaged: {error}", "Copy or write the file again.") from error

    def _blocks(self, names: Sequence[str]) -> Iterator[Block]:
        import pyarrow as pa

        for name in names:
            kind = self._types[name]
            if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
                raise ImportDataError(
                    f"{self._path}: column '{name}' contains {kind}, not numbers", "Convert it before importing."
                )
        total = max(self._file.metadata.num_rows, 1)
        row = 0
        for batch in self._file.iter_batches(batch_size=BLOCK_ROWS, columns=list(names)):
            # By name: a batch has its columns in the order of the file.
            columns = [batch.column(name).cast(pa.float64()).to_numpy(zero_copy_only=False) for name in names]
            values = np.column_stack(columns)
            yield Block(
                row,
                values,
                lambda k, row=row: f"row {row + k + 1}",  # type: ignore[misc]
                min((row + len(values)) / total, 1.0),
            )
            row += len(values)


_READERS: Final[dict[FileFormat, Callable[[Path, FileLayout], ColumnReader]]] = {
    FileFormat.CSV: CsvColumns,
    FileFormat.MAT: MatColumns,
    FileFormat.PARQUET: ParquetColumns,
}
