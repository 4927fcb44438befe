"""Weights of values at nodes in their interpolating polynomial."""

import numpy as np

from gateway.core.types import FloatArray


def polynomial_weights(nodes: FloatArray, values: FloatArray | float) -> FloatArray:
    """Return the weights of what is known at the nodes in the polynomial through it (Lagrange's form).

    Args:
        nodes: (n,) distinct.
        values: (...) at which the polynomial is wanted; beyond the nodes it extrapolates.

    Returns:
        (..., n).
    """
    # Row i of the differences, with its own entry replaced by 1, holds the factors of weight i.
    diagonal = np.eye(len(nodes), dtype=bool)
    weights: FloatArray = np.where(diagonal, 1.0, np.asarray(values)[..., None, None] - nodes).prod(axis=-1)
    weights /= np.where(diagonal, 1.0, nodes[:, None] - nodes).prod(axis=-1)
    return weights
