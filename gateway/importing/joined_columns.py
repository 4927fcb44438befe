"""Several files as one measurement: a logger that begins a new file each minute, or when one is full."""

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from gateway.core.errors import ImportDataError
from gateway.importing.columns import Block, BlockReader, FileFacts, require_columns


class JoinedColumns:
    """Columns of files with the same layout, one after the other. One file is open at a time.

    Times go on where files state when they begin: dates with times, and the start in MDF and TDMS files. Other times
    are taken as they are.

    Attributes:
        facts: statements of the first file.
        unreadable: number of cells in the current pass that are no numbers, taken for missing values.
    """

    def __init__(
        self,
        paths: Sequence[Path],
        open_file: Callable[[Path], BlockReader],
        names: Sequence[str],
        time_column: str | None,
    ) -> None:
        """Check that all files have the columns.

        Args:
            paths: the files in the order of time.
            open_file: opens one.
            names: columns that the map names.
            time_column: that of the times, None without one.

        Raises:
            ImportDataError: a file occurs twice, cannot be read or lacks a column.
        """
        self._paths, self._open_file, self._time_column = tuple(paths), open_file, time_column
        self.unreadable = 0
        real_paths = [os.path.realpath(path) for path in paths]
        duplicate = next((path for k, path in enumerate(paths) if real_paths[k] in real_paths[:k]), None)
        if duplicate is not None:
            raise ImportDataError(f"{duplicate} is given twice", "Give each file once, in the order of time.")
        facts = []
        for path in paths:
            with contextlib.closing(open_file(path)) as reader:
                require_columns(reader, path, names)
                facts.append(reader.facts)
        self.facts: FileFacts = facts[0]

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns of all files.

        Raises:
            ImportDataError: as the readers.
        """
        self.unreadable = 0
        row, origin_ns = 0, None
        time_index = names.index(self._time_column) if self._time_column in names else None
        for number, path in enumerate(self._paths):
            unreadable_before, first_row, shift_s = self.unreadable, row, 0.0
            with contextlib.closing(self._open_file(path)) as reader:
                for block in reader.blocks(names):
                    if row == first_row:
                        # A text file tells its first date with its first rows.
                        begin_ns = _begin_ns(reader.facts, self._time_column)
                        if number == 0:
                            origin_ns, self.facts = begin_ns, reader.facts
                        elif begin_ns is not None and origin_ns is not None:
                            shift_s = (begin_ns - origin_ns) * 1e-9
                    values = block.values
                    if time_index is not None and shift_s:
                        values = values.copy()
                        values[:, time_index] += shift_s
                    progress = (number + block.progress) / len(self._paths)
                    yield Block(row, values, _where(path, block), progress)
                    row += len(values)
                    self.unreadable = unreadable_before + getattr(reader, "unreadable", 0)

    def close(self) -> None:
        """Do nothing: each pass closes the files."""


def _begin_ns(facts: FileFacts, time_column: str | None) -> int | None:
    """Return the time, ns since 1970, at which the time column of a file is zero, None where it states none."""
    if time_column in facts.dates:
        return facts.dates[time_column]
    return facts.start_ns if time_column is not None and time_column == facts.time_column else None


def _where(path: Path, block: Block) -> Callable[[int], str]:
    return lambda k: f"{path.name}, {block.where(k)}"
