"""Weak form and modal estimator on linear and exact rings: accuracy, invariance and stated errors."""

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import extended
from gateway.core.reasons import codes_of
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.forces.damped_modes import signal_orders
from gateway.papers.reasons import PaperCode
from gateway.papers.ring_modal import RingModalEstimator, fit_modal
from gateway.papers.ring_paper import RingPaperEstimator
from gateway.ring.belt_shape import MAX_ORDER, curvature_orders, orders_about
from gateway.ring.contact_pressure import road_orders
from gateway.ring.order_errors import relative_std, wave_std
from gateway.ring.reasons import RingCode
from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring
from gateway.ring.tread_pattern import EdgeWaves
from gateway.ring.weak_form import WaveformFits, WeakFormEstimator
from gateway.ring.weak_form import fits_of as fits_of_solution
from gateway.ring.weak_form_rows import motion_begin
from gateway.ring.weak_form_solve import solve_balance
from tests.testkit.exact_ring import BASE_RING, PRESSURE_PA, RADIUS_M, omega_at, on_grid, solution
from tests.testkit.revolution_data import CONDITIONS, OMEGA, exact_wave, make_revolution, settled

TRUTH = np.array(TABLE_3_NUMBERS)
# 5 mg/rtHz over one revolution at 65 km/h, as a share of R omega^2, of a real order.
NOISE = 1.44e-4
LOAD_NUMBER = 5000.0 / (PRESSURE_PA * RADIUS_M**2)


def estimates_of(
    wave: np.ndarray, conditions: TireConditions = CONDITIONS, *, count: int = 10, **revolution: object
) -> dict[str, Estimate]:
    data = make_revolution(wave, **revolution)
    return {e.name: e for e in WeakFormEstimator().update(data, settled(data, count), conditions)}


def errors_of(
    ring: RingSolution, conditions: TireConditions | None = None, wave: np.ndarray | None = None
) -> np.ndarray:
    """Return the relative errors of the four numbers."""
    conditions = conditions or TireConditions(RADIUS_M, ring.load_n, ring.pressure_pa)
    estimates = estimates_of(exact_wave(ring) if wave is None else wave, conditions)
    return np.array([estimates[name].value for name in ("Bs", "Cw", "Rs", "Ts")]) / np.array(ring.numbers) - 1.0


def fits_of(waves: np.ndarray, order_std: float) -> WaveformFits:
    """Fit waveforms over R omega^2 of the 5000 N ring."""
    orders = orders_about(waves, 0.0, MAX_ORDER).real
    shapes = curvature_orders(orders, 0.0)
    std = relative_std(np.full(61, order_std), float(orders[:, 0].mean()), shapes.mean(axis=0), MAX_ORDER)[np.newaxis]
    balance = solve_balance(shapes, motion_begin(solution().half_angle_rad), std.repeat(len(waves), axis=0), None, 4)
    return fits_of_solution(balance, std)


def test_numbers_are_recovered_over_table_1() -> None:
    errors = []
    for wear, pressure, load in itertools.product((0.0, 2.9, 6.4), (1.7e5, 2.5e5), (2000.0, 5000.0, 8000.0)):
        sidewall = 0.5 + 0.5 * pressure / PRESSURE_PA
        ring = replace(
            BASE_RING,
            bending_stiffness_nm2=BASE_RING.bending_stiffness_nm2 * (1.0 - wear / 15.0) ** 3,
            radial_stiffness_npm2=BASE_RING.radial_stiffness_npm2 * sidewall,
            tangential_stiffness_npm2=BASE_RING.tangential_stiffness_npm2 * sidewall,
        )
        errors.append(errors_of(solution(load, pressure, ring)))
    rms, worst = np.sqrt(np.mean(np.square(errors), axis=0)), np.abs(errors).max(axis=0)
    assert (rms < [0.003, 0.002, 0.003, 0.03]).all()
    assert (worst < [0.006, 0.004, 0.004, 0.03]).all()


def test_remaining_error_is_the_belts_extension() -> None:
    stiff = solve_rolling_ring(replace(BASE_RING, extension_stiffness_n=5e8), 5000.0, PRESSURE_PA, OMEGA, nodes=1440)
    assert (np.abs(errors_of(stiff)) < [2e-3, 1e-3, 5e-4, 2e-3]).all()


BASE_ERRORS = errors_of(solution())


@pytest.mark.parametrize(
    ("change", "most"),
    [
        ({"tread_stiffness_npm2": 3.5e7}, (6e-4, 6e-4, 6e-4, 2e-3)),
        ({"tread_damping_nspm2": 5e4}, (1e-3, 1e-3, 1e-3, 8e-3)),
        ({"foundation_damping_nspm2": 200.0}, (4e-3, 3e-3, 4e-3, 0.012)),
        ({"shear_stiffness_n": 2e5}, (0.012, 0.008, 2e-3, 0.006)),
        ({"sidewall_stiffening_pm": 5.0}, (0.045, 0.05, 0.08, 0.08)),
        ({"sidewall_stiffening_pm": -5.0}, (0.055, 0.06, 0.08, 0.1)),
    ],
)
def test_unmodelled_laws_change_the_numbers_little(change: dict[str, float], most: tuple[float, ...]) -> None:
    ring = solve_rolling_ring(replace(BASE_RING, **change), 5000.0, PRESSURE_PA, OMEGA, nodes=1440)
    assert (np.abs(errors_of(ring) - BASE_ERRORS) <= most).all()


@pytest.mark.parametrize("options", [{"drum_radius_m": 0.85}, {"axle_torque_nm": 300.0}])
def test_drums_and_torque_change_the_numbers_little(options: dict[str, float]) -> None:
    ring = solve_rolling_ring(BASE_RING, 5000.0, PRESSURE_PA, OMEGA, nodes=1440, **options)
    assert (np.abs(errors_of(ring) - BASE_ERRORS) < [7e-3, 6e-3, 0.015, 0.02]).all()


def test_gain_speed_and_centre_leave_numbers_unchanged() -> None:
    wave = exact_wave(solution())
    shifted = np.fft.irfft(np.fft.rfft(wave) * np.exp(-1j * np.arange(513) * 0.013), n=1024)
    for other in (0.95 * wave, 1.05 * wave, shifted):
        assert (np.abs(errors_of(solution(), wave=other) - BASE_ERRORS) < [2e-4, 1e-4, 1e-4, 1e-3]).all()
    for speed in (30.0, 120.0):
        ring = solve_rolling_ring(BASE_RING, 5000.0, PRESSURE_PA, omega_at(speed), nodes=1440)
        wave = OMEGA**2 * on_grid(ring.sensor.radial_m)
        assert (np.abs(errors_of(solution(), wave=wave) - BASE_ERRORS) < 1e-4).all()


def test_known_sensor_offset_is_corrected() -> None:
    ring = solve_rolling_ring(BASE_RING, 5000.0, PRESSURE_PA, OMEGA, nodes=1440, sensor_offset_m=0.005)
    wave = exact_wave(ring)
    corrected = errors_of(ring, replace(CONDITIONS, sensor_offset_m=0.005), wave)
    assert (np.abs(corrected - BASE_ERRORS) < [2e-3, 2e-3, 2e-3, 0.01]).all()
    uncorrected = errors_of(ring, wave=wave)
    assert uncorrected[1] < -0.04
    assert uncorrected[3] < -0.3


def test_numbers_scale_with_load_pressure_and_radius() -> None:
    wave = exact_wave(solution())
    estimates = estimates_of(wave)
    doubled = estimates_of(wave, replace(CONDITIONS, load_n=10000.0))
    assert doubled["Rs"].value == pytest.approx(2.0 * estimates["Rs"].value, rel=1e-9)
    uncertain = replace(CONDITIONS, load_std_n=100.0, pressure_std_pa=2.1e3, radius_std_m=0.0032)
    with_errors = estimates_of(wave, uncertain)
    scale = math.hypot(0.02, 0.01, 0.02)
    for name in ("Bs", "Cw", "Rs", "Ts"):
        expected = math.hypot(estimates[name].std, scale * estimates[name].value)
        assert with_errors[name].std == pytest.approx(expected, rel=1e-9)
        assert with_errors[f"{name}/Cw"].std == estimates[f"{name}/Cw"].std if name != "Cw" else True


def test_ratios_need_neither_load_nor_pressure() -> None:
    wave = exact_wave(solution())
    full, ratios = estimates_of(wave), estimates_of(wave, TireConditions(RADIUS_M))
    for name in ("Bs", "Cw", "Rs", "Ts"):
        assert ratios[name].status is Status.INVALID
        assert codes_of(ratios[name].reasons) == (RingCode.NEEDS_LOAD, EstimateCode.NEEDS_PRESSURE)
    for name in ("Bs/Cw", "Rs/Cw", "Ts/Cw"):
        assert ratios[name].value == pytest.approx(full[name].value, rel=1e-9)
        assert ratios[name].status is Status.VALID


def test_scatter_matches_error_and_approaches_bound() -> None:
    """The Cramer-Rao bound with unknown tread stiffness is 0.39, 1.40, 0.98, 6.0 % for one revolution."""
    rng = np.random.default_rng(4)
    clean = on_grid(solution().sensor.radial_m)
    waves = clean + rng.normal(0.0, NOISE * RADIUS_M * math.sqrt(512.0), (256, 1024))
    fits = fits_of(waves, NOISE * RADIUS_M)
    errors = fits.values * LOAD_NUMBER / TRUTH - 1.0
    spread = errors.std(axis=0)
    stated = np.sqrt(np.diagonal(fits.noise + fits.model, axis1=1, axis2=2)).mean(axis=0) * LOAD_NUMBER / TRUTH
    assert (spread < 1.3 * np.array([0.39 * 2.0, 1.40, 0.98, 6.0]) * 1e-2).all()
    np.testing.assert_allclose(stated / spread, 1.1, atol=0.2)
    # Errors of the factors do not bias the mean: five standard errors of it.
    assert (np.abs(errors.mean(axis=0) - BASE_ERRORS) < 5.0 * spread / 16.0).all()
    assert np.median(fits.misfit) == pytest.approx(1.0, abs=0.15)


def test_repeating_errors_leave_bending_unbiased() -> None:
    """Orders wrong by 0.5 % of R omega^2, the same in every revolution, survive averaging."""
    rng = np.random.default_rng(6)
    clean = on_grid(solution().sensor.radial_m)
    orders = np.arange(2, 61)
    theta = -math.pi + 2.0 * math.pi / 1024 * np.arange(1024)
    drawn = rng.normal(0.0, 0.005 * RADIUS_M, (60, 59)) @ np.cos(np.multiply.outer(orders, theta))
    values = np.array([fits_of(wave[np.newaxis], 1e-5 * RADIUS_M).values[0] for wave in clean + drawn])
    stated = np.array(
        [np.sqrt(np.diagonal(fits_of(wave[np.newaxis], 1e-5 * RADIUS_M).model[0])) for wave in clean + drawn[:20]]
    )
    ratio = values * LOAD_NUMBER / TRUTH
    spread = ratio.std(axis=0)
    assert abs(np.median(ratio[:, 0]) - 1.0) < 0.1
    assert (spread[:3] > 0.02).all()
    # From noise alone the stated error would be a hundredth of that.
    stated_error = np.median(stated, axis=0) * LOAD_NUMBER / TRUTH
    assert (stated_error[:3] > 0.4 * spread[:3]).all()
    assert (stated_error[:3] < 2.5 * spread[:3]).all()


def test_edge_waves_widen_the_errors() -> None:
    ring = solution()
    clean = on_grid(ring.sensor.radial_m)
    theta = -math.pi + 2.0 * math.pi / 1024 * np.arange(1024)
    off = []
    for phase, order in itertools.product(np.arange(0.0, 6.0, 1.5), (26.0, 34.0)):
        waves = EdgeWaves(0.1, order_before=order, order_after=1.6 * order, phase_rad=phase)
        wave = clean + RADIUS_M * waves.radial(theta, ring.leading_edge_rad, ring.trailing_edge_rad)
        fits = fits_of(wave[np.newaxis], 1e-5 * RADIUS_M)
        error = fits.values[0] * LOAD_NUMBER - TRUTH
        off.append(error / np.sqrt(np.diagonal(fits.noise[0] + fits.model[0])) / LOAD_NUMBER)
    assert (np.sqrt(np.mean(np.square(off), axis=0)) < 2.5).all()


def test_updates_start_warm_and_reset_forgets() -> None:
    wave = exact_wave(solution())
    rng = np.random.default_rng(7)
    average, estimator, fresh = RunningAverage(), WeakFormEstimator(), WeakFormEstimator()
    for _ in range(12):
        revolution = make_revolution(wave + rng.normal(0.0, 3.3, 1024))
        latest = extended(average, revolution)
        warm = estimator.update(revolution, latest, CONDITIONS)
    estimator.reset()
    cold = estimator.update(revolution, latest, CONDITIONS)
    assert cold == fresh.update(revolution, latest, CONDITIONS)
    for a, b in zip(warm, cold, strict=True):
        assert a.value == pytest.approx(b.value, abs=0.1 * b.std)
        assert a.status is Status.VALID


def test_few_orders_are_rejected() -> None:
    wave = exact_wave(solution())
    refused = estimates_of(wave, order_max=14)
    assert all(e.status is Status.INVALID and e.reasons[0]["orders"] == 14 for e in refused.values())
    spectrum = np.fft.rfft(wave)
    spectrum[41:] = 0.0
    estimates = estimates_of(np.fft.irfft(spectrum, n=1024), order_max=40)
    for name, true in zip(("Bs", "Cw", "Rs", "Ts"), TRUTH, strict=True):
        assert abs(estimates[name].value - true) < 4.0 * estimates[name].std + 0.03 * true


@pytest.mark.parametrize("wave", [np.zeros(1024), np.full(1024, -5.0), np.full(1024, 900.0)])
def test_non_tire_signals_are_rejected(wave: np.ndarray) -> None:
    estimates = estimates_of(wave, edges=(-0.2, 0.2))
    assert all(e.status is not Status.VALID for e in estimates.values())


def test_clipped_signal_does_not_balance() -> None:
    """Clipped revolutions are rejected before; where clipping is not detected, no number is valid."""
    clipped = estimates_of(np.minimum(exact_wave(solution()), 1.15 * RADIUS_M * OMEGA**2))
    assert {clipped[name].status for name in ("Bs", "Cw", "Ts")} <= {Status.PROVISIONAL, Status.INVALID}


@pytest.mark.parametrize("orders", [(81.0, 56.0), (86.0, 52.0), (75.0, 60.0)])
@pytest.mark.parametrize("phase_rad", [0.0, 2.0, 4.0])
def test_waves_of_tread_blocks_do_not_bend_the_numbers(orders: tuple[float, float], phase_rad: float) -> None:
    """Where the orders' errors are noise alone, Bs is up to 4.7 errors off."""
    wave, truth, theta = exact_wave(solution()), solution(), angle_grid(1024)
    before, behind = truth.leading_edge_rad - theta, theta - truth.trailing_edge_rad
    ahead = np.cos(orders[0] * theta + phase_rad) * np.exp(-before / 1.2) * (before > 0.0)
    after = 0.4 * np.cos(orders[1] * theta + phase_rad) * np.exp(-behind) * (behind > 0.0)
    spectrum = np.fft.rfft(ahead + after) * np.exp(-0.5 * (np.arange(513) / 80.0) ** 2)
    estimates = estimates_of(wave + 0.04 * wave.mean() * np.fft.irfft(spectrum, n=1024))
    for name, true in zip(("Bs", "Cw", "Rs", "Ts"), TRUTH, strict=True):
        assert estimates[name].status is Status.VALID
        assert abs(estimates[name].value - true) < 2.5 * estimates[name].std


def test_waves_are_told_from_damping_and_clipping() -> None:
    rng, noise = np.random.default_rng(3), np.full(61, 1e-5)
    shape = np.concatenate([[1.0], np.full(90, 1e-9)]).astype(np.complex128)
    damped, clipped, waves = shape.copy(), shape.copy(), shape.copy()
    damped[1:61] -= 1e-3j
    clipped[1:] += 1e-3 * rng.normal(size=90)
    waves[39:] += 1e-3 * (rng.normal(size=52) + 1j * rng.normal(size=52))
    assert not wave_std(damped, noise, 90).any()
    assert not wave_std(clipped, noise, 90).any()
    result = wave_std(7.0 * waves, noise, 90)
    assert not result[:39].any()
    assert result[39:] == pytest.approx(np.full(22, 1e-3), rel=0.5)
    assert wave_std(waves, np.full(61, 1e-3), 90) == pytest.approx(np.zeros(61))
    # Where the sampling carries no higher orders, sines alone show waves.
    assert wave_std(waves, noise, 50)[48:].all()
    assert not wave_std(waves, noise, 38).any()


def test_ring_far_from_table_3_is_recovered() -> None:
    ring = RingParameters.from_numbers(
        0.02, 0.4, 8.0, 1.0, radius_m=0.5, pressure_pa=8e5, extension_stiffness_n=5e8, tread_stiffness_npm2=2e8
    )
    exact = solve_rolling_ring(ring, 40000.0, 8e5, 40.0, nodes=1440)
    errors = errors_of(exact, TireConditions(0.5, 40000.0, 8e5))
    assert (np.abs(errors) < [0.01, 0.01, 0.01, 0.05]).all()


ORDERS = np.arange(1.0, 61.0)
factor = st.floats(0.6, 1.7)


def linear_orders(numbers: tuple[float, ...], half: float, shape: tuple[float, ...], centre: float) -> np.ndarray:
    ring = RingParameters.from_numbers(*numbers, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA)
    road = road_orders(ORDERS, 5000.0, RADIUS_M, half, shape) * np.exp(-1j * ORDERS * centre)
    return signal_orders(ORDERS, ring, PRESSURE_PA, OMEGA, road) / RADIUS_M


def modal_estimates_of(wave: np.ndarray, estimator: object | None = None) -> dict[str, Estimate]:
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
    modal, paper = modal_estimates_of(wave), modal_estimates_of(wave, RingPaperEstimator())
    true = dict(zip(("Bs", "Cw", "Rs", "Ts"), TABLE_3_NUMBERS, strict=True))
    assert modal["Bs"].value == pytest.approx(true["Bs"], rel=0.04)
    assert abs(paper["Bs"].value / true["Bs"] - 1.0) > 0.15
    assert modal["Cw"].value / true["Cw"] == pytest.approx(0.6, abs=0.05)
    assert modal["Rs"].value == pytest.approx(true["Rs"], rel=0.15)
    assert codes_of(modal["Bs"].reasons) == (PaperCode.LINEAR_RING,)


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
    base, louder = modal_estimates_of(wave), modal_estimates_of(1.05 * wave)
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
