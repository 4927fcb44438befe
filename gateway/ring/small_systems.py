"""Factors and least squares of small dense systems, by the compiled core or LAPACK's own functions.

Both take a fraction of the time of numpy's, whose overhead exceeds the work on matrices of this size. LAPACK shares its
work among threads where the environment does not forbid it, which makes systems this small a hundred times slower.
"""

import numpy as np

from gateway.core.compiled import core
from gateway.core.types import FloatArray


def upper_factor(columns: FloatArray) -> FloatArray:
    """Return R, upper triangular, (n, n), of columns (m, n), m >= n: R^T R = columns^T columns.

    The signs of its rows are not fixed.
    """
    upper: FloatArray = np.asarray(np.linalg.qr(columns, mode="r"))
    return upper


def solve_lower(factors: FloatArray, right: FloatArray, *, transposed: bool = False) -> FloatArray:
    """Solve L x = right, or L^T x = right, for each of b right-hand sides (b, n, k).

    Args:
        factors: (b or 1, n, n) lower triangular L.
        right: (b, n, k).
        transposed: solve with L^T.

    Raises:
        numpy.linalg.LinAlgError: a factor is singular.
    """
    solved = np.empty(right.shape)
    for index, element in enumerate(right):
        if not solved_lower(factors[min(index, len(factors) - 1)], element, transposed, solved[index]):
            raise np.linalg.LinAlgError("a triangular factor is singular")
    return solved


def _solved_by_lapack(factor: FloatArray, right: FloatArray, transposed: bool, out: FloatArray) -> bool:
    """Set L^-1 right or L^-T right, (n, k); return whether L is regular."""
    from scipy.linalg.lapack import dtrtrs

    out[:], info = dtrtrs(factor, right, lower=True, trans=transposed)
    return not info


def _solved_by_core(factor: FloatArray, right: FloatArray, transposed: bool, out: FloatArray) -> bool:
    """As `_solved_by_lapack`."""
    assert core is not None
    regular: bool = core.solve_lower(np.ascontiguousarray(factor), np.ascontiguousarray(right), transposed, out)
    return regular


solved_lower = _solved_by_lapack if core is None else _solved_by_core


def least_squares(matrices: FloatArray, right: FloatArray) -> FloatArray:
    """Return x of least |matrix x - right|^2 for each of b systems, (b, n, k).

    Args:
        matrices: (b, m, n), m >= n.
        right: (b, m, k).

    Raises:
        numpy.linalg.LinAlgError: a matrix is singular.
    """
    count = matrices.shape[2]
    solved = np.empty((len(right), count, right.shape[2]))
    for index, system in enumerate(zip(matrices, right, strict=True)):
        if not fitted(*system, solved[index]):
            raise np.linalg.LinAlgError("the columns are not independent")
    return solved


def _fitted_by_lapack(matrix: FloatArray, right: FloatArray, out: FloatArray) -> bool:
    """Set x of least |matrix x - right|^2, (n, k); return whether the columns are independent."""
    from scipy.linalg.lapack import dgels

    _, solution, info = dgels(matrix, right)
    out[:] = solution[: matrix.shape[1]]
    # Of a matrix of zeros LAPACK says nothing.
    return not info and bool(matrix.any())


def _fitted_by_core(matrix: FloatArray, right: FloatArray, out: FloatArray) -> bool:
    """As `_fitted_by_lapack`."""
    assert core is not None
    rows, columns = matrix.shape
    work = np.empty((rows + 1) * (columns + right.shape[1]))
    independent: bool = core.least_squares(np.ascontiguousarray(matrix), np.ascontiguousarray(right), work, out)
    return independent


fitted = _fitted_by_lapack if core is None else _fitted_by_core
