"""Other optima of a set: a packet of waves that fits nearly as well a period off."""

import math

import numpy as np
import pytest

from gateway.closure.closed_loop import other_optimum_notes
from gateway.closure.effects.effect import LATERAL, GroupConditions
from gateway.closure.inference.findings import findings_of
from gateway.closure.inference.other_optima import other_optima
from gateway.closure.inference.set_evidence import Evaluated, settled
from gateway.reasons import Code
from gateway.types import FloatArray
from tests.closure.planted_campaign import ALL_AXES, ONE_SPEED, Plant, WavePacket, campaign_of, searched

PERIOD_RAD = math.tau / 9.0
STARTS_RAD = (0.3, 1.0, 1.7)


def packet(size_mps2: float, place_rad: float) -> Plant:
    def plant(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[LATERAL] += size_mps2 * WavePacket.packet(theta - place_rad)[0]
        return read

    return plant


def place_of(evaluation: Evaluated) -> float:
    return float(evaluation.fit.vector[evaluation.fit.model.layout.effect("wave packet")][1])


@pytest.mark.parametrize("starts_rad", [STARTS_RAD, STARTS_RAD[::-1]])
def test_a_weak_packet_may_be_a_period_off(starts_rad: tuple[float, ...]) -> None:
    effect = WavePacket(*starts_rad)
    campaign = campaign_of(ONE_SPEED, packet(1.3, 1.1), noise_mps2=1.0, axes=ALL_AXES)
    posterior, _ = searched(campaign, {effect.name: effect})
    ((other,),) = posterior.optima.values()
    best = posterior.best
    assert abs(place_of(other) - place_of(best)) == pytest.approx(PERIOD_RAD, rel=0.02)
    # Each optimum has the weight of its evidence, and the error of the place contains their distance.
    weights = {place_of(item): weight for item, weight in posterior.considered if effect.name in item.names}
    odds = math.exp(other.log_evidence - best.log_evidence)
    assert weights[place_of(other)] / weights[place_of(best)] == pytest.approx(odds, rel=1e-6)
    assert sum(weight for _, weight in posterior.considered) == pytest.approx(1.0)
    (finding,) = findings_of(posterior, {effect.name: effect}, {})
    position = finding.parameters["place_rad"]
    local_std = math.sqrt(best.fit.covariance[best.fit.model.layout.effect(effect.name)][-1, -1])
    assert position.value == pytest.approx(place_of(best))
    (note,) = other_optimum_notes(posterior)
    assert (note.code, note["effect"], note["parameter"]) == (Code.OTHER_OPTIMUM, effect.name, "place_rad")
    assert (note["best"], note["value"]) == (pytest.approx(place_of(best)), pytest.approx(place_of(other)))
    assert position.std == pytest.approx(math.hypot(local_std, PERIOD_RAD * math.sqrt(odds / (1.0 + odds))), rel=0.05)


def test_a_strong_packet_has_one_place() -> None:
    effect = WavePacket(*STARTS_RAD)
    campaign = campaign_of(ONE_SPEED, packet(4.0, 1.1), noise_mps2=0.3, axes=ALL_AXES)
    posterior, _ = searched(campaign, {effect.name: effect})
    assert posterior.optima == {effect.name: ()}
    assert not list(other_optimum_notes(posterior))
    assert place_of(posterior.best) == pytest.approx(1.1, rel=0.02)


def test_the_better_optimum_is_found_from_the_worse_one() -> None:
    effect = WavePacket(*STARTS_RAD)
    campaign = campaign_of(ONE_SPEED, packet(1.3, 1.1), noise_mps2=1.0, axes=ALL_AXES)
    posterior, search = searched(campaign, {effect.name: effect})
    ((worse,),) = search.optima.values()
    bare = posterior.baseline.fit.under(worse.fit.applied)
    first, *_ = other_optima(worse, bare, effect, (0,))
    assert first.log_evidence == pytest.approx(search.best.log_evidence, abs=0.1)
    assert place_of(first) == pytest.approx(place_of(posterior.best), abs=0.01)


def test_an_effect_of_one_start_has_one_optimum() -> None:
    effect = WavePacket(1.0)
    campaign = campaign_of(ONE_SPEED, packet(1.3, 1.1), noise_mps2=1.0, axes=ALL_AXES)
    posterior, _ = searched(campaign, {effect.name: effect})
    assert not other_optima(posterior.best, posterior.baseline.fit, effect, (0,))


def test_optima_beside_much_that_is_left_are_those_of_the_best_set() -> None:
    """Sets come to rest before optima are sought, and another may then be the best."""
    effect = WavePacket(*STARTS_RAD)

    def beside(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        read = packet(4.0, 1.1)(signal, theta, conditions)
        read[LATERAL] += 10.0 * np.cos(17.0 * theta + 3.0 * np.sin(theta))
        return read

    posterior, search = searched(campaign_of(ONE_SPEED, beside, noise_mps2=0.3, axes=ALL_AXES), {effect.name: effect})
    assert max(posterior.temperatures) > 10.0
    assert set(search.optima) == set(search.best.names)
    best = search.best
    std = np.sqrt(np.diagonal(best.fit.covariance))
    assert float((np.abs(settled(best, search.data).fit.vector - best.fit.vector) / std).max()) < 0.03
