"""A scenario as values: user's units in the keys, defaults of every wheel overridden wheel by wheel."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Any, Final, Literal, TypeVar

from pydantic import Field

from gateway.config.faults import Fault, Section, show
from gateway.simulator.faults import parse_fault
from gateway.simulator.series import Series, checked_text, constant, in_range, per_axis

SectionT = TypeVar("SectionT", bound=Section)
Triple = tuple[float, float, float]

_INHERITED: Final = ("motion", "road", "tire", "edge_waves", "sensor")
AXIS_NAMES: Final = ("circumferential", "lateral", "radial")


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


class Road(Section):
    """`[road]`: shaking of each axis that is not locked to the wheel; grows with speed, 0 at standstill."""

    rms_mps2: float = Field(default=0.0, ge=0, le=1000, description="per axis, at 65 km/h")
    bandwidth_hz: float = Field(default=500.0, ge=10, le=10_000)


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
    extension_stiffness_mn: float = Field(default=5.0, ge=0.1, le=1000)
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


class EdgeWaveTable(Section):
    """`[edge_waves]` and `[wheel.edge_waves]`: what a tread pattern sends along the belt, locked to the tire."""

    amplitude_percent: float = Field(default=0.0, ge=0, le=100, description="of R omega^2, at the contact's edges")
    order_before: float = Field(default=35.0, ge=2, le=300)
    order_after: float = Field(default=45.0, ge=2, le=300)
    decay_rad: float = Field(default=1.0, ge=0.05, le=10)
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
    radial_sign: Literal[-1, 1] = 1
    sign_declared: bool = Field(default=True, description="whether the hello tells radial_sign")
    offset_mm: float = Field(default=0.0, ge=-20, le=80, description="sensor below the belt's neutral layer")
    roll_deg: float = Field(default=0.0, ge=-45, le=45)
    pitch_deg: float = Field(default=0.0, ge=-45, le=45)
    zero_g_offset_g: Annotated[Triple, per_axis(-1000, 1000)] = (0.0, 0.0, 0.0)
    gain_error_percent: Annotated[Triple, per_axis(-50, 50)] = (0.0, 0.0, 0.0)
    rate_error_ppm: float = Field(default=0.0, ge=-10_000, le=10_000)


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


class Wheel(Section):
    """`[[wheel]]`."""

    position: str = Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,23}$", description="as FL or rear.left")
    hub: int = Field(default=0, ge=0, le=255)
    wheel: int = Field(ge=0, le=254)
    sensor_id: str = Field(default="", pattern=r"^[0-9a-fA-F]{0,8}$", description='hexadecimal digits, as "0000a001"')
    load_n: Annotated[Series, in_range(50, 50_000)] = constant(5000.0)
    pressure_kpa: Annotated[Series, in_range(20, 1500)] = constant(210.0)
    temperature_degc: Annotated[Series, in_range(-60, 250)] = constant(25.0)
    camber_deg: float = Field(default=0.0, ge=-30, le=30)
    phase_deg: float | None = Field(default=None, ge=-360, le=360, description="at the start; nothing for random")
    motion: Motion = Motion()
    road: Road = Road()
    tire: Tire = Tire()
    edge_waves: EdgeWaveTable = EdgeWaveTable()
    sensor: Sensor = Sensor()


class Scenario(Section):
    """The whole scenario."""

    scenario: Header = Header()
    link: Link = Link()
    motion: Motion = Motion()
    road: Road = Road()
    tire: Tire = Tire()
    edge_waves: EdgeWaveTable = EdgeWaveTable()
    sensor: Sensor = Sensor()
    hub: tuple[Hub, ...] = Field(default=(), strict=False)
    wheel: tuple[Wheel, ...] = Field(strict=False, min_length=1, description="one [[wheel]] table at least")

    def wheels(self) -> tuple[Wheel, ...]:
        """Return the wheels with the scenario's defaults filled in."""
        return tuple(
            wheel.model_copy(update={name: _filled(getattr(self, name), getattr(wheel, name)) for name in _INHERITED})
            for wheel in self.wheel
        )

    def hubs(self) -> tuple[Hub, ...]:
        """Return every hub that a wheel names, by number."""
        described = {hub.hub: hub for hub in self.hub}
        numbers = sorted({wheel.hub for wheel in self.wheel})
        return tuple(described.get(number) or Hub(hub=number) for number in numbers)


def _filled(base: SectionT, own: SectionT) -> SectionT:
    return base.model_copy(update={name: getattr(own, name) for name in own.model_fields_set})


def scenario_faults(data: Mapping[str, Any]) -> Iterator[Fault]:
    """Yield what is inconsistent between keys, on the raw document."""
    wheels = [item for item in _list(data.get("wheel")) if isinstance(item, Mapping)]
    taken = "another wheel has it already; each needs its own"
    yield from _repeated("wheel", "position", [show(wheel.get("position")) for wheel in wheels], taken)
    addresses = [f"hub = {show(wheel.get('hub', 0))}, wheel = {show(wheel.get('wheel'))}" for wheel in wheels]
    yield from _repeated("wheel", "wheel", addresses, taken)
    hubs = [show(hub.get("hub")) for hub in _list(data.get("hub")) if isinstance(hub, Mapping)]
    yield from _repeated("hub", "hub", hubs, "another table describes this hub; keep one")
    yield from _section_faults("", data, data)
    for number, wheel in enumerate(wheels, 1):
        yield from _section_faults(f"wheel[{wheel.get('position', f'#{number}')}].", wheel, data)


def _repeated(table: str, key: str, values: Sequence[str], allowed: str) -> Iterator[Fault]:
    for index, value in enumerate(values):
        if value in values[:index]:
            yield Fault(f"{table}[#{index + 1}].{key}", value, allowed)


def _section_faults(where: str, table: Mapping[str, Any], data: Mapping[str, Any]) -> Iterator[Fault]:
    own = {name: _table(table.get(name)) for name in ("sensor", "tire", "motion")}
    merged = {name: {**_table(data.get(name)), **items} for name, items in own.items()}
    sensor, tire, motion = merged["sensor"], merged["tire"], merged["motion"]
    bandwidth, rate = _number(sensor.get("bandwidth_hz")), _number(sensor.get("rate_hz", 9600.0))
    if _given(own["sensor"], "bandwidth_hz", "rate_hz") and bandwidth > 0.45 * rate:
        allowed = f"allowed: up to 0.45 of rate_hz, {0.45 * rate:g}; leave it out for the whole band"
        yield Fault(f"{where}sensor.bandwidth_hz", show(bandwidth), allowed)
    wear, thickness = _number(tire.get("wear_mm", 0.0)), _number(tire.get("ring_thickness_mm", 15.0))
    if _given(own["tire"], "wear_mm", "ring_thickness_mm") and wear > 0.8 * thickness:
        allowed = f"allowed: up to 0.8 of ring_thickness_mm, {0.8 * thickness:g}"
        yield Fault(f"{where}tire.wear_mm", show(wear), allowed)
    drum, radius = _number(tire.get("drum_radius_mm")), _number(tire.get("radius_mm", 320.0))
    if _given(own["tire"], "drum_radius_mm", "radius_mm") and -radius <= drum <= 0.0:
        allowed = f"allowed: more than 0, or below -radius_mm = {-radius:g} for an inner drum"
        yield Fault(f"{where}tire.drum_radius_mm", show(drum), allowed)
    speed = motion.get("speed_kmh")
    stated = _given(own["motion"], "repeat", "speed_kmh") and motion.get("repeat") is True
    if stated and isinstance(speed, list) and len(speed) > 1:
        ends = [point[1] for point in (speed[0], speed[-1]) if isinstance(point, list) and len(point) == 2]
        if len(ends) == 2 and ends[0] != ends[1]:
            yield Fault(f"{where}motion.speed_kmh", show(speed), "repeated, it must end at the speed it begins with")


def _given(table: Mapping[str, Any], *names: str) -> bool:
    return any(name in table for name in names)


def _number(value: object) -> float:
    """Return a number as such, NaN for anything else: no comparison with it is true."""
    return float(value) if isinstance(value, int | float) and not isinstance(value, bool) else math.nan


def _list(value: object) -> list[Any]:
    return value if isinstance(value, list) else []


def _table(value: object) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else {}
