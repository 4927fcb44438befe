"""Statements whose errors are drawn from what is stated of them: each of the budget's sources, and how it is off."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.sensor_claims import HAND_MOUNTED_STD_RAD
from gateway.core.estimates.tire_data import SOFTENING_PER_K, SOFTENING_STD_PER_K
from gateway.planner.uncertainty_budget import SOURCES
from validity.statements import REFERENCE_STD, Statement, without_errors
from validity.tires import World, ordinary

Told = tuple[World, Statement]
Draw = Callable[[World, Statement, float, np.random.Generator], Told]

# A statement beyond is one that anybody sees.
_LIMIT: Final = 3.0


def _of_statement(key: str, true_value: Callable[[World], float]) -> Draw:
    def draw(world: World, said: Statement, std: float, rng: np.random.Generator) -> Told:
        return world, replace(said, **{key: true_value(world) * (1.0 + std * _normal(rng))})

    return draw


def _off(key: str, true_value: Callable[[World], float]) -> Draw:
    """Return what draws a length in mm about its true value; its error is in m."""

    def draw(world: World, said: Statement, std: float, rng: np.random.Generator) -> Told:
        return world, replace(said, **{key: true_value(world) + 1e3 * std * _normal(rng)})

    return draw


def _gain(axes: tuple[int, ...]) -> Draw:
    """Return what draws one error of the gain of some axes, beside what they have."""

    def draw(world: World, said: Statement, std: float, rng: np.random.Generator) -> Told:
        error = std * _normal(rng)
        first, second, third = (gain + error * (axis in axes) for axis, gain in enumerate(world.gain_error))
        return replace(world, gain_error=(first, second, third)), said

    return draw


def _zeros(world: World, said: Statement, std: float, rng: np.random.Generator) -> Told:
    first, second, third = (std * rng.standard_normal(3)).tolist()
    return replace(world, zero_g_mps2=(first, second, third)), said


def _linearity(world: World, said: Statement, std: float, rng: np.random.Generator) -> Told:
    full_scale_mps2 = STANDARD_GRAVITY_MPS2 * world.plan().sensor.range_g
    return world, replace(said, spoils=(*said.spoils, ("nonlinear", std * _normal(rng) / full_scale_mps2)))


def _reference(world: World, said: Statement, _: float, rng: np.random.Generator) -> Told:
    bs, cw, rs, ts = (np.array(world.numbers) * (1.0 + REFERENCE_STD * rng.standard_normal(4))).tolist()
    return world, replace(said, reference=(bs, cw, rs, ts))


def _temperature(world: World, said: Statement, std_k: float, rng: np.random.Generator) -> Told:
    """Measure the new tire at another temperature than is assumed, of a rubber that softens as rubbers do."""
    per_k = SOFTENING_PER_K + SOFTENING_STD_PER_K * _normal(rng)
    return replace(world, softening=world.softening * math.exp(per_k * std_k * _normal(rng))), said


def _with_it(world: World, said: Statement, _: float, __: np.random.Generator) -> Told:
    """Draw nothing: softening is drawn with the temperature that it goes with, and depths are all stated."""
    return world, said


def _normal(rng: np.random.Generator) -> float:
    return float(np.clip(rng.standard_normal(), -_LIMIT, _LIMIT))


_DRAWS: Final[dict[str, Draw]] = {
    "load": _of_statement("load_n", lambda world: world.load_n),
    "pressure": _of_statement("pressure_factor", lambda _: 1.0),
    "belt radius": _of_statement("radius_mm", lambda world: 1e3 * world.radius_m),
    "sampling rate": _of_statement("rate_factor", lambda _: 1.0),
    "gain": _gain((0, 1, 2)),
    "lateral gain": _gain((1,)),
    "circumferential gain": _gain((0,)),
    "linearity": _linearity,
    "zero-g offset": _zeros,
    "sensor depth": _off("offset_mm", lambda world: 1e3 * world.offset_m),
    "depth of the sensor": _with_it,
    "softening by temperature": _with_it,
    "temperature of the new tire": _temperature,
    "Bs of the new tire": _reference,
    "ring thickness": _off("thickness_mm", lambda world: world.thickness_mm),
}


def draw_all(world: World, said: Statement, _: float, rng: np.random.Generator) -> Told:
    """Draw every statement about an ordinary tire from its stated error, of every second one from that assumed."""
    none = (0.0, 0.0, 0.0)
    world = replace(ordinary(world, rng), gain_error=none, zero_g_mps2=none, gain_std_percent=1.5)
    said = replace(said, gain_std_percent=None)
    said = without_errors(said) if rng.random() < 0.5 else said
    (setup,) = said.vehicle(world).wheel_setups()
    for source in SOURCES:
        std = source.stated(setup)
        if std is not None:
            world, said = _DRAWS[source.name](world, said, std, rng)
    roll, pitch, yaw = np.degrees(HAND_MOUNTED_STD_RAD * rng.standard_normal(3)).tolist()
    return replace(world, tilt_deg=(roll, pitch, yaw)), said
