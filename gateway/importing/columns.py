"""Columns of a measurement file: the interface of its readers, and blocks of rows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Protocol

from gateway.config.validation import nearest
from gateway.errors import ImportDataError
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

    def close(self) -> None:
        """Release the file and what reads it."""
        ...


def row_places(first_row: int) -> Callable[[int], str]:
    """Return the names of the rows of a block for messages, counted from 1."""
    return lambda k: f"row {first_row + k + 1}"


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
