"""Tables that a scenario's wheels share: user's units in the keys, one class a table."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.validation import Section
from gateway.constants import AXIS_NAMES
from gateway.simulator.link_faults import parse_fault
from gateway.simulator.time_series import Series, checked_text, constant, in_range, per_axis

Triple = tuple[float, float, float]
AxisName = Literal["circumferential", "lateral", "radial"]


class Header(Section):
    """`[scenario]`."""

    name: str = ""
    seed: int = Field(default=1, ge=0)
    duration_s: float | None = Field(default=None, gt=0, le=1e7, description="nothing for no end")
    faults: tuple[Annotated[str, checked_text(parse_fault)], ...] = Field(default=(), strict=False)


class Link(Section):
    """`[link]`: how bytes are handed over."""

    chunk_ms: float = Field(default=10.0, ge=1, le=1000)
    jitter_ms: float = Field(default=0.3, ge=0, le=1000, description="mean lateness of a chunk")


class Motion(Section):
    """`[motion]`, and `[wheel.motion]` for a wheel of its own speed."""

    speed_kmh: Annotated[Series, in_range(0, 400)] = constant(65.0)
    repeat: bool = False
    direction: Literal["forward", "reverse"] = "forward"


class Road(Section):
    """`[road]`: shaking of each axis that is not locked to the wheel; grows with speed, 0 at standstill."""

    rms_mps2: float = Field(default=0.0, ge=0, le=1000, description="per axis, at 65 km/h")
    bandwidth_hz: float = Field(default=500.0, ge=10, le=10_000)
    leading_jitter_mm: float = Field(default=0.0, ge=0, le=20, description="rms from revolution to revolution")
    trailing_jitter_mm: float = Field(default=0.0, ge=0, le=20)


class Vibration(Section):
    """`[vibration]` and `[wheel.vibration]`: what the car does to the wheel."""

    ripple_percent: float = Field(default=0.0, ge=0, le=20, description="of the angular speed")
    ripple_order: float = Field(default=2.0, ge=0.1, le=200, description="periods a revolution")
    ripple_deg: float = Field(default=0.0, ge=-360, le=360)
    imbalance_mps2: float = Field(default=0.0, ge=0, le=100, description="at 65 km/h, with the square of the speed")
    imbalance_deg: float = Field(default=0.0, ge=-360, le=360)
    hub_rms_mps2: float = Field(default=0.0, ge=0, le=100, description="at 65 km/h, with the speed")
    hub_hz: float = Field(default=11.3, ge=1, le=500)
    hub_bandwidth_hz: float = Field(default=8.0, ge=0.5, le=500)
    cavity_rms_mps2: float = Field(default=0.0, ge=0, le=1000, description="at 65 km/h, with the speed")
    cavity_hz: float = Field(default=222.0, ge=50, le=900)
    cavity_bandwidth_hz: float = Field(default=6.0, ge=0.5, le=200)


class Impact(Section):
    """`[impact]` and `[wheel.impact]`: a stone in the tread or a bump, striking once a revolution."""

    amplitude_mps2: float = Field(default=0.0, ge=0, le=10_000, description="at 65 km/h, with the speed")
    at_deg: float = Field(default=90.0, ge=-360, le=360, description="the sensor's angle when it strikes")
    frequency_hz: float = Field(default=600.0, ge=10, le=5000)
    decay_ms: float = Field(default=2.0, ge=0.1, le=100)


class Tire(Section):
    """`[tire]` and `[wheel.tire]`: the ring; its four numbers are the new tire's at the reference pressure."""

    size: str = ""
    radius_mm: float = Field(default=320.0, ge=100, le=1200)
    Bs: float = Field(default=3.08e-3, gt=0, le=10)
    Cw: float = Field(default=0.195, gt=0, le=10)
    Rs: float = Field(default=2.97, gt=0, le=1000)
    Ts: float = Field(default=2.53, gt=0, le=1000)
    reference_pressure_kpa: float = Field(default=210.0, ge=10, le=1500)
    sidewall_pressure_share: float = Field(
        default=0.5, ge=0, le=1, description="share of the sidewall's stiffness that grows with pressure"
    )
    mass_kgpm: float = Field(default=3.5, gt=0, le=100)
    extension_stiffness_mn: float = Field(default=5.0, ge=0.1, le=1e6)
    tread_stiffness_mpa: float = Field(default=70.0, ge=1, le=10_000)
    ring_thickness_mm: float = Field(default=15.0, ge=1, le=80, description="belt and tread, new")
    wear_mm: float = Field(default=0.0, ge=0, le=60)
    foundation_damping_nspm2: float = Field(default=0.0, ge=0, le=1e5)
    tread_damping_nspm2: float = Field(default=0.0, ge=0, le=1e6)
    sidewall_stiffening_pm: float = Field(default=0.0, ge=-10, le=100)
    shear_stiffness_kn: float | None = Field(default=None, gt=1, le=1e7, description="nothing for an Euler belt")
    rotary_inertia_kgm: float = Field(default=0.0, ge=0, le=1)
    drum_radius_mm: float | None = Field(
        default=None, description="negative for an inner drum, nothing for a flat road"
    )
    axle_torque_nm: float | None = Field(
        default=None, ge=-5000, le=5000, description="driving torque, nothing for a road without friction"
    )
    cord_angle_deg: float = Field(
        default=-26.0,
        ge=-90,
        le=90,
        description="inner ply's, to the left of forward; 0: no ply steer",
    )
    ply_separation_mm: float = Field(default=1.2, gt=0, le=10, description="from ply to ply, mid-plane to mid-plane")
    conicity_deg: float = Field(default=0.0, ge=-10, le=10, description="half angle of the belt's cone")
    lateral_shear_stiffness_mn: float = Field(default=1.6, gt=0, le=1000)
    lateral_bending_stiffness_knm2: float = Field(default=1.0, gt=0, le=1000)
    lateral_sidewall_stiffness_mpa: float = Field(default=0.25, gt=0, le=100)
    lateral_tread_stiffness_mpa: float = Field(default=8.0, gt=0, le=1000)
    lateral_friction: float = Field(default=1.0, ge=0, le=3)
    runout_mm: float = Field(default=0.0, ge=0, le=3, description="height of the high spot")
    runout_deg: float = Field(default=0.0, ge=-360, le=360, description="from the sensor to the high spot")
    ring_nodes: int | None = Field(default=None, ge=240, le=14_400, description="to solve the belt on; nothing: enough")


class EdgeWaveTable(Section):
    """`[edge_waves]` and `[wheel.edge_waves]`: what a tread pattern sends along the belt, locked to the tire."""

    amplitude_percent: float = Field(default=0.0, ge=0, le=100, description="of R omega^2, at the contact's edges")
    order_before: float = Field(default=35.0, ge=2, le=300)
    order_after: float = Field(default=45.0, ge=2, le=300)
    decay_rad: float = Field(default=1.0, ge=0.05, le=10)
    phase_deg: float = Field(default=0.0, ge=-360, le=360)


class TreadPitchTable(Section):
    """`[tread_pitch]` and `[wheel.tread_pitch]`: blocks that bend the belt in the contact, locked to the tire."""

    amplitude_percent: float = Field(default=0.0, ge=0, le=100, description="of R omega^2, in the contact")
    blocks: float = Field(default=70.0, ge=2, le=300, description="on the circumference")
    reach_rad: float = Field(default=0.15, ge=0.02, le=3, description="beyond the contact's edges")
    phase_deg: float = Field(default=0.0, ge=-360, le=360)


class Sensor(Section):
    """`[sensor]` and `[wheel.sensor]`; three values are circumferential, lateral, radial."""

    rate_hz: float = Field(default=9600.0, ge=2000, le=25600)
    axes: tuple[Literal["circumferential", "lateral", "radial"], ...] = Field(
        default=AXIS_NAMES, strict=False, min_length=1, max_length=3
    )
    range_g: float = Field(default=500.0, ge=1, le=10_000)
    noise_mg_rthz: Annotated[Triple, per_axis(0, 1000)] = (5.0, 5.0, 5.0)
    bandwidth_hz: float | None = Field(default=None, ge=10, le=11_520, description="nothing for the whole band")
    coupling: Literal["dc", "ac"] = "dc"
    highpass_hz: float = Field(default=0.5, gt=0, le=100, description="corner of an AC-coupled sensor")
    coupling_declared: bool = Field(default=True, description="whether the hello tells of the AC coupling")
    radial_sign: Literal[-1, 1] = 1
    sign_declared: bool = Field(default=True, description="whether the hello tells radial_sign")
    offset_mm: float = Field(default=0.0, ge=-20, le=80, description="sensor below the belt's neutral layer")
    roll_deg: float = Field(default=0.0, ge=-180, le=180)
    pitch_deg: float = Field(default=0.0, ge=-180, le=180)
    yaw_deg: float = Field(default=0.0, ge=-180, le=180)
    zero_g_offset_g: Annotated[Triple, per_axis(-1000, 1000)] = (0.0, 0.0, 0.0)
    gain_error_percent: Annotated[Triple, per_axis(-50, 50)] = (0.0, 0.0, 0.0)
    zero_g_drift_mg_per_k: Annotated[Triple, per_axis(-1000, 1000)] = (0.0, 0.0, 0.0)
    gain_drift_percent_per_k: Annotated[Triple, per_axis(-1, 1)] = (0.0, 0.0, 0.0)
    tone_mg: Annotated[Triple, per_axis(0, 100_000)] = (0.0, 0.0, 0.0)
    tone_hz: float = Field(default=50.0, gt=0, le=11_520, description="of an electrical tone")
    rate_error_ppm: float = Field(default=0.0, ge=-10_000, le=10_000)


class Defect(Section):
    """`[defect]` and `[wheel.defect]`: what is broken, from a time on; nothing for what works."""

    axes: tuple[AxisName, ...] = Field(default=AXIS_NAMES, strict=False, max_length=3)
    dead_from_s: float | None = Field(default=None, ge=0, description="reads 0")
    stuck_from_s: float | None = Field(default=None, ge=0, description="repeats its last value")
    clip_g: float | None = Field(default=None, gt=0, le=10_000, description="saturates here, below range_g")
    loose_hz: float | None = Field(default=None, ge=10, le=5000, description="resonance of a loose sensor")
    loose_q: float = Field(default=10.0, ge=0.5, le=1000)
    silent_from_s: float | None = Field(default=None, ge=0, description="nothing more is heard of the wheel")
    pressure_stuck_from_s: float | None = Field(default=None, ge=0, description="the pressure repeats its last value")


class Stated(Section):
    """`[wheel.stated]`: what the vehicle's file says, where that is not the truth; nothing for the truth."""

    load_n: float | None = Field(default=None, ge=50, le=50_000)
    pressure_kpa: float | None = Field(default=None, ge=20, le=1500)
    radius_mm: float | None = Field(default=None, ge=100, le=1200)
    offset_mm: float | None = Field(default=None, ge=-20, le=80)
    roll_deg: float | None = Field(default=None, ge=-45, le=45)
    pitch_deg: float | None = Field(default=None, ge=-45, le=45)


class Hub(Section):
    """`[[hub]]`; hubs that wheels name but no table describes have the defaults."""

    hub: int = Field(ge=0, le=255)
    clock_ppm: float = Field(default=0.0, ge=-1000, le=1000)
    uptime_s: float = Field(default=0.0, ge=0, le=1e9, description="when the scenario begins")
    boot_count: int = Field(default=1, ge=0, le=0xFFFF_FFFE)
    battery_percent: float | None = Field(default=95.0, ge=0, le=100, description="nothing for a hub without battery")
    battery_drain_percent_per_h: float = Field(default=1.0, ge=0, le=1e6)
    supply_v: float = Field(default=3.7, ge=0, le=60)
    supply_w: float = Field(default=0.08, ge=0, le=1000)
    rssi_dbm: int | None = Field(default=-62, ge=-127, le=127)
