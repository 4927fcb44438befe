"""Reader of numeric columns in delimited text, block by block so that memory use stays constant."""

import csv
import itertools
import math
import os
import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple, TextIO

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.columns import BLOCK_ROWS, Block, FileFacts
from gateway.importing.import_map import DELIMITERS, FileLayout
from gateway.importing.iso_times import IsoTimes

_DATE_OR_CLOCK: Final = re.compile(r"\d{4}[-/.]\d{1,2}[-/.]\d{1,2}|\d{1,2}[-/.]\d{1,2}[-/.]\d{4}|\d{1,2}:\d{2}")
PLACEHOLDER: Final = re.compile(r"[-?*#./]+|n/?a|#n/a|null|none|missing|err(or)?", re.IGNORECASE)
# Signs and dashes that spreadsheets and word processors write for a minus.
_OTHER_MINUS: Final = re.compile("[\u2010-\u2015\u2212\ufe63\uff0d]\\s*[.,]?\\d")
_AS_GAP: Final = 'the import keeps the gap. Or state [file] unreadable = "missing" in the map.'
# With a decimal comma, the comma of the cell is a point already.
_THOUSANDS: Final = re.compile(r"[+-]?\d{1,3}(?:(?:[.,' \xa0\u202f]\d{3})+[.,]\d*|(?:[.,' \xa0\u202f]\d{3}){2,})")


class TolerantSample(NamedTuple):
    """First rows of a column, NaN where a cell is no number.

    Attributes:
        block: the rows.
        unreadable: number of cells that are no numbers.
        first: place and text of the first of them.
    """

    block: Block
    unreadable: int
    first: str


class _BadCell(NamedTuple):
    """A cell that is no number.

    Attributes:
        line: its number in the file.
        column: its index among those in use.
        cells: number of cells in the line.
        text: None where the line ends before it.
    """

    line: int
    column: int
    cells: int
    text: str | None

    def __str__(self) -> str:
        if self.text is None:
            return f"line {self.line}: has {self.cells} cells"
        fault = "NUL bytes" if "\0" in self.text else f"'{self.text[:40]}' is not a number"
        return f"line {self.line}: {fault}"


def column_names(cells: Sequence[str]) -> tuple[str, ...]:
    """Return names for the cells of a header, each once: one that is empty or occurs again has its number."""
    names: list[str] = []
    for number, cell in enumerate(map(str.strip, cells), 1):
        name = cell if cell not in names else f"{cell} (column {number})"
        names.append(name or f"column {number}")
    return tuple(names)


class CsvColumns:
    """Reader of delimited text. Without a header the columns are named 1, 2, 3, ...

    Attributes:
        unreadable: number of cells in the current pass that are no numbers, where the layout takes them for missing.
    """

    def __init__(
        self,
        path: Path,
        layout: FileLayout,
        times: IsoTimes | None = None,
        line_start: str = "",
        rows_of: tuple[str, str] | None = None,
    ) -> None:
        """Read the header.

        Args:
            path: the file.
            layout: its layout.
            times: converter of a column of ISO times, None without one.
            line_start: text with which the lines of data begin; others are skipped.
            rows_of: column and its text in the rows to read, None for all rows.

        Raises:
            ImportDataError: the encoding is wrong, the file is empty, or it lacks the column of `rows_of`.
            OSError: the file cannot be read.
        """
        self._path = path
        self._layout = layout
        self._times = times
        self.unreadable = 0
        self._line_start = line_start
        self._delimiter = DELIMITERS[layout.delimiter]
        self._lines_before_data = layout.skip_rows + (1 + layout.skip_rows_after_header if layout.header else 0)
        with self._open() as file:
            line = next(itertools.islice(self._lines(file), layout.skip_rows, None), None)
        if line is None or not line.strip():
            fault = "is empty" if path.stat().st_size == 0 else f"has nothing in line {layout.skip_rows + 1}"
            raise ImportDataError(f"{path} {fault}", "Check the file, and skip_rows in [file] of the map.")
        cells = self._cells(line)
        self._names = column_names(cells) if layout.header else tuple(str(k + 1) for k in range(len(cells)))
        self._rows_of = None
        if rows_of is not None:
            if rows_of[0] not in self._names:
                raise ImportDataError(
                    f"{path}: there is no column '{rows_of[0]}'", f"Columns of the file: {', '.join(self._names)}."
                )
            self._rows_of = self._names.index(rows_of[0]), rows_of[1]

    @property
    def facts(self) -> FileFacts:
        """Columns of the header, or their numbers; the start is known after a first block."""
        dates = {} if self._times is None else {self._times.column: self._times.start_ns}
        return FileFacts(self._names, dates=dates)

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns; blank lines are skipped."""
        use = [self._names.index(name) for name in names]
        size_bytes = max(self._path.stat().st_size, 1)
        row, line_number = 0, self._lines_before_data + 1
        self.unreadable = 0
        if self._times is not None:
            self._times.rewind()
        with self._open() as file:
            source = self._lines(file)
            for _ in itertools.islice(source, self._lines_before_data):
                pass
            while lines := list(itertools.islice(source, BLOCK_ROWS)):
                numbers = list(range(line_number, line_number + len(lines)))
                line_number += len(lines)
                if self._line_start or self._rows_of or any(not line.strip() for line in lines):
                    data_lines = [
                        (line, number)
                        for line, number in zip(lines, numbers, strict=True)
                        if line.strip() and line.startswith(self._line_start) and self._is_row(line)
                    ]
                    lines, numbers = [line for line, _ in data_lines], [number for _, number in data_lines]
                if not lines:
                    continue
                values = self._parsed(lines, numbers, use, names)
                progress = min(os.lseek(file.fileno(), 0, os.SEEK_CUR) / size_bytes, 1.0)
                yield Block(row, values, lambda k, numbers=numbers: f"line {numbers[k]}", progress)  # type: ignore[misc]
                row += len(lines)

    def sample(self, names: Sequence[str]) -> Block | None:
        """Return the first block of the named columns, None without rows."""
        return next(self.blocks(names), None)

    def tolerant_sample(self, name: str) -> TolerantSample | None:
        """Return the first block of a column with its unreadable cells as gaps, None without rows.

        Raises:
            ImportDataError: the encoding is wrong, or reading fails.
        """
        with self._open() as file:
            first = self._lines_before_data
            lines = list(itertools.islice(enumerate(self._lines(file), 1), first, first + BLOCK_ROWS))
        rows = [(number, line) for number, line in lines if line.strip() and self._is_row(line)]
        numbers = [number for number, _ in rows]
        if not numbers:
            return None
        values, bad = self._by_cell([line for _, line in rows], numbers, [self._names.index(name)])
        block = Block(0, values, lambda k: f"line {numbers[k]}", 0.0)
        unreadable = sum(cell.text is None or not PLACEHOLDER.fullmatch(cell.text) for cell in bad)
        return TolerantSample(block, unreadable, str(bad[0]) if bad else "")

    def close(self) -> None:
        """Do nothing: each pass closes the file."""

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
        # A reader for each line costs several times as much.
        if '"' not in line and 1 < len(line) < csv.field_size_limit():
            return line.rstrip("\n").split(self._delimiter)
        try:
            return next(csv.reader([line], delimiter=self._delimiter))
        except csv.Error as error:
            fault = f"a cell has more than {csv.field_size_limit()} characters"
            raise ImportDataError(f"{self._path}: {fault}", "Check the delimiter and the quotation marks.") from error

    def _is_row(self, line: str) -> bool:
        """Return whether a line is of the sensor whose rows are read."""
        if self._rows_of is None:
            return True
        cells = self._cells(line)
        column, text = self._rows_of
        return column < len(cells) and cells[column].strip() == text

    def _parsed(self, lines: list[str], numbers: list[int], use: list[int], names: Sequence[str]) -> FloatArray:
        """Return (n, columns) values, ISO times in seconds."""
        if self._times is None or self._times.column not in names:
            return self._parse(lines, numbers, use, names)
        time_index = list(names).index(self._times.column)
        values = np.empty((len(lines), len(names)))
        others = [k for k in range(len(names)) if k != time_index]
        values[:, others] = self._parse(lines, numbers, [use[k] for k in others], [names[k] for k in others])
        cells = [self._cells(line) for line in lines]
        texts = [row[use[time_index]] if use[time_index] < len(row) else "" for row in cells]
        values[:, time_index] = self._times.seconds(texts, lambda k: f"line {numbers[k]}")
        return values

    def _parse(self, lines: list[str], numbers: list[int], use: list[int], names: Sequence[str]) -> FloatArray:
        if self._layout.decimal == ",":
            lines = [self._with_point(line) for line in lines]
        delimiter = None if self._layout.delimiter == "space" else self._delimiter
        with suppress(ValueError):
            values = np.loadtxt(lines, delimiter=delimiter, usecols=use, ndmin=2, comments=None, quotechar='"')
            if len(values) == len(lines):
                return values
        # The fast parser knows no empty cells, and joins the lines between two quotation marks.
        values, bad = self._by_cell(lines, numbers, use)
        if bad and self._layout.unreadable == "error":
            raise self._refusal(bad[0], use, names)
        self.unreadable += len(bad)
        return values

    def _by_cell(self, lines: list[str], numbers: list[int], use: list[int]) -> tuple[FloatArray, list[_BadCell]]:
        """Return the values, NaN for cells that are empty or no numbers, and the latter."""
        values, bad = np.full((len(lines), len(use)), math.nan), []
        for row, (line, number) in enumerate(zip(lines, numbers, strict=True)):
            cells = self._cells(line)
            for k, column in enumerate(use):
                cell = cells[column].strip() if column < len(cells) else None
                if cell == "":
                    continue
                try:
                    # The fast parser knows no underscores between digits.
                    values[row, k] = float(self._with_point(cell or "?").replace("_", "?"))
                except ValueError:
                    bad.append(_BadCell(number, k, len(cells), cell))
        return values, bad

    def _with_point(self, text: str) -> str:
        return text.replace(",", ".") if self._layout.decimal == "," else text

    def _refusal(self, bad: _BadCell, use: list[int], names: Sequence[str]) -> ImportDataError:
        name = names[bad.column]
        if bad.text is None:
            return ImportDataError(
                f"{self._path}: line {bad.line} has {bad.cells} cells, but column '{name}' is number "
                f"{use[bad.column] + 1}",
                "Check the delimiter in [file] of the map. If the file is cut off there, remove that line.",
            )
        return ImportDataError(
            f"{self._path}: line {bad.line}, column '{name}': '{bad.text}' is not a number",
            self._remedy(bad.text, bad.line),
        )

    def _remedy(self, cell: str, number: int) -> str:
        if _OTHER_MINUS.search(cell):
            return "Write the minus sign as '-' (ASCII 45): another program's sign or dash is no number."
        if _THOUSANDS.fullmatch(cell):
            return "If this is a separator of thousands, write the numbers without it."
        if "," in cell and self._layout.decimal == "." and self._delimiter == ",":
            return "If this is a decimal comma, write the file with decimal points, or with another delimiter."
        if "," in cell and self._layout.decimal == ".":
            return 'If this is a decimal comma, state [file] decimal = "," in the map.'
        if _DATE_OR_CLOCK.match(cell):
            return (
                'If these are dates with times, state [sampling] time_unit = "iso". Else write seconds, or state '
                "rate_hz instead of time_column."
            )
        if PLACEHOLDER.fullmatch(cell):
            return f"If it stands for a missing value, leave the cell empty: {_AS_GAP}"
        if not cell[:1].isdigit() and number > self._lines_before_data + 1:
            return f"If the line is no row of the data, remove it. Else correct the cell, or leave it empty: {_AS_GAP}"
        if not cell[:1].isdigit():
            return "If this is a line of units, state [file] skip_rows_after_header in the map; else correct the cell."
        return f"Correct the cell, or leave it empty: {_AS_GAP}"
