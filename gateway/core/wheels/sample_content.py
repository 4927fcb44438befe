"""Samples against what a hello states of them: order of the bytes, and coupling.

A few blocks are enough, so that this costs little. They are chosen by their sample numbers, not at equal distances: a
wheel may turn once between blocks at equal distances.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_protocol.messages import Axis, Coupling, Hello
from gateway.core.constants import AXIS_NAMES
from gateway.core.reasons import Code, Value
from gateway.core.wheels.reasons import WheelCode

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


def is_chosen(first_sample: int) -> bool:
    """Return whether a block is looked at, by its first sample."""
    return (first_sample * _HASH & 0xFFFF_FFFF) >> _HASH_SHIFT == 0


Contradiction = tuple[Code, dict[str, Value]]
"""What a hello states wrongly, and the values that show it."""


class SampleContent:
    """Chosen blocks of one sensor."""

    __slots__ = ("_blocks", "_stated")

    def __init__(self) -> None:
        self._stated: tuple[object, ...] | None = None
        # Not judged yet. Together they take a tenth of the work that they take one by one.
        self._blocks: list[NDArray[np.int16]] = []

    def block(self, hello: Hello, counts: NDArray[np.int16]) -> tuple[Contradiction, ...]:
        """Take the (n, channels) samples of a chosen block; return what contradicts the hello, after some blocks."""
        description = hello.axes, hello.coupling, hello.scale_mps2, hello.offset_counts, hello.sensor_id
        if description != self._stated:
            self._stated = description
            self._blocks.clear()
        if self._blocks and counts.shape[1] != self._blocks[0].shape[1]:
            return ()
        # Samples may be a view of much more.
        self._blocks.append(counts.copy())
        if len(self._blocks) < _WINDOW_BLOCKS:
            return ()
        contradictions = _contradictions(hello, self._blocks)
        self._blocks.clear()
        return contradictions


def _contradictions(hello: Hello, blocks: Sequence[NDArray[np.int16]]) -> tuple[Contradiction, ...]:
    """Return what (n, channels) samples of blocks that do not follow each other say against the hello."""
    counts = np.concatenate(blocks)
    last = np.cumsum([len(block) for block in blocks])[:-1] - 1
    as_sent, swapped = _steps(counts, last), _steps(counts.byteswap(), last)
    # Words of 8 bits in the upper byte look swapped and are not.
    varied = int(np.bitwise_or.reduce(counts, axis=None)) & 0xFF
    if varied and (swapped > 0).all() and (as_sent > _SWAPPED_RATIO * swapped).all():
        return ((WheelCode.SAMPLES_BYTES_SWAPPED, {"ratio": float((as_sent / swapped).min())}),)
    if hello.coupling != Coupling.AC or 0.0 < hello.highpass_hz < _LOWEST_CORNER_HZ:
        return ()
    axes = [axis for axis in Axis if hello.axes >> axis & 1]
    scale = np.abs([hello.scale_mps2[axis] for axis in axes])
    steady = np.abs(counts.mean(axis=0) - [hello.offset_counts[axis] for axis in axes]) * scale
    worst = int(np.argmax(steady))
    span = float(np.ptp(counts[:, worst].astype(np.int64))) * scale[worst]
    if steady[worst] < max(_STEADY_MPS2, _STEADY_SHARE * span) or span < _LEAST_SPAN * steady[worst]:
        return ()
    values: dict[str, Value] = {"axis": AXIS_NAMES[axes[worst]], "steady_mps2": float(steady[worst])}
    return ((WheelCode.HELLO_AC_WITH_STEADY_VALUE, values),)


def _steps(counts: NDArray[np.int16], last: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the sums of the steps within blocks, by channel; `last` is the last sample of each block but one."""
    steps = np.abs(np.diff(counts.astype(np.int64), axis=0))
    steps[last] = 0
    result: NDArray[np.int64] = steps.sum(axis=0)
    return result
