"""Gauss-Newton fit of a closure model to a campaign with priors, and its linearisation for each fold."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.closure.inference.likelihood import Normal, Whitened, add_rows, empty_normal
from gateway.closure.model.baseline import NoShapeError
from gateway.closure.model.closure_model import ClosureModel
from gateway.types import ComplexArray, FloatArray, IntArray

_MAX_STEPS: Final = 25
_ALL_STEPS: Final = 200
_HALVINGS: Final = 6
# Decrease of the cost, relative to the misfit per degree of freedom, below which a fit has converged.
_DONE: Final = 0.05
# Largest step of a state's logarithms.
_REACH: Final = 0.5
# A model that does not describe the data overstates its information, so the priors are tightened in proportion to the
# excess misfit. The factor is updated during the fit until the misfit decreases by less than this.
_RESCALINGS: Final = 6
_SETTLED: Final = 0.9
# Shares of the signal by which the errors of the data are widened when a fit starts far off.
_ANNEAL: Final = (3e-2, 3e-3, 3e-4)


class FitFailedError(Exception):
    """No equilibrium near the starting point: the model cannot be fitted to these data."""


@dataclass(frozen=True, slots=True)
class Rows:
    """Whitened derivatives of one group.

    Attributes:
        places: (k,) indices in the parameter vector.
        rows: (blocks, k, 3, ORDERS).
        residual: (blocks, 3, ORDERS).
        weight: (blocks, 3, ORDERS) whitening weights of both.
    """

    places: IntArray
    rows: ComplexArray
    residual: ComplexArray
    weight: FloatArray


@dataclass(frozen=True, slots=True)
class Fit:
    """A model at its optimum.

    Attributes:
        model: the model.
        vector: parameters.
        predicted: (blocks, 3, ORDERS) for each group.
        alone: (3, ORDERS) for each group, at its mean conditions.
        rows: linearisation of each group.
        normal: normal equations by fold, without priors.
        prior_mean: (P,).
        prior_std: (P,) tightened where the misfit is too large.
    """

    model: ClosureModel
    vector: FloatArray
    predicted: tuple[ComplexArray, ...]
    alone: tuple[ComplexArray, ...]
    rows: tuple[Rows, ...]
    normal: Normal
    prior_mean: FloatArray
    prior_std: FloatArray

    @property
    def misfit(self) -> float:
        """Chi-square of the data and of the side information."""
        return float(self.normal.misfit.sum()) + self.model.witness_misfit(self.vector)

    @property
    def cost(self) -> float:
        """Chi-square of data and priors."""
        return float(self.normal.misfit.sum()) + float(
            np.sum(np.square((self.vector - self.prior_mean) / self.prior_std))
        )

    def linear_misfit(self) -> float:
        """Return the chi-square of the data predicted after a linear step."""
        matrix, gradient = self.normal.matrix.sum(axis=0), self.normal.gradient.sum(axis=0)
        precision = self.prior_std**-2.0
        change = np.linalg.solve(matrix + np.diag(precision), gradient - (self.vector - self.prior_mean) * precision)
        return self.misfit - float(2.0 * change @ gradient - change @ matrix @ change)

    def covariance(self) -> FloatArray:
        """Return the covariance of the parameters by noise, floor and priors, (P, P)."""
        inverse: FloatArray = np.linalg.inv(self.normal.matrix.sum(axis=0) + np.diag(self.prior_std**-2.0))
        return inverse

    def held_out(self) -> FloatArray:
        """Return the misfit of every fold under the (linearised) fit of all others, (K,)."""
        own = held_out_misfit(self.normal, self.vector - self.prior_mean, self.prior_std)
        return own + self.model.witness_misfit(self.vector) / len(own)


def held_out_misfit(normal: Normal, from_prior: FloatArray, prior_std: FloatArray) -> FloatArray:
    """Return the misfit of every fold under the linear fit of all others, (K,).

    Args:
        normal: at the point of linearisation.
        from_prior: (P,) that point minus the priors' mean.
        prior_std: (P,).
    """
    result = np.empty(len(normal.misfit))
    for fold, change in enumerate(_changes_without(normal, from_prior, prior_std)):
        result[fold] = (
            normal.misfit[fold] - 2.0 * change @ normal.gradient[fold] + change @ normal.matrix[fold] @ change
        )
    return result


def held_out_residuals(fit: Fit) -> list[ComplexArray]:
    """Return every group's residual (blocks, 3, ORDERS), m/s^2, each fold's under the linear fit of all others."""
    changes = _changes_without(fit.normal, fit.vector - fit.prior_mean, fit.prior_std)
    residuals = []
    for rows in fit.rows:
        residual = rows.residual.copy()
        for fold in range(len(residual)):
            residual[fold] -= np.tensordot(changes[fold][rows.places], rows.rows[fold], axes=1)
        used = rows.weight > 0.0
        residuals.append(np.where(used, residual / np.where(used, rows.weight, 1.0), 0.0))
    return residuals


def _changes_without(normal: Normal, from_prior: FloatArray, prior_std: FloatArray) -> list[FloatArray]:
    """Return for every fold the change of the parameters when it is held out."""
    precision = prior_std**-2.0
    matrix = normal.matrix.sum(axis=0) + np.diag(precision)
    gradient = normal.gradient.sum(axis=0) - from_prior * precision
    return [
        np.linalg.solve(matrix - own, gradient - slope)
        for own, slope in zip(normal.matrix, normal.gradient, strict=True)
    ]


def fit_model(
    model: ClosureModel,
    data: Whitened,
    start: FloatArray | None = None,
    *,
    from_afar: bool = False,
    most_steps: int = _ALL_STEPS,
    rough: float = 0.0,
) -> Fit:
    """Return the fit of a model.

    Args:
        model: model to fit.
        data: whitened data; folds of weight 0 are ignored.
        start: initial vector; None starts at the priors' mean.
        from_afar: True first fits with loosened data, for a start far from the solution.
        most_steps: after which the fit is taken as it is.
        rough: share of the misfit beyond noise; the fit ends after a step that gains less.

    Raises:
        FitFailedError: the model has no equilibrium near the start.
    """
    prior_mean, prior_std = model.priors(start)
    vector = prior_mean.copy() if start is None else start.copy()
    left = _Steps(most_steps, rough)
    try:
        if from_afar:
            for share in _ANNEAL:
                vector = _descend(model, data.loosened(share), vector, prior_mean, prior_std, left).vector
        model.refine(vector)
        scale = _overdispersion(misfit_of(data, model.predict(vector)), data, model)
        for _ in range(_RESCALINGS):
            fit = _descend(model, data, vector, prior_mean, prior_std / math.sqrt(scale), left)
            vector, was = fit.vector, scale
            scale = _overdispersion(fit.misfit, data, model)
            model.refine(vector)
            if scale > _SETTLED * was or left.none:
                break
        return _descend(model, data, vector, prior_mean, prior_std / math.sqrt(scale), left)
    except (NoShapeError, np.linalg.LinAlgError) as error:
        raise FitFailedError(str(error)) from error


class _Steps:
    """Number of steps that remain for a fit."""

    def __init__(self, count: int, rough: float) -> None:
        self._count = count
        self.rough = rough

    @property
    def none(self) -> bool:
        return self._count <= 0

    def take(self) -> None:
        self._count -= 1


def _overdispersion(misfit: float, data: Whitened, model: ClosureModel) -> float:
    return max(1.0, misfit / max(1, data.used - model.layout.size))


def _descend(
    model: ClosureModel,
    data: Whitened,
    vector: FloatArray,
    prior_mean: FloatArray,
    prior_std: FloatArray,
    left: _Steps,
) -> Fit:
    precision = prior_std**-2.0
    fit = linearised(model, data, vector, prior_mean, prior_std)
    for _ in range(_MAX_STEPS):
        if left.none:
            break
        left.take()
        done = _DONE * _overdispersion(fit.misfit, data, model)
        done = max(done, left.rough * (fit.misfit - data.used))
        matrix = fit.normal.matrix.sum(axis=0) + np.diag(precision)
        gradient = fit.normal.gradient.sum(axis=0) - (fit.vector - prior_mean) * precision
        change = np.linalg.solve(matrix, gradient)
        if float(change @ gradient) < done:
            break
        states = model.layout.states
        change = change / max(1.0, float(np.abs(change[states]).max()) / _REACH)
        moved = _better(model, data, fit, change)
        if moved is None:
            break
        gained = fit.cost
        fit = linearised(model, data, moved, prior_mean, prior_std)
        if gained - fit.cost < done:
            break
    return fit


def _better(model: ClosureModel, data: Whitened, fit: Fit, change: FloatArray) -> FloatArray | None:
    """Return the parameters after a full or partial step that improves the fit; None if none does."""
    for _ in range(_HALVINGS):
        moved: FloatArray = fit.vector + change
        try:
            cost = misfit_of(data, model.predict(moved))
        except (NoShapeError, np.linalg.LinAlgError):
            change = 0.25 * change
            continue
        cost += float(np.sum(np.square((moved - fit.prior_mean) / fit.prior_std)))
        if cost < fit.cost:
            return moved
        change = 0.4 * change
    return None


def misfit_of(data: Whitened, predicted: list[ComplexArray]) -> float:
    """Return the chi-square of a prediction."""
    total = 0.0
    for orders, weight, there in zip(data.orders, data.weights, predicted, strict=True):
        total += float(np.sum(np.abs((orders - there) * weight) ** 2))
    return total


def linearised(
    model: ClosureModel, data: Whitened, vector: FloatArray, prior_mean: FloatArray, prior_std: FloatArray
) -> Fit:
    """Return a model at these parameters, which need not be its optimum; with priors (P,) each.

    Raises:
        NoShapeError: the ring has no solution there.
    """
    normal = empty_normal(data.folds, model.layout.size)
    predicted, alone, rows = [], [], []
    for index in range(len(model.campaign.groups)):
        base = model.predict_group(vector, index)
        places, mean, derivatives = model.group_derivatives(vector, index)
        weight = data.weights[index]
        whitened = Rows(places, derivatives * weight[:, None], (data.orders[index] - base) * weight, weight)
        add_rows(normal, whitened.places, whitened.rows, whitened.residual)
        predicted.append(base)
        alone.append(mean)
        rows.append(whitened)
    return Fit(model, vector, tuple(predicted), tuple(alone), tuple(rows), normal, prior_mean, prior_std)
