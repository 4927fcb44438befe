import math
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.revolutions.contact_edges import EDGE_MODEL_STD_RAD
from gateway.core.revolutions.order_spectrum import ORDER_COUNT, order_coefficients
from gateway.core.revolutions.synchronous_average import AngleAverage, RunningAverage

SHAPE = 1000.0 * (1.0 - np.exp(-((angle_grid() / 0.25) ** 4)))


def feed(
    average: RunningAverage,
    wave: np.ndarray,
    omega: float = 50.0,
    edges: tuple[float, float] = (-0.25, 0.25),
    order_max: int = 60,
    noise: float = 2.0,
    edges_std: tuple[float, float] = (0.0075, 0.0075),
) -> AngleAverage:
    return average.update_block(
        wave[np.newaxis],
        order_coefficients(wave, order_max)[np.newaxis],
        [omega],
        edges_rad=[edges],
        edges_std_rad=[edges_std],
        noise_mps2=[noise],
    ).at(0)


def waves(count: int, noise: float = 2.0, seed: int = 3) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    return [SHAPE + rng.normal(size=1024) * noise for _ in range(count)]


def test_plain_mean_until_horizon() -> None:
    data = waves(20)
    average = RunningAverage(horizon_revolutions=20)
    for wave in data:
        result = feed(average, wave)
    np.testing.assert_allclose(result.radial_mps2, np.mean(data, axis=0), atol=1e-9)
    np.testing.assert_allclose(result.scatter_mps2, np.std(data, axis=0, ddof=1), rtol=1e-9)
    assert result.count == 20
    assert result.effective_count == pytest.approx(20.0)
    np.testing.assert_allclose(result.orders_mps2, order_coefficients(np.mean(data, axis=0)), atol=1e-9)


def test_effective_count_matches_exponential_average() -> None:
    horizon = 10.0
    average = RunningAverage(horizon)
    for wave in waves(300):
        result = feed(average, wave)
    assert result.effective_count == pytest.approx(2.0 * horizon - 1.0, rel=1e-3)
    # A change of the tire is visible after a few horizons.
    for wave in waves(60):
        result = feed(average, 0.5 * wave)
    np.testing.assert_allclose(result.radial_mps2, 0.5 * SHAPE, atol=4.0)


@settings(max_examples=20)
@given(speeds=st.lists(st.floats(5.0, 300.0), min_size=2, max_size=12))
def test_average_scales_to_latest_speed(speeds: list[float]) -> None:
    average = RunningAverage()
    for omega in speeds:
        result = feed(average, SHAPE * omega**2, omega)
    np.testing.assert_allclose(result.radial_mps2, SHAPE * speeds[-1] ** 2, rtol=1e-9, atol=1e-6)
    assert result.omega_radps == speeds[-1]
    assert np.abs(result.scatter_mps2).max() < 1e-5 * speeds[-1] ** 2


@pytest.mark.parametrize("count", [2, 10, 60])
def test_standard_errors_match_scatter_of_average(count: int) -> None:
    means, stated, level, level_stated = [], [], [], []
    for seed in range(60):
        average = RunningAverage(horizon_revolutions=20)
        for wave in waves(count, seed=seed):
            result = feed(average, wave)
        means.append(result.orders_mps2[1:].real)
        stated.append(np.mean(result.orders_std_mps2[1:] ** 2))
        level.append(result.orders_mps2[0].real)
        level_stated.append(result.orders_std_mps2[0] ** 2)
    assert math.sqrt(np.mean(stated)) == pytest.approx(float(np.mean(np.std(means, axis=0))), rel=0.1)
    assert math.sqrt(np.mean(level_stated)) == pytest.approx(float(np.std(level)), rel=0.4)


def test_first_revolution_uses_stated_noise() -> None:
    result = feed(RunningAverage(), waves(1)[0], noise=2.0)
    assert result.effective_count == 1.0
    assert np.isnan(result.scatter_mps2).all()
    np.testing.assert_allclose(result.orders_std_mps2[1:], 2.0 * math.sqrt(2.0 / 1024.0), rtol=1e-9)


def test_nan_orders_keep_their_average() -> None:
    average = RunningAverage()
    feed(average, SHAPE, order_max=60)
    both = feed(average, SHAPE * 4.0, omega=100.0, order_max=30)
    np.testing.assert_allclose(both.orders_mps2, order_coefficients(SHAPE * 4.0), atol=1e-6)
    only_fast = feed(RunningAverage(), SHAPE, order_max=30)
    assert np.isfinite(only_fast.orders_mps2[:31]).all()
    assert np.isnan(only_fast.orders_mps2[31:]).all()
    assert np.isnan(only_fast.orders_std_mps2[31:]).all()
    assert len(only_fast.orders_mps2) == ORDER_COUNT


def test_mean_edge_error_keeps_model_uncertainty() -> None:
    rng = np.random.default_rng(8)
    average = RunningAverage()
    for wave in waves(100):
        leading, trailing = rng.normal(0.0, 0.0045, 2)
        result = feed(average, wave, edges=(-0.25 + leading, 0.26 + trailing))
    assert result.leading_edge_rad == pytest.approx(-0.25, abs=0.002)
    assert result.trailing_edge_rad == pytest.approx(0.26, abs=0.002)
    assert result.trailing_edge_std_rad > EDGE_MODEL_STD_RAD
    # What the stated errors have beyond the scatter is the definition's.
    assert result.trailing_edge_std_rad == pytest.approx(math.sqrt(0.0075**2 - 0.0045**2), rel=0.1)
    noisy = [feed(RunningAverage(), SHAPE).leading_edge_std_rad, result.leading_edge_std_rad]
    assert noisy[0] == pytest.approx(0.0075)
    assert noisy[0] > noisy[1]


def test_larger_stated_edge_error_is_kept() -> None:
    average = RunningAverage()
    for wave in waves(20):
        result = feed(average, wave, edges_std=(0.012, 0.012))
    assert result.leading_edge_std_rad == pytest.approx(0.012, rel=1e-6)


def test_nan_edges_keep_mean_edges() -> None:
    average = RunningAverage()
    missing = feed(average, SHAPE, edges=(math.nan, math.nan))
    assert math.isnan(missing.leading_edge_rad)
    assert math.isnan(missing.leading_edge_std_rad)
    feed(average, SHAPE)
    assert feed(average, SHAPE, edges=(math.nan, 0.3)).trailing_edge_rad == pytest.approx(0.25)


def test_returned_averages_do_not_change() -> None:
    average = RunningAverage()
    data = waves(4)
    first = feed(average, data[0])
    second = feed(average, data[1])
    copies = (
        second.radial_mps2.copy(),
        second.orders_mps2.copy(),
        second.scatter_mps2.copy(),
        first.radial_mps2.copy(),
    )
    feed(average, data[2])
    feed(average, data[3])
    for before, after in zip(
        copies, (second.radial_mps2, second.orders_mps2, second.scatter_mps2, first.radial_mps2), strict=True
    ):
        np.testing.assert_array_equal(before, after)


@settings(max_examples=30)
@given(
    highest=st.lists(st.sampled_from([54, 58, 60]), min_size=3, max_size=12),
    cuts=st.sets(st.integers(1, 11)),
)
def test_steps_do_not_depend_on_blocks(highest: list[int], cuts: set[int]) -> None:
    """A slow wheel's sampling carries other orders in one revolution than in the next."""
    data = waves(len(highest))
    orders = [order_coefficients(wave, order) for wave, order in zip(data, highest, strict=True)]

    def fed(edges: list[int]) -> list[tuple[float, np.ndarray]]:
        average, result = RunningAverage(6), []
        for begin, end in pairwise(edges):
            steps = average.update_block(
                np.stack(data[begin:end]),
                np.stack(orders[begin:end]),
                [50.0] * (end - begin),
                edges_rad=[(-0.25, 0.25)] * (end - begin),
                edges_std_rad=[(0.0075, 0.0075)] * (end - begin),
                noise_mps2=[2.0] * (end - begin),
            )
            result += list(zip(steps.scatters, steps.spectra, strict=True))
        return result

    count = len(highest)
    single = fed(list(range(count + 1)))
    blocks = fed([0, *sorted(cut for cut in cuts if cut < count), count])
    for (item, entry), (other, same) in zip(single, blocks, strict=True):
        assert item == pytest.approx(other, rel=1e-10, nan_ok=True)
        np.testing.assert_allclose(entry, same, rtol=1e-9, atol=1e-13)


def test_reset_makes_replay_identical() -> None:
    average = RunningAverage(5)
    assert average.latest is None
    first = [feed(average, wave) for wave in waves(12)][-1]
    np.testing.assert_array_equal(average.latest.radial_mps2, first.radial_mps2)
    average.reset()
    assert average.latest is None
    second = [feed(average, wave) for wave in waves(12)][-1]
    np.testing.assert_array_equal(first.radial_mps2, second.radial_mps2)
    np.testing.assert_array_equal(first.orders_std_mps2, second.orders_std_mps2)
    assert first.leading_edge_rad == second.leading_edge_rad


@pytest.mark.parametrize(
    ("wave", "omega"),
    [(np.full(1024, np.nan), 50.0), (np.zeros(512), 50.0), (SHAPE, 0.0), (SHAPE, math.nan), (SHAPE, -3.0)],
)
def test_invalid_revolution_raises_and_keeps_average(wave: np.ndarray, omega: float) -> None:
    average = RunningAverage()
    before = feed(average, SHAPE)
    with pytest.raises(ValueError, match="average"):
        feed(average, wave, omega)
    np.testing.assert_array_equal(average.latest.radial_mps2, before.radial_mps2)
    assert feed(average, SHAPE).count == 2


def test_horizon_below_one_raises() -> None:
    with pytest.raises(ValueError, match="horizon"):
        RunningAverage(0.5)


def test_what_is_filled_of_a_revolution_counts_for_nothing() -> None:
    rng = np.random.default_rng(5)
    whole, partly = RunningAverage(), RunningAverage()
    for wave in waves(400):
        average = feed(whole, wave)
        # A quarter without scatter, at any place.
        filled = np.where(np.roll(np.arange(1024), rng.integers(1024)) < 256, partly_mean(partly), wave)
        partly.update_block(
            filled[np.newaxis],
            order_coefficients(filled)[np.newaxis],
            [50.0],
            edges_rad=[(-0.25, 0.25)],
            edges_std_rad=[(0.0075, 0.0075)],
            noise_mps2=[2.0],
            measured=[0.75],
        )
    filled_average = partly.latest
    assert filled_average is not None
    assert filled_average.scatter_mps2.mean() == pytest.approx(average.scatter_mps2.mean(), rel=0.03)
    error = np.abs(filled_average.orders_mps2 - order_coefficients(SHAPE)) / filled_average.orders_std_mps2
    assert math.sqrt(0.5 * np.square(error[1:]).mean()) == pytest.approx(1.0, abs=0.35)
    assert filled_average.effective_count < average.effective_count


def partly_mean(average: RunningAverage) -> np.ndarray:
    return SHAPE if average.waveform_mps2 is None else average.waveform_mps2
