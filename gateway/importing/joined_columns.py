"""Several files as one measurement: a logger that begins a new file each minute, or when one is full."""

import contextlib
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

from gateway.core.errors import ImportDataError
from gateway.importing.column_names import unit_of
from gateway.importing.columns import Block, BlockReader, FileFacts, require_columns
from gateway.importing.import_map import ImportMap
from gateway.importing.sensor_groups import require_one_sensor


class JoinedColumns:
    """Columns of files with the same layout, one after the other. One file is open at a time.

    Times go on where files state when they begin: dates with times, and the start in MDF and TDMS files. Other times
    are taken as they are.

    Attributes:
        facts: statements of the first file, with the warnings of all.
        unreadable: number of cells in the current pass that are no numbers, taken for missing values.
    """

    def __init__(self, paths: Sequence[Path], open_file: Callable[[Path], BlockReader], import_map: ImportMap) -> None:
        """Check that all files have the columns, in the same units, and none without times ends early.

        Args:
            paths: the files in the order of time.
            open_file: opens one.
            import_map: meaning of their columns.

        Raises:
            ImportDataError: a file occurs twice, cannot be read, or does not fit the map or the others.
        """
        self._paths, self._open_file = tuple(paths), open_file
        self._time_column = import_map.sampling.time_column
        self.unreadable = 0
        real_paths = [os.path.realpath(path) for path in paths]
        duplicate = next((path for k, path in enumerate(paths) if real_paths[k] in real_paths[:k]), None)
        if duplicate is not None:
            raise ImportDataError(f"{duplicate} is given twice", "Give each file once, in the order of time.")
        facts, names = [], import_map.columns()
        warnings: dict[str, str] = {}
        for path in paths:
            with contextlib.closing(open_file(path)) as reader:
                require_columns(reader, path, names)
                require_one_sensor(path, reader.facts, import_map.wheels())
                facts.append(reader.facts)
            _require_equal_units(path, facts[-1], paths[0], facts[0], names)
            cuts = [
                f"'{name}' has {cut[0]} of {cut[1]} samples" for name, cut in facts[-1].cut.items() if name in names
            ]
            if cuts and self._time_column is None and path != paths[-1]:
                raise ImportDataError(
                    f"{path} is cut: {', '.join(cuts)}; without times the next file would follow at once",
                    "State time_column instead of rate_hz, or import the files before and behind the gap apart.",
                )
            for warning in (*cuts, *facts[-1].warnings):
                warnings.setdefault(warning, f"{path.name}: {warning}")
        self.facts: FileFacts = replace(facts[0], cut={}, warnings=tuple(warnings.values()))

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
                        begin_ns = reader.facts.zero_ns(self._time_column)
                        if number == 0:
                            origin_ns, self.facts = begin_ns, replace(self.facts, dates=reader.facts.dates)
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


def _require_equal_units(
    path: Path, facts: FileFacts, first_path: Path, first_facts: FileFacts, names: Sequence[str]
) -> None:
    """Check that no column is in another unit than in the first file, as far as both state one."""
    for name in names:
        unit, first_unit = (unit_of(name, part.units.get(name, "")) for part in (facts, first_facts))
        if unit and first_unit and unit != first_unit:
            raise ImportDataError(
                f"{path}: '{name}' is in {unit}, in {first_path.name} in {first_unit}",
                "Write the files in the same units, or import each with a map of its own.",
            )


def _where(path: Path, block: Block) -> Callable[[int], str]:
    return lambda k: f"{path.name}, {block.where(k)}"
