"""Tables of a scenario: one class per table, user's units in the keys."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.core.config.validation import Section, above, within
from gateway.core.constants import AXIS_NAMES
from gateway.simulator.link_faults import parse_fault
from gateway.simulator.time_series import Series, checked_text, constant, in_range, per_axis

Triple = tuple[float, float, float]
AxisName = Literal["circumferential", "lateral", "radial"]


class Header(Section):
    """`[scenario]`: name, length and faults of the scenario."""

    name: str = Field(default="", description="name of the scenario")
    seed: int = Field(default=1, ge=0, description="seed of all random numbers")
    duration_s: float | None = above(None, 0, 1e7, "length in s; default: endless")
    faults: tuple[Annotated[str, checked_text(parse_fault)], ...] = Field(
        default=(),
        strict=False,
        description='faults of the link, such as "drop:rate=0.02"; see `treadlink simulate --list`',
    )


class Link(Section):
    """`[link]`: delivery of the bytes."""

    chunk_ms: float = within(10.0, 1, 1000, "interval between chunks in ms")
    jitter_ms: float = within(0.3, 0, 1000, "mean delay of a chunk in ms")


class Motion(Section):
    """`[motion]`, and `[wheel.motion]` for a wheel with its own speed."""

    speed_kmh: Annotated[Series, in_range(0, 400)] = Field(
        default=constant(65.0), description="speed in km/h: a number or a list of [t_s, value] points"
    )
    repeat: bool = Field(default=False, description="whether the speed repeats after its last point")
    direction: Literal["forward", "reverse"] = Field(default="forward", description="direction of rolling")
    yaw_rate_degps: Annotated[Series, in_range(-120, 120)] = Field(
        default=constant(0.0),
        description="yaw rate of the vehicle in degrees/s, positive to the left: a number or a list of [t_s, value] "
        "points; in a curve the wheels of the outer side are faster",
    )
    curvature_pkm: Annotated[Series, in_range(-500, 500)] = Field(
        default=constant(0.0),
        description="curvature of the path in 1/km instead, positive to the left: a number or a list of "
        "[distance_m, value] points",
    )
    track_m: float = within(1.5, 0, 4, "distance between the paths of left and right wheels in m")
    grade_deg: Annotated[Series, in_range(-30, 30)] = Field(
        default=constant(0.0), description="slope of the road in degrees, positive uphill: as the yaw rate"
    )
    bank_deg: Annotated[Series, in_range(-45, 45)] = Field(
        default=constant(0.0), description="crossfall of the road in degrees, positive with its left side up: likewise"
    )


class Road(Section):
    """`[road]` and `[wheel.road]`: random vibration of each axis, not locked to the wheel, and the road's profile."""

    rms_mps2: float = within(0.0, 0, 1000, "RMS value per axis at 65 km/h in m/s^2; grows with the speed")
    bandwidth_hz: float = within(500.0, 10, 10_000, "bandwidth in Hz")
    leading_jitter_mm: float = within(0.0, 0, 20, "RMS jitter of the leading contact edge between revolutions in mm")
    trailing_jitter_mm: float = within(0.0, 0, 20, "RMS jitter of the trailing contact edge between revolutions in mm")
    profile: Literal["A", "B", "C", "D", "E", "F", "G", "H"] | None = Field(
        default=None, description="class of the road's profile after ISO 8608; default: an even road"
    )
    waviness: float = within(2.0, 1, 4, "exponent of the profile's density")
    unsprung_kg: float = within(40.0, 5, 1000, "unsprung mass of the wheel in kg")
    suspension_knpm: float = within(25.0, 1, 1000, "stiffness of the suspension at the wheel in kN/m")
    damper_nspm: float = within(1500.0, 50, 100_000, "damping of the suspension at the wheel in N s/m")


class Vibration(Section):
    """`[vibration]` and `[wheel.vibration]`: vibration of the wheel caused by the vehicle."""

    ripple_percent: float = within(0.0, 0, 20, "amplitude of the ripple of the angular speed in percent")
    ripple_order: float = within(2.0, 0.1, 200, "order of the ripple: periods per revolution")
    ripple_deg: float = within(0.0, -360, 360, "phase of the ripple in degrees")
    imbalance_mps2: float = within(
        0.0, 0, 100, "amplitude of the imbalance at 65 km/h in m/s^2; grows with the square of the speed"
    )
    imbalance_deg: float = within(0.0, -360, 360, "phase of the imbalance in degrees")
    hub_rms_mps2: float = within(
        0.0, 0, 100, "RMS vertical vibration of the wheel centre at 65 km/h in m/s^2; grows with the speed"
    )
    hub_hz: float = within(11.3, 1, 500, "centre frequency of this vibration in Hz")
    hub_bandwidth_hz: float = within(8.0, 0.5, 500, "bandwidth of this vibration in Hz")
    cavity_rms_mps2: float = within(
        0.0, 0, 1000, "RMS radial vibration of the air cavity at 65 km/h in m/s^2; grows with the speed"
    )
    cavity_hz: float = within(222.0, 50, 900, "resonance frequency of the air cavity in Hz")
    cavity_bandwidth_hz: float = within(6.0, 0.5, 200, "bandwidth of the cavity resonance in Hz")


class Impact(Section):
    """`[impact]` and `[wheel.impact]`: a stone in the tread or a bump that strikes once per revolution."""

    amplitude_mps2: float = within(0.0, 0, 10_000, "amplitude at 65 km/h in m/s^2; grows with the speed")
    at_deg: float = within(90.0, -360, 360, "angle of the sensor at the impact in degrees")
    frequency_hz: float = within(600.0, 10, 5000, "frequency of the decaying oscillation in Hz")
    decay_ms: float = within(2.0, 0.1, 100, "decay time of the oscillation in ms")


class Tire(Section):
    """`[tire]` and `[wheel.tire]`: ring model; the numbers are those of the new tire at the reference pressure."""

    size: str = Field(default="", description="tire size; for information only")
    radius_mm: float = within(320.0, 100, 1200, "belt radius in mm")
    Bs: float = above(3.08e-3, 0, 10, "bending stiffness number, dimensionless")
    Cw: float = above(0.195, 0, 10, "contact width number, dimensionless")
    Rs: float = above(2.97, 0, 1000, "radial stiffness number, dimensionless")
    Ts: float = above(2.53, 0, 1000, "tangential stiffness number, dimensionless")
    reference_pressure_kpa: float = within(210.0, 10, 1500, "gauge pressure at which the four numbers hold, in kPa")
    sidewall_pressure_share: float = within(0.5, 0, 1, "share of the sidewall stiffness that grows with pressure")
    linear_half_angle_deg: float | None = within(
        None,
        2,
        60,
        "contact half angle in degrees of the ring paper's linear ring: the radial signal is its Eq. 27 as "
        "printed, without a circumferential one; default: the exact ring, which finds its contact itself",
    )
    mass_kgpm: float = above(3.5, 0, 100, "mass of the ring per length in kg/m")
    extension_stiffness_mn: float = within(5.0, 0.1, 1e6, "extension stiffness of the belt in MN")
    tread_stiffness_mpa: float = within(70.0, 1, 10_000, "radial stiffness of the tread per length in MPa")
    ring_thickness_mm: float = within(15.0, 1, 80, "thickness of belt and tread of the new tire in mm")
    wear_mm: float = within(0.0, 0, 60, "tread wear in mm")
    foundation_damping_nspm2: float = within(0.0, 0, 1e5, "radial damping of the sidewall per length in N s/m^2")
    tangential_damping_ratio: float = within(1.0, 0, 100, "tangential over radial damping of the sidewall")
    tread_damping_nspm2: float = within(0.0, 0, 1e6, "damping of the tread per length in N s/m^2")
    bending_damping_nm2s: float = within(0.0, 0, 100, "damping of the belt in bending in N m^2 s")
    sidewall_stiffening_pm: float = within(
        0.0, -10, 100, "relative increase of the sidewall stiffness per deflection in 1/m"
    )
    shear_stiffness_kn: float | None = above(
        None, 1, 1e7, "shear stiffness of the belt in kN; default: rigid in shear (Euler belt)"
    )
    rotary_inertia_kgm: float = within(0.0, 0, 1, "rotary inertia of the belt per length in kg m")
    drum_radius_mm: float | None = Field(
        default=None, description="radius of the test drum in mm, negative for an inner drum; default: flat road"
    )
    axle_torque_nm: float | None = within(None, -5000, 5000, "driving torque in N m; default: road without friction")
    cord_angle_deg: float = within(
        -26.0, -90, 90, "cord angle of the inner ply in degrees, positive to the left of forward; 0: no ply steer"
    )
    ply_separation_mm: float = above(1.2, 0, 10, "distance of the plies in mm, from mid-plane to mid-plane")
    conicity_deg: float = within(0.0, -10, 10, "half angle of the belt's cone in degrees")
    lateral_shear_stiffness_mn: float = above(1.6, 0, 1000, "lateral shear stiffness of the belt in MN")
    lateral_bending_stiffness_knm2: float = above(1.0, 0, 1000, "lateral bending stiffness of the belt in kN m^2")
    lateral_sidewall_stiffness_mpa: float = above(0.25, 0, 100, "lateral stiffness of the sidewall per length in MPa")
    lateral_tread_stiffness_mpa: float = above(8.0, 0, 1000, "lateral stiffness of the tread per length in MPa")
    lateral_friction: float = within(1.0, 0, 3, "lateral coefficient of friction")
    runout_mm: float = within(0.0, 0, 3, "radial run-out: height of the high spot in mm")
    runout_deg: float = within(0.0, -360, 360, "angle from the sensor to the high spot in degrees")
    ring_nodes: int | None = within(
        None, 240, 14_400, "number of nodes of the numerical solution; default: enough for the sensor"
    )


class EdgeWaveTable(Section):
    """`[edge_waves]` and `[wheel.edge_waves]`: waves from the tread pattern along the belt, locked to the tire."""

    amplitude_percent: float = within(0.0, 0, 100, "amplitude at the contact edges in percent of R omega^2")
    order_before: float = within(35.0, 2, 300, "order of the waves before the contact")
    order_after: float = within(45.0, 2, 300, "order of the waves after the contact")
    decay_rad: float = within(1.0, 0.05, 10, "decay angle in rad")
    phase_deg: float = within(0.0, -360, 360, "phase in degrees")


class TreadPitchTable(Section):
    """`[tread_pitch]` and `[wheel.tread_pitch]`: tread blocks that bend the belt in the contact, locked to the tire."""

    amplitude_percent: float = within(0.0, 0, 100, "amplitude in the contact in percent of R omega^2")
    blocks: float = within(70.0, 2, 300, "number of blocks on the circumference")
    reach_rad: float = within(0.15, 0.02, 3, "reach beyond the contact edges in rad")
    phase_deg: float = within(0.0, -360, 360, "phase in degrees")


class Sensor(Section):
    """`[sensor]` and `[wheel.sensor]`; three values are circumferential, lateral, radial."""

    rate_hz: float = within(9600.0, 2000, 25600, "sampling rate in Hz")
    axes: tuple[Literal["circumferential", "lateral", "radial"], ...] = Field(
        default=AXIS_NAMES, strict=False, min_length=1, max_length=3, description="measured axes"
    )
    range_g: float = within(500.0, 1, 10_000, "range in g")
    noise_mg_rthz: Annotated[Triple, per_axis(0, 1000)] = Field(
        default=(5.0, 5.0, 5.0), description="noise density of each axis in mg/sqrt(Hz)"
    )
    bandwidth_hz: float | None = within(None, 10, 11_520, "bandwidth in Hz; default: up to half the sampling rate")
    resolution_mg: float | None = above(None, 0, 1e5, "step of the output in mg; default: a 16-bit word over the range")
    coupling: Literal["dc", "ac"] = Field(default="dc", description="coupling of the signal")
    highpass_hz: float = above(0.5, 0, 100, "corner frequency of an AC-coupled sensor in Hz")
    coupling_declared: bool = Field(default=True, description="whether the hello states the AC coupling")
    radial_sign: Literal[-1, 1] = Field(default=1, description="sign of the radial axis")
    sign_declared: bool = Field(default=True, description="whether the hello states radial_sign")
    offset_mm: float = within(0.0, -20, 80, "distance of the sensor below the belt's neutral layer in mm")
    roll_deg: float = within(0.0, -180, 180, "rotation about the circumferential axis in degrees")
    pitch_deg: float = within(0.0, -180, 180, "rotation about the lateral axis in degrees")
    yaw_deg: float = within(0.0, -180, 180, "rotation about the radial axis in degrees")
    cross_axis_percent: float = within(0.0, -20, 20, "share of each other axis in the output of an axis in percent")
    zero_g_offset_g: Annotated[Triple, per_axis(-1000, 1000)] = Field(
        default=(0.0, 0.0, 0.0), description="zero-g offset of each axis in g"
    )
    gain_error_percent: Annotated[Triple, per_axis(-50, 50)] = Field(
        default=(0.0, 0.0, 0.0), description="gain error of each axis in percent"
    )
    zero_g_drift_mg_per_k: Annotated[Triple, per_axis(-1000, 1000)] = Field(
        default=(0.0, 0.0, 0.0), description="drift of the zero-g offset from 25 degrees Celsius in mg/K"
    )
    gain_drift_percent_per_k: Annotated[Triple, per_axis(-1, 1)] = Field(
        default=(0.0, 0.0, 0.0), description="drift of the gain from 25 degrees Celsius in percent/K"
    )
    tone_mg: Annotated[Triple, per_axis(0, 100_000)] = Field(
        default=(0.0, 0.0, 0.0), description="amplitude of an electrical tone on each axis in mg"
    )
    tone_hz: float = above(50.0, 0, 11_520, "frequency of the electrical tone in Hz")
    rate_error_ppm: float = within(0.0, -10_000, 10_000, "error of the sampling rate in ppm")


class Defect(Section):
    """`[defect]` and `[wheel.defect]`: defects of the sensor; none by default."""

    axes: tuple[AxisName, ...] = Field(default=AXIS_NAMES, strict=False, max_length=3, description="defective axes")
    dead_from_s: float | None = Field(default=None, ge=0, description="time in s from which the axes read 0")
    stuck_from_s: float | None = Field(
        default=None, ge=0, description="time in s from which the axes repeat their last value"
    )
    clip_g: float | None = above(None, 0, 10_000, "level in g at which the axes saturate, below range_g")
    loose_hz: float | None = within(None, 10, 5000, "resonance frequency of a loose sensor in Hz")
    loose_q: float = within(10.0, 0.5, 1000, "quality factor of this resonance")
    silent_from_s: float | None = Field(default=None, ge=0, description="time in s from which the wheel sends nothing")
    pressure_stuck_from_s: float | None = Field(
        default=None, ge=0, description="time in s from which the pressure repeats its last value"
    )


class Stated(Section):
    """`[wheel.stated]`: values of the vehicle configuration that differ from the truth; default: the truth."""

    load_n: float | None = within(None, 50, 50_000, "stated vertical load in N")
    pressure_kpa: float | None = within(None, 20, 1500, "stated gauge pressure in kPa")
    radius_mm: float | None = within(None, 100, 1200, "stated belt radius in mm")
    offset_mm: float | None = within(None, -20, 80, "stated distance of the sensor below the neutral layer in mm")
    roll_deg: float | None = within(None, -45, 45, "stated roll of the sensor in degrees")
    pitch_deg: float | None = within(None, -45, 45, "stated pitch of the sensor in degrees")


class Hub(Section):
    """`[[hub]]`: a hub; hubs without a table have the defaults."""

    hub: int = Field(ge=0, le=255, description="number of the hub")
    clock_ppm: float = within(0.0, -1000, 1000, "error of its clock in ppm")
    uptime_s: float = within(0.0, 0, 1e9, "uptime at the start of the scenario in s")
    boot_count: int = within(1, 0, 0xFFFF_FFFE, "boot count at the start")
    battery_percent: float | None = within(95.0, 0, 100, "state of charge of the battery at the start in percent")
    battery_drain_percent_per_h: float = within(1.0, 0, 1e6, "discharge in percent per hour")
    supply_v: float = within(3.7, 0, 60, "supply voltage in V")
    supply_w: float = within(0.08, 0, 1000, "supply power in W")
    rssi_dbm: int | None = within(-62, -127, 127, "signal strength of the sensor link in dBm")
