"""The validity bench judges by the truth, and repeats itself."""

import math
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from validity.bench import Order, judge_tire, size_of
from validity.cases import CASES, named
from validity.judging import Judged
from validity.summary import share, well_table
from validity.tires import draw_world

QUICK = ("kinematic", "weak-form")


def judged_of(tire: int) -> list[Judged]:
    return judge_tire(Order(1, tire, ("radius",), QUICK))


@pytest.fixture(scope="module")
def judged() -> list[Judged]:
    return [one for tire in (0, 1) for one in judged_of(tire)]


def test_misstated_radius_is_judged_by_the_true_one(judged: list[Judged]) -> None:
    case = named(["radius"])[0]
    for tire in (0, 1):
        speeds = [one for one in judged if one.tire == tire and one.quantity == "speed_mps"]
        assert len(speeds) > 40
        for one in speeds:
            assert one.truth == pytest.approx(draw_world(1, tire).speed_kmh / 3.6, rel=1e-9)
            assert one.value / one.truth == pytest.approx(1.0 + 0.01 * size_of(case, tire), rel=2e-3)


def test_same_seed_gives_same_judgement(judged: list[Judged]) -> None:
    again = judged_of(0)
    first = [one for one in judged if one.tire == 0]
    assert [repr(one) for one in again] == [repr(one) for one in first]


def test_every_estimate_of_the_estimators_is_judged(judged: list[Judged]) -> None:
    assert {one.estimator for one in judged} == set(QUICK)
    last = [one for one in judged if one.last and one.estimator == "weak-form"]
    assert {one.quantity for one in last} == {"Bs", "Cw", "Rs", "Ts", "Bs/Cw", "Rs/Cw", "Ts/Cw"}
    assert all(math.isfinite(one.truth) for one in last)


def test_share_counts_false_and_missing_estimates() -> None:
    right = Judged("plain", "true", 0.0, 0, "car", 40, True, "weak-form", "Bs", 1.1, 0.1, 1.0, "valid", True, ())
    wrong = replace(right, value=1.5)
    missing = replace(right, value=math.nan, std=math.nan, status="invalid")
    found = share([right, wrong, missing, replace(missing, determinable=False)])
    assert (found.judged, found.valid, found.falsely_valid) == (4, 2, 1)
    assert (found.able, found.falsely_invalid) == (3, 1)
    assert found.largest == pytest.approx(5.0)
    assert replace(right, std=0.0).falsely_valid
    assert well_table([right, wrong, missing]).rows


def test_cases_have_their_own_names() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert sum(case.well for case in CASES) == 4


def test_referee_has_tires_of_other_sizes_and_is_right_where_all_is_true() -> None:
    """Finite elements with friction, through the same chain."""
    found = judge_tire(Order(1, 9, ("known",), QUICK, refereed=True))
    valid = [one for one in found if one.valid]
    assert {one.kind for one in found} == {"motorcycle"}
    assert len(valid) > 0.8 * len(found)
    assert not any(one.falsely_valid for one in valid)
