"""Importer of the files of a logger: the letters ACC1, rate in Hz and number of channels, then counts of 32 bit."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.importing.columns import BLOCK_ROWS, Block, FileFacts, row_places

_HEADER = struct.Struct("<4sII")
_MAGIC = b"ACC1"


class CountColumns:
    """Channels in counts, with a column of times; follows `gateway.importing.columns.ColumnReader`."""

    def __init__(self, path: Path) -> None:
        """Read the header.

        Raises:
            ImportDataError: it is no file of this logger.
        """
        header = path.read_bytes()[: _HEADER.size]
        magic, rate_hz, channels = _HEADER.unpack(header.ljust(_HEADER.size, b"\0"))
        if magic != _MAGIC or not rate_hz or not channels:
            raise ImportDataError(f"{path} is not a file of the logger", "Check the file and its format.")
        self._counts = np.memmap(path, "<i4", "r", _HEADER.size)
        self._counts = self._counts[: len(self._counts) // channels * channels].reshape(-1, channels)
        self._rate_hz = rate_hz

    @property
    def facts(self) -> FileFacts:
        """One column for each channel, and the time."""
        channels = [f"channel {number}" for number in range(1, self._counts.shape[1] + 1)]
        return FileFacts(("time", *channels), units={"time": "s"}, time_column="time")

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns."""
        all_names, rows = list(self.facts.names), len(self._counts)
        for first in range(0, rows, BLOCK_ROWS):
            counts = self._counts[first : first + BLOCK_ROWS]
            columns = np.column_stack(((first + np.arange(len(counts))) / self._rate_hz, counts))
            chosen = columns[:, [all_names.index(name) for name in names]]
            yield Block(first, chosen, row_places(first), (first + len(counts)) / rows)

    def sample(self, names: Sequence[str]) -> Block | None:
        """Return the first block."""
        return next(self.blocks(names), None)

    def close(self) -> None:
        """Leave the file."""
        del self._counts
