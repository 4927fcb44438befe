"""Search over sets of effects: steps, other optima of a set, and effects that explain nothing beside a large rest."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.candidate_trial import Trial, refit, shapes_of, try_effect
from gateway.diagnosis.angle.fit import Fit, FitFailedError, linearised
from gateway.diagnosis.angle.set_evidence import Evaluated, settled
from gateway.diagnosis.bayes.posterior import ByPart
from gateway.diagnosis.closed_loop import other_optimum_notes
from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.effects.effect import LATERAL, BaselineModel, GroupConditions
from gateway.diagnosis.model.baseline import Shape
from gateway.diagnosis.model.baseline_registry import angle_effects
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.findings import findings_of
from gateway.diagnosis.search import candidate_scan, set_search, tempered_posterior
from gateway.diagnosis.search.candidate_scan import Scan
from gateway.diagnosis.search.other_optima import other_optima
from gateway.diagnosis.search.rival_effects import is_taken, rivals_of
from gateway.diagnosis.search.set_search import SetSearch, baseline_fit
from gateway.diagnosis.search.tempered_posterior import doubted_sets
from tests.diagnosis.planted_campaign import (
    ALL_AXES,
    ONE_SPEED,
    TWO_SPEEDS,
    Plant,
    Sideways,
    WavePacket,
    among,
    campaign_of,
    fitted,
    gain,
    searched,
    turned,
    wave,
)


def angle_effect(name: str) -> AngleEffect:
    return angle_effects(catalogue())[name]


def test_small_tilt_has_a_realistic_trial() -> None:
    angle_rad = 5e-5
    campaign = campaign_of(TWO_SPEEDS, turned(LATERAL, angle_rad), noise_mps2=0.05, axes=ALL_AXES)
    fit, data = fitted(campaign)
    trial = try_effect(fit, angle_effect("roll tilt"), shapes_of(fit, range(len(campaign.groups))))
    assert trial is not None
    assert trial.vector[trial.model.layout.effect("roll tilt")] == pytest.approx(angle_rad, rel=0.1)
    # The full fit confirms the trial.
    after = refit(trial, data)
    assert trial.cost * fit.scale == pytest.approx(after.cost * after.scale, abs=5.0)
    assert trial.promise > 10.0


def test_a_shape_far_from_the_usual_one_is_fitted_anew_from_there() -> None:
    effect = WavePacket()
    campaign = campaign_of(ONE_SPEED, packet(4.0, 1.1), noise_mps2=0.3, axes=ALL_AXES)
    fit, data = fitted(campaign)
    trial = try_effect(fit, effect, shapes_of(fit, [0]))
    assert trial is not None
    stuck = refit(trial, data)
    assert stuck.vector[stuck.model.layout.effect(effect.name)][1] == pytest.approx(1.8, abs=0.1)
    posterior, _ = searched(campaign, {effect.name: effect})
    fit = posterior.best.fit
    assert fit.vector[fit.model.layout.effect(effect.name)] == pytest.approx([4.0, 1.1], rel=0.02)


def test_trial_beside_an_impossible_belt_fails_alone() -> None:
    """A fit may have left the belt a compliance below zero, at which no ring has a shape."""
    campaign = campaign_of(ONE_SPEED)
    extension = angle_effect("belt extension")
    fit, _ = fitted(campaign, extension)
    vector = fit.vector.copy()
    vector[fit.model.layout.effect("belt extension")] = -1e-3
    beyond = replace(fit, vector=vector)
    assert not Scan(beyond, [angle_effect(name) for name in ("shear flexibility", "gain")], [0]).trials()


def tilt_and_gain(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
    return turned(LATERAL, 0.03)(gain(signal, theta, conditions), theta, conditions)


def test_two_effects_are_found_together() -> None:
    effects = among("roll tilt", "gain", "pitch tilt", "zero-g offset")
    posterior, search = searched(campaign_of(ONE_SPEED, tilt_and_gain, axes=ALL_AXES), effects)
    assert posterior.best.names == {"roll tilt", "gain"}
    assert set(posterior.identified()) == {"roll tilt", "gain"}
    assert posterior.best.names == search.best.names
    assert frozenset() in search.evaluations
    assert search.complete


def test_a_chain_ends_where_three_sets_in_a_row_bring_no_evidence(monkeypatch: pytest.MonkeyPatch) -> None:
    """Five waves around the lateral axis are no effect of these; a fit takes one more all the same."""

    five_waves = wave(LATERAL, lambda theta: 10.0 * np.cos(5.0 * theta))
    effects: dict[str, AngleEffect] = {name: Sideways(name) for name in "abcdefgh"}

    def one_more(search: SetSearch, fit: Fit) -> list[Fit]:
        taken = len(fit.model.effects)
        model = ClosureModel(search.campaign, search.core, (*fit.model.effects, effects["abcdefgh"[taken]]))
        return [linearised(model, search.data, fit.model.layout.moved(fit.vector, model.layout))]

    monkeypatch.setattr(SetSearch, "_fitted", one_more)
    posterior, search = searched(campaign_of(ONE_SPEED, five_waves, noise_mps2=0.3, axes=ALL_AXES), effects)
    assert search.complete
    assert posterior.best.names == frozenset()
    assert max(map(len, search.evaluations)) == 1 + criteria.STALLED


def test_few_sets_hold_the_inverse_of_their_covariance() -> None:
    """It takes megabytes a set."""
    effects = among("roll tilt", "gain", "pitch tilt", "zero-g offset")
    _, search = searched(campaign_of(ONE_SPEED, tilt_and_gain, axes=ALL_AXES), effects)
    applied = [
        evaluation.fit.applied for evaluation in search.evaluations.values() if evaluation.fit.applied is not None
    ]
    assert len(applied) >= 8
    assert sum("inverses" in vars(item) for item in applied) <= 4
    # It is worked out again where it is needed.
    first = next(item for item in applied if "inverses" not in vars(item))
    again = first.discrepancy.applied(first.amplitudes)
    assert sum(inverse.log_determinant for inverse in first.inverses) == again.log_determinant


def test_known_set_is_fitted_again_from_a_better_optimum() -> None:
    """A set stuck far from its optimum would give its credit to an effect that merely leads out of it."""
    campaign = campaign_of(ONE_SPEED, tilt_and_gain, axes=ALL_AXES)
    posterior, search = searched(campaign, among("roll tilt", "gain"))
    assert posterior.best.names == {"roll tilt", "gain"}
    alone = frozenset(["gain"])
    stuck = search.evaluations[alone]
    search.evaluations[alone] = replace(stuck, log_evidence=stuck.log_evidence - 50.0)
    search.run(baseline_fit(campaign, search.core, search.data))
    assert search.evaluations[alone].log_evidence == pytest.approx(stuck.log_evidence, abs=0.5)


def test_known_set_stays_where_another_fit_of_it_fails(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise FitFailedError("no step makes it better")

    campaign = campaign_of(ONE_SPEED, tilt_and_gain, axes=ALL_AXES)
    _, search = searched(campaign, among("roll tilt", "gain"))
    reference = dict(search.evaluations)
    monkeypatch.setattr(set_search, "evaluate", fail)
    search.run(baseline_fit(campaign, search.core, search.data))
    assert search.evaluations == reference
    assert not search.rejected & set(reference)


def test_effects_without_a_chance_at_noise_are_not_tried_again(monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[str] = []
    plain = candidate_scan.try_effect

    def counted(fit: Fit, effect: AngleEffect, shapes: Mapping[int, Shape]) -> Trial | None:
        tried.append(effect.name)
        return plain(fit, effect, shapes)

    monkeypatch.setattr(candidate_scan, "try_effect", counted)
    effects = among("roll tilt", "gain", "pitch tilt", "tread pitch")
    campaign = campaign_of(ONE_SPEED, tilt_and_gain, axes=ALL_AXES)
    posterior, _ = searched(campaign, effects)
    fewer = len(tried)
    tried.clear()
    monkeypatch.setattr(SetSearch, "_additions", lambda search, *_: list(search.effects))
    every, _ = searched(campaign, effects)
    assert fewer < len(tried)
    assert posterior.best.names == every.best.names == {"roll tilt", "gain"}
    assert posterior.weights == every.weights


@pytest.mark.parametrize("answers", [0, 3])
def test_expired_search_returns_what_is_known(answers: int) -> None:
    asked = itertools.count()
    effects = among("roll tilt", "gain")
    posterior, search = searched(
        campaign_of(ONE_SPEED, tilt_and_gain, axes=ALL_AXES), effects, expired=lambda: next(asked) >= answers
    )
    assert not search.complete
    assert posterior.best.names in search.evaluations
    assert sum(posterior.weights) == pytest.approx(1.0)
    assert posterior.baseline.names == frozenset()


def test_rivals_are_those_of_what_an_effect_adds_to_its_set() -> None:
    """A zero-g offset stands for a pitch tilt until that is found; then camber can do what is left for it."""
    promises = [{"pitch tilt": 640.0, "zero-g offset": 636.0, "camber": 139.0, "gain": -4.0}]
    effects = ("pitch tilt", "zero-g offset", "camber", "gain", "never tried")
    alone = rivals_of("zero-g offset", 600.0, effects, promises)
    assert alone == ["pitch tilt", "zero-g offset", "never tried"]
    assert rivals_of("zero-g offset", 15.0, effects, promises) == [*alone[:2], "camber", "never tried"]


def test_form_of_one_effect_excludes_the_other() -> None:
    standing, travelling = angle_effect("tire-locked edge waves"), angle_effect("travelling edge waves")
    assert is_taken(travelling, [standing])
    assert is_taken(standing, [travelling])
    assert not is_taken(angle_effect("gain"), [standing, travelling])


def test_scan_order_does_not_depend_on_the_catalogue() -> None:
    effects: dict[str, AngleEffect] = {name: Sideways(name) for name in ("b", "a", "c")}
    campaign = campaign_of(ONE_SPEED, axes=ALL_AXES)
    first, _ = searched(campaign, effects)
    again, _ = searched(campaign, dict(reversed(effects.items())))
    assert first.weights == again.weights
    assert [effect_set.names for effect_set in first.sets] == [effect_set.names for effect_set in again.sets]


@pytest.mark.parametrize(("curvature", "may_be"), [(0.003, True), (-0.0003, True), (-0.007, False), (-0.5, True)])
def test_hollow_road_is_an_inner_drum(curvature: float, may_be: bool) -> None:
    effect = angle_effect("drum curvature")
    assert (effect.reason_against(np.array([curvature]), np.array([2e-4])) is None) is may_be


@pytest.mark.parametrize(("decay", "may_be"), [(4.0, True), (20.0, False)])
def test_wave_has_at_least_one_wavelength(decay: float, may_be: bool) -> None:
    effect = angle_effect("tire-locked edge waves")
    values = np.array([0.1, 0.1, 60.0, decay, 0.1, 0.1, 52.0, 1.4])
    assert (effect.reason_against(values, np.full(8, 0.01)) is None) is may_be
    # A wave that is indistinguishable from zero cannot be wrong.
    assert effect.reason_against(values, np.full(8, 0.1)) is None


def test_an_expired_search_tries_no_further_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    campaign = campaign_of(ONE_SPEED, turned(LATERAL, 0.03), axes=ALL_AXES)
    tried: list[str] = []

    def counted(fit: object, effect: AngleEffect, shapes: object) -> None:
        tried.append(effect.name)

    monkeypatch.setattr("gateway.diagnosis.search.candidate_scan.try_effect", counted)
    effects = among("roll tilt", "pitch tilt", "gain")
    _, search = searched(campaign, effects, expired=lambda: True)
    assert tried == []
    assert not search.complete
    assert list(search.evaluations) == [frozenset()]
    # The time runs out while single effects are tried.
    _, search = searched(campaign, effects, expired=lambda: len(tried) >= 1)
    assert len(tried) == 1
    assert not search.complete


def test_sets_that_count_as_alike_beside_much_that_is_left_are_not_climbed(monkeypatch: pytest.MonkeyPatch) -> None:
    """What is left of the plane has 20 times the rms of the noise: 10 of log evidence count as half of one."""
    _, search = searched(campaign_of(ONE_SPEED, axes=ALL_AXES), {})
    (start,) = search.evaluations.values()
    higher, highest = (replace(start, log_evidence=start.log_evidence + gain) for gain in (10.0, 30.0))
    lateral = replace(higher, lateral=start.lateral + 10.0)
    monkeypatch.setattr(set_search, "ratios_by_part", lambda *_: ByPart(400.0, 1.0))
    assert not search._is_worth_climbing(higher, [start])
    assert search._is_worth_climbing(highest, [start])
    assert search._is_worth_climbing(lateral, [start])
    monkeypatch.setattr(set_search, "ratios_by_part", lambda *_: ByPart(3.9, 1.0))
    assert search._is_worth_climbing(higher, [start])


def test_a_set_leads_only_by_the_evidence_that_it_has_at_rest(monkeypatch: pytest.MonkeyPatch) -> None:
    """The set without the tilt says that it is the best, as one does whose last step promised what is not there."""
    _, search = searched(campaign_of(ONE_SPEED, tilt_and_gain, axes=ALL_AXES), among("roll tilt", "gain"))
    best, alone = search.best, search.evaluations[frozenset(["gain"])]
    search.evaluations[alone.names] = replace(alone, log_evidence=best.log_evidence + 2.0)
    monkeypatch.setattr(SetSearch, "_at_noise", lambda *_: False)
    leaders = []
    monkeypatch.setattr(SetSearch, "_neighbours", lambda _, leader: leaders.append(leader.names))
    search._climb()
    assert leaders[0] == search.best.names == best.names
    assert search.evaluations[alone.names].log_evidence < best.log_evidence - 50.0


PERIOD_RAD = math.tau / 9.0
STARTS_RAD = (0.3, 1.0, 1.7)


def packet(size_mps2: float, place_rad: float) -> Plant:
    return wave(LATERAL, lambda theta: size_mps2 * WavePacket.packet(theta - place_rad)[0])


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
    assert (note.code, note["effect"], note["parameter"]) == (DiagnosisCode.OTHER_OPTIMUM, effect.name, "place_rad")
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


def judged(
    monkeypatch: pytest.MonkeyPatch, ratios: Mapping[str, tuple[float, ...]]
) -> tuple[dict[str, list[str]], ByPart]:
    """Return the effects objected to in each set, and the temperatures.

    Args:
        monkeypatch: of the test.
        ratios: of sets, effects as letters, their log evidence and the power that they leave over that of the noise in
            the wheel's plane and, where it is not that of noise, on the lateral axis.
    """
    sets = {frozenset(names): Evaluated(frozenset(names), cast(Any, names), ratios[names][0]) for names in ratios}

    monkeypatch.setattr(tempered_posterior, "ratios_by_part", lambda fit, data: ByPart(*ratios[fit][1:]))
    result, temperatures = doubted_sets(sets, cast(Any, None))
    assert all(
        reason.code is DiagnosisCode.LEAVES_MORE_THAN_WITHOUT
        for item in result.values()
        for _, reason in item.objections
    )
    return {names: [name for name, _ in result[frozenset(names)].objections] for names in ratios}, temperatures


def test_effect_that_moves_the_fit_away_does_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """The evidence is for a and b together; without a, less is left."""
    objected, temperatures = judged(monkeypatch, {"": (0.0, 400.0), "b": (50.0, 16.0), "ab": (90.0, 40.0)})
    assert objected == {"": [], "b": [], "ab": ["a"]}
    assert temperatures == pytest.approx((4.0, 1.0))


def test_set_that_leaves_half_replaces_as_many_effects(monkeypatch: pytest.MonkeyPatch) -> None:
    objected, _ = judged(monkeypatch, {"": (0.0, 400.0), "ac": (90.0, 40.0), "bc": (50.0, 18.0)})
    assert objected["ac"] == ["a"]
    # Of two that leave about as much, neither replaces the other.
    objected, _ = judged(monkeypatch, {"": (0.0, 400.0), "ac": (90.0, 40.0), "bc": (50.0, 30.0)})
    assert objected["ac"] == []


def test_effects_at_the_noise_are_not_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    objected, temperatures = judged(monkeypatch, {"": (0.0, 1.2), "a": (9.0, 1.3)})
    assert objected["a"] == []
    assert temperatures == pytest.approx((1.3**0.5, 1.0))


def test_effect_on_one_part_is_not_doubted_for_what_is_left_of_the_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """`l` explains the lateral axis; its set leaves a little more of the plane, which it does not move."""
    sets = {"": (0.0, 400.0, 49.0), "l": (90.0, 401.0, 1.1), "p": (60.0, 200.0, 49.0), "pl": (95.0, 201.0, 1.1)}
    objected, temperatures = judged(monkeypatch, sets)
    assert objected == {"": [], "l": [], "p": [], "pl": []}
    assert temperatures == pytest.approx((201.0**0.5, 1.1**0.5))


def test_effect_whose_rival_leaves_half_of_its_part_is_doubted(monkeypatch: pytest.MonkeyPatch) -> None:
    """What both leave of the lateral axis is the same but for noise."""
    objected, _ = judged(monkeypatch, {"": (0.0, 400.0, 1.1), "a": (90.0, 40.0, 1.05), "b": (50.0, 16.0, 1.1)})
    assert objected["a"] == ["a"]
    objected, _ = judged(monkeypatch, {"": (0.0, 400.0, 9.0), "a": (90.0, 40.0, 1.05), "b": (50.0, 16.0, 9.0)})
    assert objected["a"] == []


def test_search_says_what_could_take_the_place_of_an_effect_and_was_not_tried() -> None:
    names = ("roll tilt", "ply steer", "zero-g offset", "camber")
    _, search = searched(campaign_of(TWO_SPEEDS, turned(LATERAL, 0.03), axes=ALL_AXES), among(*names))
    assert search.best.names == {"roll tilt"}
    assert search.untried == ()
    assert search.untried_rivals("roll tilt") == ()
    # As if its time had ended with the first set.
    search.promises.clear()
    search.evaluations = {of: each for of, each in search.evaluations.items() if of <= {"roll tilt"}}
    assert set(search.untried) == {*names} - {"roll tilt"}
    assert set(search.untried_rivals("roll tilt")) == {*names} - {"roll tilt"}


def test_an_effect_may_be_one_too_many_where_the_set_without_it_was_not_tried() -> None:
    """The time of the search ended after a chain."""
    unknown: Any = None
    core: Any = SimpleNamespace(model=BaselineModel.EXACT)
    effects = {name: Sideways(name) for name in "abc"}
    search = SetSearch(unknown, core, unknown, effects, unknown)
    search.promises = {frozenset(): dict.fromkeys("abc", 0.0)}
    for names, log_evidence in (("", 0.0), ("a", 50.0), ("ab", 90.0), ("abc", 120.0)):
        search.evaluations[frozenset(names)] = Evaluated(frozenset(names), unknown, log_evidence)
    assert [search.untried_rivals(name) for name in "abc"] == [("b", "c"), ("a", "c"), ()]
    search.evaluations[frozenset("bc")] = search.evaluations[frozenset()]
    search.rejected.add(frozenset("ac"))
    assert [search.untried_rivals(name) for name in "abc"] == [(), (), ()]
