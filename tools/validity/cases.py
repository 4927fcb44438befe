"""Cases: everything true, and every single misstatement at several sizes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.constants import STANDARD_GRAVITY_MPS2
from validity.statements import Statement, known_exactly, moved_to
from validity.tires import TREAD_PER_PRESSURE, World, ordinary, with_resistance

Change = Callable[[World, Statement, float, np.random.Generator], tuple[World, Statement]]


@dataclass(frozen=True, slots=True)
class Case:
    """One misstatement.

    Attributes:
        name: for --case.
        unit: of the sizes.
        sizes: each tire gets one of them, in turn.
        change: makes the case from a plain tire of which everything stated is true.
        well: whether everything stated is true.
        tire: whether it changes the tire, its load or its drive, which only the exact ring follows.
        about: one line.
    """

    name: str
    unit: str
    sizes: tuple[float, ...]
    change: Change
    about: str
    well: bool = False
    tire: bool = False


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
    return world, replace(said, load_n=world.load_n * (1.0 + 0.01 * size))


def _pressure(world: World, said: Statement, size: float, _: np.random.Generator) -> tuple[World, Statement]:
    return world, replace(said, pressure_factor=1.0 + 0.01 * size)


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
    Case("plain", "", (0.0,), _plain, "everything true, on the ring that the estimators assume", well=True),
    Case("known", "", (0.0,), _known, "everything stated without an error, and a perfect sensor", well=True),
    Case(
        "ordinary",
        "",
        (0.0,),
        _ordinary,
        "everything true; losses, extension, road, drift",
        well=True,
        tire=True,
    ),
    Case("depth-unstated", "mm", (0.0, 2.0, 4.0, 6.0, 9.0, 12.0), _depth_unstated, "no depth stated", well=True),
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
    Case("load", "%", _both(5.0, 10.0, 20.0), _load, "another load stated"),
    Case("pressure", "%", _both(5.0, 10.0, 20.0), _pressure, "pressure sensor in error"),
    Case("conicity", "deg", (0.1, 0.3, 0.6), _conicity, "conicity in place of ply steer", tire=True),
    Case("light", "load number", (0.03, 0.05, 0.08), _light, "light load", tire=True),
    Case("tread", "MPa at 2.1 bar", (15.0, 30.0, 200.0, 400.0), _tread, "soft or stiff tread", tire=True),
)


def named(names: list[str] | None) -> list[Case]:
    """Return cases by name, all for None."""
    return [case for case in CASES if not names or case.name in names]
