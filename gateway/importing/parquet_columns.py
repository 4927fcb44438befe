"""Reader of numeric columns in Parquet files, run by `gateway.importing.reader_process`; needs the package pyarrow."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.columns import BLOCK_ROWS, Block, FileFacts, row_places


class ParquetColumns:
    """Parquet file, read block by block."""

    def __init__(self, path: Path) -> None:
        """Read the schema.

        Raises:
            Exception: of pyarrow, where the file is not Parquet or damaged.
        """
        import pyarrow.parquet as pq

        self._path = path
        # Buffering ahead would hold every row group of the file in memory.
        self._file = pq.ParquetFile(path, pre_buffer=False, page_checksum_verification=True)
        self._types = {field.name: field.type for field in self._file.schema_arrow}
        self._begins_ns = {name: self._begin_ns(name) for name in self._types if self._is_date(name)}

    @property
    def facts(self) -> FileFacts:
        """Columns of the schema."""
        dates = {name: begin_ns if self._types[name].tz else None for name, begin_ns in self._begins_ns.items()}
        durations = {name: "s" for name, kind in self._types.items() if _is_span(kind)}
        return FileFacts(tuple(self._types), dates=dates, units=durations)

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns; an empty cell is NaN."""
        import pyarrow as pa

        for name in names:
            kind = self._types[name]
            types = (pa.types.is_integer, pa.types.is_floating, pa.types.is_boolean, pa.types.is_decimal)
            numbers = any(is_type(kind) for is_type in types)
            if not (numbers or self._is_date(name) or _is_span(kind) or self._is_list(name)):
                raise ImportDataError(
                    f"{self._path}: column '{name}' contains {kind}, not numbers", "Convert it before importing."
                )
        total = max(self._file.metadata.num_rows, 1)
        row = 0
        for batch in self._file.iter_batches(batch_size=BLOCK_ROWS, columns=list(names)):
            # By name: a batch has its columns in the order of the file.
            values = self._rows(names, batch)
            yield Block(row, values, row_places(row), min((row + len(values)) / total, 1.0))
            row += len(values)

    def _rows(self, names: Sequence[str], batch: Any) -> FloatArray:
        """Return the (n, columns) values of a batch; lists are blocks of samples, a number beside them is their first.

        Raises:
            ImportDataError: the lists of a row differ in length.
        """
        lists = {name: batch.column(name) for name in names if self._is_list(name)}
        if not lists:
            return np.column_stack([self._values(name, batch.column(name)) for name in names])
        lengths = {name: np.asarray(column.value_lengths().fill_null(0)) for name, column in lists.items()}
        first_name, counts = next(iter(lengths.items()))
        for name, sizes in lengths.items():
            if not np.array_equal(sizes, counts):
                row = int(np.flatnonzero(sizes != counts)[0])
                raise ImportDataError(
                    f"{self._path}: a list of '{name}' has {sizes[row]} values, of '{first_name}' {counts[row]}",
                    "Leave one out of the map.",
                )
        ends = np.cumsum(counts)
        columns = []
        for name in names:
            if name in lists:
                columns.append(self._values(name, lists[name].flatten()))
                continue
            column = np.full(int(ends[-1]) if len(ends) else 0, np.nan)
            filled = counts > 0
            column[(ends - counts)[filled]] = self._values(name, batch.column(name))[filled]
            columns.append(column)
        return np.column_stack(columns)

    def _is_list(self, name: str) -> bool:
        import pyarrow as pa

        kind = self._types[name]
        is_list = pa.types.is_list(kind) or pa.types.is_large_list(kind) or pa.types.is_fixed_size_list(kind)
        value = kind.value_type if is_list else None
        return is_list and bool(pa.types.is_integer(value) or pa.types.is_floating(value))

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _values(self, name: str, column: Any) -> FloatArray:
        import pyarrow as pa

        if name in self._begins_ns:
            times_ns = column.cast(pa.timestamp("ns")).cast(pa.int64())
            seconds = np.full(len(column), np.nan)
            valid = np.asarray(times_ns.is_valid())
            # In integers: a double of the seconds since 1970 is 0.2 us coarse.
            seconds[valid] = (times_ns.drop_null().to_numpy(zero_copy_only=False) - self._begins_ns[name]) * 1e-9
            return seconds
        if _is_span(column.type):
            kind = pa.duration("ns") if pa.types.is_duration(column.type) else pa.time64("ns")
            seconds_ns = column.cast(kind).cast(pa.int64()).cast(pa.float64(), safe=False)
            durations: FloatArray = seconds_ns.to_numpy(zero_copy_only=False) * 1e-9
            return durations
        if pa.types.is_boolean(column.type):
            column = column.cast(pa.int8())
        values: FloatArray = column.cast(pa.float64(), safe=False).to_numpy(zero_copy_only=False)
        return values

    def _is_date(self, name: str) -> bool:
        import pyarrow as pa

        return bool(pa.types.is_timestamp(self._types[name]))

    def _begin_ns(self, name: str) -> int:
        """Return the first time of a column of dates, 0 where it has none."""
        import pyarrow as pa

        for batch in self._file.iter_batches(batch_size=BLOCK_ROWS, columns=[name]):
            if len(times := batch.column(name).drop_null()):
                return int(times[:1].cast(pa.timestamp("ns")).cast(pa.int64())[0].as_py())
        return 0


def _is_span(kind: Any) -> bool:
    """Return whether values are durations, or times of day as those from midnight."""
    import pyarrow as pa

    return bool(pa.types.is_duration(kind) or pa.types.is_time(kind))
