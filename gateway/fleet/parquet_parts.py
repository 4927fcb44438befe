"""Parquet files of a dataset: fixed columns, units and descriptions in their metadata, complete or not there."""

import json
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any, Final

from gateway import __version__
from gateway.core.optional_packages import require_packages
from gateway.core.table_columns import CONVENTIONS, Column
from gateway.core.text.output_file import OutputFile, WholeOutput
from gateway.core.text.result_columns import Cells, values_of
from gateway.core.text.table_sinks import Cell, arrow_schema

_ROW_GROUP: Final = 16_384
_COMPRESSION: Final = "zstd"
_SELECTED: Final = ("recording_id", "position", "sensor_id", "host_utc", "start_utc")
FORMAT: Final = "1"


def require_campaign_packages() -> None:
    """Raise OutputError, naming the extra to install, when a package of campaigns is missing."""
    require_packages("a campaign", "campaign", "pyarrow", "psutil")


class PartFile(WholeOutput):
    """One Parquet file, written row by row in constant memory; it appears when it is complete.

    Attributes:
        rows: written so far.
    """

    def __init__(self, path: Path, columns: Mapping[str, Column], table: str, *, many_rows: bool = False) -> None:
        """Open the file.

        Args:
            path: of the file.
            columns: in order.
            table: name of the table, for the metadata.
            many_rows: whether text repeats from row to row.

        Raises:
            OutputError: the file cannot be created.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        self.rows = 0
        self._columns = columns
        self._cells: dict[str, list[Any]] = {name: [] for name in columns}
        self._schema = _schema(columns, table)
        self._output = OutputFile(path, force=True)
        text = [field.name for field in self._schema if pa.types.is_string(field.type)]
        # The footer of a file with hundreds of columns and few rows is larger than its data: no Arrow schema, which
        # repeats Parquet's, and statistics only of what queries select by.
        with self._output.explained():
            self._writer = pq.ParquetWriter(
                self._output.file,
                self._schema,
                compression=_COMPRESSION,
                use_dictionary=text if many_rows else False,
                write_statistics=[name for name in _SELECTED if name in columns],
                store_schema=False,
            )

    def row(self, cells: Mapping[str, Cell]) -> None:
        """Add a row; columns without a cell are null. Times are ns since the epoch.

        Raises:
            OutputError: the disk refuses.
        """
        for name, column in self._cells.items():
            column.append(cells.get(name))
        self._count(1)

    def block(self, columns: Mapping[str, Cells], count: int) -> None:
        """Add rows by column, otherwise as `row`.

        Raises:
            OutputError: the disk refuses.
        """
        for name, column in self._cells.items():
            column.extend(values_of(columns[name]) if name in columns else [None] * count)
        self._count(count)

    def _count(self, count: int) -> None:
        self.rows += count
        if len(next(iter(self._cells.values()))) >= _ROW_GROUP:
            self._flush()

    def close(self) -> None:
        """Write the rest and give the file its name.

        Raises:
            OutputError: the disk refuses; there is no file then.
        """
        with self._output.explained():
            self._flush()
            self._writer.add_key_value_metadata(self._schema.metadata)
            self._writer.close()
        self._output.close()

    def discard(self) -> None:
        """Leave no file."""
        with suppress(Exception):  # pyarrow would try to finish the file when it is collected
            self._writer.close()
        self._output.discard()

    def _flush(self) -> None:
        import pyarrow as pa

        arrays = {name: pa.array(cells, self._schema.field(name).type) for name, cells in self._cells.items()}
        if next(iter(self._cells.values())):
            with self._output.explained():
                self._writer.write_table(pa.table(arrays, schema=self._schema))
        self._cells = {name: [] for name in self._columns}


def read_rows(path: Path, names: Collection[str], needed: Collection[str] | None = None) -> list[dict[str, Any]] | None:
    """Return rows of a file with those of the columns that it has; times are ns since the epoch.

    Args:
        path: of the file.
        names: of the columns.
        needed: columns without which it is another file; None for all.

    Returns:
        the rows, or None where the file cannot be read or is another one.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        with pq.ParquetFile(path) as file:
            present = set(file.schema_arrow.names)
            if not present.issuperset(names if needed is None else needed):
                return None
            table = file.read([name for name in names if name in present])
        for index, field in enumerate(table.schema):
            if pa.types.is_timestamp(field.type):
                table = table.set_column(index, field.name, table.column(index).cast(pa.int64()))
        rows: list[dict[str, Any]] = table.to_pylist()
    except (OSError, ValueError, KeyError, pa.ArrowException):
        return None
    return rows


def _schema(columns: Mapping[str, Column], table: str) -> Any:
    """Return the Arrow schema; the file's metadata have the units of all columns as one JSON object."""
    units = {name: column.unit for name, column in columns.items() if column.unit}
    metadata = {
        "treadlink": __version__,
        "treadlink.dataset": FORMAT,
        "treadlink.table": table,
        "treadlink.time_zone": "UTC",
        "treadlink.units": json.dumps(units, ensure_ascii=False),
        **{f"treadlink.{key}": text for key, text in CONVENTIONS.items()},
    }
    return arrow_schema(columns.values(), metadata, is_brief=True)
