"""Newton's method for the rolling ring: equilibrium under any condition, starting from the undeformed ring.

Each step solves a cyclic block band with a border. Folding the ring flat makes it an ordinary band.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from itertools import pairwise
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import FloatArray, IntArray
from gateway.ring.rolling_ring.force_balance import (
    Balance,
    BeltLaw,
    Grid,
    Held,
    belt_balance,
    belt_tension_n,
    imbalance,
    road_force,
)

_STEP_LIMIT_M: Final = 0.01
# Convergence is quadratic once the extent of the contact stays: after a step this small, over R, 1e-13 of R is left.
_TOLERANCE: Final = 1e-7
_MAX_ITERATIONS: Final = 60
# Newton's method ends within ten steps or so unless it alternates between two extents of the contact.
_ALTERNATING: Final = 15
_MAX_HALVINGS: Final = 5
# Steps by secants begin within the first share of R, each is at most the second of the one before, and they end where
# the next one would be below the third.
_SECANT_RANGE: Final = 3e-3
_FIRST_SECANT: Final = 2e-2
_SLOWEST_FALL: Final = 0.3
_REACHED: Final = 1e-12
_MAX_SECANTS: Final = 8


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
    half_loaded = find_equilibrium(replace(law, load_n=0.5 * law.load_n), grid, resting_state(law, grid), depth + 1)
    return _newton(law, grid, half_loaded)


def _newton(law: BeltLaw, grid: Grid, start: NewtonState) -> NewtonState:
    """Return the equilibrium by semi-smooth Newton: the extent of the contact is part of the solution.

    The belt hardly stretches. After a step that turns it, its length is off by the square of the turn, and so much more
    its tension. In the tangent the tension is therefore the one that the step before predicts.
    """
    tension = None
    state, height, traction = start.state, start.height_m, start.traction
    share, last_size, tries_secants = 1.0, math.inf, True
    for iteration in range(1, _MAX_ITERATIONS + 1):
        balance = belt_balance(law, grid, state, height, traction, tension)
        tangent = Tangent(balance)
        changes, borders = tangent(-balance.residual[None], -balance.border[None])
        change, border = changes[0], borders[0]
        size = max(float(np.abs(change[:, :2]).max()), abs(float(border[0])))
        if not math.isfinite(size):
            raise RingNotConvergedError("the iteration diverged")
        if iteration > _ALTERNATING:
            share = 0.5 if size > last_size else min(1.0, 1.3 * share)
        last_size = size
        damp = share * min(1.0, _STEP_LIMIT_M / size) if size > 0.0 else 1.0
        state = state + damp * change
        tension = balance.segments.tension_after_n(damp * change[:, :2])
        height += damp * float(border[0])
        if len(border) == 2:
            traction += damp * float(border[1])
        trial = NewtonState(state, height, traction, start.iterations + iteration)
        if size < _TOLERANCE * law.radius_m and _same_contact(law, grid, balance, trial):
            return trial
        if tries_secants and size < _SECANT_RANGE * law.radius_m:
            end = by_secants(law, grid, trial, tangent, tension)
            if end is not None:
                return end
            tries_secants = False
    raise RingNotConvergedError(f"still moving by {size:.1e} m after {_MAX_ITERATIONS} iterations")


def by_secants(
    law: BeltLaw, grid: Grid, start: NewtonState, tangent: Tangent, tension_n: FloatArray | None = None
) -> NewtonState | None:
    """Return the equilibrium by Broyden's method, None where it does not come near fast.

    The tangent stiffness of a ring nearby stands for that of every state, corrected by what the steps have shown: a
    step takes a third of the time of one with a factorisation. Kelley (1995), Iterative methods, section 7.3.

    Args:
        law: stiffnesses and conditions.
        grid: the grid.
        start: state of a ring nearby.
        tangent: of one nearby.
        tension_n: (N,) of the start; None for that which its nodes' distances give.
    """
    if tangent.borders != (1 if law.torque_nm is None else 2) or tangent.shape != (len(grid.theta_rad), law.dof):
        return None
    if tension_n is None:
        tension_n = belt_tension_n(law, grid, start.state)
    state_size = start.state.size
    moving = state_size + tangent.borders
    unknowns = np.concatenate([start.state.reshape(-1), [start.height_m, start.traction][: tangent.borders], tension_n])
    steps: list[FloatArray] = []
    last_size = _FIRST_SECANT * law.radius_m

    def solution(iterations: int) -> NewtonState:
        borders = unknowns[state_size:moving].tolist()
        return NewtonState(
            unknowns[:state_size].reshape(start.state.shape),
            borders[0],
            borders[1] if len(borders) == 2 else start.traction,
            start.iterations + iterations,
        )

    for iteration in range(_MAX_SECANTS):
        current = solution(iteration)
        held = Held(unknowns[moving:], tangent.segments)
        residual, border, excess_n = imbalance(law, grid, current.state, current.height_m, current.traction, held)
        changes, borders = tangent(-residual[None], -border[None])
        by_stretch = tangent.segments.tension_after_n(changes[0, :, :2]) - tangent.segments.tension_n
        step = np.concatenate([changes.reshape(-1), borders[0], excess_n + by_stretch])
        # The tension follows the nodes: the secants are those of their movement.
        for first, second in pairwise(steps):
            step += second * float(first[:moving] @ step[:moving] / (first[:moving] @ first[:moving]))
        if steps:
            last = steps[-1][:moving]
            step /= 1.0 - float(last @ step[:moving] / (last @ last))
        size = float(np.abs(step[:moving]).max())
        if not size < _SLOWEST_FALL * last_size:
            return None
        unknowns = unknowns + step
        # The next step is smaller than this one by more than this one is than that before.
        if steps and size * size < _REACHED * law.radius_m * last_size:
            return solution(iteration + 1)
        steps.append(step)
        last_size = size
    return None


def _same_contact(law: BeltLaw, grid: Grid, balance: Balance, trial: NewtonState) -> bool:
    """Return whether the nodes in contact are those of an earlier balance."""
    push = road_force(law, grid, trial.state[:, :2], trial.height_m, trial.traction).unclipped_npm
    return bool(np.array_equal(push > 0.0, balance.road.unclipped_npm > 0.0))


def first_order_changes(
    balance: tuple[FloatArray, FloatArray],
    tangent: Tangent,
    grid: Grid,
    equilibrium: NewtonState,
    others: Sequence[BeltLaw],
) -> list[NewtonState]:
    """Return equilibria under laws that differ little from one whose equilibrium is known, to first order.

    Args:
        balance: residual and border of the equilibrium, as of `imbalance`.
        tangent: of its balance.
        grid: the grid.
        equilibrium: known.
        others: the laws.
    """
    state, height_m, traction, iterations = equilibrium
    imbalances = [imbalance(law, grid, state, height_m, traction)[:2] for law in others]
    changes, borders = tangent(
        np.stack([balance[0] - residual for residual, _ in imbalances]),
        np.stack([balance[1] - border for _, border in imbalances]),
    )
    return [
        NewtonState(state + change, height_m + border[0], traction + sum(border[1:]), iterations)
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


class Tangent:
    """Factorised tangent stiffness of a ring: `[[A, B], [C, D]]` with A a cyclic block band.

    Attributes:
        shape: (N, d).
        borders: number of rows of C.
        segments: of the balance.
    """

    def __init__(self, balance: Balance) -> None:
        """Factorise.

        Args:
            balance: A as (2 r + 1, N, d, d) `blocks`, where [o, i] couples node i to node i + o - r; B as (m, N, d)
                `columns`, C as (m, N, d) `rows` and D as (m, m) `corner`.

        Raises:
            FloatingPointError: A is singular.
        """
        from scipy.linalg.lapack import dgbtrf

        blocks = balance.blocks
        reach, nodes, dof = blocks.shape[0] // 2, blocks.shape[1], blocks.shape[2]
        self._layout = folded_band(nodes, dof, reach)
        half, self.shape, self.borders = self._layout.half, (nodes, dof), len(balance.columns)
        self.segments = balance.segments
        band = np.zeros((3 * half + 1) * nodes * dof)
        band[self._layout.flat] = blocks
        self._factors, self._pivots, info = dgbtrf(band.reshape(nodes * dof, -1).T, half, half, overwrite_ab=True)
        if info != 0:
            raise FloatingPointError("the tangent stiffness of the ring is singular")
        self._rows = balance.rows.reshape(self.borders, -1)
        self._column_solution = self._solved(balance.columns)
        self._schur = balance.corner - self._rows @ self._column_solution.T

    def _solved(self, sides: FloatArray) -> FloatArray:
        """Return A^-1 times sides (k, N, d), (k, N d)."""
        from scipy.linalg.lapack import dgbtrs

        half, unknown = self._layout.half, self._layout.unknown.reshape(-1)
        columns = np.empty((len(unknown), len(sides)), order="F")
        columns[unknown] = sides.reshape(len(sides), -1).T
        solution, _ = dgbtrs(self._factors, half, half, columns, self._pivots, overwrite_b=True)
        result: FloatArray = solution[unknown].T
        return result

    def __call__(self, right: FloatArray, below: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Solve `[[A, B], [C, D]] (x, y) = (right, below)` for several right sides.

        Args:
            right: (k, N, d).
            below: (k, m).

        Returns:
            x (k, N, d) and y (k, m).
        """
        unbordered = self._solved(right)
        y = np.asarray(np.linalg.solve(self._schur, (below - unbordered @ self._rows.T).T).T, dtype=np.float64)
        x: FloatArray = unbordered - y @ self._column_solution
        return x.reshape(-1, *self.shape), y
