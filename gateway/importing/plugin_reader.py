"""Gate between the import and the readers of plug-ins: whatever they raise or return that is wrong is a message."""

import logging
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from gateway.errors import ImportDataError
from gateway.importing.columns import Block, ColumnReader, FileFacts

_logger = logging.getLogger(__name__)


class PluginReader:
    """A reader of a plug-in, whose faults end its own import only; follows `columns.ColumnReader`."""

    def __init__(self, path: Path, open_reader: Callable[[Path], ColumnReader]) -> None:
        """Open a file.

        Raises:
            ImportDataError: the reader fails; also for all other methods.
            OSError: the system refuses.
        """
        self._path = path
        with self._explained():
            self._reader = open_reader(path)

    @property
    def facts(self) -> FileFacts:
        """Statements of the file about its columns."""
        with self._explained():
            facts: object = self._reader.facts
        if not isinstance(facts, FileFacts):
            raise self._wrong(f"facts is {type(facts).__name__}, not FileFacts")
        return facts

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns from the first row on."""
        with self._explained():
            blocks = iter(self._reader.blocks(names))
        while True:
            with self._explained():
                block = next(blocks, None)
            if block is None:
                return
            yield self._checked(block, names)

    def sample(self, names: Sequence[str]) -> Block | None:
        """Return rows that show what the columns are."""
        with self._explained():
            block = self._reader.sample(names)
        return None if block is None else self._checked(block, names)

    def close(self) -> None:
        """Release the file; what fails here has no consequence."""
        with suppress(ImportDataError), self._explained():
            self._reader.close()

    def _checked(self, block: object, names: Sequence[str]) -> Block:
        if not isinstance(block, Block):
            raise self._wrong(f"a block is {type(block).__name__}, not Block")
        values: Any = block.values
        if not isinstance(values, np.ndarray) or values.ndim != 2 or values.shape[1] != len(names):
            raise self._wrong(f"a block has the shape {np.shape(values)}, not (rows, {len(names)})")
        if values.dtype.kind not in "fiu":
            raise self._wrong(f"a block has values of type {values.dtype}, not numbers")
        return replace(block, values=values.astype(np.float64, copy=False))

    @contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except (ImportDataError, OSError):
            raise
        except (Exception, SystemExit) as error:  # code of others may raise anything
            _logger.debug("reader of a plug-in failed", exc_info=error)
            raise self._wrong(f"{type(error).__name__}: {error}") from error

    def _wrong(self, text: str) -> ImportDataError:
        return ImportDataError(f"{self._path} cannot be read: {text}", "Check the file, or update the plug-in.")
