import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.revolutions.order_spectrum import (
    ORDER_COUNT,
    coefficient_std,
    highest_order,
    order_coefficients,
    sample_std,
)


def waveform_from_orders(coefficients: np.ndarray, n: int) -> np.ndarray:
    """Sum the orders one by one, coefficients (..., 61), at n angles."""
    phase = np.multiply.outer(np.arange(ORDER_COUNT), angle_grid(n))
    return coefficients.real @ np.cos(phase) - coefficients.imag @ np.sin(phase)


@settings(max_examples=30)
@given(seed=st.integers(0, 2**32 - 1), n=st.sampled_from([128, 500, 1024]))
def test_order_coefficients_inverts_the_series(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    coefficients = rng.normal(size=(2, ORDER_COUNT)) + 1j * rng.normal(size=(2, ORDER_COUNT))
    coefficients[:, 0] = coefficients[:, 0].real
    np.testing.assert_allclose(order_coefficients(waveform_from_orders(coefficients, n)), coefficients, atol=1e-12)


def test_order_coefficients_have_documented_sign_and_scale() -> None:
    theta = angle_grid(256)
    wave = 4.0 + 3.0 * np.cos(2.0 * theta) + 5.0 * np.sin(7.0 * theta)
    coefficients = order_coefficients(wave)
    expected = np.zeros(ORDER_COUNT, dtype=complex)
    expected[0], expected[2], expected[7] = 4.0, 3.0, -5.0j
    np.testing.assert_allclose(coefficients, expected, atol=1e-12)


def test_orders_above_the_highest_are_nan() -> None:
    coefficients = order_coefficients(np.ones(256), order_max=20)
    assert np.isfinite(coefficients[:21]).all()
    assert np.isnan(coefficients[21:]).all()


@pytest.mark.parametrize(("samples", "order"), [(1069.0, 60), (223.0, 60), (121.0, 33), (58.0, 16), (3.0, 0)])
def test_highest_order(samples: float, order: int) -> None:
    assert highest_order(samples) == order


@pytest.mark.parametrize("samples", [300.0, 1024.0, 6949.0])
def test_coefficient_std_ignores_a_smooth_shape(samples: float) -> None:
    theta = angle_grid(1024)
    shape = 1000.0 * (1.0 - np.exp(-((theta / 0.25) ** 4)))
    rng = np.random.default_rng(5)
    estimates = []
    for _ in range(40):
        spectrum = np.zeros(513, dtype=complex)
        carried = min(512, int(samples / 2))
        spectrum[1:carried] = rng.normal(size=(carried - 1, 2)) @ [1.0, 1j]
        noise = np.fft.irfft(spectrum, n=1024) * 512.0 * 0.2  # 0.2 m/s^2 on every coefficient
        estimates.append(coefficient_std(shape + noise, samples))
    assert np.mean(estimates) == pytest.approx(0.2, rel=0.05)


def test_sample_std_matches_coefficient_std() -> None:
    rng = np.random.default_rng(6)
    wave = rng.normal(size=(400, 1024)) * 3.0
    spread = float(np.std(order_coefficients(wave)[:, 1:].real))
    assert sample_std(spread, 1024.0, 1024) == pytest.approx(3.0, rel=0.02)


def test_coefficient_std_of_nan_is_nan() -> None:
    assert math.isnan(coefficient_std(np.full(1024, np.nan), 1024.0))
