"""Plan of each simulated wheel: its scenario in SI units, with its tire."""

import math
import zlib
from dataclasses import dataclass, replace

from gateway.forces.laminate import crossed_coupling_length
from gateway.forces.lateral_belt import LateralBelt
from gateway.ring.rolling_ring import RingParameters
from gateway.ring.tread_pattern import EdgeWaves, TreadPitch
from gateway.simulator.motion import MotionProfile, Ripple, WheelRotation
from gateway.simulator.path import Path, speed_beside, yaw_over_time
from gateway.simulator.road_profile import QuarterCar, largest_swing, quarter_car, roughness_m3
from gateway.simulator.scenario_model import Scenario, Wheel
from gateway.simulator.scenario_tables import (
    Defect,
    EdgeWaveTable,
    Hub,
    Impact,
    Road,
    Sensor,
    Tire,
    TreadPitchTable,
    Vibration,
)
from gateway.simulator.time_series import Series
from gateway.simulator.tire_model import RING_NODES, TireModel
from gateway.simulator.tire_table import Range, TireTable, tire_table


def tire_model(wheel: Wheel) -> TireModel:
    """Return the tire of a wheel as it is mounted and rolls."""
    tire = wheel.tire
    return TireModel(
        ring=_ring(tire),
        reference_pa=tire.reference_pressure_kpa * 1e3,
        lateral=_lateral(tire, reverse=wheel.motion.direction == "reverse", right=wheel.side == "right"),
        pressure_share=tire.sidewall_pressure_share,
        sensor_offset_m=wheel.sensor.offset_mm * 1e-3,
        drum_radius_m=math.inf if tire.drum_radius_mm is None else tire.drum_radius_mm * 1e-3,
        axle_torque_nm=tire.axle_torque_nm,
        waves=_waves(wheel.edge_waves),
        pitch=_pitch(wheel.tread_pitch, reverse=wheel.motion.direction == "reverse"),
        runout_m=tire.runout_mm * 1e-3,
        runout_rad=math.radians(tire.runout_deg),
        linear_half_angle_rad=None if tire.linear_half_angle_deg is None else math.radians(tire.linear_half_angle_deg),
        nodes=RING_NODES if tire.ring_nodes is None else tire.ring_nodes,
    )


def _lateral(tire: Tire, *, reverse: bool, right: bool) -> LateralBelt:
    """Return the lateral belt at the reference pressure.

    Rolling the other way is the mirror image fore and aft: the plies' angles change sign, a cone stays what it is. A
    tire turned round to sit on the other side keeps its plies' angles, and its cone points the other way.
    """
    coupling = 0.0
    if tire.cord_angle_deg:
        coupling = crossed_coupling_length(math.radians(tire.cord_angle_deg), tire.ply_separation_mm * 1e-3)
    return LateralBelt(
        coupling_length_m=-coupling if reverse else coupling,
        shear_stiffness_n=tire.lateral_shear_stiffness_mn * 1e6,
        bending_stiffness_nm2=tire.lateral_bending_stiffness_knm2 * 1e3,
        sidewall_stiffness_npm2=tire.lateral_sidewall_stiffness_mpa * 1e6,
        tread_stiffness_npm2=tire.lateral_tread_stiffness_mpa * 1e6,
        friction=tire.lateral_friction,
        conicity_rad=math.radians(-tire.conicity_deg if right else tire.conicity_deg),
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


def _pitch(table: TreadPitchTable, *, reverse: bool) -> TreadPitch | None:
    """Return the pattern's blocks, reversed when the tire rolls backwards."""
    if not table.amplitude_percent:
        return None
    return TreadPitch(
        amplitude=table.amplitude_percent * 1e-2,
        blocks=table.blocks,
        reach_rad=table.reach_rad,
        phase_rad=math.radians(-table.phase_deg if reverse else table.phase_deg),
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
        tangential_damping_ratio=tire.tangential_damping_ratio,
        tread_damping_nspm2=tire.tread_damping_nspm2,
        bending_damping_nm2s=tire.bending_damping_nm2s,
        sidewall_stiffening_pm=tire.sidewall_stiffening_pm,
        shear_stiffness_n=math.inf if tire.shear_stiffness_kn is None else tire.shear_stiffness_kn * 1e3,
        rotary_inertia_kgm=tire.rotary_inertia_kgm,
    )
    # Belt and tread bend as one plate: EI and its damping are proportional to the cube of the remaining thickness.
    remaining_share = 1.0 - tire.wear_mm / tire.ring_thickness_mm
    return replace(
        new,
        bending_stiffness_nm2=new.bending_stiffness_nm2 * remaining_share**3,
        bending_damping_nm2s=new.bending_damping_nm2s * remaining_share**3,
        mass_kgpm=new.mass_kgpm * remaining_share,
    )


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
        path: turns of its hub over time.
        load_n: over time.
        pressure_pa: over time.
        temperature_degc: over time.
        slip_angle_rad: over time, positive pulls the tire to the left.
        camber_rad: inclination of the wheel plane over time, positive reads positive on the lateral axis.
        reverse: whether the wheel rolls backwards.
        phase_rad: material angle at the start; None for a random one.
        ripple: over the steady rotation.
        road: road noise as the scenario states it.
        vibration: of hub and cavity, as the scenario states it.
        impact: once a revolution, as the scenario states it.
        sensor: as the scenario states it.
        defect: of the sensor, as the scenario states it.
    """

    position: str
    hub: Hub
    wheel: int
    sensor_id: int
    radius_m: float
    tire: TireModel
    motion: MotionProfile
    path: Path
    load_n: Series
    pressure_pa: Series
    temperature_degc: Series
    slip_angle_rad: Series
    camber_rad: Series
    reverse: bool
    phase_rad: float | None
    ripple: Ripple
    road: Road
    vibration: Vibration
    impact: Impact
    sensor: Sensor
    defect: Defect

    def table(self) -> TireTable:
        """Return the tire's waveforms over the conditions of this wheel. Solved once per process."""
        swing = 0.0
        if self.road.profile is not None:
            load = 0.5 * (self.load_n.low + self.load_n.high)
            density = roughness_m3(self.road.profile)
            swing = largest_swing(self.quarter_car(), load, density, self.road.waviness, self.motion.highest_mps)
        return tire_table(
            self.tire,
            Range(self.load_n.low * (1.0 - swing), self.load_n.high * (1.0 + swing)),
            Range(self.pressure_pa.low, self.pressure_pa.high),
            Range(0.0, self.motion.highest_mps / self.radius_m),
            Range(self.slip_angle_rad.low, self.slip_angle_rad.high),
        )

    def quarter_car(self) -> QuarterCar:
        """Return the wheel with its share of the vehicle, at the middle of its loads and pressures."""
        return quarter_car(
            self.tire,
            0.5 * (self.load_n.low + self.load_n.high),
            0.5 * (self.pressure_pa.low + self.pressure_pa.high),
            self.road.unsprung_kg,
            1e3 * self.road.suspension_knpm,
            self.road.damper_nspm,
        )

    def rotation(self, phase_rad: float) -> WheelRotation:
        """Return the wheel's angle over time from a given angle at the start."""
        return WheelRotation(self.motion, self.radius_m, phase_rad, self.ripple)

    def told_pressure_pa(self, time_s: float) -> float:
        """Return the reading of the pressure sensor."""
        stuck_s = self.defect.pressure_stuck_from_s
        return self.pressure_pa.at(time_s if stuck_s is None else min(time_s, stuck_s))

    def speaks(self, time_s: float) -> bool:
        """Return whether the wheel's sensor transmits."""
        return self.defect.silent_from_s is None or time_s < self.defect.silent_from_s

    @property
    def sample_rate_hz(self) -> float:
        """Samples per true second: the nominal rate, with the errors of the sensor's and the hub's clock."""
        return self.sensor.rate_hz * (1.0 + self.sensor.rate_error_ppm * 1e-6) * (1.0 + self.hub.clock_ppm * 1e-6)


def wheel_plans(scenario: Scenario) -> tuple[WheelPlan, ...]:
    """Return the plans of a scenario's wheels, in its order."""
    hubs = {hub.hub: hub for hub in scenario.hubs()}
    return tuple(_plan(wheel, hubs[wheel.hub]) for wheel in scenario.wheels())


def _plan(wheel: Wheel, hub: Hub) -> WheelPlan:
    speed_kmh, path = _path(wheel)
    return WheelPlan(
        position=wheel.position,
        hub=hub,
        wheel=wheel.wheel,
        sensor_id=int(wheel.sensor_id, 16) if wheel.sensor_id else zlib.crc32(wheel.position.encode()),
        radius_m=wheel.tire.radius_mm * 1e-3,
        tire=tire_model(wheel),
        motion=MotionProfile(speed_kmh, wheel.motion.repeat),
        path=path,
        load_n=wheel.load_n,
        pressure_pa=wheel.pressure_kpa.scaled(1e3),
        temperature_degc=wheel.temperature_degc,
        slip_angle_rad=wheel.slip_angle_deg.scaled(math.radians(1.0)),
        camber_rad=wheel.camber_deg.scaled(math.radians(1.0)),
        reverse=wheel.motion.direction == "reverse",
        phase_rad=None if wheel.phase_deg is None else math.radians(wheel.phase_deg),
        ripple=Ripple(
            wheel.vibration.ripple_percent * 1e-2,
            wheel.vibration.ripple_order,
            math.radians(wheel.vibration.ripple_deg),
        ),
        road=wheel.road,
        vibration=wheel.vibration,
        impact=wheel.impact,
        sensor=wheel.sensor,
        defect=wheel.defect,
    )


def _path(wheel: Wheel) -> tuple[Series, Path]:
    """Return the speed of a wheel in km/h, and the turns of its hub."""
    motion = wheel.motion
    degree = math.radians(1.0)
    yaw = motion.yaw_rate_degps.scaled(degree)
    if motion.curvature_pkm.low or motion.curvature_pkm.high:
        yaw = yaw_over_time(motion.speed_kmh, motion.curvature_pkm.scaled(1e-3))
    reverse, speed_kmh = motion.direction == "reverse", motion.speed_kmh
    if yaw.low or yaw.high:
        left_m = 0.5 * motion.track_m * (-1.0 if (wheel.side == "right") != reverse else 1.0)
        speed_kmh = speed_beside(speed_kmh, yaw, left_m)
    slip, camber = wheel.slip_angle_deg.scaled(degree), wheel.camber_deg.scaled(degree)
    return speed_kmh, Path(yaw, slip, camber, motion.grade_deg.scaled(degree), motion.bank_deg.scaled(degree), reverse)
