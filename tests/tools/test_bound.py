import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.ring_quantities import RING_NUMBERS
from gateway.planner.cramer_rao import (
    DEFAULT_PARAMETERS,
    cramer_rao,
    order_variance,
    waveform_orders,
    waveform_sensitivity,
)
from gateway.ring.rolling_ring import solve_rolling_ring
from tests.testkit.exact_ring import BASE_RING, PRESSURE_PA, omega_at

OMEGA = omega_at(65.0)
DENSITY = 5e-3 * STANDARD_GRAVITY_MPS2


def sensitivity(load_n: float = 5000.0, parameters: tuple[str, ...] = DEFAULT_PARAMETERS):
    return waveform_sensitivity(BASE_RING, load_n, PRESSURE_PA, OMEGA, parameters=parameters, nodes=720)


BASE = sensitivity()
VARIANCE = order_variance(BASE.period_s, DENSITY)
BOUND = cramer_rao(BASE, VARIANCE)


@pytest.mark.parametrize(
    ("load_n", "percent"),
    [(2000.0, (0.38, 1.5, 1.6, 11.0)), (5000.0, (0.31, 1.36, 0.97, 6.0)), (8000.0, (0.31, 1.1, 0.67, 3.9))],
)
def test_bounds_with_known_tread(load_n: float, percent: tuple[float, ...]) -> None:
    bound = cramer_rao(sensitivity(load_n, RING_NUMBERS), VARIANCE)
    assert [100.0 * bound.std(name) for name in RING_NUMBERS] == pytest.approx(percent, rel=0.03)
    assert math.isnan(bound.period_std_s)


def test_bounds_with_unknown_tread() -> None:
    assert [100.0 * BOUND.std(name) for name in RING_NUMBERS] == pytest.approx((0.39, 1.40, 0.98, 6.0), rel=0.02)
    # The contact centre within 1.0 us is 0.0013 % of the speed.
    assert BOUND.period_std_s / BASE.period_s == pytest.approx(1.3e-5, rel=0.03)


def test_bound_matches_scatter_of_fits() -> None:
    """Linear least-squares fits of random noise scatter by the bound."""
    rng = np.random.default_rng(3)
    jacobian = np.concatenate([BASE.derivatives_mps2.real, BASE.derivatives_mps2.imag], axis=1) / np.sqrt(
        np.concatenate([VARIANCE, VARIANCE])
    )
    fits = np.linalg.lstsq(jacobian.T, rng.standard_normal((jacobian.shape[1], 4000)), rcond=None)[0]
    stds = [BOUND.std(name) for name in BASE.names]
    assert fits.std(axis=1) == pytest.approx(stds, rel=0.05)


def test_shape_hardly_determines_load() -> None:
    free = cramer_rao(sensitivity(parameters=(*DEFAULT_PARAMETERS, "load")), VARIANCE)
    assert free.std("load") > 20.0 * BOUND.std("Bs")
    reference = cramer_rao(sensitivity(parameters=(*DEFAULT_PARAMETERS, "load")), VARIANCE, prior_std={"load": 1e-6})
    assert reference.std("Bs") == pytest.approx(BOUND.std("Bs"), rel=1e-3)
    # The error is common to all four numbers, so their ratios keep their bound.
    assert free.ratio_std("Bs", "Cw") < 1.2 * BOUND.ratio_std("Bs", "Cw")


def test_bounds_scale_with_noise_and_speed() -> None:
    double = cramer_rao(BASE, order_variance(BASE.period_s, 2.0 * DENSITY))
    assert double.covariance == pytest.approx(4.0 * BOUND.covariance, rel=1e-9)
    # The shape of an undamped tire does not change with the speed.
    slow = replace(
        BASE,
        coefficients_mps2=0.25 * BASE.coefficients_mps2,
        derivatives_mps2=0.25 * BASE.derivatives_mps2,
        omega_radps=0.5 * OMEGA,
    )
    direct = waveform_sensitivity(BASE_RING, 5000.0, PRESSURE_PA, 0.5 * OMEGA, nodes=720)
    assert slow.derivatives_mps2 == pytest.approx(
        direct.derivatives_mps2, abs=1e-4 * np.abs(slow.derivatives_mps2).max()
    )
    # At half the speed the signal is a quarter, the noise of an order sqrt(1/2).
    at_half = cramer_rao(slow, order_variance(slow.period_s, DENSITY))
    assert at_half.std("Bs") == pytest.approx(4.0 / math.sqrt(2.0) * BOUND.std("Bs"), rel=1e-6)


def test_road_noise_counts_by_density() -> None:
    wide = order_variance(BASE.period_s, 0.0, road_rms_mps2=5.0, road_bandwidth_hz=1e6)
    density = 5.0 / math.sqrt(1e6 * math.pi / (2.0 * math.sqrt(2.0)))
    assert wide[1:] == pytest.approx(np.full(150, density**2 / BASE.period_s), rel=1e-6)
    assert wide[0] == pytest.approx(0.5 * wide[1])
    road = cramer_rao(BASE, order_variance(BASE.period_s, DENSITY, road_rms_mps2=5.0))
    # 5 m/s^2 below 500 Hz is equivalent to 23 mg/rtHz, 4.6 times the sensor's noise.
    assert 3.5 < road.std("Ts") / BOUND.std("Ts") < 5.0


def test_bounds_need_enough_orders() -> None:
    assert cramer_rao(BASE, VARIANCE[:61]).std("Rs") < 1.02 * BOUND.std("Rs")
    assert cramer_rao(BASE, VARIANCE[:10]).std("Bs") > 2.0 * BOUND.std("Bs")


def test_edge_derivatives_match_the_ring() -> None:
    stiffer = replace(BASE_RING, tread_stiffness_npm2=BASE_RING.tread_stiffness_npm2 * 1.05)
    moved = solve_rolling_ring(stiffer, 5000.0, PRESSURE_PA, OMEGA, nodes=720)
    predicted = BASE.edges_rad + math.log(1.05) * BASE.edge_derivatives_rad[BASE.names.index("tread")]
    assert (moved.leading_edge_rad, moved.trailing_edge_rad) == pytest.approx(predicted, abs=1e-4)


def test_waveform_orders_of_a_curve() -> None:
    theta = -math.pi + 2.0 * math.pi / 64 * np.arange(64)
    orders = waveform_orders(2.0 + 3.0 * np.cos(5 * theta) - 4.0 * np.sin(7 * theta), 10)
    expected = np.zeros(11, dtype=complex)
    expected[0], expected[5], expected[7] = 2.0, 3.0, 4.0j
    assert orders == pytest.approx(expected, abs=1e-12)


def test_unknown_parameter_raises() -> None:
    with pytest.raises(ValueError, match="colour"):
        sensitivity(parameters=("colour",))
