"""Lateral shape of a steadily rolling belt: a beam of cubic elements whose tread sticks to the road and slides on it.

The belt shears in its plane by its plies as it is bent flat (ply steer paper, Eq. 13) and curves by its cone. A bristle
of the tread touches down undeflected; its tip then stays on the road until friction gives way.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.sparse import coo_array, csc_array, diags_array
from scipy.sparse.linalg import splu

from independent_tire.elements import COORDINATES, Array, GaussPoints
from independent_tire.steady import NotSteadyError, SteadyBelt, turned

_PASSES: Final = 80
# Of the section's strains by (y, psi, y', psi'): shear, pull, bending and the sidewall's deflection.
_SHEAR, _PULL, _BEND, _SIDEWALL = np.array([[0.0, -1, 1, 0], [0, 0, 1, 0], [0, 0, 0, 1], [1, 0, 0, 0]])


@dataclass(frozen=True)
class Sides:
    """What a belt has sideways, in SI units; per length of belt where the unit says so.

    Attributes:
        shear_n: stiffness against shear in the belt's plane.
        bending_nm2: against bending in it.
        sidewall_npm2: lateral stiffness of the sidewall.
        tread_npm2: of the tread.
        friction: of the road.
        coupling_m: shear over the loss of curvature, negative shear for a positive coupling.
        conicity_rad: half angle of the cone.
    """

    shear_n: float
    bending_nm2: float
    sidewall_npm2: float
    tread_npm2: float
    friction: float
    coupling_m: float = 0.0
    conicity_rad: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class SidewaysShape:
    """Lateral shape, (N,) over the belt's nodes.

    Attributes:
        y_m: displacement to the left.
        lateral_m: its second derivative by the angle: what a lateral axis reads over omega squared.
        side_force_n: of the road on the tire.
    """

    y_m: Array
    lateral_m: Array
    side_force_n: float


def bend_sideways(steady: SteadyBelt, sides: Sides, slip_rad: float = 0.0) -> SidewaysShape:
    """Return the lateral shape under a slip angle that pulls the tire to the left where it is positive.

    Raises:
        NotSteadyError: sticking and sliding did not settle.
    """
    mesh, places = steady.mesh, steady.mesh.places(COORDINATES)
    weight, values, slopes = mesh.weight_m, mesh.shapes[0], mesh.shapes[1]
    fields = np.zeros((len(weight), 4, 8))
    fields[:, 0, 0::2], fields[:, 1, 1::2], fields[:, 2, 0::2], fields[:, 3, 1::2] = values, values, slopes, slopes
    plain = (
        sides.shear_n * np.outer(_SHEAR, _SHEAR)
        + sides.bending_nm2 * np.outer(_BEND, _BEND)
        + sides.sidewall_npm2 * np.outer(_SIDEWALL, _SIDEWALL)
    )
    blocks = np.einsum("p,pai,ab,pbj->ij", weight, fields, plain, fields)[None]
    pulled = np.einsum("pai,a->pi", fields, _PULL)
    blocks = blocks + np.einsum("p,np,pi,pj->nij", weight, steady.tension_n, pulled, pulled, optimize=True)
    stiffness = mesh.assembled(blocks, places)
    straightened = steady.curvature_pm - 1.0 / steady.belt.radius_m
    wanted = -(sides.shear_n * sides.coupling_m * _SHEAR + sides.bending_nm2 * sides.conicity_rad * _BEND)
    load = mesh.gathered(np.einsum("p,np,pai,a->ni", weight, straightened, fields, wanted, optimize=True))
    tread = _Tread(steady, sides, slip_rad)
    coordinates, deflection = tread.settled(stiffness, load)
    nodes = coordinates.reshape(-1, COORDINATES)
    return SidewaysShape(
        y_m=nodes[:, 0].copy(),
        lateral_m=steady.belt.radius_m * turned(nodes[:, 2].astype(np.complex128)).real,
        side_force_n=float(tread.stiffness_n_per_m @ deflection),
    )


class _Tread:
    """Bristles at the Gauss points of the contact, the leading one first.

    Attributes:
        stiffness_n_per_m: (m,) of each bristle.
    """

    def __init__(self, steady: SteadyBelt, sides: Sides, slip_rad: float) -> None:
        mesh = steady.mesh
        touching = np.flatnonzero(steady.push_npm.reshape(-1) > 0.0)
        points = np.arange(touching[0], touching[-1] + 1)
        angle = np.append(steady.edges_rad[0], mesh.theta_rad.reshape(-1)[points])
        # Rows of y: at the leading edge, then at the bristles.
        element = (angle - mesh.mesh.theta_rad[0]) * steady.belt.radius_m / mesh.mesh.length_m
        number = element.astype(np.int64)
        places = mesh.places(COORDINATES)[number][:, 0::2]
        shape = GaussPoints.shapes_at(element - number, mesh.mesh.length_m).T
        rows = np.repeat(np.arange(len(angle))[:, None], 4, axis=1)
        size = COORDINATES * mesh.mesh.count
        entries = (shape.reshape(-1), (rows.reshape(-1), places.reshape(-1)))
        self._feet = coo_array(entries, shape=(len(angle), size)).tocsr()
        self._creep_m = np.tan(slip_rad) * steady.belt.radius_m * (angle - angle[0])
        self.stiffness_n_per_m: Array = sides.tread_npm2 * np.tile(mesh.weight_m, mesh.mesh.count)[points]
        push = steady.push_npm.reshape(-1)[points]
        self._bound_m = sides.friction * push / sides.tread_npm2

    def settled(self, stiffness: csc_array, load: Array) -> tuple[Array, Array]:
        """Return the belt's coordinates and the bristles' deflections in balance."""
        count = len(self._bound_m)
        state, seen = np.zeros(count), set[bytes]()
        on_belt = csc_array(self._feet[1:].T @ diags_array(self.stiffness_n_per_m))
        for _ in range(_PASSES):
            # A sticking bristle follows the road since the last sliding one ahead of it, or the leading edge.
            ahead = np.maximum.accumulate(np.where(state != 0.0, np.arange(1, count + 1), 0))
            sticking = state == 0.0
            held = np.append(0.0, state * self._bound_m)
            selected = np.arange(1, count + 1)
            follow = diags_array(sticking.astype(np.float64)) @ (self._feet[selected] - self._feet[ahead])
            rest = np.where(sticking, held[ahead] + self._creep_m[selected] - self._creep_m[ahead], held[1:])
            coordinates = splu(csc_array(stiffness + on_belt @ follow)).solve(load + on_belt @ rest)
            deflection = rest - follow @ coordinates
            wanted = self._marched(self._feet @ coordinates)
            if np.array_equal(wanted, state):
                return coordinates, deflection
            if wanted.tobytes() in seen:
                # Going round in circles: change only the foremost, on which the others depend.
                first = int(np.flatnonzero(wanted != state)[0])
                wanted = np.concatenate([state[:first], wanted[first : first + 1], state[first + 1 :]])
            seen.add(wanted.tobytes())
            state = wanted
        raise NotSteadyError(f"belt: stick and slip of the tread did not settle in {_PASSES} passes")

    def _marched(self, feet_m: Array) -> Array:
        """Return +1 or -1 for bristles that slide when the feet are where they are, 0 for those that stick."""
        growth = np.diff(self._creep_m - feet_m).tolist()
        state, deflection = np.zeros(len(growth)), 0.0
        for index, (grown, bound) in enumerate(zip(growth, self._bound_m.tolist(), strict=True)):
            deflection += grown
            if abs(deflection) > bound:
                state[index] = 1.0 if deflection > 0.0 else -1.0
                deflection = state[index] * bound
        return state
