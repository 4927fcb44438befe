"""Columns of a CSV or other delimited text file."""

from __future__ import annotations

import csv
import itertools
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TextIO

import numpy as np

from gateway.errors import ImportDataError
from gateway.importing.columns import BLOCK_ROWS, Block
from gateway.importing.import_map import DELIMITERS, FileLayout
from gateway.types import FloatArray


class CsvColumns:
    """Reads delimited text in blocks of lines. Without a header the columns are named 1, 2, 3, ..."""

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
            raise ImportDataError(f"{path} {found}", "Check the file, and skip_rows in the map's [file].")
        cells = [cell.strip() for cell in self._cells(line)]
        self._names = tuple(cells) if layout.header else tuple(str(k + 1) for k in range(len(cells)))

    @property
    def names(self) -> tuple[str, ...]:
        """Columns of the header, or their numbers."""
        return self._names

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns; blank lines are passed over."""
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
                f"{self._path}: the encoding '{self._layout.encoding}' is unknown", 'Try [file] encoding = "latin-1".'
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
                f"{self._path} cannot be read on: {error.strerror}", "Is the disk still there?"
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
        """Look for the first cell that is no number, slowly; the fast parser names no line of the file."""
        for line, number in zip(lines, numbers, strict=True):
            cells = self._cells(line)
            for column, name in zip(use, names, strict=True):
                if column >= len(cells):
                    return ImportDataError(
                        f"{self._path}: line {number} has {len(cells)} cells, column '{name}' is number {column + 1}",
                        "Mend or remove the line; is the file cut off, or the delimiter another one?",
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
        return ImportDataError(f"{self._path}: line {numbers[0]} or one after it cannot be read", "Look at its quotes.")

    def _remedy(self, cell: str) -> str:
        if "," in cell and self._layout.decimal == ".":
            return 'A decimal comma? Then state [file] decimal = "," in the map.'
        if cell.strip() and not cell.strip()[0].isdigit():
            return "A line of units? Then state [file] skip_rows_after_header in the map; else mend the cell."
        return "Mend the cell or remove the line."
