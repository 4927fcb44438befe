"""ASAM MDF 4.10: a channel group for every wheel, written by asammdf."""

import datetime
from collections.abc import Sequence
from typing import Any, Final
from xml.sax.saxutils import escape, quoteattr

import numpy as np
from numpy.typing import NDArray

from gateway.core.errors import OutputError
from gateway.core.table_columns import Column
from gateway.core.text.text import escaped
from gateway.exporting.export_table import Block, Condition, ExportWriter, Target, WheelTable

START_NS: Final = "start_ns"
"""Condition with the time of the recording's start, ns since the epoch."""

# Numbers of the standard for the synchronisation of a master channel.
_SYNC_TIME, _SYNC_ANGLE = 1, 2
_FRAGMENT_BYTES: Final = 1 << 20


class MdfExport(ExportWriter):
    """Channels `FL.radial_mps2` over the first column of the table; rows go through a temporary file of asammdf."""

    def __init__(self, target: Target) -> None:
        """Take the open file.

        Raises:
            OutputError: asammdf is missing.
        """
        try:
            import asammdf
        except ImportError as error:
            raise OutputError(
                "MF4 needs the package asammdf", "Install it: pip install 'treadlink[formats]'"
            ) from error
        self._asammdf: Any = asammdf
        self._target = target
        self._mdf: Any = asammdf.MDF(version="4.10", temporary_folder=target.scratch)
        self._mdf.configure(write_fragment_size=_FRAGMENT_BYTES)
        self._groups: dict[str, int] = {}

    def begin(self, tables: Sequence[WheelTable]) -> None:
        """Make the channel groups, empty."""
        for table in tables:
            self._groups[table.wheel] = self._append(table)
            group = self._mdf.groups[self._groups[table.wheel]].channel_group
            group.comment = _comment("CGcomment", escaped(f"{table.what} of wheel {table.wheel}"), table.conditions)
        start = next((entry.value for entry in tables[0].conditions if entry.name == START_NS), None)
        if isinstance(start, int):
            self._mdf.header.start_time = datetime.datetime.fromtimestamp(start * 1e-9, datetime.UTC)
        self._mdf.header.comment = _comment("HDcomment", "treadlink export", tables[0].conditions)

    def write(self, table: WheelTable, block: Block) -> None:
        """Append rows."""
        first, *others = (_stored(column, block[column.name]) for column in table.columns)
        self._mdf.extend(self._groups[table.wheel], [(first, None), *((values, None) for values in others)])

    def end(self) -> None:
        """Write the file."""
        self._mdf.save(self._target.file, compression=1)
        self._mdf.close()

    def discard(self) -> None:
        """Remove the temporary file."""
        self._mdf.close()

    def _append(self, table: WheelTable) -> int:
        axis, *others = table.columns
        sync = _SYNC_ANGLE if axis.unit == "rad" else _SYNC_TIME
        empty = np.zeros(0)
        signals = [
            self._asammdf.Signal(
                _stored(column, empty),
                empty,
                name=f"{table.wheel}.{column.name}",
                unit=column.unit,
                comment=column.description,
                master_metadata=(f"{table.wheel}.{axis.name}", sync),
                encoding="utf-8" if column.kind is str else None,
            )
            for column in others
        ]
        number: int = self._mdf.append(signals, acq_name=table.wheel, common_timebase=True)
        self._mdf.groups[number].channels[0].unit = axis.unit
        return number


def _stored(column: Column, values: NDArray[Any]) -> NDArray[Any]:
    """Return a column as MDF stores it; it has no type for flags, and texts are bytes."""
    if column.kind is str:
        return np.array([str(text).encode() for text in values], "S" if len(values) else "S1")
    if column.kind is bool:
        return values.astype(np.uint8)
    return np.asarray(values, np.float64 if column.kind is float else np.int64)


def _comment(tag: str, text: str, conditions: Sequence[Condition]) -> str:
    """Return the comment of a block, with the conditions as the properties that other programs list."""
    properties = "".join(
        f"<e name={quoteattr(entry.name)} desc={quoteattr(entry.source)} unit={quoteattr(entry.unit)}>"
        f"{escape(str(entry.value))}</e>"
        for entry in conditions
    )
    return f"<{tag}><TX>{escape(text)}</TX><common_properties>{properties}</common_properties></{tag}>"
