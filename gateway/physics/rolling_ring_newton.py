"""Newton's method for the rolling ring: every condition from the undeformed ring."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from gateway.physics.rolling_ring_band import solve_bordered
from gateway.physics.rolling_ring_equations import belt_balance
from gateway.physics.rolling_ring_road import BeltLaw, Grid
from gateway.types import FloatArray

_STEP_LIMIT_M = 0.01
_TOLERANCE = 1e-9
_MAX_ITERATIONS = 40
_MAX_HALVINGS = 5


class NewtonState(NamedTuple):
    """A Newton state: unknowns of the nodes, axle height, traction ratio and how many iterations it took."""

    state: FloatArray
    height_m: float
    traction: float
    iterations: int


class RingNotConvergedError(ArithmeticError):
    """No equilibrium was found: the load is out of reach of this ring, or a stiffness is out of proportion."""


def resting_state(law: BeltLaw, grid: Grid) -> NewtonState:
    """Return the undeformed ring, its axle low enough for the tread to touch the road."""
    state = np.zeros((len(grid.theta_rad), law.dof))
    state[:, :2] = law.radius_m * grid.radial
    reach = max(0.003, 1.5 * law.radius_m * (1.0 - math.cos(grid.step_rad)))
    return NewtonState(state, law.radius_m - reach, 0.0, 0)


def find_equilibrium(law: BeltLaw, grid: Grid, start: NewtonState, depth: int = 0) -> NewtonState:
    """Return the equilibrium by Newton's method from `start`; by way of half the load when that fails.

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
    """Return the equilibrium; the contact's extent follows by itself (semi-smooth Newton)."""
    state, height, traction = start.state, start.height_m, start.traction
    for iteration in range(1, _MAX_ITERATIONS + 1):
        balance = belt_balance(law, grid, state, height, traction)
        change, border = solve_bordered(
            balance.blocks, balance.columns, balance.rows, balance.corner, -balance.residual, -balance.border
        )
        size = max(float(np.abs(change[:, :2]).max()), abs(float(border[0])))
        if not math.isfinite(size):
            raise RingNotConvergedError("the iteration diverged")
        damp = min(1.0, _STEP_LIMIT_M / size) if size > 0.0 else 1.0
        state = state + damp * change
        height += damp * float(border[0])
        if len(border) == 2:
            traction += damp * float(border[1])
        if size < _TOLERANCE * law.radius_m:
            return NewtonState(state, height, traction, start.iterations + iteration)
    raise RingNotConvergedError(f"still moving by {size:.1e} m after {_MAX_ITERATIONS} iterations")
