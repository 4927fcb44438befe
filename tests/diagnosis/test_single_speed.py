"""Effects with an order at one speed."""

import pytest

from gateway.core.reasons import Reason
from gateway.diagnosis.checks.single_speed import FIXED_FREQUENCY, doubted, is_one_speed
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Finding, Verdict
from tests.diagnosis.planted_campaign import ONE_SPEED, TWO_SPEEDS, among, campaign_of


def finding_of(name: str) -> Finding:
    return Finding(name, Verdict.NAMED, {}, 1e4, 1e4, 1e2, 3.0)


@pytest.mark.parametrize("name", ["tire-locked edge waves", "tread pitch", "torsional ripple"])
def test_order_at_one_speed_is_undecided(name: str) -> None:
    named = [finding_of(name), finding_of("mounting offset")]
    effects = list(among(name, "mounting offset").values())
    open_, offset = doubted(named, effects, campaign_of(ONE_SPEED), 3.3)
    assert open_.verdict is Verdict.INDISTINGUISHABLE
    assert open_.rivals == (FIXED_FREQUENCY,)
    assert open_.decide_with == Reason(DiagnosisCode.RECORD_AGAIN, how="ratio", quantity="speed", ratio=1.5)
    assert open_.reason == Reason(DiagnosisCode.ORDER_OR_FREQUENCY, noise_floors=3.3)
    assert offset == named[1]
    assert doubted(named, effects, campaign_of(ONE_SPEED), 1.2) == named
    assert doubted(named, effects, campaign_of(TWO_SPEEDS), 3.3) == named


def test_speeds_ten_percent_apart_are_two() -> None:
    assert is_one_speed(campaign_of(ONE_SPEED))
    assert not is_one_speed(campaign_of(TWO_SPEEDS))
