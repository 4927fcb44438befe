"""Samples that repeat the one before on all axes more often than by chance, as a stuck converter or buffer sends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import pdtrc

from gateway.types import BoolArray, FloatArray

# Probability below which a number of repetitions is no chance.
_CHANCE: Final = 1e-6
# Least step in counts, and share of the samples that must make it on some axis: below, a value may well stay.
_MOVES: Final = 2
_MOVING: Final = 0.5
# With steps of two counts and more, a step of 0 is less than this many times as likely as one of 1 on each axis.
_SMOOTH: Final = 1.3


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
    """Counter of repeated samples of one sensor."""

    def __init__(self, channels: int, saturation_counts: int) -> None:
        """Take the number of channels and the count from which a sample is saturated and may well stay."""
        self._channels, self._saturation = channels, saturation_counts
        self._square: FloatArray = np.zeros(channels)
        self._runs = self._samples = self._total = self._near = self._moving = 0

    def add(self, counts: NDArray[np.int16]) -> None:
        """Add (n, channels) consecutive samples; a run at the end of a call is left out."""
        if len(counts) < 3:
            return
        steps = np.abs(np.diff(counts.astype(np.int32), axis=0))
        # A dead axis tells nothing.
        live = steps.any(axis=0)
        if not live.any():
            return
        steps = steps[:, live]
        free = (np.abs(counts[1:, live].astype(np.int32)) < self._saturation).all(axis=1)
        largest = steps.max(axis=1)
        equal, near = (largest == 0) & free, (largest <= 1) & free
        self._total += len(counts)
        self._moving += int((largest >= _MOVES).sum())
        self._near += int((near[1:] & near[:-1] & ~(equal[1:] & equal[:-1])).sum())
        first, last = _stretches(equal)
        # A stuck sample is left by a jump; at a crest that is slow to turn, the next step is small.
        after = np.append(largest, 0)[last]
        long = (last - first >= 2) & (after >= _MOVES)
        for begin, end in zip(first[long].tolist(), last[long].tolist(), strict=True):
            self._runs += 1
            self._samples += end - begin
            jump = (counts[end + 1].astype(np.float64) - counts[end]) / (end - begin + 1)
            self._square += np.square(jump) * float(np.square(np.arange(1, end - begin + 1)).sum())

    def result(self) -> Repetition | None:
        """Return the repetitions; None if chance may make as many, or the signal moves too little to tell."""
        if self._runs == 0 or self._moving < _MOVING * self._total:
            return None
        # Steps of -1, 0 and 1 are about as likely as one another, on each axis and in each of two steps.
        expected = (self._near + 1) * _SMOOTH ** (2 * self._channels) / (9.0**self._channels - 1.0)
        if float(pdtrc(self._runs - 1, expected)) > _CHANCE:
            return None
        return Repetition(self._runs, self._samples, self._total, np.sqrt(self._square / self._total))


def _stretches(values: BoolArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return the first index of each stretch of true values, and that after its last."""
    edges = np.diff(np.concatenate(([0], values.astype(np.int8), [0])))
    return np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
