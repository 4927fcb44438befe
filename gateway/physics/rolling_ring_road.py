"""What goes into a solve of the rolling ring (stiffnesses, grid) and how a road, flat or a drum, pushes on its tread.

Axle at the origin, y up, the belt runs counter-clockwise past it: the node with material angle theta rests at
R (sin theta, -cos theta), so theta = 0 is the lowest point and the belt moves towards +x there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gateway.types import FloatArray


@dataclass(frozen=True, slots=True)
class BeltLaw:
    """Stiffnesses and loads of one solve, SI; what `RingParameters` and the conditions come down to.

    Attributes:
        radius_m: R.
        bending_nm2: EI - rho I V^2.
        tension_width_m: b; the pressure acts on the belt as p0 b per length.
        radial_npm2: kw, sidewall.
        tangential_npm2: kv, sidewall.
        stiffening_pm: relative growth of kw and kv per metre of deflection.
        damping_nspm2: sidewall damping, radial and tangential.
        mass_kgpm: rho A.
        extension_n: EA.
        shear_n: GA; infinity for a belt that keeps its sections square.
        tread_npm2: kt.
        tread_damping_nspm2: ct.
        pressure_pa: p0.
        omega_radps: angular speed.
        load_n: Q.
        drum_radius_m: of the road, positive for an outer drum, negative for an inner one, infinite for a flat road.
        torque_nm: driving torque at the axle, None for a road without friction.
    """

    radius_m: float
    bending_nm2: float
    tension_width_m: float
    radial_npm2: float
    tangential_npm2: float
    stiffening_pm: float
    damping_nspm2: float
    mass_kgpm: float
    extension_n: float
    shear_n: float
    tread_npm2: float
    tread_damping_nspm2: float
    pressure_pa: float
    omega_radps: float
    load_n: float
    drum_radius_m: float
    torque_nm: float | None

    @property
    def dof(self) -> int:
        """Unknowns of a node: x, y and, for a shear-flexible belt, the turn of its section."""
        return 2 if math.isinf(self.shear_n) else 3


class Grid(NamedTuple):
    """Material angles and the resting directions there.

    Attributes:
        step_rad: angle from node to node.
        theta_rad: (N,) from -pi.
        radial: (N, 2) unit vectors outward.
        along: (N, 2) unit vectors in the direction of rotation.
        chord: (N, 2) resting direction of the segment from node i to i + 1.
    """

    step_rad: float
    theta_rad: FloatArray
    radial: FloatArray
    along: FloatArray
    chord: FloatArray


@lru_cache(maxsize=16)
def ring_grid(nodes: int) -> Grid:
    """Return the grid of `nodes` equal steps, theta = -pi first."""
    step = 2.0 * math.pi / nodes
    theta: FloatArray = -math.pi + step * np.arange(nodes, dtype=np.float64)
    radial = np.stack([np.sin(theta), -np.cos(theta)], axis=1)
    along = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    chord = np.stack([np.cos(theta + step / 2), np.sin(theta + step / 2)], axis=1)
    for shared in (theta, radial, along, chord):
        shared.setflags(write=False)
    return Grid(step, theta, radial, along, chord)


def following(values: FloatArray) -> FloatArray:
    """Return the values of node i + 1 at i."""
    return np.roll(values, -1, axis=0)


def preceding(values: FloatArray) -> FloatArray:
    """Return the values of node i - 1 at i."""
    return np.roll(values, 1, axis=0)


def outer(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the outer products (N, d, e) of the rows of a (N, d) and b (N, e)."""
    return a[:, :, None] * b[:, None, :]


class RoadPush(NamedTuple):
    """What the road does to each node.

    Attributes:
        pressure_npm: (N,) q, force per length of belt along the road's normal, not negative.
        unclipped_npm: (N,) the same before negative values are set to zero; its zeros are the contact edges.
        force_npm: (N, 2) push per length.
        d_position: (3, N, 2, 2) derivative of the push of node i by the position of nodes i - 1, i, i + 1.
        d_height: (N, 2) derivative by the axle height.
        d_traction: (N, 2) derivative by the traction ratio.
    """

    pressure_npm: FloatArray
    unclipped_npm: FloatArray
    force_npm: FloatArray
    d_position: FloatArray
    d_height: FloatArray
    d_traction: FloatArray


QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])


def road_push(law: BeltLaw, grid: Grid, position: FloatArray, height_m: float, traction: float) -> RoadPush:
    """Return the road's push on the nodes: q = kt penetration + ct d/dt penetration where positive.

    Args:
        law: stiffnesses and conditions.
        grid: the grid.
        position: (N, 2) node positions.
        height_m: height of the axle above the road (above the crown of a drum).
        traction: friction per push, along the belt's motion.
    """
    nodes = len(position)
    normal = np.zeros((nodes, 2))
    if math.isinf(law.drum_radius_m):
        normal[:, 1] = 1.0
        penetration = -height_m - position[:, 1]
        spread = np.zeros(nodes)
    else:
        side = math.copysign(1.0, law.drum_radius_m)
        from_centre = position + np.array([0.0, height_m + law.drum_radius_m])
        distance = np.hypot(from_centre[:, 0], from_centre[:, 1])
        normal = side * from_centre / distance[:, None]
        # drum radius - distance, without the cancellation that a large drum would bring.
        gap = position[:, 1] + height_m
        excess = position[:, 0] ** 2 + gap * (gap + 2.0 * law.drum_radius_m)
        penetration = -side * excess / (distance + abs(law.drum_radius_m))
        spread = side / distance
    rate = law.tread_damping_nspm2 * law.omega_radps / (2.0 * grid.step_rad)
    push = law.tread_npm2 * penetration
    if rate:
        push = push + rate * (following(penetration) - preceding(penetration))
    touching = push > 0.0
    unclipped, push = push, np.where(touching, push, 0.0)
    along = normal @ QUARTER_TURN.T
    direction = normal + traction * along
    # d normal / d position is (I - n n^T) / distance: zero on a flat road.
    turn = np.eye(2) + traction * QUARTER_TURN
    bend = np.einsum("ab,ibc->iac", turn, (np.eye(2) - outer(normal, normal)) * (push * spread)[:, None, None])
    active = np.where(touching, 1.0, 0.0)[:, None]
    d_position = np.zeros((3, nodes, 2, 2))
    d_position[1] = bend - law.tread_npm2 * outer(active * direction, normal)
    d_height = bend[:, :, 1] - law.tread_npm2 * active * direction * normal[:, 1:]
    if rate:
        d_position[0] = rate * outer(active * direction, preceding(normal))
        d_position[2] = -rate * outer(active * direction, following(normal))
        d_height = d_height - rate * active * direction * (following(normal) - preceding(normal))[:, 1:]
    return RoadPush(push, unclipped, push[:, None] * direction, d_position, d_height, push[:, None] * along)
