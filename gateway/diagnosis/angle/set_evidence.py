"""Log evidence of a set of effects: Laplace's approximation at its fit, discrepancy in the covariance."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.candidate_trial import bounds
from gateway.diagnosis.angle.discrepancy import Applied, Discrepancy
from gateway.diagnosis.angle.fit import Fit, FitFailedError, fit_model
from gateway.diagnosis.angle.likelihood import Whitened
from gateway.diagnosis.bayes.parameter_estimates import beyond_range
from gateway.diagnosis.effects.effect import LATERAL, GroupConditions
from gateway.diagnosis.model.baseline import NoShapeError
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel

# Precision of the data over that of the prior below which they say nothing about a parameter.
_NO_DATA: Final = 1e-9
# Most steps of the amplitudes, those that show their limit, and the change of log evidence at which they end.
_STEPS: Final = 15
_STEPS_TO_LIMIT: Final = 2
_LOG_TOLERANCE: Final = 0.03
# Most rounds until all rest, the change of a parameter over its error at which it does, that of log evidence at which
# the amplitudes do, and the rounds of no higher evidence after which no rest is to come.
_MAX_ROUNDS: Final = 20
_CONVERGED_CHANGE: Final = 0.02
_AMPLITUDE_TOLERANCE: Final = 1e-3
_MAX_FALLS: Final = 3
# Steps of the parameters with the discrepancy in: it moves them by little. Most rounds of them, for those that it moves
# by more, and the predicted decrease of the cost up to which the last step is taken without a fit.
_FIT_STEPS: Final = 6
_FIT_ROUNDS: Final = 3
_UNTAKEN_DECREASE: Final = 0.5


@dataclass(frozen=True)
class Evaluated:
    """A set of effects with its evidence.

    Attributes:
        names: of the effects.
        fit: with the discrepancy in the covariance, at the optimum of its linearisation.
        log_evidence: of the data, up to a constant of the data; prior odds of the set included.
        objections: effects whose values are impossible, with the reason, in the order of the model.
        log_prior_odds: logarithm of the prior odds of the set.
        lateral: part of the log evidence that the lateral axis adds to that of the wheel's plane.
    """

    names: frozenset[str]
    fit: Fit
    log_evidence: float
    objections: tuple[tuple[str, Reason], ...] = ()
    log_prior_odds: float = 0.0
    lateral: float = 0.0

    def tempered(self, plane: float, lateral: float) -> Evaluated:
        """Return the set with the evidence of plane and lateral axis divided by these, prior odds excepted."""
        odds, by_lateral = self.log_prior_odds, self.lateral
        return replace(
            self,
            log_evidence=odds + (self.log_evidence - odds - by_lateral) / plane + by_lateral / lateral,
            lateral=by_lateral / lateral,
        )


def evaluate(
    fit: Fit, data: Whitened, discrepancy: Discrepancy, near: Applied | None, enough: float = -math.inf
) -> Evaluated:
    """Return the evidence of a fitted set.

    Args:
        fit: of the set, in any covariance.
        data: whitened.
        discrepancy: of the campaign.
        near: discrepancy as a similar set has it; None if none is known.
        enough: a set that is still below this after the first step of the amplitudes is not worked out.

    Raises:
        FitFailedError: the fit fails with the discrepancy in.
    """
    applied = discrepancy.applied(discrepancy.start(fit.residual)) if near is None else near
    if near is not None:
        fit, applied = _fit_amplitudes(fit, applied, 1)
        rough = fit.moved(_limited(fit))
        if log_evidence(rough) < enough:
            return evaluated_at(rough)
    fit, applied = _fit_amplitudes(fit, applied, _STEPS)
    for _ in range(_FIT_ROUNDS):
        start = _clipped(fit.vector + _limited(fit), fit)
        fit = fit_model(fit.model, data, start, applied=applied, most_steps=_FIT_STEPS, done=_UNTAKEN_DECREASE)
        fit, applied = _fit_amplitudes(fit, applied, _STEPS)
        if _predicted_decrease(fit) < _UNTAKEN_DECREASE:
            return evaluated_at(fit.moved(_limited(fit)))
    # A fit that does not follow its own steps, as at a kink, has the evidence that it has.
    return evaluated_at(fit)


def _predicted_decrease(fit: Fit) -> float:
    """Return the decrease of the cost that a fit predicts of its next step."""
    step = _limited(fit)
    return float(step @ fit.precision @ step)


def settled(evaluated: Evaluated, data: Whitened) -> Evaluated:
    """Return a set whose parameters and discrepancy rest, to a fiftieth of their errors.

    Along a flat ridge the evidence changes by little long before both do. Where they stop then depends on the way
    there, and so on the rounding of the machine. A set that goes to and fro over a kink has no such place; the highest
    of its evidences is taken once it does not rise any more.
    """
    fit, applied = evaluated.fit, evaluated.fit.applied
    if applied is None:
        raise ValueError("a set rests with its discrepancy")
    highest: tuple[float, Fit] = (-math.inf, fit)
    falls = 0
    try:
        for number in range(_MAX_ROUNDS):
            previous = fit.vector
            clipped = _clipped(previous, fit)
            # The first fit is moved, with derivatives of where it came from.
            is_unmoved = number and np.array_equal(clipped, previous)
            fit = fit_model(fit.model, data, fit if is_unmoved else clipped, applied=applied, done=_CONVERGED_CHANGE**2)
            fit, applied = _fit_amplitudes(fit, applied, _MAX_ROUNDS, _AMPLITUDE_TOLERANCE)
            # The first fit is that under the amplitudes as they were.
            if number and _in_errors(fit, fit.vector - previous) < _CONVERGED_CHANGE:
                return evaluated_at(fit)
            evidence = log_evidence(fit)
            falls += evidence <= highest[0]
            highest = max(highest, (evidence, fit), key=lambda entry: entry[0])
            if falls == _MAX_FALLS:
                break
    except (FitFailedError, np.linalg.LinAlgError):
        return evaluated
    return evaluated_at(highest[1])


def _in_errors(fit: Fit, change: FloatArray) -> float:
    """Return the largest change of a parameter over its error."""
    return float((np.abs(change) / np.sqrt(np.diagonal(fit.covariance))).max())


def evaluated_at(fit: Fit) -> Evaluated:
    """Return a set with the evidence at a fit's parameters.

    Where the ring has no shape at them, the fit that is kept has every effect in its range.
    """
    clipped = _clipped(fit.vector, fit)
    usable = fit
    if not np.array_equal(clipped, fit.vector):
        try:
            for index in range(len(fit.model.campaign.groups)):
                fit.model.shape(fit.vector, index)
        except NoShapeError:
            usable = fit.moved(clipped - fit.vector)
    return Evaluated(
        names_of(fit), usable, log_evidence(fit), impossible(fit), log_prior_odds(fit.model), _by_lateral_axis(fit)
    )


def names_of(fit: Fit) -> frozenset[str]:
    """Return the names of the effects of a fit."""
    return frozenset(effect.name for effect in fit.model.effects)


def log_evidence(fit: Fit) -> float:
    """Return the log evidence of a fit with a discrepancy, prior odds of its effects included."""
    if fit.applied is None:
        raise ValueError("the evidence of a set needs its discrepancy")
    witness_deviance = fit.model.witness_deviance()
    odds = log_prior_odds(fit.model) - fit.model.log_choices()
    odds += _by_prior_widths(fit)
    return odds - 0.5 * (fit.cost + witness_deviance + fit.applied.log_determinant + fit.log_occam)


def _by_lateral_axis(fit: Fit) -> float:
    """Return the part of the log evidence that the lateral axis adds to that of the wheel's plane.

    The covariance has no terms between axes. A parameter's prior counts for the lateral axis by the share of its
    information that comes from there.
    """
    if fit.applied is None:
        raise ValueError("the evidence of a set needs its discrepancy")
    lateral_gram = fit.gram_of([LATERAL])
    plane_precision = fit.precision - lateral_gram[:-1, :-1]
    occam = fit.log_occam + float(np.linalg.slogdet(fit.prior_precision)[1] - np.linalg.slogdet(plane_precision)[1])
    deviation = fit.vector - fit.prior_mean
    total = np.diagonal(fit.information)
    lateral_share = np.where(total > 0.0, np.diagonal(lateral_gram)[:-1] / np.where(total > 0.0, total, 1.0), 0.0)
    prior = float(lateral_share @ (deviation * (fit.prior_precision @ deviation)))
    return -0.5 * (float(lateral_gram[-1, -1]) + prior + float(fit.applied.log_determinants[LATERAL]) + occam)


def log_prior_odds(model: ClosureModel) -> float:
    """Return the logarithm of the odds of a model's effects before the data."""
    conditions = tuple(group.conditions for group in model.campaign.groups)
    return sum(log_odds(effect, conditions) for effect in model.effects)


def log_odds(effect: AngleEffect, conditions: tuple[GroupConditions, ...]) -> float:
    """Return the logarithm of the odds of one effect before the data."""
    return math.log(criteria.EXPECTED_ODDS if effect.expected(conditions) else criteria.PRIOR_ODDS)


def _by_prior_widths(fit: Fit) -> float:
    """Return the gain of log evidence by parameters with several prior widths: the mean over widths takes its place.

    The data give a parameter the mean m and the variance l. Under a prior of standard deviation s its evidence is the
    density of m under a normal law of variance l + s^2, whatever the other parameters are.
    """
    gain = 0.0
    for effect in fit.model.effects:
        first = fit.model.layout.effect(effect.name).start
        for index, parameter in enumerate(effect.parameters, first):
            if not parameter.other_stds:
                continue
            variance, prior = float(fit.covariance[index, index]), float(fit.prior_precision[index, index])
            precision = 1.0 / variance - prior
            if precision <= _NO_DATA * prior:
                continue
            mean = float(fit.vector[index]) / (variance * precision)
            total = 1.0 / precision + np.square([1.0 / math.sqrt(prior), *parameter.other_stds])
            density = -0.5 * (np.log(total) + mean**2 / total)
            gain += float(np.logaddexp.reduce(density) - density[0]) - math.log(len(total))
    return gain


def impossible(fit: Fit) -> tuple[tuple[str, Reason], ...]:
    """Return the effects whose parameters are out of their physical range, with the reason."""
    reasons: list[tuple[str, Reason | None]] = []
    for effect in fit.model.effects:
        values, variances = fit.parameters_of(effect.name)
        errors = np.sqrt(variances)
        reason = beyond_range(effect.parameters, values, errors) or effect.reason_against(values, errors)
        reasons.append((effect.name, reason))
    return tuple((name, reason) for name, reason in reasons if reason is not None)


def _fit_amplitudes(fit: Fit, applied: Applied, steps: int, tolerance: float = _LOG_TOLERANCE) -> tuple[Fit, Applied]:
    """Return the fit under the amplitudes of the highest evidence, each time at the optimum of the linear model."""
    fit = fit.under(applied)
    previous, stepped = -math.inf, applied
    amplitude_path: list[FloatArray] = []
    for number in range(1, steps + 1):
        optimum = fit.moved(_limited(fit))
        evidence = log_evidence(optimum)
        if evidence < previous and applied is not stepped:  # the limit was too far
            applied = stepped
        elif abs(evidence - previous) < tolerance:
            break
        else:
            previous = evidence
            amplitude_path.append(applied.amplitudes)
            applied = stepped = applied.improved(optimum.weighted, optimum.precision)
            if len(amplitude_path) == _STEPS_TO_LIMIT and number < steps:
                applied = stepped.limit(*amplitude_path)
                amplitude_path.clear()
        fit = fit.under(applied)
    return fit, applied


def _limited(fit: Fit) -> FloatArray:
    """Return the step of a fit, shortened where it leaves the range in which the linear model holds."""
    step = fit.step
    largest = float(np.abs(step[fit.model.layout.states]).max())
    return step * min(1.0, 0.2 / max(largest, 1e-12))


def _clipped(vector: FloatArray, fit: Fit) -> FloatArray:
    """Return a vector with every effect in its range: the ring has no solution beyond."""
    result = vector.copy()
    for effect in fit.model.effects:
        where = fit.model.layout.effect(effect.name)
        result[where] = np.clip(result[where], *bounds(effect))
    return result
