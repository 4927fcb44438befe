"""Reader of numeric columns in Parquet files, run by `gateway.importing.reader_process`; needs the package pyarrow."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from gateway.errors import ImportDataError
from gateway.importing.columns import BLOCK_ROWS, Block, FileFacts, row_places


class ParquetColumns:
    """Parquet file, read block by block."""

    def __init__(self, path: Path) -> None:
        """Read the schema.

        Raises:
            ImportDataError: the file is not Parquet.
            OSError: the file cannot be read.
        """
        import pyarrow as pa
        import pyarrow.parquet as pq

        self._path = path
        if path.stat().st_size == 0:
            raise ImportDataError(f"{path} is empty", "Check the file.")
        try:
            # Buffering ahead would hold every row group of the file in memory.
            self._file = pq.ParquetFile(path, pre_buffer=False)
            self._types = {field.name: field.type for field in self._file.schema_arrow}
        except (pa.ArrowException, OSError, ValueError) as error:
            raise ImportDataError(f"{path} is not a Parquet file: {error}", "Check the file and its format.") from error

    @property
    def facts(self) -> FileFacts:
        """Columns of the schema."""
        return FileFacts(tuple(self._types))

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns; an empty cell is NaN."""
        import pyarrow as pa

        try:
            yield from self._blocks(names)
        except (pa.ArrowException, OSError, ValueError) as error:
            raise ImportDataError(f"{self._path} is damaged: {error}", "Copy or write the file again.") from error

    def close(self) -> None:
        """Close the file."""
        self._file.close()

    def _blocks(self, names: Sequence[str]) -> Iterator[Block]:
        import pyarrow as pa

        for name in names:
            kind = self._types[name]
            if not (pa.types.is_integer(kind) or pa.types.is_floating(kind)):
                raise ImportDataError(
                    f"{self._path}: column '{name}' contains {kind}, not numbers", "Convert it before importing."
                )
        total = max(self._file.metadata.num_rows, 1)
        row = 0
        for batch in self._file.iter_batches(batch_size=BLOCK_ROWS, columns=list(names)):
            # By name: a batch has its columns in the order of the file.
            columns = [batch.column(name).cast(pa.float64()).to_numpy(zero_copy_only=False) for name in names]
            values = np.column_stack(columns)
            yield Block(row, values, row_places(row), min((row + len(values)) / total, 1.0))
            row += len(values)
