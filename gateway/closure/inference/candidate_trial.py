"""Linear trial of one effect: the fit of all parameters with its columns added."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.closure.effects.effect import SignalEffect
from gateway.closure.inference.fit import Fit, fit_model, held_out_misfit, linearised, misfit_of
from gateway.closure.inference.likelihood import Normal, Whitened, as_real
from gateway.closure.model.baseline import NoShapeError
from gateway.closure.model.closure_model import AngleEffect, ClosureModel
from gateway.types import FloatArray, IntArray

# Steps of a refit: a correct effect converges in five to fifteen; one that needs more is not the cause.
_TRIAL_STEPS: Final = 30
# Tolerance of a refit with a large residual, which need not converge fully.
_ROUGH: Final = 3e-3
# Logarithm of a state's parameters from which the ring is far from its nominal shape.
_BENT: Final = 1.5
# Fraction of a ring effect's starts that is tried in addition.
_SMALL: Final = 0.03


FAR_OFF: Final = 30.0
"""Ratio of a trial's linear misfit to the misfit expected from noise above which a refit cannot succeed."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One effect tried from one start.

    Attributes:
        effect: the effect.
        model: the model with it.
        start: initial parameters of the effect.
        vector: parameters of the linear fit.
        misfit: chi-square of the data there, by the linear fit.
        held_out: (K,) misfit of every fold under the fit of all others.
    """

    effect: AngleEffect
    model: ClosureModel
    start: FloatArray
    vector: FloatArray
    misfit: float
    held_out: FloatArray


def try_effect(fit: Fit, data: Whitened, effect: AngleEffect) -> Trial | None:
    """Return the best trial of an effect over its starts, by held-out misfit; None if no start succeeds."""
    conditions = tuple(group.conditions for group in fit.model.campaign.groups)
    starts = tuple(effect.starts(conditions))
    if not isinstance(effect, SignalEffect):
        # The ring responds differently to large and to small changes of its own parameters.
        starts = (*starts, *(tuple(_SMALL * value for value in start) for start in starts))
    best = min(_trials(fit, data, effect, starts), key=_unseen, default=None)
    if best is None:
        return None
    if effect.scan:
        for place, values in effect.scan:
            near = best.start.tolist()
            varied = [(*near[:place], value, *near[place + 1 :]) for value in values]
            best = min([best, *_trials(fit, data, effect, varied)], key=_unseen)
    elif isinstance(effect, SignalEffect) and not effect.linear:
        # A start that is far too large adds curvature, which hides a small effect. The endpoint is therefore tried too.
        reached = np.clip(best.vector[best.model.layout.effect(effect.name)], *_bounds(effect))
        best = min([best, *_trials(fit, data, effect, [reached.tolist()])], key=_unseen)
    return best


def _trials(fit: Fit, data: Whitened, effect: AngleEffect, starts: Sequence[Sequence[float]]) -> list[Trial]:
    """Return the successful trials from these starts."""
    trials = [_try_from(fit, data, effect, np.array(start, dtype=np.float64)) for start in starts]
    return [trial for trial in trials if trial is not None and math.isfinite(trial.misfit + _unseen(trial))]


def _unseen(trial: Trial) -> float:
    """Return the misfit of all folds, each under the fit of the others."""
    return float(trial.held_out.sum())


def refit(trial: Trial, fit: Fit, data: Whitened) -> Fit:
    """Return the nonlinear fit that a linear trial predicts.

    Args:
        trial: the linear trial.
        fit: the fit from which the trial started.
        data: whitened data.

    Raises:
        FitFailedError: the fit fails.
    """
    vector = trial.vector.copy()
    where = trial.model.layout.effect(trial.effect.name)
    low, high = _bounds(trial.effect)
    if isinstance(trial.effect, SignalEffect):
        # Outside its range an effect may have zero slope, so that the fit could not return.
        vector[where] = np.where((vector[where] < low) | (vector[where] > high), trial.start, vector[where])
    # The ring cannot be solved for negative stiffness or damping.
    vector[where] = np.clip(vector[where], low, high)
    mean, _ = trial.model.priors()
    states = trial.model.layout.states
    if float(np.abs(vector[states] - mean[states]).max()) < _BENT or _is_better(trial.model, vector, fit, data):
        return fit_model(trial.model, data, vector, most_steps=_TRIAL_STEPS, rough=_ROUGH)
    # Without the effect the ring was distorted to imitate it, and a linear step does not restore it.
    vector[states] = mean[states]
    return fit_model(trial.model, data, vector, from_afar=True, most_steps=_TRIAL_STEPS, rough=_ROUGH)


def bare(fit: Fit, effect: AngleEffect, data: Whitened) -> Fit | None:
    """Return the model without an effect, all other parameters unchanged; None if it has no solution.

    Effects that fit equally well in its place are compared from here. A refit could distort the ring.
    """
    others = tuple(other for other in fit.model.effects if other.name != effect.name)
    model = ClosureModel(fit.model.campaign, fit.model.core, others)
    vector = fit.model.layout.moved(fit.vector, model.layout)
    mean, std = model.priors(vector)
    try:
        return linearised(model, data, vector, mean, std * _tightened(fit))
    except (NoShapeError, np.linalg.LinAlgError):
        return None


def _bounds(effect: AngleEffect) -> FloatArray:
    """Return the lowest and the highest plausible value of each parameter, (2, P)."""
    return np.array([(parameter.low, parameter.high) for parameter in effect.parameters]).T


def _is_better(model: ClosureModel, vector: FloatArray, fit: Fit, data: Whitened) -> bool:
    try:
        return misfit_of(data, model.predict(vector)) < fit.misfit
    except (NoShapeError, np.linalg.LinAlgError):
        return False


def _try_from(fit: Fit, data: Whitened, effect: AngleEffect, start: FloatArray) -> Trial | None:
    model = ClosureModel(fit.model.campaign, fit.model.core, (*fit.model.effects, effect))
    there = fit.model.layout.moved(fit.vector, model.layout)
    own = model.layout.effect(effect.name)
    there[own] = start
    old = _places(fit, model)
    size, folds = model.layout.size, data.folds
    matrix, gradient, misfit = np.zeros((folds, size, size)), np.zeros((folds, size)), np.zeros(folds)
    matrix[np.ix_(np.arange(folds), old, old)] = fit.normal.matrix
    try:
        for index, known in enumerate(fit.rows):
            places, base, derivatives = model.group_derivatives(there, index, only=effect.name)
            weight = data.weights[index]
            rows, columns = as_real(known.rows), as_real(derivatives * weight[:, None])
            left = as_real(known.residual - (base - fit.alone[index]) * weight)
            blocks, before = np.arange(len(weight)), old[known.places]
            cross = rows @ columns.swapaxes(1, 2)
            matrix[np.ix_(blocks, before, places)] += cross
            matrix[np.ix_(blocks, places, before)] += cross.swapaxes(1, 2)
            matrix[np.ix_(blocks, places, places)] += columns @ columns.swapaxes(1, 2)
            gradient[np.ix_(blocks, places)] += (columns @ left[:, :, None])[..., 0]
            gradient[np.ix_(blocks, before)] += (rows @ left[:, :, None])[..., 0]
            misfit[blocks] += np.square(left).sum(axis=1)
    except (NoShapeError, np.linalg.LinAlgError):
        return None
    if not (np.isfinite(matrix).all() and np.isfinite(gradient).all()):
        return None
    return _solved(effect, start, model, there, Normal(matrix, gradient, misfit), _tightened(fit))


def _places(fit: Fit, model: ClosureModel) -> IntArray:
    """Return the index of each parameter of a fit in the larger model, (P,)."""
    result = np.arange(fit.model.layout.size)
    for effect in fit.model.effects:
        where, there = fit.model.layout.effect(effect.name), model.layout.effect(effect.name)
        result[where] = np.arange(there.start, there.stop)
    return result


def _tightened(fit: Fit) -> float:
    """Return the factor by which the priors of a fit are tightened."""
    _, std = fit.model.priors()
    return float(fit.prior_std[0] / std[0])


def _solved(
    effect: AngleEffect, start: FloatArray, model: ClosureModel, there: FloatArray, normal: Normal, tightened: float
) -> Trial | None:
    mean, std = model.priors(there)
    # The effect may be what distorts the states, so its own prior stays wide.
    own = model.layout.effect(effect.name)
    std[: own.start] *= tightened
    std[own.stop :] *= tightened
    precision = std**-2.0
    total = normal.matrix.sum(axis=0)
    gradient = normal.gradient.sum(axis=0) - (there - mean) * precision
    try:
        change = np.linalg.solve(total + np.diag(precision), gradient)
        held_out = held_out_misfit(normal, there - mean, std)
    except np.linalg.LinAlgError:
        return None
    misfit = float(normal.misfit.sum() - 2.0 * change @ normal.gradient.sum(axis=0) + change @ total @ change)
    known = model.witness_misfit(there + change)
    return Trial(effect, model, start, there + change, misfit + known, held_out + known / len(held_out))
