"""Modal estimator on the linear ring and on the exact one."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.estimators.estimator import Estimate, Status
from gateway.estimators.ring_modal import RingModalEstimator, fit_modal
from gateway.estimators.ring_paper import RingPaperEstimator
from gateway.physics.contact_pressure import road_orders
from gateway.physics.damped_modes import signal_orders
from gateway.physics.reference_tire import TABLE_3_NUMBERS
from gateway.physics.rolling_ring import RingParameters
from gateway.reasons import Code, codes_of
from tests.testkit.exact_ring import PRESSURE_PA, RADIUS_M, solution
from tests.testkit.revolution_data import CONDITIONS, OMEGA, exact_wave, make_revolution, settled

ORDERS = np.arange(1.0, 61.0)
LOAD_NUMBER = 5000.0 / (PRESSURE_PA * RADIUS_M**2)
factor = st.floats(0.6, 1.7)


def linear_orders(numbers: tuple[float, ...], half: float, shape: tuple[float, ...], centre: float) -> np.ndarray:
    ring = RingParameters.from_numbers(*numbers, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA)
    road = road_orders(ORDERS, 5000.0, RADIUS_M, half, shape) * np.exp(-1j * ORDERS * centre)
    return signal_orders(ORDERS, ring, PRESSURE_PA, OMEGA, road) / RADIUS_M


def estimates_of(wave: np.ndarray, estimator: object | None = None) -> dict[str, Estimate]:
    revolution = make_revolution(wave)
    chosen = estimator or RingModalEstimator()
    return {e.name: e for e in chosen.update(revolution, settled(revolution), CONDITIONS)}


@settings(max_examples=25)
@given(
    factors=st.tuples(factor, factor, factor, factor),
    shape=st.tuples(st.floats(-0.2, 0.2), st.floats(-0.8, -0.2), st.floats(-0.1, 0.1), st.floats(-0.6, -0.1)),
    half=st.floats(0.19, 0.3),
)
def test_linear_ring_is_recovered_with_edges_and_pressure(
    factors: tuple[float, ...], shape: tuple[float, ...], half: float
) -> None:
    numbers = tuple(f * n for f, n in zip(factors, TABLE_3_NUMBERS, strict=True))
    data = linear_orders(numbers, half, shape, 0.003)[1:]
    # The measured edges have a small error. A wider contact with less pressure at its edges is nearly the same.
    fit = fit_modal(ORDERS[1:], data, np.full(59, 1e-9), edges_rad=(-half - 0.002, half + 0.004), edge_std_rad=0.006)
    assert fit is not None
    model = np.abs(fit.residual).max() / np.abs(data).max()
    assert model < 5e-3
    relative = fit.numbers * LOAD_NUMBER / np.array(numbers) - 1.0
    assert (np.abs(relative) < [0.08, 0.08, 0.08, 0.5]).all()
    assert fit.half_angle_rad == pytest.approx(half, abs=0.03)


def test_exact_ring_gives_bending_but_not_tension() -> None:
    """At 5000 N half of the tension is lost in the contact, which no linear ring shows."""
    wave = exact_wave(solution())
    modal, paper = estimates_of(wave), estimates_of(wave, RingPaperEstimator())
    true = dict(zip(("Bs", "Cw", "Rs", "Ts"), TABLE_3_NUMBERS, strict=True))
    assert modal["Bs"].value == pytest.approx(true["Bs"], rel=0.04)
    assert abs(paper["Bs"].value / true["Bs"] - 1.0) > 0.15
    assert modal["Cw"].value / true["Cw"] == pytest.approx(0.6, abs=0.05)
    assert modal["Rs"].value == pytest.approx(true["Rs"], rel=0.15)
    assert codes_of(modal["Bs"].reasons) == (Code.LINEAR_RING_TENSION,)


def test_light_loads_give_all_numbers() -> None:
    ring = solution(300.0)
    revolution = make_revolution(
        exact_wave(ring), edges=(ring.leading_edge_rad, ring.trailing_edge_rad), edge_std=0.002
    )
    conditions = replace(CONDITIONS, load_n=300.0)
    results = {e.name: e for e in RingModalEstimator().update(revolution, settled(revolution), conditions)}
    for name, number in zip(("Bs", "Cw", "Rs"), TABLE_3_NUMBERS, strict=False):
        assert results[name].value == pytest.approx(number, rel=0.06)


def test_gain_and_speed_do_not_change_the_fit() -> None:
    wave = exact_wave(solution())
    base, louder = estimates_of(wave), estimates_of(1.05 * wave)
    for name, estimate in base.items():
        assert louder[name].value == pytest.approx(estimate.value, rel=1e-3)


def test_non_ring_signals_are_rejected() -> None:
    wave = exact_wave(solution())
    rng = np.random.default_rng(1)
    for other in (wave - 2.0 * wave.mean(), wave.mean() + rng.normal(0.0, 500.0, 1024)):
        revolution = make_revolution(other, edges=(-0.2, 0.2), edge_std=0.005)
        result = RingModalEstimator().update(revolution, settled(revolution), CONDITIONS)
        assert all(e.status is Status.INVALID for e in result)
    assert fit_modal(ORDERS[1:], np.zeros(59, complex), np.ones(59), edges_rad=(-0.2, 0.2), edge_std_rad=0.01) is None
