"""Linear solver of the rolling ring: a cyclic block band with a border, by folding the ring flat."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gateway.types import FloatArray, IntArray


class FoldedBand(NamedTuple):
    """Where the entries of a cyclic block band lie in LAPACK's band storage after folding.

    The ring is pressed flat: node 0, node N-1, node 1, node N-2, ... Neighbours on the ring are then at most twice as
    far apart as before, and nothing is left in the corners of the matrix.

    Attributes:
        unknown: (N, d) position of each unknown in the folded vector.
        flat: (offsets, N, d, d) index into the raveled band storage; [o, i, a, b] is row (i, a), column (i + o, b).
        half: number of sub- and of super-diagonals.
    """

    unknown: IntArray
    flat: IntArray
    half: int


@lru_cache(maxsize=32)
def folded_band(nodes: int, dof: int, reach: int) -> FoldedBand:
    """Return the layout for `nodes` nodes of `dof` unknowns, each coupled to `reach` neighbours either side."""
    index = np.arange(nodes)
    place = np.where(index < (nodes + 1) // 2, 2 * index, 2 * (nodes - 1 - index) + 1)
    unknown = place[:, None] * dof + np.arange(dof)
    half = 2 * reach * dof + dof - 1
    columns = np.stack([np.roll(unknown, -offset, axis=0) for offset in range(-reach, reach + 1)])
    row = unknown[None, :, :, None]
    column = columns[:, :, None, :]
    # LAPACK keeps `half` further rows on top for the fill-in of pivoting; entry (r, c) lies in band row 2 half + r - c.
    flat = (2 * half + row - column) * (nodes * dof) + column
    return FoldedBand(unknown, flat, half)


def solve_bordered(
    blocks: FloatArray, columns: FloatArray, rows: FloatArray, corner: FloatArray, right: FloatArray, below: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Solve [[A, B], [C, D]] [x, y] = [right, below] with A a cyclic block band.

    Args:
        blocks: (2 r + 1, N, d, d) blocks of A; [o, i] couples node i to node i + o - r.
        columns: (m, N, d) B.
        rows: (m, N, d) C.
        corner: (m, m) D.
        right: (N, d).
        below: (m,).

    Returns:
        x (N, d) and y (m,).

    Raises:
        FloatingPointError: A is singular.
    """
    from scipy.linalg.lapack import dgbsv

    reach, nodes, dof = blocks.shape[0] // 2, blocks.shape[1], blocks.shape[2]
    layout = folded_band(nodes, dof, reach)
    size = nodes * dof
    band = np.zeros((3 * layout.half + 1) * size)
    band[layout.flat] = blocks
    border = len(below)
    sides = np.empty((size, border + 1), order="F")
    sides[layout.unknown, 0] = right
    for k in range(border):
        sides[layout.unknown, k + 1] = columns[k]
    _, _, solution, info = dgbsv(
        layout.half, layout.half, band.reshape(-1, size), sides, overwrite_ab=True, overwrite_b=True
    )
    if info != 0:
        raise FloatingPointError("the tangent stiffness of the ring is singular")
    free = solution[layout.unknown, 0]
    carried = solution[layout.unknown, 1:]
    schur = corner - np.einsum("kia,iaj->kj", rows, carried)
    y = np.linalg.solve(schur, below - np.einsum("kia,ia->k", rows, free))
    return free - carried @ y, y
