"""Cases: everything true; every parameter by itself; random mixtures; conditions; and what strangers thought of.

Whoever adds a case does not read the rules of doubt before: a size is what people meet, never where a rule begins.
"""

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, Literal

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.tire_data import SOFTENING_PER_K, SOFTENING_STD_PER_K
from validity.draws import draw_all
from validity.later_spoils import EVERY_SPOIL
from validity.ranges import STATED, Span, drawn_size, listed, spans
from validity.statements import NotApplicableError, Statement, known_exactly, moved_to, without_errors
from validity.tires import REFERENCE_DEGC, World, ordinary, with_resistance

Kind = Literal["true", "one", "two", "normal", "conditions", "stranger", "hidden"]
Told = tuple[World, Statement]
Change = Callable[[World, Statement, float, np.random.Generator], Told]

AIMS_PERCENT: Final[dict[Kind, float | None]] = {
    "true": 0.0, "one": 0.3, "two": 0.6, "normal": 0.3, "conditions": 0.2, "stranger": 1.0, "hidden": None,
}  # fmt: skip
BENDS_REVOLUTIONS: Final = 110
# Curves to both sides of a run: shares of it, and how far each goes.
_BENDS: Final = (
    (0.0, 0.0), (0.18, 0.0), (0.22, 1.0), (0.38, 1.0), (0.42, 0.0),
    (0.58, 0.0), (0.62, -1.0), (0.78, -1.0), (0.82, 0.0), (1.0, 0.0),
)  # fmt: skip
AIM_OF_A_QUANTITY_PERCENT: Final = 1.0


@dataclass(frozen=True, slots=True)
class Case:
    """One thing that is other than stated or than the models take it.

    Attributes:
        name: for --case.
        span: sizes; each tire gets a random one.
        change: makes the case from a plain tire of which everything stated is true.
        about: one line.
        kind: table that it belongs to.
        ring_only: whether only the exact ring follows it.
    """

    name: str
    span: Span
    change: Change
    about: str
    kind: Kind = "one"
    ring_only: bool = False

    @property
    def well(self) -> bool:
        """Whether everything stated is true."""
        return self.kind == "true"

    def size(self, seed: int, tire: int) -> float:
        """Return the size that a tire gets."""
        rng = np.random.default_rng([seed, tire, zlib.crc32(self.name.encode()), 7])
        return drawn_size(self.span, float(rng.random()), float(rng.choice([-1.0, 1.0])))


def set_value(world: World, said: Statement, key: str, value: Any, axis: int | None = None) -> Told:
    """Return a tire and its statement with a parameter set; a statement that is made of it stays true."""
    table, _, name = key.partition(".")
    if key.startswith(STATED):
        return world, replace(said, edits=(*said.edits, (key.removeprefix(STATED), "is", value)))
    if table == "link" or key.startswith("link:"):
        return replace(world, link=(*world.link, (key[5:], float(value)))), said
    if key == "hello:rate_hz":
        return world, replace(said, rate_factor=said.rate_factor * (1.0 + 0.01 * value))
    if key == "hello:axes":
        first, second, third = (int(digit) for digit in f"{int(value):03d}")
        return world, replace(said, axes=(first, second, third))
    if ":" in key:
        return world, replace(said, told=(*said.told, (key, value, axis)))
    after = _with_field(world, key, value, axis)
    if after is not None:
        said = moved_to(said, world, after)
        return after, replace(said, thickness_mm=said.thickness_mm + after.thickness_mm - world.thickness_mm)
    if axis is not None:
        # Three numbers, the other two as they are without it.
        value = tuple(value if index == axis else 0.0 for index in range(3))
    return replace(world, extra=(*world.extra, (table, name, value))), said


# Fields of a `World`, with their scales.
_FIELDS: Final = {
    "sensor.offset_mm": ("offset_m", 1e-3), "tire.wear_mm": ("wear_mm", 1.0),
    "tire.conicity_deg": ("conicity_deg", 1.0), "tire.cord_angle_deg": ("cord_angle_deg", 1.0),
    "tire.ply_separation_mm": ("ply_separation_mm", 1.0), "tire.tread_stiffness_mpa": ("tread_mpa", 1.0),
    "tire.extension_stiffness_mn": ("extension_mn", 1.0), "tire.ring_thickness_mm": ("thickness_mm", 1.0),
    "road.rms_mps2": ("road_mps2", 1.0), "wheel.temperature_degc": ("temperature_degc", 1.0),
}  # fmt: skip
_AXES: Final = {"sensor.gain_error_percent": ("gain_error", 0.01),
                "sensor.zero_g_offset_g": ("zero_g_mps2", STANDARD_GRAVITY_MPS2)}  # fmt: skip
_PLACES: Final = {
    "sensor.roll_deg": ("tilt_deg", 0), "sensor.pitch_deg": ("tilt_deg", 1), "sensor.yaw_deg": ("tilt_deg", 2),
    "tire.foundation_damping_nspm2": ("damping_nspm2", 0), "tire.tread_damping_nspm2": ("damping_nspm2", 1),
}  # fmt: skip


def _with_field(world: World, key: str, value: Any, axis: int | None) -> World | None:
    """Return the tire with one of its own fields set, None where it has none for a parameter."""
    if key in _FIELDS:
        name, scale = _FIELDS[key]
        return replace(world, **{name: scale * value})
    name, index, scale = "", axis, 1.0
    if key in _AXES:
        name, scale = _AXES[key]
    elif key in _PLACES:
        name, index = _PLACES[key]
    if not name or index is None:
        return None
    items = list(getattr(world, name))
    items[index] = scale * value
    return replace(world, **{name: tuple(items)})


def ramp(world: World, key: str, change: float) -> World:
    """Return the tire with its load, pressure (by percent) or temperature (by kelvins) running to another value."""
    now = {"wheel.load_n": world.load_n, "wheel.pressure_kpa": 1e-3 * world.pressure_pa,
           "wheel.temperature_degc": world.temperature_degc}[key]  # fmt: skip
    end = now + change if key == "wheel.temperature_degc" else now * (1.0 + 0.01 * change)
    return replace(world, extra=(*world.extra, ("wheel", key.partition(".")[2], ((0.0, now), (0.25, now), (1.0, end)))))


def _set(span: Span, world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    """Set a parameter, and what it needs beside it."""
    for key, value in span.beside:
        if key.startswith("wheel.pressure"):
            world = ramp(world, key, value)
        else:
            world, said = set_value(world, said, key, value, span.axis if span.key.startswith(key) else None)
    value: Any = size
    if span.way == "choice":
        value = span.sizes[int(size)]
        value = value.split("+") if isinstance(value, str) and "+" in value else value
        value = tuple(value) if isinstance(value, list) else (value,) if span.key.endswith(".axes") else value
        value = int(value) if isinstance(value, float) and value.is_integer() and span.key.endswith("sign") else value
    elif span.way == "ramp":
        return ramp(world, span.key, size), said
    elif span.way == "share":
        value = size * world.seconds
    elif span.key == "defect.clip_g":
        # In percent of the steady value.
        value = 0.01 * size * world.radius_m * world.omega_radps**2 / STANDARD_GRAVITY_MPS2
    elif span.key in ("hub.boot_count", "link:silence"):
        value = round(size)
    if span.key.startswith(STATED):
        path = span.key.removeprefix(STATED)
        return world, replace(said, edits=(*said.edits, (path, span.way, value)))
    return set_value(world, said, span.key, value, span.axis)


# Where the statement follows the parameter, or the models have it, nothing is wrong.
_TRUE: Final = frozenset({"sensor.offset_mm", "tire.ring_thickness_mm", "tire.cord_angle_deg", "wheel.phase_deg"})


def _case(span: Span) -> Case:
    # Nothing but a statement can say that its error is larger than it says, nor that a band is narrower.
    hidden = span.is_error or span.key == "sensor.bandwidth_hz"
    kind: Kind = "hidden" if hidden else "true" if span.key in _TRUE else "one"
    return Case(span.name, span, partial(_set, span), span.source, kind, span.ring_only)


def _plain(world: World, said: Statement, _: float, __: np.random.Generator) -> Told:
    return world, said


def _without_errors(world: World, said: Statement, _: float, __: np.random.Generator) -> Told:
    none = (0.0, 0.0, 0.0)
    world = replace(world, gain_error=none, zero_g_mps2=none, tilt_deg=none)
    return world, known_exactly(world, said)


def _ordinary(world: World, said: Statement, _: float, rng: np.random.Generator) -> Told:
    return ordinary(world, rng), said


def _unstated(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    return replace(world, offset_m=1e-3 * size), replace(said, offset_mm=None)


def _normal(world: World, said: Statement, _: float, rng: np.random.Generator) -> Told:
    """Everything is off by the error that is assumed where none is stated; a sensor by its data sheet."""
    errors = rng.standard_normal(10).tolist()
    said = replace(
        without_errors(said),
        radius_mm=1e3 * world.radius_m * (1.0 + 0.01 * errors[0]),
        load_n=world.load_n * (1.0 + 0.1 * max(-3.0, min(3.0, errors[1]))),
        pressure_factor=1.0 + 0.05 * errors[2],
        thickness_mm=world.thickness_mm + 0.2 * errors[3],
        offset_mm=None if said.offset_mm is None else 1e3 * world.offset_m + errors[4],
        rate_factor=1.0 + 2e-5 * errors[5],
    )
    roll, pitch, yaw = (1.5 * error for error in errors[6:9])
    world = replace(ordinary(world, rng), tilt_deg=(roll, pitch, yaw))
    return set_value(world, said, "sensor.cross_axis_percent", errors[9])


def _steps(world: World, table: str, key: str, points: Sequence[tuple[float, float]]) -> World:
    return replace(world, extra=(*world.extra, (table, key, tuple(points))))


def _speeding(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    end = world.speed_kmh * (1.0 + 0.01 * size)
    return _steps(world, "motion", "speed_kmh", ((0.0, world.speed_kmh), (0.3, world.speed_kmh), (1.0, end))), said


def _braking(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    """Brake by `size` of the load, or pull away, for at most half of the speed."""
    torque = -size * world.load_n * world.radius_m
    lost = max(-0.5, min(3.6 * size * STANDARD_GRAVITY_MPS2 * world.seconds / world.speed_kmh, 0.5))
    world, said = set_value(world, said, "tire.axle_torque_nm", torque)
    return _speeding(world, said, -100.0 * lost, np.random.default_rng(0))


def _rough(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    world, said = set_value(world, said, "road.profile", "BCDE"[min(int(size), 3)])
    world, said = set_value(world, said, "road.rms_mps2", 0.5 * 2.0 ** int(size))
    return set_value(world, said, "vibration.hub_rms_mps2", 0.3 * 2.0 ** int(size))


def _curve(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    """Drive a curve of `size` m/s^2: yaw, slip of 1 deg for 2 m/s^2, a load transfer of 4 % for 1 m/s^2."""
    speed = world.speed_kmh / 3.6
    yaw = max(-100.0, min(100.0, math.degrees(size / speed)))
    world = _steps(world, "motion", "yaw_rate_degps", ((0.0, 0.0), (0.3, 0.0), (0.6, yaw), (1.0, yaw)))
    world = _steps(world, "wheel", "slip_angle_deg", ((0.0, 0.0), (0.3, 0.0), (0.6, 0.5 * size), (1.0, 0.5 * size)))
    load = world.load_n
    after = load * (1.0 + 0.04 * size)
    return _steps(world, "wheel", "load_n", ((0.0, load), (0.3, load), (0.6, after), (1.0, after))), said


def _slalom(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    """Drive a slalom of `size` m/s^2: as a curve to one side and the other, with 0.3 deg of camber for 1 m/s^2."""
    hz, speed = float(rng.uniform(0.15, 0.5)), world.speed_kmh / 3.6
    yaw = max(-100.0, min(100.0, math.degrees(size / speed)))
    for table, key, mean, swing in (
        ("motion", "yaw_rate_degps", 0.0, yaw),
        ("wheel", "slip_angle_deg", 0.0, 0.5 * size),
        ("wheel", "camber_deg", 0.0, 0.3 * size),
        ("wheel", "load_n", world.load_n, 0.04 * size * world.load_n),
    ):
        world = _steps(world, table, key, _waves(world, swing, mean, hz))
    return world, said


def _bends(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    """Drive a curve of `size` m/s^2 to one side and one to the other, with straights before, between and behind."""
    world = replace(world, revolutions=BENDS_REVOLUTIONS)
    yaw = max(-100.0, min(100.0, math.degrees(size / (world.speed_kmh / 3.6))))
    for table, key, mean, change in (
        ("motion", "yaw_rate_degps", 0.0, yaw),
        ("wheel", "slip_angle_deg", 0.0, 0.5 * size),
        ("wheel", "camber_deg", 0.0, 0.3 * size),
        ("wheel", "load_n", world.load_n, 0.04 * size * world.load_n),
    ):
        world = _steps(world, table, key, [(share, mean + side * change) for share, side in _BENDS])
    return world, said


def _steering(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    """Steer to and fro by `size` m/s^2 at the frequencies of a lane change, with straights before, between, behind."""
    world = replace(world, revolutions=BENDS_REVOLUTIONS)
    shares = np.linspace(0.0, 1.0, 1 + 4 * BENDS_REVOLUTIONS)
    steers = np.interp(shares, *np.abs(np.array(_BENDS)).T)
    steers *= np.sin(2.0 * math.pi * float(rng.uniform(0.5, 1.5)) * world.seconds * shares)
    yaw = max(-100.0, min(100.0, math.degrees(size / (world.speed_kmh / 3.6))))
    for table, key, change in (("motion", "yaw_rate_degps", yaw), ("wheel", "slip_angle_deg", 0.5 * size)):
        points = zip(shares.tolist(), (change * steers).tolist(), strict=True)
        world = _steps(world, table, key, list(points))
    return world, said


def _road(key: str, world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    """Roll over a road whose grade or crossfall of `size` deg changes within 80 to 300 m."""
    world = replace(world, revolutions=BENDS_REVOLUTIONS)
    hz = world.speed_kmh / 3.6 / float(rng.uniform(80.0, 300.0))
    return _steps(world, "motion", key, _waves(world, size, float(rng.uniform(-0.5, 0.5)) * size, hz)), said


def _travel(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    """Let the suspension camber the wheel by `size` deg to and fro, as on a wavy road."""
    return _steps(world, "wheel", "camber_deg", _waves(world, size, 0.0, float(rng.uniform(0.8, 2.0)))), said


def _wet(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    """Roll on a wet road: friction `size`, a cool tire, and some slip."""
    world, said = set_value(world, said, "tire.lateral_friction", size)
    world, said = set_value(world, said, "wheel.slip_angle_deg", float(rng.uniform(-1.0, 1.0)))
    return _hot(world, said, -12.0, rng)


def _hot(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    """Run `size` K from the temperature of the reference: softer rubber, and the pressure that follows."""
    softening = rng.normal(SOFTENING_PER_K, SOFTENING_STD_PER_K)
    gauge = (world.pressure_pa + 1e5) * (1.0 + size / 298.0) - 1e5
    after = replace(
        world,
        temperature_degc=REFERENCE_DEGC + size,
        softening=world.softening * math.exp(-max(softening, 0.0) * size),
        pressure_pa=gauge,
    )
    edit = ("tire.reference.temperature_degc", "is", REFERENCE_DEGC)
    return after, said if said.reference is None else replace(said, edits=(*said.edits, edit))


def _warming(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    world = ramp(world, "wheel.temperature_degc", size)
    world = ramp(world, "wheel.pressure_kpa", 100.0 * size / 298.0 * (1.0 + 1e5 / world.pressure_pa))
    drift = tuple(rng.normal(0.0, 0.02, 3).tolist())
    return replace(world, extra=(*world.extra, ("sensor", "gain_drift_percent_per_k", drift))), said


def _loading(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    after = world.load_n * (1.0 + 0.01 * size)
    load = world.load_n
    return _steps(world, "wheel", "load_n", ((0.0, load), (0.5, load), (0.52, after), (1.0, after))), said


def _kerb(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    """Run over a kerb that loads the wheel by `size` percent for 2 % of the run."""
    load, high = world.load_n, world.load_n * (1.0 + 0.01 * size)
    points = ((0.0, load), (0.5, load), (0.505, high), (0.515, high), (0.52, load), (1.0, load))
    return _steps(world, "wheel", "load_n", points), said


def _winter_compound(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    """Run 25 K colder than the reference on a rubber that softens by `size` percent per kelvin."""
    cold = replace(world, temperature_degc=REFERENCE_DEGC - 25.0, softening=world.softening * math.exp(0.25 * size))
    edit = ("tire.reference.temperature_degc", "is", REFERENCE_DEGC)
    return cold, said if said.reference is None else replace(said, edits=(*said.edits, edit))


def _leak(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    return ramp(world, "wheel.pressure_kpa", -size), said


def _lost(in_a_row: int, world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    return world, replace(said, lost=(0.01 * size, in_a_row))


def _lossy(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    return with_resistance(world, size), said


def _spoil(name: str, world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    return world, replace(said, spoils=(*said.spoils, (name, size)))


def _wander(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    return world, replace(said, wander=(1e-6 * size, float(rng.uniform(0.05, 0.5))))


def _toe(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    world, said = set_value(world, said, "wheel.slip_angle_deg", size)
    return set_value(world, said, "wheel.camber_deg", -2.0 * abs(size) * float(rng.uniform(0.5, 1.5)))


def _waves(world: World, swing: float, mean: float, frequency_hz: float) -> list[tuple[float, float]]:
    """Return points of a wave of an amplitude about a mean, over the share of the run."""
    count = max(int(8.0 * frequency_hz * world.seconds), 8)
    share = (np.arange(count + 1) / count).tolist()
    return [(t, mean + swing * math.sin(2.0 * math.pi * frequency_hz * t * world.seconds)) for t in share]


def _hop(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    return _steps(world, "wheel", "load_n", _waves(world, 0.01 * size * world.load_n, world.load_n, 12.0)), said


def _jerks(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    points = _waves(world, 0.01 * size * world.speed_kmh, world.speed_kmh, float(rng.uniform(1.0, 4.0)))
    return _steps(world, "motion", "speed_kmh", points), said


def _chain(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    world, said = set_value(world, said, "tread_pitch.amplitude_percent", size)
    return set_value(world, said, "tread_pitch.blocks", 16.0)


def _bent_rim(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    world, said = set_value(world, said, "tire.runout_mm", size)
    world, said = set_value(world, said, "tire.runout_deg", float(rng.uniform(-180.0, 180.0)))
    return set_value(world, said, "vibration.imbalance_mps2", 2.0 * size)


def _other_tire(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
    if said.reference is None:
        raise NotApplicableError
    bs, cw, rs, ts = (np.array(world.numbers) * np.exp(0.01 * size * rng.standard_normal(4))).tolist()
    return world, replace(said, reference=(bs, cw, rs, ts))


def _edited(path: str, way: str, world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    return world, replace(said, edits=(*said.edits, (path, way, size)))


def _depth_from_inside(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    return world, replace(said, offset_mm=size - 1e3 * world.offset_m)


def _altitude(world: World, said: Statement, size: float, _: np.random.Generator) -> Told:
    edit = ("tire.pressure_std_kpa", "is", None)
    return world, replace(said, pressure_factor=1.0 + 1e3 * size / world.pressure_pa, edits=(*said.edits, edit))


_ZERO: Final = Span("", "is", (0.0, 0.0))
_TRUES: Final = (
    Case("plain", _ZERO, _plain, "everything true, on the ring that the estimators assume", "true"),
    Case("known", _ZERO, _without_errors, "everything stated without an error, and a perfect sensor", "true"),
    Case("ordinary", _ZERO, _ordinary, "everything true; losses, extension, road, drift", "true"),
    Case("depth-unstated", Span("", "is", (0.1, 12.0)), _unstated, "no depth stated", "true"),
)
# What a name of the table stands for; what sensors do to their samples is in `spoils`.
_CHANGES: Final[dict[str, Change]] = {
    "speeding": _speeding,
    "braking": _braking,
    "rough-road": _rough,
    "curve": _curve,
    "slalom": _slalom,
    "bends": _bends,
    "steering": _steering,
    "hills": partial(_road, "grade_deg"),
    "crossfall": partial(_road, "bank_deg"),
    "suspension": _travel,
    "wet": _wet,
    "hot": _hot,
    "frost": _hot,
    "warming": _warming,
    "load-step": _loading,
    "leak": _leak,
    "kerb": _kerb,
    "winter-compound": _winter_compound,
    "lossy-tire": _lossy,
    "lost-frames": partial(_lost, 1),
    "lost-bursts": partial(_lost, 8),
    "clock-wanders": _wander,
    "toe-and-camber": _toe,
    "wheel-hop": _hop,
    "jerks": _jerks,
    "snow-chain": _chain,
    "bent-rim": _bent_rim,
    "loaded-radius": partial(_edited, "tire.radius_mm", "times"),
    "other-tire": _other_tire,
    "depth-from-inside": _depth_from_inside,
    "altitude": _altitude,
    "tread-for-ring": partial(_edited, "tire.ring_thickness_mm", "is"),
    **{name: partial(_spoil, name) for name in EVERY_SPOIL},
}
_RING_ONLY: Final = frozenset({"braking", "rough-road", "snow-chain", "bent-rim"})


def _named(kind: Kind) -> tuple[Case, ...]:
    """Return the cases of a kind that the table names."""
    rows = ((key.partition(":")[2], span) for key, span in listed().items() if key.startswith(f"{kind}:"))
    return tuple(Case(name, span, _CHANGES[name], span.source, kind, name in _RING_ONLY) for name, span in rows)


NORMAL: Final = Case("normal", _ZERO, _normal, "everything off by its normal error", "normal")
DRAWN: Final = Case("drawn", _ZERO, draw_all, "every statement off by the error that is stated of it", "true")
CASES: Final[tuple[Case, ...]] = (*_TRUES, *map(_case, spans()), *_named("conditions"), *_named("stranger"))
SINGLE: Final = tuple(case for case in CASES if case.kind == "one")


def together(first: Case, second: Case) -> Case:
    """Return two at once; the second gets a size of its own."""

    def change(world: World, said: Statement, size: float, rng: np.random.Generator) -> Told:
        second_size = drawn_size(second.span, float(rng.random()), float(rng.choice([-1.0, 1.0])))
        return second.change(*first.change(world, said, size, rng), second_size, rng)

    kind: Kind = "normal" if first is NORMAL else "two"
    ring_only = first.ring_only or second.ring_only
    return Case(f"{first.name} + {second.name}", first.span, change, "both", kind, ring_only)


def drawn(count: int, seed: int, tire: int) -> list[Case]:
    """Return random cases of a tire: so many pairs of single ones, and as many beside normal errors."""
    rng = np.random.default_rng([seed, tire, 2])
    cases = []
    for _ in range(count):
        first, second = rng.choice(len(SINGLE), 2, replace=False).tolist()
        # What replaces the statement comes first.
        cases += [together(SINGLE[first], SINGLE[second]), together(NORMAL, SINGLE[second])]
    return cases


def named(names: Sequence[str] | None) -> list[Case]:
    """Return cases by name, two with a plus between them; all for None.

    Raises:
        ValueError: there is no such case.
    """
    by_name = {case.name: case for case in (*CASES, NORMAL, DRAWN)}
    chosen = []
    for name in names or [case.name for case in CASES]:
        first, _, second = name.partition(" + ")
        if missing := {first, second or first} - by_name.keys():
            raise ValueError(f"no case {', '.join(sorted(missing))}; cases are {', '.join(by_name)}")
        chosen.append(together(by_name[first], by_name[second]) if second else by_name[first])
    return chosen
