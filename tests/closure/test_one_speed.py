"""An order that is seen at one speed only may be a frequency."""

from __future__ import annotations

import pytest

from gateway.closure.diagnosis import Finding, Verdict
from gateway.closure.one_speed import doubted, is_one_speed
from tests.closure.planted_campaign import ONE_SPEED, TWO_SPEEDS, among, campaign_of


def found(name: str) -> Finding:
    return Finding(name, Verdict.NAMED, {}, 1e4, 1e4, 1e2, 3.0)


@pytest.mark.parametrize("name", ["tire-locked edge waves", "tread pitch", "torsional ripple"])
def test_where_much_is_left_an_order_at_one_speed_is_left_open(name: str) -> None:
    named = [found(name), found("mounting offset")]
    effects = list(among(name, "mounting offset").values())
    open_, offset = doubted(named, effects, campaign_of(ONE_SPEED), 3.3)
    assert open_.verdict is Verdict.INDISTINGUISHABLE
    assert "frequency" in open_.rivals[0]
    assert "speed would decide" in open_.decide_with
    assert "3.3 times the noise" in open_.reason
    assert offset == named[1]
    assert doubted(named, effects, campaign_of(ONE_SPEED), 1.2) == named
    assert doubted(named, effects, campaign_of(TWO_SPEEDS), 3.3) == named


def test_speeds_a_tenth_apart_are_two() -> None:
    assert is_one_speed(campaign_of(ONE_SPEED))
    assert not is_one_speed(campaign_of(TWO_SPEEDS))
