"""Tables of a dataset in few large files: a copy that queries read faster than two files a recording."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from datetime import date
from pathlib import Path
from typing import IO, Any, Final
from urllib.parse import unquote

from gateway.core.errors import OutputError
from gateway.core.text.output_file import OutputFile, check_target, scratch_folder
from gateway.fleet.dataset import DIAGNOSES, read_description
from gateway.fleet.parquet_parts import require_campaign_packages
from gateway.fleet.recording_estimation import RECORDINGS, REVOLUTIONS

TABLES: Final = (RECORDINGS, REVOLUTIONS, DIAGNOSES)
"""Tables that are packed."""

_FILE_BYTES: Final = 100_000_000
# A group of rows is the least that a query reads; so many fit into some 100 MB of memory.
_GROUP_ROWS: Final = 65_536
# Small tables until they become one: each takes some 100 kB besides its rows.
_SMALL_TABLES: Final = 256


@dataclass(frozen=True, slots=True)
class PackedTable:
    """One table as packed.

    Attributes:
        name: of the table.
        files: number of files, each of 100 MB at most but for one group of rows.
        parts: number of files that they hold.
        rows: number of rows.
        size_bytes: of the files.
        unreadable: files of the dataset that are no files of this table, and are left out.
    """

    name: str
    files: int
    parts: int
    rows: int
    size_bytes: int
    unreadable: tuple[Path, ...]


def pack_tables(root: Path, target: Path, on_progress: Callable[[int, int], None]) -> list[PackedTable]:
    """Copy the tables of a dataset into `TABLE-0001.parquet` and so on, with columns `vehicle` and `day` in front.

    Args:
        root: folder of the dataset, which is not changed.
        target: new folder; it appears when it is complete.
        on_progress: called with the number of files that are done, and of all.

    Raises:
        OutputError: `root` is no dataset or has no rows, `target` exists, or the disk refuses.
    """
    require_campaign_packages()
    read_description(root)
    if target.exists():
        raise OutputError(f"'{target}' already exists", "Remove it, or give another name with --out.")
    check_target(target)
    parts = {table: sorted((root / table).glob("*/*/*.parquet")) for table in TABLES}
    total = sum(map(len, parts.values()))
    if not total:
        raise OutputError(
            f"the dataset '{root}' has no recordings", "Add some: treadlink campaign PATH... --out DATASET"
        )
    packed: list[PackedTable] = []
    with scratch_folder(target) as scratch:
        folder = scratch / "tables"
        done = 0

        def count() -> None:
            nonlocal done
            done += 1
            on_progress(done, total)

        try:
            folder.mkdir()
            packed += [_packed(table, paths, folder, count) for table, paths in parts.items() if paths]
            folder.replace(target)
        except OSError as error:
            raise OutputError(
                f"'{target}' cannot be written: {error.strerror or error}", "Free some space, or choose another folder."
            ) from error
    return packed


def _packed(table: str, paths: list[Path], folder: Path, count: Callable[[], None]) -> PackedTable:
    import pyarrow as pa

    files = _Files(table, folder)
    # Rows that have not been written, and those of them that are in small tables still.
    pending: list[Any] = []
    small_tables: list[Any] = []
    pending_rows = 0
    unreadable = []
    try:
        for path, rows in _tables(paths):
            if rows is None or (files.schema is not None and not rows.schema.equals(files.schema)):
                unreadable.append(path)
            else:
                files.schema = files.schema or rows.schema
                small_tables.append(rows)
                pending_rows += rows.num_rows
                if len(small_tables) >= _SMALL_TABLES:
                    pending.append(pa.concat_tables(small_tables).combine_chunks())
                    small_tables = []
                if pending_rows >= _GROUP_ROWS:
                    files.write(pa.concat_tables([*pending, *small_tables]))
                    pending, small_tables, pending_rows = [], [], 0
            count()
        if pending or small_tables:
            files.write(pa.concat_tables([*pending, *small_tables]))
        files.close()
    except BaseException:
        files.discard()
        raise
    return PackedTable(
        table, files.number, len(paths) - len(unreadable), files.rows, files.size_bytes, tuple(unreadable)
    )


class _Files:
    """Files of one table, of which the next begins where one is large."""

    def __init__(self, table: str, folder: Path) -> None:
        self.number = 0
        self.rows = 0
        self.size_bytes = 0
        self.schema: Any = None
        self._table = table
        self._folder = folder
        self._output: OutputFile | None = None
        self._writer: Any = None

    def write(self, rows: Any) -> None:
        """Write one group of rows."""
        if self._output is None:
            self._output = self._next(rows.schema)
        with self._output.explained():
            self._writer.write_table(rows)
        self.rows += rows.num_rows
        if self._output.file.tell() >= _FILE_BYTES:
            self.close()

    def close(self) -> None:
        """Finish the present file."""
        if self._output is not None:
            with self._output.explained():
                self._writer.add_key_value_metadata(self.schema.metadata or {})
                self._writer.close()
                self.size_bytes += self._output.file.tell()
            self._output.close()
            self._output = None

    def discard(self) -> None:
        """Leave the present file."""
        if self._output is not None:
            with suppress(Exception):  # pyarrow would try to finish the file when it is collected
                self._writer.close()
            self._output.discard()

    def _next(self, schema: Any) -> OutputFile:
        self.number += 1
        output = OutputFile(self._folder / f"{self._table}-{self.number:04}.parquet")
        self._writer = _writer(output.file, schema)
        return output


def _writer(file: IO[bytes], schema: Any) -> Any:
    import pyarrow as pa
    import pyarrow.parquet as pq

    text = [field.name for field in schema if pa.types.is_string(field.type)]
    return pq.ParquetWriter(file, schema, compression="zstd", use_dictionary=text, store_schema=False)


def _tables(paths: list[Path]) -> Iterator[tuple[Path, Any]]:
    """Yield each file with its rows, vehicle and day in front; None for one that cannot be read."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    for path in paths:
        vehicle = unquote(path.parent.parent.name.removeprefix("vehicle="))
        try:
            day = date.fromisoformat(path.parent.name.removeprefix("day="))
            with pq.ParquetFile(path) as file:
                rows = file.read()
        except (OSError, ValueError, pa.ArrowException):
            yield path, None
            continue
        count = rows.num_rows
        rows = rows.add_column(0, "vehicle", pa.array([vehicle] * count, pa.string()))
        yield path, rows.add_column(1, "day", pa.array([day] * count, pa.date32()))
