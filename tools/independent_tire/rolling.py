"""A dynamic belt rolling on a road, integrated in time by exudyn.

exudyn has the elements (ANCFCable2D: extension, bending, bending damping, inertia) and the integrator (generalised
alpha). Everything else is one object with constant matrices (Coriolis and centrifugal terms, sidewall, pressure) and
a force: the road, by penalty at Gauss points, with tread damping and friction.
"""

import importlib
import math
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.sparse import coo_matrix, csr_matrix

from independent_tire.elements import COORDINATES, QUARTER_TURN, Array, BeltMatrices, Mesh, belt_matrices

# Revolutions: lowering onto the road, settling, and those recorded.
LOWERING: Final = 0.5
SETTLING: Final = 3.5
# Angle from the lowest point within which the belt may touch the road.
_REACH_RAD: Final = 0.8
# Tread damping acts fully from this penetration on: a damper that starts at once would strike.
_GROWS_OVER_M: Final = 1e-4
# Gain of the road's speed on the longitudinal force.
_FREE_ROLLING: Final = 0.5


@dataclass(frozen=True)
class LocalPart:
    """What differs over a piece of the belt, and how the axle moves as that piece passes the road.

    Attributes:
        place_rad: of its middle, in the direction of growing material angle from the sensor's node.
        width_rad: of the piece.
        bending_share: of EI in addition, as in a splice.
        mass_share: of the mass in addition, as under a weight.
        proud_m: height of the tread above the rest, as of a nail's head.
        axle_m: lift of the axle as the middle passes the road, a raised cosine over twice the width: a bent rim.
    """

    place_rad: float
    width_rad: float
    bending_share: float = 0.0
    mass_share: float = 0.0
    proud_m: float = 0.0
    axle_m: float = 0.0

    def inside(self, from_sensor_rad: Array) -> Array:
        """Return 1 within the piece and 0 elsewhere, by the material angle from the sensor's node."""
        return np.asarray(np.abs(_wrapped(from_sensor_rad - self.place_rad)) < 0.5 * self.width_rad, dtype=np.float64)

    def lift_m(self, turned_rad: float) -> float:
        """Return the lift of the axle when the sensor's node is at this angle beyond the highest point."""
        off = float(_wrapped(np.array(turned_rad + self.place_rad - math.pi))) / self.width_rad
        return 0.5 * self.axle_m * (1.0 + math.cos(math.pi * off)) if abs(off) < 1.0 else 0.0


def _wrapped(angle_rad: Array) -> Array:
    return np.mod(angle_rad + math.pi, 2.0 * math.pi) - math.pi


@dataclass(frozen=True)
class Belt:
    """A tire, its road and its drive, in SI units.

    Attributes:
        name: of the tire.
        radius_m: R, of the inflated, rolling, unloaded belt.
        pressure_pa: p0.
        tension_width_m: b.
        bending_nm2: EI.
        extension_n: EA.
        radial_npm2: kw, sidewall.
        tangential_npm2: kv, sidewall.
        mass_kgpm: rho A.
        tread_npm2: kt.
        speed_mps: R times the angular speed.
        sinking_m: height of the belt's lowest point, unloaded, below the road: the load follows from it.
        sidewall_damping_nspm2: of both directions.
        tread_damping_nspm2: of the tread.
        bending_damping_nm2s: of the belt.
        friction: of the road.
        slip_scale: sliding speed at which friction is nearly full, as a share of the rolling speed. A tread that shears
            has one of some percent; a stiff one makes the force follow the slip too slowly to be steady.
        traction: longitudinal force of the road on the tire, positive forward, over the load; the road's speed follows.
        drum_radius_m: infinite for a flat road.
        blocks: of the tread, a turn; 0 is a tread without blocks.
        block_share: amplitude of the tread's stiffness over a block, as a share of its mean.
        local: what differs at one place; None for an even tire.
        elements: of the belt.
        steps: of the integration, a revolution.
        recorded: revolutions.
        settling: revolutions between lowering and recording.
    """

    name: str
    radius_m: float
    pressure_pa: float
    tension_width_m: float
    bending_nm2: float
    extension_n: float
    radial_npm2: float
    tangential_npm2: float
    mass_kgpm: float
    tread_npm2: float
    speed_mps: float
    sinking_m: float
    sidewall_damping_nspm2: float = 0.0
    tread_damping_nspm2: float = 0.0
    bending_damping_nm2s: float = 0.0
    friction: float = 0.0
    slip_scale: float = 2e-3
    traction: float = 0.0
    drum_radius_m: float = math.inf
    blocks: int = 0
    block_share: float = 0.0
    local: LocalPart | None = None
    elements: int = 180
    steps: int = 2048
    recorded: int = 4
    settling: float = SETTLING

    @property
    def omega_radps(self) -> float:
        """Angular speed of the rim."""
        return self.speed_mps / self.radius_m

    @property
    def period_s(self) -> float:
        """Of a revolution."""
        return 2.0 * math.pi / self.omega_radps


@dataclass(frozen=True)
class Road:
    """Force of the road on the belt at one moment.

    Attributes:
        force: (4 N,) on the coordinates.
        by_position: (m, p, 2, 2) derivative of the force on each point near the road by its position.
        by_velocity: likewise by its velocity.
        elements: (m,) numbers of the elements near the road.
        push_n: sum along the vertical.
        drag_n: sum along the road, on the belt.
        edges_rad: material angles of the contact's ends from the lowest point; NaN without contact.
        torque_nm: about the axle.
    """

    force: Array
    by_position: Array
    by_velocity: Array
    elements: Array
    push_n: float
    drag_n: float
    edges_rad: tuple[float, float]
    torque_nm: float


@dataclass(frozen=True)
class History:
    """Recording of one node of a rolling belt; n instants.

    Attributes:
        angle_rad: (n,) material angle of the node from the lowest point.
        position_m: (n, 4) coordinates in the rim's frame.
        velocity_mps: (n, 4) their rates.
        acceleration_mps2: (n, 4) likewise.
        load_n: (n,) vertical force of the road.
        drag_n: (n,) longitudinal force of the road on the belt, along its motion.
        torque_nm: (n,) of the road about the axle.
        edges_rad: (n, 2) contact edges.
    """

    angle_rad: Array
    position_m: Array
    velocity_mps: Array
    acceleration_mps2: Array
    load_n: Array
    drag_n: Array
    torque_nm: Array
    edges_rad: Array


class RoadForce:
    """Contact of a belt with the road, which turns in the rim's frame."""

    def __init__(self, belt: Belt, mesh: Mesh) -> None:
        """Take the belt; the road starts below it."""
        self._belt = belt
        self._mesh = mesh
        self._values = mesh.points.values.T
        self._weight_m = mesh.points.element_weight_m
        self._resting = mesh.resting.reshape(mesh.count, 2, 2)
        self._middle_rad = mesh.theta_rad + math.pi / mesh.count
        self._local_rad = 2.0 * math.pi / mesh.count * (mesh.points.at - 0.5)
        # (N, p), N/m^2. The middle of a block is at the first node, which the sensor is at.
        turned = belt.blocks * (mesh.points.theta_rad.reshape(mesh.count, -1) - mesh.theta_rad[0])
        self._tread_npm2 = belt.tread_npm2 * (1.0 + belt.block_share * np.cos(turned))
        from_sensor = mesh.points.theta_rad.reshape(mesh.count, -1) - mesh.theta_rad[0]
        self._proud_m = np.zeros(from_sensor.shape)
        if belt.local is not None:
            self._proud_m += belt.local.proud_m * belt.local.inside(from_sensor)
        self.road_mps = belt.speed_mps

    def height_m(self, time_s: float) -> float:
        """Return the height of the axle above the road."""
        share = min(1.0, time_s / (LOWERING * self._belt.period_s))
        lift = 0.0 if self._belt.local is None else self._belt.local.lift_m(self._belt.omega_radps * time_s)
        return self._belt.radius_m - self._belt.sinking_m * share * share * (3.0 - 2.0 * share) + share * lift

    def at(self, time_s: float, displaced: Array, rate: Array) -> Road:
        """Return the road's force on displaced coordinates (4 N,) with their rates."""
        belt, shape = self._belt, self._values
        turned = belt.omega_radps * time_s
        cos, sin = math.cos(turned), math.sin(turned)
        # The road's forward and upward directions in the rim's frame.
        forward, up = np.array([cos, -sin]), np.array([sin, cos])
        angle = np.mod(self._middle_rad + turned + math.pi, 2.0 * math.pi) - math.pi
        elements = np.flatnonzero(np.abs(angle) < _REACH_RAD)
        elements = elements[np.argsort(angle[elements])]
        after = (elements + 1) % self._mesh.count
        moved = self._resting + displaced.reshape(-1, 2, 2)
        rates = rate.reshape(-1, 2, 2)
        # (m, p, 2) at the points of the elements near the road.
        position = shape @ np.concatenate([moved[elements], moved[after]], axis=1)
        moving = shape @ np.concatenate([rates[elements], rates[after]], axis=1)
        # In the road's frame the rim's turning adds Omega x r.
        moving = moving + belt.omega_radps * position @ QUARTER_TURN.T
        height = self.height_m(time_s)
        if math.isinf(belt.drum_radius_m):
            depth = -position @ up - height
            normal: Array = np.broadcast_to(up, position.shape)
            spread = np.zeros(depth.shape)
        else:
            arm = position + (height + belt.drum_radius_m) * up
            distance = np.hypot(arm[..., 0], arm[..., 1])
            depth, normal, spread = belt.drum_radius_m - distance, arm / distance[..., None], 1.0 / distance
        along = np.stack([normal[..., 1], -normal[..., 0]], axis=-1)
        depth = depth + self._proud_m[elements]
        sinking = -(moving * normal).sum(axis=-1)
        grown = np.clip(depth / _GROWS_OVER_M, 0.0, 1.0)
        damper = belt.tread_damping_nspm2 * grown
        tread = self._tread_npm2[elements]
        unclipped = tread * depth + damper * sinking
        push = np.maximum(unclipped, 0.0)
        alive = push > 0.0
        width = belt.slip_scale * belt.speed_mps
        held = np.tanh(((moving * along).sum(axis=-1) - self.road_mps) / width)
        direction = normal - (belt.friction * held)[..., None] * along
        force = (self._weight_m * push)[..., None] * direction
        growing = np.where(grown < 1.0, belt.tread_damping_nspm2 * sinking / _GROWS_OVER_M, 0.0)
        stiff = self._weight_m * np.where(alive, tread + growing, 0.0)
        by_velocity = -(self._weight_m * np.where(alive, damper, 0.0))[..., None, None] * _outer(direction, normal)
        sliding = self._weight_m * belt.friction * push * (1.0 - held**2) / width
        by_velocity = by_velocity - sliding[..., None, None] * _outer(along, along)
        by_position = by_velocity @ (belt.omega_radps * QUARTER_TURN)
        by_position = by_position - stiff[..., None, None] * _outer(direction, normal)
        by_position = by_position + (self._weight_m * push * spread)[..., None, None] * (
            np.eye(2) - _outer(normal, normal)
        )
        nodal = shape.T @ force
        whole = np.zeros((self._mesh.count, 2, 2))
        whole[elements] += nodal[:, :2]
        whole[after] += nodal[:, 2:]
        lever = position[..., 0] * force[..., 1] - position[..., 1] * force[..., 0]
        edges = _edges((angle[elements][:, None] + self._local_rad).reshape(-1), unclipped.reshape(-1))
        return Road(
            force=whole.reshape(-1),
            by_position=by_position,
            by_velocity=by_velocity,
            elements=elements,
            push_n=float((force @ up).sum()),
            drag_n=float((force @ forward).sum()),
            edges_rad=edges,
            torque_nm=float(lever.sum()),
        )

    def triplets(self, road: Road, position: float, velocity: float) -> Array:
        """Return minus the derivative of the force, with these factors, as (k, 3) row, column, value."""
        blocks = -(position * road.by_position + velocity * road.by_velocity)
        # (m, 4, 2, 4, 2) of the elements' coordinates.
        local = np.einsum("pk,pl,mpab->mkalb", self._values, self._values, blocks, optimize=True)
        after = (road.elements + 1) % self._mesh.count
        base = np.arange(COORDINATES)
        places = np.concatenate(
            [COORDINATES * road.elements[:, None] + base, COORDINATES * after[:, None] + base], axis=1
        )
        rows = np.repeat(places[:, :, None], 8, axis=2).reshape(-1)
        columns = np.repeat(places[:, None, :], 8, axis=1).reshape(-1)
        values = local.reshape(-1)
        used = values != 0.0
        return np.stack([rows[used], columns[used], values[used]], axis=1)


def _edges(angle: Array, push: Array) -> tuple[float, float]:
    """Return the angles between which the road pushes, by its push on points in the order of angle, unclipped."""
    touching = np.flatnonzero(push > 0.0)
    if not len(touching):
        return math.nan, math.nan
    first, last = int(touching[0]), int(touching[-1])
    if first == 0 or last == len(push) - 1:
        return math.nan, math.nan
    return (
        float(np.interp(0.0, push[first - 1 : first + 1], angle[first - 1 : first + 1])),
        float(np.interp(0.0, push[last : last + 2][::-1], angle[last : last + 2][::-1])),
    )


def _outer(a: Array, b: Array) -> Array:
    return a[..., :, None] * b[..., None, :]


def roll(belt: Belt, quiet: bool = True) -> History:
    """Return the history of one node over the recorded revolutions.

    Raises:
        RuntimeError: exudyn is not installed, or the integration failed.
    """
    try:
        exu: Any = importlib.import_module("exudyn")
        items: Any = importlib.import_module("exudyn.itemInterface")
    except ImportError as error:
        raise RuntimeError(
            "the independent tire needs exudyn: pip install exudyn, in an environment of its own"
        ) from error
    exu.special.exceptions.dictionaryNonCopyable = False
    mesh = Mesh(belt.elements, belt.radius_m)
    matrices = belt_matrices(mesh, 1.0 + _share(belt, "mass_share", mesh.points.theta_rad - mesh.theta_rad[0]))
    road = RoadForce(belt, mesh)
    system = exu.SystemContainer()
    mbs = system.AddSystem()
    nodes = _add_nodes(mbs, items, mesh)
    _add_cables(mbs, items, belt, mesh, nodes)
    _add_rest(mbs, items, exu, belt, mesh, matrices, road, nodes)
    mbs.Assemble()
    return _integrate(mbs, exu, belt, road, quiet)


def _add_nodes(mbs: Any, items: Any, mesh: Mesh) -> list[int]:
    resting = mesh.resting.reshape(-1, COORDINATES)
    return [mbs.AddNode(items.NodePoint2DSlope1(referenceCoordinates=row.tolist())) for row in resting]


def _share(belt: Belt, of: str, from_sensor_rad: Array) -> Array:
    """Return what a piece of the belt has in addition, by the material angle from the sensor's node."""
    local = belt.local
    return np.zeros(from_sensor_rad.shape) if local is None else getattr(local, of) * local.inside(from_sensor_rad)


def _add_cables(mbs: Any, items: Any, belt: Belt, mesh: Mesh, nodes: list[int]) -> None:
    # At rest on the circle the belt carries the tension of pressure and rotation.
    tension = belt.pressure_pa * belt.tension_width_m * belt.radius_m + belt.mass_kgpm * belt.speed_mps**2
    middle = mesh.theta_rad - mesh.theta_rad[0] + math.pi / mesh.count
    masses = belt.mass_kgpm * (1.0 + _share(belt, "mass_share", middle))
    bendings = belt.bending_nm2 * (1.0 + _share(belt, "bending_share", middle))
    for index, node in enumerate(nodes):
        mbs.AddObject(
            items.ObjectANCFCable2D(
                length=mesh.length_m,
                massPerLength=float(masses[index]),
                bendingStiffness=float(bendings[index]),
                axialStiffness=belt.extension_n,
                bendingDamping=belt.bending_damping_nm2s,
                referenceAxialStrain=-tension / belt.extension_n,
                strainIsRelativeToReference=1.0,
                nodeNumbers=[node, nodes[(index + 1) % len(nodes)]],
            )
        )


def _add_rest(
    mbs: Any, items: Any, exu: Any, belt: Belt, mesh: Mesh, matrices: BeltMatrices, road: RoadForce, nodes: list[int]
) -> None:
    """Add everything but the belt's own elasticity and inertia as one object."""
    size = COORDINATES * mesh.count
    omega, mass = belt.omega_radps, belt.mass_kgpm
    pressure = belt.pressure_pa * belt.tension_width_m
    on_position = mass * omega**2 * matrices.mass + pressure * matrices.area
    sidewall = belt.radial_npm2 * matrices.radial + belt.tangential_npm2 * matrices.along
    damping = belt.sidewall_damping_nspm2 * (matrices.radial + matrices.along)
    stiffness = csr_matrix(sidewall - on_position)
    gyroscopic = csr_matrix(damping + mass * omega * matrices.coriolis)
    constant = on_position @ mesh.resting
    # Damps the lowering away: as strong as a tenth of critical at first, gone before the recording.
    calming = mass * math.sqrt(belt.radial_npm2 / mass) * 0.2

    def calmed(time_s: float) -> float:
        share = time_s / ((LOWERING + 0.5 * belt.settling) * belt.period_s)
        return calming * max(0.0, 1.0 - share) ** 2

    whole_mass = coo_matrix(matrices.mass)
    mass_triplets = np.stack([whole_mass.row, whole_mass.col, whole_mass.data], axis=1)

    def force(_: Any, time_s: float, __: int, displaced: Any, rate: Any) -> Array:
        q, v = np.asarray(displaced), np.asarray(rate)
        push: Array = road.at(time_s, q, v).force
        if calm := calmed(time_s):
            push = push - calm * (matrices.mass @ v)
        return push

    def jacobian(_: Any, time_s: float, __: int, displaced: Any, rate: Any, position: float, velocity: float) -> Any:
        result = road.at(time_s, np.asarray(displaced), np.asarray(rate))
        triplets = road.triplets(result, position, velocity)
        if calm := calmed(time_s):
            triplets = np.concatenate([triplets, mass_triplets * [1.0, 1.0, velocity * calm]])
        container = exu.MatrixContainer()
        container.SetWithSparseMatrix(triplets, size, size)
        return container

    mbs.AddObject(
        items.ObjectGenericODE2(
            nodeNumbers=nodes,
            massMatrix=_container(exu, csr_matrix((size, size))),
            stiffnessMatrix=_container(exu, stiffness),
            dampingMatrix=_container(exu, gyroscopic),
            forceVector=constant,
            forceUserFunction=force,
            jacobianUserFunction=jacobian,
        )
    )


def _container(exu: Any, matrix: csr_matrix) -> Any:
    matrix.eliminate_zeros()
    container = exu.MatrixContainer()
    container.SetWithSparseMatrix(matrix, matrix.shape[0], matrix.shape[1])
    return container


def _integrate(mbs: Any, exu: Any, belt: Belt, road: RoadForce, quiet: bool) -> History:
    begin_s = (LOWERING + belt.settling) * belt.period_s
    # The loop of force and road speed keeps a driven belt swinging on its sidewall, so the road then keeps its speed.
    held_s = math.inf if belt.traction == 0.0 else (LOWERING + 0.5 * belt.settling) * belt.period_s
    end_s = begin_s + belt.recorded * belt.period_s
    rows: list[tuple[Any, ...]] = []
    states = mbs.systemData

    def after_step(_: Any, time_s: float) -> bool:
        q, v = states.GetODE2Coordinates(), states.GetODE2Coordinates_t()
        result = road.at(time_s, q, v)
        if belt.friction and result.push_n > 0.0 and time_s < held_s:
            # The road follows the belt until the force is the wanted one; without one the tire rolls freely. The force
            # on the belt is along the belt's motion, which is backward.
            excess = result.drag_n / result.push_n + belt.traction
            road.road_mps -= _FREE_ROLLING * excess * belt.speed_mps / belt.steps
        if time_s >= begin_s - 1e-12:
            a = states.GetODE2Coordinates_tt()
            rows.append((time_s, q[:COORDINATES], v[:COORDINATES], a[:COORDINATES], result.push_n, result.drag_n,
                         result.torque_nm, result.edges_rad))  # fmt: skip
        return True

    mbs.SetPostStepUserFunction(after_step)
    settings = exu.SimulationSettings()
    integration = settings.timeIntegration
    integration.endTime = end_s
    integration.numberOfSteps = round((LOWERING + belt.settling + belt.recorded) * belt.steps)
    integration.generalizedAlpha.spectralRadius = 0.7
    integration.newton.modifiedNewtonJacUpdatePerStep = True
    integration.newton.relativeTolerance = 1e-6
    integration.newton.absoluteTolerance = 1e-7
    integration.verboseMode = 0 if quiet else 1
    settings.solutionSettings.writeSolutionToFile = False
    settings.linearSolverType = exu.LinearSolverType.EigenSparse
    if not mbs.SolveDynamic(settings):
        raise RuntimeError(f"tire {belt.name}: the integration failed")
    resting = -math.pi
    column = [np.array([row[k] for row in rows]) for k in range(8)]
    return History(
        angle_rad=resting + belt.omega_radps * column[0],
        position_m=column[1] + Mesh(belt.elements, belt.radius_m).resting[:COORDINATES],
        velocity_mps=column[2],
        acceleration_mps2=column[3],
        load_n=column[4],
        drag_n=column[5],
        torque_nm=column[6],
        edges_rad=column[7],
    )
