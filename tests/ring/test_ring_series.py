import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad

from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.ring_series import (
    Kinematics,
    RoadForce,
    displacement_orders,
    modal_force,
    modal_number,
    modal_stiffness,
    pressure_number,
    signal_orders,
    signal_waveform,
    stiffness_terms,
)
from gateway.ring.rolling_ring import RingParameters
from tests.testkit.exact_ring import PRESSURE_PA, RADIUS_M, cosine_orders, omega_at, solution

ORDERS = np.arange(1, 61)
LOADED = {"load_n": 5000.0, "pressure_pa": PRESSURE_PA, "radius_m": RADIUS_M, "half_angle_rad": 0.2}

positive = st.floats(0.2, 5.0)


@settings(max_examples=40)
@given(factors=st.tuples(positive, positive, positive, positive), radius=st.floats(0.2, 0.6), bar=st.floats(1.0, 9.0))
def test_modal_number_is_eq_13(factors: tuple[float, float, float, float], radius: float, bar: float) -> None:
    pressure = bar * 1e5
    numbers = tuple(f * t for f, t in zip(factors, TABLE_3_NUMBERS, strict=True))
    ring = RingParameters.from_numbers(*numbers, radius_m=radius, pressure_pa=pressure)
    n = ORDERS.astype(float)
    equation_13 = (
        -(n**2)
        / math.pi
        * radius**4
        / (
            ring.bending_stiffness_nm2 * (n**6 - 2.0 * n**4 + n**2)
            + ring.tension_width_m * radius**3 * pressure * (n**4 - n**2)
            + ring.radial_stiffness_npm2 * radius**4 * n**2
            + ring.tangential_stiffness_npm2 * radius**4
        )
    )
    np.testing.assert_allclose(modal_number(ORDERS, ring.numbers(pressure)), equation_13 * pressure, rtol=1e-12)


@pytest.mark.parametrize("road", list(RoadForce))
def test_modal_force_matches_integral(road: RoadForce) -> None:
    load, radius, half = 4000.0, 0.3, 0.27
    push = load / (2.0 * radius * half)
    for n in (1, 2, 3, 7, 16, 40):

        def integrand(theta: float, n: int = n) -> float:
            if road is RoadForce.RADIAL:
                return push * math.cos(n * theta)
            return push * (math.cos(theta) * math.cos(n * theta) + math.sin(theta) * math.sin(n * theta) / n)

        expected, _ = quad(integrand, -half, half, limit=200)
        assert modal_force(n, load, radius, half, road) == pytest.approx(expected, abs=1e-6 * load)


def test_signal_orders_match_printed_eq_27() -> None:
    n = ORDERS.astype(float)
    bs, cw, rs, ts = TABLE_3_NUMBERS
    expected = (
        -5000.0
        / (RADIUS_M * 0.2 * math.pi * PRESSURE_PA)
        * np.sin(n * 0.2)
        * n**3
        / (bs * (n**6 - 2 * n**4 + n**2) + cw * (n**4 - n**2) + rs * n**2 + ts)
    )
    np.testing.assert_allclose(signal_orders(ORDERS, TABLE_3_NUMBERS, **LOADED), expected, rtol=1e-12)


def test_corrected_kinematics_add_rotating_frame() -> None:
    printed = signal_orders(ORDERS, TABLE_3_NUMBERS, **LOADED)
    corrected = signal_orders(ORDERS, TABLE_3_NUMBERS, kinematics=Kinematics.CORRECTED, **LOADED)
    np.testing.assert_allclose(corrected[:3] / printed[:3], [0.0, 0.75, 8.0 / 9.0])
    np.testing.assert_allclose(corrected / printed, 1.0 - 1.0 / ORDERS.astype(float) ** 2)


def test_contact_moves_belt_inward() -> None:
    theta = np.array([0.0, 1.5, math.pi])
    displacement = np.cos(np.outer(theta, ORDERS)) @ displacement_orders(ORDERS, TABLE_3_NUMBERS, **LOADED)
    assert displacement[0] < -0.01
    coefficients = signal_orders(ORDERS, TABLE_3_NUMBERS, kinematics=Kinematics.CORRECTED, **LOADED)
    waveform = signal_waveform(theta, omega_at(65.0), RADIUS_M, coefficients)
    baseline = omega_at(65.0) ** 2 * RADIUS_M
    assert abs(waveform[0]) < 0.15 * baseline
    np.testing.assert_allclose(waveform[1:], baseline, rtol=0.05)


def test_linear_ring_matches_exact_ring_at_small_load() -> None:
    exact = solution(100.0)
    orders = np.arange(2, 26)
    linear = signal_orders(
        orders,
        TABLE_3_NUMBERS,
        load_n=100.0,
        pressure_pa=PRESSURE_PA,
        radius_m=RADIUS_M,
        half_angle_rad=exact.half_angle_rad,
        kinematics=Kinematics.CORRECTED,
        road=RoadForce.VERTICAL,
    )
    true = cosine_orders(exact.sensor.radial_m)[orders - 1]
    np.testing.assert_allclose(linear, true, atol=0.02 * np.abs(true).max())
    # The printed kinematics give 4/3 of that at n = 2.
    assert signal_orders(
        2,
        TABLE_3_NUMBERS,
        load_n=100.0,
        pressure_pa=PRESSURE_PA,
        radius_m=RADIUS_M,
        half_angle_rad=exact.half_angle_rad,
    ) == pytest.approx(true[0] * 4.0 / 3.0, rel=0.05)


def test_stiffness_is_linear_in_numbers() -> None:
    np.testing.assert_allclose(modal_stiffness(1, TABLE_3_NUMBERS), TABLE_3_NUMBERS[2] + TABLE_3_NUMBERS[3])
    assert stiffness_terms(ORDERS).shape == (60, 4)
    np.testing.assert_allclose(stiffness_terms(2), [36.0, 12.0, 4.0, 1.0])


def test_pressure_number_of_base_case() -> None:
    assert pressure_number(5000.0, PRESSURE_PA, RADIUS_M, 0.2398) == pytest.approx(0.485, abs=0.001)
