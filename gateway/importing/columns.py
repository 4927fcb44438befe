"""Columns of a measurement file: the interface of its readers, and blocks of rows."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.nearest_name import nearest
from gateway.core.types import FloatArray

BLOCK_ROWS: Final = 65536
# A matrix with more columns has its channels in rows.
MAX_MATRIX_COLUMNS: Final = 1000
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


@dataclass(frozen=True, slots=True)
class FileFacts:
    """Statements of a file about its columns.

    Attributes:
        names: columns of numbers.
        units: unit of a column, where the file states one.
        unusable: reason and remedy for a column that cannot be imported.
        start_ns: start of the measurement in ns since 1970 (UTC), None where the file has none.
        dates: columns of dates with times, read as seconds from the first; its ns since 1970, None without a time zone.
        time_column: column of the file's own time base, which counts from `start_ns`, None where the file has none.
        further_times: other columns of times that count from `start_ns`.
        conditions: by wheel and name, value and source as text, in a file that treadlink has exported.
        rates_hz: sampling rates that the file states beside its columns, by the name of the attribute or number.
        groups: group that a column belongs to, and its name there, where the file has groups.
        cut: columns that end early: rows that they have, and rows that they should have.
        steps_s: time between two values of a column, where columns have steps of their own.
        starts_s: time of the first value of a column from `start_ns`, where columns have starts of their own.
        warnings: what the package that reads the file has warned of.
        stated: conditions that the file states: key of an import map, its value in TOML, and the place.
    """

    names: Sequence[str]
    units: dict[str, str] = field(default_factory=dict)
    unusable: dict[str, Sequence[str]] = field(default_factory=dict)
    start_ns: int | None = None
    dates: dict[str, int | None] = field(default_factory=dict)
    time_column: str | None = None
    further_times: Sequence[str] = ()
    conditions: dict[str, dict[str, Sequence[str]]] = field(default_factory=dict)
    rates_hz: dict[str, float] = field(default_factory=dict)
    groups: Mapping[str, Sequence[str]] = field(default_factory=dict)
    cut: Mapping[str, Sequence[int]] = field(default_factory=dict)
    steps_s: dict[str, float] = field(default_factory=dict)
    starts_s: dict[str, float] = field(default_factory=dict)
    warnings: Sequence[str] = ()
    stated: Sequence[Sequence[str]] = ()

    def zero_ns(self, name: str | None) -> int | None:
        """Return the time, ns since 1970, at which a column of times is zero, None where the file states none."""
        if name in self.dates:
            return self.dates[name]
        return self.start_ns if name is not None and name in (self.time_column, *self.further_times) else None


class BlockReader(Protocol):
    """A file with named columns, read from the first row to the last."""

    @property
    def facts(self) -> FileFacts:
        """Statements of the file about its columns."""
        ...

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns from the first row on; may be called again.

        Raises:
            ImportDataError: a column is not numeric, or the file is damaged.
            Exception: of a foreign parser, for the latter; `gateway.importing.reader_process` makes it the former.
        """
        ...

    def close(self) -> None:
        """Release the file and what reads it."""
        ...


class ColumnReader(BlockReader, Protocol):
    """A file with named columns, of which a sample can be read."""

    def sample(self, names: Sequence[str]) -> Block | None:
        """Return the first block of the named columns, None without rows.

        Raises:
            ImportDataError: as `blocks`.
        """
        ...


def row_places(first_row: int) -> Callable[[int], str]:
    """Return the names of the rows of a block for messages, counted from 1."""
    return lambda k: f"row {first_row + k + 1}"


def require_equal_lengths(path: Path, lengths: Mapping[str, int]) -> None:
    """Check that columns have the same number of rows.

    Raises:
        ImportDataError: naming all columns with their lengths.
    """
    if len(set(lengths.values())) > 1:
        lengths_text = ", ".join(f"{name} has {length}" for name, length in lengths.items())
        raise ImportDataError(
            f"{path}: the columns differ in length: {lengths_text}", "Resample them to one rate before importing."
        )


def require_columns(reader: BlockReader, path: Path, names: Sequence[str]) -> None:
    """Check that a file has all the named columns.

    Raises:
        ImportDataError: naming every missing column with the most similar one, and the columns of the file.
    """
    facts = reader.facts
    for name in names:
        # The column of a matrix that cannot be used is none of the file.
        base_name = name if name in facts.names else name.rsplit("(:,", 1)[0]
        if base_name in facts.unusable:
            reason, remedy = facts.unusable[base_name]
            raise ImportDataError(f"{path}: '{base_name}' {reason}", remedy)
    present = set(facts.names)
    missing = [name for name in names if name not in present]
    if not missing:
        return
    lines = []
    for name in missing:
        guess = nearest(name, facts.names)
        lines.append(f"{path}: there is no column '{name}'" + (f"; did you mean '{guess}'?" if guess else ""))
    listing = ", ".join(facts.names[:_LISTED_COLUMNS]) + (", ..." if len(facts.names) > _LISTED_COLUMNS else "")
    raise ImportDataError("\n".join(lines), f"Columns of the file: {listing or 'none'}.")


def number_table(path: Path, lines: list[tuple[int, str]], width: int) -> FloatArray:
    """Return the (n, width) numbers of numbered lines.

    Raises:
        ImportDataError: a line has fewer cells, or another than a number.
    """
    rows = [line.split()[:width] for _, line in lines]
    try:
        return np.array([[float(cell) for cell in row] for row in rows], dtype=np.float64).reshape(-1, width)
    except ValueError as error:
        bad = next(
            number for (number, _), row in zip(lines, rows, strict=True) if len(row) < width or not _numbers(row)
        )
        raise ImportDataError(f"{path}: line {bad} is no row of {width} numbers", "Correct or remove it.") from error


def _numbers(row: list[str]) -> bool:
    try:
        [float(cell) for cell in row]
    except ValueError:
        return False
    return True
