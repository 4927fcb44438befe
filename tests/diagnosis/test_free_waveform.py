"""Effects beside the strongest single unknown: a waveform of any shape that no effect of the catalogue has."""

import math

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.set_evidence import Evaluated
from gateway.diagnosis.bayes.posterior import ByPart
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, GroupConditions
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.free_waveform import beside_unknown
from gateway.diagnosis.result import Finding, Verdict
from tests.diagnosis.planted_campaign import Plant, among, campaign_of, evaluated, signal_of
from tests.diagnosis.test_one_size import DEPTH_M, SPEEDS, of_depth, turned
from tests.diagnosis.test_sensor_depth import at_depth

DELAY = "circumferential delay"
DELAY_S = 120e-6
REFERENCE = SPEEDS[2]
"""Speed at which an unknown is what a delay would be."""


def fixed_in_time(signal: FloatArray, theta: FloatArray, group_conditions: GroupConditions) -> FloatArray:
    """Read what a delay adds at one speed, at the same times at every speed, growing with the square of it."""
    read = at_depth(DEPTH_M)(signal, theta, group_conditions).copy()
    plain = signal_of(REFERENCE)
    added = turned(0.0, DELAY_S)(plain, theta, REFERENCE) - at_depth(DEPTH_M)(plain, theta, REFERENCE)
    ratio = group_conditions.omega_radps / REFERENCE.omega_radps
    there = np.clip(theta / ratio, -math.pi, math.pi)
    window = np.exp(-0.5 * (there / 0.8) ** 4)
    read[CIRCUMFERENTIAL] += ratio**2 * window * np.interp(there, theta, added[CIRCUMFERENTIAL])
    return read


def sets_of(plant: Plant, name: str) -> tuple[Evaluated, Evaluated, float]:
    """Return the sets with and without an effect, and the logarithm of its odds."""
    campaign = of_depth(campaign_of(SPEEDS, plant))
    inside, without = evaluated(campaign, *among(name).values())[0], evaluated(campaign)[0]
    return inside, without, inside.log_evidence - without.log_evidence


def judged(plant: Plant, name: str, plane: float = 1.0) -> Finding:
    inside, without, log_odds = sets_of(plant, name)
    finding = Finding(name, Verdict.NAMED, {}, 100.0, 1.0, log_odds=log_odds)
    (result,) = beside_unknown([finding], inside.fit, {name: without.fit}, ByPart(plane))
    return result


def test_effect_that_stands_for_a_waveform_fixed_in_time_is_rejected() -> None:
    *_, log_odds = sets_of(fixed_in_time, DELAY)
    assert log_odds > math.log(criteria.NAMED / (1.0 - criteria.NAMED))
    finding = judged(fixed_in_time, DELAY)
    assert finding.verdict is Verdict.REFUSED
    assert finding.reason is not None
    assert finding.reason.code is DiagnosisCode.TAKEN_BY_UNKNOWN


@pytest.mark.parametrize(
    ("plant", "name"), [(turned(0.0, DELAY_S), DELAY), (turned(0.016, 0.0), "circumferential shift")]
)
def test_true_effect_keeps_its_odds_beside_any_waveform(plant: Plant, name: str) -> None:
    assert judged(plant, name).verdict is Verdict.NAMED


def test_unknown_counts_less_where_much_is_left() -> None:
    """What takes the odds is divided as the odds are."""
    assert judged(fixed_in_time, DELAY, plane=100.0).verdict is Verdict.NAMED


def test_one_speed_and_one_load_know_no_such_waveform() -> None:
    campaign = of_depth(campaign_of((REFERENCE,) * 3, turned(0.0, DELAY_S)))
    inside, without = evaluated(campaign, *among(DELAY).values())[0], evaluated(campaign)[0]
    finding = Finding(DELAY, Verdict.NAMED, {}, 100.0, 1.0, log_odds=0.0)
    assert beside_unknown([finding], inside.fit, {DELAY: without.fit}, ByPart()) == [finding]
