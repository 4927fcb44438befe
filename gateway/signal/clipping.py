"""Signals that are cut off at a level nobody declared."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# The top of an overshoot falls off by d over a width of about this, in rad, times the root of d over its height; cut
# off, it is level over several times as much.
_TOP_WIDTH_RAD: Final = 0.2
_TIMES: Final = 4.0
_LEAST_RUN: Final = 3


def is_clipped(counts: NDArray[np.integer[Any]]) -> bool:
    """Whether one revolution of raw values is cut off at its highest.

    A smooth top is level to one count over a few samples only, and with noise on it over fewer. So a run of equal
    highest values that is several times as long has been cut.

    Args:
        counts: (n,) raw values of one revolution.
    """
    top = counts.max()
    if top <= 0:
        return False
    at_top = np.flatnonzero(counts == top)
    natural = len(counts) / (2.0 * math.pi) * _TOP_WIDTH_RAD * math.sqrt(1.0 / float(top))
    needed = max(_LEAST_RUN, math.ceil(_TIMES * natural))
    if len(at_top) < needed:
        return False
    # A run of that length: its last sample lies as many places after its first.
    return bool((at_top[needed - 1 :] - at_top[: len(at_top) - needed + 1] == needed - 1).any())
