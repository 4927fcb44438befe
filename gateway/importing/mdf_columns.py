"""Reader of numeric channels in MDF files (MF4, also versions 2 and 3); needs the package asammdf.

A damaged file can make the parser ask for any amount of memory, so `gateway.importing.reader_process` runs this module.
"""

import contextlib
import logging
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final
from xml.etree import ElementTree

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.storable_text import storable
from gateway.core.types import FloatArray
from gateway.importing.columns import BLOCK_ROWS, Block, FileFacts, row_places

_MAX_CHANNELS: Final = 20_000
# A channel of another group is loaded as a whole; a slow quantity has fewer samples.
_MAX_SLOW_ROWS: Final = 10_000_000
# A group with a larger share of the samples is no slow one.
_SLOW_SHARE: Final = 0.5
# Share of the sample interval by which equal times may differ.
_SAME_TIME: Final = 1e-3
TIME: Final = "time"


@dataclass(frozen=True, slots=True)
class _Channel:
    """Place of a channel."""

    group: int
    index: int


class MdfColumns:
    """MDF file, read block by block.

    Columns are channels by their names; one whose name occurs in several groups is `name (group 2)`. The first column
    that is read gives the rows; channels of groups with other times are interpolated to its times. `time` is the time
    of these rows in seconds.
    """

    def __init__(self, path: Path) -> None:
        """List the channels.

        Raises:
            ImportDataError: it has too many channels.
            Exception: of asammdf, where it is no MDF file or damaged.
        """
        from asammdf import MDF

        logging.getLogger("asammdf").setLevel(logging.CRITICAL)
        self._path = path
        self._channels: dict[str, _Channel] = {}
        self._units: dict[str, str] = {}
        self._unusable: dict[str, tuple[str, str]] = {}
        self._groups: dict[str, tuple[str, str]] = {}
        self._mdf: Any = MDF(path)
        self._list()
        if any(name.startswith("CAN_DataFrame") for name in (*self._channels, *self._unusable)):
            raise ImportDataError(
                f"{path} holds frames of a CAN bus",
                f"Record them as signals of the vehicle: treadlink record SOURCE can:{path.name}?dbc=FILE.",
            )
        start = self._mdf.header.start_time
        # A file without a date has the start of the epoch; one in local time does not state its zone.
        dated = start.tzinfo is not None and start.year > 1990
        self._start_ns = round(start.timestamp() * 1e6) * 1000 if dated else None

    @property
    def facts(self) -> FileFacts:
        """Every channel of numbers, and the time."""
        names = (*self._channels, *(() if TIME in self._channels else (TIME,)))
        return FileFacts(
            names,
            units=self._units,
            unusable=dict(self._unusable),
            start_ns=self._start_ns,
            time_column=TIME,
            conditions=self._conditions(),
            groups=self._groups,
            steps_s=self._steps_s(),
        )

    def close(self) -> None:
        """Close the file."""
        self._mdf.close()

    def _steps_s(self) -> dict[str, float]:
        """Return the mean time between the values of each channel whose group has times."""
        steps_s: dict[int, float] = {}
        for number in {channel.group for channel in self._channels.values()} & set(self._mdf.masters_db):
            count = int(self._mdf.groups[number].channel_group.cycles_nr)
            with contextlib.suppress(Exception):  # of asammdf: a damaged group is named where it is read
                ends = [self._mdf.get_master(number, record_offset=row, record_count=1) for row in (0, count - 1)]
                steps_s[number] = float(ends[1][0] - ends[0][0]) / (count - 1)
        return {
            name: step_s for name, channel in self._channels.items() if (step_s := steps_s.get(channel.group, 0.0)) > 0
        }

    def _conditions(self) -> dict[str, dict[str, Sequence[str]]]:
        """Return the properties of each group by its name."""
        conditions: dict[str, dict[str, Sequence[str]]] = {}
        for group in self._mdf.groups:
            block = group.channel_group
            with contextlib.suppress(ElementTree.ParseError, AttributeError, TypeError):
                entries = ElementTree.fromstring(block.comment).iterfind("./common_properties/e")
                properties = {entry.get("name", ""): (entry.text or "", entry.get("desc", "")) for entry in entries}
                if properties:
                    wheel = storable(str(block.acq_name))
                    conditions[wheel] = {name: tuple(map(storable, pair)) for name, pair in properties.items()}
        return conditions

    def _list(self) -> None:
        channels = []
        for number, group in enumerate(self._mdf.groups):
            master = self._mdf.masters_db.get(number)
            for index, channel in enumerate(group.channels):
                if index != master:
                    channels.append((storable(channel.name), number, index))
            if len(channels) > _MAX_CHANNELS:
                raise ImportDataError(
                    f"{self._path} has more than {_MAX_CHANNELS} channels",
                    "Save the channels of one run in a new file.",
                )
        times = Counter(name for name, _, _ in channels)
        for name, number, index in channels:
            column = name if times[name] == 1 else f"{name} (group {number})"
            channel = self._mdf.groups[number].channels[index]
            self._channels[column] = _Channel(number, index)
            self._groups[column] = (f"group {number}", name)
            conversion = getattr(channel, "conversion", None)
            unit = getattr(conversion, "unit", "") or getattr(channel, "unit", "")
            if unit:
                self._units[column] = storable(str(unit))[:40]

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named channels at the times of the first; an invalid value is NaN."""
        channels = {name: self._channels[name] for name in names if name in self._channels}
        if not channels:
            return
        base = next(iter(channels.values())).group
        count = int(self._mdf.groups[base].channel_group.cycles_nr)
        others = {channel.group for channel in channels.values()} - {base}
        slow = {name: self._slow(name, channel, base) for name, channel in channels.items() if channel.group in others}
        row = 0
        while row < count:
            rows = min(BLOCK_ROWS, count - row)
            times_s = np.asarray(self._mdf.get_master(base, record_offset=row, record_count=rows), dtype=np.float64)
            if not len(times_s):
                break
            columns = []
            for name in names:
                if name not in channels:
                    columns.append(times_s)
                elif name in slow:
                    columns.append(_interpolated_at(times_s, *slow[name]))
                else:
                    columns.append(self._values(name, channels[name], row, rows))
            length = min(len(column) for column in columns)
            if length < len(times_s):
                raise ImportDataError(f"{self._path} ends before its last sample", "Copy or write the file again.")
            yield Block(row, np.column_stack(columns), row_places(row), min((row + rows) / count, 1.0))
            row += len(times_s)

    def _slow(self, name: str, channel: _Channel, base: int) -> tuple[FloatArray, FloatArray]:
        """Return the times and values of a channel of another group than `base`."""
        count, base_count = (int(self._mdf.groups[group].channel_group.cycles_nr) for group in (channel.group, base))
        timing_error = ImportDataError(
            f"{self._path}: '{name}' has {count} samples at times of its own",
            "Import such channels one group after the other, each with a map of its own.",
        )
        if count > _MAX_SLOW_ROWS:
            raise timing_error
        times_s = np.asarray(self._mdf.get_master(channel.group), dtype=np.float64)
        if count > _SLOW_SHARE * base_count:
            # Interpolation would change an acceleration.
            base_s = np.asarray(self._mdf.get_master(base), dtype=np.float64)
            step_s = float(base_s[-1] - base_s[0]) / max(len(base_s) - 1, 1)
            is_common = (times_s >= base_s[0] - 0.5 * step_s) & (times_s <= base_s[-1] + 0.5 * step_s)
            if is_common.sum() <= _SLOW_SHARE * base_count:
                raise timing_error
            # Groups that start apart share the rows at which their times agree.
            rows = np.clip(np.rint(np.interp(times_s, base_s, np.arange(len(base_s)))), 0, len(base_s) - 1)
            if float(np.abs(times_s - base_s[rows.astype(np.intp)])[is_common].max()) > _SAME_TIME * step_s:
                raise timing_error
            times_s = np.where(is_common, base_s[rows.astype(np.intp)], times_s)
        values = self._values(name, channel, 0, None)
        if len(values) != len(times_s) or (np.diff(times_s) < 0).any():
            raise ImportDataError(f"{self._path}: the times of '{name}' do not increase", "Write the file again.")
        return times_s, values

    def _values(self, name: str, channel: _Channel, row: int, rows: int | None) -> FloatArray:
        # Without this option samples that are marked as invalid are left out, and the others move up.
        signal = self._mdf.get(
            group=channel.group,
            index=channel.index,
            ignore_invalidation_bits=True,
            record_offset=row,
            record_count=rows,
        )
        samples, invalid = np.asarray(signal.samples), signal.invalidation_bits
        if samples.ndim != 1 or samples.dtype.kind not in "iufb":
            kind = {"S": "text", "U": "text", "c": "complex"}.get(samples.dtype.kind, str(samples.dtype))
            fault = f"is of {samples.ndim} dimensions" if samples.ndim != 1 else f"is {kind}"
            raise ImportDataError(f"{self._path}: '{name}' {fault}", "Save its values as a channel of numbers.")
        values = samples.astype(np.float64)
        if invalid is not None and len(invalid) == len(values):
            values[np.asarray(invalid, dtype=np.bool_)] = np.nan
        return values


def _interpolated_at(times_s: FloatArray, channel_s: FloatArray, values: FloatArray) -> FloatArray:
    """Return values at other times: interpolated, NaN outside of the known times."""
    if not len(channel_s):
        return np.full(len(times_s), np.nan)
    interpolated: FloatArray = np.interp(times_s, channel_s, values, left=np.nan, right=np.nan)
    return interpolated
