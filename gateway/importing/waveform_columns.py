"""Columns of files that store each channel as a waveform: its values, the time of the first, and a step.

A reader of such a format lists the channels with what the file states of them. Here alone is decided which rows they
share: channels of one step are aligned by their starts, slower ones interpolated, and what ends early cuts the rest.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.columns import BLOCK_ROWS, Block, FileFacts, require_equal_lengths, row_places

TIME: Final = "time"
"""Column of the times of the waveforms, in s from the start of the file."""
# Relative; steps are written in decimals of single precision at worst.
_SAME_STEP: Final = 1e-6
# Share of a step by which starts may miss a whole number of steps: they are rounded to 1 us at worst.
_SAME_START: Final = 0.05
# A channel with a step longer by this factor is a slow quantity, which may be interpolated.
_SLOW: Final = 2.0


@dataclass(frozen=True, slots=True)
class Waveform:
    """A channel.

    Attributes:
        rows: number of its values.
        read: returns the values from a row to before another, (n,).
        step_s: time between two values, 0 where the file states none.
        unit: its unit, empty where the file states none.
        start_s: time of its first value from the zero of the file.
        group: name of the group of channels that it belongs to, empty without one.
        name: its name in that group.
        stated_rows: number of values that the file states, 0 where it states none.
    """

    rows: int
    read: Callable[[int, int], FloatArray]
    step_s: float = 0.0
    unit: str = ""
    start_s: float = 0.0
    group: str = ""
    name: str = ""
    stated_rows: int = 0

    @classmethod
    def of(cls, values: FloatArray, unit: str = "", group: str = "", name: str = "") -> "Waveform":
        """Return a channel of (n,) values without a step."""
        return cls(len(values), lambda first, end: values[first:end].astype(np.float64), 0.0, unit, 0.0, group, name)

    @property
    def end_s(self) -> float:
        """Time of the end of the last value."""
        return self.start_s + self.rows * self.step_s

    def is_alike(self, other: "Waveform") -> bool:
        """Return whether another channel has the same step."""
        return abs(self.step_s - other.step_s) <= _SAME_STEP * max(self.step_s, other.step_s)


class WaveformColumns:
    """Base of the readers, which fill the attributes; the column `time` follows from the steps.

    Attributes:
        waveforms: channels of numbers.
        unusable: as in the facts of the file.
        start_ns: zero of the times, ns since 1970, None where the file has none.
        rates_hz: as in the facts of the file.
        warnings: what is to be said of the file beside its channels.
        stated: as in the facts of the file.
    """

    def __init__(self, path: Path) -> None:
        """Begin without channels."""
        self.path = path
        self.waveforms: dict[str, Waveform] = {}
        self.unusable: dict[str, tuple[str, str]] = {}
        self.start_ns: int | None = None
        self.rates_hz: dict[str, float] = {}
        self.warnings: list[str] = []
        self.stated: list[tuple[str, str, str]] = []

    def close(self) -> None:
        """Release the values."""
        self.waveforms.clear()

    @property
    def facts(self) -> FileFacts:
        """Every channel of numbers, and the time where one has a step."""
        has_time = TIME not in self.waveforms and any(waveform.step_s > 0.0 for waveform in self.waveforms.values())
        return FileFacts(
            (*self.waveforms, *([TIME] if has_time else [])),
            units={name: waveform.unit for name, waveform in self.waveforms.items() if waveform.unit},
            unusable=dict(self.unusable),
            start_ns=self.start_ns,
            time_column=TIME if has_time else None,
            rates_hz=dict(self.rates_hz),
            groups={
                name: (waveform.group, waveform.name) for name, waveform in self.waveforms.items() if waveform.group
            },
            cut=self._cut(),
            warnings=tuple(self.warnings),
            stated=tuple(self.stated),
            steps_s={name: waveform.step_s for name, waveform in self.waveforms.items() if waveform.step_s > 0.0},
            starts_s={name: waveform.start_s for name, waveform in self.waveforms.items()},
        )

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns, from the first to the last row that all those of the first one's step have.

        Raises:
            ImportDataError: they cannot be aligned, or have no step where the time is asked for.
        """
        channels = {name: self.waveforms[name] for name in names if name in self.waveforms}
        base = next(iter(channels.values()), None)
        if base is None:
            return
        if len(channels) < len(names) and not base.step_s > 0.0:
            raise self._different_steps(channels)
        shifts = self._shifts(channels, base)
        begin = max(shifts.values())
        end = min(shift + channels[name].rows for name, shift in shifts.items())
        slow = {name: _timed_values(channel) for name, channel in channels.items() if name not in shifts}
        for first in range(begin, end, BLOCK_ROWS):
            last = min(first + BLOCK_ROWS, end)
            times_s = base.start_s + np.arange(first, last) * base.step_s
            columns = []
            for name in names:
                if name not in channels:
                    columns.append(times_s)
                elif name in slow:
                    columns.append(np.interp(times_s, *slow[name], left=np.nan, right=np.nan))
                else:
                    columns.append(channels[name].read(first - shifts[name], last - shifts[name]))
            rows = np.column_stack(columns).astype(np.float64)
            yield Block(first - begin, rows, row_places(first - begin), (last - begin) / (end - begin))

    def _shifts(self, channels: Mapping[str, Waveform], base: Waveform) -> dict[str, int]:
        """Return the row of `base` at which each channel of its step begins; slower ones are left out.

        Raises:
            ImportDataError: a step is another one and not slower, starts miss a whole number of steps, no row is
                common, or lengths differ and nothing says how the channels belong together.
        """
        if not base.step_s > 0.0 and not any(channel.step_s > 0.0 for channel in channels.values()):
            if not any(channel.stated_rows for channel in channels.values()):
                require_equal_lengths(self.path, {name: channel.rows for name, channel in channels.items()})
            return dict.fromkeys(channels, 0)
        shifts = {}
        for name, channel in channels.items():
            if channel.step_s >= _SLOW * base.step_s > 0.0:
                continue
            if not base.is_alike(channel):
                raise self._different_steps(channels)
            shift = (channel.start_s - base.start_s) / base.step_s
            if abs(shift - round(shift)) > _SAME_START:
                raise ImportDataError(
                    f"{self.path}: '{name}' starts {channel.start_s - base.start_s:+.6g} s from "
                    f"'{next(iter(channels))}', which is no whole number of steps of {base.step_s:g} s",
                    "Resample them to common times before importing, or leave one out of the map.",
                )
            shifts[name] = round(shift)
        begin, end = max(shifts.values()), min(shift + channels[name].rows for name, shift in shifts.items())
        if end <= begin and all(channel.rows for channel in channels.values()):
            raise ImportDataError(
                f"{self.path}: no time is common to {', '.join(shifts)}: they start up to "
                f"{(begin - min(shifts.values())) * base.step_s:.6g} s apart",
                "Import channels that were not measured at the same time one after the other.",
            )
        return shifts

    def _different_steps(self, channels: Mapping[str, Waveform]) -> ImportDataError:
        steps_text = ", ".join(
            f"{name} has {channel.step_s:g} s" if channel.step_s else f"{name} has none"
            for name, channel in channels.items()
        )
        return ImportDataError(
            f"{self.path}: the channels differ in their step: {steps_text}",
            "Leave channels of other rates out of the map, or state rate_hz instead of time_column.",
        )

    def _cut(self) -> dict[str, tuple[int, int]]:
        """Return rows and expected rows of the channels that end before the others of their group and step."""
        cut_rows = {}
        for name, channel in self.waveforms.items():
            peers = [peer for peer in self.waveforms.values() if peer.group == channel.group and channel.is_alike(peer)]
            is_short = channel.end_s < max(peer.end_s for peer in peers) - 0.5 * channel.step_s
            expected = max(
                channel.stated_rows,
                max(peer.rows for peer in peers) if channel.step_s > 0.0 and is_short else 0,
            )
            if channel.rows < expected:
                cut_rows[name] = (channel.rows, expected)
        return cut_rows


def _timed_values(channel: Waveform) -> tuple[FloatArray, FloatArray]:
    """Return times and values of a slow channel."""
    times_s: FloatArray = channel.start_s + np.arange(channel.rows, dtype=np.float64) * channel.step_s
    return times_s, channel.read(0, channel.rows)
