"""Covariance of a campaign's whitened data as one dense matrix, written out with numpy."""

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.discrepancy import Applied
from gateway.diagnosis.angle.likelihood import Whitened


def covariance_of(applied: Applied, data: Whitened, *, shared_only: bool = False) -> FloatArray:
    """Return the covariance of all whitened data, scatter and discrepancy, (size, size).

    Args:
        applied: the discrepancy.
        data: whitened.
        shared_only: leave out the scatter and what the groups do not share.
    """
    widths = [sum(len(factor) for factor in factors) for factors in data.factors]
    begins = np.concatenate([[0], np.cumsum(widths)]).astype(int)
    total = np.eye(int(begins[-1])) * (0.0 if shared_only else 1.0)
    for position, (axis, column) in enumerate(applied.discrepancy.axes):
        rows, marked = [], []
        for number, (index, scatter) in enumerate(zip(column.groups, column.scatters, strict=True)):
            factor = scatter.factor
            first = begins[index] + sum(map(len, data.factors[index][:axis]))
            for part in range(column.parts):
                wide = np.zeros((int(begins[-1]), factor.shape[1]))
                wide[first : first + len(factor)] = factor
                rows.append((part, column.scales[part, number] * wide))
                marked.append((part, number, column.scales[part, number] * wide))
        if len(column.groups) > 1 and not shared_only:
            for number in range(len(column.groups)):
                selected = np.zeros_like(total)
                for part in range(column.parts):
                    (wide,) = [row for of, at_group, row in marked if of == part and at_group == number]
                    selected += wide @ np.tensordot(applied.amplitudes[position, part], column.kernels, axes=1) @ wide.T
                total += criteria.OWN_SHARE * selected
        for part in range(column.parts):
            seen = sum((row for of, row in rows if of == part), np.zeros_like(rows[0][1]))
            kernel = np.tensordot(applied.amplitudes[position, part], column.kernels, axes=1)
            total += seen @ kernel @ seen.T
    return total


def whitened(data: Whitened, group: int, real: FloatArray) -> FloatArray:
    """Return real coefficients (..., 3, REAL) of one group whitened by the scatter, (..., m)."""
    axes = [real[..., axis, :] @ factor.T for axis, factor in enumerate(data.factors[group])]
    return np.concatenate(axes, axis=-1)


def joined(data: Whitened, rows: tuple[FloatArray, ...]) -> FloatArray:
    """Return real coefficients ([p,] 3, REAL) of each group whitened and side by side, (p, size)."""
    return np.concatenate([np.atleast_2d(whitened(data, index, row)) for index, row in enumerate(rows)], axis=1)
