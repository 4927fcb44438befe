"""Runs of tires made of finite elements, with friction: a referee that has no equation of the gateway's ring."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any, Final, Self

import numpy as np
from independent_tire.rolling import Belt
from independent_tire.sideways import Sides, SidewaysShape, bend_sideways
from independent_tire.steady import NotSteadyError, SteadyBelt, roll_steadily

from gateway.core.types import FloatArray
from gateway.ring.rolling_ring import RingNotConvergedError, RingParameters
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform
from gateway.simulator.tire_model import TireModel
from validity.runs import Run, record_wheel, ring_waveforms
from validity.tires import CLASSES, TireClass, World, draw_world

_ELEMENTS: Final = 480
# A belt of 1 GN stretches by a hundred-thousandth.
_STIFFEST_N: Final = 1e9
# Slope of force over slip: 25 times the load, as of `independent_tire.tires`.
_SLIP_SCALE: Final = 0.04
# Sizes beside those of the bench: a narrow, light tire and a wide one at low pressure.
REFEREED: Final = (
    *(replace(kind, share=0.2) for kind in CLASSES),
    TireClass("motorcycle", 0.2, (0.28, 0.33), (2.0e5, 2.9e5), (40.0, 200.0), (8.0, 14.0), (0.06, 0.16), 0.6),
    TireClass("racing", 0.2, (0.29, 0.36), (1.3e5, 2.2e5), (80.0, 300.0), (6.0, 12.0), (0.12, 0.34), 1.5),
)


@dataclass(frozen=True, slots=True, eq=False)
class SolvedTire:
    """A tire of finite elements under one set of conditions, in place of a `RingSolution`.

    Attributes:
        ring: its parameters.
        pressure_pa: inflation pressure.
        steady: the belt.
        sensor: waveform of the sensor.
    """

    ring: RingParameters
    pressure_pa: float
    steady: SteadyBelt
    sensor: SensorWaveform

    @property
    def theta_rad(self) -> FloatArray:
        """(N,) material angles."""
        return self.steady.mesh.mesh.theta_rad

    @property
    def leading_edge_rad(self) -> float:
        """Angle at which the belt meets the road."""
        return self.steady.edges_rad[0]

    @property
    def trailing_edge_rad(self) -> float:
        """Angle at which it leaves."""
        return self.steady.edges_rad[1]


@dataclass(frozen=True, slots=True)
class FiniteElementTire(TireModel):
    """A tire of the same parameters, solved by finite elements.

    Attributes:
        road_friction: of the road along the belt; the wheel rolls freely on it.
    """

    road_friction: float = 0.0

    @classmethod
    def of(cls, tire: TireModel, road_friction: float) -> Self:
        """Return the tire of a simulated wheel on a road with friction."""
        return cls(**{field.name: getattr(tire, field.name) for field in fields(tire)}, road_friction=road_friction)

    def solve(self, load_n: float, pressure_pa: float, omega_radps: float, start: Any = None) -> Any:
        """Return the `SolvedTire` under given conditions.

        Raises:
            RingNotConvergedError: there is no equilibrium.
        """
        ring = self.ring_at(pressure_pa)
        belt = Belt(
            name="referee",
            radius_m=ring.radius_m,
            pressure_pa=pressure_pa,
            tension_width_m=ring.tension_width_m,
            bending_nm2=ring.bending_stiffness_nm2,
            extension_n=min(ring.extension_stiffness_n, _STIFFEST_N),
            radial_npm2=ring.radial_stiffness_npm2,
            tangential_npm2=ring.tangential_stiffness_npm2,
            mass_kgpm=ring.mass_kgpm,
            tread_npm2=ring.tread_stiffness_npm2,
            speed_mps=ring.radius_m * omega_radps,
            sinking_m=0.03 * ring.radius_m,
            sidewall_damping_nspm2=ring.foundation_damping_nspm2,
            tread_damping_nspm2=ring.tread_damping_nspm2,
            friction=self.road_friction,
            slip_scale=_SLIP_SCALE,
            elements=_ELEMENTS,
        )
        try:
            steady = roll_steadily(belt, load_n, None if start is None else start.steady)
        except NotSteadyError as error:
            raise RingNotConvergedError(str(error)) from error
        return SolvedTire(ring, pressure_pa, steady, SensorWaveform(*steady.signals(self.sensor_offset_m)))

    def solve_lateral(self, ring: Any, slip_angle_rad: float) -> Any:
        """Return the `SidewaysShape` on a solution of `solve`."""
        lateral = self.lateral_at(ring.pressure_pa)
        sides = Sides(
            shear_n=lateral.shear_stiffness_n,
            bending_nm2=lateral.bending_stiffness_nm2,
            sidewall_npm2=lateral.sidewall_stiffness_npm2,
            tread_npm2=lateral.tread_stiffness_npm2,
            friction=lateral.friction,
            coupling_m=lateral.coupling_length_m,
            conicity_rad=lateral.conicity_rad,
        )
        shape: SidewaysShape = bend_sideways(ring.steady, sides, slip_angle_rad)
        return shape


def refereed_world(seed: int, index: int) -> World:
    """Return the referee's tire of a number."""
    return draw_world(seed, index, REFEREED)


def record_refereed(world: World, seed: Sequence[int]) -> Run:
    """Return a run of a tire of finite elements; seed and number of the tire give the road's friction."""
    plan = world.plan()
    friction = float(np.random.default_rng([*seed[:2], 3]).uniform(0.2, 1.0))
    tire = FiniteElementTire.of(plan.tire, friction)
    return record_wheel(world, replace(plan, tire=tire), ring_waveforms, seed)
