"""Clipped signals against smooth, quiet and coarsely quantised ones."""

import itertools

import numpy as np
import pytest
from scipy.special import ndtr

from gateway.signal.clipping import is_clipped
from tests.testkit.exact_ring import omega_at, sampled, solution


def counts(rate_hz: float, speed_kmh: float, noise: float, scale: float, cut: float | None = None) -> np.ndarray:
    samples, contacts = sampled(solution(), rate_hz, speed_kmh, revolutions=1, noise_mps2=noise, seed=3)
    radial = samples[int(contacts[0]) : int(contacts[1]), 1]
    if cut is not None:
        radial = np.minimum(radial, cut * 0.32 * omega_at(speed_kmh) ** 2)
    return np.rint(radial / scale).astype(np.int16)


@pytest.mark.parametrize("rate_hz", [2000.0, 9600.0, 25600.0])
@pytest.mark.parametrize("speed_kmh", [12.0, 65.0, 110.0])
@pytest.mark.parametrize("noise", [0.0, 0.1, 3.4])
def test_smooth_peak_is_not_clipped(rate_hz: float, speed_kmh: float, noise: float) -> None:
    assert not is_clipped(counts(rate_hz, speed_kmh, noise, 0.6))


@pytest.mark.parametrize("rate_hz", [2000.0, 9600.0, 25600.0])
@pytest.mark.parametrize("noise", [0.0, 3.4])
def test_cut_peak_is_clipped(rate_hz: float, noise: float) -> None:
    assert is_clipped(counts(rate_hz, 65.0, noise, 0.15, cut=1.3))


def test_zero_signal_is_not_clipped() -> None:
    assert not is_clipped(np.zeros(1000, np.int16))


def test_revolutions_below_one_count_of_noise_are_not_clipped() -> None:
    # 0.125 mg/rtHz at 9600 Hz is 0.14 counts of a sensor of +-2000 g; the phase of the sampling is another every time.
    rng = np.random.default_rng(5)
    samples, contacts = sampled(solution(), 9600.0, 65.0, revolutions=60, noise_mps2=0.085, seed=4)
    radial = samples[:, 1] / 0.6 + rng.uniform(-0.5, 0.5)
    revolutions = [np.rint(radial[int(a) : int(b)]).astype(np.int16) for a, b in itertools.pairwise(contacts)]
    assert not any(is_clipped(revolution) for revolution in revolutions)


@pytest.mark.parametrize("knee", [0.003, 0.01])
def test_soft_knee_is_clipped(knee: float) -> None:
    raw = counts(9600.0, 65.0, 0.5, 0.15).astype(float)
    limit = 1.15 * 0.32 * omega_at(65.0) ** 2 / 0.15
    width = knee * limit
    z = (raw - limit) / width
    over = width * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) + (raw - limit) * ndtr(z)
    assert is_clipped(np.rint(raw - over).astype(np.int16))


def test_noisy_contact_cut_at_its_floor_is_clipped() -> None:
    raw = counts(9600.0, 65.0, 3.4, 0.15)
    assert not is_clipped(raw)
    assert is_clipped(np.maximum(raw, 0).astype(np.int16))


def imported(samples: np.ndarray, step: float) -> np.ndarray:
    """Return samples of a coarse converter in the counts of an import, which scales the largest value to 32767."""
    coarse = np.rint(samples / step) * step
    return np.rint(coarse * (32767.0 / np.abs(coarse).max())).astype(np.int16)


@pytest.mark.parametrize("step", [0.1, 0.48, 1.9, 15.3])
@pytest.mark.parametrize("noise", [0.0, 0.4, 3.4])
def test_coarse_converter_is_not_clipped(step: float, noise: float) -> None:
    samples, contacts = sampled(solution(), 9600.0, 65.0, revolutions=20, noise_mps2=noise, seed=4)
    raw = imported(samples[:, 1], step)
    assert not any(is_clipped(raw[int(a) : int(b)]) for a, b in itertools.pairwise(contacts))


@pytest.mark.parametrize("step", [0.1, 0.48, 1.9])
def test_coarse_converter_that_is_cut_is_clipped(step: float) -> None:
    samples, contacts = sampled(solution(), 9600.0, 65.0, revolutions=5, noise_mps2=0.4, seed=4)
    raw = imported(np.minimum(samples[:, 1], 1.15 * 0.32 * omega_at(65.0) ** 2), step)
    assert all(is_clipped(raw[int(a) : int(b)]) for a, b in itertools.pairwise(contacts))
