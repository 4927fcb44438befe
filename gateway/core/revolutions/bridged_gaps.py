"""Gaps that were bridged by straight lines before the signal came here, as a spreadsheet or a data frame does.

Within such a gap the first difference is constant on every axis, to the rounding of the values. Noise makes that by
chance for a few samples at most, and the longer, the more rarely. Values of a coarse converter, and those of a quiet
and smooth signal, are on straight lines more often: then short lines are frequent too.
"""

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.types import BoolArray, FloatArray, IntArray

# Probability below which a number of lines is no chance.
_CHANCE_PROBABILITY: Final = 1e-6
# Equal differences in a row, at least, of the lines that are counted together. Lengths double from class to class.
_LINE_LENGTHS: Final = (2, 3, 6, 12, 24, 48)
# First class whose lines may be gaps, and that where noise does not exceed the rounding of the values. What is shorter
# spans five samples and bends too little to matter; a smooth contact edge may be straight for some more.
_FIRST_CLASS: Final = 2
_FIRST_QUIET_CLASS: Final = 3
# Steps by which noise changes most differences on some axis where it exceeds the rounding.
_NOISE_STEPS: Final = 4.0
# Largest ratio of the number of lines in a class to that of the next shorter one: by chance, it is well below one.
_LARGEST_RATIO: Final = 0.9
# Share of the largest magnitude to which single precision and a change of unit round the values.
_ROUNDING: Final = 2.0**-22
# Allowance for the same in a comparison with one step.
_SLACK: Final = 1.01
# Steps by which a line must rise on some axis: a signal that stays is no line.
_RISE_STEPS: Final = 3.0
# Steps by which the difference changes at either end of a line, on some axis: a smooth signal leaves a line gradually.
_KINK_STEPS: Final = 6.0
# Samples of an unfinished line that are kept until the next ones come.
_MAX_OPEN_SAMPLES: Final = 4096
# Share of the samples from which the whole signal was interpolated, rather than gaps in it.
_INTERPOLATED_SHARE: Final = 0.5


@dataclass(frozen=True, slots=True)
class Bridging:
    """Straight lines in a signal.

    Attributes:
        lines: (k, 2) first sample of each line between its ends, and that after the last, as running numbers.
        samples: in these.
        total: samples.
    """

    lines: IntArray
    samples: int
    total: int

    @property
    def share(self) -> float:
        """Share of the samples."""
        return self.samples / self.total

    @property
    def is_everywhere(self) -> bool:
        """Whether the whole signal was interpolated, as from a lower rate."""
        return self.share > _INTERPOLATED_SHARE


class BridgedGaps:
    """Finder of straight lines on all axes of one sensor."""

    def __init__(self, channels: int) -> None:
        """Take the number of channels."""
        self._peak: FloatArray = np.zeros(channels)
        self._step: FloatArray = np.full(channels, np.inf)
        self._open: NDArray[Any] = np.empty((0, channels))
        self._counts: IntArray = np.zeros(len(_LINE_LENGTHS), dtype=np.int64)
        self._lines: list[IntArray] = []
        self._total = self._noisy = 0

    def add(self, values: NDArray[Any], *, follows: bool = True) -> None:
        """Add (n, channels) samples, NaN in gaps; `follows` is False where some are missing before them."""
        start = self._total
        self._total += len(values)
        if follows and len(self._open):
            start -= len(self._open)
            values = np.concatenate((self._open, values))
        self._open = values[-3:].copy()
        if len(values) < 3:
            return
        # Integers of 16 bits would overflow.
        differences = np.diff(values.astype(np.float64), axis=0)
        tolerance = self._rounding(values, differences)
        # In steps.
        bends = np.abs(np.diff(differences, axis=0)) / tolerance
        largest_bends = bends.max(axis=1)
        straight: BoolArray = largest_bends <= 1.0
        self._noisy += int(np.count_nonzero(largest_bends > _NOISE_STEPS))
        edges = np.flatnonzero(np.diff(np.concatenate(([0], straight.astype(np.int8), [0]))))
        first, last = edges[::2], edges[1::2]
        if len(last) and last[-1] == len(straight) and len(values) - first[-1] <= _MAX_OPEN_SAMPLES:
            # It may go on in the next block.
            self._open = values[max(first[-1] - 1, 0) :].copy()
            first, last = first[:-1], last[:-1]
        # A line needs both its ends.
        inner = (first > 0) & (last < len(straight))
        first, last = first[inner], last[inner]
        is_sharp = np.minimum(largest_bends[first - 1], largest_bends[last]) >= _KINK_STEPS
        self._count_lines(values, differences, tolerance, first[is_sharp], last[is_sharp], start)

    def result(self) -> Bridging | None:
        """Return the lines that chance does not make; None without any. Lines at the very end are left out."""
        from scipy.special import pdtrc

        gaps = np.concatenate(self._lines) if self._lines else np.empty((0, 2), dtype=np.int64)
        counts = [self._total, *self._counts.tolist()]
        # Outside of lines, most differences show the noise.
        outside_count = self._total - int((gaps[:, 1] - gaps[:, 0]).sum())
        first = _FIRST_CLASS if 2 * self._noisy > outside_count else _FIRST_QUIET_CLASS
        for index in range(first, len(_LINE_LENGTHS)):
            # By chance, the next class has at most the same share of the one before as that has of one still shorter.
            class_count = counts[index] + 1
            shorter_count = next(count for count in reversed(counts[:index]) if count > 0 or index == 0) + 1
            ratio = class_count / shorter_count
            limit = min(ratio, _LARGEST_RATIO)
            expected = class_count * max(ratio, 1.0) * limit / (1.0 - limit)
            lines = gaps[gaps[:, 1] - gaps[:, 0] + 1 >= _LINE_LENGTHS[index]]
            if len(lines) and float(pdtrc(len(lines) - 1, expected)) < _CHANCE_PROBABILITY:
                return Bridging(lines, int((lines[:, 1] - lines[:, 0]).sum()), self._total)
        return None

    def _rounding(self, values: NDArray[Any], differences: FloatArray) -> FloatArray:
        """Return (channels,) by how much differences on a line differ: the least step of the values so far."""
        for channel in range(values.shape[1]):
            sizes = np.abs(values[:, channel])
            finite = sizes[np.isfinite(sizes)]
            if len(finite):
                self._peak[channel] = max(self._peak[channel], float(finite.max()))
            steps = np.abs(differences[:, channel])
            steps = steps[steps > _ROUNDING * self._peak[channel]]
            if len(steps):
                self._step[channel] = min(self._step[channel], float(steps.min()))
        step: FloatArray = np.where(np.isfinite(self._step), self._step, 0.0)
        # An axis that is zero throughout allows any zero.
        rounding: FloatArray = np.maximum(np.maximum(_SLACK * step, 2.0 * _ROUNDING * self._peak), np.finfo(float).tiny)
        return rounding

    def _count_lines(
        self,
        values: NDArray[Any],
        differences: FloatArray,
        tolerance: FloatArray,
        first: IntArray,
        last: IntArray,
        start: int,
    ) -> None:
        """Count lines that start at differences `first` and end with `last`, inclusive."""
        if not len(first):
            return
        bounds = np.column_stack((first, last + 1)).ravel()
        # Of the parts between bounds every other one is a line; a bound at the end has none behind it.
        bounds = bounds[bounds < len(differences)]
        highest = np.maximum.reduceat(differences, bounds, axis=0)[::2]
        lowest = np.minimum.reduceat(differences, bounds, axis=0)[::2]
        is_straight = (highest - lowest <= tolerance).all(axis=1)
        rise = np.abs(values[last + 1].astype(np.float64) - values[first])
        is_line = is_straight & (rise >= _RISE_STEPS * tolerance).any(axis=1)
        first, last = first[is_line], last[is_line]
        lengths = last - first + 1
        self._counts += np.bincount(np.digitize(lengths, _LINE_LENGTHS) - 1, minlength=len(_LINE_LENGTHS))
        is_long = lengths >= _LINE_LENGTHS[_FIRST_CLASS]
        # The ends of a line are samples; what lies between them is not.
        self._lines.append(start + np.column_stack((first[is_long] + 1, last[is_long] + 1)))
