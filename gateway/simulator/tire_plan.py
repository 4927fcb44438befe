"""From a wheel's scenario tables to its tire in SI units."""

from __future__ import annotations

import math
from dataclasses import replace

from gateway.physics.laminate import crossed_coupling_length
from gateway.physics.lateral_belt import LateralBelt
from gateway.physics.rolling_ring import RingParameters
from gateway.physics.rolling_ring_waves import EdgeWaves, TreadPitch
from gateway.simulator.scenario_model import Wheel
from gateway.simulator.scenario_tables import EdgeWaveTable, Tire, TreadPitchTable
from gateway.simulator.tire_model import RING_NODES, TireModel


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
    """Return the pattern's blocks; they pass the other way round when the tire does."""
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
        tread_damping_nspm2=tire.tread_damping_nspm2,
        sidewall_stiffening_pm=tire.sidewall_stiffening_pm,
        shear_stiffness_n=math.inf if tire.shear_stiffness_kn is None else tire.shear_stiffness_kn * 1e3,
        rotary_inertia_kgm=tire.rotary_inertia_kgm,
    )
    # Belt and tread bend as one plate: EI goes with the cube of what is left of the thickness.
    left = 1.0 - tire.wear_mm / tire.ring_thickness_mm
    return replace(new, bending_stiffness_nm2=new.bending_stiffness_nm2 * left**3, mass_kgpm=new.mass_kgpm * left)
