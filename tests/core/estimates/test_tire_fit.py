"""Load calibration and reference numbers on the exact ring, with estimated edges."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.reasons import codes_of
from gateway.core.revolutions.contact_edges import find_contact_edges
from gateway.forces.tire_fit import TirePoint, fit_load_calibration, reference_numbers
from gateway.ring.rolling_ring import solve_rolling_ring
from tests.testkit.exact_ring import BASE_RING, omega_at, on_grid


@cache
def point(load_n: float, pressure_pa: float) -> TirePoint:
    ring = solve_rolling_ring(BASE_RING, load_n, pressure_pa, omega_at(65.0), nodes=720)
    edges = find_contact_edges(omega_at(65.0) ** 2 * on_grid(ring.sensor.radial_m), 1069.0)
    return TirePoint("", load_n, 0.0, pressure_pa, 0.5 * (edges.trailing_rad - edges.leading_rad), {})


GRID = [(load, pressure) for load in (2500.0, 4000.0, 5500.0, 7000.0) for pressure in (1.8e5, 2.1e5, 2.4e5)]


def test_calibration_fits_the_exact_ring() -> None:
    fit = fit_load_calibration([point(*position) for position in GRID])
    assert np.abs(fit.residuals).max() < 0.03
    assert fit.calibration.relative_std < 0.02
    for load_n, pressure_pa in ((3200.0, 1.95e5), (6200.0, 2.25e5), (4700.0, 1.85e5)):
        there = point(load_n, pressure_pa)
        result = fit.calibration.load_at(there.half_angle_rad, pressure_pa)
        assert result == pytest.approx(load_n, rel=3.0 * fit.calibration.relative_std)


def test_left_out_error_predicts_new_loads() -> None:
    points = [point(load, 2.1e5) for load in (3000.0, 4500.0, 6000.0)]
    fit = fit_load_calibration(points)
    assert np.abs(fit.left_out).max() > np.abs(fit.residuals).max()
    assert fit.calibration.relative_std == pytest.approx(math.hypot(math.sqrt(np.square(fit.left_out).mean()), 0.01))
    without_last = fit_load_calibration(points[:2]).calibration
    expected = without_last.load_at(points[2].half_angle_rad, 2.1e5) / 6000.0 - 1.0
    assert fit.left_out[2] == pytest.approx(expected, abs=1e-9)


def test_one_recording_gives_uncertain_scale() -> None:
    fit = fit_load_calibration([point(5500.0, 2.1e5)])
    assert np.isnan(fit.left_out).all()
    assert fit.calibration.relative_std > 0.05
    for load_n, pressure_pa in ((4000.0, 2.1e5), (7000.0, 2.1e5), (5500.0, 1.8e5)):
        there = point(load_n, pressure_pa)
        result = fit.calibration.load_at(there.half_angle_rad, pressure_pa)
        assert result == pytest.approx(load_n, rel=2.0 * fit.calibration.relative_std)


def test_uncertain_load_has_less_weight() -> None:
    good = [point(*position) for position in GRID]
    wrong = replace(point(5500.0, 2.1e5), load_n=6600.0, load_std_n=1200.0)
    fit = fit_load_calibration([*good, wrong])
    clean = fit_load_calibration(good)
    assert np.abs(fit.residuals[:-1] - clean.residuals).max() < 0.005


def test_uncertain_half_angle_has_less_weight() -> None:
    """Noise that shortens the contact by 6 % does not move the exponent of a recording that states it."""
    good = [point(4200.0, 2.1e5), point(5000.0, 2.1e5)]
    half = good[0].half_angle_rad
    noisy = replace(good[0], half_angle_rad=0.94 * half)
    believed = fit_load_calibration([*good, noisy])
    doubted = fit_load_calibration([*good, replace(noisy, half_angle_std_rad=0.06 * half)])
    clean = fit_load_calibration(good)
    exponent, std = clean.calibration.angle_exponent, clean.angle_exponent_std
    assert believed.scatter > 2.0
    assert abs(doubted.calibration.angle_exponent - exponent) < 0.05
    assert doubted.angle_exponent_std == pytest.approx(std, rel=0.1)
    assert doubted.scatter == pytest.approx(1.0, abs=0.1)
    # The third recording is worth little, so that leaving one out says no more than with two.
    assert not doubted.is_error_measured


def test_one_load_does_not_determine_the_exponent() -> None:
    same = [replace(point(4200.0, 2.1e5), half_angle_rad=0.21 + 1e-4 * index) for index in range(3)]
    fit = fit_load_calibration(same)
    assert not fit.is_angle_exponent_determined
    assert not fit.is_pressure_exponent_determined
    assert not fit.is_error_measured
    assert fit.calibration.angle_exponent == pytest.approx(1.4, abs=0.02)
    assert fit.angle_exponent_std == pytest.approx(0.15, rel=0.05)
    full = fit_load_calibration([point(*position) for position in GRID])
    assert full.is_angle_exponent_determined
    assert full.is_pressure_exponent_determined
    assert full.angle_exponent_std < 0.05


def test_contradicting_points_are_not_believed() -> None:
    other = replace(point(4200.0, 2.1e5), half_angle_rad=1.12 * point(4200.0, 2.1e5).half_angle_rad)
    fit = fit_load_calibration([point(4200.0, 2.1e5), other])
    assert fit.scatter > 5.0
    assert fit.calibration.angle_exponent == pytest.approx(1.4, abs=0.05)
    assert fit.calibration.relative_std > 0.08


def test_range_check_and_slope() -> None:
    calibration = fit_load_calibration([point(*position) for position in GRID]).calibration
    assert calibration.outside(0.2, 2.1e5) == ()
    assert codes_of(calibration.outside(0.2, 3.0e5)) == (EstimateCode.PRESSURE_OUTSIDE_CALIBRATION,)
    assert codes_of(calibration.outside(0.6, 2.1e5)) == (EstimateCode.HALF_ANGLE_OUTSIDE_CALIBRATION,)
    by_difference = math.log(calibration.load_at(0.2002, 2e5) / calibration.load_at(0.2, 2e5)) / math.log(1.001)
    assert calibration.slope_at(0.2001) == pytest.approx(by_difference, rel=1e-3)


def numbers(bs: float, cw: float, rs: float, status: Status = Status.VALID) -> dict[str, Estimate]:
    return {name: Estimate(name, value, 0.01 * value, status) for name, value in (("Bs", bs), ("Cw", cw), ("Rs", rs))}


def test_reference_uses_points_of_one_pressure() -> None:
    points = [
        replace(point(5500.0, 1.8e5), numbers=numbers(3.5e-3, 0.195, 3.3)),
        replace(point(5500.0, 2.1e5), numbers=numbers(3.0e-3, 0.197, 3.0)),
        replace(point(5500.0, 2.4e5), numbers=numbers(2.625e-3, 0.193, 2.7)),
    ]
    result = reference_numbers(points, "weak-form")
    assert result.pressure_pa == 2.1e5
    assert result.Bs == pytest.approx(3.0e-3, rel=1e-9)
    assert result.Bs_std == pytest.approx(3.0e-5 / math.sqrt(3.0), rel=1e-6)
    assert result.Cw == pytest.approx(0.195, rel=2e-3)
    assert result.Rs == pytest.approx(3.0)
    assert result.Ts is None


def test_reference_uses_valid_numbers_only() -> None:
    points = [replace(point(5500.0, 2.1e5), numbers=numbers(3e-3, 0.195, 3.0, Status.PROVISIONAL))]
    assert reference_numbers(points, "weak-form").Bs is None


def test_reference_error_includes_scatter() -> None:
    points = [
        replace(point(load, 2.1e5), numbers=numbers(bs, 0.195, 3.0))
        for load, bs in ((2500.0, 2.8e-3), (4000.0, 3.0e-3), (5500.0, 3.2e-3))
    ]
    assert reference_numbers(points, "weak-form").Bs_std > 8e-5
