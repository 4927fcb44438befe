"""Probabilities as text."""

import math
from typing import Final

# From here on a third digit counts: the limits of decisions are here.
_NEAR_ONE: Final = 0.9


def probability_text(probability: float, low_format: str = ".2f") -> str:
    """Return a finite probability, near 1 rounded down: one that misses a limit of 0.99 is not shown as reaching it.

    Args:
        probability: 0 to 1.
        low_format: format of those that are not near 1.
    """
    if probability <= _NEAR_ONE:
        return format(probability, low_format)
    # Products such as 0.957 * 1000 lie just below the whole number.
    return f"{math.floor(1e3 * probability + 1e-9) / 1e3:.3f}"
