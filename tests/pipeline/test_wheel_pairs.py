"""Left and right wheels that slip to one side, or to opposite ones."""

from dataclasses import replace
from itertools import chain

import numpy as np
import pytest

from gateway.estimators.estimator import Estimate, Status, TireConditions
from gateway.pipeline.results import RevolutionResult
from gateway.pipeline.wheel_pairs import WheelPairs
from gateway.quantity_catalogue import declared
from gateway.reasons import Code
from tests.testkit.exact_ring import solution
from tests.testkit.revolution_data import exact_wave, make_revolution

REVOLUTION = make_revolution(exact_wave(solution()))
(OF_AXLE,) = (quantity.name for quantity in declared() if quantity.is_of_axle)


def results(position: str, directions: list[float], late_s: float = 0.0) -> list[RevolutionResult]:
    """Return a revolution of each direction, one after the other."""
    return [
        RevolutionResult(
            position,
            round(1e9 * ((index + 1) * REVOLUTION.period_s + late_s)),
            REVOLUTION,
            TireConditions(0.32),
            (Estimate(OF_AXLE, direction, float("nan"), Status.PROVISIONAL),),
        )
        for index, direction in enumerate(directions)
    ]


def alarms(*taken: RevolutionResult) -> dict[str, Code]:
    pairs = WheelPairs()
    for result in taken:
        pairs.take(result)
    return {alarm.position: alarm.reason.code for alarm in pairs.alarms()}


TURNS = [1.0, 1.0, 1.0, 0.0, 0.0, -1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0]
BACK = [-turn for turn in TURNS]


@pytest.mark.parametrize(("left", "right"), [("FL", "FR"), ("rear.left", "rear.right")])
def test_opposite_slip_is_an_alarm_at_both_wheels(front_left: str, right: str) -> None:
    opposite = dict.fromkeys((front_left, right), Code.LATERAL_SLIP_APART)
    assert alarms(*results(front_left, TURNS), *results(right, BACK, 0.01)) == opposite
    assert alarms(*results(front_left, TURNS), *results(right, TURNS, 0.01)) == {}


def test_order_of_the_revolutions_does_not_matter() -> None:
    remainder, right = results("FL", TURNS), results("FR", BACK, 0.02)
    alternating = list(chain.from_iterable(zip(remainder, right, strict=True)))
    assert alarms(*alternating) == alarms(*right, *remainder) == alarms(*remainder, *right) != {}


def test_few_revolutions_or_another_axle_say_nothing() -> None:
    assert alarms(*results("FL", TURNS[:7]), *results("FR", BACK[:7])) == {}
    assert alarms(*results("FL", TURNS), *results("RR", BACK)) == {}
    # At another time.
    assert alarms(*results("FL", TURNS), *results("FR", BACK, 100.0)) == {}


def test_revolutions_without_host_times_say_nothing() -> None:
    remainder, right = (
        [replace(result, host_ns=0) for result in results(*item)] for item in (("FL", [1.0] * 12), ("FR", [-1.0] * 12))
    )
    assert alarms(*remainder, *right) == {}


def test_wheels_that_slip_by_chance_say_nothing() -> None:
    rng = np.random.default_rng(1)
    remainder, right = (rng.choice([-1.0, 1.0], 200).tolist() for _ in range(2))
    assert alarms(*results("FL", remainder), *results("FR", right)) == {}
