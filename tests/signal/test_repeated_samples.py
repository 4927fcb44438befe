"""Counter of repeated samples."""

from __future__ import annotations

import numpy as np
import pytest

from gateway.signal.repeated_samples import RepeatedSamples, Repetition

SATURATION = 32_000


def result_of(counts: np.ndarray, saturation: int = SATURATION) -> Repetition | None:
    """Return the repetitions of samples that come in blocks."""
    counter = RepeatedSamples(counts.shape[1], saturation)
    for block in np.array_split(counts.astype(np.int16), 7):
        counter.add(block)
    return counter.result()


def noise(scale: float, channels: int = 3, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    slow = 3000.0 * np.sin(np.arange(40_000) / 90.0)[:, None]
    return np.round(slow + scale * rng.standard_normal((40_000, channels)))


def stuck(counts: np.ndarray, times: int, length: int) -> np.ndarray:
    result = counts.copy()
    for at in np.linspace(100, len(counts) - 100, times).astype(int):
        result[at : at + length] = counts[at]
    return result


@pytest.mark.parametrize("scale", [0.05, 0.4, 1.0, 3.0, 20.0])
@pytest.mark.parametrize("channels", [1, 3])
def test_quantised_noise_is_chance(scale: float, channels: int) -> None:
    assert result_of(noise(scale, channels)) is None


def test_still_and_dead_sensors_are_no_repetition() -> None:
    assert result_of(np.zeros((40_000, 3))) is None
    assert result_of(np.round(0.3 * noise(1.0)[:, :3] / 3000.0)) is None


def test_stuck_samples_are_counted() -> None:
    counts = noise(20.0)
    found = result_of(stuck(counts, 12, 5))
    assert found is not None
    assert (found.runs, found.samples, found.total) == (12, 48, 40_000)
    true = np.sqrt(np.square(stuck(counts, 12, 5) - counts).mean(axis=0))
    assert found.error_counts == pytest.approx(true, rel=0.5)


def test_two_equal_samples_are_no_run() -> None:
    assert result_of(stuck(noise(20.0), 30, 2)) is None


def test_saturated_samples_may_stay() -> None:
    assert result_of(np.clip(2.0 * noise(20.0, 1), -4000, 4000), saturation=4000) is None
