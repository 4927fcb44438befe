"""Pressure shapes and their modal forces against numerical integrals and the exact ring."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.ring.contact_pressure import road_orders, unit_road_orders
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.ring_series import RoadForce, modal_force
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring

ORDERS = np.arange(1, 61)
amount = st.floats(-1.0, 1.0)


@settings(max_examples=25)
@given(
    shape=st.tuples(amount, amount, amount, amount),
    half=st.floats(0.05, 0.8),
    centre=st.floats(-0.1, 0.1),
)
def test_road_orders_match_integrals(shape: tuple[float, ...], half: float, centre: float) -> None:
    x, weights = np.polynomial.legendre.leggauss(120)
    theta = centre + half * x
    q = 4000.0 / (2.0 * 0.3 * half) * np.polynomial.legendre.legval(x, [1.0, *shape])
    assert 0.3 * half * float(weights @ q) == pytest.approx(4000.0)
    n = ORDERS[:, np.newaxis]
    kernel = (np.cos(theta) + 1j * np.sin(theta) / n) * np.exp(-1j * n * theta)
    np.testing.assert_allclose(
        road_orders(ORDERS, 4000.0, 0.3, half, shape, centre), half * kernel @ (weights * q), atol=1e-8 * 4000.0
    )


def test_uniform_pressure() -> None:
    np.testing.assert_allclose(
        road_orders(ORDERS, 5000.0, 0.32, 0.2).real, modal_force(ORDERS, 5000.0, 0.32, 0.2, RoadForce.VERTICAL)
    )


def test_derivative_by_half_angle() -> None:
    step = 1e-6
    _, slope = unit_road_orders(ORDERS, 0.24, 4, 0.01)
    upper, lower = (unit_road_orders(ORDERS, 0.24 + sign * step, 4, 0.01)[0] for sign in (1.0, -1.0))
    np.testing.assert_allclose(slope, (upper - lower) / (2.0 * step), atol=1e-6 * 60)


def test_exact_ring_pressure_has_documented_shape() -> None:
    ring = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=0.32, pressure_pa=2.1e5)
    for load, second, fourth in ((1000.0, -0.98, -0.02), (5000.0, -0.36, -0.59), (8000.0, -0.17, -0.60)):
        result = solve_rolling_ring(ring, load, 2.1e5, 56.4, nodes=3600)
        x = result.theta_rad[result.in_contact] / result.half_angle_rad
        q = result.contact_pressure_npm[result.in_contact]
        amounts = [
            (2 * m + 1) * float(q @ np.polynomial.legendre.Legendre.basis(m)(x)) / float(q.sum()) for m in (2, 4)
        ]
        assert amounts == pytest.approx([second, fourth], abs=0.03)
    assert math.isclose(result.contact_centre_rad, 0.0, abs_tol=1e-6)
