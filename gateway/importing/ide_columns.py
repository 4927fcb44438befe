"""Reader of channels in IDE recordings of enDAQ sensors; needs the package idelib."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.importing.columns import BLOCK_ROWS, Block, FileFacts, row_places

TIME: Final = "time"


class _Part(NamedTuple):
    """A subchannel: the events of its channel, and its row in their arrays, whose first row are the times."""

    events: Any
    row: int


class IdeColumns:
    """IDE recording. Columns are `channel/subchannel`, with the calibration of the file.

    `time` is the file's own time of the samples in s. It differs from channel to channel.
    """

    def __init__(self, path: Path) -> None:
        """Read the file.

        Raises:
            ImportDataError: it has no samples.
            Exception: of idelib, where it is no IDE file or damaged.
        """
        import idelib

        self._path = path
        self._file: Any = idelib.importFile(str(path), quiet=True)
        self._parts: dict[str, _Part] = {}
        self._units: dict[str, str] = {}
        for channel in self._file.channels.values():
            events = channel.getSession()
            for row, part in enumerate(channel.subchannels if len(events) else (), 1):
                name = f"{channel.name}/{part.name}"
                self._parts[name] = _Part(events, row)
                self._units[name] = str((part.units or ("", ""))[-1])
        if not self._parts:
            raise ImportDataError(f"{path} has no samples", "Copy the recording from the sensor again.")

    @property
    def facts(self) -> FileFacts:
        """Every subchannel, and the time."""
        start_s = self._file.lastSession.utcStartTime
        return FileFacts(
            (*self._parts, TIME),
            units={name: unit for name, unit in self._units.items() if unit},
            start_ns=round(start_s * 1e9) if start_s else None,
            time_column=TIME,
        )

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns.

        Raises:
            ImportDataError: they are of several channels.
        """
        parts = [self._parts.get(name) for name in names]
        several = {id(part.events): part.events for part in parts if part is not None}
        if len(several) > 1:
            raise ImportDataError(
                f"{self._path}: the columns are of channels with times of their own",
                "Leave those of other channels than the accelerations out of the map.",
            )
        for events in several.values():
            for first in range(0, len(events), BLOCK_ROWS):
                end = min(first + BLOCK_ROWS, len(events))
                rows = np.asarray(events.arraySlice(first, end), dtype=np.float64)
                # The format counts in us.
                columns = [rows[0] * 1e-6 if part is None else rows[part.row] for part in parts]
                yield Block(first, np.column_stack(columns), row_places(first), end / len(events))

    def close(self) -> None:
        """Close the file."""
        self._file.close()
