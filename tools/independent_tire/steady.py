"""A belt that rolls steadily: that of `rolling` where nothing changes, seen from the road, in a second and not minutes.

A material point passes the shape X(theta) once a revolution, so its rates are the speed times derivatives along the
belt. The strain energy is that of exudyn's ANCFCable2D.
"""

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, csr_matrix
from scipy.sparse.linalg import splu

from independent_tire.elements import COORDINATES, QUARTER_TURN, Array, BeltMatrices, GaussPoints, Mesh, belt_matrices
from independent_tire.rolling import Belt
from independent_tire.sensor import Signals

_GAUSS: Final = 4
_ITERATIONS: Final = 60
# The belt is lowered in so many parts of its sinking before the load is asked for.
_LOWERINGS: Final = 4
# Of one step of Newton's iteration, over the radius.
_LARGEST_STEP: Final = 0.02
# Largest force out of balance, over that of the pressure on an element; of load and traction, over the load.
_BALANCED: Final = 1e-6
_CARRIED: Final = 1e-7
# As in `rolling`.
_REACH_RAD: Final = 0.8
_GROWS_OVER_M: Final = 1e-4


class NotSteadyError(ArithmeticError):
    """The belt has no equilibrium, or it was not reached."""


@dataclass(frozen=True)
class SteadyMesh:
    """A mesh with what steady rolling needs of it.

    Attributes:
        mesh: of the belt.
        at: (p,) Gauss points of an element, 0 to 1.
        weight_m: (p,) their lengths.
    """

    mesh: Mesh
    at: Array
    weight_m: Array

    @cached_property
    def gauss(self) -> GaussPoints:
        """The points of all elements."""
        return GaussPoints(self.mesh, self.at, self.weight_m)

    @cached_property
    def matrices(self) -> BeltMatrices:
        """Of pressure, sidewall and mass."""
        return belt_matrices(self.mesh)

    @cached_property
    def passing(self) -> csr_matrix:
        """Inertia of the passing belt, (4 N, 4 N), per unit of mass per length and speed squared."""
        return self.gauss.form(self.gauss.slope, np.eye(2), self.gauss.slope)

    @cached_property
    def stretching(self) -> csr_matrix:
        """Sidewall damping, (4 N, 4 N), per unit of damping per length and speed: du/ds less the rim's turning."""
        gauss = self.gauss
        turning = gauss.form(gauss.shape, QUARTER_TURN, gauss.shape) / self.mesh.radius_m
        return csr_matrix(gauss.form(gauss.shape, np.eye(2), gauss.slope) - turning)

    @cached_property
    def shapes(self) -> Array:
        """(3, p, 4) shape functions, their first and second derivatives by length."""
        x, length = self.at, self.mesh.length_m
        bends = np.stack([(12 * x - 6) / length, 6 * x - 4, (6 - 12 * x) / length, 6 * x - 2]) / length
        return np.stack([self.gauss.values, self.gauss.slopes, bends]).transpose(0, 2, 1)

    @cached_property
    def theta_rad(self) -> Array:
        """(N, p) angles of the points."""
        return self.gauss.theta_rad.reshape(self.mesh.count, -1)

    def local(self, values: Array) -> Array:
        """Return (N, 4, k) place and slope at both nodes of each element, of (N, 2 k) or (2 k N,) coordinates."""
        nodes = values.reshape(self.mesh.count, 2, -1)
        return np.concatenate([nodes, np.roll(nodes, -1, axis=0)], axis=1)

    def places(self, per_node: int) -> NDArray[np.int64]:
        """Return (N, 2 per_node) numbers of the coordinates of each element."""
        first: NDArray[np.int64] = per_node * np.arange(self.mesh.count)[:, None] + np.arange(per_node)
        return np.concatenate([first, np.roll(first, -1, axis=0)], axis=1)

    def gathered(self, forces: Array) -> Array:
        """Return forces on the coordinates of the belt, (4 N,), of those on each element, (N, 8)."""
        total: Array = np.bincount(
            self.places(COORDINATES).reshape(-1), forces.reshape(-1), COORDINATES * self.mesh.count
        ).astype(np.float64)
        return total

    def assembled(self, blocks: Array, places: NDArray[np.int64]) -> csc_array:
        """Return the sparse matrix of (N, m, m) blocks."""
        rows, columns = (np.broadcast_to(p, blocks.shape).reshape(-1) for p in (places[:, :, None], places[:, None]))
        size = places.max() + 1
        return csc_array(coo_array((blocks.reshape(-1), (rows, columns)), shape=(size, size)))


@lru_cache(maxsize=4)
def steady_mesh(elements: int, radius_m: float) -> SteadyMesh:
    """Return the mesh of a belt."""
    mesh = Mesh(elements, radius_m)
    position, weight = np.polynomial.legendre.leggauss(_GAUSS)
    return SteadyMesh(mesh, 0.5 * (position + 1.0), 0.5 * weight * mesh.length_m)


@dataclass(frozen=True, slots=True, eq=False)
class SteadyBelt:
    """A steadily rolling belt, the axle at the origin and the road below.

    Attributes:
        belt: its parameters.
        push_n: vertical force of the road, the load.
        drag_n: its force along the belt's motion.
        coordinates: (4 N,) of the nodes at theta = -pi + 2 pi i / N.
        height_m: of the axle above the road.
        road_share: speed of the road over that of the belt at rest on the rim.
        curvature_pm: (N, p) curvature at the Gauss points.
        tension_n: (N, p) axial force there without its centrifugal part.
        push_npm: (N, p) of the road there, 0 off the contact.
        edges_rad: leading and trailing contact angle.
    """

    belt: Belt
    push_n: float
    drag_n: float
    coordinates: Array
    height_m: float
    road_share: float
    curvature_pm: Array
    tension_n: Array
    push_npm: Array
    edges_rad: tuple[float, float]

    @property
    def mesh(self) -> SteadyMesh:
        """The mesh."""
        return steady_mesh(self.belt.elements, self.belt.radius_m)

    def signals(self, offset_m: float) -> Signals:
        """Return the parts of the signal of a sensor `offset_m` below the middle line, (N,) over the nodes' angles."""
        slope = self.coordinates.reshape(-1, COORDINATES)[:, 2:] @ np.array([1.0, 1.0j])
        along = slope / np.abs(slope)
        inward = 1j * along
        velocity = self.belt.radius_m * slope + offset_m * turned(inward)
        acceleration = turned(velocity)
        spin = velocity - self.belt.radius_m
        return Signals(
            radial_m=(acceleration * inward.conj()).real,
            circumferential_m=(acceleration * along.conj()).real,
            gravity_radial=inward.imag.copy(),
            gravity_circumferential=along.imag.copy(),
            spin_radial_m=(spin * inward.conj()).real,
            spin_circumferential_m=(spin * along.conj()).real,
        )


def turned(values: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the derivative by the angle of a periodic curve (N,), N even."""
    order = np.fft.fftfreq(len(values), 1.0 / len(values))
    order[len(values) // 2] = 0.0
    derivative: NDArray[np.complex128] = np.fft.ifft(1j * order * np.fft.fft(values))
    return derivative


def roll_steadily(belt: Belt, load_n: float, start: SteadyBelt | None = None) -> SteadyBelt:
    """Return the equilibrium of a belt that rolls on a flat road.

    Args:
        belt: without blocks, drum and damping of its bending; its sinking is where the search begins.
        load_n: vertical load.
        start: a solution nearby of the same mesh.

    Raises:
        NotSteadyError: Newton's iteration did not settle.
    """
    mesh = steady_mesh(belt.elements, belt.radius_m)
    linear = _linear(belt, mesh)
    if start is not None:
        state = _State(start.coordinates, start.height_m, start.road_share)
    else:
        state = _State(mesh.mesh.resting, belt.radius_m, 1.0)
        for lowering in range(1, _LOWERINGS + 1):
            height_m = belt.radius_m - belt.sinking_m * lowering / _LOWERINGS
            state = _balanced(belt, mesh, linear, _State(state.coordinates, height_m, state.road_share), None)
    state = _balanced(belt, mesh, linear, state, load_n)
    road = _Road(belt, mesh, state)
    slope, bend = _derivatives(mesh, state.coordinates)
    length = np.hypot(slope[..., 0], slope[..., 1])
    return SteadyBelt(
        belt=belt,
        push_n=road.push_n,
        drag_n=road.drag_n,
        coordinates=state.coordinates,
        height_m=state.height_m,
        road_share=state.road_share,
        curvature_pm=(slope[..., 0] * bend[..., 1] - slope[..., 1] * bend[..., 0]) / length**2,
        tension_n=belt.pressure_pa * belt.tension_width_m * belt.radius_m + belt.extension_n * (length - 1.0),
        push_npm=road.push_npm,
        edges_rad=road.edges_rad,
    )


@dataclass(frozen=True, slots=True)
class _State:
    coordinates: Array
    height_m: float
    road_share: float


def _linear(belt: Belt, mesh: SteadyMesh) -> tuple[csc_array, Array]:
    """Return the stiffness of sidewall, pressure and rotation, (4 N, 4 N), and the sidewall's force at zero."""
    matrices, speed = mesh.matrices, belt.speed_mps
    sidewall = belt.radial_npm2 * matrices.radial + belt.tangential_npm2 * matrices.along
    sidewall = sidewall + belt.sidewall_damping_nspm2 * speed * mesh.stretching
    passing = belt.mass_kgpm * speed**2 * mesh.passing
    pressed = belt.pressure_pa * belt.tension_width_m * matrices.area
    return csc_array(sidewall - passing - pressed), np.asarray(sidewall @ mesh.mesh.resting)


def _balanced(
    belt: Belt, mesh: SteadyMesh, linear: tuple[csc_array, Array], state: _State, load_n: float | None
) -> _State:
    """Return the balanced state under a load; without one, at the given height and speed of the road."""
    stiffness, offset = linear
    places = mesh.places(COORDINATES)
    scale_n = belt.pressure_pa * belt.tension_width_m * mesh.mesh.length_m
    for _ in range(_ITERATIONS):
        force, blocks = _elastic(belt, mesh, state.coordinates)
        road = _Road(belt, mesh, state)
        lacking = offset + road.force - stiffness @ state.coordinates - force
        missing: Array = np.zeros(2)
        if load_n is not None:
            missing = np.array([load_n - road.push_n, -belt.traction * load_n - road.drag_n])
            missing[1] *= belt.friction > 0.0
        if np.abs(lacking).max() < _BALANCED * scale_n and np.abs(missing).max() <= _CARRIED * (load_n or 1.0):
            return state
        factor = splu(csc_array(stiffness + mesh.assembled(blocks + road.blocks, places)))
        change: Array = factor.solve(lacking)
        moved: Array = np.zeros(2)
        if load_n is not None:
            # Push and drag by height and speed of the road, after the belt has given way.
            yielding = factor.solve(road.force_by)
            answer = road.sums_by + road.sums_by_coordinates @ yielding
            missing = missing - road.sums_by_coordinates @ change
            if belt.friction:
                moved = np.linalg.solve(answer, missing).astype(np.float64)
            else:
                moved[0] = missing[0] / answer[0, 0]
            change = change + yielding @ moved
        shifts = change.reshape(-1, 2, 2)[:, 0]
        share = min(1.0, _LARGEST_STEP * belt.radius_m / max(float(np.abs(shifts).max()), abs(float(moved[0])), 1e-12))
        state = _State(
            state.coordinates + share * change,
            state.height_m + share * float(moved[0]),
            state.road_share + share * float(moved[1]),
        )
    raise NotSteadyError(f"belt {belt.name} found no equilibrium in {_ITERATIONS} iterations")


def _derivatives(mesh: SteadyMesh, coordinates: Array) -> tuple[Array, Array]:
    """Return first and second derivatives by length at the points, (N, p, 2)."""
    local = mesh.local(coordinates)
    return mesh.shapes[1] @ local, mesh.shapes[2] @ local


def _elastic(belt: Belt, mesh: SteadyMesh, coordinates: Array) -> tuple[Array, Array]:
    """Return the force of stretching and bending on the coordinates, (4 N,), and its derivative, (N, 8, 8)."""
    strains = np.concatenate(_derivatives(mesh, coordinates), axis=-1).astype(np.complex128)
    gradient = _energy_gradient(belt, strains).real
    # The gradient is analytic: a step along the imaginary axis gives its derivative without cancellation.
    step = 1e-30
    hessian = np.stack([_energy_gradient(belt, strains + 1j * step * unit).imag / step for unit in np.eye(4)], axis=-1)
    points = mesh.shapes.shape[1]
    by_local = np.zeros((points, 4, 8))
    for axis in range(2):
        by_local[:, axis, axis::2] = mesh.shapes[1]
        by_local[:, 2 + axis, axis::2] = mesh.shapes[2]
    force = np.einsum("p,pai,npa->ni", mesh.weight_m, by_local, gradient, optimize=True)
    blocks = np.einsum("p,pai,npab,pbj->nij", mesh.weight_m, by_local, hessian, by_local, optimize=True)
    return mesh.gathered(force), blocks


def _energy_gradient(belt: Belt, strains: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the derivative of the energy per length by (x', y', x'', y''), (..., 4).

    The circle of the rolling, unloaded belt carries the tension of pressure and rotation and no moment.
    """
    x, y, xx, yy = np.moveaxis(strains, -1, 0)
    square = x * x + y * y
    length = np.sqrt(square)
    rest_n = belt.pressure_pa * belt.tension_width_m * belt.radius_m + belt.mass_kgpm * belt.speed_mps**2
    pull = (rest_n + belt.extension_n * (length - 1.0)) / length
    curvature = (x * yy - y * xx) / square
    moment = belt.bending_nm2 * (curvature - 1.0 / belt.radius_m) / square
    return np.stack(
        [
            pull * x + moment * (yy - 2.0 * curvature * x),
            pull * y - moment * (xx + 2.0 * curvature * y),
            -moment * y,
            moment * x,
        ],
        axis=-1,
    )


class _Road:
    """The road's force on a steady belt, and its derivatives.

    Attributes:
        force: (4 N,) on the coordinates.
        blocks: (N, 8, 8) minus its derivative by the coordinates.
        force_by: (4 N, 2) derivative by the axle's height and the road's speed.
        push_n: sum along the vertical.
        drag_n: sum along the belt's motion.
        sums_by: (2, 2) derivatives of both by height and speed of the road, the belt held.
        sums_by_coordinates: (2, 4 N) likewise by the coordinates.
        push_npm: (N, p) push on the points.
        edges_rad: of the contact.
    """

    def __init__(self, belt: Belt, mesh: SteadyMesh, state: _State) -> None:
        local = mesh.local(state.coordinates)
        position, slope = mesh.shapes[0] @ local, mesh.shapes[1] @ local
        speed = belt.speed_mps
        depth = -position[..., 1] - state.height_m
        grown = np.clip(depth / _GROWS_OVER_M, 0.0, 1.0)
        sinking = -speed * slope[..., 1]
        unclipped = belt.tread_npm2 * depth + belt.tread_damping_nspm2 * grown * sinking
        touching = (unclipped > 0.0) & (np.abs(mesh.theta_rad) < _REACH_RAD)
        push = np.where(touching, unclipped, 0.0)
        growing = np.where((grown > 0.0) & (grown < 1.0), belt.tread_damping_nspm2 * sinking / _GROWS_OVER_M, 0.0)
        by_depth = np.where(touching, belt.tread_npm2 + growing, 0.0)
        by_sinking = np.where(touching, belt.tread_damping_nspm2 * grown, 0.0)
        held = np.tanh((slope[..., 0] - state.road_share) / belt.slip_scale)
        sliding = belt.friction * push * (1.0 - held**2) / belt.slip_scale
        direction = np.stack([-belt.friction * held, np.ones_like(held)], axis=-1)
        weight, values, slopes = mesh.weight_m, mesh.shapes[0], mesh.shapes[1]
        force = np.einsum("p,np,npa,pk->nka", weight, push, direction, values)
        # Derivatives of the force on a point by (y, x', y'), (N, p, 2, 3).
        by = np.zeros((*push.shape, 2, 3))
        by[..., 0] = -by_depth[..., None] * direction
        by[..., 2] = -speed * by_sinking[..., None] * direction
        by[..., 0, 1] = -sliding
        by_local = np.zeros((len(weight), 3, 8))
        by_local[:, 0, 1::2], by_local[:, 1, 0::2], by_local[:, 2, 1::2] = values, slopes, slopes
        changes = np.einsum("npab,pbj->npaj", by, by_local)
        self.blocks = -np.einsum("p,pk,npaj->nkaj", weight, values, changes, optimize=True).reshape(-1, 8, 8)
        by_road = np.zeros((*push.shape, 2, 2))
        by_road[..., 0] = by[..., 0]
        by_road[..., 0, 1] = sliding
        local_by = np.einsum("p,pk,npab->nkab", weight, values, by_road).reshape(-1, 8, 2)
        self.force = mesh.gathered(force.reshape(-1, 8))
        self.force_by = np.stack([mesh.gathered(local_by[..., k]) for k in range(2)], axis=1)
        drag, lift = np.einsum("p,np,npa->a", weight, push, direction).tolist()
        self.push_n, self.drag_n = float(lift), float(drag)
        self.sums_by: Array = np.einsum("p,npab->ab", weight, by_road)[::-1]
        rows = np.einsum("p,npaj->anj", weight, changes)[::-1]
        self.sums_by_coordinates = np.stack([mesh.gathered(row) for row in rows])
        self.push_npm = push
        self.edges_rad = _edges(mesh.theta_rad, unclipped, touching)


def _edges(theta_rad: Array, unclipped: Array, touching: NDArray[np.bool_]) -> tuple[float, float]:
    """Return the angles between which the road pushes."""
    angle, push, inside = theta_rad.reshape(-1), unclipped.reshape(-1), np.flatnonzero(touching)
    if not len(inside):
        return math.nan, math.nan
    ends = []
    for within, beyond in ((int(inside[0]), -1), (int(inside[-1]), 1)):
        pair = [within + beyond, within]
        ends.append(float(np.interp(0.0, push[pair], angle[pair])))
    return ends[0], ends[1]
