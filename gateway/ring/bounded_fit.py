"""Damped Gauss-Newton (Levenberg-Marquardt) for a few parameters that cannot be negative.

Where the model cannot follow the data, Gauss-Newton converges slowly. A model may supply its curvature; the steps are
then Newton's.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import FloatArray

# Returns model values (m,) and their Jacobian (m, k).
Model = Callable[[FloatArray], tuple[FloatArray, FloatArray]]

# From parameters (k,) and residuals (m,): sum of residual times second derivative of the model, (k, k).
Curvature = Callable[[FloatArray, FloatArray], FloatArray]

_FIRST_DAMPING: Final = 1e-3
_MAX_DAMPING: Final = 1e12
_MIN_DAMPING: Final = 1e-12
_MAX_GROWTH: Final = 10.0


@dataclass(frozen=True, slots=True)
class BoundedFit:
    """Result of a fit.

    Attributes:
        parameters: (k,) at least 0.
        residuals: (m,) data minus model.
        jacobian: (m, k) of the model.
        cost: sum of squared residuals.
    """

    parameters: FloatArray
    residuals: FloatArray
    jacobian: FloatArray
    cost: float


def fit_nonnegative(
    model: Model,
    data: FloatArray,
    start: FloatArray,
    *,
    curvature: Curvature | None = None,
    tolerance: float = 1e-7,
    max_evaluations: int = 60,
) -> BoundedFit:
    """Minimise sum (data - model(p))^2 over p >= 0.

    Parameters on their bound are held there while the gradient pushes outward (projected step). Scale the parameters to
    about 1: the tolerance is on their largest change.

    Args:
        model: the function to fit; need not be defined at p = 0.
        data: (m,) finite.
        start: (k,) at least 0.
        curvature: of the model, for Newton steps where the cost is convex.
        tolerance: largest change of a parameter, relative to the largest parameter, that counts as converged.
        max_evaluations: of the model.

    Returns:
        The minimum found; deterministic.
    """
    parameters = start.copy()
    values, jacobian = model(parameters)
    residuals = data - values
    cost = float(residuals @ residuals)
    damping = _FIRST_DAMPING
    normal, gradient = _normal(parameters, residuals, jacobian, curvature), jacobian.T @ residuals
    for _ in range(max_evaluations - 1):
        step = _projected_step(normal, gradient, parameters, damping)
        # Data that no parameters describe would drive them to infinity, quadratically with every step.
        trial = np.clip(parameters + step, 0.0, _MAX_GROWTH * max(1.0, float(parameters.max())))
        if float(np.abs(trial - parameters).max()) <= tolerance * float(parameters.max()):
            break
        values, new_jacobian = model(trial)
        new_residuals = data - values
        new_cost = float(new_residuals @ new_residuals)
        if new_cost <= cost:  # False for NaN as well
            parameters, residuals, jacobian = trial, new_residuals, new_jacobian
            cost = new_cost
            normal, gradient = _normal(parameters, residuals, jacobian, curvature), jacobian.T @ residuals
            damping = max(damping * 0.1, _MIN_DAMPING)
        else:
            damping *= 8.0
            if damping > _MAX_DAMPING:
                break
    return BoundedFit(parameters, residuals, jacobian, cost)


def _normal(
    parameters: FloatArray, residuals: FloatArray, jacobian: FloatArray, curvature: Curvature | None
) -> FloatArray:
    """Return the Hessian of half the cost where it is positive definite, else its Gauss-Newton part."""
    normal: FloatArray = jacobian.T @ jacobian
    if curvature is None:
        return normal
    full = normal - curvature(parameters, residuals)
    try:
        np.linalg.cholesky(full)
    except np.linalg.LinAlgError:
        return normal
    return full


def _projected_step(normal: FloatArray, gradient: FloatArray, parameters: FloatArray, damping: float) -> FloatArray:
    """Return the damped step of the parameters that are not held on their bound."""
    free = (parameters > 0.0) | (gradient > 0.0)
    step = np.zeros_like(parameters)
    # A free parameter that the step carries below zero ends on its bound; the others are then solved without it.
    for _ in range(len(parameters)):
        if not free.any():
            break
        rows = normal.compress(free, 0)
        damped = rows.compress(free, 1)
        diagonal = np.diagonal(damped).copy()
        damped.flat[:: len(damped) + 1] += damping * diagonal + 1e-300
        right = gradient[free] - rows.compress(~free, 1) @ step[~free]
        try:
            solved = np.linalg.solve(damped, right)
        except np.linalg.LinAlgError:
            solved = right / np.maximum(diagonal, 1e-300)
        step[free] = solved
        leaving = free & (parameters + step < 0.0)
        if not leaving.any():
            break
        step[leaving] = -parameters[leaving]
        free = free & ~leaving
    return step
