"""Unexplained signals of single revolutions."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.diagnosis.data.campaign_data import Block, EdgeTiming, Group, Repeats
from gateway.diagnosis.data.revolution_deviations import CELLS, angle_scatter
from gateway.diagnosis.effects.angle_orders import ORDERS
from gateway.diagnosis.effects.effect import GroupConditions
from gateway.diagnosis.remainder.unexplained_revolutions import unexplained_revolutions
from gateway.diagnosis.result import ScalingStatus
from gateway.diagnosis.views.phrases import place_text, residual_remarks, residual_sentence

GRID = 1024
COUNT = 80
THETA = -math.pi + 2.0 * math.pi * np.arange(GRID) / GRID


def group(
    signal: np.ndarray | float = 0.0,
    *,
    kmh: float = 60.0,
    seed: int = 1,
    reverse: bool = False,
    clipped_beyond_rad: float = math.inf,
) -> Group:
    """Return a group of revolutions with white noise of 2 m/s^2 and a signal, (COUNT, 3, GRID).

    Beyond an angle from the contact the radial axis stays at the end of its range.
    """
    rng = np.random.default_rng(seed)
    # Noise of a sensor that has half as many samples as the grid.
    rough = np.fft.rfft(2.0 * math.sqrt(2.0) * rng.standard_normal((COUNT, 3, GRID)))
    rough[..., GRID // 4 :] = 0.0
    remainder = np.fft.irfft(rough, n=GRID) + signal
    clipped = np.abs(THETA) > clipped_beyond_rad
    remainder[:, 2, clipped] *= 1e-3
    current = GroupConditions(kmh / 3.6 / 0.32, 0.0, 0.32, 4000.0, 2.1e5, 25.0, 25.0, 9600.0, 0.0, reverse=reverse)
    flat = Block(COUNT, current, np.zeros((3, ORDERS), complex))
    scatter = angle_scatter(remainder, np.ones(3, dtype=bool), np.arange(COUNT), clipped=bool(clipped.any()))
    return Group(f"{kmh} km/h", 0, 0, current, (flat,), np.ones((3, ORDERS)), 0.2, by_angle=scatter)


def burst(at_rad: float, size: float, *, seed: int = 5, axes: tuple[int, ...] = (0, 1, 2)) -> np.ndarray:
    """Return noise at one angle, another in each revolution."""
    rng = np.random.default_rng(seed)
    result = np.zeros((COUNT, 3, GRID))
    for axis in axes:
        result[:, axis] = size * np.exp(-0.5 * ((THETA - at_rad) / 0.1) ** 2) * rng.standard_normal((COUNT, GRID))
    return result


def test_even_noise_has_nothing_unexplained() -> None:
    for seed in range(40):
        assert unexplained_revolutions([group(seed=2 * seed), group(kmh=90.0, seed=2 * seed + 1)]) == ()


@pytest.mark.parametrize("turns", [np.zeros(COUNT), np.arange(COUNT) / COUNT])
def test_revolutions_without_noise_have_no_place(turns) -> None:
    """As of a model, of one turn repeated, or of a drift alone: there is nothing to compare a place with."""
    wave = turns[:, None, None] * np.cos(THETA) * np.ones((COUNT, 3, GRID))
    scatter = angle_scatter(wave, np.ones(3, dtype=bool), np.arange(COUNT), clipped=False)
    assert unexplained_revolutions([replace(group(), by_angle=scatter)]) == ()


@pytest.mark.parametrize("beyond_rad", [0.3, 1.4, 1.8, 2.8])
def test_noise_where_a_clipped_signal_is_free_is_no_place(beyond_rad: float) -> None:
    """At 0.3 rad, as where a range ends below the steady value: most of the turn has no noise to compare with."""
    for seed in range(5):
        assert unexplained_revolutions([group(seed=seed, clipped_beyond_rad=beyond_rad)]) == ()


def test_place_is_found_beside_clipping() -> None:
    (result,) = unexplained_revolutions([group(burst(1.2, 3.0, axes=(2,)), clipped_beyond_rad=2.5)])
    assert (result.lock, result.axis) == ("place", "radial")
    (result,) = unexplained_revolutions([group(burst(1.2, 3.0, axes=(1,)), clipped_beyond_rad=0.3)])
    assert (result.lock, result.axis, result.other_axes) == ("place", "lateral", ())


def test_a_few_odd_turns_are_no_place() -> None:
    """As at the end of a ramp, where the edges of three turns lie elsewhere."""
    odd = burst(-0.3, 8.0)
    odd[3:] = 0.0
    assert unexplained_revolutions([group(odd)]) == ()


def changed(at_rad: float, amounts: np.ndarray) -> np.ndarray:
    """Return one waveform at an angle, in each revolution by another amount."""
    result = np.zeros((COUNT, 3, GRID))
    result[:, 2] = amounts[:, None] * np.exp(-0.5 * ((THETA - at_rad) / 0.1) ** 2)
    return result


def test_step_or_drift_of_a_waveform_is_no_place() -> None:
    """As the load or a gain makes: neighbouring turns are alike."""
    for amounts in (np.where(np.arange(COUNT) < 40, -20.0, 20.0), np.linspace(-20.0, 20.0, COUNT)):
        assert unexplained_revolutions([group(changed(0.3, amounts))]) == ()


def test_rubbing_beside_a_step_is_found_at_its_own_place() -> None:
    step = changed(0.3, np.where(np.arange(COUNT) < 40, -20.0, 20.0))
    (result,) = unexplained_revolutions([group(step + burst(1.5, 2.0))])
    assert result.angle_rad is not None
    assert result.angle_rad[0] < 1.5 < result.angle_rad[1]


def test_one_waveform_by_random_amounts_is_a_place() -> None:
    amounts = np.random.default_rng(3).normal(0.0, 5.0, COUNT)
    result = unexplained_revolutions([group(changed(0.3, amounts))])
    assert result[0].lock == "place"


def test_coarse_converter_is_no_place() -> None:
    """It scatters where the signal passes from one step to the next, and nowhere else."""
    step = 8.0
    rng = np.random.default_rng(1)
    passing = np.abs(THETA - 0.8) < 0.4
    scatter = np.where(passing, rng.uniform(-0.5 * step, 0.5 * step, (COUNT, 3, GRID)), 0.0)
    coarse = group(scatter)
    assert [unexplained_revolution.lock for unexplained_revolution in unexplained_revolutions([coarse])][:1] == [
        "place"
    ]
    assert unexplained_revolutions([replace(coarse, step_mps2=(step, step, step))]) == ()


def test_few_revolutions_have_no_scatter_by_angle() -> None:
    assert angle_scatter(np.ones((5, 3, GRID)), np.ones(3, dtype=bool), np.arange(5)) is None
    assert unexplained_revolutions([replace(group(), by_angle=None)]) == ()


def test_rubbing_at_one_place_has_angle_size_and_growth() -> None:
    groups = [group(burst(1.2, 2.0), kmh=60.0), group(burst(1.2, 3.0, seed=6), kmh=90.0, seed=2)]
    (result,) = unexplained_revolutions(groups)
    assert result.lock == "place"
    assert result.angle_rad is not None
    assert result.angle_rad[0] < 1.2 < result.angle_rad[1]
    assert result.angle_rad[1] - result.angle_rad[0] < 0.6
    assert len(result.other_axes) == 2
    assert (result.scaling.status, result.scaling.exponent) == (ScalingStatus.KNOWN, 1.0)
    true = 3.0 * math.sqrt(0.1 * math.sqrt(math.pi) / (2.0 * math.pi))
    assert abs(result.rms_mps2 - true) < 3.0 * result.std_mps2 + 0.03 * true
    assert result.largest_in == "90.0 km/h"


def test_weak_rubbing_is_found_by_all_groups_together() -> None:
    alone = [group(burst(-2.0, 0.75, seed=seed), kmh=60.0, seed=seed + 20) for seed in range(6)]
    assert all(unexplained_revolutions([item]) == () for item in alone)
    (result,) = unexplained_revolutions(alone)
    assert result.angle_rad is not None
    assert result.angle_rad[0] < -2.0 < result.angle_rad[1]


def test_place_on_the_wheel_is_mirrored_in_reverse() -> None:
    groups = [group(burst(1.2, 2.0)), group(burst(-1.2, 2.0, seed=6), seed=2, reverse=True)]
    assert len(unexplained_revolutions(groups)) == 1


def test_place_may_lie_opposite_the_contact() -> None:
    wrapped = np.roll(burst(0.0, 3.0), GRID // 2, axis=-1)
    (result,) = unexplained_revolutions([group(wrapped)])
    assert result.angle_rad is not None
    low, high = result.angle_rad
    assert low < math.pi < high or low < -math.pi < high


def test_every_second_turn_is_recognised() -> None:
    pulse = 4.0 * np.exp(-0.5 * ((THETA + 0.9) / 0.1) ** 2) * np.sin(40.0 * THETA)
    signal = np.zeros((COUNT, 3, GRID))
    signal[::2, 2], signal[1::2, 2] = 0.5 * pulse, -0.5 * pulse
    results = [
        unexplained_revolution
        for unexplained_revolution in unexplained_revolutions([group(signal)])
        if unexplained_revolution.lock == "turns"
    ]
    assert len(results) == 1
    assert results[0].axis == "radial"
    assert results[0].rms_mps2 == pytest.approx(math.sqrt(np.square(0.5 * pulse).mean()), rel=0.25)


def test_random_bursts_are_not_every_second_turn() -> None:
    for seed in range(10):
        result = unexplained_revolutions([group(burst(0.5, 6.0, seed=seed), seed=seed)])
        assert {item.lock for item in result} == {"place"}


def test_corrected_contact_edges_may_leave_a_share() -> None:
    there = group(burst(0.3, 2.0))
    (result,) = unexplained_revolutions([there])
    explained = 40.0 * result.rms_mps2**2
    assert unexplained_revolutions([replace(there, edges=EdgeTiming(explained_m2ps4=explained))]) == ()


def test_repeated_samples_are_listed_with_their_error() -> None:
    stuck = replace(group(), recording=1, repeats=Repeats(20, 90, 40_000, (0.1, 0.0, 0.8)))
    (result,) = unexplained_revolutions([group(kmh=90.0), stuck])
    assert (result.lock, result.axis, result.rms_mps2) == ("samples", "radial", 0.8)
    assert result.other_axes == (("circumferential", 0.1),)
    assert result.largest_in == stuck.label


def test_cells_cover_the_revolution() -> None:
    scatter = group().by_angle
    assert scatter is not None
    assert scatter.power_m2ps4.shape == (3, CELLS)
    # 4, less the largest twentieth of the turns.
    assert scatter.power_m2ps4.mean() == pytest.approx(3.7, rel=0.05)
    assert scatter.successive_m2ps4.mean() == pytest.approx(3.7, rel=0.05)
    assert scatter.alternating_m2ps4.mean() == pytest.approx(3.5, rel=0.1)


@pytest.mark.parametrize(
    ("lock", "words"),
    [("place", "at one angle with another waveform"), ("turns", "odd and even turns"), ("samples", "data fault")],
)
def test_report_says_what_single_turns_show(lock: str, words: str) -> None:
    repeated = replace(group(burst(1.2, 2.0)), repeats=Repeats(20, 90, 40_000, (0.1, 0.0, 0.8)))
    entry = replace(unexplained_revolutions([repeated])[0], lock=lock)
    assert words in residual_sentence(entry)
    assert words in residual_remarks(entry)[0]
    assert "circumferential" in residual_sentence(entry)
    assert place_text(entry)


def contact(axis: int, times_s: np.ndarray | float = 0.0) -> np.ndarray:
    """Return a wheel's waveform with two steep edges, read late by times, (..., GRID) on one axis."""
    late = THETA + 60.0 / 3.6 / 0.32 * np.asarray(times_s)
    edges = np.tanh((late + 0.25) / 0.04) - np.tanh((late - 0.25) / 0.04)
    return np.asarray((900.0, 0.0, 1500.0)[axis] * (1.0 - 0.5 * edges))


def steep(scatter: np.ndarray) -> Group:
    """Return a group with that waveform and scatter."""
    made = group(scatter)
    waves = np.fft.rfft(np.roll([contact(axis) for axis in range(3)], GRID // 2, axis=-1)) * 2.0 / GRID
    mean = waves[:, :ORDERS].copy()
    mean[:, 0] *= 0.5
    return replace(made, blocks=(replace(made.blocks[0], orders_mps2=mean),))


def test_timing_noise_is_told_by_the_slope_of_the_waveform() -> None:
    times_s = 12e-6 * np.random.default_rng(4).standard_normal((COUNT, GRID))
    late = np.stack([contact(axis, times_s) - contact(axis) for axis in range(3)], axis=1)
    result = unexplained_revolutions([steep(late)])
    assert len(result) == 2
    for item in result:
        assert item.timing_s == pytest.approx(12e-6, rel=0.15)
        assert residual_remarks(item)[0].startswith("timing noise of 1")


@pytest.mark.parametrize(("at_rad", "axes"), [(-0.25, (0, 2)), (1.2, (0, 1, 2)), (-0.25, (1,))])
def test_rubbing_is_no_timing_noise(at_rad: float, axes: tuple[int, ...]) -> None:
    """Not at a steep edge either, while the other edge or another axis is quiet."""
    (result, *_) = unexplained_revolutions([steep(burst(at_rad, 3.0, axes=axes))])
    assert math.isnan(result.timing_s)
    assert "with another waveform each turn" in residual_remarks(result)[0]
