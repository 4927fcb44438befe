"""Angles without a sample are filled with the shape of the revolutions before, and count for nothing."""

import math

import numpy as np
import pytest

from gateway.pipeline.gap_filling import GapFilling, angles_in_gaps
from gateway.signal.angle_resampling import angle_grid, elapsed_angles, fit_phase

N = 256
SHAPE = np.stack([np.sin(angle_grid(N)), np.cos(3.0 * angle_grid(N)), 1.0 - np.exp(-((angle_grid(N) / 0.3) ** 2))])


def axes(omega_radps: float, constant: float = 0.0, ramp: float = 0.0) -> np.ndarray:
    turned = elapsed_angles(N)
    return SHAPE * omega_radps**2 + constant + ramp * turned


def gap(first: int, end: int) -> np.ndarray:
    inside = np.zeros(N, np.bool_)
    inside[first:end] = True
    return inside


def test_gap_is_filled_at_its_speed_with_the_constant_and_ramp_of_its_revolution() -> None:
    filling = GapFilling()
    for omega in (50.0, 51.0, 52.0, 53.0):
        assert filling.take(axes(omega), omega, None, "state", 0.0)
    true = axes(60.0, constant=3.0, ramp=0.5)
    damaged = true.copy()
    damaged[:, 20:60] = 999.0
    assert filling.take(damaged, 60.0, gap(20, 60), "state", 0.0)
    np.testing.assert_allclose(damaged, true, atol=1e-6)


def test_absent_axis_stays_absent_and_alone() -> None:
    filling = GapFilling()
    for _ in range(4):
        row = axes(50.0)
        row[1] = math.nan
        filling.take(row, 50.0, None, "state", 0.0)
    damaged = axes(50.0)
    damaged[1] = math.nan
    damaged[[0, 2], 20:60] = 999.0
    assert filling.take(damaged, 50.0, gap(20, 60), "state", 0.0)
    np.testing.assert_allclose(damaged[[0, 2]], axes(50.0)[[0, 2]], atol=1e-6)
    assert np.isnan(damaged[1]).all()


def test_shape_may_come_from_revolutions_with_other_gaps() -> None:
    filling = GapFilling()
    for begin in (0, 40, 80, 120, 160, 200):
        row = axes(50.0)
        row[:, begin : begin + 30] = 999.0
        is_whole = filling.take(row, 50.0, gap(begin, begin + 30), "state", 0.0)
    # Four revolutions before have samples there.
    assert is_whole
    np.testing.assert_allclose(row, axes(50.0), atol=1e-6)


@pytest.mark.parametrize("why", ["too few before", "more filled than measured", "another state", "after a pause"])
def test_gap_without_a_shape_for_it_is_left(why: str) -> None:
    filling = GapFilling()
    for _ in range(3 if why == "too few before" else 4):
        filling.take(axes(50.0), 50.0, None, "state", 0.0)
    inside = gap(0, 150 if why == "more filled than measured" else 40)
    damaged = axes(50.0)
    damaged[:, inside] = 999.0
    assert not filling.take(
        damaged, 50.0, inside, "other" if why == "another state" else "state", 11.0 if why == "after a pause" else 0.0
    )
    assert (damaged[:, inside] == 999.0).all()


def test_gap_between_two_angles_of_the_grid_leaves_the_revolution_whole() -> None:
    # 40 samples lie between two angles of the grid.
    inside = angles_in_gaps([(12, 28)], fit_phase(0.0, 40.0 * N), N)
    assert not inside.any()
    filling = GapFilling()
    for _ in range(2):
        row = axes(50.0)
        assert filling.take(row, 50.0, inside, "state", 0.0)
        np.testing.assert_array_equal(row, axes(50.0))


def test_angles_in_gaps_are_those_between_the_samples_beside_them() -> None:
    phase = fit_phase(100.0, 356.0)
    inside = angles_in_gaps([(150, 160)], phase, N)
    turned = elapsed_angles(N)[inside] / (2.0 * math.pi) * 256.0 + 100.0
    assert 145.0 < turned.min() <= 149.0
    assert 160.0 <= turned.max() < 164.0
