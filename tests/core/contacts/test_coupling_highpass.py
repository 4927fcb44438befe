"""The high-pass of an AC coupling on a wheel that turns steadily, and its inverse."""

import numpy as np
import pytest

from gateway.core.revolutions.coupling_highpass import before_highpass, behind_highpass
from gateway.simulator.filters import highpass

N = 512


@pytest.mark.parametrize("corner", [0.01, 0.1, 1.0])
def test_inverse_gives_back_what_a_filter_of_samples_took(corner: float) -> None:
    rng = np.random.default_rng(3)
    orders = np.zeros(N // 2 + 1, np.complex128)
    orders[1:20] = rng.normal(size=19) + 1j * rng.normal(size=19)
    signal = np.fft.irfft(orders, N)
    turns = 40 + int(10.0 / corner)
    # N samples a revolution; the corner is in units of the wheel's frequency.
    filtered = highpass(corner, N)(np.tile(signal, turns)[:, np.newaxis])[-N:, 0]
    assert behind_highpass(signal, corner) == pytest.approx(filtered, abs=2e-3 * np.ptp(signal))
    assert before_highpass(filtered, corner) == pytest.approx(signal, abs=3e-3 * np.ptp(signal))
    assert before_highpass(behind_highpass(signal, corner), corner) == pytest.approx(signal)
