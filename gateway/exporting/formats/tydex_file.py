"""TYDEX, release 1.3: the tire data exchange format, text with one measuring point a line.

Header, constants and channels stand in fixed columns: key 1 to 10, comment 11 to 40, unit 41 to 50, value or factor
from 51; H.-J. Unrau, J. Zamow: TYDEX-Format, Description and Reference Manual, Release 1.3, 1997.
"""

import datetime
import math
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from gateway import __version__
from gateway.core.errors import OutputError
from gateway.core.table_columns import Column
from gateway.exporting.column_file import ColumnFile
from gateway.exporting.export_table import DTYPES, Block, Cell, ExportWriter, Target, WheelTable

NOT_AVAILABLE: Final = "NOTAVAIL"
"""Cell of an unknown number."""
START_NS: Final = "start_ns"

# Names that the manual defines, by our columns and conditions; others get a key of their own.
_CHANNELS: Final = {
    "time_s": "RUNTIME",
    "revolution": "MEASNUMB",
    "speed_mps": "LONGVEL",
    "omega_radps": "WHROTSPD",
    "load_n": "FZW",
    "pressure_pa": "INFLPRES",
}
_CONSTANTS: Final = {"vehicle": "TESTRIG", "tire_size": "IDENTITY", "load_n": "FZW", "pressure_pa": "INFLPRES"}
_KEY_CHARS, _COMMENT_CHARS, _UNIT_CHARS = 8, 29, 9


class TydexExport(ExportWriter):
    """The table of one wheel, without its columns of text; columns without a single number are left out too."""

    def __init__(self, target: Target) -> None:
        """Take the open file."""
        self._target = target
        self._table: WheelTable | None = None
        self._file: ColumnFile | None = None

    def begin(self, tables: Sequence[WheelTable]) -> None:
        """Open a temporary file.

        Raises:
            OutputError: there are several wheels.
        """
        if len(tables) > 1:
            wheels = ", ".join(table.wheel for table in tables)
            raise OutputError(f"a TYDEX file holds one wheel, not {len(tables)} ({wheels})", "Choose one with --wheel.")
        (self._table,) = tables
        columns = [column for column in self._table.columns if column.kind is not str]
        self._file = ColumnFile(columns, self._target.scratch)

    def write(self, table: WheelTable, block: Block) -> None:  # noqa: ARG002 - there is one table
        """Append rows to the temporary file."""
        assert self._file is not None
        self._file.append(block)

    def end(self) -> None:
        """Write the file."""
        assert self._file is not None
        assert self._table is not None
        measured = [column for column in self._file.columns if _is_known(column, self._file)]
        keys = channel_keys(column.name for column in measured)
        self._write_text(_head(self._table, [column for column in self._table.columns if column not in measured], keys))
        self._write_text(
            _line(keys[column.name], column.description, column.unit or "-", f"{1:<10}{0:<10}{0}")
            for column in measured
        )
        self._write_text(["", "**MEASURDATA"])
        for block in self._file.blocks():
            cells = [_cells(column, block) for column in measured]
            self._write_text(map(" ".join, zip(*cells, strict=True)))
        self._write_text(["", "**END"])
        self.discard()

    def discard(self) -> None:
        """Remove the temporary file."""
        if self._file is not None:
            self._file.close()

    def _write_text(self, lines: Iterator[str] | Sequence[str]) -> None:
        for line in lines:
            self._target.file.write(f"{line}\r\n".encode("ascii", "replace"))


def channel_keys(names: Iterator[str] | Sequence[str]) -> dict[str, str]:
    """Return a distinct key of at most eight capital letters and digits for each column."""
    keys: dict[str, str] = {}
    names = list(names)
    used_keys = {_CHANNELS[name] for name in names if name in _CHANNELS}
    for name in names:
        key = _CHANNELS.get(name, "")
        if not key:
            plain = re.sub(r"[^A-Z0-9]", "", name.upper())
            key, number = plain[:_KEY_CHARS], 1
            while key in used_keys:
                number += 1
                key = f"{plain[: _KEY_CHARS - len(str(number))]}{number}"
            used_keys.add(key)
        keys[name] = key
    return keys


def _is_known(column: Column, file: ColumnFile) -> bool:
    if column.kind is not float:
        return True
    dtype = DTYPES[column.kind].newbyteorder("<")
    return any(bool(np.isfinite(np.frombuffer(data, dtype)).any()) for data in file.stored(column))


def _head(table: WheelTable, left_out: Sequence[Column], keys: Mapping[str, str]) -> Iterator[str]:
    conditions = {entry.name: entry for entry in table.conditions}
    start = conditions.get(START_NS)
    since = start.value * 1e-9 if start is not None and isinstance(start.value, int) else 0.0
    start_time = datetime.datetime.fromtimestamp(since, datetime.UTC)
    recording = conditions.get("recording")
    yield "**HEADER"
    yield _line("RELEASE", "Release of TYDEX-Format", "", "1.3")
    yield _line("MEASID", "Measurement ID", "", "" if recording is None else recording.value)
    yield _line("SUPPLIER", "Data supplier", "", f"treadlink {__version__}")
    yield _line("DATE", "Date", "", f"{start_time:%d.%m.%Y}")
    yield _line("CLCKTIME", "Clocktime (UTC)", "", f"{start_time:%H:%M:%S}")
    yield from ("", "**COMMENTS")
    yield f"{table.what} of wheel {table.wheel}"
    for entry in table.conditions:
        unit = f" {entry.unit}" if entry.unit else ""
        source = f" ({entry.source})" if entry.source else ""
        yield " ".join(f"{entry.name}: {entry.value}{unit}{source}".split())
    for name, key in keys.items():
        yield f"channel {key}: {name}"
    for column in left_out:
        yield f"left out: {column.name}"
    yield from ("", "**CONSTANTS")
    for name, key in _CONSTANTS.items():
        if name in conditions:
            yield _line(key, name.replace("_", " "), conditions[name].unit or "-", conditions[name].value)
    yield from ("", "**MEASURCHANNELS")


def _line(key: str, comment: str, unit: str, value: Cell) -> str:
    """Return a line in the fixed columns of the manual."""
    return f"{key:<10}{comment[:_COMMENT_CHARS]:<30}{unit[:_UNIT_CHARS]:<10}{value}"


def _cells(column: Column, block: Block) -> list[str]:
    values = block[column.name].tolist()
    if column.kind is float:
        return [repr(value) if math.isfinite(value) else NOT_AVAILABLE for value in values]
    return [str(int(value)) for value in values]
