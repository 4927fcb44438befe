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
    return [item for tire in (0, 1) for item in judged_of(tire)]


def test_misstated_radius_is_judged_by_the_true_one(judged: list[Judged]) -> None:
    case = named(["radius"])[0]
    for tire in (0, 1):
        speeds = [item for item in judged if item.tire == tire and item.quantity == "speed_mps"]
        assert len(speeds) > 40
        for speed in speeds:
            assert speed.truth == pytest.approx(draw_world(1, tire).speed_kmh / 3.6, rel=1e-9)
            assert speed.value / speed.truth == pytest.approx(1.0 + 0.01 * size_of(case, tire), rel=2e-3)


def test_same_seed_gives_same_judgement(judged: list[Judged]) -> None:
    again = judged_of(0)
    first = [item for item in judged if item.tire == 0]
    assert [repr(item) for item in again] == [repr(item) for item in first]


def test_every_estimate_of_the_estimators_is_judged(judged: list[Judged]) -> None:
    assert {item.estimator for item in judged} == set(QUICK)
    last = [item for item in judged if item.last and item.estimator == "weak-form"]
    assert {item.quantity for item in last} == {"Bs", "Cw", "Rs", "Ts", "Bs/Cw", "Rs/Cw", "Ts/Cw"}
    assert all(math.isfinite(item.truth) for item in last)


def test_share_counts_false_and_missing_estimates() -> None:
    right = Judged("plain", "true", 0.0, 0, "car", 40, True, "weak-form", "Bs", 1.1, 0.1, 1.0, "valid", True, ())
    wrong = replace(right, value=1.5)
    missing = replace(right, value=math.nan, std=math.nan, status="invalid")
    result = share([right, wrong, missing, replace(missing, determinable=False)])
    assert (result.judged, result.valid, result.falsely_valid) == (4, 2, 1)
    assert (result.able, result.falsely_invalid) == (3, 1)
    assert result.largest == pytest.approx(5.0)
    assert replace(right, std=0.0).falsely_valid
    assert well_table([right, wrong, missing]).rows


def test_cases_have_their_own_names() -> None:
    names = [case.name for case in CASES]
    assert len(set(names)) == len(names)
    assert sum(case.well for case in CASES) == 4


def test_referee_has_tires_of_other_sizes_and_is_right_where_all_is_true() -> None:
    """Finite elements with friction, through the same chain."""
    result = judge_tire(Order(1, 9, ("known",), QUICK, refereed=True))
    valid = [item for item in result if item.valid]
    assert {item.kind for item in result} == {"motorcycle"}
    assert len(valid) > 0.8 * len(result)
    assert not any(item.falsely_valid for item in valid)
