"""Samples that repeat exactly, as a logger writes them where it has none: zeros, or the last value held."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import FloatArray

# Shorter runs hide no contact.
_MIN_RUN_STEPS: Final = 8
# Number of runs that may be by chance.
_CHANCE: Final = 1e-6
_MAX_RUNS: Final = 10_000
# Runs of a single axis up to this number, or one in so many samples: in each contact a quiet signal may stay.
_MAX_QUIET_RUNS: Final = 3
_SAMPLES_PER_RUN: Final = 10_000
# Share of the samples in several runs of an axis that is quiet against its steps.
_QUIET_SHARE: Final = 0.2


@dataclass(frozen=True, slots=True)
class Held:
    """Runs of equal samples.

    Attributes:
        axes: columns that repeat.
        runs: number of them.
        samples: in these.
        first: row of the first, counted from 0.
    """

    axes: tuple[int, ...]
    runs: int
    samples: int
    first: int


class HeldSamples:
    """Finder of runs on all axes, or else on single ones."""

    def __init__(self, axes: int) -> None:
        """Take the number of axes."""
        singles = [(axis,) for axis in range(axes)]
        self._finders = [_Runs(columns) for columns in ([tuple(range(axes)), *singles] if axes > 1 else singles)]

    def add(self, values: FloatArray) -> None:
        """Add (n, axes) consecutive samples, NaN in gaps."""
        if len(values):
            for finder in self._finders:
                finder.add(values[:, finder.axes])

    def result(self) -> Held | None:
        """Return the runs on all axes, or those of the first axis that has some; None without any."""
        return next(filter(None, (finder.result() for finder in self._finders)), None)


class _Runs:
    """Runs that noise does not make: the more samples repeat elsewhere, the longer a run has to be.

    A run of a single axis at the end of its range is saturation, and no such run.
    """

    def __init__(self, axes: tuple[int, ...]) -> None:
        self.axes = axes
        self._last: FloatArray | None = None
        self._rows = self._length = self._steps = self._equal = 0
        self._runs: list[tuple[int, int, float]] = []
        self._low, self._high = math.inf, -math.inf

    def add(self, values: FloatArray) -> None:
        joined = values if self._last is None else np.concatenate((self._last[None], values))
        first = self._rows - (len(joined) - len(values))
        equal = (np.diff(joined, axis=0) == 0.0).all(axis=1)
        self._steps += len(equal)
        self._equal += int(np.count_nonzero(equal))
        edges = np.flatnonzero(np.diff(np.concatenate(([self._length > 0], equal, [False])).astype(np.int8)))
        begins = [first + int(k) for k in edges if k < len(equal) and equal[k]]
        ends = [first + int(k) for k in edges if k == len(equal) or not equal[k]]
        if self._length:
            begins.insert(0, first - self._length)
        is_open = bool(len(equal)) and bool(equal[-1])
        for begin, end in zip(begins, ends, strict=False):
            if is_open and end == first + len(equal):
                self._length = end - begin
                break
            self._note(begin, end, float(joined[max(end - first, 0), 0]))
        else:
            self._length = 0
        self._last, self._rows = values[-1].copy(), self._rows + len(values)
        if values.shape[1] == 1 and np.isfinite(values).any():
            self._low, self._high = min(self._low, float(np.nanmin(values))), max(self._high, float(np.nanmax(values)))

    def result(self) -> Held | None:
        if self._length and self._last is not None:
            self._note(self._rows - 1 - self._length, self._rows - 1, float(self._last[0]))
            self._length = 0
        run_steps = sum(length for _, length, _ in self._runs)
        share = (self._equal - run_steps + 1) / (self._steps - run_steps + 2)
        # Rows times the chance of a run of n equal steps.
        min_length = math.log(_CHANCE / max(self._steps, 1)) / math.log(share) if 0.0 < share < 1.0 else math.inf
        runs = [
            (begin, length)
            for begin, length, value in self._runs
            if length >= max(_MIN_RUN_STEPS, min_length) and value not in (self._low, self._high)
        ]
        samples = sum(length + 1 for _, length in runs)
        is_quiet = len(runs) > max(_MAX_QUIET_RUNS, self._rows / _SAMPLES_PER_RUN) or (
            len(runs) > 1 and samples > _QUIET_SHARE * self._rows
        )
        if not runs or (len(self.axes) == 1 and is_quiet):
            return None
        return Held(self.axes, len(runs), samples, runs[0][0])

    def _note(self, begin: int, end: int, value: float) -> None:
        if end - begin >= _MIN_RUN_STEPS and len(self._runs) < _MAX_RUNS:
            self._runs.append((begin, end - begin, value))
