"""Recordings that contradict the others, or a statement they have in common; a wrong rolling direction."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.errors import TreadlinkError
from gateway.core.types import FloatArray
from gateway.diagnosis.checks.outvoted_recordings import opposite_pair, unlike_contacts_of, unlike_loads, unlike_signals
from gateway.diagnosis.checks.recordings_apart import recordings_apart
from gateway.diagnosis.checks.rolling_direction import turned_round
from gateway.diagnosis.closed_loop import diagnose
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL, BaselineModel, GroupConditions
from gateway.diagnosis.model.baseline_registry import make_core
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Fitted
from gateway.diagnosis.views.phrases import why_undetermined
from tests.diagnosis.planted_campaign import (
    ALL_AXES,
    LOAD_N,
    TWO_SPEEDS,
    Plant,
    campaign_of,
    conditions,
    fitted,
    gain,
    larger_belt,
    nothing,
    ring,
    signal_of,
    turned,
)

SLOW = conditions(30.0).omega_radps


def overloaded(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """The slow recording has a fifth more load than is stated."""
    return (
        signal_of(replace(group_conditions, load_n=1.2 * LOAD_N))
        if group_conditions.omega_radps < 1.1 * SLOW
        else signal
    )


def humming(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """Waves behind the contact that nothing in the catalogue explains, at the faster speed only."""
    read = signal.copy()
    if group_conditions.omega_radps > 1.1 * SLOW:
        wave = 20.0 * np.exp(-np.square((theta - 0.6) / 0.3)) * np.cos(40.0 * theta)
        read[RADIAL] += wave
        read[CIRCUMFERENTIAL] += 0.4 * wave
    return read


@pytest.mark.parametrize("plant", [nothing, larger_belt, humming])
def test_one_tire_is_not_apart(plant: Plant) -> None:
    assert recordings_apart(campaign_of(TWO_SPEEDS, plant), make_core(BaselineModel.EXACT)) == []


def test_wrong_load_at_another_speed_is_apart() -> None:
    (apart,) = recordings_apart(campaign_of(TWO_SPEEDS, overloaded), make_core(BaselineModel.EXACT))
    # The numbers are over the stated load.
    assert (apart.low_recording, apart.high_recording) == (1, 0)
    assert apart.low.value == pytest.approx(apart.high.value / 1.2, rel=0.02)


def test_recordings_apart_determine_nothing() -> None:
    diagnosis = diagnose(campaign_of(TWO_SPEEDS, overloaded), expired=lambda: True)
    (note,) = [note for note in diagnosis.notes if note.code is DiagnosisCode.NUMBERS_CONTRADICT]
    assert (note["recording"], note["other"]) == ("run 2", "run 1")
    assert not any(diagnosis.determined.values())
    assert why_undetermined(diagnosis, ["Cw"]) == "the recordings contradict each other: see the notes"


SPEEDS = tuple(conditions(speed_kmh) for speed_kmh in (30.0, 45.0, 60.0, 75.0, 90.0))


def sideways(reversed_at: tuple[float, ...], size: float = 0.5) -> Plant:
    """Return a lateral axis that moves with the circumferential one, against it at some angular speeds."""

    def plant(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        sign = -1.0 if group_conditions.omega_radps in reversed_at else 1.0
        read[LATERAL] = sign * size * signal[CIRCUMFERENTIAL]
        return read

    return plant


def with_reversed(*numbers: int, count: int = 5, size: float = 0.5) -> Campaign:
    current = SPEEDS[:count]
    return campaign_of(current, sideways(tuple(current[number].omega_radps for number in numbers), size), axes=ALL_AXES)


@pytest.mark.parametrize(
    ("numbers", "count", "result"),
    [((), 5, []), ((2,), 5, [2]), ((0, 4), 5, [0, 4]), ((1,), 3, [1]), ((0, 1), 4, []), ((1,), 2, [])],
)
def test_a_reversed_lateral_axis_is_found_by_the_majority(numbers, count, result):
    unlike = unlike_signals(with_reversed(*numbers, count=count))
    assert sorted(unlike) == result
    for reason in unlike.values():
        assert reason.code is DiagnosisCode.LATERAL_OPPOSITE_TO_OTHERS
        assert reason["count"] == count - len(result)


@pytest.mark.parametrize(
    ("numbers", "count", "pair"),
    [((), 2, None), ((1,), 2, (0, 1)), ((0,), 2, (0, 1)), ((0, 1), 4, (0, 2)), ((1,), 3, None), ((2,), 5, None)],
)
def test_opposite_lateral_axes_without_a_majority_are_a_pair(numbers, count, pair):
    assert opposite_pair(with_reversed(*numbers, count=count)) == pair


def test_noise_on_the_lateral_axis_is_never_opposite():
    for seed in range(5):
        campaign = campaign_of(SPEEDS, sideways((), 0.0), axes=ALL_AXES, seed=seed)
        assert unlike_signals(campaign) == {}
        assert opposite_pair(campaign) is None
    assert opposite_pair(campaign_of(SPEEDS)) is None
    assert unlike_signals(campaign_of(SPEEDS)) == {}  # no lateral axis


def test_another_stated_radius_is_found_by_the_majority():
    def stated(radius_m: float, number: int) -> GroupConditions:
        return replace(SPEEDS[number], radius_m=radius_m)

    campaign = campaign_of(SPEEDS)
    groups = [
        replace(group, conditions=stated(0.34 if number == 3 else 0.31, number))
        for number, group in enumerate(campaign.groups)
    ]
    unlike = unlike_signals(replace(campaign, groups=tuple(groups)))
    assert list(unlike) == [3]
    assert (unlike[3].code, unlike[3]["count"]) == (DiagnosisCode.RADIUS_UNLIKE_OTHERS, 4)
    assert unlike_signals(replace(campaign, groups=tuple(groups[2:4]))) == {}


def test_another_contact_is_found_by_the_majority():
    campaign = campaign_of(tuple(conditions(60.0 + 0.1 * number) for number in range(4)))
    halves = (0.222, 0.224, 0.272, 0.223)
    groups = [replace(group, half_angle_rad=half) for group, half in zip(campaign.groups, halves, strict=True)]
    unlike = unlike_contacts_of(replace(campaign, groups=tuple(groups)))
    assert list(unlike) == [2]
    assert unlike[2]["angle_rad"] == 0.272
    assert unlike[2]["other_rad"] == 0.223
    assert unlike_contacts_of(replace(campaign, groups=tuple(groups[1:3]))) == {}


def width(value: float) -> Fitted:
    return Fitted(value, 0.002, quantity="Cw")


def test_another_load_is_found_by_the_majority():
    loads = (LOAD_N, LOAD_N, 5500.0, LOAD_N)
    campaign = campaign_of(tuple(conditions(60.0 + number, load_n=load) for number, load in enumerate(loads)))
    unlike = unlike_loads(campaign, {0: width(0.2), 1: width(0.25)})
    assert list(unlike) == [2]
    assert (unlike[2]["value"], unlike[2]["other"], unlike[2]["count"]) == (0.25, 0.2, 3)
    assert unlike_loads(campaign, {0: width(0.2), 1: width(0.203)}) == {}


def test_recordings_whose_load_is_assumed_have_no_vote():
    loads = (3500.0, 3500.0, LOAD_N, 5500.0, 5500.0)
    campaign = campaign_of(tuple(conditions(60.0 + number, load_n=load) for number, load in enumerate(loads)))
    assert list(unlike_loads(campaign, {0: width(0.2), 1: width(0.25)})) == [2]


def test_no_recording_is_outvoted_by_others_that_contradict_each_other():
    campaign = campaign_of(tuple(conditions(60.0, load_n=load_n) for load_n in (3500.0, 4500.0, 5500.0)))
    assert unlike_loads(campaign, dict(enumerate(map(width, (0.16, 0.2, 0.25))))) == {}


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
