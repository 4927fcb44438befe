"""Counter of repeated samples."""

import numpy as np
import pytest

from gateway.signal.repeated_samples import RepeatedSamples, Repetition

SATURATION = 32_000
NEVER = 65_535


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
    for position in np.linspace(100, len(counts) - 100, times).astype(int):
        result[position : position + length] = counts[position]
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
    result = result_of(stuck(counts, 12, 5))
    assert result is not None
    assert (result.runs, result.samples, result.total) == (12, 48, 40_000)
    true = np.sqrt(np.square(stuck(counts, 12, 5) - counts).mean(axis=0))
    assert result.error_counts == pytest.approx(true, rel=0.5)


def test_two_equal_samples_are_no_run() -> None:
    assert result_of(stuck(noise(20.0), 30, 2)) is None


def test_saturated_samples_may_stay() -> None:
    assert result_of(np.clip(2.0 * noise(20.0, 1), -4000, 4000), saturation=4000) is None


def imported(counts: np.ndarray, step: float) -> np.ndarray:
    """Return counts of a converter of a step in the counts of an import, which scales each axis to its largest."""
    coarse = np.rint(counts / step) * step
    return np.rint(coarse * (32767.0 / np.abs(coarse).max(axis=0)))


@pytest.mark.parametrize("step", [1.0, 8.0, 40.0, 300.0])
@pytest.mark.parametrize("scale", [0.4, 3.0, 20.0])
@pytest.mark.parametrize("channels", [1, 3])
def test_coarse_converter_is_chance(step: float, scale: float, channels: int) -> None:
    assert result_of(imported(noise(scale, channels), step), NEVER) is None


@pytest.mark.parametrize("step", [1.0, 1.5, 2.5, 8.0])
@pytest.mark.parametrize("share", [1.0, 0.05])
def test_stuck_samples_of_a_coarse_converter_are_counted(step: float, share: float) -> None:
    # A converter uses a part of its range on one axis, and hardly any on another.
    counts = imported(noise(20.0) * (1.0, share, 1.0), step * share)
    result = result_of(stuck(counts, 12, 5), NEVER)
    assert result is not None
    assert (result.runs, result.samples) == (12, 48)


def test_stuck_samples_are_counted_beside_a_dead_axis() -> None:
    result = result_of(stuck(noise(20.0) * (1.0, 0.0, 1.0), 12, 5))
    assert result is not None
    assert result.runs == 12


def test_values_between_the_steps_hide_no_step() -> None:
    counts = imported(noise(20.0), 8.0)
    for index in range(500, len(counts) - 500, 1000):
        counts[index : index + 40] = np.rint(np.linspace(counts[index - 1], counts[index + 40], 40))
    assert result_of(counts, NEVER) is None
    assert result_of(stuck(counts, 12, 5), NEVER) is not None
