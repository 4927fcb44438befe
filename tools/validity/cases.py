"""Cases: everything true, and every single misstatement at several sizes."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Literal

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from validity.statements import Statement, known_exactly, moved_to, without_errors
from validity.tires import TREAD_PER_PRESSURE, World, ordinary, with_resistance

# Of the sampling rate, which a band is below.
_BAND_OF_RATE: Final = 0.45

Kind = Literal["true", "one", "two", "conditions", "normal", "hidden"]
Change = Callable[[World, Statement, float, np.random.Generator], tuple[World, Statement]]


@dataclass(frozen=True, slots=True)
class Case:
    """One misstatement.

    Attributes:
        name: for --case.
        unit: of the sizes.
        sizes: each tire gets one of them, in turn.
        change: makes the case from a plain tire of which everything stated is true.
        about: one line.
        kind: table that it belongs to.
        tire: whether it changes the tire, its load or its drive, which only the exact ring follows.
    """

    name: str
    unit: str
    sizes: tuple[float, ...]
    change: Change
    about: str
    kind: Kind = "one"
    tire: bool = False

    @property
    def well(self) -> bool:
        """Whether everything stated is true."""
        return self.kind == "true"


def _plain(world: World, said: Statement, _: float, __: np.random.Generator) -> tuple[World, Statement]:
    return world, said


def _known(world: World, said: Statement, _: float, __: np.random.Generator) -> tuple[World, Statement]:
    nothing = (0.0, 0.0, 0.0)
    perfect = replace(world, gain_error=nothing, zero_g_mps2=nothing, tilt_deg=nothing)
    return perfect, known_exactly(perfect, said)


def _ordinary(world: World, said: Statement, _: float, rng: np.random.Generator) -> tuple[World, Statement]:
    return ordinary(world, rng), said


def _depth_unstated(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return replace(world, offset_m=1e-3 * size), replace(said, offset_mm=None)


def _depth(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return world, replace(said, offset_mm=1e3 * world.offset_m + size)


def _rate(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return world, replace(said, rate_factor=size)


def _radius(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return world, replace(said, radius_mm=1e3 * world.radius_m * (1.0 + 0.01 * size))


def _unit(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return world, replace(said, unit_factor=size)


def _gain(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return replace(world, gain_error=(0.01 * size,) * 3), said


def _zero_g(world: World, said: Statement, size: float, rng: np.random.Generator) -> tuple[World, Statement]:
    first, second = rng.uniform(-size, size, 2).tolist()
    last = float(rng.choice([-size, size]))
    return replace(world, zero_g_mps2=tuple(STANDARD_GRAVITY_MPS2 * g for g in (first, second, last))), said


def _sign(world: World, said: Statement, _: float, __: np.random.Generator) -> tuple[World, Statement]:
    return replace(world, flipped=True), said


def _resistance(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return with_resistance(world, 0.01 * size), said


def _drift(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return replace(world, drift_per_s=0.01 * size), said


def _worn(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return replace(world, wear_mm=size), replace(said, left_out=("wear",))


def _worn_known(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return replace(world, wear_mm=size), said


def _soft(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    # About half a percent of the stiffness per kelvin.
    warmer = replace(world, softening=1.0 - 0.01 * size, temperature_degc=world.temperature_degc + 2.0 * size)
    return warmer, said


def _load(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return world, replace(said, load_n=world.load_n * (1.0 + 0.01 * size), load_std_n=None)


def _pressure(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return world, replace(said, pressure_factor=1.0 + 0.01 * size, pressure_std_kpa=None)


def _load_known(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return world, replace(said, load_n=world.load_n * (1.0 + 0.01 * size))


def _pressure_known(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return world, replace(said, pressure_factor=1.0 + 0.01 * size)


def _swapped(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    first, second = ((0, 1), (1, 2), (0, 2))[int(size)]
    axes = [0, 1, 2]
    axes[first], axes[second] = second, first
    return world, replace(said, axes=(axes[0], axes[1], axes[2]))


def _late(axis: int) -> Change:
    def change(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
        late = [0.0, 0.0, 0.0]
        late[axis] = 1e-3 * size
        return world, replace(said, late_s=(late[0], late[1], late[2]))

    return change


def _lost(in_a_row: int) -> Change:
    def change(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
        return world, replace(said, lost=(0.01 * size, in_a_row))

    return change


def _tilt(world: World, said: Statement, size: float, rng: np.random.Generator) -> tuple[World, Statement]:
    roll, pitch, yaw = (size * rng.choice([-1.0, 1.0], 3)).tolist()
    return replace(world, tilt_deg=(roll, pitch, yaw)), said


def _references(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    bs, cw, rs, ts = world.numbers
    return world, replace(said, reference=(bs * (1.0 + 0.02 * size), cw * (1.0 + 0.01 * size), rs, ts))


def _normal(world: World, said: Statement, _: float, rng: np.random.Generator) -> tuple[World, Statement]:
    """Everything off by an error that a tire engineer would call normal, and none of the errors stated."""
    radius, load, pressure, rate, depth, *zero = rng.standard_normal(8).tolist()
    gain = (0.015 * rng.standard_normal(3)).tolist()
    world = replace(world, gain_error=(gain[0], gain[1], gain[2]), zero_g_mps2=(zero[0], zero[1], zero[2]))
    return world, replace(
        without_errors(said),
        radius_mm=1e3 * world.radius_m * (1.0 + 0.01 * radius),
        load_n=world.load_n * (1.0 + 0.05 * load),
        pressure_factor=1.0 + 0.03 * pressure,
        rate_factor=1.0 + 1e-4 * rate,
        offset_mm=1e3 * world.offset_m + depth,
    )


def _while_driving(*extra: tuple[str, str, Callable[[World, float], Any]]) -> Change:
    """Return a change of the drive, which is stated rightly at its start."""

    def change(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
        return replace(world, extra=tuple((table, key, of(world, size)) for table, key, of in extra)), said

    return change


def _turns_hz(world: World) -> float:
    return world.omega_radps / (2.0 * math.pi)


def _step(before: float, after: float) -> tuple[tuple[float, float], ...]:
    return (0.0, before), (0.5, before), (0.51, after)


def _conicity(world: World, said: Statement, size: float, rng: np.random.Generator) -> tuple[World, Statement]:
    return replace(world, cord_angle_deg=0.0, conicity_deg=size * float(rng.choice([-1.0, 1.0]))), said


def _light(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    lighter = world.at_number(size)
    return lighter, moved_to(said, world, lighter)


def _tread(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    relative = size / (1e-6 * TREAD_PER_PRESSURE * 2.1e5)
    return replace(world, tread_mpa=relative * 1e-6 * TREAD_PER_PRESSURE * world.pressure_pa), said


def _both(*sizes: float) -> tuple[float, ...]:
    return (*(-size for size in reversed(sizes)), *sizes)


CASES: Final[tuple[Case, ...]] = (
    Case("plain", "", (0.0,), _plain, "everything true, on the ring that the estimators assume", kind="true"),
    Case("known", "", (0.0,), _known, "everything stated without an error, and a perfect sensor", kind="true"),
    Case(
        "ordinary",
        "",
        (0.0,),
        _ordinary,
        "everything true; losses, extension, road, drift",
        kind="true",
        tire=True,
    ),
    Case("depth-unstated", "mm", (0.0, 2.0, 4.0, 6.0, 9.0, 12.0), _depth_unstated, "no depth stated", kind="true"),
    Case("depth", "mm", _both(1.0, 2.0, 4.0, 8.0), _depth, "another depth of the sensor stated"),
    Case("rate", "times", (0.5, 0.9, 0.95, 1.05, 2.0), _rate, "another sampling rate stated"),
    Case("radius", "%", _both(1.0, 2.0, 4.0, 7.0, 10.0), _radius, "another radius stated"),
    Case("unit", "times", (STANDARD_GRAVITY_MPS2, 1.0 / STANDARD_GRAVITY_MPS2), _unit, "g for m/s^2, or the reverse"),
    Case("gain", "%", _both(2.0, 5.0, 10.0, 20.0), _gain, "gain of all axes"),
    Case("zero-g", "g", (0.1, 0.3, 1.0, 2.0, 5.0), _zero_g, "zero-g offsets"),
    Case("sign", "", (0.0,), _sign, "radial axis points outward, not stated"),
    Case("resistance", "%", (0.5, 1.0, 2.0, 3.0), _resistance, "rolling resistance", tire=True),
    Case("drift", "%/s", _both(0.1, 0.3, 1.0, 3.0), _drift, "speed changes", tire=True),
    Case("worn", "mm", (1.5, 3.0, 5.0), _worn, "worn tread, no wear estimator", tire=True),
    Case("worn-known", "mm", (1.5, 3.0, 5.0), _worn_known, "worn tread, with wear estimator", tire=True),
    Case("soft-rubber", "%", (5.0, 15.0, 30.0), _soft, "bending stiffness reduced by warmth", tire=True),
    Case("load", "%", _both(5.0, 10.0, 20.0), _load, "another load stated, without an error"),
    Case("pressure", "%", _both(5.0, 10.0, 20.0), _pressure, "pressure sensor in error, none stated"),
    Case("references", "%", _both(2.0, 4.0, 8.0), _references, "Cw of the reference off, Bs by twice as much"),
    Case("tilt", "deg", (1.0, 3.0, 6.0, 10.0), _tilt, "sensor askew about all axes"),
    Case("swapped", "axes", (0.0, 1.0, 2.0), _swapped, "two axes swapped"),
    Case("late-circumferential", "ms", (0.3, 1.0, 2.5), _late(0), "circumferential axis late"),
    Case("late-lateral", "ms", (0.3, 1.0, 2.5), _late(1), "lateral axis late"),
    Case("conicity", "deg", (0.1, 0.3, 0.6), _conicity, "conicity in place of ply steer", tire=True),
    Case("light", "load number", (0.03, 0.05, 0.08), _light, "light load", tire=True),
    Case("tread", "MPa at 2.1 bar", (15.0, 30.0, 200.0, 400.0), _tread, "soft or stiff tread", tire=True),
    # Off by many of the errors that are stated for them: nothing but another statement can say so.
    Case("load-as-weighed", "%", _both(5.0, 10.0, 20.0), _load_known, "load off, its error stated as 1 %", "hidden"),
    Case("pressure-as-checked", "%", _both(5.0, 10.0, 20.0), _pressure_known, "pressure off, 0.5 % stated", "hidden"),
    Case(
        "band",
        "of the wheel's frequency",
        (20.0, 30.0, 60.0),
        _while_driving(
            ("sensor", "bandwidth_hz", lambda world, size: min(size * _turns_hz(world), _BAND_OF_RATE * world.rate_hz))
        ),
        "two poles of the sensor, not stated",
        "hidden",
        tire=True,
    ),
    Case(
        "ac-corner",
        "of the wheel's frequency",
        (0.03, 0.1, 0.3),
        _while_driving(
            ("sensor", "coupling", lambda *_: "ac"),
            ("sensor", "highpass_hz", lambda world, size: size * _turns_hz(world)),
        ),
        "AC coupling, as the sensor states it",
        "conditions",
        tire=True,
    ),
    Case(
        "imbalance",
        "m/s^2",
        (0.3, 1.0, 3.0),
        _while_driving(("vibration", "imbalance_mps2", lambda world, size: size * (65.0 / world.speed_kmh) ** 2)),
        "motion of the hub at wheel order 1, at the wheel's speed",
        "conditions",
        tire=True,
    ),
    Case(
        "ripple",
        "%",
        (0.1, 0.3, 1.0),
        _while_driving(("vibration", "ripple_percent", lambda _, size: size)),
        "rotation uneven at order 2",
        "conditions",
        tire=True,
    ),
    Case(
        "shock",
        "m/s^2",
        (50.0, 200.0, 2000.0),
        _while_driving(("impact", "amplitude_mps2", lambda _, size: size)),
        "a shock in every revolution",
        "conditions",
        tire=True,
    ),
    Case(
        "load-step",
        "%",
        _both(10.0, 30.0),
        _while_driving(
            ("wheel", "load_n", lambda world, size: _step(world.load_n, world.load_n * (1.0 + 0.01 * size)))
        ),
        "the load changes in the middle",
        "conditions",
        tire=True,
    ),
    Case(
        "puncture",
        "% of the pressure",
        (10.0, 30.0),
        _while_driving(
            (
                "wheel",
                "pressure_kpa",
                lambda world, size: (
                    (0.0, 1e-3 * world.pressure_pa),
                    (1.0, 1e-3 * world.pressure_pa * (1.0 - 0.01 * size)),
                ),
            )
        ),
        "the pressure falls",
        "conditions",
        tire=True,
    ),
    Case(
        "slip-step",
        "deg",
        (0.3, 1.0, 2.0),
        _while_driving(("wheel", "slip_angle_deg", lambda _, size: _step(0.0, size))),
        "slip begins in the middle",
        "conditions",
        tire=True,
    ),
    Case(
        "speed-step",
        "%",
        _both(10.0, 30.0),
        _while_driving(
            (
                "motion",
                "speed_kmh",
                lambda world, size: (
                    (0.0, world.speed_kmh),
                    (0.4, world.speed_kmh),
                    (0.7, world.speed_kmh * (1.0 + 0.01 * size)),
                ),
            )
        ),
        "the wheel brakes or speeds up in the middle",
        "conditions",
        tire=True,
    ),
    Case("lost-frames", "% of the frames", (3.0, 10.0, 20.0), _lost(1), "lost on the link, one by one", "conditions"),
    Case("lost-bursts", "% of the frames", (3.0, 10.0, 20.0), _lost(8), "lost eight in a row", "conditions"),
)
NORMAL: Final = Case("normal", "", (0.0,), _normal, "everything off by its normal error", "normal")


def together(first: Case, second: Case) -> Case:
    """Return two misstatements of one tire at once; the second gets the size of a random tire."""

    def change(world: World, said: Statement, size: float, rng: np.random.Generator) -> tuple[World, Statement]:
        return second.change(*first.change(world, said, size, rng), float(rng.choice(second.sizes)), rng)

    kind: Kind = "normal" if first is NORMAL else "two"
    return Case(
        f"{first.name} + {second.name}", first.unit, first.sizes, change, "both", kind, first.tire or second.tire
    )


def drawn(count: int, seed: int, tire: int) -> list[Case]:
    """Return random cases of a tire: so many pairs of misstatements, and as many beside normal errors."""
    rng = np.random.default_rng([seed, tire, 2])
    single = [case for case in CASES if case.kind == "one"]
    cases = []
    for _ in range(count):
        first, second = rng.choice(len(single), 2, replace=False).tolist()
        # What replaces the statement comes first.
        cases += [together(single[first], single[second]), together(NORMAL, single[second])]
    return cases


def named(names: Sequence[str] | None) -> list[Case]:
    """Return cases by name, all for None."""
    return [case for case in CASES if not names or case.name in names]
