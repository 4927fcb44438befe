"""From a scenario to what is simulated: SI, one plan a wheel."""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace

from gateway.physics.rolling_ring import RingParameters
from gateway.physics.rolling_ring_waves import EdgeWaves
from gateway.simulator.motion import MotionProfile
from gateway.simulator.scenario_model import Scenario, Wheel
from gateway.simulator.scenario_tables import EdgeWaveTable, Hub, Sensor, Tire
from gateway.simulator.series import Series
from gateway.simulator.tire_table import Range, TireModel, TireTable, tire_table

ROAD_SPEED_MPS = 65.0 / 3.6
"""Speed at which the road's rms is stated."""


@dataclass(frozen=True, slots=True)
class WheelPlan:
    """One wheel, ready to be simulated.

    Attributes:
        position: name of the wheel.
        hub: its hub.
        wheel: number at the hub.
        sensor_id: serial number of the sensor.
        radius_m: belt radius.
        tire: the ring.
        motion: speed over time.
        load_n: over time.
        pressure_pa: over time.
        temperature_degc: over time.
        camber_rad: inclination of the wheel plane.
        phase_rad: material angle at the start; None for a random one.
        road_rms_mps2: road noise of each axis at ROAD_SPEED_MPS.
        road_bandwidth_hz: its bandwidth.
        sensor: the sensor as the scenario tells it.
    """

    position: str
    hub: Hub
    wheel: int
    sensor_id: int
    radius_m: float
    tire: TireModel
    motion: MotionProfile
    load_n: Series
    pressure_pa: Series
    temperature_degc: Series
    camber_rad: float
    phase_rad: float | None
    road_rms_mps2: float
    road_bandwidth_hz: float
    sensor: Sensor

    def table(self) -> TireTable:
        """Return the tire's waveforms over what this wheel meets; solved once per process."""
        return tire_table(
            self.tire,
            Range(self.load_n.low, self.load_n.high),
            Range(self.pressure_pa.low, self.pressure_pa.high),
            Range(0.0, self.motion.highest_mps / self.radius_m),
        )

    @property
    def sample_rate_hz(self) -> float:
        """Samples per true second: the nominal rate, off by the sensor's and the hub's clock."""
        return self.sensor.rate_hz * (1.0 + self.sensor.rate_error_ppm * 1e-6) * (1.0 + self.hub.clock_ppm * 1e-6)


def wheel_plans(scenario: Scenario) -> tuple[WheelPlan, ...]:
    """Return the plans of a scenario's wheels, in its order."""
    hubs = {hub.hub: hub for hub in scenario.hubs()}
    return tuple(_plan(wheel, hubs[wheel.hub]) for wheel in scenario.wheels())


def _plan(wheel: Wheel, hub: Hub) -> WheelPlan:
    drum_mm = wheel.tire.drum_radius_mm
    return WheelPlan(
        position=wheel.position,
        hub=hub,
        wheel=wheel.wheel,
        sensor_id=int(wheel.sensor_id, 16) if wheel.sensor_id else zlib.crc32(wheel.position.encode()),
        radius_m=wheel.tire.radius_mm * 1e-3,
        tire=TireModel(
            ring=_ring(wheel.tire),
            reference_pa=wheel.tire.reference_pressure_kpa * 1e3,
            pressure_share=wheel.tire.sidewall_pressure_share,
            sensor_offset_m=wheel.sensor.offset_mm * 1e-3,
            drum_radius_m=math.inf if drum_mm is None else drum_mm * 1e-3,
            waves=_waves(wheel.edge_waves),
        ),
        motion=MotionProfile(wheel.motion.speed_kmh, wheel.motion.repeat),
        load_n=wheel.load_n,
        pressure_pa=Series(tuple((time, 1e3 * value) for time, value in wheel.pressure_kpa.points)),
        temperature_degc=wheel.temperature_degc,
        camber_rad=math.radians(wheel.camber_deg),
        phase_rad=None if wheel.phase_deg is None else math.radians(wheel.phase_deg),
        road_rms_mps2=wheel.road.rms_mps2,
        road_bandwidth_hz=wheel.road.bandwidth_hz,
        sensor=wheel.sensor,
    )


def _waves(table: EdgeWaveTable) -> EdgeWaves | None:
    if not table.amplitude_percent:
        return None
    return EdgeWaves(
        amplitude=table.amplitude_percent * 1e-2,
        order_before=table.order_before,
        order_after=table.order_after,
        decay_rad=table.decay_rad,
        phase_rad=math.radians(table.phase_deg),
    )


def _ring(tire: Tire) -> RingParameters:
    """Return the worn ring at the reference pressure."""
    new = RingParameters.from_numbers(
        tire.Bs,
        tire.Cw,
        tire.Rs,
        tire.Ts,
        radius_m=tire.radius_mm * 1e-3,
        pressure_pa=tire.reference_pressure_kpa * 1e3,
        mass_kgpm=tire.mass_kgpm,
        extension_stiffness_n=tire.extension_stiffness_mn * 1e6,
        tread_stiffness_npm2=tire.tread_stiffness_mpa * 1e6,
        foundation_damping_nspm2=tire.foundation_damping_nspm2,
        tread_damping_nspm2=tire.tread_damping_nspm2,
        sidewall_stiffening_pm=tire.sidewall_stiffening_pm,
        shear_stiffness_n=math.inf if tire.shear_stiffness_kn is None else tire.shear_stiffness_kn * 1e3,
        rotary_inertia_kgm=tire.rotary_inertia_kgm,
    )
    # Belt and tread bend as one plate: EI goes with the cube of what is left of the thickness.
    left = 1.0 - tire.wear_mm / tire.ring_thickness_mm
    return replace(new, bending_stiffness_nm2=new.bending_stiffness_nm2 * left**3, mass_kgpm=new.mass_kgpm * left)
