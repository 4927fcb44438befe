"""Importer of WAV files, in which sound cards and some data loggers store acceleration; integers of 16 or 32 bit."""

from __future__ import annotations

import wave
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.importing.columns import BLOCK_ROWS, Block, FileFacts, row_places

_TYPES = {2: "<i2", 4: "<i4"}


class WavColumns:
    """Channels of a WAV file in counts, with a column of times; follows `gateway.importing.columns.ColumnReader`."""

    def __init__(self, path: Path) -> None:
        """Read the header.

        Raises:
            ImportDataError: it is no WAV file of 16 or 32 bit.
        """
        self._path = path
        try:
            self._file = wave.open(str(path), "rb")  # noqa: SIM115 - `close` closes it
        except (wave.Error, EOFError) as error:
            raise ImportDataError(f"{path} is not a WAV file: {error}", "Check the file and its format.") from error
        if self._file.getsampwidth() not in _TYPES:
            raise ImportDataError(f"{path} has {8 * self._file.getsampwidth()} bit", "Write it with 16 or 32 bit.")

    @property
    def facts(self) -> FileFacts:
        """One column for each channel, and the time."""
        channels = [f"channel {number}" for number in range(1, self._file.getnchannels() + 1)]
        return FileFacts(("time", *channels), units={"time": "s"}, time_column="time")

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns."""
        all_names, rate_hz = list(self.facts.names), self._file.getframerate()
        rows, first = max(self._file.getnframes(), 1), 0
        self._file.rewind()
        while data := self._file.readframes(BLOCK_ROWS):
            counts = np.frombuffer(data, _TYPES[self._file.getsampwidth()]).reshape(-1, self._file.getnchannels())
            time_s = (first + np.arange(len(counts))) / rate_hz
            columns = np.column_stack((time_s, counts))
            chosen = columns[:, [all_names.index(name) for name in names]]
            yield Block(first, chosen, row_places(first), min((first + len(counts)) / rows, 1.0))
            first += len(counts)

    def sample(self, names: Sequence[str]) -> Block | None:
        """Return the first block."""
        return next(self.blocks(names), None)

    def close(self) -> None:
        """Close the file."""
        self._file.close()
