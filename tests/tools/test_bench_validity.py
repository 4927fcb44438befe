"""The validity bench judges by the truth, and repeats itself."""

import math
import sys
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from validity.bench import Order, ToldRun, judge_tire, size_of, told_runs
from validity.cases import CASES, named
from validity.judging import Judged
from validity.left_out import add_counts, count_left_out, left_out_table
from validity.summary import share, well_table
from validity.tires import draw_world

from gateway.estimators.doubt_rules import DoubtRule

QUICK = ("kinematic", "weak-form")


def order_of(tire: int) -> Order:
    return Order(1, tire, ("radius",), QUICK)


@pytest.fixture(scope="module")
def told() -> list[ToldRun]:
    return [run for tire in (0, 1) for run in told_runs(order_of(tire))]


@pytest.fixture(scope="module")
def judged(told: list[ToldRun]) -> list[Judged]:
    return [item for run in told for item in run.judged()]


def test_misstated_radius_is_judged_by_the_true_one(judged: list[Judged]) -> None:
    case = named(["radius"])[0]
    for tire in (0, 1):
        speeds = [item for item in judged if item.tire == tire and item.quantity == "speed_mps"]
        assert len(speeds) > 40
        for speed in speeds:
            assert speed.truth == pytest.approx(draw_world(1, tire).speed_kmh / 3.6, rel=1e-9)
            assert speed.value / speed.truth == pytest.approx(1.0 + 0.01 * size_of(case, tire), rel=2e-3)


def test_same_seed_gives_same_judgement(judged: list[Judged]) -> None:
    again = judge_tire(order_of(0))
    first = [item for item in judged if item.tire == 0]
    assert [repr(item) for item in again] == [repr(item) for item in first]


def test_every_estimate_of_the_estimators_is_judged(judged: list[Judged]) -> None:
    assert {item.estimator for item in judged} == set(QUICK)
    last = [item for item in judged if item.last and item.estimator == "weak-form"]
    assert {item.quantity for item in last} == {"Bs", "Cw", "Rs", "Ts", "Bs/Cw", "Rs/Cw", "Ts/Cw"}
    assert all(math.isfinite(item.truth) for item in last)


def test_rule_left_out_makes_falsely_valid_what_it_doubts(told: list[ToldRun]) -> None:
    """A radius that the steady value alone contradicts."""
    counts = count_left_out(told[-1:], (DoubtRule.STEADY_VALUE, DoubtRule.GRAVITY))
    assert counts["none"].false["one"] == 0
    assert counts["none"].still_valid == counts["none"].valid
    without, other = counts[DoubtRule.STEADY_VALUE], counts[DoubtRule.GRAVITY]
    assert without.false["one"] > 40
    assert without.still_valid["one"] < without.valid["one"]
    assert other.false == counts["none"].false
    twice = add_counts(counts, counts)
    assert twice[DoubtRule.STEADY_VALUE].false["one"] == 2 * without.false["one"]
    rows = {row[0]: row for row in left_out_table(twice).rows}
    assert float(rows["steady value"][1]) > float(rows["none"][1])


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
