import math

import numpy as np
import pytest

from gateway.compare.order_statistics import BLOCK_REVOLUTIONS, OrderAccumulator
from gateway.core.revolutions.angle_resampling import GRID_SIZE, angle_grid

OMEGA = 50.0


def curves(radial, circumferential=None):
    """Return the axes of a revolution; the lateral axis is absent."""
    axes = np.full((3, GRID_SIZE), math.nan)
    axes[0] = 0.0 if circumferential is None else circumferential
    axes[2] = radial
    return axes


def statistics_of(revolutions, step=5.0):
    total = OrderAccumulator(step)
    for index, (axes, omega, order_max) in enumerate(revolutions):
        total.add(index, axes, omega, order_max)
    result = total.statistics()
    assert result is not None
    return result


def test_amplitudes_are_those_of_the_waveform():
    theta = angle_grid()
    radial = 7.0 + 3.0 * np.cos(2 * theta) + 4.0 * np.sin(2 * theta) - 2.0 * np.cos(5 * theta)
    statistics = statistics_of([(curves(radial), OMEGA, 60)] * 20)
    expected = np.zeros(61)
    expected[[0, 2, 5]] = 7.0, 5.0, 2.0
    np.testing.assert_allclose(statistics.amplitude_mps2[2], expected, atol=1e-12)
    np.testing.assert_allclose(statistics.repeated_mps2[2], expected, atol=1e-12)
    assert np.isnan(statistics.amplitude_mps2[1]).all()
    assert (statistics.revolutions, statistics.blocks) == (20, 2)


def test_what_repeats_lies_on_integer_orders():
    theta = angle_grid()
    statistics = statistics_of([(curves(5.0 * np.cos(3 * theta)), OMEGA, 60)] * (3 * BLOCK_REVOLUTIONS))
    assert statistics.integer_share[2] == pytest.approx(1.0)
    assert statistics.integer_share_std[2] == pytest.approx(0.0, abs=1e-12)
    peak = statistics.fine_order[np.nanargmax(statistics.fine_mps2[2])]
    assert peak == 3.0


def test_noise_alone_has_an_eighth_on_integer_orders():
    rng = np.random.default_rng(1)
    noise = [(curves(rng.standard_normal(GRID_SIZE)), OMEGA, 60) for _ in range(40 * BLOCK_REVOLUTIONS)]
    statistics = statistics_of(noise)
    assert statistics.integer_share[2] == pytest.approx(1 / 8, abs=4 * statistics.integer_share_std[2])
    # What is not repeated averages out, and its amplitude stays.
    assert np.mean(statistics.repeated_mps2[2][1:]) < 0.1 * np.mean(statistics.amplitude_mps2[2][1:])


def test_line_between_orders_is_found_where_it_is():
    theta = np.linspace(0.0, 2 * math.pi * BLOCK_REVOLUTIONS, GRID_SIZE * BLOCK_REVOLUTIONS, endpoint=False)
    line = 2.0 * np.sin(4.375 * theta)
    # The grid of a revolution begins in the middle of its time.
    turns = [np.roll(part, GRID_SIZE // 2) for part in line.reshape(BLOCK_REVOLUTIONS, -1)]
    statistics = statistics_of([(curves(turn), OMEGA, 60) for turn in turns])
    index = int(np.nanargmax(statistics.fine_mps2[2]))
    assert (statistics.fine_order[index], statistics.fine_mps2[2][index]) == (4.375, pytest.approx(2.0))
    assert statistics.integer_share[2] == pytest.approx(0.0, abs=1e-12)


def test_change_of_speed_is_no_power_between_orders():
    theta = angle_grid()
    speeds = OMEGA * np.linspace(1.0, 1.05, BLOCK_REVOLUTIONS)
    statistics = statistics_of([(curves(1e-3 * speed**2 * np.cos(3 * theta)), speed, 60) for speed in speeds])
    assert statistics.integer_share[2] == pytest.approx(1.0)
    assert statistics.repeated_mps2[2][3] == pytest.approx(statistics.amplitude_mps2[2][3])


def test_waterfall_sorts_revolutions_by_speed():
    theta = angle_grid()
    slow, fast = (curves(np.cos(theta)), 12.0, 60), (curves(4.0 * np.cos(theta)), 23.0, 60)
    statistics = statistics_of([fast, slow, slow])
    assert [(speed.low_radps, speed.high_radps, speed.revolutions) for speed in statistics.speeds] == [
        (10.0, 15.0, 2),
        (20.0, 25.0, 1),
    ]
    assert [speed.amplitude_mps2[2][1] for speed in statistics.speeds] == [pytest.approx(1.0), pytest.approx(4.0)]
    assert statistics.omega_range_radps == (12.0, 23.0)


def test_the_last_range_of_speed_reaches_to_the_fastest_revolution():
    slow, fast = (curves(np.cos(angle_grid())), 12.0, 60), (curves(np.cos(angle_grid())), 130.0, 60)
    ranges = [(speed.low_radps, speed.high_radps) for speed in statistics_of([slow, fast], step=0.5).speeds]
    assert ranges == [(12.0, 12.5), (100.0, 130.0)]


def test_orders_above_the_sampling_are_unknown():
    statistics = statistics_of([(curves(np.cos(angle_grid())), OMEGA, 10)] * BLOCK_REVOLUTIONS)
    assert np.isfinite(statistics.amplitude_mps2[2][:11]).all()
    assert np.isnan(statistics.amplitude_mps2[2][11:]).all()
    assert np.isnan(statistics.fine_mps2[2][BLOCK_REVOLUTIONS * 10 + 5 :]).all()


@pytest.mark.parametrize(("indices", "after_gap"), [((0, 1, 2, 4, 5, 6), None), (range(6), 3)])
def test_gap_between_revolutions_ends_a_block(indices, after_gap):
    total = OrderAccumulator(5.0)
    for index in indices:
        total.add(index, curves(np.cos(angle_grid())), OMEGA, 60, follows=index != after_gap)
    result = total.statistics()
    assert result is not None
    assert (result.revolutions, result.blocks) == (6, 0)
    assert np.isnan(result.integer_share).all()
    assert result.block_mps2.size == 0


def test_short_recording_has_a_spectrum_of_its_longest_run():
    rng = np.random.default_rng(2)
    total = OrderAccumulator(5.0)
    for index in (*range(5), *range(6, 10)):
        total.add(index, curves(rng.standard_normal(GRID_SIZE)), OMEGA, 60)
    result = total.statistics()
    assert result is not None
    assert (result.blocks, result.block_revolutions, result.noise_share) == (1, 5, 0.2)
    assert result.fine_order[1] == pytest.approx(0.2)
    assert result.fine_mps2.shape == (3, 5 * 61)
    assert result.integer_share[2] == pytest.approx(0.2, abs=0.1)
    assert np.isnan(result.integer_share_std).all()
    assert result.speeds[0].blocks == 1


def test_each_speed_has_its_own_share():
    theta, rng = angle_grid(), np.random.default_rng(3)
    quiet = [(curves(np.cos(2 * theta)), 12.0, 60)] * (2 * BLOCK_REVOLUTIONS)
    noisy = [(curves(rng.standard_normal(GRID_SIZE)), 32.0, 60) for _ in range(2 * BLOCK_REVOLUTIONS)]
    statistics = statistics_of([*quiet, *noisy])
    slow, fast = statistics.speeds
    assert (slow.blocks, fast.blocks) == (2, 2)
    assert slow.integer_share[2] == pytest.approx(1.0)
    assert fast.integer_share[2] < 0.25
    np.testing.assert_allclose(slow.fine_mps2[2][2 * BLOCK_REVOLUTIONS], 1.0)
    np.testing.assert_allclose(statistics.block_mps2[2][:GRID_SIZE], np.roll(np.cos(2 * theta), -GRID_SIZE // 2))


def test_no_revolution_has_no_statistics():
    assert OrderAccumulator(5.0).statistics() is None
    with pytest.raises(ValueError, match="positive width"):
        OrderAccumulator(0.0)
