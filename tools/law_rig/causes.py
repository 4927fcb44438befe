"""Causes of the rig: changes of the rolling belt and errors of the sensor chain, none in the library's own form.

Windows are boxes, ramps and arches where the library has normal ones; changes are finite where it is of first order;
the belt rolls in time with losses of its own. The chain's errors are those of parts: play, soft transitions, late
interpolated samples.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.angle_orders import ORDERS, THETA, field_orders, orders_field
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, FIELD_SIZE, RADIAL, GroupConditions
from gateway.ring.rolling_ring.force_balance import ring_grid
from law_rig.rolling_in_time import NODES, STEPS, LocalChange, Rolling, last_revolution, read_by

SENSORS: Final = 45
"""Nodes at which a sensor may sit, evenly around the belt."""

_STEP_RAD: Final = 2.0 * math.pi / NODES
_THETA: Final = ring_grid(NODES).theta_rad


@dataclass(frozen=True)
class BeltCause:
    """A change of the belt, at material angle 0.

    Attributes:
        name: in the tables.
        law: name of the law that is right.
        size: of the law's first parameter, its widths included; NaN where no single number is true.
        change: of the nodes.
    """

    name: str
    law: str
    size: float
    change: LocalChange


def _box(half_rad: float) -> FloatArray:
    """Return 1 within an angle, the nodes at its ends in part."""
    return np.clip((half_rad - np.abs(_THETA)) / _STEP_RAD + 0.5, 0.0, 1.0)


def arch(half_rad: float) -> FloatArray:
    """Return an arch of height 1 over the nodes within an angle."""
    return np.where(np.abs(_THETA) < half_rad, np.cos(0.5 * math.pi * _THETA / half_rad) ** 2, 0.0)


def _bump(height_m: float, half_rad: float) -> Callable[[FloatArray], FloatArray]:
    """Return the height of an axle on a rim bent over an arch."""

    def axle_m(angle_rad: FloatArray) -> FloatArray:
        from_it = np.mod(angle_rad + math.pi, 2.0 * math.pi) - math.pi
        return np.where(np.abs(from_it) < half_rad, height_m * np.cos(0.5 * math.pi * from_it / half_rad) ** 4, 0.0)

    return axle_m


def area(window: FloatArray) -> float:
    """Return the integral of a window over the nodes' angles, in its unit times rad."""
    return float(window.sum()) * _STEP_RAD


def belt_causes() -> tuple[BeltCause, ...]:
    """Return the changes of the belt that are simulated."""
    weight, ply = 0.4 * _box(0.04), 0.25 * _box(0.12)
    nail, strip = 6e-5 * _box(0.02), -4e-5 * arch(0.09)
    return (
        BeltCause("weight, box", "law: local mass", area(weight), LocalChange(mass=weight)),
        BeltCause("nail, box", "law: local tread height", area(nail), LocalChange(tread_m=nail)),
        BeltCause("bent rim, arch", "law: bent rim", 1.5e-4 * 0.75 * 0.5, LocalChange(axle_m=_bump(1.5e-4, 0.5))),
        BeltCause("ply end, box", "law: local sidewall stiffness", area(ply), LocalChange(sidewall=ply)),
        BeltCause(
            "oval rim",
            "law: axle height of order 2",
            1.5e-4,
            LocalChange(axle_m=lambda angle: 1.5e-4 * np.cos(2.0 * angle)),
        ),
        BeltCause("worn tread, arch", "law: local tread height", area(strip), LocalChange(tread_m=strip)),
    )


def simulated(change: LocalChange | None, conditions: Rolling, depth_m: float, cache: Path, name: str) -> ComplexArray:
    """Return the orders that each of SENSORS sensors reads over omega^2, (SENSORS, 2, ORDERS), kept in a file."""
    path = cache / f"{name}-{conditions.omega_radps:.2f}-{conditions.load_n:.0f}.npy"
    if not path.is_file():
        positions = last_revolution(conditions, change or LocalChange())
        waves = read_by(positions, np.arange(SENSORS) * (NODES // SENSORS), depth_m)
        signs = np.where(np.arange(ORDERS) % 2, -2.0, 2.0) / STEPS
        signs[0] *= 0.5
        cache.mkdir(parents=True, exist_ok=True)
        np.save(path, np.fft.rfft(waves, axis=-1)[..., :ORDERS] * signs)
    return np.asarray(np.load(path))


Fault = Callable[[FloatArray, GroupConditions], FloatArray]
"""From a signal (3, FIELD_SIZE) and its conditions to what is read."""


@dataclass(frozen=True)
class ChainCause:
    """An error of the sensor chain: its name, the law that is right, the law's size, and the error."""

    name: str
    law: str
    size: float
    fault: Fault


def chain_causes(rng: np.random.Generator) -> tuple[ChainCause, ...]:
    """Return one error of each kind with drawn sizes."""
    late = rng.uniform(30e-6, 150e-6) * rng.choice([-1.0, 1.0])
    lag, share = rng.uniform(2.0, 8.0), rng.uniform(0.02, 0.08) * rng.choice([-1.0, 1.0])
    cross, square = rng.uniform(0.03, 0.12) * rng.choice([-1.0, 1.0]), rng.uniform(5e-5, 4e-4)
    length = rng.uniform(0.012, 0.025)
    soft = rng.uniform(1.0, 4.0)

    def delay(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # Two channels of a multiplexer, the later one interpolated between its own samples.
        result = signal.copy()
        angle = conditions.omega_radps * late
        grid = np.arange(FIELD_SIZE) * (2.0 * math.pi / FIELD_SIZE)
        fine = np.fft.irfft(np.fft.rfft(signal[CIRCUMFERENTIAL]), n=8 * FIELD_SIZE) * 8.0
        position = np.mod(grid - angle, 2.0 * math.pi) / (2.0 * math.pi) * len(fine)
        low = np.floor(position).astype(int) % len(fine)
        part = position - np.floor(position)
        result[CIRCUMFERENTIAL] = (1.0 - part) * fine[low] + part * fine[(low + 1) % len(fine)]
        return result

    def play(signal: FloatArray, _: GroupConditions) -> FloatArray:
        # Three backlashes of different widths, as of friction between grains: two turns to forget the start.
        result, axis = signal.copy(), signal[CIRCUMFERENTIAL]
        total = np.zeros(FIELD_SIZE)
        for width, weight in ((0.5, 0.25), (1.0, 0.5), (1.5, 0.25)):
            held, half, out = float(axis[0]), width * lag, np.empty(FIELD_SIZE)
            for number in range(2 * FIELD_SIZE):
                value = float(axis[number % FIELD_SIZE])
                held = min(max(held, value - half), value + half)
                out[number % FIELD_SIZE] = held
            total += weight * out
        result[CIRCUMFERENTIAL] = total
        return result

    def below(signal: FloatArray, _: GroupConditions) -> FloatArray:
        # The gain changes over some m/s^2, not at a point.
        result = signal.copy()
        axis = signal[CIRCUMFERENTIAL]
        result[CIRCUMFERENTIAL] += share * (axis - soft * np.logaddexp(0.0, axis / soft))
        return result

    def leak(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # Through a stage that is 15 us late.
        result = signal.copy()
        order = np.arange(FIELD_SIZE // 2 + 1)
        late_by = np.exp(-1j * order * conditions.omega_radps * 15e-6)
        result[RADIAL] += cross * np.fft.irfft(np.fft.rfft(signal[CIRCUMFERENTIAL]) * late_by, n=FIELD_SIZE)
        return result

    def bent(signal: FloatArray, _: GroupConditions) -> FloatArray:
        result = signal.copy()
        axis = signal[CIRCUMFERENTIAL]
        result[CIRCUMFERENTIAL] += 300.0 * square * axis * np.tanh(axis / 300.0)
        return result

    def board(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # A board held best in its middle: an arch of the same second moment as a uniform mean.
        x = np.arange(FIELD_SIZE // 2 + 1) * length / conditions.radius_m
        offsets = np.linspace(-0.5, 0.5, 41)
        weights = np.cos(math.pi * offsets) ** 2
        weights /= weights.sum()
        wide = math.sqrt(1.0 / 12.0 / float(weights @ offsets**2))
        transfer = np.cos(np.outer(x, wide * offsets)) @ weights
        return np.fft.irfft(np.fft.rfft(signal) * transfer, n=FIELD_SIZE)

    axis = "circumferential axis"
    return (
        ChainCause("multiplexer", f"law: delay of the {axis}", late, delay),
        ChainCause("play", f"law: hysteresis of the {axis}", lag, play),
        ChainCause("soft rectifier", f"law: gain below zero of the {axis}", share, below),
        ChainCause("late leak", "law: circumferential in the radial axis", cross, leak),
        ChainCause("bent characteristic", f"law: square of the {axis}", square, bent),
        ChainCause("board, arch", "law: mean over a length", length, board),
    )


def outside_causes(rng: np.random.Generator) -> tuple[tuple[str, Fault], ...]:
    """Return causes that neither the library nor the catalogue has."""
    position, width = rng.uniform(-2.5, 2.5), rng.uniform(0.03, 0.15)
    hz, size = rng.uniform(250.0, 700.0), rng.uniform(2.0, 15.0)
    from_it = np.mod(THETA - position + math.pi, 2.0 * math.pi) - math.pi
    phases = rng.uniform(0.0, 2.0 * math.pi, 12)
    first = int(rng.integers(4, 40))
    power = float(rng.choice([0.0, 1.0, 3.0]))

    def pulse(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # A kick of the road at one angle, as of an expansion joint of a drum, in proportion to the speed.
        result = signal.copy()
        kick = (1.0 - (from_it / width) ** 2) * np.exp(-0.5 * (from_it / width) ** 2)
        result[RADIAL] += size * (conditions.omega_radps / 50.0) * kick
        return result

    def ringing(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # A loose part that rings at its own frequency from one place on.
        result = signal.copy()
        after = np.mod(THETA - position, 2.0 * math.pi) / conditions.omega_radps
        ring = np.exp(-after / 0.006) * np.sin(2.0 * math.pi * hz * after)
        result[RADIAL] += size * ring
        result[CIRCUMFERENTIAL] += 0.4 * size * ring
        return result

    def hum(signal: FloatArray, conditions: GroupConditions) -> FloatArray:
        # A band of orders all around, of a power of speed that no law has.
        result = signal.copy()
        waves = sum(np.cos((first + k) * THETA + phase) for k, phase in enumerate(phases.tolist()))
        result[RADIAL] += 0.3 * size * (conditions.omega_radps / 50.0) ** power * waves
        return result

    def dead(signal: FloatArray, _: GroupConditions) -> FloatArray:
        # Readings near zero are zero.
        result = signal.copy()
        axis = signal[CIRCUMFERENTIAL]
        result[CIRCUMFERENTIAL] = np.where(np.abs(axis) < 0.5 * size, 0.0, axis)
        return result

    def limit(signal: FloatArray, _: GroupConditions) -> FloatArray:
        # A slew rate: steep edges are read with a largest slope.
        result = signal.copy()
        axis, most = signal[RADIAL].copy(), 8.0 + 2.0 * size
        for number in range(2 * FIELD_SIZE):
            position, before = number % FIELD_SIZE, (number - 1) % FIELD_SIZE
            axis[position] = np.clip(signal[RADIAL, position], axis[before] - most, axis[before] + most)
        result[RADIAL] = axis
        return result

    return ("road kick", pulse), ("ringing part", ringing), ("hum", hum), ("dead zone", dead), ("slew limit", limit)


def through(fault: Fault, orders: ComplexArray, conditions: GroupConditions) -> ComplexArray:
    """Return the orders (3, ORDERS) of a signal that an error has changed."""
    return field_orders(fault(orders_field(orders), conditions))
