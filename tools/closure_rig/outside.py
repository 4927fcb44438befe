"""Effects outside the catalogue: some made by the simulator, some added here to the sensor's input."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from closure_rig.bench import SAMPLE_RATE_HZ
from closure_rig.bent import Creep
from closure_rig.causes import Drawing, Tables
from gateway.core.types import FloatArray
from gateway.simulator.motion import Turning, WheelRotation
from gateway.simulator.sensor import SensorChain

Disturbance = Callable[[Turning, bool], FloatArray]
"""From the rotation at n samples, and whether it rolls in reverse, to (n, 3) added specific force in m/s^2."""

OutputFault = Callable[[NDArray[np.int16]], NDArray[np.int16]]
"""From (n, channels) counts to those that reach the hub; called once for each block, in order of time."""

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
        creep: of the sensor's bond, None for a firm one.
        fault: of the samples' transport, None for a sound one; called again for each recording.
        lowest: smallest size that is of interest; None for any.
        also: effects of the catalogue that are there as well, as a part of it.
    """

    name: str
    unit: str
    sizes: tuple[float, float, float]
    tables: Callable[[Drawing], Tables]
    disturbance: Callable[[float, np.random.Generator], Disturbance] | None = None
    creep: Callable[[Drawing], Creep] | None = None
    fault: Callable[[float, np.random.Generator], OutputFault] | None = None
    lowest: float | None = None
    also: tuple[str, ...] = ()


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


class FaultyChain:
    """Sensor chain whose counts arrive with faults."""

    def __init__(self, chain: SensorChain, fault: OutputFault) -> None:
        """Take the sensor and the fault."""
        self._chain = chain
        self._fault = fault

    def __getattr__(self, name: str) -> Any:
        return getattr(self._chain, name)

    def __call__(self, force_mps2: FloatArray, time_s: FloatArray, temperature_degc: float) -> NDArray[np.int16]:
        """Return the counts that arrive."""
        return self._fault(self._chain(force_mps2, time_s, temperature_degc))


def _nothing(_: Drawing) -> Tables:
    return {}


def _bump(drawn: Drawing) -> Tables:
    position, hz = drawn.between(60.0, 300.0), drawn.between(150.0, 300.0)
    return {
        "impact": {
            "amplitude_mps2": drawn.size,
            "at_deg": position,
            "frequency_hz": hz,
            "decay_ms": drawn.between(4, 8),
        }
    }


def _stone(drawn: Drawing) -> Tables:
    position, hz = drawn.between(40.0, 320.0), drawn.between(900.0, 1800.0)
    return {
        "impact": {
            "amplitude_mps2": drawn.size,
            "at_deg": position,
            "frequency_hz": hz,
            "decay_ms": drawn.between(0.5, 1),
        }
    }


def _tone(drawn: Drawing) -> Tables:
    return {"sensor": {"tone_mg": drawn.size, "tone_hz": drawn.between(60.0, 900.0)}}


def kick(size: float, rng: np.random.Generator) -> Disturbance:
    """A kick of the radial axis alone at one angle, in proportion to omega squared: no belt answers a splice so."""
    position, width = rng.uniform(0.9, 2.6) * rng.choice([-1.0, 1.0]), rng.uniform(0.05, 0.12)

    def added(turning: Turning, reverse: bool) -> FloatArray:
        from_it = np.mod(turning.angle_rad - (-position if reverse else position) + math.pi, 2.0 * math.pi) - math.pi
        wave = (1.0 - (from_it / width) ** 2) * np.exp(-0.5 * (from_it / width) ** 2)
        force = np.zeros((len(wave), 3))
        force[:, 2] = size * (turning.omega_radps / REFERENCE_RADPS) ** 2 * wave
        return force

    return added


def rub(size: float, rng: np.random.Generator) -> Disturbance:
    """Rubbing in every second revolution: a burst at one order between 30 and 80."""
    position, order = rng.uniform(0.8, 2.4) * rng.choice([-1.0, 1.0]), rng.uniform(30.0, 80.0)

    def added(turning: Turning, _: bool) -> FloatArray:
        # Two revolutions are one period; it comes once in it.
        double = np.mod(turning.angle_rad - position + 2.0 * math.pi, 4.0 * math.pi) - 2.0 * math.pi
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


# Belt beds and drums: circumference of a 1.7 m drum, and a flat belt's length.
_TRACK_M: Final = (5.37, 6.5)


def joint(size: float, rng: np.random.Generator) -> Disturbance:
    """A joint of the drum: each time it passes under the tire, the belt rings at a mode of its own.

    The drum's circumference is no multiple of the tire's, so the joint meets the sensor at another angle each time. The
    blow goes with the speed, as that of a step of given height does.
    """
    length_m, hz = float(rng.choice(_TRACK_M)) * rng.uniform(0.97, 1.03), rng.uniform(70.0, 140.0)
    decay_s, begin = rng.uniform(8e-3, 2e-2), rng.uniform()

    def added(turning: Turning, _: bool) -> FloatArray:
        # Distance rolled since the joint last passed; at constant speed time is distance over speed.
        radius_m = turning.speed_mps[0] / turning.omega_radps[0]
        since_s = np.mod(turning.angle_rad * radius_m + begin * length_m, length_m) / turning.speed_mps
        ring = np.exp(-since_s / decay_s) * (1.0 - np.exp(-since_s / 1e-3))
        force = np.zeros((len(since_s), 3))
        # Fixed in space: the turning sensor reads it in turn along and across.
        blow = size * turning.omega_radps / REFERENCE_RADPS * ring * np.sin(2.0 * math.pi * hz * since_s)
        force[:, 2], force[:, 0] = blow * np.cos(turning.angle_rad), blow * np.sin(turning.angle_rad)
        return force

    return added


def rim_rub(size: float, rng: np.random.Generator) -> Disturbance:
    """Friction at one place of the turn, as of a bead that rubs on the rim: bursts of noise, the place fixed.

    Stick and slip have no phase: the bursts' mean over revolutions is zero.
    """
    position, width = rng.uniform(-math.pi, math.pi), rng.uniform(0.08, 0.2)
    noise = np.random.default_rng(int(rng.integers(2**31)))

    def added(turning: Turning, reverse: bool) -> FloatArray:
        from_it = np.mod(turning.angle_rad - (-position if reverse else position) + math.pi, 2.0 * math.pi) - math.pi
        burst = np.exp(-0.5 * (from_it / width) ** 2)
        white = noise.standard_normal((len(burst), 3))
        # Neighbouring samples are alike: a band below a quarter of the sampling rate.
        white[1:] = (white[1:] + white[:-1]) * math.sqrt(0.5)
        force: FloatArray = size * (turning.omega_radps / REFERENCE_RADPS * burst)[:, None] * white
        return force

    return added


# Time from the trailing edge to the blow: a gap of a tenth of a millimetre at 20 m/s^2 to 200 m/s^2.
_GAP_S: Final = (1e-3, 3e-3)
# Where the contact of a car's tire ends, and belt and load take hold again.
_CONTACT_END_RAD: Final = 0.22


def rattle(size: float, rng: np.random.Generator) -> Disturbance:
    """A part loose in the sensor's housing floats in the contact, where nothing presses it, and lands after it.

    The time to the blow and its strength differ from turn to turn, by a third.
    """
    draws = np.random.default_rng(int(rng.integers(2**31)))
    hz, decay_s = rng.uniform(1200.0, 2500.0), rng.uniform(5e-4, 1.5e-3)
    number = 4096
    delays_s, strengths = draws.uniform(*_GAP_S, number), 1.0 + 0.33 * draws.standard_normal(number)

    def added(turning: Turning, _: bool) -> FloatArray:
        turns = (turning.angle_rad - _CONTACT_END_RAD) / (2.0 * math.pi)
        turn = np.floor(turns).astype(np.int64)
        since_s = (turns - turn) * 2.0 * math.pi / turning.omega_radps - delays_s[turn % number]
        after = since_s > 0.0
        blow = np.zeros(len(turn))
        blow[after] = np.exp(-since_s[after] / decay_s) * np.sin(2.0 * math.pi * hz * since_s[after])
        force = np.zeros((len(turn), 3))
        force[:, 2] = size * turning.omega_radps / REFERENCE_RADPS * strengths[turn % number] * blow
        return force

    return added


def swap(size: float, rng: np.random.Generator) -> OutputFault:
    """Two neighbouring samples change places, `size` times a second: a race in the sensor's buffer."""
    draws = np.random.default_rng(int(rng.integers(2**31)))

    def changed(counts: NDArray[np.int16]) -> NDArray[np.int16]:
        first = np.flatnonzero(draws.random(max(len(counts) - 1, 0)) < size / SAMPLE_RATE_HZ)
        result = counts.copy()
        for position in first.tolist():
            result[[position, position + 1]] = result[[position + 1, position]]
        return result

    return changed


def stick(size: float, rng: np.random.Generator) -> OutputFault:
    """The converter repeats its last sample for the next two to eight, `size` times a second."""
    draws = np.random.default_rng(int(rng.integers(2**31)))

    def changed(counts: NDArray[np.int16]) -> NDArray[np.int16]:
        result = counts.copy()
        for position in np.flatnonzero(draws.random(len(counts)) < size / SAMPLE_RATE_HZ).tolist():
            result[position : position + int(draws.integers(3, 10))] = counts[position]
        return result

    return changed


def _creep(drawn: Drawing) -> Creep:
    return Creep(math.radians(drawn.sign() * drawn.size), drawn.between(0.2, 2.0), 8.0)


STRANGERS: Final[tuple[Stranger, ...]] = (
    Stranger("belt bump", "m/s^2 at 65 km/h", (1.0, 3.0, 30.0), _bump),
    Stranger("stone in the tread", "m/s^2 at 65 km/h", (2.0, 6.0, 60.0), _stone),
    Stranger("electrical tone", "mg", (5.0, 15.0, 200.0), _tone),
    Stranger("radial kick", "m/s^2 at 65 km/h", (0.5, 1.5, 15.0), _nothing, kick),
    Stranger("rub every second turn", "m/s^2 at 65 km/h", (2.0, 6.0, 40.0), _nothing, rub),
    Stranger("pole wheel", "m/s^2", (0.05, 0.15, 2.0), _nothing, pole_wheel),
    Stranger("joint of the drum", "m/s^2 at 65 km/h", (0.3, 1.0, 15.0), _nothing, joint),
    Stranger("rim rub", "m/s^2 at 65 km/h", (0.3, 1.0, 20.0), _nothing, rim_rub),
    Stranger("rattling part", "m/s^2 at 65 km/h", (1.0, 3.0, 60.0), _nothing, rattle),
    Stranger("swapped samples", "per second", (0.5, 5.0, 500.0), _nothing, fault=swap),
    Stranger("stuck samples", "per second", (0.2, 2.0, 100.0), _nothing, fault=stick),
    # Its mean over a recording is a tilt.
    Stranger("creeping bond", "deg after 8 s", (0.01, 0.03, 0.5), _nothing, creep=_creep, also=("pitch tilt",)),
)


def stranger(name: str) -> Stranger:
    """Return an effect outside the catalogue by name."""
    return next(entry for entry in STRANGERS if entry.name == name)
