"""Excitation by tread blocks in the closure: recovery from data, mirror image in reverse, models without a belt."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.closure.effects.belt_dispersion import BlockTread, belt_wave, mass_of_wave
from gateway.closure.effects.catalogue import candidates, catalogue
from gateway.closure.effects.effect import CIRCUMFERENTIAL, RADIAL, BaselineModel, SignalEffect
from tests.closure.belt_data import CONDITIONS, block_of
from tests.closure.test_belt_recovery import std_of_recovered

NAME = "tread block excitation"
# Shares, blocks, mass, losses of belt and tread.
TRUTH = np.array([0.035, -0.02, 71.0, 4.6, 2.5e-5, 4e-5])


def effect() -> SignalEffect:
    result = catalogue()[NAME]
    assert isinstance(result, SignalEffect)
    return result


@pytest.mark.parametrize("speeds", [(65.0,), (45.0, 75.0)])
def test_blocks_mass_and_losses_are_found(speeds: tuple[float, ...]) -> None:
    std = std_of_recovered(effect(), TRUTH, 5, speeds)
    assert std[2] < 0.3
    assert std[3] < 0.05 * TRUTH[3]


def test_numbers_of_blocks_are_tried_with_the_mass_of_the_same_wave() -> None:
    start = (0.03, 0.03, 64.0, 6.8, 1e-4, 0.0)
    masses = [item[3] for item in effect().nearer(0, start, (CONDITIONS,))]
    assert min(masses) < 0.7 * 6.8 < 1.4 * 6.8 < max(masses)
    results = {item[2]: item[3] for item in effect().nearer(1, start, (CONDITIONS,))}
    assert set(results) >= {60.0, 64.0, 67.0, 70.0}
    assert results[60.0] > 1.5 * results[64.0] > 1.5 * results[67.0]
    assert results[67.0] == pytest.approx(3.7, rel=0.15)


def test_mass_of_a_wave_is_that_of_its_belt() -> None:
    bending, tension, mass, omega, radius = 6.8, 4200.0, 3.5, 52.0, 0.32
    wave = belt_wave(BlockTread(67.0, bending / mass, tension / mass, 0.0, 0.0), 0, omega, radius)
    # The dispersion has a sidewall of its own, of little weight.
    result = mass_of_wave(wave.order, 67.0, bending, tension, 1.8e5 * mass, omega, radius)
    assert result == pytest.approx(mass, rel=0.01)
    assert np.isnan(mass_of_wave(67.0, 67.0, bending, tension, 6e5, omega, radius))


def test_reverse_sees_the_mirror_image_of_the_pattern() -> None:
    forward, back = block_of(), block_of(replace(CONDITIONS, reverse=True))
    cosine, sine = (np.array([*pair, *TRUTH[2:]]) for pair in ((0.04, 0.0), (0.0, 0.04)))
    assert effect().contribution(back, cosine) == pytest.approx(effect().contribution(forward, cosine))
    assert effect().contribution(back, sine) == pytest.approx(-effect().contribution(forward, sine))


def test_sensor_on_the_middle_line_still_moves_along_the_belt() -> None:
    """The belt's vibration has a part along it, unlike the steady shape of an inextensible belt."""
    made = effect().contribution(block_of(), TRUTH)
    assert 0.01 < np.linalg.norm(made[CIRCUMFERENTIAL]) / np.linalg.norm(made[RADIAL]) < 0.5


def test_model_without_a_belt_has_no_excitation() -> None:
    block = replace(block_of(), belt=None)
    assert not effect().contribution(block, TRUTH).any()
    assert not effect().derivative(block, TRUTH).any()
    assert NAME in candidates(BaselineModel.EXACT)
    assert NAME not in candidates(BaselineModel.SERIES)
