"""Trends: the last revolution of each second, in shown units, for ten minutes."""

import dataclasses
import math

import pytest

from gateway.estimators.estimator import Estimate, Status
from gateway.reasons import Code, Reason
from gateway.views.trend_history import SPAN_S, TrendHistory

START_S = 1_700_000_000


def result_at(result, at_s, speed_mps=20.0, status=Status.VALID, position="FL"):
    estimates = (
        Estimate("speed_mps", speed_mps, 0.1, status)
        if status is not Status.INVALID
        else Estimate.invalid("speed_mps", Reason(Code.NEEDS_LOAD)),
        Estimate("Rs", 3.0, math.nan, Status.PROVISIONAL),
        Estimate("vehicle_speed_age_s", 0.1, 0.0, Status.VALID),
    )
    host_ns = round((START_S + at_s) * 1e9)
    return dataclasses.replace(result, host_ns=host_ns, estimates=estimates, position=position)


@pytest.fixture
def history():
    return TrendHistory()


def test_last_revolution_of_each_second_in_shown_units(history, made) -> None:
    for at_s, speed_mps in [(0.1, 10.0), (0.9, 11.0), (1.2, 12.0), (2.5, 13.0)]:
        history.add(result_at(made.result(), at_s, speed_mps))
    points = history.points("FL", "speed_mps")
    assert [point.at_s - START_S for point in points] == [0, 1, 2]
    assert [point.value for point in points] == pytest.approx([39.6, 43.2, 46.8], rel=1e-6)
    assert [point.std for point in points] == pytest.approx([0.36] * 3, rel=1e-6)
    assert {point.status for point in points} == {Status.VALID}
    assert {point.status for point in history.points("FL", "Rs")} == {Status.PROVISIONAL}
    assert [point.at_s - START_S for point in history.points("FL", "speed_mps", START_S + 1)] == [1, 2]


def test_invalid_value_and_unknown_names_have_no_point(history, made) -> None:
    for at_s, status in enumerate([Status.VALID, Status.INVALID, Status.INVALID]):
        history.add(result_at(made.result(), at_s, status=status))
    assert [point.at_s - START_S for point in history.points("FL", "speed_mps")] == [0]
    assert history.points("FL", "nothing") == history.points("nowhere", "speed_mps") == []


def test_old_points_end_and_quantities_have_words(history, made) -> None:
    for at_s in range(SPAN_S + 100):
        history.add(result_at(made.result(), at_s))
    points = history.points("FL", "speed_mps")
    assert points[-1].at_s - points[0].at_s == SPAN_S
    quantities = {quantity.name: quantity for quantity in history.quantities()}
    assert list(quantities) == ["speed_mps", "Rs", "pressure_pa", "temperature_degc"]
    assert quantities["speed_mps"][1:] == ("speed", "km/h", "rolling speed")
    assert history.points("FL", "pressure_pa")[-1].value == pytest.approx(210.0)
