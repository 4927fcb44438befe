"""Spectrum and lines of signals with known content."""

import math

import numpy as np
import pytest

from gateway.forces.nonsynchronous_spectrum import spectral_lines, welch_spectrum

RATE_HZ = 4000.0


def noise(seconds: float, density: float, seed: int = 0) -> np.ndarray:
    """Return white noise of a one-sided density in m/s^2 per root Hz."""
    size = round(seconds * RATE_HZ)
    return np.random.default_rng(seed).normal(0.0, density * math.sqrt(0.5 * RATE_HZ), size)


def test_density_of_white_noise() -> None:
    spectrum = welch_spectrum(noise(60.0, 0.3), RATE_HZ, 4000)
    band = spectrum.density_m2ps3[10:1900]
    assert math.sqrt(band.mean()) == pytest.approx(0.3, rel=0.01)
    # The scatter of a bin agrees with the stated number of averages.
    assert band.mean() ** 2 / band.var() == pytest.approx(spectrum.averages, rel=0.15)


def test_rms_error_matches_scatter() -> None:
    results = [welch_spectrum(noise(4.0, 0.3, seed), RATE_HZ, 4000).rms_mps2(100.0, 400.0) for seed in range(60)]
    values, stds = np.array(results).T
    assert values.mean() == pytest.approx(0.3 * math.sqrt(301.0), rel=0.01)
    assert values.std() == pytest.approx(stds.mean(), rel=0.4)


@pytest.mark.parametrize("frequency_hz", [57.0, 222.4, 222.75, 701.1])
def test_line_frequency_and_rms_are_recovered(frequency_hz: float) -> None:
    time = np.arange(round(8.0 * RATE_HZ)) / RATE_HZ
    signal = noise(8.0, 0.05) + 2.0 * math.sqrt(2.0) * np.sin(2.0 * math.pi * frequency_hz * time)
    (line,) = spectral_lines(welch_spectrum(signal, RATE_HZ, 4000), 5.0, 800.0)
    assert line.frequency_hz == pytest.approx(frequency_hz, abs=0.1)
    assert line.rms_mps2 == pytest.approx(2.0, rel=0.03)
    assert abs(line.frequency_hz - frequency_hz) < 3.0 * line.frequency_std_hz


def test_noise_has_no_lines() -> None:
    seen = sum(len(spectral_lines(welch_spectrum(noise(6.0, 1.0, s), RATE_HZ, 4000), 5.0, 800.0)) for s in range(100))
    assert seen <= 5


def test_strongest_line_comes_first() -> None:
    time = np.arange(round(8.0 * RATE_HZ)) / RATE_HZ
    tones = ((100.3, 0.5), (222.4, 2.0), (318.2, 1.0))
    signal = noise(8.0, 0.05) + sum(a * np.sin(2.0 * math.pi * f * time) for f, a in tones)
    lines = spectral_lines(welch_spectrum(signal, RATE_HZ, 4000), 5.0, 800.0)
    assert [round(line.frequency_hz) for line in lines] == [222, 318, 100]


def test_short_signal_has_no_spectrum() -> None:
    assert welch_spectrum(noise(0.5, 1.0), RATE_HZ, 4000) is None
