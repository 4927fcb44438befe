"""Covariance of the quantities of a revolution, from the errors that they share (JCGM 100, 5.2.2 and F.1.2.3)."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from gateway.core.estimates.estimator import TireConditions
from gateway.core.quantity import Basis
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.types import FloatArray

CAUSES: Final = (Basis.RADIUS, Basis.RATE, Basis.GAIN, Basis.LOAD, Basis.PRESSURE)
"""What all quantities of all revolutions of a wheel share; `Quantity.powers` has the exponents."""
_LEAST_DIFFERENCES: Final = 8


def relative_errors(conditions: TireConditions) -> tuple[float, ...]:
    """Return the relative standard errors of CAUSES during a revolution, 0 of what is not stated."""
    load, pressure = conditions.load_n, conditions.pressure_pa
    return (
        conditions.radius_std_m / conditions.radius_m if conditions.radius_m > 0.0 else 0.0,
        conditions.claims.rate_std,
        conditions.gain_std,
        conditions.load_std_n / load if load else 0.0,
        conditions.pressure_std_pa / pressure if pressure else 0.0,
    )


def scatter_correlation(series: FloatArray) -> FloatArray:
    """Return the correlation of the scatter of k quantities, (k, k); the identity of a short series.

    Second differences are free of what driving changes steadily, and of what is constant.

    Args:
        series: (n, k) finite values of consecutive revolutions.
    """
    count = series.shape[1]
    differences = np.diff(series, 2, axis=0)
    if len(differences) < _LEAST_DIFFERENCES:
        return np.eye(count)
    size = np.sqrt(np.square(differences).sum(axis=0))
    scaled = differences / np.where(size > 0.0, size, 1.0)
    result: FloatArray = scaled.T @ scaled
    np.fill_diagonal(result, 1.0)
    return result


def covariance(
    names: Sequence[str],
    values: FloatArray,
    constant_std: FloatArray,
    scatter_std: FloatArray,
    errors: FloatArray,
    correlation: FloatArray,
) -> FloatArray:
    """Return the covariance of k quantities of a revolution, (k, k); its diagonal is their variances.

    A cause of relative error u changes a quantity x of power p by p (x - origin) u, and two quantities by both. What
    the constant parts have beyond the causes counts as independent.

    Args:
        names: of the quantities.
        values: (k,) in their units.
        constant_std: (k,) constant parts of their standard errors.
        scatter_std: (k,) scattering parts.
        errors: (5,) relative standard errors of CAUSES.
        correlation: (k, k) of the scattering parts.
    """
    quantities = [quantity_of(name) for name in names]
    powers = np.array([[quantity.powers.get(cause, 0.0) for cause in CAUSES] for quantity in quantities])
    origins = np.array([quantity.origin for quantity in quantities])
    factors = powers * np.nan_to_num(errors) * (values - origins)[:, np.newaxis]
    size = np.sqrt(np.square(factors).sum(axis=1))
    # Another statement may know a common factor better than its causes, such as the belt width of the new tire.
    factors *= np.minimum(1.0, constant_std / np.where(size > 0.0, size, 1.0))[:, np.newaxis]
    result: FloatArray = factors @ factors.T + correlation * np.multiply.outer(scatter_std, scatter_std)
    np.fill_diagonal(result, np.square(constant_std) + np.square(scatter_std))
    return result
