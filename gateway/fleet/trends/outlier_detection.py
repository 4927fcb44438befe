"""Outliers of a regression: generalized extreme Studentized deviates, with a stated rate of false ones.

Rosner, B. (1983): Percentage points for a generalized ESD many-outlier procedure. Technometrics 25, 165-172. Points are
taken out one by one, the most deviating first; the test looks at all before it decides, so that several outliers do not
hide each other.
"""

import math
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import BoolArray, FloatArray
from gateway.fleet.trends.regression import LEAST_FREEDOM, Fit, fit

FALSE_RATE: Final = 0.01
"""Probability that a whole family of series without outliers is given a single one."""

MOST_SHARE: Final = 0.2
"""Share of a series that can be outliers; more are another state of the tire."""


# Outliers that hide each other are rarely more; the test costs one fit for each.
_LOOK_AHEAD: Final = 12
_LARGEST_LEVERAGE: Final = 0.999
# Share of the values that rounding leaves.
_ROUNDING: Final = 1e-10


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
    if fit(design, values, weights, used) is None:
        return OutlierSearch(~used, None)
    level = false_rate / max(family, 1)
    root = np.sqrt(weights)
    rows, targets = design * root[:, None], values * root
    removed: list[int] = []
    outlier_count = 0
    for step in range(1, int(MOST_SHARE * count) + 1):
        freedom = count - step - design.shape[1]
        if freedom < LEAST_FREEDOM or step - outlier_count > _LOOK_AHEAD:
            break
        deviates = _studentized(rows, targets, used)
        worst = int(np.argmax(deviates))
        quantile = float(stats.t.isf(level / (2.0 * (count - step + 1)), freedom))
        limit = quantile * math.sqrt(freedom + 1) / math.sqrt(freedom + quantile**2)
        if not deviates[worst] > 0.0:
            break
        removed.append(worst)
        used[worst] = False
        if deviates[worst] > limit:
            outlier_count = step
    is_outlier = np.zeros(count, dtype=bool)
    is_outlier[removed[:outlier_count]] = True
    return OutlierSearch(is_outlier, fit(design, values, weights, ~is_outlier))


def _studentized(rows: FloatArray, targets: FloatArray, used: BoolArray) -> FloatArray:
    """Return (n,) residuals of the points used over their own standard deviation; -1 for the others."""
    basis = np.linalg.qr(rows[used])[0]
    residuals = targets[used] - basis @ (basis.T @ targets[used])
    leverage = np.minimum(np.einsum("ij,ij->i", basis, basis), _LARGEST_LEVERAGE)
    scale = math.sqrt(float(residuals @ residuals) / (len(residuals) - basis.shape[1]))
    deviates = np.full(len(targets), -1.0)
    if scale > _ROUNDING * float(np.abs(targets).max()):
        deviates[used] = np.abs(residuals) / (scale * np.sqrt(1.0 - leverage))
    return deviates
