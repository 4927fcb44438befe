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
            ImportDataError: it has no samples, or ends within a block of them.
            Exception: of idelib, where it is no IDE file or damaged.
        """
        import idelib

        self._path = path
        try:
            self._file: Any = idelib.importFile(str(path), quiet=True)
        except ValueError as error:  # of numpy: the bytes of a block are not those of whole rows
            raise ImportDataError(
                f"{path} is cut or damaged within a block of samples ({error})",
                "Copy the recording from the sensor again.",
            ) from error
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
            warnings=self._damage(),
        )

    def _damage(self) -> tuple[str, ...]:
        """Return what idelib passes over: elements that it does not know behind the last block, and broken ones."""
        unknown_offset: int | None = None
        try:
            for element in self._file.ebmldoc:
                is_unknown = element.name == "UnknownElement"
                unknown_offset = (element.offset if unknown_offset is None else unknown_offset) if is_unknown else None
            is_broken = bool(self._file.fileDamaged)
        except Exception:  # of ebmlite
            is_broken = True
        if unknown_offset is None and not is_broken:
            return ()
        where = "" if unknown_offset is None else f" behind byte {unknown_offset}"
        return (f"the file is damaged{where}, and the rest of it is not read",)

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
