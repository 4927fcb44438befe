"""Newton's method for the rolling ring: equilibrium under any condition, starting from the undeformed ring.

Each step solves a cyclic block band with a border. Folding the ring flat makes it an ordinary band.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from gateway.physics.rolling_ring.force_balance import Balance, BeltLaw, Grid, belt_balance, imbalance, road_push
from gateway.types import FloatArray, IntArray

_STEP_LIMIT_M: Final = 0.01
# Convergence is quadratic once the extent of the contact stays: after a step this small, over R, 1e-13 of R is left.
_TOLERANCE: Final = 1e-7
_MAX_ITERATIONS: Final = 60
# Newton's method ends within ten steps or so unless it alternates between two extents of the contact.
_ALTERNATING: Final = 15
_MAX_HALVINGS: Final = 5


class NewtonState(NamedTuple):
    """State of the iteration: unknowns of the nodes, axle height, traction ratio, and iterations so far."""

    state: FloatArray
    height_m: float
    traction: float
    iterations: int


class RingNotConvergedError(ArithmeticError):
    """No equilibrium was found: this ring cannot carry the load, or its stiffnesses are out of proportion."""


def resting_state(law: BeltLaw, grid: Grid) -> NewtonState:
    """Return the undeformed ring, its axle low enough for the tread to touch the road."""
    state = np.zeros((len(grid.theta_rad), law.dof))
    state[:, :2] = law.radius_m * grid.radial
    reach = max(0.003, 1.5 * law.radius_m * (1.0 - math.cos(grid.step_rad)))
    return NewtonState(state, law.radius_m - reach, 0.0, 0)


def find_equilibrium(law: BeltLaw, grid: Grid, start: NewtonState, depth: int = 0) -> NewtonState:
    """Return the equilibrium by Newton's method from `start`. If that fails, solve for half the load first.

    Raises:
        RingNotConvergedError: no equilibrium was found.
    """
    try:
        return _newton(law, grid, start)
    except (FloatingPointError, np.linalg.LinAlgError, RingNotConvergedError) as error:
        if depth == _MAX_HALVINGS:
            raise RingNotConvergedError(
                f"no equilibrium of the ring at {law.load_n:.0f} N and {law.pressure_pa:.0f} Pa: {error}"
            ) from error
    light = find_equilibrium(replace(law, load_n=0.5 * law.load_n), grid, resting_state(law, grid), depth + 1)
    return _newton(law, grid, light)


def _newton(law: BeltLaw, grid: Grid, start: NewtonState) -> NewtonState:
    """Return the equilibrium by semi-smooth Newton: the extent of the contact is part of the solution.

    The belt hardly stretches. After a step that turns it, its length is off by the square of the turn, and so much more
    its tension. In the tangent the tension is therefore the one that the step before predicts.
    """
    tension = None
    state, height, traction = start.state, start.height_m, start.traction
    share, before = 1.0, math.inf
    for iteration in range(1, _MAX_ITERATIONS + 1):
        balance = belt_balance(law, grid, state, height, traction, tension)
        changes, borders = solve_bordered(balance, -balance.residual[None], -balance.border[None])
        change, border = changes[0], borders[0]
        size = max(float(np.abs(change[:, :2]).max()), abs(float(border[0])))
        if not math.isfinite(size):
            raise RingNotConvergedError("the iteration diverged")
        if iteration > _ALTERNATING:
            share = 0.5 if size > before else min(1.0, 1.3 * share)
        before = size
        damp = share * min(1.0, _STEP_LIMIT_M / size) if size > 0.0 else 1.0
        state = state + damp * change
        tension = balance.segments.tension_after_n(damp * change[:, :2])
        height += damp * float(border[0])
        if len(border) == 2:
            traction += damp * float(border[1])
        if size < _TOLERANCE * law.radius_m and _same_contact(law, grid, balance, state, height, traction):
            return NewtonState(state, height, traction, start.iterations + iteration)
    raise RingNotConvergedError(f"still moving by {size:.1e} m after {_MAX_ITERATIONS} iterations")


def _same_contact(
    law: BeltLaw, grid: Grid, balance: Balance, state: FloatArray, height: float, traction: float
) -> bool:
    """Return whether the nodes in contact are those of an earlier balance."""
    push = road_push(law, grid, state[:, :2], height, traction).unclipped_npm
    return bool(np.array_equal(push > 0.0, balance.road.unclipped_npm > 0.0))


def first_order_changes(
    law: BeltLaw, grid: Grid, equilibrium: NewtonState, others: Sequence[BeltLaw]
) -> list[NewtonState]:
    """Return equilibria under laws that differ little from one whose equilibrium is known, to first order.

    One factorisation of the tangent stiffness serves all of them.

    Raises:
        FloatingPointError: the tangent stiffness is singular.
    """
    balance = belt_balance(law, grid, equilibrium.state, equilibrium.height_m, equilibrium.traction)
    imbalances = [
        imbalance(other, grid, equilibrium.state, equilibrium.height_m, equilibrium.traction) for other in others
    ]
    changes, borders = solve_bordered(
        balance,
        np.stack([balance.residual - residual for residual, _ in imbalances]),
        np.stack([balance.border - border for _, border in imbalances]),
    )
    return [
        NewtonState(
            equilibrium.state + change,
            equilibrium.height_m + border[0],
            equilibrium.traction + sum(border[1:]),
            equilibrium.iterations,
        )
        for change, border in zip(changes, borders.tolist(), strict=True)
    ]


class FoldedBand(NamedTuple):
    """Places of a cyclic block band's entries in LAPACK's band storage after folding.

    Folding orders the nodes 0, N-1, 1, N-2, ... Neighbours on the ring are then at most twice as far apart as before,
    and the corners of the matrix are empty.

    Attributes:
        unknown: (N, d) position of each unknown in the folded vector.
        flat: (offsets, N, d, d) index into the band storage, column by column; [o, i, a, b] is row (i, a), column
            (i + o, b).
        half: number of sub- and of super-diagonals.
    """

    unknown: IntArray
    flat: IntArray
    half: int


@lru_cache(maxsize=32)
def folded_band(nodes: int, dof: int, reach: int) -> FoldedBand:
    """Return the layout for `nodes` nodes of `dof` unknowns, each coupled to `reach` neighbours on either side."""
    index = np.arange(nodes)
    position = np.where(index < (nodes + 1) // 2, 2 * index, 2 * (nodes - 1 - index) + 1)
    unknown = position[:, None] * dof + np.arange(dof)
    half = 2 * reach * dof + dof - 1
    columns = np.stack([np.roll(unknown, -offset, axis=0) for offset in range(-reach, reach + 1)])
    row = unknown[None, :, :, None]
    column = columns[:, :, None, :]
    # LAPACK keeps `half` extra rows on top for fill-in by pivoting; entry (r, c) lies in band row 2 half + r - c.
    flat = column * (3 * half + 1) + 2 * half + row - column
    return FoldedBand(unknown, flat, half)


def solve_bordered(balance: Balance, right: FloatArray, below: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Solve `[[A, B], [C, D]] (x, y) = (right, below)` with A a cyclic block band, for several right sides.

    Args:
        balance: A as (2 r + 1, N, d, d) `blocks`, where [o, i] couples node i to node i + o - r; B as (m, N, d)
            `columns`, C as (m, N, d) `rows` and D as (m, m) `corner`.
        right: (k, N, d).
        below: (k, m).

    Returns:
        x (k, N, d) and y (k, m).

    Raises:
        FloatingPointError: A is singular.
    """
    from scipy.linalg.lapack import dgbsv

    blocks, columns, rows = balance.blocks, balance.columns, balance.rows
    reach, nodes, dof = blocks.shape[0] // 2, blocks.shape[1], blocks.shape[2]
    layout = folded_band(nodes, dof, reach)
    size, count = nodes * dof, len(right)
    band = np.zeros((3 * layout.half + 1) * size)
    band[layout.flat] = blocks
    sides = np.empty((size, count + len(columns)), order="F")
    for k, side in enumerate((*right, *columns)):
        sides[layout.unknown, k] = side
    _, _, solution, info = dgbsv(
        layout.half, layout.half, band.reshape(size, -1).T, sides, overwrite_ab=True, overwrite_b=True
    )
    if info != 0:
        raise FloatingPointError("the tangent stiffness of the ring is singular")
    free = np.stack([solution[layout.unknown, k] for k in range(count)])
    carried = solution[layout.unknown, count:]
    schur = balance.corner - np.einsum("mia,iak->mk", rows, carried)
    y = np.linalg.solve(schur, (below - np.einsum("mia,kia->km", rows, free)).T).T
    return free - np.einsum("iam,km->kia", carried, y), y
