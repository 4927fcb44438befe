"""Detection of a wrongly stated rolling direction."""

import math

import numpy as np
import pytest

from gateway.closure.closed_loop import diagnose
from gateway.closure.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions
from gateway.closure.inference.rolling_direction import turned_round
from gateway.errors import TreadlinkError
from gateway.types import FloatArray
from tests.closure.planted_campaign import (
    Plant,
    campaign_of,
    conditions,
    fitted,
    gain,
    nothing,
    ring,
    turned,
)

THREE = (conditions(60.0), conditions(40.0), conditions(60.0, load_n=5500.0))
BACKWARDS = conditions(40.0, reverse=True)


def offset(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """A sensor 5 mm below its stated depth: the belt's turning moves it along the circumference."""
    depth_m = 0.005
    wave = ring(group_conditions.load_n).sensor.radial_m
    slope = np.gradient(wave, 2.0 * math.pi / len(wave))
    read = signal.copy()
    read[CIRCUMFERENTIAL] -= group_conditions.omega_radps**2 * depth_m / group_conditions.radius_m * slope
    return read


def backwards(plant: Plant) -> Plant:
    def planted(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        read = plant(signal, theta, group_conditions)
        read[CIRCUMFERENTIAL] *= -1.0
        return read

    return planted


@pytest.mark.parametrize("plant", [nothing, gain, offset, turned(CIRCUMFERENTIAL, 0.1)])
@pytest.mark.parametrize("noise_mps2", [1.0, 5.0])
def test_only_reversal_flips_the_circumferential_axis(plant: Plant, noise_mps2: float) -> None:
    assert turned_round(*fitted(campaign_of(THREE, plant, noise_mps2=noise_mps2))) == []
    result = turned_round(*fitted(campaign_of(THREE, backwards(plant), noise_mps2=noise_mps2)))
    assert result == [0, 1, 2]


def test_one_reversed_recording_is_found() -> None:
    def second(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        return (backwards(nothing) if group_conditions.omega_radps == THREE[1].omega_radps else nothing)(
            signal, theta, group_conditions
        )

    assert turned_round(*fitted(campaign_of(THREE, second))) == [1]


def test_no_detection_without_circumferential_axis() -> None:
    assert turned_round(*fitted(campaign_of(THREE[:1], axes=(RADIAL,)))) == []


@pytest.mark.parametrize(
    ("group_conditions", "remedy"), [(THREE[0], "add --reverse run 1"), (BACKWARDS, "remove --reverse")]
)
def test_error_names_recording_and_remedy(group_conditions: GroupConditions, remedy: str) -> None:
    campaign = campaign_of((group_conditions,), backwards(nothing))
    with pytest.raises(TreadlinkError, match="opposite to that of a rolling tire in 'run 1'") as caught:
        diagnose(campaign)
    assert remedy in caught.value.remedy
