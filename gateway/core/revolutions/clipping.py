"""Detection of signals that are clipped below their declared range.

A clipped signal piles up at its extreme. Without clipping the number of samples near an extreme is limited, and the
limit gives the probability of a pile by chance:

* The overshoots beside the contact are smooth peaks. Samples spread over them as over a parabola: the share of the
  samples within K counts of the top that lie within j counts of it is at most about sqrt((j + 1) / (K + 1)). Noise only
  reduces it.
* Noise of more than a count spreads the samples even over a flat part, such as the contact. Towards an extreme their
  density decreases, so the share of the extreme count among the last K counts is at most 1 / (K + 1).

A count stands for a step of the converter. Where the converter is coarser than the counts, as in an import, its steps
are counted.
"""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gateway.core.revolutions.short_medians import median

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
# Share of the different values that may lie closer together than the converter's step: values between its steps are
# those of bridged gaps.
_BETWEEN_STEPS_SHARE: Final = 0.1
# So few samples at an extreme are no pile, whatever the noise below 30,000 counts: the last of them has a probability
# above that of chance.
_NO_PILE: Final = 2
# Probability of a pile by chance from which a revolution is clipped.
_CHANCE: Final = 1e-10


def is_clipped(counts: NDArray[np.integer[Any]], sign: int = 1) -> bool:
    """Return whether one revolution is clipped at its maximum or at its minimum.

    Args:
        counts: (n,) raw values of one revolution.
        sign: +1 when they are positive inward, -1 when they are negative.
    """
    # 32 bits hold -(-32768), and numpy sorts them many times faster than 16.
    ascending = counts.astype(np.int32)
    if sign < 0:
        np.negative(ascending, out=ascending)
    ascending.sort()
    if not _is_piled(ascending, counts):
        return False
    # Hardly ever does a revolution get here.
    step = _converter_step(ascending)
    if step <= 1.0:
        return True
    top = ascending[-1]
    return _is_piled(np.rint((ascending - top) / step).astype(np.int32), np.rint(counts / step))


def _is_piled(ascending: NDArray[np.int32], counts: NDArray[Any]) -> bool:
    """Return whether values, in ascending order and, but for their sign, in order of time, pile up at an extreme."""
    n, bottom, top = len(ascending), ascending.item(0), ascending.item(-1)
    if _is_cut_deeply(ascending) or _peak_is_cut(ascending):
        return True
    if n <= _NO_PILE or (ascending.item(_NO_PILE) > bottom and ascending.item(-1 - _NO_PILE) < top):
        return False
    noise = _noise_counts(counts)
    if noise < _LEAST_NOISE:
        return False
    depth = math.floor(_NOISE_RANGE * noise)
    at_bottom, near_bottom = ascending.searchsorted((bottom, bottom + depth), side="right").tolist()
    at_top, near_top = (n - ascending.searchsorted((top, top - depth))).tolist()
    share = _FLATNESS / (depth + 1.0)
    return _beyond_chance(at_top, near_top, share) or _beyond_chance(at_bottom, near_bottom, share)


def _converter_step(ascending: NDArray[np.int32]) -> float:
    """Return the step of the converter in counts, from the distances of values in ascending order."""
    distances = np.diff(ascending)
    distances = np.sort(distances[distances > 0])
    if not len(distances):
        return 1.0
    smallest = distances.item(math.floor(_BETWEEN_STEPS_SHARE * len(distances)))
    if smallest <= 1:
        return 1.0
    # Counts are whole numbers: a step between two of them appears as both.
    return float(distances[(distances >= smallest) & (distances <= smallest + 1)].mean())


def _is_cut_deeply(ascending: NDArray[np.integer[Any]]) -> bool:
    """Return whether a large part of the revolution lies at the top, as when the steady value itself is cut."""
    top = ascending.item(-1)
    if top - ascending.item(0) <= _DEEP_COUNTS:
        return False
    # The lowest of the least number of samples that are a large part.
    return bool(ascending.item(-1 - math.floor(_DEEP_SHARE * len(ascending))) == top)


def _peak_is_cut(ascending: NDArray[np.integer[Any]]) -> bool:
    """Return whether more samples lie near the top than a smooth peak has."""
    n, top = len(ascending), ascending.item(-1)
    middle = 0.5 * (ascending.item((n - 1) // 2) + ascending.item(n // 2))
    depth = math.floor(_PARABOLA_SHARE * (top - middle))
    if depth < _LEAST_COUNTS:
        return False
    # Powers of two up to a quarter of the parabola's counts, and the number of samples within each and within all.
    widths = [1 << power for power in range(depth.bit_length() - 2)]
    *counts, total = (n - ascending.searchsorted([top + 1 - width for width in (*widths, depth + 1)])).tolist()
    limit = _FLATNESS * total / math.sqrt(depth + 1.0)
    for count, width in zip(counts, widths, strict=True):
        root = math.sqrt(width)
        if count > limit * root and _beyond_chance(count, total, _FLATNESS * root / math.sqrt(depth + 1.0)):
            return True
    return False


def _beyond_chance(count: int, total: int, share: float) -> bool:
    """Return whether a number of samples is too large for its largest share of `total`."""
    share = min(share, 1.0)
    count = max(count, 1)
    # Numbers up to the expected one are likely, and so are those that are all there are, if the share to that power is.
    if count <= share * total or share**count >= _CHANCE:
        return False
    # Few revolutions come here, and importing it takes as long as a second of samples.
    from scipy.special import betainc

    # The binomial probability of at least this number.
    return float(betainc(count, total - count + 1.0, share)) < _CHANCE


def _noise_counts(counts: NDArray[Any]) -> float:
    """Return the standard deviation of white noise, from the second differences."""
    wide = counts.astype(np.int32)
    second = np.abs(wide[2:] - 2 * wide[1:-1] + wide[:-2])
    return median(second) / (0.6745 * math.sqrt(6.0)) if len(second) else 0.0
