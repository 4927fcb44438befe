"""Fit of the ring paper's four numbers to measured orders (Eq. 28 and 29), with the covariance of what it rests on."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.estimators.bounded_fit import BoundedFit, Model, fit_nonnegative
from gateway.physics.reference_tire import TABLE_3_NUMBERS
from gateway.physics.ring_series import stiffness_terms
from gateway.types import BoolArray, FloatArray

# The fit works in units of Table 3, so that all four parameters are about 1.
_UNITS: Final = np.array(TABLE_3_NUMBERS)

# Where a cold fit starts: a soft and a stiff belt, a wide and a narrow one, sidewalls either way.
_COLD_STARTS: Final = (
    (1.0, 1.0, 1.0, 1.0),
    (0.1, 0.5, 1.0, 3.0),
    (3.0, 0.3, 1.0, 1.0),
    (0.5, 3.0, 0.5, 0.5),
    (1.0, 0.3, 2.0, 0.1),
    (0.3, 1.0, 0.3, 5.0),
)
# A number below this share of its Table 3 value is on its bound.
_ZERO: Final = 1e-6


@dataclass(frozen=True, slots=True)
class RingFit:
    """The four numbers Bs, Cw, Rs, Ts as fitted.

    Attributes:
        numbers: (4,) at least 0.
        free: (4,) False where the fit puts a number on its bound 0.
        covariance: (4, 4) from the residual or from the noise, whichever is larger for each number; zero for numbers
            that are not free.
        angle_derivative: (4,) change of the numbers per rad of contact half angle.
        residual: rms residual over rms signal.
        evaluations: model evaluations spent.
    """

    numbers: FloatArray
    free: BoolArray
    covariance: FloatArray
    angle_derivative: FloatArray
    residual: float
    evaluations: int


def fit_ring_numbers(
    orders: FloatArray,
    coefficients_m: FloatArray,
    coefficients_std_m: FloatArray,
    *,
    force_m: float,
    half_angle_rad: float,
    warm: FloatArray | None = None,
) -> RingFit | None:
    """Minimise Eq. 28 over Bs, Cw, Rs, Ts >= 0.

    The model is -force sin(n theta_r) n^3 / D_n, with force = Q / (pi p0 R theta_r): all four numbers are proportional
    to it, so that with an unknown load or pressure any force gives the right ratios.

    Args:
        orders: (m,) order numbers, m >= 5.
        coefficients_m: (m,) measured cosine coefficients of s / Omega^2.
        coefficients_std_m: (m,) their standard errors; NaN counts as unknown.
        force_m: Q / (pi p0 R theta_r), positive.
        half_angle_rad: contact half angle theta_r.
        warm: numbers to start from; None tries a set of starts and keeps the best.

    Returns:
        The fit, or None when the data are flat or not finite.
    """
    sine, cosine = np.sin(orders * half_angle_rad), np.cos(orders * half_angle_rad)
    cube = -force_m * orders**3
    numerator = cube * sine
    terms = stiffness_terms(orders) * _UNITS
    power = float(coefficients_m @ coefficients_m)
    if not (math.isfinite(power) and power > 0.0 and bool(np.isfinite(numerator).all())):
        return None

    def model(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        stiffness = np.maximum(terms @ parameters, 1e-12)
        values = numerator / stiffness
        return values, terms * (-values / stiffness)[:, np.newaxis]

    def curvature(parameters: FloatArray, residuals: FloatArray) -> FloatArray:
        stiffness = np.maximum(terms @ parameters, 1e-12)
        result: FloatArray = terms.T @ ((2.0 * residuals * numerator / stiffness**3)[:, np.newaxis] * terms)
        return result

    if warm is None:
        fits = [
            fit_nonnegative(model, coefficients_m, start, curvature=curvature, tolerance=1e-6)
            for start in (_scaled_start(model, coefficients_m, np.array(shape)) for shape in _COLD_STARTS)
        ]
        best = min(fits, key=lambda fit: fit.cost)
        evaluations = sum(fit.iterations for fit in fits)
    else:
        # A number that was left on its bound gets a chance to come off it.
        best = fit_nonnegative(
            model, coefficients_m, np.maximum(warm / _UNITS, 1e-3), curvature=curvature, tolerance=1e-5
        )
        evaluations = best.iterations
    if not math.isfinite(best.cost):
        return None
    free = best.parameters > _ZERO
    if not free.any():
        return None
    # Change of the numerator per rad at fixed load: the sine turns, and force falls as 1 / theta_r.
    turn = cube * orders * cosine - numerator / half_angle_rad
    covariance, angle_derivative = _uncertainty(best, free, terms, numerator, turn, coefficients_std_m)
    return RingFit(
        numbers=np.where(free, best.parameters, 0.0) * _UNITS,
        free=free,
        covariance=covariance * np.outer(_UNITS, _UNITS),
        angle_derivative=angle_derivative * _UNITS,
        residual=math.sqrt(best.cost / power),
        evaluations=evaluations,
    )


def _scaled_start(model: Model, data: FloatArray, shape: FloatArray) -> FloatArray:
    """Scale a start so that the model has the data's size: the model is proportional to 1 / parameters."""
    values, _ = model(shape)
    overlap = float(values @ data)
    if not overlap > 0.0:
        overlap = float(np.linalg.norm(values) * np.linalg.norm(data))
    result: FloatArray = shape * (float(values @ values) / overlap)
    return result


def _uncertainty(
    fit: BoundedFit,
    free: BoolArray,
    terms: FloatArray,
    numerator: FloatArray,
    turn: FloatArray,
    data_std: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return the covariance (k, k) and the derivative by the half angle (k,), zero where not free.

    Both come from how the minimum moves: with f = a / (B p) its Hessian is B' diag(f^2 - 2 r f) / (B p)^2 B. Its
    residual term is no small thing here, where the model does not fit: leaving it out misses by a factor of 3.
    """
    size = len(free)
    covariance, derivative = np.zeros((size, size)), np.zeros(size)
    own = terms[:, free]
    stiffness = terms @ fit.parameters
    values, weighted = numerator / stiffness, own / stiffness[:, np.newaxis]
    hessian = weighted.T @ ((values**2 - 2.0 * fit.residuals * values)[:, np.newaxis] * weighted)
    if np.linalg.eigvalsh(hessian)[0] <= 0.0:
        hessian = weighted.T @ (values[:, np.newaxis] ** 2 * weighted)
    jacobian = fit.jacobian[:, free]
    right = np.column_stack([jacobian.T, weighted.T @ ((values - fit.residuals) * turn / stiffness)])
    try:
        moved = np.linalg.solve(hessian, right)
    except np.linalg.LinAlgError:
        moved = np.full_like(right, math.nan)
    by_data = moved[:, :-1]
    degrees = max(1, len(fit.residuals) - int(np.count_nonzero(free)))
    from_residual = fit.cost / degrees * (by_data @ by_data.T)
    by_noise = by_data * np.nan_to_num(data_std)
    from_noise = by_noise @ by_noise.T
    # Each number's larger variance, with the correlations of the residual's covariance.
    larger = np.sqrt(np.maximum(np.diagonal(from_noise) / np.maximum(np.diagonal(from_residual), 1e-300), 1.0))
    covariance[np.ix_(free, free)] = from_residual * np.outer(larger, larger)
    derivative[free] = moved[:, -1]
    return covariance, derivative
