"""Samples that repeat the one before on all axes more often than by chance, as a stuck converter or buffer sends."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtrc

from gateway.core.types import BoolArray, FloatArray, IntArray

# Probability below which a number of repetitions is no chance.
_CHANCE: Final = 1e-6
# Share of the samples that must make more than one step of the converter on some axis: below, a value may well stay.
_MOVING: Final = 0.5
# With larger steps, one of 0 is less than this many times as likely as one up or down on each axis.
_SMOOTH: Final = 1.3
# Non-zero differences on every axis that show the converter's step, and samples after which no more are awaited: an
# axis may be dead, and the samples wait in memory.
_ENOUGH_CHANGES: Final = 5_000
_AWAITED: Final = 1_000_000
# Differences below the step, over those from one to two steps: fewer are no steps of the converter, but values between
# them that something else has made, such as bridged gaps.
_BELOW_STEP_RATIO: Final = 0.3
# Differences of two counts are smaller.
_LARGEST: Final = 1 << 16


@dataclass(frozen=True, slots=True)
class Repetition:
    """Repeated samples of a recording.

    Attributes:
        runs: stretches of three or more samples that are equal on all axes.
        samples: samples that repeat the one before, in these.
        total: samples.
        error_counts: (channels,) root mean square of the error over all samples. A stuck sample is off by a share of
            the step to the next sound one.
    """

    runs: int
    samples: int
    total: int
    error_counts: FloatArray


class RepeatedSamples:
    """Counter of repeated samples of one sensor.

    Its converter may be coarser than the counts: an import scales them to the largest value of a file. The first
    samples show the step of each axis.
    """

    def __init__(self, channels: int, saturation_counts: int) -> None:
        """Take the number of channels and the count from which a sample is saturated and may well stay."""
        self._channels, self._saturation = channels, saturation_counts
        self._square: FloatArray = np.zeros(channels)
        self._runs = self._samples = self._total = self._small_pairs = self._moving = 0
        self._waiting: list[NDArray[np.int16]] = []
        self._changes: IntArray = np.zeros(channels, dtype=np.int64)
        self._awaited = 0
        self._one_step: IntArray | None = None

    def add(self, counts: NDArray[np.int16]) -> None:
        """Add (n, channels) consecutive samples; a run at the end of a call is left out."""
        if len(counts) < 3:
            return
        if self._one_step is not None:
            self._count(counts, self._one_step)
            return
        # A copy: the caller's memory may be used again.
        self._waiting.append(counts.copy())
        self._awaited += len(counts)
        self._changes += (counts[1:] != counts[:-1]).sum(axis=0)
        if int(self._changes.min()) >= _ENOUGH_CHANGES or self._awaited >= _AWAITED:
            self._count_waiting()

    def step_counts(self) -> FloatArray:
        """Return the (channels,) step of the converter in counts, rounded down to a whole number."""
        if self._one_step is None:
            self._count_waiting()
        step: FloatArray = np.asarray(self._one_step, dtype=np.float64) - 1.0
        return step

    def result(self) -> Repetition | None:
        """Return the repetitions; None if chance may make as many, or the signal moves too little to tell."""
        if self._one_step is None:
            self._count_waiting()
        if self._runs == 0 or self._moving < _MOVING * self._total:
            return None
        # Steps of -1, 0 and 1 are about as likely as one another, on each axis and in each of two steps.
        expected = (self._small_pairs + 1) * _SMOOTH ** (2 * self._channels) / (9.0**self._channels - 1.0)
        if float(pdtrc(self._runs - 1, expected)) > _CHANCE:
            return None
        return Repetition(self._runs, self._samples, self._total, np.sqrt(self._square / self._total))

    def _count_waiting(self) -> None:
        # The step is a whole number of counts or not: rounded, it is one of two. Of a step below two counts, 2 counts
        # may be one step or two, and one step is the cautious choice.
        differences = np.zeros((self._channels, _LARGEST), dtype=np.int64)
        for counts in self._waiting:
            steps = np.abs(np.diff(counts.astype(np.int32), axis=0))
            for channel, column in enumerate(steps.T):
                differences[channel] += np.bincount(column, minlength=_LARGEST)
        self._one_step = np.array([_step_counts(column) for column in differences]) + 1
        for counts in self._waiting:
            self._count(counts, self._one_step)
        self._waiting.clear()

    def _count(self, counts: NDArray[np.int16], one_step: IntArray) -> None:
        steps = np.abs(np.diff(counts.astype(np.int32), axis=0))
        # A dead axis tells nothing.
        live = steps.any(axis=0)
        if not live.any():
            return
        steps = steps[:, live]
        valid: BoolArray = np.logical_and.reduce(np.abs(counts[1:, live].astype(np.int32)) < self._saturation, axis=1)
        is_small: BoolArray = np.logical_and.reduce(steps <= one_step[live], axis=1)
        equal: BoolArray = (steps.max(axis=1) == 0) & valid
        is_small_valid = is_small & valid
        self._total += len(counts)
        self._moving += len(is_small) - int(is_small.sum())
        self._small_pairs += int((is_small_valid[1:] & is_small_valid[:-1] & ~(equal[1:] & equal[:-1])).sum())
        first, last = _stretches(equal)
        # A stuck sample is left by a jump; at a crest that is slow to turn, the next step is small.
        long = (last - first >= 2) & ~np.append(is_small, True)[last]
        for begin, end in zip(first[long].tolist(), last[long].tolist(), strict=True):
            self._runs += 1
            self._samples += end - begin
            jump = (counts[end + 1].astype(np.float64) - counts[end]) / (end - begin + 1)
            self._square += np.square(jump) * float(np.square(np.arange(1, end - begin + 1)).sum())


def _step_counts(differences: IntArray) -> int:
    """Return the step of a converter in counts, rounded down, from the numbers of absolute differences by size."""
    below = np.cumsum(np.append(0, differences[1:]))
    sizes = np.arange(2, _LARGEST // 2)
    # Of a finer converter, differences below any size are about as frequent as from it to twice as much.
    is_step = below[sizes - 1] < _BELOW_STEP_RATIO * (below[2 * sizes - 1] - below[sizes - 1])
    return int(sizes[is_step].max()) if is_step.any() else 1


def _stretches(values: BoolArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first index of each stretch of true values, and that after its last."""
    edges = np.diff(np.concatenate(([0], values.astype(np.int8), [0])))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
