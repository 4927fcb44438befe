"""Detection of signals that are clipped below their declared range."""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

# A smooth peak of height h stays within d of its top over this angle times sqrt(d / h). When clipped, it is level over
# several times that angle.
_TOP_WIDTH_RAD: Final = 0.2
_WIDTH_RATIO: Final = 4.0
_MIN_RUN_SAMPLES: Final = 3


def is_clipped(counts: NDArray[np.integer[Any]]) -> bool:
    """Return whether one revolution of raw values is clipped at its maximum.

    A smooth peak is level to one count over a few samples only, and with noise over fewer. A run of equal maximum
    values that is several times as long is clipped.

    Args:
        counts: (n,) raw values of one revolution.
    """
    top = counts.max()
    if top <= 0:
        return False
    at_top = np.flatnonzero(counts == top)
    natural = len(counts) / (2.0 * math.pi) * _TOP_WIDTH_RAD * math.sqrt(1.0 / float(top))
    needed = max(_MIN_RUN_SAMPLES, math.ceil(_WIDTH_RATIO * natural))
    if len(at_top) < needed:
        return False
    # In a run of that length, the last sample is needed - 1 places after the first.
    return bool((at_top[needed - 1 :] - at_top[: len(at_top) - needed + 1] == needed - 1).any())
