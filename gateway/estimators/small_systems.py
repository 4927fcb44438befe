"""Factors and least squares of small dense systems, by LAPACK's own functions.

They take a fraction of the time of numpy's, whose overhead exceeds the work on matrices of this size.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.lapack import dgels, dgeqrf, dtrtrs

from gateway.types import FloatArray


def upper_factor(columns: FloatArray) -> FloatArray:
    """Return R, upper triangular, (n, n), of columns (m, n), m >= n: R^T R = columns^T columns.

    The signs of its rows are not fixed.
    """
    upper, *_ = dgeqrf(columns)
    result: FloatArray = np.triu(upper[: columns.shape[1]])
    return result


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
    for place, one in enumerate(right):
        solved[place], info = dtrtrs(factors[min(place, len(factors) - 1)], one, lower=True, trans=transposed)
        if info:
            raise np.linalg.LinAlgError("a triangular factor is singular")
    return solved


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
    for place, (matrix, one) in enumerate(zip(matrices, right, strict=True)):
        _, found, info = dgels(matrix, one)
        if info:
            raise np.linalg.LinAlgError("the columns are not independent")
        solved[place] = found[:count]
    return solved
