"""Recordings that most others contradict are found; where there is no majority, none is."""

from dataclasses import replace

import pytest

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.effects.effect import CIRCUMFERENTIAL, LATERAL, GroupConditions
from gateway.closure.inference.outvoted_recordings import (
    opposite_pair,
    unlike_contacts_of,
    unlike_loads,
    unlike_signals,
)
from gateway.closure.result import Fitted, TireState
from gateway.reasons import Code
from gateway.types import FloatArray
from tests.closure.planted_campaign import ALL_AXES, LOAD_N, PRESSURE_PA, Plant, campaign_of, conditions

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
        assert reason.code is Code.LATERAL_OPPOSITE_TO_OTHERS
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
    assert (unlike[3].code, unlike[3]["count"]) == (Code.RADIUS_UNLIKE_OTHERS, 4)
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


def test_another_load_is_found_by_the_majority():
    loads = (LOAD_N, LOAD_N, 5500.0, LOAD_N)
    current = tuple(conditions(60.0 + number, load_n=load) for number, load in enumerate(loads))
    campaign = campaign_of(current)
    heavy = TireState(5500.0, PRESSURE_PA)

    def widths(value: float) -> dict[str, Fitted]:
        return {
            "Cw": Fitted(0.2, 0.002, quantity="Cw"),
            "Cw (5500 N, 220 kPa)": Fitted(value, 0.002, quantity="Cw", state=heavy),
        }

    unlike = unlike_loads(campaign, widths(0.25))
    assert list(unlike) == [2]
    assert (unlike[2]["value"], unlike[2]["other"], unlike[2]["count"]) == (0.25, 0.2, 3)
    assert unlike_loads(campaign, widths(0.203)) == {}
