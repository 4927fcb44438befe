"""Random tires with a sensor and a drive: the truth of a bench case."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np

from gateway.core.config.toml_writer import toml_text
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.ring.reference_tire import TABLE_3_NUMBERS, TABLE_3_PRESSURE_PA, TABLE_3_RADIUS_M
from gateway.ring.rolling_ring import RingNotConvergedError, RingParameters, solve_rolling_ring
from gateway.simulator.scenario import parse_scenario
from gateway.simulator.wheel_plan import WheelPlan, wheel_plans

REVOLUTIONS: Final = 48
RING_NODES: Final = 2880
# Without extension, for the plain tire: a belt of 20 GN stretches by a millionth.
STIFF_BELT_MN: Final = 20_000.0
REFERENCE_DEGC: Final = 25.0
# Contact stiffness of the tread over pressure, on the reference tire 70 MPa at 2.1 bar.
TREAD_PER_PRESSURE: Final = 7e7 / TABLE_3_PRESSURE_PA
# Samples that a revolution needs, so that its waveform is there at all.
_LEAST_SAMPLES: Final = 60.0
_SPREAD: Final = (0.35, 0.2, 0.25, 0.4)
# Standard errors of a sensor's data sheet, as the configuration assumes them: gain in percent, zero-g offset in m/s^2.
# Assumed when nothing is stated, and of a cheaper sensor, stated.
GAIN_STDS_PERCENT: Final = (1.5, 3.0)
ZERO_G_STD_MPS2: Final = 1.0


@dataclass(frozen=True, slots=True)
class TireClass:
    """Ranges of one kind of vehicle: belt radius, pressure, speed, load over p0 R^2; breadth is of the belt's Cw."""

    name: str
    share: float
    radius_m: tuple[float, float]
    pressure_pa: tuple[float, float]
    speed_kmh: tuple[float, float]
    thickness_mm: tuple[float, float]
    load_number: tuple[float, float] = (0.13, 0.34)
    breadth: float = 1.0


CLASSES: Final = (
    TireClass("car", 0.6, (0.27, 0.36), (1.5e5, 3.2e5), (30.0, 250.0), (12.0, 18.0)),
    TireClass("van", 0.2, (0.32, 0.40), (2.5e5, 5.0e5), (30.0, 150.0), (15.0, 22.0)),
    TireClass("truck", 0.2, (0.40, 0.56), (5.0e5, 8.0e5), (30.0, 110.0), (20.0, 30.0)),
)


@dataclass(frozen=True, slots=True)
class World:
    """The truth of one run; SI units unless the name says otherwise.

    Attributes:
        kind: class of the vehicle.
        radius_m: belt radius.
        numbers: Bs, Cw, Rs, Ts of the new, cold tire at `reference_pa`.
        reference_pa: the tire's usual pressure.
        pressure_pa: gauge pressure.
        load_n: vertical load.
        speed_kmh: at the start.
        drift_per_s: relative change of the speed per second.
        rate_hz: sampling rate.
        noise_mg_rthz: of the sensor, every axis.
        road_mps2: vibration by the road, rms at 65 km/h.
        offset_m: sensor below the neutral layer.
        gain_std_percent: standard error of the gains, as one of GAIN_STDS_PERCENT.
        gain_error: (3,) relative error of each axis.
        zero_g_mps2: (3,) offset of each axis.
        tilt_deg: roll, pitch and yaw.
        flipped: whether the radial axis points outward and the hello does not say so.
        extension_mn: extension stiffness of the belt.
        tread_mpa: stiffness of the tread.
        damping_nspm2: of sidewall and tread.
        thickness_mm: of the new ring.
        wear_mm: tread wear.
        softening: bending stiffness over that of the cold tire.
        temperature_degc: of the tire and its sensor.
        cord_angle_deg: of the plies; 0 for none.
        ply_separation_mm: of the plies.
        conicity_deg: of the belt.
        lateral: lateral stiffnesses of the belt, by the scenario's keys.
        revolutions: length of the run.
        extra: what else the scenario states, as (table, key, value); a tuple of pairs is a series of (share of the run,
            value).
        link: faults of the link and how it delivers, as (name, size).
    """

    kind: str
    radius_m: float
    numbers: tuple[float, float, float, float]
    reference_pa: float
    pressure_pa: float
    load_n: float
    speed_kmh: float
    rate_hz: float
    noise_mg_rthz: float
    offset_m: float
    gain_std_percent: float
    gain_error: tuple[float, float, float]
    zero_g_mps2: tuple[float, float, float]
    tilt_deg: tuple[float, float, float]
    tread_mpa: float
    thickness_mm: float
    cord_angle_deg: float
    ply_separation_mm: float
    lateral: tuple[tuple[str, float], ...]
    drift_per_s: float = 0.0
    road_mps2: float = 0.0
    flipped: bool = False
    extension_mn: float = STIFF_BELT_MN
    damping_nspm2: tuple[float, float] = (0.0, 0.0)
    wear_mm: float = 0.0
    softening: float = 1.0
    temperature_degc: float = REFERENCE_DEGC
    conicity_deg: float = 0.0
    revolutions: int = REVOLUTIONS
    extra: tuple[tuple[str, str, Any], ...] = ()
    link: tuple[tuple[str, float], ...] = ()

    @property
    def load_number(self) -> float:
        """Load over pressure and radius squared."""
        return self.load_n / (self.pressure_pa * self.radius_m**2)

    @property
    def omega_radps(self) -> float:
        """Angular speed at the start."""
        return self.speed_kmh / 3.6 / self.radius_m

    @property
    def seconds(self) -> float:
        """Length of the run; a braked wheel keeps at least half its speed."""
        steady = (self.revolutions + 2.5) * 2.0 * math.pi / self.omega_radps
        return min(steady, 0.5 / abs(self.drift_per_s)) if self.drift_per_s < 0.0 else steady

    def plan(self) -> WheelPlan:
        """Return the simulated wheel."""
        bs, cw, rs, ts = self.numbers
        foundation, tread = self.damping_nspm2
        end_kmh = self.speed_kmh * (1.0 + self.drift_per_s * self.seconds)
        speed: Any = [[0.0, self.speed_kmh], [self.seconds, end_kmh]] if self.drift_per_s else self.speed_kmh
        roll, pitch, yaw = self.tilt_deg
        tire: dict[str, Any] = {
            **{"radius_mm": 1e3 * self.radius_m, "Bs": bs * self.softening, "Cw": cw, "Rs": rs, "Ts": ts},
            "reference_pressure_kpa": 1e-3 * self.reference_pa,
            "extension_stiffness_mn": self.extension_mn,
            "tread_stiffness_mpa": self.tread_mpa,
            "ring_thickness_mm": self.thickness_mm,
            "wear_mm": self.wear_mm,
            "foundation_damping_nspm2": foundation,
            "tread_damping_nspm2": tread,
            "ring_nodes": RING_NODES,
            "cord_angle_deg": self.cord_angle_deg,
            "ply_separation_mm": self.ply_separation_mm,
            "conicity_deg": self.conicity_deg,
            **dict(self.lateral),
        }
        sensor: dict[str, Any] = {
            "rate_hz": self.rate_hz,
            "range_g": max(20.0, 0.25 * (self.speed_kmh / 3.6) ** 2 / self.radius_m),
            "noise_mg_rthz": [self.noise_mg_rthz] * 3,
            "offset_mm": 1e3 * self.offset_m,
            **{"roll_deg": roll, "pitch_deg": pitch, "yaw_deg": yaw},
            "gain_error_percent": [100.0 * error for error in self.gain_error],
            "zero_g_offset_g": [offset / STANDARD_GRAVITY_MPS2 for offset in self.zero_g_mps2],
            "radial_sign": -1 if self.flipped else 1,
            "sign_declared": not self.flipped,
        }
        wheel: dict[str, Any] = {
            **{"position": "W", "hub": 0, "wheel": 0, "load_n": self.load_n},
            "pressure_kpa": 1e-3 * self.pressure_pa,
            "temperature_degc": self.temperature_degc,
        }
        tables: dict[str, dict[str, Any]] = {
            "scenario": {"name": "validity", "duration_s": self.seconds},
            "motion": {"speed_kmh": speed},
            "road": {"rms_mps2": self.road_mps2, "bandwidth_hz": min(500.0, 0.4 * self.rate_hz)},
            "tire": tire,
            "sensor": sensor,
        }
        for table, key, value in self.extra:
            timed = [[share * self.seconds, v] for share, v in value] if _is_series(value) else value
            (wheel if table == "wheel" else tables.setdefault(table, {}))[key] = timed
        if "hub" in tables:
            tables["hub"] = [{"hub": 0, **tables["hub"]}]  # type: ignore[assignment]
        return wheel_plans(parse_scenario(toml_text({**tables, "wheel": [wheel]}), "validity"))[0]


def _is_series(value: Any) -> bool:
    return isinstance(value, tuple) and isinstance(value[0], tuple)


def with_resistance(world: World, coefficient: float) -> World:
    """Return the tire damped so that it has a coefficient of rolling resistance: half sidewall, half tread, roughly."""
    bs, cw, rs, ts = world.numbers
    scale = world.pressure_pa / TABLE_3_PRESSURE_PA / (world.omega_radps / 56.4)
    # On the reference tire at 65 km/h each of these loses about 0.7 % of the load's work.
    damping = np.array([200.0, 5e4]) * scale * 0.5 * coefficient / 0.007
    for _ in range(3):
        ring = RingParameters.from_numbers(
            **{"Bs": bs * world.softening, "Cw": cw, "Rs": rs, "Ts": ts},
            radius_m=world.radius_m,
            pressure_pa=world.pressure_pa,
            extension_stiffness_n=1e6 * world.extension_mn,
            tread_stiffness_npm2=1e6 * world.tread_mpa,
            foundation_damping_nspm2=float(damping[0]),
            tread_damping_nspm2=float(damping[1]),
        )
        got = solve_rolling_ring(ring, world.load_n, world.pressure_pa, world.omega_radps, nodes=720)
        damping = damping * (coefficient / got.rolling_resistance)
    return replace(world, damping_nspm2=(float(damping[0]), float(damping[1])))


def draw_world(seed: int, index: int, classes: Sequence[TireClass] = CLASSES) -> World:
    """Return the tire of a number, always the same one: plain, as the estimators' models assume it."""
    for attempt in range(20):
        world = _drawn(np.random.default_rng([seed, index, attempt]), classes)
        try:
            bs, cw, rs, ts = world.numbers
            ring = RingParameters.from_numbers(bs, cw, rs, ts, radius_m=world.radius_m, pressure_pa=world.pressure_pa)
            solve_rolling_ring(ring, world.load_n, world.pressure_pa, world.omega_radps, nodes=480)
        except RingNotConvergedError:
            continue
        return world
    raise RuntimeError(f"no tire of seed {seed}, number {index} stands under its load")


def _drawn(rng: np.random.Generator, classes: Sequence[TireClass]) -> World:
    kind = classes[int(rng.choice(len(classes), p=[c.share for c in classes]))]
    radius = float(rng.uniform(*kind.radius_m))
    pressure = float(rng.uniform(*kind.pressure_pa))
    size = pressure / TABLE_3_PRESSURE_PA * (radius / TABLE_3_RADIUS_M) ** 2
    speed = float(np.exp(rng.uniform(*np.log(kind.speed_kmh))))
    rates = np.array([2000.0, 3200.0, 4800.0, 6400.0, 9600.0])
    turns_hz = speed / 3.6 / (2.0 * math.pi * radius)
    rate = float(rng.choice(rates[rates >= _LEAST_SAMPLES * turns_hz]))
    bs, cw, rs, ts = (v * math.exp(rng.uniform(-s, s)) for v, s in zip(TABLE_3_NUMBERS, _SPREAD, strict=True))
    lateral = {
        "lateral_shear_stiffness_mn": 1.6 * size * math.exp(rng.uniform(-0.3, 0.3)),
        "lateral_bending_stiffness_knm2": size * (radius / TABLE_3_RADIUS_M) ** 2 * math.exp(rng.uniform(-0.5, 0.5)),
        "lateral_sidewall_stiffness_mpa": 0.25 * pressure / TABLE_3_PRESSURE_PA * math.exp(rng.uniform(-0.3, 0.3)),
        "lateral_tread_stiffness_mpa": 8.0 * pressure / TABLE_3_PRESSURE_PA * math.exp(rng.uniform(-0.3, 0.3)),
    }
    # From its own generator, so that the draws after it stay what they are.
    gain_std = float(rng.spawn(1)[0].choice(GAIN_STDS_PERCENT))
    gain = 0.01 * gain_std * rng.standard_normal(3)
    zero = ZERO_G_STD_MPS2 * rng.standard_normal(3)
    roll, pitch, yaw = (0.3 * rng.standard_normal(3)).tolist()
    return World(
        kind=kind.name,
        radius_m=radius,
        numbers=(bs, cw * kind.breadth, rs, ts),
        reference_pa=pressure,
        pressure_pa=pressure,
        # A calibration loads it by a third more, and the simulator takes 50 kN.
        load_n=min(float(np.exp(rng.uniform(*np.log(kind.load_number)))) * pressure * radius**2, 38_000.0),
        speed_kmh=speed,
        rate_hz=rate,
        noise_mg_rthz=float(np.exp(rng.uniform(*np.log([1.0, 15.0])))),
        offset_m=1e-3 * float(rng.uniform(0.0, 8.0)),
        gain_std_percent=gain_std,
        gain_error=(float(gain[0]), float(gain[1]), float(gain[2])),
        zero_g_mps2=(float(zero[0]), float(zero[1]), float(zero[2])),
        tilt_deg=(roll, pitch, yaw),
        tread_mpa=1e-6 * TREAD_PER_PRESSURE * pressure * math.exp(rng.uniform(-0.5, 0.5)),
        thickness_mm=float(rng.uniform(*kind.thickness_mm)),
        cord_angle_deg=float(rng.choice([-1.0, 1.0]) * rng.uniform(15.0, 30.0)),
        ply_separation_mm=1.2 * float(rng.uniform(0.7, 1.5)),
        lateral=tuple(lateral.items()),
    )


def ordinary(world: World, rng: np.random.Generator) -> World:
    """Return the tire with what every real tire has: rolling resistance, belt extension, road, a drifting speed."""
    size = world.pressure_pa * world.radius_m / (TABLE_3_PRESSURE_PA * TABLE_3_RADIUS_M)
    return replace(
        with_resistance(world, float(rng.uniform(0.002, 0.012))),
        extension_mn=size * float(np.exp(rng.uniform(*np.log([5.0, 50.0])))),
        road_mps2=float(rng.uniform(0.0, 1.0)),
        drift_per_s=float(rng.uniform(-1e-3, 1e-3)),
    )
