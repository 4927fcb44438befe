"""What else sensors, firmware and tires do to samples: a second stranger's kinds, written without reading the rules."""

import math
from typing import Final

import numpy as np
from scipy.fft import dct, idct
from scipy.ndimage import uniform_filter1d
from scipy.signal import cheby1, group_delay, lfilter

from gateway.core.types import FloatArray
from validity.spoils import CIRCUMFERENTIAL, LATERAL, RADIAL, SPOILS, Signal, Spoil, at_the_axle, turned


def _wrapped(angle_rad: FloatArray) -> FloatArray:
    wrapped: FloatArray = np.mod(angle_rad + np.pi, 2.0 * np.pi) - np.pi
    return wrapped


def _turn(signal: Signal) -> tuple[FloatArray, int]:
    """Return the number of the turn of each sample, from 0, and how many there are."""
    turn = np.floor((signal.angle_rad + np.pi) / (2.0 * np.pi)).astype(int)
    turn -= turn.min()
    return turn, int(turn.max()) + 1


def glue_lifts(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Pitch by `size` deg where the belt is round; the flat contact presses a lifted edge back."""
    lifted = 1.0 / (1.0 + np.exp(-(np.abs(_wrapped(signal.angle_rad)) - 0.3) / 0.03))
    return turned(signal.values_mps2, CIRCUMFERENTIAL, RADIAL, math.radians(size) * lifted)


def cable_pulls(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Yaw by `size` deg at the largest radial force, as a cable of some mass pulls at one corner."""
    pull = np.abs(signal.values_mps2[:, RADIAL])
    return turned(signal.values_mps2, CIRCUMFERENTIAL, LATERAL, math.radians(size) * pull / pull.max())


def cracked_potting(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Follow with a play of `size` percent of the swing."""
    result = signal.values_mps2.copy()
    for axis in range(result.shape[1]):
        play = 0.005 * size * float(np.ptp(result[:, axis]))
        followed = result[:, axis].tolist()
        for index in range(1, len(followed)):
            followed[index] = min(max(followed[index - 1], followed[index] - play), followed[index] + play)
        result[:, axis] = followed
    return result


def moving_average(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Average over `size` samples."""
    averaged: FloatArray = uniform_filter1d(signal.values_mps2, round(size), axis=0)
    return averaged


def loose_stone(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Let a stone inside the tire strike near the contact, up to `size` m/s^2, each turn at another angle."""
    turn, turns = _turn(signal)
    where, height = rng.uniform(-0.4, 0.4, turns), size * rng.uniform(0.0, 1.0, turns)
    result = signal.values_mps2.copy()
    result[:, RADIAL] += height[turn] * np.exp(-0.5 * ((_wrapped(signal.angle_rad) - where[turn]) / 0.02) ** 2)
    return result


def warms_up(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Let every zero settle from `size` m/s^2 in a third of the run."""
    settling = np.exp(-3.0 * signal.time_s / signal.time_s[-1])
    return signal.values_mps2 + size * rng.uniform(-1.0, 1.0, 3) * settling[:, None]


def supply_sags(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Let the gain of a ratiometric part sag by `size` percent at each transmission, every 50 ms."""
    return signal.values_mps2 * (1.0 - 0.01 * size * np.exp(-np.mod(signal.time_s, 0.05) / 0.01))[:, None]


def missing_codes(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Bend the characteristic by `size` m/s^2 with a period of a sixteenth of the range, as segments of a converter."""
    period = np.abs(signal.values_mps2).max() / 8.0
    return signal.values_mps2 + size * np.sin(2.0 * np.pi * signal.values_mps2 / period)


def dead_zone(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Read 0 below `size` m/s^2, and less by as much beyond: crossover of an output stage."""
    values = signal.values_mps2
    passed: FloatArray = np.sign(values) * np.maximum(np.abs(values) - size, 0.0)
    return passed


def bit_errors(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Flip a random bit of `size` per mille of the samples, before the check sum is made."""
    values = signal.values_mps2
    unit = np.abs(values).max() * 2.0 ** -rng.integers(1, 14, values.shape)
    flipped = np.where(np.mod(np.floor(values / unit), 2.0) == 0.0, unit, -unit)
    return values + flipped * (rng.random(values.shape) < 1e-3 * size)


def gain_control(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Hold the level with `size` percent of its changes within 30 ms."""
    level = uniform_filter1d(np.abs(signal.values_mps2[:, RADIAL]), max(round(0.03 * signal.rate_hz), 1))
    return signal.values_mps2 * ((level / level.mean()) ** (-0.01 * size))[:, None]


def auto_zero(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Take `size` percent of the mean of 20 ms away, measured anew every half second."""
    result = signal.values_mps2.copy()
    length, short = round(0.5 * signal.rate_hz), max(round(0.02 * signal.rate_hz), 1)
    for begin in range(0, len(result), length):
        result[begin : begin + length] -= 0.01 * size * signal.values_mps2[begin : begin + short].mean(axis=0)
    return result


def drum_seam(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Shake the axle by `size` m/s^2 where the seam of a drum passes, 0.17 times a turn, ringing at 60 Hz."""
    age_s = np.mod(0.17 * (signal.angle_rad - signal.angle_rad[0]), 2.0 * np.pi) / 0.17
    age_s *= signal.time_s[-1] / abs(float(signal.angle_rad[-1] - signal.angle_rad[0]))
    return at_the_axle(signal, size * np.exp(-age_s / 0.03) * np.sin(2.0 * np.pi * 60.0 * age_s))


def judder(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Brake with discs of uneven thickness in the second half: `size` m/s^2 along the belt, twice a turn."""
    result = signal.values_mps2.copy()
    late = signal.time_s > 0.5 * signal.time_s[-1]
    result[:, CIRCUMFERENTIAL] += size * late * np.cos(2.0 * signal.angle_rad + 0.7)
    return result


def stick_slip(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Squeal at the end of the contact: `size` m/s^2 at 600 Hz, of another phase in each turn."""
    turn, turns = _turn(signal)
    phase = rng.uniform(-np.pi, np.pi, turns)[turn]
    near = np.exp(-0.5 * ((_wrapped(signal.angle_rad) - 0.15) / 0.06) ** 2)
    wave = size * near * np.sin(2.0 * np.pi * 600.0 * signal.time_s + phase)
    return signal.values_mps2 + wave[:, None] * np.array([1.0, 0.5, 0.5])


def foam(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Cover the sensor by foam that moves as a mass on a spring of `size` Hz and pushes by 2 percent of its force."""
    omega = 2.0 * math.pi * size / signal.rate_hz
    pole = 2.0 * math.exp(-0.2 * omega) * math.cos(omega), -math.exp(-0.4 * omega)
    moved: FloatArray = lfilter([1.0 - sum(pole)], [1.0, -pole[0], -pole[1]], signal.swing(), axis=0)
    return signal.values_mps2 + 0.02 * moved


def gravity_removed(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Take `size` percent of gravity away, as firmware does that knows the angle."""
    return at_the_axle(signal, np.full(len(signal.time_s), -0.0981 * size))


def twists_once(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Yaw by `size` deg in the middle of the run."""
    late = math.radians(size) * (signal.time_s > 0.5 * signal.time_s[-1])
    return turned(signal.values_mps2, CIRCUMFERENTIAL, LATERAL, late)


def axes_interleaved(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Convert the axes in turn, each `size` percent of a sample after the one before."""
    axes = [np.interp(signal.time_s - 0.01 * size * axis / signal.rate_hz, signal.time_s, signal.values_mps2[:, axis])
            for axis in range(3)]  # fmt: skip
    return np.stack(axes, axis=1)


def differences(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Code differences in 5 bits whose step is `size` percent of their standard deviation."""
    result = signal.values_mps2.copy()
    for axis in range(result.shape[1]):
        step = 0.01 * size * float(np.diff(result[:, axis]).std())
        decoded, level = result[:, axis].tolist(), float(result[0, axis])
        for index, value in enumerate(decoded):
            level += step * max(-16, min(15, round((value - level) / step)))
            decoded[index] = level
        result[:, axis] = decoded
    return result


def cosines(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Compress blocks of 64 samples: keep the `size` percent of the cosine coefficients that are largest."""
    whole = len(signal.values_mps2) // 64 * 64
    result = signal.values_mps2.copy()
    blocks = dct(result[:whole].reshape(-1, 64, 3), axis=1, norm="ortho")
    limit = np.quantile(np.abs(blocks), 1.0 - 0.01 * size, axis=1, keepdims=True)
    restored = idct(np.where(np.abs(blocks) >= limit, blocks, 0.0), axis=1, norm="ortho")
    result[:whole] = restored.reshape(-1, 3)
    return result


def truncates(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Round to steps of `size` m/s^2, always downward."""
    rounded: FloatArray = size * np.floor(signal.values_mps2 / size)
    return rounded


def zero_wanders(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Let every zero walk at random, by `size` m/s^2 in a second."""
    walk = np.cumsum(rng.standard_normal(signal.values_mps2.shape), axis=0) * size / math.sqrt(signal.rate_hz)
    return signal.values_mps2 + walk


def rubs(signal: Signal, size: float, rng: np.random.Generator) -> FloatArray:
    """Rub in the wheel arch, in the second half: noise of `size` m/s^2 where the sensor is at the top."""
    near = np.exp(-0.5 * (_wrapped(signal.angle_rad + np.pi) / 0.2) ** 2) * (signal.time_s > 0.5 * signal.time_s[-1])
    return signal.values_mps2 + size * near[:, None] * rng.standard_normal(signal.values_mps2.shape)


def dual_kiss(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Touch the other tire of a twin wheel below the axle: `size` percent of the radial swing, mostly sideways."""
    push = (
        0.01 * size * np.abs(signal.swing()[:, RADIAL]).max() * np.exp(-0.5 * (_wrapped(signal.angle_rad) / 0.35) ** 2)
    )
    return signal.values_mps2 + push[:, None] * np.array([0.0, 1.0, 0.2])


def chebyshev(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Filter steeply at `size` percent of half the rate, with 1 dB of ripple; its delay at rest is known."""
    taps = cheby1(6, 1.0, 0.01 * size)
    delay = round(float(group_delay(taps, [1e-3])[1][0]))
    filtered = lfilter(*taps, signal.swing(), axis=0) + signal.values_mps2.mean(axis=0)
    return np.concatenate([filtered[delay:], np.repeat(filtered[-1:], delay, axis=0)])


def soft_limiter(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Compress smoothly; the largest reading loses `size` percent."""
    values = signal.values_mps2
    largest = np.abs(values).max()
    return values * (1.0 - 0.01 * size * (values / largest) ** 4)


def rectifies(signal: Signal, size: float, _: np.random.Generator) -> FloatArray:
    """Shift the zero with the power beyond 5 ms: `size` m/s^2 where it is largest."""
    swing = signal.values_mps2 - uniform_filter1d(signal.values_mps2, max(round(0.005 * signal.rate_hz), 2), axis=0)
    power = uniform_filter1d(swing**2, max(round(0.02 * signal.rate_hz), 1), axis=0)
    return signal.values_mps2 + size * power / power.max(axis=0)


EVERY_SPOIL: Final[dict[str, Spoil]] = SPOILS | {
    spoil.__name__.replace("_", "-"): spoil
    for spoil in (
        glue_lifts, cable_pulls, cracked_potting, moving_average, loose_stone, warms_up, supply_sags, missing_codes,
        dead_zone, bit_errors, gain_control, auto_zero, drum_seam, judder, stick_slip, foam, gravity_removed,
        twists_once, axes_interleaved, differences, cosines, truncates, zero_wanders, rubs, dual_kiss, chebyshev,
        soft_limiter, rectifies,
    )
}  # fmt: skip
