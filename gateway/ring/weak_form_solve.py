"""Solution of the belt's balance for the four numbers: least squares with errors in the rows themselves.

The rows hold for the true shape, but the signal has errors. So the orders are corrected as little as possible, in terms
of their errors, until all rows hold (the Gauss-Helmert model). Rows and their sensitivity are computed at the corrected
orders, and the rows are weighted with the covariance that follows from the errors of the orders. At the measured orders
bending would be too small by the square of the errors (docs/explanation/estimators.md).
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import BoolArray, FloatArray
from gateway.ring.belt_shape import belt_shape
from gateway.ring.bounded_fit import fit_nonnegative
from gateway.ring.determination import NUMBER_UNITS
from gateway.ring.small_systems import least_squares, solve_lower, upper_factor
from gateway.ring.weak_form_rows import (
    ROWS,
    SENSITIVE_ORDERS,
    UNKNOWNS,
    BalanceRows,
    balance_rows,
    row_sensitivity,
)

# Units of the unknowns: all are about 1 for a car tire at load number 1.
UNITS: Final[FloatArray] = np.array([*NUMBER_UNITS, 0.18 / 0.2325, 0.08])
# Degrees of freedom: rows minus unknowns.
FREEDOM: Final = ROWS + 1 - UNKNOWNS

_GAUSS_NEWTON_STEPS: Final = 5
_CONVERGED: Final = 1e-5
# Ridge of the unknowns, and right-hand sides whose solutions are the columns of an inverse.
_RIDGE: Final[FloatArray] = np.eye(UNKNOWNS)
_ROW_BY_ROW: Final[FloatArray] = np.eye(ROWS + 1 + UNKNOWNS, ROWS + 1)
# An unknown below this share of its unit is on its bound.
_ON_BOUND: Final = 1e-6


@dataclass(frozen=True, slots=True)
class WeakFormSolution:
    """Solutions of b waveforms at load number 1: numbers and tension are proportional to Q / (p0 R^2).

    Attributes:
        unknowns: (b, 6) Bs, Cw, Rs, Ts, tension, deflection.
        free: (b, 6) False where an unknown is held at 0.
        response: (b or 1, 6, SENSITIVE_ORDERS) derivative of the unknowns by the orders of the relative signal.
        correction: (b, SENSITIVE_ORDERS) least change of the orders, in terms of their errors, that lets all rows hold.
        misfit: (b,) its size squared, in terms of the errors, over FREEDOM: about 1 when errors are as stated.
    """

    unknowns: FloatArray
    free: BoolArray
    response: FloatArray
    correction: FloatArray
    misfit: FloatArray


@dataclass(frozen=True, slots=True)
class _Weights:
    """Rows' sensitivity to the orders, the orders' variance, and a triangular factor of the rows' covariance."""

    sensitivity: FloatArray
    variance: FloatArray
    factor: FloatArray


def solve_balance(
    orders: FloatArray,
    begin: int,
    order_std: FloatArray,
    start: WeakFormSolution | None,
    passes: int,
) -> WeakFormSolution:
    """Solve the balance of b waveforms, each with its own weights.

    Args:
        orders: (b, MAX_ORDER + 1) cosine orders of kappa R, order 0 being 1.
        begin: grid index where the virtual motion begins.
        order_std: (b, SENSITIVE_ORDERS) standard errors of the relative signal's orders, all positive.
        start: a solution of nearly the same waveforms; None starts from the ring of Table 3.
        passes: at least 1; one is enough from a start, four are needed without one where the errors are large.

    Raises:
        numpy.linalg.LinAlgError: the orders describe no belt.
    """
    rows = balance_rows(belt_shape(orders if start is None else _corrected(orders, start.correction)), begin)
    solution = start
    for _ in range(passes):
        if solution is not None and solution is not start:
            rows = balance_rows(belt_shape(_corrected(orders, solution.correction)), begin)
        unknowns = _cold_start(rows) if solution is None else solution.unknowns
        solution = _solve_at(orders, rows, unknowns, _weights(rows, unknowns, order_std))
    assert solution is not None
    return solution


def _corrected(orders: FloatArray, correction: FloatArray) -> FloatArray:
    """Return the orders with their correction; order 0 is 1 and has none."""
    corrected = orders.copy()
    corrected[:, 1:SENSITIVE_ORDERS] += correction[:, 1:]
    return corrected


def _weights(rows: BalanceRows, unknowns: FloatArray, order_std: FloatArray) -> _Weights:
    sensitivity = row_sensitivity(rows, unknowns)
    weighted = sensitivity * order_std[:, np.newaxis, :]
    # The product of `weighted` with its transpose is the covariance, but would square the condition number.
    return _Weights(sensitivity, np.square(order_std), np.array([upper_factor(matrix.T).T for matrix in weighted]))


def _cold_start(rows: BalanceRows) -> FloatArray:
    """Return Table 3's numbers with the deflection and tension that fit the shape best, scaled to the load."""
    numbers = UNITS[:4]
    constant, rise = rows.constant[..., :4] @ numbers, rows.rise[..., :4] @ numbers
    factors = np.stack([rise[:, :ROWS], rows.constant[:, :ROWS, 4]], axis=2)
    transposed = factors.transpose(0, 2, 1)
    fitted = np.linalg.solve(transposed @ factors, -transposed @ constant[:, :ROWS, np.newaxis])[..., 0]
    start = np.tile(UNITS, (len(constant), 1))
    start[:, 4:] = np.maximum(fitted[:, ::-1], 0.1 * UNITS[4:])
    scale = constant[:, ROWS] + start[:, 5] * rise[:, ROWS]
    start[:, :5] /= np.clip(scale, 0.1, 10.0)[:, np.newaxis]
    return start


def _solve_at(orders: FloatArray, rows: BalanceRows, start: FloatArray, weights: _Weights) -> WeakFormSolution:
    """Solve with rows computed at `rows.shape.orders`, which differ from `orders` by the last correction."""
    change = (orders - rows.shape.orders)[:, :SENSITIVE_ORDERS]
    change[:, :2] = 0.0  # order 0 is 1 and order 1 is the closure's
    target = -weights.sensitivity @ change[..., np.newaxis]
    target[:, ROWS] += 1.0
    whitened = solve_lower(weights.factor, np.concatenate([rows.constant, rows.rise, target], axis=2))
    unknowns, free, jacobian, residual = _solve_whitened(whitened, start)
    inverse = _inverse(jacobian)
    # Back through the weights: whitened rows to unknowns, residual to the change of the orders that explains it.
    columns = np.concatenate([inverse, residual[:, np.newaxis]], axis=1).transpose(0, 2, 1)
    by_order = solve_lower(weights.factor, columns, transposed=True).transpose(0, 2, 1) @ weights.sensitivity
    return WeakFormSolution(
        unknowns=unknowns,
        free=free,
        response=-by_order[:, :UNKNOWNS],
        correction=-by_order[:, UNKNOWNS] * weights.variance,
        misfit=np.sum(np.square(residual), axis=1) / FREEDOM,
    )


def _solve_whitened(whitened: FloatArray, start: FloatArray) -> tuple[FloatArray, BoolArray, FloatArray, FloatArray]:
    """Minimise the sum of squares of whitened rows; return unknowns, which are free, Jacobian and residual.

    Gauss-Newton for all waveforms at once, then a bounded fit of each waveform where that fails or ends below zero.
    """
    unknowns = start
    size = np.full(len(unknowns), math.inf)
    for _ in range(_GAUSS_NEWTON_STEPS):
        jacobian, residual = _linearised(whitened, unknowns)
        try:
            step = least_squares(jacobian * UNITS, residual[..., np.newaxis])[..., 0]
        except np.linalg.LinAlgError:
            break
        unknowns = unknowns - step * UNITS
        size = np.abs(step).max(axis=1)
        if not size.max() > _CONVERGED:
            break
    free = np.ones(unknowns.shape, dtype=np.bool_)
    for index in np.flatnonzero(~((unknowns > 0.0).all(axis=1) & (size <= _CONVERGED))):
        unknowns[index], free[index] = _solve_bounded(whitened[index], start[index])
    jacobian, residual = _linearised(whitened, unknowns)
    return unknowns, free, jacobian, residual


def _linearised(whitened: FloatArray, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the Jacobian (..., ROWS + 1, 6) and the residual (..., ROWS + 1) of the whitened rows."""
    linear, deflection = unknowns[..., :5, np.newaxis], unknowns[..., 5, np.newaxis]
    constant, rise, target = whitened[..., :5], whitened[..., 5:10], whitened[..., 10]
    by_deflection = (rise @ linear)[..., 0]
    jacobian = np.empty((*target.shape, UNKNOWNS))
    np.multiply(rise, deflection[..., np.newaxis], out=jacobian[..., :5])
    jacobian[..., :5] += constant
    jacobian[..., 5] = by_deflection
    return jacobian, (constant @ linear)[..., 0] + by_deflection * deflection - target


def _solve_bounded(whitened: FloatArray, start: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Solve one waveform with all unknowns at least 0."""
    target = whitened[:, 10]

    def model(parameters: FloatArray) -> tuple[FloatArray, FloatArray]:
        jacobian, residual = _linearised(whitened, parameters * UNITS)
        return residual + target, jacobian * UNITS

    # An unknown on its bound starts slightly above it, so that it can leave it.
    first = np.clip(np.nan_to_num(start / UNITS, nan=1.0), 0.01, 100.0)
    fit = fit_nonnegative(model, target, first, tolerance=1e-6)
    free = fit.parameters > _ON_BOUND
    return np.where(free, fit.parameters, 0.0) * UNITS, free


def _inverse(jacobian: FloatArray) -> FloatArray:
    """Return the matrix from whitened rows to unknowns, (b, 6, ROWS + 1), with all of them free.

    An unknown on its bound is not known to be 0: its possible values are part of the errors of the others.
    """
    scaled = jacobian * UNITS
    # A small ridge, so that the matrix is never singular.
    ridge = 1e-7 * np.sqrt(np.sum(np.square(scaled), axis=(1, 2)))[:, np.newaxis, np.newaxis] * _RIDGE
    right = np.broadcast_to(_ROW_BY_ROW, (len(scaled), *_ROW_BY_ROW.shape))
    inverse: FloatArray = least_squares(np.concatenate([scaled, ridge], axis=1), right) * UNITS[:, np.newaxis]
    return inverse
