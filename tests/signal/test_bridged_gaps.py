"""Straight lines over gaps, against coarse, quiet, smooth and still signals."""

from collections.abc import Sequence

import numpy as np
import pytest

from gateway.signal.bridged_gaps import BridgedGaps, Bridging
from gateway.types import FloatArray
from tests.testkit.exact_ring import sampled, solution

COUNT = 40_000


def result_of(values: np.ndarray, blocks: int = 7) -> Bridging | None:
    finder = BridgedGaps(values.shape[1])
    for block in np.array_split(values, blocks):
        finder.add(block)
    return finder.result()


def noise(scale: float = 0.4, channels: int = 3, seed: int = 1) -> FloatArray:
    rng = np.random.default_rng(seed)
    slow = 300.0 * np.sin(np.arange(COUNT) / 90.0)[:, None]
    result: FloatArray = slow + scale * rng.standard_normal((COUNT, channels))
    return result


def rolling(noise_mps2: float, speed_kmh: float = 90.0, revolutions: int = 60) -> FloatArray:
    """Return radial and circumferential axis of an exact ring, (n, 2)."""
    samples, _ = sampled(solution(), 9600.0, speed_kmh, revolutions=revolutions, noise_mps2=noise_mps2, seed=3)
    return samples


def bridged(values: np.ndarray, starts: Sequence[int], length: int) -> FloatArray:
    """Return values in which `length` samples from each start are missing and replaced by a line."""
    result: FloatArray = values.astype(float)
    for position in starts:
        result[position : position + length] = np.linspace(values[position - 1], values[position + length], length + 2)[
            1:-1
        ]
    return result


STARTS = list(range(500, COUNT - 500, 1000))


@pytest.mark.parametrize("length", [5, 8, 40, 300])
@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("blocks", [1, 7, 40])
def test_bridged_gaps_are_found_sample_by_sample(length: int, channels: int, blocks: int) -> None:
    result = result_of(bridged(noise(channels=channels), STARTS, length), blocks)
    assert result is not None
    assert result.lines.tolist() == [[position, position + length] for position in STARTS]
    assert (result.samples, result.total) == (length * len(STARTS), COUNT)
    assert not result.is_everywhere


@pytest.mark.parametrize("step", [1e-6, 0.01, 0.1])
def test_rounding_after_bridging_hides_few_lines(step: float) -> None:
    values = np.rint(bridged(noise(1.0), STARTS, 40) / step) * step
    result = result_of(values)
    assert result is not None
    assert len(result.lines) > 0.9 * len(STARTS)


def test_bridging_of_coarse_values_is_found() -> None:
    result = result_of(bridged(np.rint(noise() / 1.9) * 1.9, STARTS, 40))
    assert result is not None
    assert len(result.lines) > 0.5 * len(STARTS)


def test_integers_do_not_overflow() -> None:
    counts = np.rint(noise() * 100.0).astype(np.int16)
    assert result_of(counts) is None
    result = result_of(np.rint(bridged(counts, STARTS, 40)).astype(np.int16))
    assert result is not None
    assert len(result.lines) > 0.9 * len(STARTS)


@pytest.mark.parametrize("scale", [0.0, 0.01, 0.1, 0.4, 3.0])
@pytest.mark.parametrize("step", [1e-9, 0.06, 0.5, 1.9, 15.3])
@pytest.mark.parametrize("axes", [slice(0, 1), slice(1, 2), slice(0, 2)])
def test_rolling_wheel_has_no_bridged_gaps(scale: float, step: float, axes: slice) -> None:
    for speed_kmh in (8.0, 40.0, 90.0, 140.0):
        revolutions = 12 if speed_kmh < 20.0 else 60
        values = np.rint(rolling(scale, speed_kmh, revolutions)[:, axes] / step) * step
        assert result_of(values) is None, speed_kmh


def test_still_wheel_between_bridged_gaps_is_none() -> None:
    values = noise()
    values[10_000:20_000] = np.rint(np.random.default_rng(2).normal(0.0, 0.3, (10_000, 3)) / 0.3) * 0.3
    assert result_of(values) is None
    result = result_of(bridged(values, [position for position in STARTS if not 9_000 < position < 21_000], 40))
    assert result is not None
    assert not any(10_000 <= first < 20_000 for first, _ in result.lines)


def test_constant_and_saturated_axes_are_no_lines() -> None:
    assert result_of(np.zeros((COUNT, 3))) is None
    assert result_of(np.clip(noise(), -100.0, 100.0)) is None
    assert result_of(noise() * (1.0, 0.0, 0.0)) is None


def test_held_samples_are_no_lines() -> None:
    values = noise()
    for position in STARTS:
        values[position : position + 40] = values[position]
    assert result_of(values) is None


def test_signal_of_a_lower_rate_is_straight_everywhere() -> None:
    coarse = noise()[: COUNT // 10]
    places = np.arange(COUNT - 10) / 10.0
    result = result_of(np.column_stack([np.interp(places, np.arange(len(coarse)), axis) for axis in coarse.T]))
    assert result is not None
    assert result.is_everywhere


def test_missing_samples_are_no_lines() -> None:
    values = noise()
    for position in STARTS:
        values[position : position + 40] = np.nan
    assert result_of(values) is None


def test_lines_do_not_span_missing_samples() -> None:
    values = bridged(noise(), STARTS, 40)
    finder = BridgedGaps(3)
    for index in range(0, COUNT, 1000):
        finder.add(values[index : index + 520], follows=False)
        finder.add(values[index + 530 : index + 1000], follows=False)
    assert finder.result() is None
