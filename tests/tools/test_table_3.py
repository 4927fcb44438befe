"""The figures of Table 3 in docs/evidence/ring-paper-figures.md."""

from functools import lru_cache

import numpy as np
import pytest

from gateway.ring.reference_tire import TABLE_3_NUMBERS
from gateway.ring.ring_series import Kinematics
from gateway.ring.rolling_ring import RingSolution
from tools.bench_ring_paper import RADIUS_M, ratio_with_truth_given
from tools.table_3 import (
    LOAD_N,
    PRESSURE_PA,
    contact,
    flat_angle,
    open_changes,
    scaled,
    sensitivities,
    solve,
    tire_that_reads_table_3,
    wave_change,
)


@lru_cache(maxsize=1)
def base() -> RingSolution:
    return solve()


def test_implied_stiffnesses() -> None:
    ring, position = base().ring, contact(base())
    assert ring.bending_stiffness_nm2 == pytest.approx(6.8, abs=0.05)
    assert ring.tension_width_m == pytest.approx(0.062, abs=6e-4)
    assert PRESSURE_PA * ring.tension_width_m * RADIUS_M == pytest.approx(4200.0, abs=1.0)
    assert position.half_angle_rad == pytest.approx(0.240, abs=5e-4)
    assert position.length_m == pytest.approx(0.153, abs=6e-4)
    assert position.deflection_m == pytest.approx(0.0263, abs=5e-5)
    assert position.mean_pressure_npm == pytest.approx(32.6e3, abs=50.0)
    assert position.mean_pressure_npm / PRESSURE_PA == pytest.approx(0.155, abs=5e-4)
    assert (position.peak_over_mean, position.centre_over_mean) == pytest.approx((1.22, 0.98), abs=5e-3)
    assert position.tension_loss == pytest.approx(0.338, abs=1e-3)
    assert position.tension_loss * 4200.0 == pytest.approx(1420.0, abs=5.0)
    assert position.overshoot == pytest.approx(1.50, abs=5e-3)
    middle = np.abs(base().theta_rad).argmin()
    assert base().sensor.radial_m[middle] / RADIUS_M == pytest.approx(-0.06, abs=5e-3)
    stiffness = 0.2 * LOAD_N / (solve(load_n=1.1 * LOAD_N).deflection_m - solve(load_n=0.9 * LOAD_N).deflection_m)
    assert stiffness == pytest.approx(229e3, abs=1e3)


def test_linear_ring_has_another_contact_angle() -> None:
    assert flat_angle(Kinematics.PRINTED) == pytest.approx(0.217, abs=1e-3)
    assert flat_angle(Kinematics.CORRECTED) == pytest.approx(0.208, abs=1e-3)


def test_contact_half_angle_constraints() -> None:
    expected = {"Bs": -0.15, "Cw": -0.25, "Rs": -0.23, "Ts": 0.02, "kt": -0.09, "load": 0.71}
    assert sensitivities() == pytest.approx(expected, abs=6e-3)


def test_undetermined_quantities() -> None:
    expected = {
        "tread kt / 3": (0.270, 26.9, 1.20, 1.17, 33.8, 5.4),
        "tread kt x 3": (0.219, 26.1, 1.34, 0.80, 33.8, 3.6),
        "EA 1 MN": (0.239, 26.5, 1.22, 0.98, 32.7, 0.6),
        "EA 50 MN": (0.240, 26.3, 1.22, 0.98, 34.1, 0.1),
        "shear length 6 mm (GA 200 kN)": (0.241, 26.3, 1.21, 0.99, 33.8, 1.2),
        "belt mass x 2": (0.240, 26.3, 1.22, 0.98, 33.8, 0.0),
        "load + 10 %": (0.256, 28.5, 1.23, 0.95, 36.6, 9.6),
        "load - 10 %": (0.222, 24.1, 1.21, 1.02, 31.0, 9.7),
    }
    result = open_changes()
    assert list(result) == list(expected)
    for name, solution in result.items():
        position = contact(solution)
        half, sunk, peak, centre, loss, wave = expected[name]
        assert position.half_angle_rad == pytest.approx(half, abs=6e-4), name
        assert 1e3 * position.deflection_m == pytest.approx(sunk, abs=0.06), name
        assert (position.peak_over_mean, position.centre_over_mean) == pytest.approx((peak, centre), abs=6e-3), name
        assert 100.0 * position.tension_loss == pytest.approx(loss, abs=0.06), name
        assert 100.0 * wave_change(solution, base()) == pytest.approx(wave, abs=0.06), name


@pytest.mark.parametrize("factor", [0.7, 1.2])
def test_waveform_does_not_depend_on_force_scale(factor: float) -> None:
    assert wave_change(scaled(factor), base()) < 1e-5
    assert contact(scaled(factor)).half_angle_rad == pytest.approx(contact(base()).half_angle_rad, rel=1e-5)


def test_paper_estimator_on_this_ring() -> None:
    ratio, residual = ratio_with_truth_given(base())
    assert ratio == pytest.approx([0.78, 0.64, 1.07, 2.24], abs=6e-3)
    assert residual == pytest.approx(0.059, abs=6e-4)


@pytest.mark.parametrize(
    ("tread_mpa", "numbers", "read", "residual"),
    [
        (15.0, (0.95, 2.31, 0.33, 1.57), (1.0, 1.0, 1.0, 1.0), 0.20),
        (70.0, (0.84, 1.25, 0.90, 0.03), (0.69, 1.04, 0.94, 1.61), 0.08),
    ],
)
def test_a_tire_that_reads_as_table_3(
    tread_mpa: float, numbers: tuple[float, ...], read: tuple[float, ...], residual: float
) -> None:
    result = tire_that_reads_table_3(tread_mpa * 1e6)
    assert np.array(result.numbers) / np.array(TABLE_3_NUMBERS) == pytest.approx(numbers, abs=0.02)
    assert result.read_over_printed == pytest.approx(read, abs=0.02)
    assert result.residual == pytest.approx(residual, abs=0.006)
