"""Clipped signals against smooth, quiet and coarsely quantised ones."""

from __future__ import annotations

import numpy as np
import pytest

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
    assert not is_clipped(-counts(rate_hz, speed_kmh, noise, 0.6))


@pytest.mark.parametrize("rate_hz", [2000.0, 9600.0, 25600.0])
@pytest.mark.parametrize("noise", [0.0, 3.4])
def test_cut_peak_is_clipped(rate_hz: float, noise: float) -> None:
    assert is_clipped(counts(rate_hz, 65.0, noise, 0.15, cut=1.3))


def test_zero_signal_is_not_clipped() -> None:
    assert not is_clipped(np.zeros(1000, np.int16))
