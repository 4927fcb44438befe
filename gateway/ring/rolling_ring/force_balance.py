"""Force balance of the geometrically exact rolling ring on a grid of nodes, and its analytic tangent.

Frame: axle at the origin, y up, the belt runs counter-clockwise past it. The node with material angle theta rests at
R (sin theta, -cos theta), so theta = 0 is the lowest point and the belt moves towards +x there. The road is flat or a
drum.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple, TypeVar

import numpy as np

from gateway.core.types import ComplexArray, FloatArray

_Array = TypeVar("_Array", FloatArray, ComplexArray)

QUARTER_TURN: Final = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Rotation by -90 degrees: turns the road's normal into the direction of the belt's motion."""


@dataclass(frozen=True, slots=True)
class BeltLaw:
    """Stiffnesses and loads of one solve, in SI units, derived from `RingParameters` and the conditions.

    Attributes:
        radius_m: R.
        bending_nm2: EI - rho I V^2.
        bending_damping_nm2s: c_b; the moment of a belt that bends at a rate kappa' is c_b kappa'.
        tension_width_m: b; the pressure acts on the belt as p0 b per length.
        radial_npm2: kw, sidewall.
        tangential_npm2: kv, sidewall.
        stiffening_pm: relative growth of kw and kv per metre of deflection.
        radial_damping_nspm2: c_w, sidewall.
        tangential_damping_nspm2: c_v, sidewall.
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
    bending_damping_nm2s: float
    tension_width_m: float
    radial_npm2: float
    tangential_npm2: float
    stiffening_pm: float
    radial_damping_nspm2: float
    tangential_damping_nspm2: float
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
        """Number of unknowns per node: x, y and, for a shear-flexible belt, the turn of its section."""
        return 2 if math.isinf(self.shear_n) else 3

    @property
    def reach(self) -> int:
        """Number of neighbours to either side that a node's balance depends on."""
        return 3 if self.bending_damping_nm2s and self.dof == 2 else 2


class Grid(NamedTuple):
    """Material angles and the resting directions there.

    Attributes:
        step_rad: angle from node to node.
        theta_rad: (N,) from -pi.
        radial: (N, 2) unit vectors outward.
        along: (N, 2) unit vectors in the direction of rotation.
        chord: (N, 2) resting direction of the segment from node i to i + 1.
        outward: (N,) radial as x + i y.
    """

    step_rad: float
    theta_rad: FloatArray
    radial: FloatArray
    along: FloatArray
    chord: FloatArray
    outward: ComplexArray


@lru_cache(maxsize=16)
def ring_grid(nodes: int) -> Grid:
    """Return the grid of `nodes` equal steps, theta = -pi first."""
    step = 2.0 * math.pi / nodes
    theta: FloatArray = -math.pi + step * np.arange(nodes, dtype=np.float64)
    radial = np.stack([np.sin(theta), -np.cos(theta)], axis=1)
    tangent = np.stack([np.cos(theta), np.sin(theta)], axis=1)
    chord = np.stack([np.cos(theta + step / 2), np.sin(theta + step / 2)], axis=1)
    outward = plane(radial)
    for array in (theta, radial, tangent, chord, outward):
        array.setflags(write=False)
    return Grid(step, theta, radial, tangent, chord, outward)


def plane(vectors: FloatArray) -> ComplexArray:
    """Return vectors (N, 2 or more) of the plane as x + i y, (N,): a product turns them."""
    result: ComplexArray = np.ascontiguousarray(vectors[:, :2]).view(np.complex128)[:, 0]
    return result


def _vectors(numbers: ComplexArray) -> FloatArray:
    """Return complex numbers (N,) as vectors (N, 2)."""
    return np.ascontiguousarray(numbers).view(np.float64).reshape(-1, 2)


def following(values: _Array) -> _Array:
    """Return the values of node i + 1 at i."""
    return np.concatenate((values[1:], values[:1]))


def preceding(values: _Array) -> _Array:
    """Return the values of node i - 1 at i."""
    return np.concatenate((values[-1:], values[:-1]))


def outer(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the outer products (N, d, e) of the rows of a (N, d) and b (N, e)."""
    # Column by column: broadcasting over axes this short takes three times as long.
    result = np.empty((len(a), a.shape[1], b.shape[1]))
    for row in range(a.shape[1]):
        for column in range(b.shape[1]):
            np.multiply(a[:, row], b[:, column], out=result[:, row, column])
    return result


class RoadForce(NamedTuple):
    """Force of the road on each node.

    Attributes:
        pressure_npm: (N,) q, force per length of belt along the road's normal, not negative.
        unclipped_npm: (N,) the same before negative values are set to zero; its zeros are the contact edges.
        normal: (N, 2) of the road, towards the tire.
        spread_pm: (N,) curvature of the road over its normal's side, 0 on a flat road.
        force_npm: (N, 2) push per length.
    """

    pressure_npm: FloatArray
    unclipped_npm: FloatArray
    normal: FloatArray
    spread_pm: FloatArray
    force_npm: FloatArray


class RoadSlopes(NamedTuple):
    """Derivatives of the road's force on each node.

    Attributes:
        position: (3, N, 2, 2) derivative of the push of node i by the position of nodes i - 1, i, i + 1.
        height: (N, 2) derivative by the axle height.
        traction: (N, 2) derivative by the traction ratio.
    """

    position: FloatArray
    height: FloatArray
    traction: FloatArray


def road_force(law: BeltLaw, grid: Grid, position: FloatArray, height_m: float, traction: float) -> RoadForce:
    """Return the road's push on the nodes: q = kt penetration + ct d/dt penetration where positive.

    Args:
        law: stiffnesses and conditions.
        grid: the grid.
        position: (N, 2) node positions.
        height_m: height of the axle above the road (above the crown of a drum).
        traction: friction per push, along the belt's motion.
    """
    nodes = len(position)
    if math.isinf(law.drum_radius_m):
        normal, spread = _flat(nodes)
        penetration = -height_m - position[:, 1]
    else:
        side = math.copysign(1.0, law.drum_radius_m)
        from_centre = position + np.array([0.0, height_m + law.drum_radius_m])
        distance = np.hypot(from_centre[:, 0], from_centre[:, 1])
        normal = side * from_centre / distance[:, None]
        # Drum radius minus distance, written without the cancellation of a large drum.
        gap = position[:, 1] + height_m
        excess = position[:, 0] ** 2 + gap * (gap + 2.0 * law.drum_radius_m)
        penetration = -side * excess / (distance + abs(law.drum_radius_m))
        spread = side / distance
    unclipped = law.tread_npm2 * penetration
    rate = _tread_rate(law, grid)
    if rate:
        unclipped += rate * (following(penetration) - preceding(penetration))
    push = np.maximum(unclipped, 0.0)
    direction = normal + traction * (normal @ QUARTER_TURN.T) if traction else normal
    return RoadForce(push, unclipped, normal, spread, push[:, None] * direction)


@lru_cache(maxsize=16)
def _flat(nodes: int) -> tuple[FloatArray, FloatArray]:
    """Return normal (N, 2) and curvature (N,) of a flat road."""
    normal, spread = np.tile([0.0, 1.0], (nodes, 1)), np.zeros(nodes)
    for array in (normal, spread):
        array.setflags(write=False)
    return normal, spread


def _tread_rate(law: BeltLaw, grid: Grid) -> float:
    """Return the damping of the tread over the difference of two nodes' penetrations."""
    return law.tread_damping_nspm2 * law.omega_radps / (2.0 * grid.step_rad)


def road_slopes(law: BeltLaw, grid: Grid, road: RoadForce, traction: float) -> RoadSlopes:
    """Return the derivatives of the road's push; arguments as for `road_force`."""
    nodes, normal = len(road.normal), road.normal
    contact = np.flatnonzero(road.unclipped_npm > 0.0)
    tangent = normal @ QUARTER_TURN.T
    direction = normal + traction * tangent
    d_position, d_height = np.zeros((3, nodes, 2, 2)), np.zeros((nodes, 2))
    push_direction, contact_normal = direction[contact], normal[contact]
    by_position = -law.tread_npm2 * outer(push_direction, contact_normal)
    if road.spread_pm.any():
        # d normal / d position is (I - n n^T) / distance: zero on a flat road.
        traction_map = np.eye(2) + traction * QUARTER_TURN
        spread = (road.pressure_npm * road.spread_pm)[contact, None, None]
        by_position += traction_map @ ((np.eye(2) - outer(contact_normal, contact_normal)) * spread)
    d_position[1, contact] = by_position
    d_height[contact] = by_position[:, :, 1]
    if rate := _tread_rate(law, grid):
        before, after = preceding(normal)[contact], following(normal)[contact]
        d_position[0, contact] = rate * outer(push_direction, before)
        d_position[2, contact] = -rate * outer(push_direction, after)
        d_height[contact] -= rate * push_direction * (after - before)[:, 1:]
    return RoadSlopes(d_position, d_height, road.pressure_npm[:, None] * tangent)


def edge_tread_npm2(law: BeltLaw, road: RoadForce, traction: float) -> FloatArray:
    """Return what the contact's edges, where they are between nodes, add to the derivative by position, (N, 2, 2).

    A node stands for half a step to either side; by the nodes in contact alone a vibration's contact would be up to a
    step too long or too short.
    """
    push = road.unclipped_npm
    # Where the push is level, a node is wholly in contact or not at all.
    step = np.maximum(0.5 * np.abs(following(push) - preceding(push)), 1e-9 * np.abs(push))
    share = np.clip(0.5 + push / (step + 1e-300), 0.0, 1.0)
    direction = road.normal + traction * (road.normal @ QUARTER_TURN.T)
    return law.tread_npm2 * ((push > 0.0) - share)[:, None, None] * outer(direction, road.normal)


class Segments(NamedTuple):
    """The belt between node i and node i + 1.

    Attributes:
        tension_n: (N,).
        tangent: (N,) unit vectors as x + i y.
        stiffness_npm: tension over elongation.
    """

    tension_n: FloatArray
    tangent: ComplexArray
    stiffness_npm: float

    def tension_after_n(self, change: FloatArray) -> FloatArray:
        """Return the tension (N,) after a change of the nodes' positions (N, 2), to first order."""
        displacement = plane(change)
        stretch = (self.tangent.conj() * (following(displacement) - displacement)).real
        tension_n: FloatArray = self.tension_n + self.stiffness_npm * stretch
        return tension_n

    def beyond_n(self, held: Held) -> FloatArray:
        """Return the tension (N,) beyond a held one, of the same stretch in segments as stiff as those nearby."""
        excess_n: FloatArray = (held.near.stiffness_npm / self.stiffness_npm) * (self.tension_n - held.tension_n)
        return excess_n


class Balance(NamedTuple):
    """Residual and tangent of the whole ring.

    Attributes:
        residual: (N, d) unbalanced force of each node (and unbalanced moment of its section).
        blocks: (2 r + 1, N, d, d) derivative of the residual of node i by the unknowns of node i + o - r.
        columns: (m, N, d) derivative by the axle height (and the traction).
        rows: (m, N, d) derivative of the load (and torque) equation.
        corner: (m, m) derivative of the load (and torque) equation by the axle height (and the traction).
        border: (m,) residual of the load (and torque) equation.
        road: the road's push.
        slopes: its derivatives.
        segments: the belt between the nodes.
    """

    residual: FloatArray
    blocks: FloatArray
    columns: FloatArray
    rows: FloatArray
    corner: FloatArray
    border: FloatArray
    road: RoadForce
    slopes: RoadSlopes
    segments: Segments


def belt_balance(
    law: BeltLaw, grid: Grid, state: FloatArray, height_m: float, traction: float, tension_n: FloatArray | None = None
) -> Balance:
    """Return the force balance of every node.

    Args:
        law: stiffnesses and conditions.
        grid: the grid.
        state: (N, d) x, y and, for a shear-flexible belt, the section's extra turn.
        height_m: height of the axle above the road.
        traction: friction per push.
        tension_n: (N,) that turns with the belt in the derivatives; None for the one that the nodes' distances give.
    """
    blocks = np.zeros((2 * law.reach + 1, len(state), law.dof, law.dof))
    road = road_force(law, grid, state[:, :2], height_m, traction)
    slopes = road_slopes(law, grid, road, traction)
    residual, segments = _belt_residual(law, grid, state, road, blocks, tension_n)
    length = law.radius_m * grid.step_rad
    blocks[law.reach - 1 : law.reach + 2, :, :2, :2] += length * slopes.position
    columns, rows, corner = _border(law, grid, state[:, :2], road, slopes)
    border = _border_residual(law, grid, state[:, :2], road)
    return Balance(residual, blocks, columns, rows, corner, border, road, slopes, segments)


class Held(NamedTuple):
    """A tension that is an unknown of its own, with the segments of a ring nearby whose tangent stiffness is used.

    The belt hardly stretches: turned by little, its length is off by the square of the turn, and so much more the
    tension that follows from it. What that tension has beyond the held one acts along the segments nearby.

    Attributes:
        tension_n: (N,).
        near: of the ring nearby.
    """

    tension_n: FloatArray
    near: Segments


def imbalance(
    law: BeltLaw, grid: Grid, state: FloatArray, height_m: float, traction: float, held: Held | None = None
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return `residual` and `border` of the balance alone, and the tension beyond the held one, (N,).

    Args:
        law: as for `belt_balance`, like the next.
        grid: the grid.
        state: of the nodes.
        height_m: of the axle.
        traction: friction per push.
        held: tension; None for that which the nodes' distances give.
    """
    road = road_force(law, grid, state[:, :2], height_m, traction)
    residual, segments = _belt_residual(law, grid, state, road, held=held)
    excess_n = segments.beyond_n(held) if held is not None else np.zeros(len(state))
    return residual, _border_residual(law, grid, state[:, :2], road), excess_n


def _belt_residual(
    law: BeltLaw,
    grid: Grid,
    state: FloatArray,
    road: RoadForce,
    blocks: FloatArray | None = None,
    tension_n: FloatArray | None = None,
    held: Held | None = None,
) -> tuple[FloatArray, Segments]:
    """Return the residual and the segments; add the derivatives to `blocks`, but for those of the road's push."""
    residual = np.zeros((len(state), law.dof))
    position = plane(state)
    force, segments = _belt_force(law, grid, position, state, residual, blocks, tension_n, held)
    force += _pressure_and_inertia(law, grid, position, blocks)
    force -= _sidewall_pull(law, grid, position, blocks)
    force += law.radius_m * grid.step_rad * plane(road.force_npm)
    residual[:, :2] = _vectors(force)
    return residual, segments


def segment_turn(grid: Grid, along: FloatArray) -> FloatArray:
    """Return (N,) the angle of each segment's direction `along` (N, 2) from its resting direction."""
    cross = grid.chord[:, 0] * along[:, 1] - grid.chord[:, 1] * along[:, 0]
    angle: FloatArray = np.arctan2(cross, grid.chord[:, 0] * along[:, 0] + grid.chord[:, 1] * along[:, 1])
    return angle


def _belt_force(
    law: BeltLaw,
    grid: Grid,
    position: ComplexArray,
    state: FloatArray,
    residual: FloatArray,
    blocks: FloatArray | None,
    turning_n: FloatArray | None,
    held: Held | None,
) -> tuple[ComplexArray, Segments]:
    """Return F_i - F_(i-1), F = N t + V n by tension, bending and shear, (N,); add the moments to the residual."""
    h, radius = grid.step_rad, law.radius_m
    chord = 2.0 * radius * math.sin(h / 2)
    span = following(position) - position
    length = np.abs(span)
    tension = stretched_tension_n(law, grid, length / chord - 1.0)
    direction = span / length
    angle = segment_turn(grid, _vectors(span))
    stiffness = law.bending_nm2 / (radius * h)
    # Of a quantity that passes with the belt: its rate over its size, by central differences.
    rate = law.bending_damping_nm2s / law.bending_nm2 * law.omega_radps / (2.0 * h)
    if law.dof == 2:
        moment = stiffness * (angle - preceding(angle))
        if rate:
            moment = moment + rate * (following(moment) - preceding(moment))
        shear = (moment - following(moment)) / length
        shear_slope = 2.0 * stiffness / length
    else:
        section = state[:, 2]
        slip = angle - 0.5 * (section + following(section))
        shear = law.shear_n * chord * slip / length
        shear_slope = law.shear_n * chord / length
        couple = law.shear_n * chord * slip
        bending = stiffness * (following(section) - section)
        if rate:
            bending = bending + rate * (following(bending) - preceding(bending))
        residual[:, 2] += bending - preceding(bending) + 0.5 * (couple + preceding(couple))
    segments = Segments(tension, direction, law.extension_n / chord)
    if held is None:
        force = (tension + 1j * shear) * direction
    else:
        force = (held.tension_n + 1j * shear) * direction + segments.beyond_n(held) * held.near.tangent
    total = force - preceding(force)
    if blocks is None:
        return total, segments
    turning = tension if turning_n is None else turning_n
    tangent, normal = _vectors(direction), _vectors(1j * direction)
    turn_by = normal / length[:, None]  # derivative of a segment's turn by its span
    segment_block = (
        segments.stiffness_npm * outer(tangent, tangent)
        + outer(turning[:, None] * normal - shear[:, None] * tangent + shear_slope[:, None] * normal, turn_by)
        - outer((shear / length)[:, None] * normal, tangent)
    )
    _add_by_span(blocks, 0, segment_block)
    if law.dof == 2:
        # V_i by the turn of segment i + o, times the length.
        damped = stiffness * rate
        by_turn = {-1: -stiffness - 2.0 * damped, 1: -stiffness + 2.0 * damped}
        if rate:
            by_turn |= {-2: damped, 2: -damped}
        for offset, slope in by_turn.items():
            _add_by_span(blocks, offset, outer((slope / length)[:, None] * normal, np.roll(turn_by, -offset, axis=0)))
        return total, segments
    by_span = 0.5 * law.shear_n * chord * turn_by
    blocks[3, :, 2, :2] += by_span
    blocks[2, :, 2, :2] += preceding(by_span) - by_span
    blocks[1, :, 2, :2] -= preceding(by_span)
    quarter = 0.25 * law.shear_n * chord
    # The rate of the couples' difference is that of the sections' second difference, over two nodes each way.
    blocks[4, :, 2, 2] += stiffness * rate
    blocks[3, :, 2, 2] += stiffness - quarter - 2.0 * stiffness * rate
    blocks[2, :, 2, 2] -= 2.0 * (stiffness + quarter)
    blocks[1, :, 2, 2] += stiffness - quarter + 2.0 * stiffness * rate
    blocks[0, :, 2, 2] -= stiffness * rate
    by_section = -0.5 * (law.shear_n * chord / length)[:, None] * normal  # F_i by the section of node i and of i + 1
    blocks[3, :, :2, 2] += by_section
    blocks[2, :, :2, 2] += by_section - preceding(by_section)
    blocks[1, :, :2, 2] -= preceding(by_section)
    return total, segments


def belt_tension_n(law: BeltLaw, grid: Grid, state: FloatArray) -> FloatArray:
    """Return the tension (N,) that the distances of the nodes give."""
    return stretched_tension_n(law, grid, belt_stretch(law.radius_m, state))


def belt_stretch(radius_m: float, state: FloatArray) -> FloatArray:
    """Return the elongation (N,) of each segment over its length at rest."""
    position, chord = plane(state), 2.0 * radius_m * math.sin(math.pi / len(state))
    stretch: FloatArray = np.abs(following(position) - position) / chord - 1.0
    return stretch


def stretched_tension_n(law: BeltLaw, grid: Grid, stretch: FloatArray) -> FloatArray:
    """Return the tension of segments that are stretched by a share (N,)."""
    h, radius = grid.step_rad, law.radius_m
    # Exact pretension of the grid, so that the resting polygon balances pressure and transport inertia to rounding.
    spin = law.mass_kgpm * (radius * law.omega_radps) ** 2
    pretension = law.pressure_pa * law.tension_width_m * radius * math.cos(h / 2) + spin * 2.0 * math.sin(h / 2) / h
    result: FloatArray = pretension + law.extension_n * stretch
    return result


def _central_blocks(blocks: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the views of the derivatives by the positions of the previous, this and the next node, (N, 2, 2) each."""
    centre = len(blocks) // 2
    return blocks[centre - 1, :, :2, :2], blocks[centre, :, :2, :2], blocks[centre + 1, :, :2, :2]


def _add_by_span(blocks: FloatArray, offset: int, slope: FloatArray) -> None:
    """Add what F_i - F_(i-1) gains when F_i changes by slope (N, 2, 2) times span_(i+o) = X_(i+o+1) - X_(i+o)."""
    flat = blocks[:, :, :2, :2]
    index = len(blocks) // 2 + offset
    previous = preceding(slope)
    flat[index + 1] += slope
    flat[index] -= slope + previous
    flat[index - 1] += previous


def _pressure_and_inertia(law: BeltLaw, grid: Grid, position: ComplexArray, blocks: FloatArray | None) -> ComplexArray:
    """Return the pressure, which follows the belt's normal, minus the belt's transport inertia, (N,)."""
    subsequent, previous = following(position), preceding(position)
    push = 0.5 * law.pressure_pa * law.tension_width_m
    inertia = law.mass_kgpm * law.radius_m * law.omega_radps**2 / grid.step_rad
    if blocks is not None:
        before, centre, after = _central_blocks(blocks)
        after += push * QUARTER_TURN - inertia * np.eye(2)
        centre += 2.0 * inertia * np.eye(2)
        before -= push * QUARTER_TURN + inertia * np.eye(2)
    result: ComplexArray = (-1j * push) * (subsequent - previous) - inertia * (subsequent - 2.0 * position + previous)
    return result


def _sidewall_pull(law: BeltLaw, grid: Grid, position: ComplexArray, blocks: FloatArray | None) -> ComplexArray:
    """Return the pull (N,) of the elastic foundation; it stiffens with deflection and is damped in the rim's frame."""
    length = law.radius_m * grid.step_rad
    deflection = position * grid.outward.conj() - law.radius_m
    pulls = []
    for u, stiffness, damping, axis in (
        (deflection.real, law.radial_npm2, law.radial_damping_nspm2, grid.radial),
        (deflection.imag, law.tangential_npm2, law.tangential_damping_nspm2, grid.along),
    ):
        rate = damping * law.omega_radps / (2.0 * grid.step_rad)
        growth = law.stiffening_pm * np.abs(u) if law.stiffening_pm else np.zeros(len(u))
        pull = stiffness * u * (1.0 + growth)
        if rate:
            pull = pull + rate * (following(u) - preceding(u))
        pulls.append(pull)
        if blocks is None:
            continue
        before, centre, after = _central_blocks(blocks)
        centre -= length * (stiffness * (1.0 + 2.0 * growth))[:, None, None] * outer(axis, axis)
        if rate:
            after -= length * rate * outer(axis, following(axis))
            before += length * rate * outer(axis, preceding(axis))
    result: ComplexArray = length * (pulls[0] + 1j * pulls[1]) * grid.outward
    return result


def _border_residual(law: BeltLaw, grid: Grid, position: FloatArray, road: RoadForce) -> FloatArray:
    """Return the residual of the load equation and, with friction, of the torque equation."""
    length = law.radius_m * grid.step_rad
    load = length * float(road.force_npm[:, 1].sum()) - law.load_n
    if law.torque_nm is None:
        return np.array([load])
    return np.array([load, length * float(np.einsum("ia,ia->", _lever(position), road.force_npm)) + law.torque_nm])


def _lever(position: FloatArray) -> FloatArray:
    """Return (N, 2) the torque about the axle of a unit force on each node."""
    return np.stack([-position[:, 1], position[:, 0]], axis=1)


def _border(
    law: BeltLaw, grid: Grid, position: FloatArray, road: RoadForce, slopes: RoadSlopes
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the border: axle height for the load equation and, with friction, traction for the torque equation."""
    nodes = len(position)
    length = law.radius_m * grid.step_rad
    by_height, by_traction = length * slopes.height, length * slopes.traction
    # Derivative of sum over i of weight_i . push_i by the position of node j.
    size = 1 if law.torque_nm is None else 2
    columns = np.zeros((size, nodes, law.dof))
    rows = np.zeros((size, nodes, law.dof))
    weights = [np.broadcast_to(np.array([0.0, 1.0]), (nodes, 2))]
    columns[0, :, :2] = by_height
    if law.torque_nm is not None:
        weights.append(_lever(position))
        columns[1, :, :2] = by_traction
        rows[1, :, 0] = length * road.force_npm[:, 1]
        rows[1, :, 1] = -length * road.force_npm[:, 0]
    corner = np.zeros((size, size))
    for k, weight in enumerate(weights):
        for offset in (-1, 0, 1):
            weighted_push = np.einsum("ia,iab->ib", weight, slopes.position[offset + 1])
            if offset == 0:
                rows[k, :, :2] += length * weighted_push
            else:
                rows[k, :, :2] += length * (preceding(weighted_push) if offset > 0 else following(weighted_push))
        corner[k, 0] = np.einsum("ia,ia->", weight, by_height)
        if size == 2:
            corner[k, 1] = np.einsum("ia,ia->", weight, by_traction)
    return columns, rows, corner
