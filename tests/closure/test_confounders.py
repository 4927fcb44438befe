"""Confounders: pairs that one condition does not distinguish and two do."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
import pytest

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.effects.effect import LATERAL, GroupConditions
from gateway.closure.inference.confounders import rivals_of
from gateway.closure.model.closure_model import AngleEffect
from tests.closure.planted_campaign import (
    ALL_AXES,
    BLOCKS,
    COLD_AND_WARM,
    ONE_SPEED,
    REVOLUTIONS,
    TWO_SPEEDS,
    WARM,
    Plant,
    Sideways,
    among,
    campaign_of,
    conditions,
    drift,
    fast_clock,
    fitted,
    gain,
    larger_belt,
    sideways,
    turned,
    with_lateral_means,
)

NOISY = 7.0
# Candidates for each pair: the two effects and some others.
SENSOR = among("gain", "gain-temperature drift", "zero-g offset", "pitch tilt", "clipping")
SIDE = among("roll tilt", "zero-g offset", "yaw tilt", "ply steer", "conicity", "gain")
SPEED = among("rolling radius", "sample clock error", "pitch tilt", "zero-g offset", "clipping")


def rivals(campaign: Campaign, name: str, effects: Mapping[str, AngleEffect]) -> tuple[str, ...]:
    fit, data = fitted(campaign, effects[name])
    assert fit.misfit < 1.05 * data.used
    return tuple(rivals_of(fit, effects[name], effects, data))


@pytest.mark.parametrize(
    ("plant", "name", "rival"), [(gain, "gain", "gain-temperature drift"), (drift, "gain-temperature drift", "gain")]
)
def test_gain_and_its_drift_need_two_temperatures(plant: Plant, name: str, rival: str) -> None:
    assert rivals(campaign_of(WARM, plant, noise_mps2=NOISY), name, SENSOR) == (rival,)
    assert rivals(campaign_of(COLD_AND_WARM, plant, noise_mps2=NOISY), name, SENSOR) == ()


@pytest.mark.parametrize(
    ("plant", "name", "rival"),
    [(turned(LATERAL, 0.004), "roll tilt", "zero-g offset"), (sideways(4.0), "zero-g offset", "roll tilt")],
)
def test_weak_tilt_and_offset_need_two_speeds(plant: Plant, name: str, rival: str) -> None:
    """An effect so weak that only the mean of the radial axis exceeds the noise."""
    assert rivals(campaign_of(ONE_SPEED, plant, noise_mps2=NOISY, axes=ALL_AXES), name, SIDE) == (rival,)
    assert rivals(campaign_of(TWO_SPEEDS, plant, noise_mps2=NOISY, axes=ALL_AXES), name, SIDE) == ()


class TestClock:
    @pytest.mark.parametrize("speeds", [ONE_SPEED, TWO_SPEEDS])
    def test_speed_does_not_separate_clock_from_radius(self, speeds: tuple[GroupConditions, ...]) -> None:
        for plant, name, rival in (
            (fast_clock, "sample clock error", "rolling radius"),
            (larger_belt, "rolling radius", "sample clock error"),
        ):
            assert rivals(campaign_of(speeds, plant), name, SPEED) == (rival,)

    def test_host_time_stamps_separate_clock_from_radius(self) -> None:
        for plant, name, measured in ((fast_clock, "sample clock error", 0.008), (larger_belt, "rolling radius", 0.0)):
            assert rivals(campaign_of(ONE_SPEED, plant, clock_error=(measured, 1e-6)), name, SPEED) == ()


class TestSynthetic:
    """On the lateral axis, of which the ring says nothing: what is left of one by the other is known beforehand."""

    STD = 1.0 / np.sqrt(REVOLUTIONS * BLOCKS)

    def alike(self, explained: float, bent: float, **of_rival: float) -> bool:
        """Return whether a rival turned by `bent` from the true one is alike; the noise has no part in either."""
        true, rival = Sideways("true"), Sideways("rival", bent=bent, **of_rival)
        size = np.sqrt(explained) * self.STD
        campaign = with_lateral_means(campaign_of(ONE_SPEED, axes=ALL_AXES), [size] * BLOCKS)
        fit, data = fitted(campaign, true)
        found = rivals_of(fit, true, {"true": true, "rival": rival}, data)
        assert set(found) <= {"rival"}
        return bool(found)

    @pytest.mark.parametrize(("left", "expected"), [(0.0, True), (8.0, True), (13.0, False), (100.0, False)])
    def test_confounder_threshold(self, left: float, expected: bool) -> None:
        explained = 400.0
        assert self.alike(explained, np.arcsin(np.sqrt(left / explained))) is expected

    def test_implausible_effect_is_no_confounder(self) -> None:
        assert self.alike(400.0, 0.0, high=1.2 * 20.0 * self.STD)
        assert not self.alike(400.0, 0.0, high=0.5 * 20.0 * self.STD)

    def test_effect_in_the_model_is_no_confounder(self) -> None:
        both = Sideways("constant"), Sideways("with speed", lambda c: (c.omega_radps / conditions().omega_radps) ** 2)
        third = Sideways("third")
        campaign = campaign_of(TWO_SPEEDS, sideways(2.0, lambda c: 1.0 + both[1].goes_with(c)), axes=ALL_AXES)
        fit, data = fitted(campaign, *both)
        effects = {effect.name: effect for effect in (*both, third)}
        assert set(rivals_of(fit, both[0], effects, data)) == {"third"}
        assert not rivals_of(fit, both[1], effects, data)
