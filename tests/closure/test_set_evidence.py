"""Evidence of a set of effects: the exact Gaussian evidence, prior odds, impossible values."""

import math

import numpy as np
import pytest

from gateway.closure.effects.effect import CIRCUMFERENTIAL, RADIAL, GroupConditions, Parameter
from gateway.closure.inference import criteria
from gateway.closure.inference.number_estimates import estimates_of
from gateway.closure.inference.parameter_range import outside_range
from gateway.closure.inference.set_evidence import Evaluated, evaluate, evaluated_at, log_evidence, settled
from gateway.reasons import Code
from gateway.types import FloatArray
from tests.closure.dense_covariance import covariance_of, joined
from tests.closure.planted_campaign import (
    ALL_AXES,
    ONE_SPEED,
    TWO_SPEEDS,
    Sideways,
    among,
    campaign_of,
    evaluated,
    fitted,
    sideways,
)


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

    def kinked(signal: FloatArray, theta: FloatArray, conditions: GroupConditions) -> FloatArray:
        read = signal.copy()
        read[[CIRCUMFERENTIAL, RADIAL]] += 30.0 * np.exp(-np.square((theta - 0.5) / 0.2))
        return read

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
    assert results == ([] if possible else [("constant", Code.IMPLAUSIBLE_PARAMETER)])


def test_range_is_reported_in_display_units() -> None:
    parameter = Parameter("offset_m", "m", -0.01, 0.012, 0.005, 1e-6, factor=1e3, display_unit="mm")
    reason = outside_range(parameter, 0.02)
    assert (reason["value"], reason["low"], reason["high"], reason["unit"]) == (20.0, -10.0, 12.0, "mm")
