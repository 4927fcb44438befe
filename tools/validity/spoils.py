"""What sensors, their firmware and their surroundings do to samples; written without knowledge of the rules."""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from scipy.ndimage import median_filter, uniform_filter1d
from scipy.signal import lfilter

from gateway.core.types import FloatArray

CIRCUMFERENTIAL, LATERAL, RADIAL = range(3)


class Signal(NamedTuple):
    """Samples of a run.

    Attributes:
        time_s: (n,) true times.
        angle_rad: (n,) material angle of the sensor, multiples of 2 pi directly below the axle.
        values_mps2: (n, 3) circumferential, lateral, radial.
        rate_hz: samples per second.
    """

    time_s: FloatArray
    angle_rad: FloatArray
    values_mps2: FloatArray
    rate_hz: float

    def swing(self) -> FloatArray:
        """Return the values without their means."""
        moved: FloatArray = self.values_mps2 - self.values_mps2.mean(axis=0)
        return moved


Spoil = Callable[[Signal, float, np.random.Generator], FloatArray]


def turned(values: FloatArray, first: int, second: int, angle_rad: FloatArray) -> FloatArray:
    result = values.copy()
    result[:, first] = np.cos(angle_rad) * values[:, first] - np.sin(angle_rad) * values[:, second]
    result[:, second] = np.sin(angle_rad) * values[:, first] + np.cos(angle_rad) * values[:, second]
    return result


def glue_creeps(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Turn the sensor about its radial axis by `size` deg over the run."""
    share = signal.time_s / signal.time_s[-1]
    return turned(signal.values_mps2, CIRCUMFERENTIAL, LATERAL, math.radians(size) * share)


def pad_rocks(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Pitch the sensor on soft glue by `size` deg at the largest circumferential force."""
    pull = signal.swing()[:, CIRCUMFERENTIAL]
    pitch = math.radians(size) * pull / np.abs(pull).max()
    return turned(signal.values_mps2, CIRCUMFERENTIAL, RADIAL, pitch)


def rigid_base(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Average over a base of `size` degrees of the circumference."""
    turning = abs(float(signal.angle_rad[-1] - signal.angle_rad[0])) / (len(signal.time_s) - 1)
    length = max(round(math.radians(size) / turning), 1)
    averaged: FloatArray = uniform_filter1d(signal.values_mps2, length, axis=0)
    return averaged


def overload_tail(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Let a charge amplifier recover in 20 ms from `size` percent of what exceeds half the largest swing."""
    swing = signal.swing()
    over = np.sign(swing) * np.maximum(np.abs(swing) - 0.5 * np.abs(swing).max(axis=0), 0.0)
    keep = math.exp(-1.0 / (0.02 * signal.rate_hz))
    tail: FloatArray = lfilter([1.0], [1.0, -keep], over, axis=0)
    return signal.values_mps2 - 0.01 * size * tail


def magnetised_belt(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Induce the wheel's frequency and its double, by a magnetic belt in the earth's field, in m/s^2."""
    phases = rng.uniform(-np.pi, np.pi, (2, 3))
    waves = [np.cos((k + 1) * signal.angle_rad[:, None] + phases[k]) / (k + 1) for k in range(2)]
    return signal.values_mps2 + size * (waves[0] + waves[1])


def motor_whine(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Shake the axle vertically at an order of the motor, in m/s^2."""
    shaken = size * np.cos(float(rng.uniform(30.0, 80.0)) * signal.angle_rad)
    return at_the_axle(signal, shaken)


def worn_bearing(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Shake the axle vertically as balls pass a pit, 5.3 times a turn, in m/s^2."""
    shaken = size * np.cos(5.3 * signal.angle_rad) * (1.0 + 0.3 * rng.standard_normal(len(signal.time_s)))
    return at_the_axle(signal, shaken)


def at_the_axle(signal: Signal, upward_mps2: FloatArray) -> FloatArray:
    result = signal.values_mps2.copy()
    result[:, RADIAL] += upward_mps2 * np.cos(signal.angle_rad)
    result[:, CIRCUMFERENTIAL] -= upward_mps2 * np.sin(signal.angle_rad)
    return result


def radio_bursts(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Move the zero by `size` m/s^2 while a radio sends, a tenth of every 30 ms."""
    sends = np.mod(signal.time_s + float(rng.uniform(0.0, 1.0)), 0.03) < 0.003
    return signal.values_mps2 + size * sends[:, None]


def float_words(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Round every sample to a mantissa of `size` bits."""
    values = signal.values_mps2
    step = 2.0 ** (np.floor(np.log2(np.maximum(np.abs(values), 1e-9))) - round(size))
    rounded: FloatArray = np.round(values / step) * step
    return rounded


def slow_slew(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Limit the step between samples to `size` percent of the largest."""
    result = signal.values_mps2.copy()
    for axis in range(result.shape[1]):
        limit = 0.01 * size * float(np.abs(np.diff(result[:, axis])).max())
        followed = result[:, axis].tolist()
        for index in range(1, len(followed)):
            step = followed[index] - followed[index - 1]
            followed[index] = followed[index - 1] + max(-limit, min(limit, step))
        result[:, axis] = followed
    return result


def stuck_bit(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Hold one bit of one axis at 1; it counts 2 to the power of -`size` of the largest value."""
    axis = int(rng.integers(3))
    result = signal.values_mps2.copy()
    unit = float(np.abs(result[:, axis]).max()) * 2.0 ** -round(size)
    result[:, axis] += unit * (np.mod(np.floor(result[:, axis] / unit), 2.0) == 0.0)
    return result


def word_wraps(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Wrap the radial axis round at `size` percent of its largest value, as a word of too few bits does."""
    result = signal.values_mps2.copy()
    limit = 0.01 * size * float(np.abs(result[:, RADIAL]).max())
    result[:, RADIAL] = np.mod(result[:, RADIAL] + limit, 2.0 * limit) - limit
    return result


def range_switches(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Halve the scale in `size` percent of the pieces of 0.3 s, unmarked."""
    piece = np.floor(signal.time_s / 0.3).astype(int)
    halved = rng.random(int(piece.max()) + 1) < 0.01 * size
    return signal.values_mps2 * np.where(halved[piece], 0.5, 1.0)[:, None]


def despiked(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Take the median of about `size` samples, as firmware against spikes does."""
    length = 2 * round(0.5 * (size - 1.0)) + 1
    filtered: FloatArray = median_filter(signal.values_mps2, (length, 1))
    return filtered


def sends_on_change(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Repeat the last value until it changes by more than `size` m/s^2."""
    result = signal.values_mps2.copy()
    for axis in range(result.shape[1]):
        values = result[:, axis].tolist()
        for index in range(1, len(values)):
            if abs(values[index] - values[index - 1]) <= size:
                values[index] = values[index - 1]
        result[:, axis] = values
    return result


def sealant(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Press liquid sealant on the sensor where the belt is flat: `size` percent of the swing, each turn another."""
    angle = np.mod(signal.angle_rad + np.pi, 2.0 * np.pi) - np.pi
    turn = np.floor((signal.angle_rad + np.pi) / (2.0 * np.pi)).astype(int)
    turn -= turn.min()
    height = size * 0.01 * np.abs(signal.swing()).max(axis=0)[RADIAL] * rng.uniform(0.5, 1.5, int(turn.max()) + 1)
    result = signal.values_mps2.copy()
    result[:, RADIAL] += height[turn] * np.exp(-0.5 * (angle / 0.25) ** 2)
    result[:, CIRCUMFERENTIAL] += 0.3 * height[turn] * np.exp(-0.5 * ((angle - 0.3) / 0.1) ** 2)
    return result


def gravel(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Let stones hit the belt 15 times a second, up to `size` m/s^2, ringing at 800 Hz."""
    hits = (rng.random(len(signal.time_s)) < 15.0 / signal.rate_hz) * rng.uniform(-1.0, 1.0, len(signal.time_s))
    age = np.arange(round(0.01 * signal.rate_hz)) / signal.rate_hz
    ringing = np.exp(-age / 0.002) * np.cos(2.0 * np.pi * 800.0 * age)
    result = signal.values_mps2.copy()
    result[:, RADIAL] += size * np.convolve(hits, ringing)[: len(hits)]
    return result


def self_test(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Leave the electrostatic self-test on for the first third: `size` m/s^2 on every axis."""
    return signal.values_mps2 + size * (signal.time_s < signal.time_s[-1] / 3.0)[:, None]


def left_handed(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Turn the circumferential axis round, or with a size above 1 the lateral one."""
    return signal.values_mps2 * np.where(np.arange(3) == (LATERAL if size > 1.0 else CIRCUMFERENTIAL), -1.0, 1.0)


def nonlinear(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Add `size` times the square of each reading, per m/s^2."""
    return signal.values_mps2 * (1.0 + size * signal.values_mps2)


SPOILS: Final[dict[str, Spoil]] = {
    spoil.__name__.replace("_", "-"): spoil
    for spoil in (
        glue_creeps, pad_rocks, rigid_base, overload_tail, magnetised_belt, motor_whine, worn_bearing, radio_bursts,
        float_words, slow_slew, stuck_bit, word_wraps, range_switches, despiked, sends_on_change, sealant, gravel,
        self_test, left_handed, nonlinear,
    )
}  # fmt: skip
