"""Linear trial of one effect: what the cost would be with its columns added to a fitted model."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.core.types import FloatArray, IntArray
from gateway.diagnosis.angle.fit import Fit, fit_model
from gateway.diagnosis.angle.likelihood import Whitened, as_real
from gateway.diagnosis.effects.effect import SignalEffect
from gateway.diagnosis.effects.local_effects import LocalChange
from gateway.diagnosis.model.baseline import NoShapeError, Shape
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel

# Steps of a fit from a trial: a correct effect converges in five to fifteen; one that needs more is not the cause.
_TRIAL_STEPS: Final = 25
# Tolerance of a fit from a trial with a large residual, which need not converge fully.
_ROUGH: Final = 3e-3
# Logarithm of a state's parameters from which the ring is far from its nominal shape.
_DISTORTION_LIMIT: Final = 1.5
# Gain of log likelihood that its best start must have: at least a fifth of what a refined one gains, and refined ones
# that gain 20 promise nothing.
_WORTH_REFINING: Final = 4.0
# Starts that two groups choose, and the linear steps that are made from those of an effect with refinements.
_FINALISTS: Final = 8
_FOLLOW_STEPS: Final = 3
# Number of starts from which the slowest and the fastest group alone choose those that are tried in all.
_MAX_UNSCREENED_STARTS: Final = 16
# Fraction of a ring effect's starts that is tried in addition.
_SMALL_START_SHARE: Final = 0.03


@dataclass(frozen=True, slots=True)
class Trial:
    """One effect tried from one start.

    Attributes:
        effect: the effect.
        model: the model with it.
        start: initial parameters of the effect.
        vector: parameters of the linear fit.
        cost: chi-square of data and priors there, by the linear fit.
        promise: gain of log evidence that it stands for, prior widths of its parameters included.
    """

    effect: AngleEffect
    model: ClosureModel
    start: FloatArray
    vector: FloatArray
    cost: float
    promise: float


def shapes_of(fit: Fit, groups: Sequence[int]) -> dict[int, Shape]:
    """Return the belt's shape in these groups, by index.

    Raises:
        NoShapeError: the ring has no solution in one of them.
    """
    return {index: fit.model.shape(fit.vector, index) for index in groups}


def try_effect(fit: Fit, effect: AngleEffect, shapes: Mapping[int, Shape]) -> Trial | None:
    """Return the best trial of an effect over its starts, by promise; None if no start succeeds.

    The result depends on the arguments alone, whatever was tried before.

    Args:
        fit: of the model without the effect.
        effect: to try.
        shapes: of the fit's belt in the groups in which it is tried; the promise of the others is left out.
    """
    conditions = tuple(group.conditions for group in fit.model.campaign.groups)
    starts: Sequence[Sequence[float]] = effect.starts(conditions)
    if not isinstance(effect, SignalEffect):
        # The ring responds differently to large and to small changes of its own parameters.
        starts = (*starts, *(tuple(_SMALL_START_SHARE * value for value in start) for start in starts))
    model = ClosureModel(fit.model.campaign, fit.model.core, (*fit.model.effects, effect))
    if effect.refinements:
        starts = _nearest(fit, model, effect, shapes, starts)
    elif len(starts) > _MAX_UNSCREENED_STARTS and len(shapes) > len(extremes := _extremes(fit, shapes)):
        trials = sorted(_trials(fit, model, effect, extremes, starts), key=_promise, reverse=True)
        starts = [trial.start.tolist() for trial in trials[:_FINALISTS]]
    best = max(_trials(fit, model, effect, shapes, starts), key=_promise, default=None)
    if best is None:
        return None
    if effect.scan:
        for index, values in effect.scan:
            best_start = best.start.tolist()
            varied = [(*best_start[:index], value, *best_start[index + 1 :]) for value in values]
            best = max([best, *_trials(fit, model, effect, shapes, varied)], key=_promise)
    elif isinstance(effect, SignalEffect) and not effect.linear:
        # A start that is far too large adds curvature, which hides a small effect. The endpoint is therefore tried too.
        endpoint = np.clip(best.vector[best.model.layout.effect(effect.name)], *bounds(effect))
        best = max([best, *_trials(fit, model, effect, shapes, [endpoint.tolist()])], key=_promise)
    return best


def followed_trials(fit: Fit, effect: AngleEffect, shapes: Mapping[int, Shape]) -> list[Trial]:
    """Return a trial of an effect from each of its starts, followed for a few linear steps, by promise.

    Args:
        fit: of the model without the effect.
        effect: to try.
        shapes: of the fit's belt in the groups in which it is tried.
    """
    conditions = tuple(group.conditions for group in fit.model.campaign.groups)
    model = ClosureModel(fit.model.campaign, fit.model.core, (*fit.model.effects, effect))
    trials = _trials(fit, model, effect, shapes, effect.starts(conditions))
    where = model.layout.effect(effect.name)
    for _ in range(_FOLLOW_STEPS):
        trials = _trials(
            fit, model, effect, shapes, [np.clip(trial.vector[where], *bounds(effect)).tolist() for trial in trials]
        )
    return sorted(trials, key=_promise, reverse=True)


def _nearest(
    fit: Fit, model: ClosureModel, effect: AngleEffect, shapes: Mapping[int, Shape], starts: Sequence[Sequence[float]]
) -> list[list[float]]:
    """Return the best start of an effect with refinements, by the slowest and the fastest group alone.

    The best ones are followed for a few steps, as the promise of a start is that of a linear step from it.
    """
    extremes = _extremes(fit, shapes)
    conditions = tuple(fit.model.campaign.groups[index].conditions for index in extremes)
    # On a coarser belt, unless something else of the fit answers with the belt: its change would be tried as well.
    coarse_shapes = extremes
    if not any(isinstance(fitted_effect, LocalChange) for fitted_effect in fit.model.effects):
        coarse_shapes = {
            index: replace(shape, belt=None if shape.belt is None else shape.belt.coarser())
            for index, shape in extremes.items()
        }
    trials = _trials(fit, model, effect, coarse_shapes, starts)
    if trials and 0.5 * (fit.cost - min(trial.cost for trial in trials)) < _WORTH_REFINING:
        return [max(trials, key=_promise).start.tolist()]
    for stage in range(effect.refinements if trials else 0):
        best = max(trials, key=_promise)
        trials += _trials(fit, model, effect, coarse_shapes, effect.nearer(stage, best.start.tolist(), conditions))
    finalists = sorted(trials, key=_promise, reverse=True)[:_FINALISTS]
    trials = _trials(fit, model, effect, extremes, [trial.start.tolist() for trial in finalists])
    where = model.layout.effect(effect.name)
    for _ in range(_FOLLOW_STEPS):
        trials = sorted(trials, key=_promise, reverse=True)[:_FINALISTS]
        endpoints = [np.clip(trial.vector[where], *bounds(effect)).tolist() for trial in trials]
        trials += _trials(fit, model, effect, extremes, endpoints)
    return [max(trials, key=_promise).start.tolist()] if trials else []


def _extremes(fit: Fit, shapes: Mapping[int, Shape]) -> dict[int, Shape]:
    """Return the shapes of the slowest and of the fastest group."""
    groups = fit.model.campaign.groups
    by_speed = sorted(shapes, key=lambda index: (groups[index].conditions.omega_radps, index))
    return {index: shapes[index] for index in sorted({by_speed[0], by_speed[-1]})}


def _promise(trial: Trial) -> float:
    return trial.promise


def _trials(
    fit: Fit, model: ClosureModel, effect: AngleEffect, shapes: Mapping[int, Shape], starts: Sequence[Sequence[float]]
) -> list[Trial]:
    """Return the successful trials from these starts."""
    solved: list[tuple[FloatArray, list[FloatArray]]] = []
    for start in starts:
        rows = _rows_from(fit, model, effect, shapes, np.array(start, dtype=np.float64))
        if rows is not None:
            solved.append((np.array(start, dtype=np.float64), rows))
    if not solved:
        return []
    # All starts go through the inverse covariance together, which takes a fraction of the time of one after the other.
    stacked: list[FloatArray | None] = [None] * len(model.campaign.groups)
    for number, index in enumerate(shapes):
        stacked[index] = np.concatenate([rows[number] for _, rows in solved])
    gram, cross = fit.cross_information(stacked, len(solved)), np.split(fit.cross(stacked), len(solved), axis=1)
    trials = [_trial(fit, model, effect, start, *pair) for (start, _), *pair in zip(solved, gram, cross, strict=True)]
    return [trial for trial in trials if trial is not None and math.isfinite(trial.cost + trial.promise)]


def bounds(effect: AngleEffect) -> FloatArray:
    """Return the lowest and the highest plausible value of each parameter, (2, P)."""
    return np.array([(parameter.low, parameter.high) for parameter in effect.parameters]).T


def start_of(trial: Trial) -> FloatArray:
    """Return the parameters from which the nonlinear fit begins, those of the effect within their range."""
    vector = trial.vector.copy()
    where = trial.model.layout.effect(trial.effect.name)
    low, high = bounds(trial.effect)
    if isinstance(trial.effect, SignalEffect):
        # Outside its range an effect may have zero slope, so that the fit could not return.
        vector[where] = np.where((vector[where] < low) | (vector[where] > high), trial.start, vector[where])
    # The ring cannot be solved for negative stiffness or damping.
    vector[where] = np.clip(vector[where], low, high)
    return vector


def refit(trial: Trial, data: Whitened) -> Fit:
    """Return the nonlinear fit that a linear trial predicts, without a discrepancy.

    Raises:
        FitFailedError: the fit fails.
    """
    vector = start_of(trial)
    mean, _ = trial.model.priors()
    states = trial.model.layout.states
    if float(np.abs(vector[states] - mean[states]).max()) < _DISTORTION_LIMIT:
        return fit_model(trial.model, data, vector, most_steps=_TRIAL_STEPS, rough=_ROUGH)
    # Without the effect the ring was distorted to imitate it, and a linear step does not restore it.
    vector[states] = mean[states]
    return fit_model(trial.model, data, vector, from_afar=True, most_steps=_TRIAL_STEPS, rough=_ROUGH)


def _with_start(fit: Fit, model: ClosureModel, effect: AngleEffect, start: FloatArray) -> FloatArray:
    """Return the parameters of a fit with an effect at its start."""
    vector = fit.model.layout.moved(fit.vector, model.layout)
    vector[model.layout.effect(effect.name)] = start
    return vector


def _rows_from(
    fit: Fit, model: ClosureModel, effect: AngleEffect, shapes: Mapping[int, Shape], start: FloatArray
) -> list[FloatArray] | None:
    """Return derivatives by the effect's parameters, and the change of the signal by the start, of each group tried.

    Other groups are left out, as if the effect did not change them.

    Returns:
        (k + 1, 3, REAL) of each group, None if the model has no solution.
    """
    vector = _with_start(fit, model, effect, start)
    group_rows = []
    try:
        for index, shape in shapes.items():
            _, base, derivatives = model.group_derivatives(vector, index, effect.name, shape)
            group_rows.append(as_real(np.concatenate([derivatives, (base - fit.predicted[index])[None]])))
    except (NoShapeError, np.linalg.LinAlgError):
        return None
    return group_rows if all(np.isfinite(rows).all() for rows in group_rows) else None


def _trial(
    fit: Fit, model: ClosureModel, effect: AngleEffect, start: FloatArray, gram: FloatArray, cross: FloatArray
) -> Trial | None:
    """Return the linear fit from a start; None if it is singular or the data do not contain the effect's axes.

    Args:
        fit: of the model without the effect.
        model: with it.
        effect: to try.
        start: initial parameters.
        gram: products of the derivatives and the change of the signal by the start, (k + 1, k + 1).
        cross: products of those of the fit and its residual with them, (P + 1, k + 1).
    """
    if not np.diagonal(gram)[:-1].any():
        return None
    vector, where = _with_start(fit, model, effect, start), model.layout.effect(effect.name)
    # From the change of the signal to the residual with the start in place.
    misfit = fit.residual_product - 2.0 * float(cross[-1, -1]) + float(gram[-1, -1])
    slope = np.concatenate([fit.slope - cross[:-1, -1], cross[-1, :-1] - gram[:-1, -1]])
    mean, _ = model.priors(vector)
    prior = model.prior_precision(vector)
    reach = effect.reach(start.tolist())
    reach_precision = np.zeros_like(prior)
    if reach is not None:
        np.fill_diagonal(reach_precision[where, where], np.square(np.reciprocal(reach)))
    places = _places(fit, model)
    new_places = np.arange(where.start, where.stop)
    # A step beyond its reach would promise what the effect does not keep.
    precision = prior + reach_precision
    # A fit that misses an effect has widened errors, and the effect may be what is missing: its prior stays as it is.
    precision[np.ix_(places, places)] += fit.information
    precision[np.ix_(places, new_places)] += cross[:-1, :-1]
    precision[np.ix_(new_places, places)] += cross[:-1, :-1].T
    precision[where, where] += gram[:-1, :-1]
    deviation = vector - mean
    gradient = -prior @ deviation
    gradient[np.concatenate([places, new_places])] += slope
    try:
        step = np.linalg.solve(precision, gradient)
        occam = float(np.linalg.slogdet(precision)[1] - np.linalg.slogdet(prior + reach_precision)[1]) - fit.log_occam
    except np.linalg.LinAlgError:
        return None
    cost = misfit + float(deviation @ prior @ deviation - step @ gradient)
    witness_change = model.witness_deviance() - fit.model.witness_deviance()
    occam += 2.0 * (model.log_choices() - fit.model.log_choices())
    return Trial(effect, model, start, vector + step, cost, 0.5 * (fit.cost - cost - witness_change - occam))


def _places(fit: Fit, model: ClosureModel) -> IntArray:
    """Return the index of each parameter of a fit in the larger model, (P,)."""
    result = np.arange(fit.model.layout.size)
    for effect in fit.model.effects:
        source, target = fit.model.layout.effect(effect.name), model.layout.effect(effect.name)
        result[source] = np.arange(target.start, target.stop)
    return result
