"""Samples against what a hello states of them: order of the bytes, and coupling.

A few blocks are enough, so that this costs little. They are chosen by their sample numbers, not at equal distances: a
wheel may turn once between blocks at equal distances.
"""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Coupling, Hello
from gateway.constants import AXIS_NAMES
from gateway.reasons import Code, Value
from gateway.types import FloatArray

# One block in 32 is looked at, by a multiplicative hash of its first sample (2^32 over the golden ratio).
_HASH: Final = 2_654_435_761
_HASH_SHIFT: Final = 27
# Blocks that are judged together.
_WINDOW_BLOCKS: Final = 16
# Steps from sample to sample are so many times smaller with the bytes the other way round. In the right order they are
# smaller by far; of noise over the full scale neither is.
_SWAPPED_RATIO: Final = 4.0
# A steady value above this is no error of an AC-coupled sensor's zero: the wheel rolls.
_STEADY_MPS2: Final = 30.0
# Contacts must be among the blocks, or the level between them looks steady with AC coupling, too: the values span at
# least this share of the steady value. It is nine tenths of what they span with DC coupling, one tenth with AC.
_LEAST_SPAN: Final = 0.5
_STEADY_SHARE: Final = 0.4
# A high-pass this low passes what is steady over a window.
_LOWEST_CORNER_HZ: Final = 0.2


def chosen(first_sample: NDArray[np.int64] | int) -> NDArray[np.bool_] | bool:
    """Return whether blocks are looked at, by their first samples."""
    return (first_sample * _HASH & 0xFFFF_FFFF) >> _HASH_SHIFT == 0


Contradiction = tuple[Code, dict[str, Value]]
"""What a hello states wrongly, and the values that show it."""


class SampleContent:
    """Chosen blocks of one sensor."""

    __slots__ = ("_blocks", "_highest", "_lowest", "_samples", "_stated", "_steps", "_sum", "_varied")

    def __init__(self) -> None:
        self._stated: tuple[object, ...] | None = None
        self._begin(0)

    def _begin(self, channels: int) -> None:
        self._blocks = self._samples = 0
        self._sum: FloatArray = np.zeros(channels)
        self._lowest: FloatArray = np.full(channels, np.inf)
        self._highest: FloatArray = np.full(channels, -np.inf)
        # Sums of the steps as sent, and with the bytes the other way round.
        self._steps: FloatArray = np.zeros((2, channels))
        self._varied = 0

    def block(self, hello: Hello, counts: NDArray[np.int16]) -> tuple[Contradiction, ...]:
        """Take the (n, channels) samples of a chosen block; return what contradicts the hello, after some blocks."""
        stated = hello.axes, hello.coupling, hello.scale_mps2, hello.offset_counts, hello.sensor_id
        channels = counts.shape[1]
        if stated != self._stated:
            self._stated = stated
            self._begin(channels)
        if channels != len(self._sum):
            return ()
        values = counts.astype(np.float64)
        self._blocks += 1
        self._samples += len(values)
        self._sum += values.sum(axis=0)
        self._lowest = np.minimum(self._lowest, values.min(axis=0))
        self._highest = np.maximum(self._highest, values.max(axis=0))
        self._steps[0] += np.abs(np.diff(values, axis=0)).sum(axis=0)
        self._steps[1] += np.abs(np.diff(counts.byteswap().astype(np.float64), axis=0)).sum(axis=0)
        self._varied |= int(np.bitwise_or.reduce(counts, axis=None)) & 0xFF
        if self._blocks < _WINDOW_BLOCKS:
            return ()
        contradictions = self._contradictions(hello)
        self._begin(channels)
        return contradictions

    def _contradictions(self, hello: Hello) -> tuple[Contradiction, ...]:
        as_sent, swapped = self._steps
        # Words of 8 bits in the upper byte look swapped and are not.
        if self._varied and (swapped > 0.0).all() and (as_sent > _SWAPPED_RATIO * swapped).all():
            return ((Code.SAMPLES_BYTES_SWAPPED, {"ratio": float((as_sent / swapped).min())}),)
        if hello.coupling != Coupling.AC or 0.0 < hello.highpass_hz < _LOWEST_CORNER_HZ:
            return ()
        axes = [axis for axis in Axis if hello.axes >> axis & 1]
        scale = np.abs([hello.scale_mps2[axis] for axis in axes])
        steady = np.abs(self._sum / self._samples - [hello.offset_counts[axis] for axis in axes]) * scale
        worst = int(np.argmax(steady))
        span = (self._highest[worst] - self._lowest[worst]) * scale[worst]
        if steady[worst] < max(_STEADY_MPS2, _STEADY_SHARE * span) or span < _LEAST_SPAN * steady[worst]:
            return ()
        values: dict[str, Value] = {"axis": AXIS_NAMES[axes[worst]], "steady_mps2": float(steady[worst])}
        return ((Code.HELLO_AC_WITH_STEADY_VALUE, values),)
