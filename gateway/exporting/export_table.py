"""Tables of an export, and the interface of the writers that put them into files."""

import math
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.table_columns import Column

Cell = str | int | float | bool


DTYPES: Final[dict[type, np.dtype[Any]]] = {
    float: np.dtype(np.float64),
    int: np.dtype(np.int64),
    bool: np.dtype(np.bool_),
    str: np.dtype(object),
}
"""Type of the arrays of a block, by the kind of their column; only real numbers can be unknown, as NaN."""


@dataclass(frozen=True, slots=True)
class Condition:
    """A statement about a whole table: vehicle, sensor, load, version.

    Attributes:
        name: with its SI unit at the end, `belt_radius_m`.
        value: the value.
        unit: symbol in ASCII, empty without one.
        source: where the value comes from, in words.
    """

    name: str
    value: Cell
    unit: str = ""
    source: str = ""


@dataclass(frozen=True, slots=True)
class WheelTable:
    """Table of one wheel.

    Attributes:
        what: content, `samples`.
        wheel: position.
        columns: at least one; the first one is the axis over which the others are plotted, a time or an angle.
        conditions: of this wheel.
    """

    what: str
    wheel: str
    columns: tuple[Column, ...]
    conditions: tuple[Condition, ...] = ()


Block = Mapping[str, NDArray[Any]]
"""Rows of a table: an array of equal length for each column, by its name, of the type in DTYPES."""

WHEEL: Final = Column("wheel", "wheel", str)
"""Column that tells wheels apart in a format with a single table."""


class ExportWriter(ABC):
    """Writer of one format: takes blocks of rows and keeps none of them."""

    @abstractmethod
    def begin(self, tables: Sequence[WheelTable]) -> None:
        """Take the tables, and write what stands before their rows.

        All tables of one content have the same columns; a format of one content gets no other.

        Raises:
            OutputError: the format cannot hold them.
            OSError: the disk refuses; likewise for all methods.
        """

    @abstractmethod
    def write(self, table: WheelTable, block: Block) -> None:
        """Append rows to a table, the same object as given to `begin`."""

    @abstractmethod
    def end(self) -> None:
        """Write what stands after the rows; the file stays open."""

    def discard(self) -> None:  # noqa: B027 - only formats with temporary files have something to remove
        """Remove temporary files after an error."""


@dataclass(frozen=True, slots=True)
class Target:
    """File to write to.

    Attributes:
        file: open for writing; it need not be seekable.
        scratch: folder on the same disk for temporary files, None where the file is a pipe or a device.
    """

    file: IO[bytes]
    scratch: str | None = None


def length(block: Block) -> int:
    """Return the number of rows of a block."""
    return len(next(iter(block.values())))


def pieces(block: Block, rows: int) -> Iterator[Block]:
    """Yield a block in parts of at most `rows` rows."""
    for begin in range(0, length(block), rows):
        yield {name: values[begin : begin + rows] for name, values in block.items()}


def plain(value: object) -> object:
    """Return a condition's value, None for a number that is not finite."""
    return None if isinstance(value, float) and not math.isfinite(value) else value


def described(tables: Sequence[WheelTable]) -> dict[str, dict[str, object]]:
    """Return the conditions of each wheel as plain data: value, unit and source by name."""
    return {
        table.wheel: {
            entry.name: {"value": plain(entry.value), "unit": entry.unit, "source": entry.source}
            for entry in table.conditions
        }
        for table in tables
    }
