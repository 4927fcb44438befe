"""Columns of files that store each channel as a waveform: its values, the time of the first, and a step.

The formats are read by `gateway.importing.reader_process`; their modules list the waveforms of a file.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.errors import ImportDataError
from gateway.core.types import FloatArray
from gateway.importing.columns import BLOCK_ROWS, Block, FileFacts, require_equal_lengths, row_places

TIME: Final = "time"
"""Column of the times of the waveforms, in s from the first value."""
# Relative; steps are written in decimals of single precision at worst.
_SAME_STEP: Final = 1e-6


@dataclass(frozen=True, slots=True)
class Waveform:
    """A channel.

    Attributes:
        rows: number of its values.
        read: returns the values from a row to before another, (n,).
        step_s: time between two values, 0 where the file states none.
        unit: its unit, empty where the file states none.
    """

    rows: int
    read: Callable[[int, int], FloatArray]
    step_s: float = 0.0
    unit: str = ""


class WaveformColumns:
    """Base of the readers, which fill `waveforms` and `unusable`; the column `time` follows from the steps."""

    def __init__(self, path: Path) -> None:
        """Begin without channels."""
        self.path = path
        self.waveforms: dict[str, Waveform] = {}
        self.unusable: dict[str, tuple[str, str]] = {}
        self.start_ns: int | None = None

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
        )

    def blocks(self, names: Sequence[str]) -> Iterator[Block]:
        """Yield the named columns.

        Raises:
            ImportDataError: they differ in length, or in their steps where the time is asked for.
        """
        channels = {name: self.waveforms[name] for name in names if name in self.waveforms}
        require_equal_lengths(self.path, {name: waveform.rows for name, waveform in channels.items()})
        rows = next((waveform.rows for waveform in channels.values()), 0)
        step_s = self._step_s(channels) if len(channels) < len(names) else 0.0
        for first in range(0, rows, BLOCK_ROWS):
            end = min(first + BLOCK_ROWS, rows)
            columns = [
                channels[name].read(first, end) if name in channels else np.arange(first, end) * step_s
                for name in names
            ]
            yield Block(first, np.column_stack(columns).astype(np.float64), row_places(first), end / rows)

    def _step_s(self, channels: dict[str, Waveform]) -> float:
        """Return the step that the channels share.

        Raises:
            ImportDataError: they have none, or different ones.
        """
        steps_s = {name: waveform.step_s for name, waveform in channels.items()}
        shown = ", ".join(
            f"{name} has {step_s:g} s" if step_s else f"{name} has none" for name, step_s in steps_s.items()
        )
        low_s, high_s = min(steps_s.values(), default=0.0), max(steps_s.values(), default=0.0)
        if channels and not low_s > (1.0 - _SAME_STEP) * high_s:
            raise ImportDataError(
                f"{self.path}: the channels differ in their step: {shown}",
                "Leave channels of other rates out of the map, or state rate_hz instead of time_column.",
            )
        return high_s
