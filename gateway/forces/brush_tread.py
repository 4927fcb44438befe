"""Brush tread in lateral rolling contact: bristles stick to the road up to the friction limit.

Ply steer paper, Eq. 19 and 20 at steady state with a slip angle. The foot of a bristle rides on the belt, and its tip
sticks to the road. Its deflection delta starts at zero at the leading edge and grows by
d(delta)/ds = tan(alpha) - dy/ds along the contact, s running from the leading to the trailing edge. Coulomb friction
limits it to |cy delta| <= mu q.

Sign: delta and y are positive to the left; a positive alpha pulls the tread, and so the tire, to the left (the tire
travels to the right of where it points).
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import block_array, coo_array, csc_array, diags_array, eye_array
from scipy.sparse.linalg import splu

from gateway.core.types import BoolArray, FloatArray

_MAX_PASSES: Final = 60


class BrushNotConvergedError(ArithmeticError):
    """The division of the contact into sticking and sliding bristles did not converge."""


@dataclass(frozen=True, slots=True)
class BrushContact:
    """Bristles of one contact, leading edge first.

    Attributes:
        deflection_m: (k,) tip minus foot.
        sliding: (k,) True where the deflection is at the friction limit.
        passes: number of divisions into sticking and sliding that were tried.
    """

    deflection_m: FloatArray
    sliding: BoolArray
    passes: int


def solve_brush_on_belt(
    belt: csc_array,
    load_n: FloatArray,
    foot_unknowns: NDArray[np.int64],
    stiffness_npm: float,
    bound_m: FloatArray,
    *,
    slip_angle_rad: float,
    step_m: float,
    first_fraction: float = 1.0,
) -> tuple[FloatArray, BrushContact]:
    """Return the state of an elastic belt under its bristles, and the bristles.

    Sticking bristles follow Eq. 19, sliding ones stay at their bound, and the belt is in balance under all of them. The
    division into sticking and sliding is found by repeated exact solutions (semi-smooth Newton).

    Args:
        belt: (m, m) stiffness of the belt.
        load_n: (m,) other loads on it.
        foot_unknowns: (k + 1,) indices, among the m unknowns, of the lateral position of the node before the contact
            and of each bristle's foot.
        stiffness_npm: of one bristle.
        bound_m: (k,) largest deflection that friction holds, mu q / cy.
        slip_angle_rad: alpha.
        step_m: distance of neighbouring bristles.
        first_fraction: share of the first step that lies inside the contact.

    Returns:
        the m unknowns, and the bristles.

    Raises:
        BrushNotConvergedError: sticking and sliding kept alternating.
    """
    size, count = belt.shape[0], len(bound_m)
    previous, feet = foot_unknowns[:-1], foot_unknowns[1:]
    share = np.ones(count)
    share[0] = first_fraction
    bristles = np.arange(count)
    push = coo_array((np.full(count, -stiffness_npm), (feet, bristles)), shape=(size, count))
    # Sticking: delta_i - delta_(i-1) + share_i (y_i - y_(i-1)) = share_i step tan(alpha).
    follow = coo_array(
        (np.concatenate([share, -share]), (np.tile(bristles, 2), np.concatenate([feet, previous]))), shape=(count, size)
    ).tocsr()
    chain = (eye_array(count) - eye_array(count, k=-1)).tocsr()
    creep = share * step_m * math.tan(slip_angle_rad)
    state = np.zeros(count)
    past_states: set[bytes] = set()
    for passes in range(1, _MAX_PASSES + 1):
        sticking = diags_array((state == 0.0).astype(np.float64))
        sliding = diags_array(np.abs(state))
        system = block_array([[belt, push], [sticking @ follow, sticking @ chain + sliding]], format="csc")
        solution = splu(system).solve(np.concatenate([load_n, np.where(state == 0.0, creep, state * bound_m)]))
        unknowns, deflection = solution[:size], np.where(state == 0.0, solution[size:], state * bound_m)
        # Deflection of each bristle if it stuck to the road, starting from its neighbour's deflection.
        trial = creep - follow @ unknowns + np.append(0.0, deflection[:-1])
        next_state = np.where(np.abs(trial) > bound_m, np.sign(trial), 0.0)
        if np.array_equal(next_state, state):
            return unknowns, BrushContact(deflection, state != 0.0, passes)
        if next_state.tobytes() in past_states:
            # A cycle: change only the foremost bristle that differs, since each bristle depends on those ahead of it.
            first = int(np.flatnonzero(next_state != state)[0])
            state = np.concatenate([state[:first], next_state[first : first + 1], state[first + 1 :]])
        else:
            past_states.add(next_state.tobytes())
            state = next_state
    raise BrushNotConvergedError(f"stick and slip of the tread did not converge in {_MAX_PASSES} passes")
