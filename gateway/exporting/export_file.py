"""File of an export, complete under its name or not there at all."""

import importlib
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path

from gateway.exporting.export_registry import FORMATS
from gateway.exporting.export_table import Block, ExportWriter, Target, WheelTable, length
from gateway.views.output_file import OutputFile, WholeOutput, is_stdout, scratch_folder


class ExportFile(WholeOutput):
    """An export file.

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
        self._scratch = ExitStack()
        try:
            # On the same disk, so that a full disk is reported as that of the file.
            scratch = None if direct else str(self._scratch.enter_context(scratch_folder(path)))
            module_name, attribute = FORMATS[name].writer.split(":")
            self._writer: ExportWriter = getattr(importlib.import_module(module_name), attribute)(
                Target(self._output.file, scratch)
            )
        except BaseException:
            self._scratch.close()
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

    def close(self) -> None:
        """Write what stands after the rows, and give the file its name."""
        with self._output.explained():
            self._writer.end()
        self._scratch.close()
        self._output.close()

    def discard(self) -> None:
        """Leave no file."""
        try:
            self._writer.discard()
        finally:
            self._scratch.close()
            self._output.discard()
