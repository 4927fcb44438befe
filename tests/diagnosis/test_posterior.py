"""Evidence of a set of effects, and the posterior over sets: probabilities, rivals that share one, and verdicts."""

import math
from collections.abc import Mapping
from functools import cache
from types import SimpleNamespace
from typing import Any, NoReturn, cast

import numpy as np
import pytest

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.angle.number_estimates import estimates_of
from gateway.diagnosis.angle.set_evidence import Evaluated, evaluate, evaluated_at, log_evidence, settled
from gateway.diagnosis.bayes.parameter_estimates import outside_range
from gateway.diagnosis.bayes.posterior import over
from gateway.diagnosis.effects.catalogue import candidates
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, LATERAL, RADIAL, BaselineModel, GroupConditions, Parameter
from gateway.diagnosis.model.baseline import NoShapeError
from gateway.diagnosis.model.baseline_registry import angle_effects
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.findings import beside_more, findings_of
from gateway.diagnosis.result import Finding, Verdict
from gateway.diagnosis.search.set_search import SetSearch
from gateway.diagnosis.search.tempered_posterior import Posterior
from tests.diagnosis.dense_covariance import covariance_of, joined
from tests.diagnosis.planted_campaign import (
    ALL_AXES,
    COLD_AND_WARM,
    ONE_SPEED,
    TWO_SPEEDS,
    WARM,
    Plant,
    Sideways,
    among,
    campaign_of,
    drift,
    evaluated,
    fast_clock,
    fitted,
    gain,
    larger_belt,
    searched,
    sideways,
    turned,
    wave,
)

NOISY = 7.0
SENSOR = among("gain", "gain-temperature drift", "zero-g offset", "pitch tilt", "clipping")
SIDE = among("roll tilt", "zero-g offset", "yaw tilt", "ply steer", "conicity", "gain")
SPEED = among("rolling radius", "sample clock error", "pitch tilt", "zero-g offset", "clipping")
TWINS = {"one": Sideways("one"), "other": Sideways("other")}


def same(first: Posterior, other: Posterior) -> bool:
    """Return whether two posteriors have the same sets, weights and parameters."""
    return (
        [each.names for each in first.sets] == [each.names for each in other.sets]
        and first.weights == other.weights
        and all(np.array_equal(a.fit.vector, b.fit.vector) for a, b in zip(first.sets, other.sets, strict=True))
    )


@cache
def of_twins() -> Posterior:
    """Return the posterior over two effects that are the same, one of which is present."""
    return searched(campaign_of(ONE_SPEED, sideways(3.0), axes=ALL_AXES), TWINS)[0]


@cache
def of_gain() -> Posterior:
    return searched(campaign_of(ONE_SPEED, gain, noise_mps2=NOISY), SENSOR)[0]


def test_probabilities_add_up() -> None:
    posterior, _ = searched(campaign_of(ONE_SPEED, sideways(1.0), axes=ALL_AXES), TWINS)
    assert sum(posterior.weights) == pytest.approx(1.0)
    assert sum(weight for _, weight in posterior.considered) == pytest.approx(1.0)
    alone = [posterior.probability([name]) for name in TWINS]
    both = sum(weight for item, weight in zip(posterior.sets, posterior.weights, strict=True) if len(item.names) == 2)
    assert posterior.probability(TWINS) == pytest.approx(sum(alone) - both)
    odds = posterior.log_odds("one")
    assert math.isfinite(odds)


def test_errors_of_an_effects_parameters_contain_the_choice_of_the_set() -> None:
    """With its twin in the set as well, an effect takes any share of what both explain."""
    posterior = of_twins()
    finding = next(finding for finding in findings_of(posterior, TWINS, {}) if finding.name == "one")
    (parameter,) = finding.parameters.values()

    def alone(evaluation: Evaluated) -> tuple[float, float]:
        position = evaluation.fit.model.layout.effect("one").start
        return float(evaluation.fit.vector[position]), float(evaluation.fit.covariance[position, position])

    value, variance = alone(posterior.every[frozenset({"one"})])
    both, wide = alone(posterior.every[frozenset(TWINS)])
    share = posterior.masses[frozenset(TWINS)] / (
        posterior.masses[frozenset(TWINS)] + posterior.masses[frozenset({"one"})]
    )
    assert parameter.value == value
    assert parameter.std**2 == pytest.approx((1.0 - share) * variance + share * (wide + (both - value) ** 2))
    assert parameter.std > 2.0 * math.sqrt(variance)


def test_indistinguishable_effects_are_reported_together() -> None:
    posterior = of_twins()
    assert posterior.identified() == ()
    assert [set(group) for group in posterior.alternatives()] == [{"one", "other"}]
    findings = findings_of(posterior, TWINS, {})
    assert [finding.verdict for finding in findings] == [Verdict.INDISTINGUISHABLE] * 2
    for finding in findings:
        (rival,) = finding.rivals
        assert {finding.name, rival} == {"one", "other"}
        assert finding.probability == pytest.approx(0.5, abs=0.05)
        # They are the same under all conditions.
        assert finding.decide_with == Reason(DiagnosisCode.RECORD_AGAIN, how="none_decides")


def test_groups_of_causes_do_not_count_what_is_no_cause() -> None:
    """Where a band without a law is likely, no effect of the catalogue is certain to be present."""
    posterior = of_twins()
    assert posterior.alternatives({"one", "other"}) == posterior.alternatives()
    assert posterior.alternatives({"one"}) == ()


@pytest.mark.parametrize("reverse", [False, True])
def test_order_of_candidates_does_not_matter(reverse: bool) -> None:
    names = sorted(SENSOR, reverse=reverse)
    again, _ = searched(campaign_of(ONE_SPEED, gain, noise_mps2=NOISY), {name: SENSOR[name] for name in names})
    assert same(of_gain(), again)


def test_impossible_set_has_no_weight() -> None:
    """Its finding says which value is out of range."""
    effects = {"small": Sideways("small", high=1.0)}
    posterior, search = searched(campaign_of(ONE_SPEED, sideways(3.0), axes=ALL_AXES), effects)
    assert frozenset(["small"]) in search.evaluations
    assert posterior.probability(["small"]) == 0.0
    assert posterior.best.names == frozenset()
    (finding,) = findings_of(posterior, effects, {})
    assert (finding.verdict, finding.probability) == (Verdict.REFUSED, 0.0)
    assert finding.reason is not None
    assert finding.reason.code is DiagnosisCode.IMPLAUSIBLE_PARAMETER


def test_no_name_rests_on_impossible_sets() -> None:
    """An impossible filter, and waves that mend what it leaves."""
    objection = (("filter", Reason(DiagnosisCode.IMPLAUSIBLE_PARAMETER)),)
    sets = [
        SimpleNamespace(names=frozenset(names), log_evidence=log_evidence, objections=objections)
        for names, log_evidence, objections in (
            ((), 0.0, ()),
            (("waves",), -2.0, ()),
            (("filter",), 100.0, objection),
            (("filter", "waves"), 120.0, objection),
        )
    ]
    posterior = over({effect_set.names: effect_set for effect_set in sets})
    assert posterior.identified() == ()
    assert posterior.best.names == frozenset()
    assert posterior.probability(["waves"]) == pytest.approx(1.0 / (1.0 + math.exp(2.0)))
    # Nor is an effect named that impossible sets have no need for.
    sets[1].log_evidence = 50.0
    sets[2].log_evidence = 120.0
    posterior = over({effect_set.names: effect_set for effect_set in sets})
    assert posterior.probability(["waves"]) == pytest.approx(0.5)


def test_evidence_counts_less_beside_a_large_unexplained_part() -> None:
    """A pattern that no effect describes has five times the power of the noise of the mean."""
    effects = {"small": Sideways("small")}

    strange = wave(LATERAL, lambda theta: 6.0 * np.cos(17.0 * theta + np.sin(theta)))
    alone, search = searched(campaign_of(ONE_SPEED, sideways(1.3), axes=ALL_AXES), effects)
    assert alone.identified() == ("small",)
    assert max(alone.temperatures) < 1.1
    beside, _ = searched(campaign_of(ONE_SPEED, strange, axes=ALL_AXES), effects)
    # 18 (m/s^2)^2 on 111 orders of 0.01 each.
    assert beside.temperatures == pytest.approx((1.0, math.sqrt(1.0 + 18.0 / 1.11)), rel=0.05)
    doubted = at_temperatures(search, *beside.temperatures)
    assert doubted.identified() == ()
    assert doubted.log_odds("small") < 0.5 * alone.log_odds("small")
    # What is left of the wheel's plane does not count.
    assert at_temperatures(search, 1e9, 1.0).identified() == ("small",)
    # The prior odds stay.
    assert at_temperatures(search, 1e9, 1e9).probability(["small"]) == pytest.approx(0.05, abs=0.002)


def at_temperatures(search: SetSearch, plane: float, lateral: float) -> Posterior:
    """Return the posterior with the evidence of plane and lateral axis divided by these."""
    return over({names: item.tempered(plane, lateral) for names, item in search.evaluations.items()})


@cache
def beside_strange(size_mps2: float) -> tuple[Evaluated, Whitened]:
    """Return the set of a lateral offset of this size beside a wave of another kind."""

    def strange(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        read = sideways(size_mps2)(signal, theta, conditions)
        read[LATERAL] += 6.0 * np.cos(17.0 * theta)
        return read

    return evaluated(campaign_of(ONE_SPEED, strange, axes=ALL_AXES), Sideways("small"))


@pytest.mark.parametrize(("size_mps2", "named"), [(3.0, False), (6.0, True)])
def test_effect_smaller_than_what_is_left_is_not_identified(size_mps2: float, named: bool) -> None:
    """Beside 4.2 m/s^2 of another kind, 3 m/s^2 may be the error of any equation."""
    evaluation, data = beside_strange(size_mps2)
    (result,) = beside_more([Finding("small", Verdict.NAMED, {}, 100.0, size_mps2)], evaluation.fit, data)
    assert (result.verdict is Verdict.NAMED) == named
    if result.reason is not None:
        assert result.reason.code is DiagnosisCode.SMALLER_THAN_LEFT
        assert result.reason["left_mps2"] == pytest.approx(6.0 / math.sqrt(2.0), rel=0.02)
        assert result.reason["size_mps2"] == pytest.approx(size_mps2, rel=0.1)


def test_effect_without_which_the_ring_has_no_shape_is_not_too_small(monkeypatch: pytest.MonkeyPatch) -> None:
    evaluation, data = beside_strange(3.0)

    def unsolved(model: ClosureModel, vector: FloatArray, index: int) -> NoReturn:
        raise NoShapeError

    monkeypatch.setattr(ClosureModel, "predict_mean", unsolved)
    named = Finding("small", Verdict.NAMED, {}, 100.0, math.nan)
    assert beside_more([named], evaluation.fit, data) == [named]


def test_small_effect_at_the_noise_may_be_identified() -> None:
    evaluation, data = evaluated(campaign_of(ONE_SPEED, sideways(0.05), axes=ALL_AXES), Sideways("small"))
    named = Finding("small", Verdict.NAMED, {}, 100.0, 0.05)
    assert beside_more([named], evaluation.fit, data) == [named]


def test_weak_effect_is_refused_with_its_probability() -> None:
    effects = {"weak": Sideways("weak")}
    # Some four standard errors of the mean.
    posterior, _ = searched(campaign_of(ONE_SPEED, sideways(0.5), axes=ALL_AXES), effects)
    probability = posterior.probability(["weak"])
    assert criteria.LISTED < probability < criteria.NAMED
    (finding,) = findings_of(posterior, effects, {})
    assert finding.verdict is Verdict.REFUSED
    assert finding.reason == Reason(DiagnosisCode.PROBABILITY_TOO_LOW, probability=probability, needed=criteria.NAMED)
    assert finding.parameters["size_mps2"].value == pytest.approx(0.5, abs=3.0 * finding.parameters["size_mps2"].std)


def outcome(
    groups: tuple[GroupConditions, ...], plant: Plant, effects: Mapping[str, AngleEffect], **of: object
) -> object:
    """Return the identified effects and the groups of rivals."""
    posterior, _ = searched(campaign_of(groups, plant, **of), effects)  # type: ignore[arg-type]
    return posterior.identified(), [set(group) for group in posterior.alternatives()]


@pytest.mark.parametrize(("plant", "name"), [(gain, "gain"), (drift, "gain-temperature drift")])
def test_gain_and_its_drift_need_two_temperatures(plant: Plant, name: str) -> None:
    assert outcome(WARM, plant, SENSOR, noise_mps2=NOISY) == ((), [{"gain", "gain-temperature drift"}])
    assert outcome(COLD_AND_WARM, plant, SENSOR, noise_mps2=0.5 * NOISY) == ((name,), [])


@pytest.mark.parametrize(
    ("plant", "name"),
    [(turned(LATERAL, 0.008), "roll tilt"), pytest.param(sideways(8.0), "zero-g offset", marks=pytest.mark.slow)],
)
def test_tilt_and_offset_are_separated_by_two_speeds(plant: Plant, name: str) -> None:
    assert outcome(TWO_SPEEDS, plant, SIDE, noise_mps2=NOISY, axes=ALL_AXES) == ((name,), [])


@pytest.mark.parametrize("plant", [fast_clock, pytest.param(larger_belt, marks=pytest.mark.slow)])
def test_speed_does_not_separate_clock_from_radius(plant: Plant) -> None:
    result = outcome(TWO_SPEEDS, plant, SPEED)
    assert result == ((), [{"sample clock error", "rolling radius"}])


@pytest.mark.parametrize(
    ("plant", "name", "measured"), [(fast_clock, "sample clock error", 0.008), (larger_belt, "rolling radius", 0.0)]
)
def test_host_time_stamps_separate_clock_from_radius(plant: Plant, name: str, measured: float) -> None:
    assert outcome(ONE_SPEED, plant, SPEED, clock_error=(measured, 1e-6)) == ((name,), [])


@pytest.mark.slow
def test_undisturbed_ring_lacks_only_model_terms() -> None:
    model = BaselineModel.PAPER
    lacking = {"gravity", "belt kinematics (n^2-1)", "pressure shape", "geometric tension loss"}
    every = angle_effects(candidates(model))
    effects = {name: every[name] for name in (*lacking, "gain", "mounting offset", "clipping")}
    posterior, search = searched(campaign_of(TWO_SPEEDS, noise_mps2=1.5), effects, model)
    assert set(posterior.identified()) == lacking
    assert posterior.best.fit.misfit < 1.15 * search.data.size


@pytest.mark.parametrize(("log_evidence", "doubted"), [(20.0, True), (2.0, False)])
def test_most_probable_impossible_set_casts_doubt_on_numbers(log_evidence: float, doubted: bool) -> None:
    reason = Reason(DiagnosisCode.LEAVES_MORE_THAN_WITHOUT, with_it=1.0, without=1.0)
    none = Evaluated(frozenset(), cast(Any, None), 0.0)
    beyond = Evaluated(frozenset("a"), cast(Any, None), log_evidence, (("a", reason),))
    posterior = over({item.names: item for item in (none, beyond)})
    assert posterior.best is none
    assert posterior.impossible is (beyond if doubted else None)


@pytest.mark.parametrize("groups", [ONE_SPEED, TWO_SPEEDS], ids=["one speed", "two speeds"])
def test_evidence_equals_exact_gaussian(groups: tuple[object, ...]) -> None:
    """The linearised model's evidence is that of a normal distribution with all parameters integrated out."""
    speeds = ONE_SPEED if len(groups) == 1 else TWO_SPEEDS
    evaluation, data = evaluated(campaign_of(speeds, sideways(2.0), axes=ALL_AXES), Sideways("constant"))
    fit = evaluation.fit
    assert fit.applied is not None
    rows = joined(data, fit.rows)
    spread = covariance_of(fit.applied, data) + rows.T @ np.linalg.solve(fit.prior_precision, rows)
    residual = joined(data, fit.residual)[0] + (fit.vector - fit.prior_mean) @ rows
    _, log_determinant = np.linalg.slogdet(spread)
    exact = -0.5 * (float(residual @ np.linalg.solve(spread, residual)) + float(log_determinant))
    assert log_evidence(fit) == pytest.approx(exact + math.log(criteria.PRIOR_ODDS), abs=0.02)


def test_evidence_needs_a_discrepancy() -> None:
    fit, _ = fitted(campaign_of(ONE_SPEED))
    with pytest.raises(ValueError, match="discrepancy"):
        log_evidence(fit)


def test_set_without_a_shape_keeps_estimates_and_its_objection() -> None:
    """An optimum may lie at a compliance below zero, at which no ring has a shape."""
    evaluation, _ = evaluated(campaign_of(ONE_SPEED), *among("shear flexibility").values())
    change = np.zeros(len(evaluation.fit.vector))
    change[evaluation.fit.model.layout.effect("shear flexibility")] = -1e-3
    result = evaluated_at(evaluation.fit.moved(change))
    assert [name for name, _ in result.objections] == ["shear flexibility"]
    estimates, _ = estimates_of([(result.fit, 1.0)])
    assert estimates["Bs"].value == pytest.approx(2.6e-3, rel=0.2)


def test_settled_set_does_not_depend_on_the_way_there() -> None:
    """A kink that no effect describes; one discrepancy begins as the residual suggests, one a thousand times larger."""

    kinked = wave([CIRCUMFERENTIAL, RADIAL], lambda theta: 30.0 * np.exp(-np.square((theta - 0.5) / 0.2)))
    evaluation, data = evaluated(campaign_of(ONE_SPEED, kinked))
    applied = evaluation.fit.applied
    assert applied is not None
    larger = applied.discrepancy.applied(1e3 * applied.amplitudes)
    other = evaluate(evaluation.fit, data, applied.discrepancy, larger)
    std = np.sqrt(np.diagonal(evaluation.fit.covariance))

    def apart(first: Evaluated, second: Evaluated) -> float:
        return float((np.abs(first.fit.vector - second.fit.vector) / std).max())

    before, after = apart(evaluation, other), apart(settled(evaluation, data), settled(other, data))
    assert after < 0.1
    assert before > 2.0 * after


def test_absent_effect_costs_its_odds_and_its_width() -> None:
    campaign = campaign_of(ONE_SPEED, axes=ALL_AXES)
    without, _ = evaluated(campaign)
    beside, _ = evaluated(campaign, Sideways("constant"))
    where = beside.fit.model.layout.effect("constant")
    std = float(np.sqrt(beside.fit.covariance[where, where][0, 0]))
    pull = float(beside.fit.vector[where][0]) / std
    prior = Sideways("constant").parameters[0].prior_std
    expected = math.log(criteria.PRIOR_ODDS) + math.log(std / prior) + 0.5 * pull**2
    assert beside.log_evidence - without.log_evidence == pytest.approx(expected, abs=0.3)


@pytest.mark.parametrize("size_mps2", [0.0, 0.02, 5.0])
def test_evidence_of_several_prior_widths_is_their_mean(size_mps2: float) -> None:
    campaign = campaign_of(ONE_SPEED, sideways(size_mps2), axes=ALL_AXES)
    mixed, _ = evaluated(campaign, Sideways("constant", prior_stds=(50.0, 0.0, 0.1)))
    # Under the same discrepancy, since each set would choose its own.
    fits = [evaluated(campaign, Sideways("constant", prior_stds=(std,)))[0].fit for std in (50.0, 1e-6, 0.1)]
    settled = [fit.under(mixed.fit.applied) for fit in fits]
    each = [log_evidence(fit.moved(fit.step)) for fit in settled]
    assert mixed.log_evidence == pytest.approx(float(np.logaddexp.reduce(each)) - math.log(3.0), abs=0.02)


@pytest.mark.parametrize(("high", "possible"), [(2.4, True), (1.6, False)])
def test_value_beyond_its_range_is_impossible(high: float, possible: bool) -> None:
    evaluation, _ = evaluated(campaign_of(ONE_SPEED, sideways(2.0), axes=ALL_AXES), Sideways("constant", high=high))
    results = [(name, reason.code) for name, reason in evaluation.objections]
    assert results == ([] if possible else [("constant", DiagnosisCode.IMPLAUSIBLE_PARAMETER)])


def test_range_is_reported_in_display_units() -> None:
    parameter = Parameter("offset_m", "m", -0.01, 0.012, 0.005, 1e-6, factor=1e3, display_unit="mm")
    reason = outside_range(parameter, 0.02)
    assert (reason["value"], reason["low"], reason["high"], reason["unit"]) == (20.0, -10.0, 12.0, "mm")
