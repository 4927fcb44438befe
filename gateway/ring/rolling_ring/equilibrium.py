"""Parameters of the rolling ring, its solution and the solver's entry point."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, NamedTuple, Self

import numpy as np

from gateway.core.types import BoolArray, FloatArray
from gateway.ring.rolling_ring.block_vibration import LoadedBelt
from gateway.ring.rolling_ring.force_balance import (
    BeltLaw,
    Grid,
    belt_balance,
    following,
    preceding,
    ring_grid,
    road_force,
    segment_turn,
)
from gateway.ring.rolling_ring.newton_solver import (
    NewtonState,
    RingNotConvergedError,
    Tangent,
    by_secants,
    find_equilibrium,
    first_order_changes,
    resting_state,
)
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform, angle_derivatives, sensor_waveform

MIN_NODES: Final = 120


class RingNumbers(NamedTuple):
    """The four dimensionless numbers of the flexible ring.

    Attributes:
        Bs: EI / (R^4 p0), bending.
        Cw: b / R, tension.
        Rs: kw / p0, radial sidewall stiffness.
        Ts: kv / p0, tangential sidewall stiffness.
    """

    Bs: float
    Cw: float
    Rs: float
    Ts: float


@dataclass(frozen=True, slots=True)
class RingParameters:
    """A tire as a ring, SI units.

    Attributes:
        radius_m: R of the inflated, unloaded belt.
        tension_width_m: b; inflation tension is p0 b R.
        bending_stiffness_nm2: EI.
        radial_stiffness_npm2: kw, radial sidewall stiffness per length of belt.
        tangential_stiffness_npm2: kv, tangential sidewall stiffness per length of belt.
        mass_kgpm: rho A, belt mass per length.
        extension_stiffness_n: EA.
        tread_stiffness_npm2: kt, radial tread stiffness per length of belt.
        foundation_damping_nspm2: c_w, radial sidewall damping per length of belt.
        tread_damping_nspm2: ct, tread damping per length of belt.
        sidewall_stiffening_pm: relative growth of kw and kv per metre of their deflection; 5 is +10 % at 20 mm.
        shear_stiffness_n: GA of the belt; infinite for an Euler belt.
        rotary_inertia_kgm: rho I; rolling turns EI into EI - rho I V^2.
        tangential_damping_ratio: c_v / c_w, tangential over radial sidewall damping.
        bending_damping_nm2s: c_b, moment of the belt over the rate of its curvature.
    """

    radius_m: float
    tension_width_m: float
    bending_stiffness_nm2: float
    radial_stiffness_npm2: float
    tangential_stiffness_npm2: float
    mass_kgpm: float = 3.5
    extension_stiffness_n: float = 5e6
    tread_stiffness_npm2: float = 7e7
    foundation_damping_nspm2: float = 0.0
    tread_damping_nspm2: float = 0.0
    sidewall_stiffening_pm: float = 0.0
    shear_stiffness_n: float = math.inf
    rotary_inertia_kgm: float = 0.0
    tangential_damping_ratio: float = 1.0
    bending_damping_nm2s: float = 0.0

    @classmethod
    def from_numbers(
        cls, Bs: float, Cw: float, Rs: float, Ts: float, *, radius_m: float, pressure_pa: float, **others: float
    ) -> Self:
        """Return the ring whose numbers are Bs, Cw, Rs, Ts at `pressure_pa`; `others` are further fields."""
        return cls(
            radius_m=radius_m,
            tension_width_m=Cw * radius_m,
            bending_stiffness_nm2=Bs * radius_m**4 * pressure_pa,
            radial_stiffness_npm2=Rs * pressure_pa,
            tangential_stiffness_npm2=Ts * pressure_pa,
            **others,
        )

    def numbers(self, pressure_pa: float) -> RingNumbers:
        """Return the dimensionless numbers at `pressure_pa`."""
        return RingNumbers(
            Bs=self.bending_stiffness_nm2 / (self.radius_m**4 * pressure_pa),
            Cw=self.tension_width_m / self.radius_m,
            Rs=self.radial_stiffness_npm2 / pressure_pa,
            Ts=self.tangential_stiffness_npm2 / pressure_pa,
        )


@dataclass(frozen=True, slots=True, eq=False)
class RingSolution:
    """A ring rolling steadily under load. Arrays run over theta = -pi + 2 pi i / N; theta = 0 below the axle.

    A solution equals only itself, so that it can be the key of a cache.

    Attributes:
        ring: the parameters.
        load_n: vertical load.
        pressure_pa: inflation pressure.
        omega_radps: angular speed.
        theta_rad: (N,) material angles.
        position_m: (N, 2) belt, axle at the origin, y up; the belt moves towards +x in the contact.
        section_rad: (N,) direction of the belt's section; equals the tangent's for an Euler belt.
        curvature_pm: (N,) curvature of the section's direction, 1/m, positive as on the resting ring.
        contact_pressure_npm: (N,) q, road push per length of belt.
        in_contact: (N,) True where q > 0.
        leading_edge_rad: angle at which the belt meets the road, negative (between nodes, where q crosses zero).
        trailing_edge_rad: angle at which it leaves.
        axle_height_m: above the road, or above the crown of the drum.
        longitudinal_force_n: of the road on the tire, positive forward.
        axle_torque_nm: that keeps the speed; without friction it is the rolling resistance moment.
        sensor: waveform of a sensor at `sensor_offset_m` below the neutral layer.
        iterations: Newton iterations used.
    """

    ring: RingParameters
    load_n: float
    pressure_pa: float
    omega_radps: float
    theta_rad: FloatArray
    position_m: FloatArray
    section_rad: FloatArray
    curvature_pm: FloatArray
    contact_pressure_npm: FloatArray
    in_contact: BoolArray
    leading_edge_rad: float
    trailing_edge_rad: float
    axle_height_m: float
    longitudinal_force_n: float
    axle_torque_nm: float
    sensor: SensorWaveform
    iterations: int

    @property
    def half_angle_rad(self) -> float:
        """Half of the angle in contact."""
        return 0.5 * (self.trailing_edge_rad - self.leading_edge_rad)

    @property
    def contact_centre_rad(self) -> float:
        """Middle of the contact, 0 without damping, friction and wind-up."""
        return 0.5 * (self.trailing_edge_rad + self.leading_edge_rad)

    @property
    def deflection_m(self) -> float:
        """Vertical travel of the axle since the belt first touched the road, tread compression included."""
        return self.ring.radius_m - self.axle_height_m

    @property
    def rolling_resistance(self) -> float:
        """Power lost over speed and load (the belt passes at R omega): the coefficient of rolling resistance."""
        return (self.axle_torque_nm / self.ring.radius_m - self.longitudinal_force_n) / self.load_n

    @property
    def numbers(self) -> RingNumbers:
        """The true dimensionless numbers at this pressure."""
        return self.ring.numbers(self.pressure_pa)


def solve_rolling_ring(
    ring: RingParameters,
    load_n: float,
    pressure_pa: float,
    omega_radps: float,
    *,
    nodes: int = 3600,
    sensor_offset_m: float = 0.0,
    drum_radius_m: float = math.inf,
    axle_torque_nm: float | None = None,
    start: RingSolution | None = None,
    near: RingTangent | None = None,
) -> RingSolution:
    """Return the equilibrium of `ring` rolling steadily.

    Args:
        ring: the tire.
        load_n: vertical load, positive.
        pressure_pa: inflation (gauge) pressure.
        omega_radps: angular speed; 0 gives the standing shape.
        nodes: number of grid points, even, at least MIN_NODES; 720 gives every order to 3e-4 of the largest.
        sensor_offset_m: sensor below (inside) the belt's neutral layer.
        drum_radius_m: of an outer drum, negative for an inner one; infinite for a flat road.
        axle_torque_nm: driving torque; the road's friction, spread like the pressure, balances it. None: no friction.
        start: a nearby solution with the same number of nodes to start from; saves about half of the time.
        near: a solution with its tangent stiffness to start from in its place; saves half of that again.

    Raises:
        ValueError: an argument or a stiffness is out of range; the message names it.
        RingNotConvergedError: no equilibrium was found.
    """
    _check(ring, load_n, pressure_pa, omega_radps, nodes, drum_radius_m)
    law = _law(ring, load_n, pressure_pa, omega_radps, nodes, drum_radius_m, axle_torque_nm)
    grid = ring_grid(nodes)
    equilibrium = None if near is None else near.equilibrium_of(law, grid)
    if equilibrium is None:
        initial_state = resting_state(law, grid) if start is None else _warm_state(law, grid, start)
        equilibrium = find_equilibrium(law, grid, initial_state)
    return _solutions([ring], [law], grid, [equilibrium], sensor_offset_m)[0]


class RingTangent:
    """A solved ring with its tangent stiffness, for others that differ little from it."""

    def __init__(
        self, solution: RingSolution, *, drum_radius_m: float = math.inf, axle_torque_nm: float | None = None
    ) -> None:
        """Factorise the tangent stiffness.

        Args:
            solution: of a ring, at a load, a pressure and a speed.
            drum_radius_m: of the solution.
            axle_torque_nm: of the solution.

        Raises:
            RingNotConvergedError: the solution is at the limit of stability.
        """
        nodes = len(solution.theta_rad)
        self._grid = ring_grid(nodes)
        self._conditions = solution.load_n, solution.pressure_pa, solution.omega_radps, nodes
        self._drum_radius_m, self._axle_torque_nm = drum_radius_m, axle_torque_nm
        law = _law(solution.ring, *self._conditions, drum_radius_m, axle_torque_nm)
        self._equilibrium = _warm_state(law, self._grid, solution)
        state, height_m, traction, _ = self._equilibrium
        balance = belt_balance(law, self._grid, state, height_m, traction)
        self._imbalance = balance.residual, balance.border
        try:
            self._tangent = Tangent(balance)
        except FloatingPointError as error:
            raise RingNotConvergedError(f"no derivatives of the ring's equilibrium: {error}") from error

    def nearby(
        self,
        rings: Sequence[RingParameters],
        *,
        sensor_offset_m: float = 0.0,
        axle_torques_nm: Sequence[float] | None = None,
        drum_radii_m: Sequence[float] | None = None,
    ) -> list[RingSolution]:
        """Return the solutions of rings that differ little, to first order in the difference.

        They take a fraction of the time of `solve_rolling_ring`: the derivatives of a solution by its ring's
        parameters.

        Args:
            rings: similar ones, with the same degrees of freedom.
            sensor_offset_m: sensor below (inside) the belt's neutral layer.
            axle_torques_nm: of the rings, None for that of the solution.
            drum_radii_m: of the rings, None for that of the solution.

        Raises:
            ValueError: a stiffness is out of range; the message names it.
            RingNotConvergedError: the solution is at the limit of stability.
        """
        torques = [self._axle_torque_nm] * len(rings) if axle_torques_nm is None else axle_torques_nm
        drums = [self._drum_radius_m] * len(rings) if drum_radii_m is None else drum_radii_m
        for ring, drum in zip(rings, drums, strict=True):
            _check(ring, *self._conditions, drum)
        laws = [
            _law(ring, *self._conditions, drum, torque)
            for ring, drum, torque in zip(rings, drums, torques, strict=True)
        ]
        try:
            equilibria = first_order_changes(self._imbalance, self._tangent, self._grid, self._equilibrium, laws)
        except np.linalg.LinAlgError as error:
            raise RingNotConvergedError(f"no derivatives of the ring's equilibrium: {error}") from error
        return _solutions(rings, laws, self._grid, equilibria, sensor_offset_m)

    def equilibrium_of(self, law: BeltLaw, grid: Grid) -> NewtonState | None:
        """Return the equilibrium under a law that differs little, without a factorisation; None if it differs more."""
        return by_secants(law, grid, self._equilibrium, self._tangent)


def at_depth(solution: RingSolution, sensor_offset_m: float) -> RingSolution:
    """Return the same solution with a sensor at another distance below the neutral layer."""
    waveform = _waveforms(solution.ring, solution.position_m, solution.section_rad, sensor_offset_m)
    return replace(solution, sensor=waveform)


def _waveforms(
    ring: RingParameters, position_m: FloatArray, section_rad: FloatArray, sensor_offset_m: float
) -> SensorWaveform:
    """Return what a sensor reads, which turns with the section of a shear-flexible belt, else with the tangent."""
    section = section_rad if math.isfinite(ring.shear_stiffness_n) else None
    return sensor_waveform(position_m, ring.radius_m, sensor_offset_m, section)


def loaded_belt(solution: RingSolution, drum_radius_m: float = math.inf) -> LoadedBelt:
    """Return a solved ring as what its tread's blocks can make vibrate.

    Args:
        solution: of the ring.
        drum_radius_m: of the solution.
    """
    # Belt and tread lose more or less at the frequency of blocks than at that of the contact.
    ring = replace(solution.ring, tread_damping_nspm2=0.0, bending_damping_nm2s=0.0)
    nodes = len(solution.theta_rad)
    # Torque and load are met by the solution; the vibration is at a fixed height of the axle.
    law = _law(ring, solution.load_n, solution.pressure_pa, solution.omega_radps, nodes, drum_radius_m, None)
    equilibrium = _warm_state(law, ring_grid(nodes), solution)
    return LoadedBelt(law, equilibrium.state, equilibrium.height_m, -solution.longitudinal_force_n / solution.load_n)


def _law(
    ring: RingParameters,
    load_n: float,
    pressure_pa: float,
    omega_radps: float,
    nodes: int,
    drum_radius_m: float,
    axle_torque_nm: float | None,
) -> BeltLaw:
    bending = _bending_nm2(ring, omega_radps)
    return BeltLaw(
        radius_m=ring.radius_m,
        bending_nm2=bending,
        bending_damping_nm2s=ring.bending_damping_nm2s,
        tension_width_m=ring.tension_width_m,
        radial_npm2=ring.radial_stiffness_npm2,
        tangential_npm2=ring.tangential_stiffness_npm2,
        stiffening_pm=ring.sidewall_stiffening_pm,
        radial_damping_nspm2=ring.foundation_damping_nspm2,
        tangential_damping_nspm2=ring.foundation_damping_nspm2 * ring.tangential_damping_ratio,
        mass_kgpm=ring.mass_kgpm,
        extension_n=ring.extension_stiffness_n,
        shear_n=_on_grid(ring, bending, nodes),
        tread_npm2=ring.tread_stiffness_npm2,
        tread_damping_nspm2=ring.tread_damping_nspm2,
        pressure_pa=pressure_pa,
        omega_radps=omega_radps,
        load_n=load_n,
        drum_radius_m=drum_radius_m,
        torque_nm=axle_torque_nm,
    )


def _check(
    ring: RingParameters, load_n: float, pressure_pa: float, omega_radps: float, nodes: int, drum_radius_m: float
) -> None:
    positive = {
        "load_n": load_n,
        "pressure_pa": pressure_pa,
        "radius_m": ring.radius_m,
        "tension_width_m": ring.tension_width_m,
        "extension_stiffness_n": ring.extension_stiffness_n,
        "tread_stiffness_npm2": ring.tread_stiffness_npm2,
        "shear_stiffness_n": ring.shear_stiffness_n,
        "EI - rho I V^2": _bending_nm2(ring, omega_radps),
    }
    for name, value in positive.items():
        if not value > 0.0:
            raise ValueError(f"{name} must be positive, not {value:g}")
    if nodes < MIN_NODES or nodes % 2:
        raise ValueError(f"nodes must be even and at least {MIN_NODES}, not {nodes}")
    if drum_radius_m <= 0.0 and not drum_radius_m < -ring.radius_m:
        raise ValueError(f"drum_radius_m must be positive, or below minus the tire's radius, not {drum_radius_m:g}")


def _bending_nm2(ring: RingParameters, omega_radps: float) -> float:
    return ring.bending_stiffness_nm2 - ring.rotary_inertia_kgm * (ring.radius_m * omega_radps) ** 2


def _on_grid(ring: RingParameters, bending_nm2: float, nodes: int) -> float:
    """Return GA corrected for the grid.

    The section angle of a segment is the mean of its nodes' angles, which makes the belt too stiff in shear. With a
    node distance a, an extra shear compliance of a^2 / (4 EI) gives the Euler belt's grid as GA tends to infinity.
    """
    if math.isinf(ring.shear_stiffness_n):
        return math.inf
    return 1.0 / (1.0 / ring.shear_stiffness_n + (math.pi * ring.radius_m / nodes) ** 2 / bending_nm2)


def _warm_state(law: BeltLaw, grid: Grid, start: RingSolution) -> NewtonState:
    """Return the solution `start` as a Newton state for this law."""
    if len(start.theta_rad) != len(grid.theta_rad):
        raise ValueError(f"start has {len(start.theta_rad)} nodes, this solve {len(grid.theta_rad)}")
    state = np.empty((len(grid.theta_rad), law.dof))
    state[:, :2] = start.position_m
    if law.dof == 3:
        state[:, 2] = start.section_rad - grid.theta_rad
        if math.isfinite(start.ring.shear_stiffness_n):
            # A solution has the belt's own share of the section's turn from the tangent. Add that of the grid.
            bending = _bending_nm2(start.ring, start.omega_radps)
            by_grid = start.ring.shear_stiffness_n / _on_grid(start.ring, bending, len(grid.theta_rad)) - 1.0
            state[:, 2] += by_grid * _turn_from_tangent(start.position_m, start.section_rad)
    traction = 0.0 if law.torque_nm is None else -start.longitudinal_force_n / start.load_n
    return NewtonState(state, start.axle_height_m, traction, 0)


def _solutions(
    rings: Sequence[RingParameters],
    laws: Sequence[BeltLaw],
    grid: Grid,
    equilibria: Sequence[NewtonState],
    offset_m: float,
) -> list[RingSolution]:
    """Convert Newton states of rings of one radius, all with or all without shear, into solutions."""
    theta, length = grid.theta_rad, rings[0].radius_m * grid.step_rad
    positions = np.stack([equilibrium.state[:, :2] for equilibrium in equilibria])
    sections, curvatures = zip(
        *(
            _section(ring, law, grid, equilibrium)
            for ring, law, equilibrium in zip(rings, laws, equilibria, strict=True)
        ),
        strict=True,
    )
    waveforms = _waveforms(rings[0], positions, np.stack(sections), offset_m)
    solutions = []
    for number, (ring, law, equilibrium) in enumerate(zip(rings, laws, equilibria, strict=True)):
        position = positions[number]
        road = road_force(law, grid, position, equilibrium.height_m, equilibrium.traction)
        lever = position[:, 0] * road.force_npm[:, 1] - position[:, 1] * road.force_npm[:, 0]
        leading, trailing = _edges(theta, road.unclipped_npm)
        solutions.append(
            RingSolution(
                ring=ring,
                load_n=law.load_n,
                pressure_pa=law.pressure_pa,
                omega_radps=law.omega_radps,
                theta_rad=theta,
                position_m=position,
                section_rad=sections[number],
                curvature_pm=curvatures[number],
                contact_pressure_npm=road.pressure_npm,
                in_contact=road.pressure_npm > 0.0,
                leading_edge_rad=leading,
                trailing_edge_rad=trailing,
                axle_height_m=equilibrium.height_m,
                longitudinal_force_n=-length * float(road.force_npm[:, 0].sum()),
                axle_torque_nm=-length * float(lever.sum()),
                sensor=SensorWaveform(*(field[number] for field in waveforms)),
                iterations=equilibrium.iterations,
            )
        )
    return solutions


def _section(ring: RingParameters, law: BeltLaw, grid: Grid, equilibrium: NewtonState) -> tuple[FloatArray, FloatArray]:
    """Return the direction of the belt's section and its curvature, (N,) each."""
    position, theta = equilibrium.state[:, :2], grid.theta_rad
    if law.dof == 3:
        rotation = equilibrium.state[:, 2]
        section = theta + rotation
        # Use only the belt's share of the section's turn from the tangent; the rest is the grid's.
        share = law.shear_n / ring.shear_stiffness_n
        section = section - (1.0 - share) * _turn_from_tangent(position, section)
        return section, (1.0 + (following(rotation) - preceding(rotation)) / (2.0 * grid.step_rad)) / law.radius_m
    rotation = segment_turn(grid, following(position) - position)
    previous = preceding(rotation)
    return theta + 0.5 * (rotation + previous), (1.0 + (rotation - previous) / grid.step_rad) / law.radius_m


def _turn_from_tangent(position_m: FloatArray, section_rad: FloatArray) -> FloatArray:
    """Return (N,) the angle of the section's direction from the tangent of the belt."""
    slope, _ = angle_derivatives(position_m[:, 0] + 1j * position_m[:, 1])
    angle: FloatArray = np.angle(np.exp(1j * section_rad) / slope)
    return angle


def _edges(theta: FloatArray, unclipped: FloatArray) -> tuple[float, float]:
    """Return the angles, interpolated between nodes, where the road push first rises above and last falls below 0."""
    touching = np.flatnonzero(unclipped > 0.0)
    first, last = int(touching[0]), int(touching[-1])
    step = float(theta[1] - theta[0])
    before = _zero(unclipped[first + 1 : first - 3 : -1])
    after = _zero(unclipped[last - 1 : last + 3])
    return float(theta[first]) - step * before, float(theta[last]) + step * after


def _zero(values: FloatArray) -> float:
    """Return the zero, between 0 and 1, of the cubic through values at -1, 0, 1, 2; the value at 0 is positive."""
    before, origin, after, next_after = (float(value) for value in values)
    low, high = 0.0, 1.0
    for _ in range(40):
        x = 0.5 * (low + high)
        value = (
            -before * x * (x - 1.0) * (x - 2.0) / 6.0
            + origin * (x + 1.0) * (x - 1.0) * (x - 2.0) / 2.0
            - after * (x + 1.0) * x * (x - 2.0) / 2.0
            + next_after * (x + 1.0) * x * (x - 1.0) / 6.0
        )
        low, high = (x, high) if value > 0.0 else (low, x)
    return 0.5 * (low + high)
