"""Columns of numbers out of a file, block by block, so that memory does not grow with the file."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from gateway.config.validation import nearest
from gateway.errors import ImportDataError
from gateway.importing.import_map import SUFFIXES, FileFormat, FileLayout
from gateway.types import FloatArray

BLOCK_ROWS: Final = 65536


@dataclass(frozen=True, slots=True)
class Block:
    """Consecutive rows.

    Attributes:
        first_row: number of the first row, counted from 0.
        values: (n, columns) in the order asked for.
        where: tells the user where a row of this block (0 to n-1) is, as `line 17`.
        progress: share of the file that is read when this block is, 0 to 1.
    """

    first_row: int
    values: FloatArray
    where: Callable[[int], str]
    progress: float


class ColumnReader(Protocol):
    """A file that has named columns."""

    @property
    def names(self) -> tuple[str, ...]:
        """Every column there is."""
        ...

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns from the first row on; may be called again.

        Raises:
            ImportDataError: a column is not numeric, or the file is damaged.
        """
        ...


# format -> "module:class"; the class is called with (path, layout).
READERS: Final[dict[FileFormat, str]] = {
    FileFormat.CSV: "gateway.importing.csv_columns:CsvColumns",
    FileFormat.MAT: "gateway.importing.mat_columns:MatColumns",
    FileFormat.PARQUET: "gateway.importing.parquet_columns:ParquetColumns",
}


def open_columns(path: Path, layout: FileLayout) -> ColumnReader:
    """Open a measurement file by the map's format, or by its suffix.

    Raises:
        ImportDataError: the format is unknown, its package is missing, or the file cannot be read.
    """
    file_format = layout.format or SUFFIXES.get(path.suffix.lower())
    if file_format is None:
        raise ImportDataError(
            f"{path}: the suffix '{path.suffix}' tells no format", 'State it in the map: [file] format = "csv".'
        )
    module_name, class_name = READERS[file_format].split(":")
    try:
        reader: ColumnReader = getattr(importlib.import_module(module_name), class_name)(path, layout)
    except OSError as error:
        reason = error.strerror or str(error)
        raise ImportDataError(f"{path} cannot be read: {reason}", "Check the path and its permissions.") from error
    return reader


def require_columns(reader: ColumnReader, path: Path, names: Sequence[str]) -> None:
    """Check that a file has all the named columns.

    Raises:
        ImportDataError: naming every missing column, the nearest that is there, and all that are there.
    """
    missing = [name for name in names if name not in reader.names]
    if not missing:
        return
    lines = []
    for name in missing:
        guess = nearest(name, reader.names)
        lines.append(f"{path}: there is no column '{name}'" + (f"; did you mean '{guess}'?" if guess else ""))
    shown = ", ".join(reader.names[:40]) + (", ..." if len(reader.names) > 40 else "")
    raise ImportDataError("\n".join(lines), f"Columns there: {shown or 'none'}.")
