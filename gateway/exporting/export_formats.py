"""Registry of the formats of export files, and the opening of an export."""

from __future__ import annotations

import importlib
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, NamedTuple, Self

from gateway.errors import OutputError
from gateway.exporting.export_table import Block, ExportWriter, Target, WheelTable, length
from gateway.views.output_file import OutputFile, is_stdout


class ExportFormat(NamedTuple):
    """A format.

    Attributes:
        writer: "module:class", called with the target.
        suffixes: of files, from which the format is guessed.
        to_pipe: whether it can be written without going back.
        many_contents: whether a file holds several contents, such as samples and estimates.
        is_text: whether a terminal can show it.
        description: one line.
    """

    writer: str
    suffixes: tuple[str, ...]
    to_pipe: bool
    many_contents: bool
    is_text: bool
    description: str


_ROOM: Final = "gateway.exporting.formats"

FORMATS: Final[dict[str, ExportFormat]] = {
    "csv": ExportFormat(
        f"{_ROOM}.csv_file:CsvExport", (".csv",), True, False, True, "text; conditions and units in # lines"
    ),
    "parquet": ExportFormat(
        f"{_ROOM}.parquet_file:ParquetExport", (".parquet", ".pq"), True, False, False, "pandas, polars, DuckDB, Spark"
    ),
    "mat": ExportFormat(
        f"{_ROOM}.mat_file:MatExport", (".mat",), True, False, False, "MATLAB and Octave; a structure for each wheel"
    ),
    "mf4": ExportFormat(
        f"{_ROOM}.mdf_file:MdfExport", (".mf4", ".mdf"), False, False, False, "ASAM MDF 4.10, for measurement tools"
    ),
    "npz": ExportFormat(f"{_ROOM}.npz_file:NpzExport", (".npz",), True, False, False, "NumPy"),
    "tydex": ExportFormat(
        f"{_ROOM}.tydex_file:TydexExport", (".tdx", ".tydex"), True, False, True, "TYDEX 1.3, numbers of one wheel"
    ),
    "mcap": ExportFormat(
        f"{_ROOM}.mcap_file:McapExport", (".mcap",), True, True, False, "topics for Foxglove and PlotJuggler"
    ),
}


def format_of(path: Path, name: str | None) -> str:
    """Return the format of a file: the given one, else that of its suffix.

    Raises:
        OutputError: neither names one.
    """
    if name is not None:
        return name
    suffix = path.suffix.lower()
    found = next((known for known, entry in FORMATS.items() if suffix in entry.suffixes), None)
    if found is None:
        suffixes = ", ".join(entry.suffixes[0] for entry in FORMATS.values())
        what = "standard output has no suffix" if is_stdout(path) else f"the suffix of '{path}' names no format"
        raise OutputError(
            what, f"Give --format {', '.join(FORMATS)}" + ("." if is_stdout(path) else f", or one of {suffixes}.")
        )
    return found


def check_format(path: Path, name: str, contents: Sequence[str]) -> None:
    """Fail before the work if a file cannot have a format.

    Raises:
        OutputError: a binary format for a terminal, a format that no pipe takes, or too many contents for the format.
    """
    chosen = FORMATS[name]
    direct = is_stdout(path) or (path.exists() and not path.is_file())
    if direct and not chosen.to_pipe:
        raise OutputError(f"{name} cannot be written to a pipe, since it is written out of order", "Give a file.")
    if is_stdout(path) and not chosen.is_text and sys.stdout.isatty():
        raise OutputError(f"{name} is binary and would be written to the terminal", "Give a file, or use a pipe.")
    if len(contents) > 1 and not chosen.many_contents:
        fitting = ", ".join(known for known, entry in FORMATS.items() if entry.many_contents)
        raise OutputError(
            f"a file of format {name} holds one content, not {len(contents)} ({', '.join(contents)})",
            f"Give --what once, or the format {fitting}.",
        )


class Export:
    """An export file: complete under its name, or not there at all.

    As a context manager it commits, and after an error discards.

    Attributes:
        rows: number of rows so far.
    """

    def __init__(self, path: Path, name: str, *, force: bool = False) -> None:
        """Open a file.

        Raises:
            OutputError: as `OutputFile`; or a package that the format needs is missing.
        """
        self.rows = 0
        self._output = OutputFile(path, force=force)
        direct = is_stdout(path) or (path.exists() and not path.is_file())
        # On the same disk, so that a full disk is reported as that of the file.
        scratch = None if direct else str(path.resolve().parent)
        try:
            module_name, attribute = FORMATS[name].writer.split(":")
            self._writer: ExportWriter = getattr(importlib.import_module(module_name), attribute)(
                Target(self._output.file, scratch)
            )
        except BaseException:
            self._output.discard()
            raise

    def begin(self, tables: Sequence[WheelTable]) -> None:
        """Take the tables; as the writer's.

        Raises:
            OutputError: the format cannot hold them, or the disk refuses; the latter also for the other methods.
        """
        with self._output.explained():
            self._writer.begin(tables)

    def write(self, table: WheelTable, block: Block) -> None:
        """Append rows to a table."""
        if not length(block):
            return
        with self._output.explained():
            self._writer.write(table, block)
        self.rows += length(block)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try:
            if kind is None:
                with self._output.explained():
                    self._writer.end()
                self._output.commit()
                return
        except BaseException:
            self._discard()
            raise
        self._discard()

    def _discard(self) -> None:
        try:
            self._writer.discard()
        finally:
            self._output.discard()
