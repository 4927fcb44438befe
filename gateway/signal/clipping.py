"""Detection of signals that are clipped below their declared range.

A clipped signal piles up at its extreme. Without clipping the number of samples near an extreme is limited, and the
limit gives the probability of a pile by chance:

* The overshoots beside the contact are smooth peaks. Samples spread over them as over a parabola: the share of the
  samples within K counts of the top that lie within j counts of it is at most about sqrt((j + 1) / (K + 1)). Noise only
  reduces it.
* Noise of more than a count spreads the samples even over a flat part, such as the contact. Towards an extreme their
  density decreases, so the share of the extreme count among the last K counts is at most 1 / (K + 1).
"""

from __future__ import annotations

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.special import betainc

from gateway.types import FloatArray

# Part of the overshoot's height in which it is a parabola, and least number of counts in it.
_PARABOLA_SHARE: Final = 0.05
_LEAST_COUNTS: Final = 4
# Factor on the largest share, for peaks that are flatter than a parabola.
_FLATNESS: Final = 1.5
# Range in which the noise is compared, in its standard deviations, and least noise in counts.
_NOISE_RANGE: Final = 2.0
_LEAST_NOISE: Final = 1.5
# Share of the revolution at its extreme count, and least range in counts, from which it is cut: gravity alone moves the
# steady value by two g.
_DEEP_SHARE: Final = 0.2
_DEEP_COUNTS: Final = 50
# Probability of a pile by chance from which a revolution is clipped.
_CHANCE: Final = 1e-10


def is_clipped(counts: NDArray[np.integer[Any]]) -> bool:
    """Return whether one revolution is clipped at its maximum or at its minimum.

    Args:
        counts: (n,) raw values of one revolution, positive inward.
    """
    below_top = int(counts.max()) - counts.astype(np.int64)
    if _is_cut_deeply(below_top) or _peak_is_cut(below_top):
        return True
    noise = _noise_counts(below_top)
    return _noise_is_cut(below_top, noise) or _noise_is_cut(below_top.max() - below_top, noise)


def _is_cut_deeply(below_top: NDArray[np.int64]) -> bool:
    """Return whether a large part of the revolution lies at the top, as when the steady value itself is cut."""
    return bool(np.count_nonzero(below_top == 0) > _DEEP_SHARE * len(below_top) and below_top.max() > _DEEP_COUNTS)


def _peak_is_cut(below_top: NDArray[np.int64]) -> bool:
    """Return whether more samples lie near the top than a smooth peak has, by counts below the top, (n,)."""
    near = math.floor(_PARABOLA_SHARE * float(np.median(below_top)))
    if near < _LEAST_COUNTS:
        return False
    levels = 2 ** np.arange(max(1, math.floor(math.log2(0.25 * near)) + 1)) - 1
    within = np.array([np.count_nonzero(below_top <= level) for level in (*levels, near)])
    shares = _FLATNESS * np.sqrt((levels + 1.0) / (near + 1.0))
    return _beyond_chance(within[:-1], int(within[-1]), shares)


def _noise_is_cut(depth: NDArray[np.int64], noise: float) -> bool:
    """Return whether more samples lie at an extreme than noise leaves there, by counts from the extreme, (n,)."""
    if noise < _LEAST_NOISE:
        return False
    near = math.floor(_NOISE_RANGE * noise)
    within = np.array([np.count_nonzero(depth == 0)])
    return _beyond_chance(within, int(np.count_nonzero(depth <= near)), np.array([_FLATNESS / (near + 1.0)]))


def _beyond_chance(within: NDArray[np.integer[Any]], of: int, shares: FloatArray) -> bool:
    """Return whether any number of samples is too large for its largest share of `of`."""
    # The binomial probability of at least this number.
    chances = betainc(np.maximum(within, 1), of - within + 1.0, np.minimum(shares, 1.0))
    return bool((chances < _CHANCE).any())


def _noise_counts(counts: NDArray[np.int64]) -> float:
    """Return the standard deviation of white noise, from the second differences."""
    second = np.abs(np.diff(counts, n=2))
    return float(np.median(second)) / (0.6745 * math.sqrt(6.0)) if len(second) else 0.0
