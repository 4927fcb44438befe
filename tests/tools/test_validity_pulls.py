"""Pulls: statements drawn from their errors, and what the tables make of them."""

import math
from dataclasses import replace

import numpy as np
import pytest
from validity.bench import Order, judge_tire
from validity.draws import draw_all
from validity.judging import Judged
from validity.pulls import Ordinary, never_table, ordinary_table, pull_table, pulls_of
from validity.statements import draw_statement
from validity.tires import draw_world

from gateway.planner.uncertainty_budget import SOURCES


def entry(case: str, tire: int, error: float, **changes: object) -> Judged:
    value, std, scatter, truth = 10.0 + error, 1.0, 0.1, 10.0
    run = (case, "true", 0.0, tire, "car", 9, True, "kinematic", "speed_mps")
    return replace(Judged(*run, value, std, scatter, truth, "valid", True, ()), **changes)


def test_every_statement_is_drawn_from_its_own_error() -> None:
    world = draw_world(1, 0)
    said = draw_statement(world, np.random.default_rng(0))
    drawn = [draw_all(world, said, 0.0, np.random.default_rng(seed)) for seed in range(60)]
    radius = np.array([each.radius_mm for _, each in drawn]) / (1e3 * world.radius_m) - 1.0
    lateral = np.array([each.gain_error[1] - each.gain_error[2] for each, _ in drawn])
    # Every second one states 0.3 or 1 %, the others leave it at 1 %.
    assert 0.003 < radius.std() < 0.013
    assert lateral.std() == pytest.approx(0.06, rel=0.3)
    setup = said.vehicle(world).wheel_setups()[0]
    names = {source.name for source in SOURCES if source.stated(setup) is not None}
    assert names >= {"load", "pressure", "belt radius", "sampling rate", "linearity", "temperature of the new tire"}


def test_pulls_of_stated_and_of_scattering_parts() -> None:
    judged = [entry("drawn", tire, 2.0 * (-1.0) ** tire) for tire in range(10)]
    judged += [entry("drawn", 11, 50.0, status="invalid"), entry("drawn", 12, 50.0, last=False)]
    # Drives of one tire scatter by 0.2 about an error of 3 that they share.
    for tire in range(10):
        judged += [entry("known", tire, 3.0 + error) for error in (-0.2, 0.0, 0.2)]
    (of,) = pulls_of(judged).values()
    assert of.judged == 11
    assert of.drawn == pytest.approx([2.0 * (-1.0) ** tire for tire in range(10)])
    assert of.scattering == pytest.approx([4.0] * 10)
    (row,) = pull_table({"speed_mps": of}).rows
    assert row == ("speed_mps", "10 of 11", "2.00", "narrow", "2.80", "2.00", "10 %")


def test_a_drawn_tire_is_judged_with_its_scatter() -> None:
    judged = judge_tire(Order(3, 0, ("drawn", "known"), ("kinematic", "weak-form")))
    last = {(each.case, each.quantity): each for each in judged if each.last}
    speed = last["drawn", "angular_speed_radps"]
    assert 0.0 < speed.scatter < speed.std
    assert abs(speed.pull) < 5.0
    assert math.isclose(last["known", "Cw"].truth, last["drawn", "Cw"].truth, rel_tol=0.02)


def test_ordinary_tables_count_and_say_why() -> None:
    often = Ordinary(4, 3, [2.0, 4.0, 9.0])
    never = Ordinary(4)
    never.reasons.update(["it needs two speeds"] * 3 + ["other"])
    drives = {"lab": {"speed_mps": often, "gain": never}}
    assert ordinary_table(drives).rows == (("speed_mps", "75 (4)"), ("gain", "0"))
    assert never_table(drives).rows == (("gain", "it needs two speeds"),)
