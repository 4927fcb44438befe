"""Outliers of a regression: generalized extreme Studentized deviates, with a stated rate of false ones.

Rosner, B. (1983): Percentage points for a generalized ESD many-outlier procedure. Technometrics 25, 165-172. Points are
taken out one by one, the most deviating first; the test looks at all before it decides, so that several outliers do not
hide each other.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from gateway.trends.regression import LEAST_FREEDOM, Fit, fit
from gateway.types import BoolArray, FloatArray

FALSE_RATE: Final = 0.01
"""Probability that a whole family of series without outliers is given a single one."""

MOST_SHARE: Final = 0.2
"""Share of a series that can be outliers; more are another state of the tire."""


class OutlierSearch(NamedTuple):
    """Result of the test.

    Attributes:
        is_outlier: (n,).
        fit: of the others; None where they do not determine one.
    """

    is_outlier: BoolArray
    fit: Fit | None


def find_outliers(
    design: FloatArray, values: FloatArray, weights: FloatArray, *, family: int, false_rate: float = FALSE_RATE
) -> OutlierSearch:
    """Find the outliers of a regression.

    Args:
        design: (n, p).
        values: (n,) finite.
        weights: (n,) positive.
        family: number of series that are tested together.
        false_rate: probability of one or more false outliers in the whole family, for residuals that are normal.
    """
    from scipy import stats

    count = len(values)
    used = np.ones(count, dtype=bool)
    first = fit(design, values, weights, used)
    if first is None:
        return OutlierSearch(~used, None)
    level = false_rate / max(family, 1)
    removed: list[int] = []
    found = 0
    now: Fit | None = first
    for step in range(1, int(MOST_SHARE * count) + 1):
        if now is None or now.freedom - 1 < LEAST_FREEDOM or not now.scale > 0.0:
            break
        deviates = np.abs(now.residuals) * np.sqrt(weights) / (now.scale * np.sqrt(1.0 - now.leverage))
        deviates[~used] = -1.0
        worst = int(np.argmax(deviates))
        freedom = now.freedom - 1
        left = count - step + 1
        quantile = float(stats.t.isf(level / (2.0 * left), freedom))
        limit = quantile * math.sqrt(now.freedom) / math.sqrt(freedom + quantile**2)
        removed.append(worst)
        used[worst] = False
        if deviates[worst] > limit:
            found = step
        elif step - found >= _LOOK_AHEAD:
            break
        now = fit(design, values, weights, used)
    is_outlier = np.zeros(count, dtype=bool)
    is_outlier[removed[:found]] = True
    return OutlierSearch(is_outlier, fit(design, values, weights, ~is_outlier))


# Outliers that hide each other are rarely more; the test costs one fit for each.
_LOOK_AHEAD: Final = 12
