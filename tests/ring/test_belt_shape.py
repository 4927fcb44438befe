"""Curvature, angle and position of the belt against the exact ring and closed forms."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.ring.belt_shape import (
    ANGLES_RAD,
    HALF_STEPS,
    MAX_ORDER,
    belt_shape,
    curvature_orders,
    integrate_from_zero,
    orders_about,
)
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring

RADIUS_M = 0.32
STIFF = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=2.1e5, extension_stiffness_n=5e8)


def shape_of(wave: np.ndarray, offset: float = 0.0):
    return belt_shape(curvature_orders(orders_about(wave[np.newaxis]).real, offset))


@pytest.mark.parametrize("load_n", [2000.0, 8000.0])
def test_signal_recovers_belt_position(load_n: float) -> None:
    ring = solve_rolling_ring(STIFF, load_n, 2.1e5, 56.4, nodes=1024)
    shape = shape_of(ring.sensor.radial_m)
    half = np.append(ring.position_m[512:], ring.position_m[:1], axis=0)[:: 512 // HALF_STEPS] / RADIUS_M
    true = half[:, 0] + 1j * half[:, 1]
    error = shape.position[0] - shape.position[0, -1] - (true - true[-1])
    assert np.abs(error).max() < 1e-4
    first_order = curvature_orders(orders_about(ring.sensor.radial_m[np.newaxis]).real)[:, 1]
    np.testing.assert_allclose(shape.orders[:, 1], first_order, atol=1e-5)


def test_shape_ignores_gain_and_order_one() -> None:
    ring = solve_rolling_ring(STIFF, 5000.0, 2.1e5, 56.4, nodes=1024)
    orders = orders_about(ring.sensor.radial_m[np.newaxis]).real
    spoiled = 1.07 * orders
    spoiled[:, 1] += 0.02 * spoiled[:, 0]
    reference, other = belt_shape(curvature_orders(orders)), belt_shape(curvature_orders(spoiled))
    np.testing.assert_allclose(other.orders[:, 1], reference.orders[:, 1], atol=1e-9)
    np.testing.assert_allclose(other.position, reference.position, atol=1e-9)


@pytest.mark.parametrize("offset_m", [-0.004, 0.005, 0.010])
def test_sensor_offset_is_corrected(offset_m: float) -> None:
    on = solve_rolling_ring(STIFF, 5000.0, 2.1e5, 56.4, nodes=1024)
    off = solve_rolling_ring(STIFF, 5000.0, 2.1e5, 56.4, nodes=1024, sensor_offset_m=offset_m)
    expected = curvature_orders(orders_about(on.sensor.radial_m[np.newaxis]).real)
    wrong = curvature_orders(orders_about(off.sensor.radial_m[np.newaxis]).real)
    right = curvature_orders(orders_about(off.sensor.radial_m[np.newaxis]).real, offset_m / RADIUS_M)
    assert np.abs(right - expected).max() < 3e-5
    assert np.abs(wrong - expected).max() > 5e-4


def test_even_orders_about_the_centre() -> None:
    theta = -math.pi + 2.0 * math.pi / 1024 * np.arange(1024)
    centre = np.array([0.03, -0.2])
    waves = np.stack([5.0 + 2.0 * np.cos(3 * (theta - c)) + 4.0 * np.sin(7 * (theta - c)) for c in centre])
    orders = orders_about(waves, centre).real
    expected = np.zeros((2, MAX_ORDER + 1))
    expected[:, [0, 3]] = 5.0, 2.0
    np.testing.assert_allclose(orders, expected, atol=1e-12)
    assert orders_about(waves, centre, max_order=2).real[0, 3] == 0.0


@settings(max_examples=30)
@given(st.lists(st.floats(-1.0, 1.0), min_size=1, max_size=40))
def test_integration_is_exact_when_band_limited(amounts: list[float]) -> None:
    n = np.arange(1, len(amounts) + 1)
    field = 0.7 + np.exp(1j * np.multiply.outer(ANGLES_RAD, n)) @ np.array(amounts)
    integral = 0.7 * ANGLES_RAD + (np.exp(1j * np.multiply.outer(ANGLES_RAD, n)) - 1.0) @ (np.array(amounts) / (1j * n))
    np.testing.assert_allclose(integrate_from_zero(field), integral, atol=1e-11)


def test_circle_and_zero_mean() -> None:
    shape = shape_of(np.full(1024, 17.0))
    np.testing.assert_allclose(shape.position[0], -1j * np.exp(1j * ANGLES_RAD), atol=1e-12)
    assert np.isnan(curvature_orders(orders_about(np.full((1, 1024), -1.0)).real)).all()
