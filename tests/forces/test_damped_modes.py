"""Damped modal solution against the undamped series, closed forms and the exact ring."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.forces.damped_modes import (
    displacement_orders,
    dynamic_stiffness,
    modal_coefficients,
    phase_lag,
    signal_orders,
)
from gateway.ring.contact_pressure import road_orders
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.ring_series import Kinematics, RoadForce, modal_number, modal_stiffness
from gateway.ring.ring_series import signal_orders as series_orders
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring

RADIUS_M, PRESSURE_PA, OMEGA = 0.32, 2.1e5, 56.4
RING = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA)
ORDERS = np.arange(1, 61)


@settings(max_examples=25)
@given(
    factors=st.tuples(*[st.floats(0.2, 5.0)] * 4),
    omega=st.floats(0.0, 250.0),
    mass=st.floats(0.5, 12.0),
)
def test_speed_and_mass_cancel(factors: tuple[float, ...], omega: float, mass: float) -> None:
    numbers = tuple(f * n for f, n in zip(factors, TABLE_3_NUMBERS, strict=True))
    ring = RingParameters.from_numbers(*numbers, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA, mass_kgpm=mass)
    stiffness = dynamic_stiffness(ORDERS, ring, PRESSURE_PA, omega)
    expected = PRESSURE_PA * modal_stiffness(ORDERS, numbers)
    # The terms that cancel are mass omega^2 n^4, so rounding is relative to them.
    assert np.abs(stiffness - expected).max() < 1e-9 * np.abs(
        modal_coefficients(ORDERS, ring, PRESSURE_PA, omega)[3][-1]
    )


def test_undamped_modes_equal_the_series() -> None:
    road = road_orders(ORDERS, 5000.0, RADIUS_M, 0.2)
    context = {"load_n": 5000.0, "pressure_pa": PRESSURE_PA, "radius_m": RADIUS_M, "half_angle_rad": 0.2}
    for kinematics in Kinematics:
        np.testing.assert_allclose(
            signal_orders(ORDERS, RING, PRESSURE_PA, OMEGA, road, kinematics),
            series_orders(ORDERS, TABLE_3_NUMBERS, **context, kinematics=kinematics, road=RoadForce.VERTICAL),
            rtol=1e-9,
            atol=1e-16,
        )
    modal = modal_number(ORDERS, TABLE_3_NUMBERS) / PRESSURE_PA
    np.testing.assert_allclose(
        displacement_orders(ORDERS, RING, PRESSURE_PA, OMEGA, np.ones(60, complex)), modal, rtol=1e-9
    )


def test_damping_lag_is_eq_12() -> None:
    damped = replace(RING, foundation_damping_nspm2=300.0)
    road = road_orders(ORDERS, 5000.0, RADIUS_M, 0.2)
    lag = phase_lag(ORDERS, damped, PRESSURE_PA, OMEGA)
    damping = 300.0 * (1.0 + ORDERS**2) * ORDERS * OMEGA
    np.testing.assert_allclose(np.tan(lag), damping / (PRESSURE_PA * modal_stiffness(ORDERS, TABLE_3_NUMBERS)))
    turned = displacement_orders(ORDERS, damped, PRESSURE_PA, OMEGA, road)
    still = displacement_orders(ORDERS, RING, PRESSURE_PA, OMEGA, road)
    np.testing.assert_allclose(turned, still * np.cos(lag) * np.exp(-1j * lag), rtol=1e-9)


def test_radial_and_tangential_damping_add_up() -> None:
    """c_n = c_v + c_w n^2; the tangential part alone is that of a ratio, less that without it."""
    radial, both = (
        modal_coefficients(
            ORDERS,
            replace(RING, foundation_damping_nspm2=300.0, tangential_damping_ratio=ratio),
            PRESSURE_PA,
            OMEGA,
        ).damping_nspm2
        for ratio in (0.0, 2.0)
    )
    np.testing.assert_allclose(radial, 300.0 * ORDERS**2)
    np.testing.assert_allclose(both - radial, 600.0)


@pytest.mark.parametrize(("damping", "ratio"), [(0.0, 1.0), (400.0, 1.0), (400.0, 0.0), (50.0, 20.0)])
def test_lightly_loaded_exact_ring_is_linear(damping: float, ratio: float) -> None:
    ring = replace(RING, foundation_damping_nspm2=damping, tangential_damping_ratio=ratio, extension_stiffness_n=5e8)
    exact = solve_rolling_ring(ring, 50.0, PRESSURE_PA, OMEGA, nodes=3600)
    theta, step = exact.theta_rad, 2.0 * np.pi / 3600
    n = np.arange(2, 25)[:, np.newaxis]
    kernel = (np.cos(theta) + 1j * np.sin(theta) / n) * np.exp(-1j * n * theta)
    road = kernel @ exact.contact_pressure_npm * step
    expected = signal_orders(n[:, 0], ring, PRESSURE_PA, OMEGA, road)
    result = 2.0 / 3600 * np.exp(-1j * n * theta) @ exact.sensor.radial_m
    assert np.abs(result - expected).max() < 6e-3 * np.abs(expected).max()
    if damping and ratio <= 1.0:
        assert np.abs(result.imag).max() > 0.03 * np.abs(result.real).max()
    # A wrong share of one of the dampings would turn the low orders by more than 10 mrad.
    assert np.abs(np.angle(result[:4] / expected[:4])).max() < 3e-3
