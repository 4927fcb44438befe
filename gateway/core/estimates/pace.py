"""Pace at which estimators renew what rests on an average, decided by counts of revolutions and by conditions alone.

An average over many revolutions changes little in one. Between renewals an estimate follows the average by its own
linear response, so only terms of second order lag (docs/explanation/estimators.md has the bound). Counts and conditions
do not depend on how samples arrive: live, replay and batch renew at the same revolutions.
"""

from typing import Final

import numpy as np

from gateway.core.types import BoolArray, FloatArray

LONGEST: Final = 64
"""Longest pause between renewals, in revolutions: less than the memory of any average."""
SHARE_OF_STD: Final = 0.2
"""Share of a standard error within which a condition may differ from that of the last renewal."""


def is_due(count: int) -> bool:
    """Return whether to renew after `count` revolutions: 1, 2, 4, 8, ..., 64, 128, then every 64."""
    return count & (count - 1) == 0 if count < LONGEST else count % LONGEST == 0


def differ(values: FloatArray, renewed: FloatArray, allowed: FloatArray) -> BoolArray:
    """Return for each of k revolutions whether a condition differs from that of the last renewal by more than allowed.

    Two values that are both not known do not differ; one that is known differs from one that is not.

    Args:
        values: (k, m) conditions of each revolution, NaN where not known.
        renewed: (m,) those of the last renewal.
        allowed: (m,) largest difference of each.
    """
    differing = ~(np.abs(values - renewed) <= allowed)
    if not differing.any():
        return np.zeros(len(values), np.bool_)
    differing &= ~(np.isnan(values) & np.isnan(renewed))
    any_differs: BoolArray = np.any(differing, axis=1)
    return any_differs
