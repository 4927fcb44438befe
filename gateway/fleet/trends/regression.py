"""Weighted linear regression whose standard errors come from the scatter of the data.

The standard errors of single recordings hold parts that all recordings of a tire share, such as the error of its
reference; they say little about a slope. Errors here are those of White's estimator in the form HC3 (MacKinnon and
White 1985), which needs neither equal nor known errors, increased for residuals that follow each other (first-order
autocorrelation). What a bent curve leaves of a straight line follows each other too, but is no chance: it is taken out
before the autocorrelation is measured.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import BoolArray, FloatArray

LEAST_FREEDOM: Final = 3
"""Degrees of freedom below which nothing is determined."""

_MAD_TO_STD: Final = 1.4826
_WORST_CONDITION: Final = 1e6
_LARGEST_LEVERAGE: Final = 0.999
# Powers of the time that a bent curve has beside its line, and the probability of chance below which it is one.
_BENDS: Final = (2, 3)
_BENT: Final = 1e-3


@dataclass(frozen=True, slots=True)
class Fit:
    """A fitted line or plane.

    Attributes:
        coefficients: (p,) of the columns of the design.
        covariance: (p, p) of them, from the scatter.
        residuals: (n,) of all points, also of those left out.
        expected: (n,) fitted values of all points.
        leverage: (n,) of the points that were used, 0 for the others.
        scale: standard deviation of a residual of unit weight.
        weights: (n,) as used.
        freedom: points used less coefficients.
    """

    coefficients: FloatArray
    covariance: FloatArray
    residuals: FloatArray
    expected: FloatArray
    leverage: FloatArray
    scale: float
    weights: FloatArray
    freedom: int

    def std(self, index: int) -> float:
        """Return the standard error of a coefficient."""
        return math.sqrt(max(float(self.covariance[index, index]), 0.0))


def weights_of(design: FloatArray, values: FloatArray, stds: FloatArray) -> FloatArray:
    """Return (n,) weights 1 / (s^2 + tau^2), with tau the scatter about an unweighted fit.

    The scatter keeps a few points with small stated errors from deciding alone. Stated errors above the scatter are
    mostly shared by all points: they are scaled down to it, so that they do not decide either. Unknown errors count as
    none.
    """
    errors = np.where(np.isfinite(stds) & (stds > 0.0), stds, 0.0)
    residuals = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    tau = _MAD_TO_STD * float(np.median(np.abs(residuals - np.median(residuals))))
    known_errors = errors[errors > 0.0]
    if known_errors.size:
        errors *= min(1.0, tau / float(np.median(known_errors)))
    variance = errors**2 + tau**2
    largest = float(variance.max())
    if not largest > 0.0:
        return np.ones_like(values)
    return np.asarray(largest / np.maximum(variance, 1e-12 * largest), dtype=np.float64)


def fit(design: FloatArray, values: FloatArray, weights: FloatArray, used: BoolArray) -> Fit | None:
    """Fit values by weighted least squares.

    Args:
        design: (n, p); column 0 is the level, column 1 the time or distance where there is one.
        values: (n,) finite.
        weights: (n,) positive.
        used: (n,) False for points to leave out.

    Returns:
        the fit, or None where the points do not determine the coefficients, or leave no freedom for the scatter.
    """
    count, columns = int(used.sum()), design.shape[1]
    freedom = count - columns
    if freedom < LEAST_FREEDOM:
        return None
    root = np.sqrt(weights[used])
    rows, targets = design[used] * root[:, None], values[used] * root
    norms = np.linalg.norm(rows, axis=0)
    if not np.all(norms > 0.0) or np.linalg.cond(rows / norms) > _WORST_CONDITION:
        return None
    inverse = np.linalg.inv((rows / norms).T @ (rows / norms)) / np.outer(norms, norms)
    coefficients = inverse @ (rows.T @ targets)
    residuals = targets - rows @ coefficients
    leverage = np.minimum(np.einsum("ij,jk,ik->i", rows, inverse, rows), _LARGEST_LEVERAGE)
    scaled = rows * (residuals / (1.0 - leverage))[:, None]
    covariance = inverse @ (scaled.T @ scaled) @ inverse
    covariance *= _chance_correlation_factor(rows, residuals / np.sqrt(1.0 - leverage), design[used])
    all_leverage = np.zeros(len(values))
    all_leverage[used] = leverage
    expected = design @ coefficients
    return Fit(
        coefficients=coefficients,
        covariance=covariance,
        residuals=values - expected,
        expected=expected,
        leverage=all_leverage,
        scale=math.sqrt(float(residuals @ residuals) / freedom),
        weights=weights,
        freedom=freedom,
    )


def _chance_correlation_factor(rows: FloatArray, residuals: FloatArray, design: FloatArray) -> float:
    """Return the correlation factor of residuals without a bend of the curve, where that is significant.

    Args:
        rows: (n, p) weighted design.
        residuals: (n,) weighted.
        design: (n, p) without weights.
    """
    count, columns = rows.shape
    freedom = count - columns - len(_BENDS)
    if columns < 2 or freedom < LEAST_FREEDOM or not np.ptp(design[:, 1]) > 0.0:
        return correlation_factor(residuals, columns)
    from scipy import stats

    root = np.linalg.norm(rows, axis=1) / np.linalg.norm(design, axis=1)
    abscissa = 2.0 * (design[:, 1] - design[:, 1].min()) / np.ptp(design[:, 1]) - 1.0
    basis = np.linalg.qr(rows)[0]
    bends = root[:, None] * np.column_stack([abscissa**power for power in _BENDS])
    bend_basis = np.linalg.qr(bends - basis @ (basis.T @ bends))[0]
    remaining = residuals - bend_basis @ (bend_basis.T @ residuals)
    misfit, gain = float(remaining @ remaining), float(residuals @ residuals) - float(remaining @ remaining)
    if not misfit > 0.0 or stats.f.sf(gain / len(_BENDS) * freedom / misfit, len(_BENDS), freedom) > _BENT:
        return correlation_factor(residuals, columns)
    return correlation_factor(remaining, columns + len(_BENDS))


def correlation_factor(residuals: FloatArray, columns: int) -> float:
    """Return the increase of the variance by residuals that follow each other in time: (1 + r) / (1 - r), at least 1.

    r is the autocorrelation of neighbours, with the bias (p + 3 r) / n that a fit of p coefficients gives it removed.
    """
    count = len(residuals)
    square = float(residuals @ residuals)
    if count < 8 or not square > 0.0:
        return 1.0
    biased = float(residuals[1:] @ residuals[:-1]) / square
    correlation = min(biased + (columns + 3.0 * max(biased, 0.0)) / count, 0.95)
    # Within the noise of an uncorrelated series nothing is added.
    return (1.0 + correlation) / (1.0 - correlation) if correlation > 1.0 / math.sqrt(count) else 1.0
