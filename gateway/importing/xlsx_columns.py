"""Reader of numeric columns in workbooks of spreadsheets; needs the package openpyxl."""

import itertools
from collections.abc import Iterable, Iterator, Sequence
from datetime import UTC, datetime, time, timedelta
from pathlib import Path
from typing import Any, Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.storable_text import storable
from gateway.importing.column_names import are_units, rate_of
from gateway.importing.csv_columns import column_names
from gateway.importing.waveform_columns import Waveform, WaveformColumns

_HEADER_ROWS: Final = 200
# A row of data consists of numbers for the larger part; a line such as `rate | 9600` does not.
_NUMBER_SHARE: Final = 0.5


class XlsxColumns(WaveformColumns):
    """Workbook, loaded as a whole. Columns are `sheet/name` by the row above the first two rows of numbers."""

    def __init__(self, path: Path) -> None:
        """Read all sheets.

        Raises:
            ImportDataError: no sheet has rows of numbers.
            Exception: of openpyxl, where the file is damaged.
        """
        import openpyxl

        super().__init__(path)
        with path.open("rb") as file:
            for sheet in openpyxl.load_workbook(file, read_only=True, data_only=True).worksheets:
                # Programs state the wrong number of rows.
                sheet.reset_dimensions()
                self._read_sheet(storable(sheet.title), sheet.iter_rows(values_only=True))
        if not self.waveforms:
            raise ImportDataError(
                f"{path} has no sheet with rows of numbers",
                "Formulas have values only after a spreadsheet program has saved the file.",
            )

    def _read_sheet(self, sheet: str, rows: Iterator[Sequence[Any]]) -> None:
        head_rows: list[Sequence[Any]] = []
        for row in rows:
            head_rows.append(row)
            if len(head_rows) > 1 and all(map(_are_data, head_rows[-2:])):
                break
            if len(head_rows) > _HEADER_ROWS:
                return
        else:
            return
        first, second = head_rows.pop(-2), head_rows.pop()
        self._note_rates(sheet, head_rows)
        texts = [["" if cell is None else str(cell).strip() for cell in cells] for cells in head_rows]
        units = texts.pop() if len(texts) > 1 and are_units(texts[-1]) else []
        width = max(len(first), len(second))
        names = column_names([*(texts[-1] if texts else []), *[""] * width][:width])
        columns = self._columns(sheet, len(names), len(head_rows) + 1, itertools.chain((first, second), rows))
        for k, (name, values) in enumerate(zip(names, columns, strict=True)):
            array = np.array(values)
            column = f"{sheet}/{storable(name)}"
            if np.isfinite(array).any():
                self.waveforms[column] = Waveform.of(array, units[k] if k < len(units) else "", sheet, name)
            elif texts and k < len(texts[-1]) and texts[-1][k]:
                self.unusable[column] = ("has no numbers", "Formulas need to be saved with values.")

    def _columns(self, sheet: str, width: int, first_number: int, rows: Iterable[Sequence[Any]]) -> list[list[float]]:
        """Return the numbers of each column, NaN for other cells, which are told."""
        columns: list[list[float]] = [[] for _ in range(width)]
        first, skipped = "", 0
        for number, row in enumerate(rows, first_number):
            if all(cell is None for cell in row):
                continue
            for k, values in enumerate(columns):
                cell = row[k] if k < len(row) else None
                value = _number(cell)
                values.append(np.nan if value is None else value)
                if value is None and cell is not None:
                    skipped += 1
                    first = first or f"row {number}, '{str(cell)[:40]}'"
        if skipped:
            self.warnings.append(f"sheet {sheet}: {skipped} cells are no numbers and left empty, the first is {first}")
        return columns

    def _note_rates(self, sheet: str, head_rows: Sequence[Sequence[Any]]) -> None:
        for number, cells in enumerate(head_rows, 1):
            filled = [cell for cell in cells if cell is not None]
            rate_hz = rate_of(str(filled[0]), filled[1]) if len(filled) > 1 else None
            if rate_hz is not None:
                self.rates_hz[f"{sheet}, row {number}"] = rate_hz


def _are_data(row: Sequence[Any]) -> bool:
    filled = [cell for cell in row if cell is not None]
    return sum(_number(cell) is not None for cell in filled) > _NUMBER_SHARE * len(filled)


def _number(cell: object) -> float | None:
    """Return the number of a cell, a date with a time as seconds since 1970; None where it is none."""
    if isinstance(cell, datetime):
        return (cell if cell.tzinfo else cell.replace(tzinfo=UTC)).timestamp()
    if isinstance(cell, time):
        return cell.hour * 3600.0 + cell.minute * 60.0 + cell.second + cell.microsecond * 1e-6
    if isinstance(cell, timedelta):
        return cell.total_seconds()
    return float(cell) if isinstance(cell, int | float) else None
