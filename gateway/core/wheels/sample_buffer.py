"""Preallocated buffer of the latest raw samples, addressed by running sample number."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

# Allocated size over capacity. Samples are written linearly and moved back rarely, so that every view is one contiguous
# slice (measured to be faster than a circular buffer or writing twice, docs/evidence/performance.md).
_SLACK: Final = 4


class SampleBuffer:
    """The latest `capacity` samples of one wheel, int16 (n, channels), indexed by running sample number.

    Missing samples are filled by linear interpolation, so that the numbering has no gaps; the gaps are recorded.

    Attributes:
        capacity: number of samples kept.
        head: running number of the next sample to come.
        tail: running number of the oldest sample still held.
        overwritten: samples that were overwritten before they were read.
    """

    def __init__(self, capacity: int, channels: int) -> None:
        """Allocate once.

        Args:
            capacity: number of samples kept, > 0.
            channels: values per sample.
        """
        self.capacity = capacity
        self._data: NDArray[np.int16] = np.zeros((capacity * _SLACK, channels), np.int16)
        self._start = 0
        self._filled = 0
        self.head = self.tail = 0
        self._gaps: list[tuple[int, int]] = []
        self.overwritten = 0

    def reset(self, head: int) -> None:
        """Forget the samples and continue at running number `head`."""
        self._start, self._filled = 0, 0
        self.head = self.tail = head
        self._gaps.clear()

    def append(self, counts: NDArray[np.int16], unread_from: int | None = None) -> None:
        """Append (n, channels) samples; count the overwritten ones from `unread_from` on, which are still unread."""
        n = len(counts)
        if n > self.capacity:
            self._count_overwritten(self.head + n - self.capacity, unread_from)
            self.head += n - self.capacity
            self.tail = self.head
            self._filled, self._start = 0, 0
            counts = counts[-self.capacity :]
            n = self.capacity
        end = self._start + self._filled
        if end + n > len(self._data):
            keep = min(self._filled, self.capacity)
            self._data[:keep] = self._data[end - keep : end]
            self._start, self._filled, end = 0, keep, keep
        self._data[end : end + n] = counts
        self.head += n
        self._filled += n
        if self._filled > self.capacity:
            drop = self._filled - self.capacity
            if unread_from is not None:
                self._count_overwritten(self.tail + drop, unread_from)
            self._start += drop
            self.tail += drop
            self._filled = self.capacity
            if self._gaps and self._gaps[0][1] <= self.tail:
                self._gaps = [gap for gap in self._gaps if gap[1] > self.tail]

    def bridge(self, missing: int, following: NDArray[np.int16], unread_from: int | None = None) -> None:
        """Fill `missing` lost samples by a line from the last held sample to `following` (channels,)."""
        first = self.head
        last = self._data[self._start + self._filled - 1] if self._filled else following
        step = np.arange(1, missing + 1)[:, None] / (missing + 1)
        line = np.rint(last + step * (following.astype(np.float64) - last)).astype(np.int16)
        self.append(line, unread_from)
        self._gaps.append((first, self.head))

    def patch(self, first: int, counts: NDArray[np.int16]) -> int:
        """Insert late samples at their place; return how many of them were missing."""
        lo, hi = max(first, self.tail), min(first + len(counts), self.head)
        repaired = 0
        remaining: list[tuple[int, int]] = []
        for gap_lo, gap_hi in self._gaps:
            a, b = max(lo, gap_lo), min(hi, gap_hi)
            if a >= b:
                remaining.append((gap_lo, gap_hi))
                continue
            offset = self._start - self.tail
            self._data[offset + a : offset + b] = counts[a - first : b - first]
            repaired += b - a
            remaining += [piece for piece in ((gap_lo, a), (b, gap_hi)) if piece[0] < piece[1]]
        self._gaps = remaining
        return repaired

    def view(self, first: int, end: int) -> NDArray[np.int16]:
        """Return samples `first` to `end` (exclusive) as a view, valid until the next append.

        Raises:
            IndexError: some of them are not held.
        """
        if first < self.tail or end > self.head or first > end:
            raise IndexError(f"samples {first}..{end} are not in {self.tail}..{self.head}")
        offset = self._start - self.tail
        return self._data[offset + first : offset + end]

    def missing_between(self, first: int, end: int) -> int:
        """Count the samples in `first` to `end` (exclusive) that were lost and filled."""
        return sum(max(0, min(end, hi) - max(first, lo)) for lo, hi in self._gaps) if self._gaps else 0

    def measured_mean(self, first: int, end: int, column: int) -> float:
        """Return the mean of a channel over the samples `first` to `end` (exclusive) that were not lost; NaN for none.

        Raises:
            IndexError: some of them are not held.
        """
        total, count = int(self.view(first, end)[:, column].sum(dtype=np.int64)), end - first
        for lo, hi in self.gaps_between(first, end):
            filled = self.view(max(first, lo), min(end, hi))[:, column]
            total, count = total - int(filled.sum(dtype=np.int64)), count - len(filled)
        return total / count if count else math.nan

    def gaps_between(self, first: int, end: int) -> list[tuple[int, int]]:
        """Return first and last (exclusive) sample of the gaps that reach into `first` to `end` (exclusive)."""
        return [(lo, hi) for lo, hi in self._gaps if lo < end and hi > first] if self._gaps else []

    def longest_measured(self, first: int, end: int) -> int:
        """Return the length of the longest stretch within `first` to `end` (exclusive) in which no sample was lost."""
        gaps = self.gaps_between(first, end)
        starts, ends = [first, *(hi for _, hi in gaps)], [*(lo for lo, _ in gaps), end]
        return max(high - low for low, high in zip(starts, ends, strict=True))

    def _count_overwritten(self, new_tail: int, unread_from: int | None) -> None:
        if unread_from is not None and new_tail > unread_from:
            self.overwritten += new_tail - max(unread_from, self.tail)
