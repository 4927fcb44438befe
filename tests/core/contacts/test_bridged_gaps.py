"""Straight lines over gaps, repeated samples and clipping, against smooth, quiet, coarse and still signals."""

import itertools
from collections.abc import Sequence
from functools import cache

import numpy as np
import pytest
from scipy.special import ndtr

from gateway.core.revolutions.bridged_gaps import BridgedGaps, Bridging
from gateway.core.revolutions.clipping import is_clipped
from gateway.core.types import FloatArray
from gateway.diagnosis.repeated_samples import RepeatedSamples, Repetition
from tests.testkit.exact_ring import omega_at, sampled, solution

COUNT = 40_000


def bridging_of(values: np.ndarray, blocks: int = 7) -> Bridging | None:
    finder = BridgedGaps(values.shape[1])
    for block in np.array_split(values, blocks):
        finder.add(block)
    return finder.result()


def coarse_noise(scale: float = 0.4, channels: int = 3, seed: int = 1) -> FloatArray:
    rng = np.random.default_rng(seed)
    slow = 300.0 * np.sin(np.arange(COUNT) / 90.0)[:, None]
    result: FloatArray = slow + scale * rng.standard_normal((COUNT, channels))
    return result


@cache
def rolling(noise_mps2: float, speed_kmh: float = 90.0, revolutions: int = 60) -> FloatArray:
    """Return radial and circumferential axis of an exact ring, (n, 2)."""
    samples, _ = sampled(solution(), 9600.0, speed_kmh, revolutions=revolutions, noise_mps2=noise_mps2, seed=3)
    samples.flags.writeable = False
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
    result = bridging_of(bridged(coarse_noise(channels=channels), STARTS, length), blocks)
    assert result is not None
    assert result.lines.tolist() == [[position, position + length] for position in STARTS]
    assert (result.samples, result.total) == (length * len(STARTS), COUNT)
    assert not result.is_everywhere


@pytest.mark.parametrize("step", [1e-6, 0.01, 0.1])
def test_rounding_after_bridging_hides_few_lines(step: float) -> None:
    values = np.rint(bridged(coarse_noise(1.0), STARTS, 40) / step) * step
    result = bridging_of(values)
    assert result is not None
    assert len(result.lines) > 0.9 * len(STARTS)


def test_bridging_of_coarse_values_is_found() -> None:
    result = bridging_of(bridged(np.rint(coarse_noise() / 1.9) * 1.9, STARTS, 40))
    assert result is not None
    assert len(result.lines) > 0.5 * len(STARTS)


def test_integers_do_not_overflow() -> None:
    counts = np.rint(coarse_noise() * 100.0).astype(np.int16)
    assert bridging_of(counts) is None
    result = bridging_of(np.rint(bridged(counts, STARTS, 40)).astype(np.int16))
    assert result is not None
    assert len(result.lines) > 0.9 * len(STARTS)


@pytest.mark.parametrize("scale", [0.0, 0.01, 0.1, 0.4, 3.0])
@pytest.mark.parametrize("step", [1e-9, 0.06, 0.5, 1.9, 15.3])
@pytest.mark.parametrize("axes", [slice(0, 1), slice(1, 2), slice(0, 2)])
def test_rolling_wheel_has_no_bridged_gaps(scale: float, step: float, axes: slice) -> None:
    for speed_kmh in (8.0, 40.0, 90.0, 140.0):
        revolutions = 12 if speed_kmh < 20.0 else 60
        values = np.rint(rolling(scale, speed_kmh, revolutions)[:, axes] / step) * step
        assert bridging_of(values) is None, speed_kmh


def test_still_wheel_between_bridged_gaps_is_none() -> None:
    values = coarse_noise()
    values[10_000:20_000] = np.rint(np.random.default_rng(2).normal(0.0, 0.3, (10_000, 3)) / 0.3) * 0.3
    assert bridging_of(values) is None
    result = bridging_of(bridged(values, [position for position in STARTS if not 9_000 < position < 21_000], 40))
    assert result is not None
    assert not any(10_000 <= first < 20_000 for first, _ in result.lines)


def test_constant_and_saturated_axes_are_no_lines() -> None:
    assert bridging_of(np.zeros((COUNT, 3))) is None
    assert bridging_of(np.clip(coarse_noise(), -100.0, 100.0)) is None
    assert bridging_of(coarse_noise() * (1.0, 0.0, 0.0)) is None


def test_held_samples_are_no_lines() -> None:
    values = coarse_noise()
    for position in STARTS:
        values[position : position + 40] = values[position]
    assert bridging_of(values) is None


def test_signal_of_a_lower_rate_is_straight_everywhere() -> None:
    coarse = coarse_noise()[: COUNT // 10]
    places = np.arange(COUNT - 10) / 10.0
    result = bridging_of(np.column_stack([np.interp(places, np.arange(len(coarse)), axis) for axis in coarse.T]))
    assert result is not None
    assert result.is_everywhere


def test_missing_samples_are_no_lines() -> None:
    values = coarse_noise()
    for position in STARTS:
        values[position : position + 40] = np.nan
    assert bridging_of(values) is None


def test_lines_do_not_span_missing_samples() -> None:
    values = bridged(coarse_noise(), STARTS, 40)
    finder = BridgedGaps(3)
    for index in range(0, COUNT, 1000):
        finder.add(values[index : index + 520], follows=False)
        finder.add(values[index + 530 : index + 1000], follows=False)
    assert finder.result() is None


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


def imported_repeats(counts: np.ndarray, step: float) -> np.ndarray:
    """Return counts of a converter of a step in the counts of an import, which scales each axis to its largest."""
    coarse = np.rint(counts / step) * step
    return np.rint(coarse * (32767.0 / np.abs(coarse).max(axis=0)))


@pytest.mark.parametrize("step", [1.0, 8.0, 40.0, 300.0])
@pytest.mark.parametrize("scale", [0.4, 3.0, 20.0])
@pytest.mark.parametrize("channels", [1, 3])
def test_coarse_converter_is_chance(step: float, scale: float, channels: int) -> None:
    assert result_of(imported_repeats(noise(scale, channels), step), NEVER) is None


@pytest.mark.parametrize("step", [1.0, 1.5, 2.5, 8.0])
@pytest.mark.parametrize("share", [1.0, 0.05])
def test_stuck_samples_of_a_coarse_converter_are_counted(step: float, share: float) -> None:
    # A converter uses a part of its range on one axis, and hardly any on another.
    counts = imported_repeats(noise(20.0) * (1.0, share, 1.0), step * share)
    result = result_of(stuck(counts, 12, 5), NEVER)
    assert result is not None
    assert (result.runs, result.samples) == (12, 48)


def test_stuck_samples_are_counted_beside_a_dead_axis() -> None:
    result = result_of(stuck(noise(20.0) * (1.0, 0.0, 1.0), 12, 5))
    assert result is not None
    assert result.runs == 12


def test_values_between_the_steps_hide_no_step() -> None:
    counts = imported_repeats(noise(20.0), 8.0)
    for index in range(500, len(counts) - 500, 1000):
        counts[index : index + 40] = np.rint(np.linspace(counts[index - 1], counts[index + 40], 40))
    assert result_of(counts, NEVER) is None
    assert result_of(stuck(counts, 12, 5), NEVER) is not None


def counts(rate_hz: float, speed_kmh: float, noise: float, scale: float, cut: float | None = None) -> np.ndarray:
    samples, contacts = sampled(solution(), rate_hz, speed_kmh, revolutions=1, noise_mps2=noise, seed=3)
    radial = samples[int(contacts[0]) : int(contacts[1]), 1]
    if cut is not None:
        radial = np.minimum(radial, cut * 0.32 * omega_at(speed_kmh) ** 2)
    return np.rint(radial / scale).astype(np.int16)


@pytest.mark.parametrize("rate_hz", [2000.0, 9600.0, 25600.0])
@pytest.mark.parametrize("speed_kmh", [12.0, 65.0, 110.0])
@pytest.mark.parametrize("noise", [0.0, 0.1, 3.4])
def test_smooth_peak_is_not_clipped(rate_hz: float, speed_kmh: float, noise: float) -> None:
    assert not is_clipped(counts(rate_hz, speed_kmh, noise, 0.6))


@pytest.mark.parametrize("rate_hz", [2000.0, 9600.0, 25600.0])
@pytest.mark.parametrize("noise", [0.0, 3.4])
def test_cut_peak_is_clipped(rate_hz: float, noise: float) -> None:
    assert is_clipped(counts(rate_hz, 65.0, noise, 0.15, cut=1.3))


def test_zero_signal_is_not_clipped() -> None:
    assert not is_clipped(np.zeros(1000, np.int16))


def test_revolutions_below_one_count_of_noise_are_not_clipped() -> None:
    # 0.125 mg/rtHz at 9600 Hz is 0.14 counts of a sensor of +-2000 g; the phase of the sampling is another every time.
    rng = np.random.default_rng(5)
    samples, contacts = sampled(solution(), 9600.0, 65.0, revolutions=60, noise_mps2=0.085, seed=4)
    radial = samples[:, 1] / 0.6 + rng.uniform(-0.5, 0.5)
    revolutions = [np.rint(radial[int(a) : int(b)]).astype(np.int16) for a, b in itertools.pairwise(contacts)]
    assert not any(is_clipped(revolution) for revolution in revolutions)


@pytest.mark.parametrize("knee", [0.003, 0.01])
def test_soft_knee_is_clipped(knee: float) -> None:
    raw = counts(9600.0, 65.0, 0.5, 0.15).astype(float)
    limit = 1.15 * 0.32 * omega_at(65.0) ** 2 / 0.15
    width = knee * limit
    z = (raw - limit) / width
    over = width * np.exp(-0.5 * z**2) / np.sqrt(2.0 * np.pi) + (raw - limit) * ndtr(z)
    assert is_clipped(np.rint(raw - over).astype(np.int16))


def test_noisy_contact_cut_at_its_floor_is_clipped() -> None:
    raw = counts(9600.0, 65.0, 3.4, 0.15)
    assert not is_clipped(raw)
    assert is_clipped(np.maximum(raw, 0).astype(np.int16))


def imported(samples: np.ndarray, step: float) -> np.ndarray:
    """Return samples of a coarse converter in the counts of an import, which scales the largest value to 32767."""
    coarse = np.rint(samples / step) * step
    return np.rint(coarse * (32767.0 / np.abs(coarse).max())).astype(np.int16)


@pytest.mark.parametrize("step", [0.1, 0.48, 1.9, 15.3])
@pytest.mark.parametrize("noise", [0.0, 0.4, 3.4])
def test_coarse_converter_is_not_clipped(step: float, noise: float) -> None:
    samples, contacts = sampled(solution(), 9600.0, 65.0, revolutions=20, noise_mps2=noise, seed=4)
    raw = imported(samples[:, 1], step)
    assert not any(is_clipped(raw[int(a) : int(b)]) for a, b in itertools.pairwise(contacts))


@pytest.mark.parametrize("step", [0.1, 0.48, 1.9])
def test_coarse_converter_that_is_cut_is_clipped(step: float) -> None:
    samples, contacts = sampled(solution(), 9600.0, 65.0, revolutions=5, noise_mps2=0.4, seed=4)
    raw = imported(np.minimum(samples[:, 1], 1.15 * 0.32 * omega_at(65.0) ** 2), step)
    assert all(is_clipped(raw[int(a) : int(b)]) for a, b in itertools.pairwise(contacts))
