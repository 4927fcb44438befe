"""Parquet with units and descriptions in the fields, and the conditions in the metadata of the file."""

import json
from collections.abc import Sequence
from typing import Any, Final

import numpy as np

from gateway.core.table_columns import Column
from gateway.core.text.table_sinks import arrow_schema, require_pyarrow
from gateway.exporting.export_table import WHEEL, Block, ExportWriter, Target, WheelTable, described, length

# Smaller row groups compress badly.
_GROUP_ROWS: Final = 1 << 16


class ParquetExport(ExportWriter):
    """One table of all wheels in row groups of one wheel; unknown numbers are null."""

    def __init__(self, target: Target) -> None:
        """Take the open file.

        Raises:
            OutputError: pyarrow is missing.
        """
        require_pyarrow()
        self._file = target.file
        self._columns: tuple[Column, ...] = ()
        self._schema: Any = None
        self._writer: Any = None
        self._pending: dict[str, list[Block]] = {}

    def begin(self, tables: Sequence[WheelTable]) -> None:
        """Write the header."""
        import pyarrow.parquet as pq

        self._columns = (WHEEL, *tables[0].columns)
        self._schema = arrow_schema(self._columns, {"treadlink.conditions": json.dumps(described(tables))})
        self._writer = pq.ParquetWriter(self._file, self._schema, compression="zstd")

    def write(self, table: WheelTable, block: Block) -> None:
        """Append rows."""
        pending = self._pending.setdefault(table.wheel, [])
        pending.append(block)
        if sum(map(length, pending)) >= _GROUP_ROWS:
            self._flush(table.wheel)

    def end(self) -> None:
        """Write what is left and the index."""
        for wheel in list(self._pending):
            self._flush(wheel)
        self._writer.close()

    def discard(self) -> None:
        """Close the writer, which would try to finish the file when it is collected."""
        if self._writer is not None:
            self._pending.clear()
            self._writer.close()

    def _flush(self, wheel: str) -> None:
        import pyarrow as pa

        pending = self._pending.pop(wheel, [])
        rows = sum(map(length, pending))
        if not rows:
            return
        arrays = [pa.array([wheel] * rows, pa.string())]
        for column, field in zip(self._columns[1:], list(self._schema)[1:], strict=True):
            values = np.concatenate([block[column.name] for block in pending])
            arrays.append(pa.array(values, field.type, from_pandas=column.kind is float))
        self._writer.write_table(pa.table(arrays, schema=self._schema), row_group_size=rows)
