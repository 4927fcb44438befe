"""CSV with the conditions, units and descriptions in comment lines before the header."""

import csv
import io
import math
from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.table_columns import Column
from gateway.core.text.table_sinks import harmless
from gateway.core.text.text import escaped
from gateway.exporting.export_table import WHEEL, Block, ExportWriter, Target, WheelTable, length, pieces

_ROWS: Final = 4096


class CsvExport(ExportWriter):
    """RFC 4180 after lines that begin with `#`; unknown values are empty, flags 0 or 1, numbers keep every digit."""

    def __init__(self, target: Target) -> None:
        """Take the open file."""
        self._file = target.file
        self._columns: tuple[Column, ...] = ()

    def begin(self, tables: Sequence[WheelTable]) -> None:
        """Write comments and header."""
        self._columns = (WHEEL, *tables[0].columns)
        text = io.StringIO()
        for table in tables:
            for condition in table.conditions:
                unit = f" {condition.unit}" if condition.unit else ""
                source = f" ({condition.source})" if condition.source else ""
                self._comment(text, f"{table.wheel} {condition.name}: {condition.value}{unit}{source}")
        for column in self._columns:
            unit = f" [{column.unit}]" if column.unit else ""
            self._comment(text, f"column {column.name}{unit}: {column.description}")
        rows = csv.writer(text, lineterminator="\r\n")
        rows.writerow([harmless(column.name) for column in self._columns])
        self._file.write(text.getvalue().encode())

    def write(self, table: WheelTable, block: Block) -> None:
        """Append rows."""
        for piece in pieces(block, _ROWS):
            cells = [[_quoted(table.wheel)] * length(piece)]
            cells += [_cells(column, piece[column.name]) for column in self._columns[1:]]
            lines = map(",".join, zip(*cells, strict=True))
            self._file.write(("\r\n".join(lines) + "\r\n").encode())

    def end(self) -> None:
        """Do nothing: every row is in the file."""

    @staticmethod
    def _comment(text: io.StringIO, line: str) -> None:
        text.write("# " + escaped(" ".join(line.split())) + "\r\n")


def _cells(column: Column, values: NDArray[Any]) -> list[str]:
    if column.kind is str:
        return list(map(_quoted, values))
    if column.kind is float:
        # repr gives the shortest text with the same value
        return ["" if math.isnan(value) else repr(value) for value in values.tolist()]
    return list(map(str, np.asarray(values, np.int64).tolist()))


def _quoted(text: object) -> str:
    """Return a cell that neither ends the line nor begins a comment or a formula."""
    cell = str(harmless(str(text)))
    if any(sign in cell for sign in ',"\r\n#'):
        return '"' + cell.replace('"', '""') + '"'
    return cell
