"""Effects outside the catalogue: some made by the simulator, some added here to the sensor's input."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from closure_rig.causes import Drawing, Tables
from gateway.simulator.motion import Turning, WheelRotation
from gateway.simulator.sensor import SensorChain
from gateway.types import FloatArray

Disturbance = Callable[[Turning, bool], FloatArray]
"""From the rotation at n samples, and whether it rolls in reverse, to (n, 3) added specific force in m/s^2."""

REFERENCE_RADPS: Final = 65.0 / 3.6 / 0.32


@dataclass(frozen=True, slots=True)
class Stranger:
    """An effect outside the catalogue.

    Attributes:
        name: in the label.
        unit: of the sizes.
        sizes: small, middle, large.
        tables: changes to the scenario.
        disturbance: added to the samples, None when the scenario is enough.
    """

    name: str
    unit: str
    sizes: tuple[float, float, float]
    tables: Callable[[Drawing], Tables]
    disturbance: Callable[[float, np.random.Generator], Disturbance] | None = None


class DisturbedChain:
    """Sensor chain with an added disturbance."""

    def __init__(self, chain: SensorChain, rotation: WheelRotation, disturbance: Disturbance, reverse: bool) -> None:
        """Take the sensor, the wheel's rotation and the disturbance."""
        self._chain = chain
        self._rotation = rotation
        self._disturbance = disturbance
        self._reverse = reverse

    def __getattr__(self, name: str) -> Any:
        return getattr(self._chain, name)

    def __call__(self, force_mps2: FloatArray, time_s: FloatArray, temperature_degc: float) -> NDArray[np.int16]:
        """Return the sensor's counts of the disturbed force."""
        added = self._disturbance(self._rotation.at(time_s), self._reverse)
        return self._chain(force_mps2 + added, time_s, temperature_degc)


def _nothing(_: Drawing) -> Tables:
    return {}


def _bump(drawn: Drawing) -> Tables:
    at, hz = drawn.between(60.0, 300.0), drawn.between(150.0, 300.0)
    return {"impact": {"amplitude_mps2": drawn.size, "at_deg": at, "frequency_hz": hz, "decay_ms": drawn.between(4, 8)}}


def _stone(drawn: Drawing) -> Tables:
    at, hz = drawn.between(40.0, 320.0), drawn.between(900.0, 1800.0)
    return {
        "impact": {"amplitude_mps2": drawn.size, "at_deg": at, "frequency_hz": hz, "decay_ms": drawn.between(0.5, 1)}
    }


def _tone(drawn: Drawing) -> Tables:
    return {"sensor": {"tone_mg": drawn.size, "tone_hz": drawn.between(60.0, 900.0)}}


def _loose(drawn: Drawing) -> Tables:
    return {"defect": {"loose_hz": drawn.size, "loose_q": drawn.between(8.0, 20.0)}}


def splice(size: float, rng: np.random.Generator) -> Disturbance:
    """A stiff belt splice away from the sensor: an impulse at each contact, proportional to omega squared."""
    at, width = rng.uniform(0.9, 2.6) * rng.choice([-1.0, 1.0]), rng.uniform(0.05, 0.12)

    def added(turning: Turning, reverse: bool) -> FloatArray:
        from_it = np.mod(turning.angle_rad - (-at if reverse else at) + math.pi, 2.0 * math.pi) - math.pi
        kick = (1.0 - (from_it / width) ** 2) * np.exp(-0.5 * (from_it / width) ** 2)
        force = np.zeros((len(kick), 3))
        force[:, 2] = size * (turning.omega_radps / REFERENCE_RADPS) ** 2 * kick
        return force

    return added


def rub(size: float, rng: np.random.Generator) -> Disturbance:
    """Rubbing in every second revolution: a burst at one order between 30 and 80."""
    at, order = rng.uniform(0.8, 2.4) * rng.choice([-1.0, 1.0]), rng.uniform(30.0, 80.0)

    def added(turning: Turning, _: bool) -> FloatArray:
        # Two revolutions are one period; it comes once in it.
        double = np.mod(turning.angle_rad - at + 2.0 * math.pi, 4.0 * math.pi) - 2.0 * math.pi
        burst = np.exp(-0.5 * (double / 0.15) ** 2) * np.sin(order * double)
        force = np.zeros((len(burst), 3))
        force[:, 2] = force[:, 0] = size * turning.omega_radps / REFERENCE_RADPS * burst
        return force

    return added


def pole_wheel(size: float, rng: np.random.Generator) -> Disturbance:
    """A magnetised pole wheel of the bearing induces a tone of one order, of constant size, into every channel."""
    order, phases = int(rng.integers(24, 49)), rng.uniform(-math.pi, math.pi, 3)

    def added(turning: Turning, reverse: bool) -> FloatArray:
        angle = -turning.angle_rad if reverse else turning.angle_rad
        force: FloatArray = size * np.cos(order * angle[:, None] + phases)
        return force

    return added


STRANGERS: Final[tuple[Stranger, ...]] = (
    Stranger("belt bump", "m/s^2 at 65 km/h", (1.0, 3.0, 30.0), _bump),
    Stranger("stone in the tread", "m/s^2 at 65 km/h", (2.0, 6.0, 60.0), _stone),
    Stranger("electrical tone", "mg", (5.0, 15.0, 200.0), _tone),
    Stranger("loose sensor", "Hz", (3500.0, 2000.0, 800.0), _loose),
    Stranger("stiff splice", "m/s^2 at 65 km/h", (0.5, 1.5, 15.0), _nothing, splice),
    Stranger("rub every second turn", "m/s^2 at 65 km/h", (2.0, 6.0, 40.0), _nothing, rub),
    Stranger("pole wheel", "m/s^2", (0.05, 0.15, 2.0), _nothing, pole_wheel),
)


def stranger(name: str) -> Stranger:
    """Return an effect outside the catalogue by name."""
    return next(entry for entry in STRANGERS if entry.name == name)
