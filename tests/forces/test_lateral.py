"""Double integration in the order domain, slope rows, running moments and roll calibration."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.revolutions.sensor_mounting import MOUNTING_STD_RAD, RollCalibration
from gateway.core.revolutions.synchronous_average import RunningMoments
from gateway.forces.lateral_deformation import (
    chord_row,
    deformation,
    lateral_coefficients,
    lateral_waveform,
    line_row,
    remove_roll,
    slope_row,
    streamline_slope,
)

N, RADIUS_M = 1024, 0.32
THETA = angle_grid(N)


def random_shape(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a band-limited y and its second derivative by the angle."""
    rng = np.random.default_rng(seed)
    n = np.arange(1, 31)[:, None]
    c, s = rng.normal(size=(2, 30, 1)) / n**2
    y = (c * np.cos(n * THETA) + s * np.sin(n * THETA)).sum(axis=0)
    return y, (-(n**2) * (c * np.cos(n * THETA) + s * np.sin(n * THETA))).sum(axis=0)


@given(st.integers(0, 2**31))
@settings(max_examples=20)
def test_deformation_inverts_second_derivative(seed: int) -> None:
    y, second = random_shape(seed)
    x = lateral_coefficients(second + 3.0)  # a constant is no deformation
    assert deformation(x, N) == pytest.approx(y, abs=1e-10)
    assert lateral_waveform(x, N) == pytest.approx(second, abs=1e-9)
    slope = (np.roll(y, -1) - np.roll(y, 1)) / (2 * (THETA[1] - THETA[0]) * RADIUS_M)
    assert streamline_slope(x, RADIUS_M, N) == pytest.approx(slope, abs=3e-2 * np.abs(slope).max())


@given(st.integers(0, 2**31), st.floats(-0.5, -0.05), st.floats(0.0, 0.5))
@settings(max_examples=20)
def test_rows_match_slopes_of_the_curve(seed: int, first: float, last: float) -> None:
    x = lateral_coefficients(random_shape(seed)[1])
    fine = np.linspace(first, last, 2001)
    dense = deformation(x, 2**17)
    y = np.interp(fine, angle_grid(2**17), dense)
    scale = np.abs(streamline_slope(x, RADIUS_M, N)).max()
    chord = (y[-1] - y[0]) / (RADIUS_M * (last - first))
    assert chord_row(first, last, RADIUS_M) @ x == pytest.approx(chord, abs=1e-4 * scale)
    line = np.polyfit(RADIUS_M * fine, y, 1)[0]
    assert line_row(first, last, RADIUS_M) @ x == pytest.approx(line, abs=2e-3 * scale)
    steep = np.interp(first, angle_grid(2**17), streamline_slope(x, RADIUS_M, 2**17))
    assert slope_row(first, RADIUS_M) @ x == pytest.approx(steep, abs=1e-4 * scale)


def test_slope_variance_is_row_covariance_row() -> None:
    rng = np.random.default_rng(3)
    records = lateral_coefficients(rng.normal(size=(4000, N)))
    row = line_row(-0.2, 0.25, RADIUS_M)
    assert (records @ row).std() == pytest.approx(np.linalg.norm(row) * math.sqrt(2.0 / N), rel=0.04)


@given(st.floats(-0.3, 0.3), st.floats(-50, 50), st.floats(-50, 2000))
def test_remove_roll_is_exact(tau: float, side: float, up: float) -> None:
    lateral = math.cos(tau) * side + math.sin(tau) * up
    radial = math.cos(tau) * up - math.sin(tau) * side
    assert remove_roll(np.array([lateral]), np.array([radial]), tau)[0] == pytest.approx(side, abs=1e-8)


def test_equal_weights_give_sample_moments() -> None:
    values = np.random.default_rng(1).normal(size=(40, 5))
    whole, diagonal = RunningMoments(5, covariance=True), RunningMoments(5)
    for i, value in enumerate(values):
        whole.update(value, 1.0 / (i + 1))
        diagonal.update(value, 1.0 / (i + 1))
    assert whole.mean == pytest.approx(values.mean(axis=0))
    assert whole.variance() == pytest.approx(np.cov(values.T))
    assert diagonal.variance() == pytest.approx(values.var(axis=0, ddof=1))
    assert whole.weight_square == pytest.approx(1 / 40)


def calibrate(roll_deg: float, offset: float, squares: list[float], noise: float = 0.0, **options: float):
    rng = np.random.default_rng(5)
    calibration = RollCalibration(**options)
    for square in squares:
        calibration.update(math.tan(math.radians(roll_deg)) * square + offset + rng.normal() * noise, square)
    return calibration


def test_roll_error_at_one_speed_is_the_offset() -> None:
    clean = calibrate(2.0, 0.0, [1019.0] * 50)
    assert math.degrees(clean.roll_rad) == pytest.approx(2.0, abs=1e-3)
    assert math.degrees(clean.roll_std_rad) == pytest.approx(math.degrees(1.0 / 1019.0), rel=0.05)
    off = calibrate(2.0, 1.0, [1019.0] * 50)
    assert abs(off.roll_rad - clean.roll_rad) == pytest.approx(clean.roll_std_rad, rel=0.1)


def test_two_speeds_separate_roll_from_offset() -> None:
    both = calibrate(-1.5, 9.8, [300.0] * 60 + [1600.0] * 60, noise=0.3)
    assert math.degrees(both.roll_rad) == pytest.approx(-1.5, abs=0.02)
    assert both.offset_mps2 == pytest.approx(9.8, abs=0.6)
    assert both.roll_std_rad < 0.25 * calibrate(0.0, 0.0, [1019.0] * 120).roll_std_rad


def test_bank_that_follows_the_speed_is_in_the_error_of_the_roll() -> None:
    rng = np.random.default_rng(7)
    pulls = []
    for _ in range(60):
        # Bank and speed wander over some seconds each, independent of one another.
        bank, speed, calibration = 0.0, 0.0, RollCalibration()
        offset = rng.normal()
        for _ in range(300):
            bank += -bank / 60.0 + rng.normal() * 0.35 * math.sqrt(2.0 / 60.0)
            speed += -speed / 40.0 + rng.normal() * 0.4 * math.sqrt(2.0 / 40.0)
            square = (18.0 + speed) ** 2 / 0.32
            calibration.update(offset + bank + 0.02 * square + rng.normal() * 0.1, square)
        pulls.append((calibration.roll_rad - math.atan(0.02)) / calibration.roll_std_rad)
    assert max(np.abs(pulls)) < 3.5
    assert np.std(pulls) < 1.2


def test_roll_tracks_slow_changes() -> None:
    moved = RollCalibration(horizon_revolutions=50)
    for roll in [0.0] * 200 + [0.01] * 300:
        moved.update(math.tan(roll) * 1000.0, 1000.0)
    assert moved.roll_rad == pytest.approx(0.01, abs=moved.roll_std_rad)
    assert moved.roll_rad == pytest.approx(0.01, rel=0.1)


def test_error_of_the_roll_covers_a_sensor_that_tips() -> None:
    tipped = RollCalibration()
    for count in range(120):
        true_rad = 0.0 if count < 60 else 0.07
        tipped.update(math.tan(true_rad) * 1000.0, 1000.0)
        if not 60 <= count < 63:
            assert abs(tipped.roll_rad - true_rad) < 3.0 * tipped.roll_std_rad
    in_a_curve = RollCalibration()
    for count in range(120):
        in_a_curve.update(3.0 if count > 60 else 0.0, 1000.0)
    assert in_a_curve.roll_std_rad == pytest.approx(calibrate(0.0, 0.0, [1000.0] * 120).roll_std_rad, rel=0.05)


def test_constant_that_no_sensor_has_is_in_the_error_of_the_roll() -> None:
    drifting = RollCalibration(offset_std_mps2=9.8)
    for count in range(200):
        # Both axes drift by the same: that looks like a roll with a constant that hides it.
        drift = 0.2 * max(count - 50, 0)
        drifting.update(drift, 3450.0 + drift)
    assert abs(drifting.roll_rad) < 3.0 * drifting.roll_std_rad


def test_roll_without_mean_keeps_mounting_error() -> None:
    nothing = calibrate(5.0, 0.0, [-3.0, 0.0, math.nan])
    assert nothing.count == 0
    assert nothing.roll_rad == 0.0
    assert nothing.roll_std_rad == MOUNTING_STD_RAD
    reference = calibrate(5.0, 0.0, [1000.0] * 3)
    reference.reset()
    assert (reference.count, reference.roll_rad, reference.roll_std_rad) == (0, 0.0, MOUNTING_STD_RAD)
