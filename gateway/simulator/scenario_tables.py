"""Tables of a scenario: one class per table, user's units in the keys."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.validation import Section
from gateway.constants import AXIS_NAMES
from gateway.simulator.link_faults import parse_fault
from gateway.simulator.time_series import Series, checked_text, constant, in_range, per_axis

Triple = tuple[float, float, float]
AxisName = Literal["circumferential", "lateral", "radial"]


class Header(Section):
    """`[scenario]`: name, length and faults of the scenario."""

    name: str = Field(default="", description="name of the scenario")
    seed: int = Field(default=1, ge=0, description="seed of all random numbers")
    duration_s: float | None = Field(default=None, gt=0, le=1e7, description="length in s; default: endless")
    faults: tuple[Annotated[str, checked_text(parse_fault)], ...] = Field(
        default=(),
        strict=False,
        description='faults of the link, such as "drop:rate=0.02"; see `treadlink simulate --list`',
    )


class Link(Section):
    """`[link]`: delivery of the bytes."""

    chunk_ms: float = Field(default=10.0, ge=1, le=1000, description="interval between chunks in ms")
    jitter_ms: float = Field(default=0.3, ge=0, le=1000, description="mean delay of a chunk in ms")


class Motion(Section):
    """`[motion]`, and `[wheel.motion]` for a wheel with its own speed."""

    speed_kmh: Annotated[Series, in_range(0, 400)] = Field(
        default=constant(65.0), description="speed in km/h: a number or a list of [t_s, value] points"
    )
    repeat: bool = Field(default=False, description="whether the speed repeats after its last point")
    direction: Literal["forward", "reverse"] = Field(default="forward", description="direction of rolling")


class Road(Section):
    """`[road]` and `[wheel.road]`: random vibration of each axis, not locked to the wheel, and the road's profile."""

    rms_mps2: float = Field(
        default=0.0, ge=0, le=1000, description="RMS value per axis at 65 km/h in m/s^2; grows with the speed"
    )
    bandwidth_hz: float = Field(default=500.0, ge=10, le=10_000, description="bandwidth in Hz")
    leading_jitter_mm: float = Field(
        default=0.0, ge=0, le=20, description="RMS jitter of the leading contact edge between revolutions in mm"
    )
    trailing_jitter_mm: float = Field(
        default=0.0, ge=0, le=20, description="RMS jitter of the trailing contact edge between revolutions in mm"
    )
    leading_shift_mm: Annotated[Series, in_range(-50, 200)] = Field(
        default=constant(0.0),
        description="shift of the leading contact edge into the contact in mm, as by a water wedge: a number or a list "
        "of [t_s, value] points",
    )
    profile: Literal["A", "B", "C", "D", "E", "F", "G", "H"] | None = Field(
        default=None, description="class of the road's profile after ISO 8608; default: an even road"
    )
    waviness: float = Field(default=2.0, ge=1, le=4, description="exponent of the profile's density")
    unsprung_kg: float = Field(default=40.0, ge=5, le=1000, description="unsprung mass of the wheel in kg")
    suspension_knpm: float = Field(
        default=25.0, ge=1, le=1000, description="stiffness of the suspension at the wheel in kN/m"
    )
    damper_nspm: float = Field(
        default=1500.0, ge=50, le=100_000, description="damping of the suspension at the wheel in N s/m"
    )


class Vibration(Section):
    """`[vibration]` and `[wheel.vibration]`: vibration of the wheel caused by the vehicle."""

    ripple_percent: float = Field(
        default=0.0, ge=0, le=20, description="amplitude of the ripple of the angular speed in percent"
    )
    ripple_order: float = Field(default=2.0, ge=0.1, le=200, description="order of the ripple: periods per revolution")
    ripple_deg: float = Field(default=0.0, ge=-360, le=360, description="phase of the ripple in degrees")
    imbalance_mps2: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="amplitude of the imbalance at 65 km/h in m/s^2; grows with the square of the speed",
    )
    imbalance_deg: float = Field(default=0.0, ge=-360, le=360, description="phase of the imbalance in degrees")
    hub_rms_mps2: float = Field(
        default=0.0,
        ge=0,
        le=100,
        description="RMS vertical vibration of the wheel centre at 65 km/h in m/s^2; grows with the speed",
    )
    hub_hz: float = Field(default=11.3, ge=1, le=500, description="centre frequency of this vibration in Hz")
    hub_bandwidth_hz: float = Field(default=8.0, ge=0.5, le=500, description="bandwidth of this vibration in Hz")
    cavity_rms_mps2: float = Field(
        default=0.0,
        ge=0,
        le=1000,
        description="RMS radial vibration of the air cavity at 65 km/h in m/s^2; grows with the speed",
    )
    cavity_hz: float = Field(default=222.0, ge=50, le=900, description="resonance frequency of the air cavity in Hz")
    cavity_bandwidth_hz: float = Field(
        default=6.0, ge=0.5, le=200, description="bandwidth of the cavity resonance in Hz"
    )


class Impact(Section):
    """`[impact]` and `[wheel.impact]`: a stone in the tread or a bump that strikes once per revolution."""

    amplitude_mps2: float = Field(
        default=0.0, ge=0, le=10_000, description="amplitude at 65 km/h in m/s^2; grows with the speed"
    )
    at_deg: float = Field(default=90.0, ge=-360, le=360, description="angle of the sensor at the impact in degrees")
    frequency_hz: float = Field(
        default=600.0, ge=10, le=5000, description="frequency of the decaying oscillation in Hz"
    )
    decay_ms: float = Field(default=2.0, ge=0.1, le=100, description="decay time of the oscillation in ms")


class Tire(Section):
    """`[tire]` and `[wheel.tire]`: ring model; the numbers are those of the new tire at the reference pressure."""

    size: str = Field(default="", description="tire size; for information only")
    radius_mm: float = Field(default=320.0, ge=100, le=1200, description="belt radius in mm")
    Bs: float = Field(default=3.08e-3, gt=0, le=10, description="bending stiffness number, dimensionless")
    Cw: float = Field(default=0.195, gt=0, le=10, description="contact width number, dimensionless")
    Rs: float = Field(default=2.97, gt=0, le=1000, description="radial stiffness number, dimensionless")
    Ts: float = Field(default=2.53, gt=0, le=1000, description="tangential stiffness number, dimensionless")
    reference_pressure_kpa: float = Field(
        default=210.0, ge=10, le=1500, description="gauge pressure at which the four numbers hold, in kPa"
    )
    sidewall_pressure_share: float = Field(
        default=0.5, ge=0, le=1, description="share of the sidewall stiffness that grows with pressure"
    )
    linear_half_angle_deg: float | None = Field(
        default=None,
        ge=2,
        le=60,
        description="contact half angle in degrees of the ring paper's linear ring: the radial signal is its Eq. 27 as "
        "printed, without a circumferential one; default: the exact ring, which finds its contact itself",
    )
    mass_kgpm: float = Field(default=3.5, gt=0, le=100, description="mass of the ring per length in kg/m")
    extension_stiffness_mn: float = Field(
        default=5.0, ge=0.1, le=1e6, description="extension stiffness of the belt in MN"
    )
    tread_stiffness_mpa: float = Field(
        default=70.0, ge=1, le=10_000, description="radial stiffness of the tread per length in MPa"
    )
    ring_thickness_mm: float = Field(
        default=15.0, ge=1, le=80, description="thickness of belt and tread of the new tire in mm"
    )
    wear_mm: float = Field(default=0.0, ge=0, le=60, description="tread wear in mm")
    foundation_damping_nspm2: float = Field(
        default=0.0, ge=0, le=1e5, description="radial damping of the sidewall per length in N s/m^2"
    )
    tangential_damping_ratio: float = Field(
        default=1.0, ge=0, le=100, description="tangential over radial damping of the sidewall"
    )
    tread_damping_nspm2: float = Field(
        default=0.0, ge=0, le=1e6, description="damping of the tread per length in N s/m^2"
    )
    bending_damping_nm2s: float = Field(
        default=0.0, ge=0, le=100, description="damping of the belt in bending in N m^2 s"
    )
    sidewall_stiffening_pm: float = Field(
        default=0.0, ge=-10, le=100, description="relative increase of the sidewall stiffness per deflection in 1/m"
    )
    shear_stiffness_kn: float | None = Field(
        default=None,
        gt=1,
        le=1e7,
        description="shear stiffness of the belt in kN; default: rigid in shear (Euler belt)",
    )
    rotary_inertia_kgm: float = Field(
        default=0.0, ge=0, le=1, description="rotary inertia of the belt per length in kg m"
    )
    drum_radius_mm: float | None = Field(
        default=None, description="radius of the test drum in mm, negative for an inner drum; default: flat road"
    )
    axle_torque_nm: float | None = Field(
        default=None, ge=-5000, le=5000, description="driving torque in N m; default: road without friction"
    )
    cord_angle_deg: float = Field(
        default=-26.0,
        ge=-90,
        le=90,
        description="cord angle of the inner ply in degrees, positive to the left of forward; 0: no ply steer",
    )
    ply_separation_mm: float = Field(
        default=1.2, gt=0, le=10, description="distance of the plies in mm, from mid-plane to mid-plane"
    )
    conicity_deg: float = Field(default=0.0, ge=-10, le=10, description="half angle of the belt's cone in degrees")
    lateral_shear_stiffness_mn: float = Field(
        default=1.6, gt=0, le=1000, description="lateral shear stiffness of the belt in MN"
    )
    lateral_bending_stiffness_knm2: float = Field(
        default=1.0, gt=0, le=1000, description="lateral bending stiffness of the belt in kN m^2"
    )
    lateral_sidewall_stiffness_mpa: float = Field(
        default=0.25, gt=0, le=100, description="lateral stiffness of the sidewall per length in MPa"
    )
    lateral_tread_stiffness_mpa: float = Field(
        default=8.0, gt=0, le=1000, description="lateral stiffness of the tread per length in MPa"
    )
    lateral_friction: float = Field(default=1.0, ge=0, le=3, description="lateral coefficient of friction")
    runout_mm: float = Field(default=0.0, ge=0, le=3, description="radial run-out: height of the high spot in mm")
    runout_deg: float = Field(
        default=0.0, ge=-360, le=360, description="angle from the sensor to the high spot in degrees"
    )
    ring_nodes: int | None = Field(
        default=None,
        ge=240,
        le=14_400,
        description="number of nodes of the numerical solution; default: enough for the sensor",
    )


class EdgeWaveTable(Section):
    """`[edge_waves]` and `[wheel.edge_waves]`: waves from the tread pattern along the belt, locked to the tire."""

    amplitude_percent: float = Field(
        default=0.0, ge=0, le=100, description="amplitude at the contact edges in percent of R omega^2"
    )
    order_before: float = Field(default=35.0, ge=2, le=300, description="order of the waves before the contact")
    order_after: float = Field(default=45.0, ge=2, le=300, description="order of the waves after the contact")
    decay_rad: float = Field(default=1.0, ge=0.05, le=10, description="decay angle in rad")
    phase_deg: float = Field(default=0.0, ge=-360, le=360, description="phase in degrees")


class TreadPitchTable(Section):
    """`[tread_pitch]` and `[wheel.tread_pitch]`: tread blocks that bend the belt in the contact, locked to the tire."""

    amplitude_percent: float = Field(
        default=0.0, ge=0, le=100, description="amplitude in the contact in percent of R omega^2"
    )
    blocks: float = Field(default=70.0, ge=2, le=300, description="number of blocks on the circumference")
    reach_rad: float = Field(default=0.15, ge=0.02, le=3, description="reach beyond the contact edges in rad")
    phase_deg: float = Field(default=0.0, ge=-360, le=360, description="phase in degrees")


class Sensor(Section):
    """`[sensor]` and `[wheel.sensor]`; three values are circumferential, lateral, radial."""

    rate_hz: float = Field(default=9600.0, ge=2000, le=25600, description="sampling rate in Hz")
    axes: tuple[Literal["circumferential", "lateral", "radial"], ...] = Field(
        default=AXIS_NAMES, strict=False, min_length=1, max_length=3, description="measured axes"
    )
    range_g: float = Field(default=500.0, ge=1, le=10_000, description="range in g")
    noise_mg_rthz: Annotated[Triple, per_axis(0, 1000)] = Field(
        default=(5.0, 5.0, 5.0), description="noise density of each axis in mg/sqrt(Hz)"
    )
    bandwidth_hz: float | None = Field(
        default=None, ge=10, le=11_520, description="bandwidth in Hz; default: up to half the sampling rate"
    )
    resolution_mg: float | None = Field(
        default=None, gt=0, le=1e5, description="step of the output in mg; default: a 16-bit word over the range"
    )
    coupling: Literal["dc", "ac"] = Field(default="dc", description="coupling of the signal")
    highpass_hz: float = Field(default=0.5, gt=0, le=100, description="corner frequency of an AC-coupled sensor in Hz")
    coupling_declared: bool = Field(default=True, description="whether the hello states the AC coupling")
    radial_sign: Literal[-1, 1] = Field(default=1, description="sign of the radial axis")
    sign_declared: bool = Field(default=True, description="whether the hello states radial_sign")
    offset_mm: float = Field(
        default=0.0, ge=-20, le=80, description="distance of the sensor below the belt's neutral layer in mm"
    )
    roll_deg: float = Field(
        default=0.0, ge=-180, le=180, description="rotation about the circumferential axis in degrees"
    )
    pitch_deg: float = Field(default=0.0, ge=-180, le=180, description="rotation about the lateral axis in degrees")
    yaw_deg: float = Field(default=0.0, ge=-180, le=180, description="rotation about the radial axis in degrees")
    cross_axis_percent: float = Field(
        default=0.0, ge=-20, le=20, description="share of each other axis in the output of an axis in percent"
    )
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
    tone_hz: float = Field(default=50.0, gt=0, le=11_520, description="frequency of the electrical tone in Hz")
    rate_error_ppm: float = Field(default=0.0, ge=-10_000, le=10_000, description="error of the sampling rate in ppm")


class Defect(Section):
    """`[defect]` and `[wheel.defect]`: defects of the sensor; none by default."""

    axes: tuple[AxisName, ...] = Field(default=AXIS_NAMES, strict=False, max_length=3, description="defective axes")
    dead_from_s: float | None = Field(default=None, ge=0, description="time in s from which the axes read 0")
    stuck_from_s: float | None = Field(
        default=None, ge=0, description="time in s from which the axes repeat their last value"
    )
    clip_g: float | None = Field(
        default=None, gt=0, le=10_000, description="level in g at which the axes saturate, below range_g"
    )
    loose_hz: float | None = Field(
        default=None, ge=10, le=5000, description="resonance frequency of a loose sensor in Hz"
    )
    loose_q: float = Field(default=10.0, ge=0.5, le=1000, description="quality factor of this resonance")
    silent_from_s: float | None = Field(default=None, ge=0, description="time in s from which the wheel sends nothing")
    pressure_stuck_from_s: float | None = Field(
        default=None, ge=0, description="time in s from which the pressure repeats its last value"
    )


class Stated(Section):
    """`[wheel.stated]`: values of the vehicle configuration that differ from the truth; default: the truth."""

    load_n: float | None = Field(default=None, ge=50, le=50_000, description="stated vertical load in N")
    pressure_kpa: float | None = Field(default=None, ge=20, le=1500, description="stated gauge pressure in kPa")
    radius_mm: float | None = Field(default=None, ge=100, le=1200, description="stated belt radius in mm")
    offset_mm: float | None = Field(
        default=None, ge=-20, le=80, description="stated distance of the sensor below the neutral layer in mm"
    )
    roll_deg: float | None = Field(default=None, ge=-45, le=45, description="stated roll of the sensor in degrees")
    pitch_deg: float | None = Field(default=None, ge=-45, le=45, description="stated pitch of the sensor in degrees")


class Hub(Section):
    """`[[hub]]`: a hub; hubs without a table have the defaults."""

    hub: int = Field(ge=0, le=255, description="number of the hub")
    clock_ppm: float = Field(default=0.0, ge=-1000, le=1000, description="error of its clock in ppm")
    uptime_s: float = Field(default=0.0, ge=0, le=1e9, description="uptime at the start of the scenario in s")
    boot_count: int = Field(default=1, ge=0, le=0xFFFF_FFFE, description="boot count at the start")
    battery_percent: float | None = Field(
        default=95.0, ge=0, le=100, description="state of charge of the battery at the start in percent"
    )
    battery_drain_percent_per_h: float = Field(default=1.0, ge=0, le=1e6, description="discharge in percent per hour")
    supply_v: float = Field(default=3.7, ge=0, le=60, description="supply voltage in V")
    supply_w: float = Field(default=0.08, ge=0, le=1000, description="supply power in W")
    rssi_dbm: int | None = Field(default=-62, ge=-127, le=127, description="signal strength of the sensor link in dBm")
