"""Gauss-Newton fit of a closure model to the groups' mean waveforms, with priors and with or without a discrepancy."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final, Self

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.angle.axis_covariance import Rows
from gateway.diagnosis.angle.discrepancy import Applied
from gateway.diagnosis.angle.likelihood import REAL, Whitened, as_real
from gateway.diagnosis.effects.effect import RingEffect, SignalEffect
from gateway.diagnosis.model.baseline import NoShapeError
from gateway.diagnosis.model.closure_model import ClosureModel

_MAX_STEPS: Final = 100
# Most steps that are tried, and the shares of the one before that a shorter one is.
_MAX_TRIAL_STEPS: Final = 6
_MIN_STEP_SHARE: Final = 0.1
_MAX_STEP_SHARE: Final = 0.5
_FIXED_SHARE: Final = 0.4
_SMALLEST: Final = 1e-300
# Decrease of the cost below which a fit has converged: far below what decides between two sets of effects.
_CONVERGED_DECREASE: Final = 0.02
# Largest step of a state's logarithms.
_MAX_STATE_STEP: Final = 0.5
# Without a discrepancy a model that does not describe the data overstates its information, so errors are widened by
# the misfit per degree of freedom. The factor is updated until the misfit decreases by less than this.
_RESCALINGS: Final = 6
_SETTLED_RATIO: Final = 0.9
# Shares of the signal by which the errors of the data are widened when a fit starts far off, and the share of the
# misfit that a step must gain there: each of these fits is only the start of the next one.
_ANNEALING_SHARES: Final = (3e-2, 3e-3, 3e-4)
_MIN_GAIN: Final = 3e-3


@dataclass(frozen=True, slots=True)
class Linearisation:
    """What a trial needs of a fit besides model, data and discrepancy.

    Attributes:
        vector: parameters, (P,).
        predicted: (3, ORDERS) for each group; empty for groups that are left out, like the next.
        weighted: C^-1 times derivatives and residual, (P + 1, 3, REAL) of each group.
        gram: products of derivatives and residual with them, over all groups, (P + 1, P + 1).
        prior_mean: (P,).
        prior_precision: (P, P).
        scale: factor on the variance of the data.
    """

    vector: FloatArray
    predicted: tuple[ComplexArray, ...]
    weighted: tuple[FloatArray, ...]
    gram: FloatArray
    prior_mean: FloatArray
    prior_precision: FloatArray
    scale: float


class FitFailedError(Exception):
    """No equilibrium near the starting point: the model cannot be fitted to these data."""


@dataclass(frozen=True)
class Fit:
    """A model at its optimum.

    Attributes:
        model: the model.
        data: whitened.
        vector: parameters, (P,).
        predicted: (3, ORDERS) for each group, at its mean conditions.
        rows: derivatives of each group's real coefficients, (P, 3, REAL).
        residual: real coefficients of each group, (3, REAL).
        prior_mean: (P,).
        prior_precision: (P, P).
        scale: factor on the variance of the data, 1 with a discrepancy.
        applied: discrepancy in the covariance, if any.
        freedom: of the parameters by what the fit leaves, (P, P), a part of their covariance; None for none.
    """

    model: ClosureModel
    data: Whitened
    vector: FloatArray
    predicted: tuple[ComplexArray, ...]
    rows: tuple[FloatArray, ...]
    residual: tuple[FloatArray, ...]
    prior_mean: FloatArray
    prior_precision: FloatArray
    scale: float = 1.0
    applied: Applied | None = None
    freedom: FloatArray | None = None

    @classmethod
    def of(cls, seen: Linearisation, model: ClosureModel, data: Whitened, applied: Applied | None) -> Self:
        """Return a fit for trials, without the derivatives themselves."""
        mean, precision = seen.prior_mean, seen.prior_precision
        fit = cls(model, data, seen.vector, seen.predicted, (), (), mean, precision, seen.scale, applied)
        fit.__dict__["weighted"] = list(seen.weighted)
        fit.__dict__["_gram"] = seen.gram
        return fit

    def linearisation(self, groups: Collection[int]) -> Linearisation:
        """Return what trials in these groups need."""
        return Linearisation(
            self.vector,
            tuple(prediction if index in groups else prediction[:0] for index, prediction in enumerate(self.predicted)),
            tuple(rows if index in groups else rows[:0] for index, rows in enumerate(self.weighted)),
            self._gram,
            self.prior_mean,
            self.prior_precision,
            self.scale,
        )

    @property
    def _stacked(self) -> list[FloatArray]:
        return [np.concatenate([row, residual[None]]) for row, residual in zip(self.rows, self.residual, strict=True)]

    @cached_property
    def weighted(self) -> list[FloatArray]:
        """C^-1 times derivatives and residual for the data's covariance C, (P + 1, 3, REAL) of each group."""
        return weighted(self.data, self._stacked, self.applied)

    @cached_property
    def _gram(self) -> FloatArray:
        return product(self.weighted, self._stacked) / self.scale

    def gram_of(self, axes: Sequence[int]) -> FloatArray:
        """Return the products of derivatives and residual with them of some axes alone, (P + 1, P + 1)."""
        chosen = list(axes)
        return (
            product([rows[:, chosen] for rows in self.weighted], [rows[:, chosen] for rows in self._stacked])
            / self.scale
        )

    def cross(self, others: Rows) -> FloatArray:
        """Return derivatives and residual C^-1 others' for others (q, 3, REAL) of each group, (P + 1, q)."""
        return product(self.weighted, others) / self.scale

    def cross_information(self, others: Rows, batches: int) -> FloatArray:
        """Return others C^-1 others' within equal batches of others (k, 3, REAL) of each group, (batches, q, q)."""
        return products(self.data, others, self.applied, batches) / self.scale

    @cached_property
    def log_occam(self) -> float:
        """Logarithm of the determinant of the precision over that of the priors."""
        return float(np.linalg.slogdet(self.precision)[1] - np.linalg.slogdet(self.prior_precision)[1])

    @property
    def residual_product(self) -> float:
        """Chi-square of the data."""
        return float(self._gram[-1, -1])

    @property
    def information(self) -> FloatArray:
        """Information of the data, (P, P)."""
        return self._gram[:-1, :-1]

    @property
    def slope(self) -> FloatArray:
        """Half the negative gradient of the data's chi-square, (P,)."""
        return self._gram[:-1, -1]

    @cached_property
    def misfit(self) -> float:
        """Chi-square of the data by the scatter alone."""
        return chi_square(self.data, self.residual, None)

    @property
    def cost(self) -> float:
        """Chi-square of data and priors."""
        deviation = self.vector - self.prior_mean
        return self.residual_product + float(deviation @ self.prior_precision @ deviation)

    @cached_property
    def precision(self) -> FloatArray:
        """Inverse of the parameters' covariance, (P, P)."""
        return self.information + self.prior_precision

    @cached_property
    def covariance(self) -> FloatArray:
        """Covariance of the parameters, (P, P)."""
        covariance: FloatArray = np.asarray(np.linalg.inv(self.precision), dtype=np.float64)
        return covariance if self.freedom is None else covariance + self.freedom

    @property
    def step(self) -> FloatArray:
        """Step to the optimum of the linearised model, (P,)."""
        gradient = self.slope - self.prior_precision @ (self.vector - self.prior_mean)
        return np.asarray(np.linalg.solve(self.precision, gradient), dtype=np.float64)

    def parameters_of(self, name: str) -> tuple[FloatArray, FloatArray]:
        """Return the parameters of an effect and their variances, (P,) each."""
        where = self.model.layout.effect(name)
        return self.vector[where], np.diagonal(self.covariance)[where]

    def under(self, applied: Applied | None) -> Fit:
        """Return the same linearised model with another discrepancy in the covariance."""
        if applied is self.applied and self.scale == 1.0:
            return self
        return replace(self, applied=applied, scale=1.0)

    def weighed(self, data: Whitened, scale: float, applied: Applied | None) -> Fit:
        """Return the same linearised model with other weights of the same data."""
        if data is self.data and scale == self.scale and applied is self.applied:
            return self
        return replace(self, data=data, scale=scale, applied=applied)

    def refined(self) -> Fit:
        """Return the model with the error of the core's grid measured where it is linearised.

        That changes the signal by a few millionths, and its derivatives by as little, which stay.
        """
        self.model.refine(self.vector)
        predicted = tuple(self.model.predict_mean(self.vector, index) for index in range(len(self.predicted)))
        if all(np.array_equal(new, old) for new, old in zip(predicted, self.predicted, strict=True)):
            return self
        residual = tuple(
            error + as_real(old - new) for error, old, new in zip(self.residual, self.predicted, predicted, strict=True)
        )
        return replace(self, predicted=predicted, residual=residual)

    def moved(self, change: FloatArray) -> Fit:
        """Return the linearised model moved by a change of its parameters (P,)."""
        residual = tuple(
            group_residual - np.tensordot(change, row, axes=1)
            for row, group_residual in zip(self.rows, self.residual, strict=True)
        )
        moved_fit = replace(self, vector=self.vector + change, residual=residual)
        # Products of the residual follow from those of the derivatives.
        transform = np.eye(len(change) + 1)
        transform[-1, :-1] = -change
        moved_fit.__dict__["weighted"] = [np.tensordot(transform, rows, axes=1) for rows in self.weighted]
        moved_fit.__dict__["_gram"] = transform @ self._gram @ transform.T
        return moved_fit


def weighted(data: Whitened, rows: Rows, applied: Applied | None) -> list[FloatArray]:
    """Return C^-1 rows' for rows (k, 3, REAL) of each group, with a discrepancy in C or by the scatter alone."""
    return data.weighted(rows) if applied is None else applied.weighted(rows)


def product(rows: Sequence[FloatArray], others: Rows) -> FloatArray:
    """Return the sum over groups of rows (p, 3, REAL) times others' (q, 3, REAL), (p, q); None stands for zeros."""
    pairs = [(row, other) for row, other in zip(rows, others, strict=True) if other is not None]
    total = np.zeros((len(pairs[0][0]), len(pairs[0][1])))
    for row, other in pairs:
        total += row.reshape(len(row), -1) @ other.reshape(len(other), -1).T
    return total


def products(data: Whitened, rows: Rows, applied: Applied | None, batches: int = 1) -> FloatArray:
    """Return rows C^-1 rows' within equal batches of rows as for `weighted`, (batches, k, k)."""
    return data.products(rows, batches) if applied is None else applied.products(rows, batches)


def chi_square(data: Whitened, residual: Sequence[FloatArray], applied: Applied | None) -> float:
    """Return the chi-square of a residual (3, REAL) of each group."""
    return float(products(data, [group_residual[None] for group_residual in residual], applied)[0, 0, 0])


def fit_model(
    model: ClosureModel,
    data: Whitened,
    start: FloatArray | Fit | None = None,
    *,
    applied: Applied | None = None,
    from_afar: bool = False,
    most_steps: int = _MAX_STEPS,
    rough: float = 0.0,
    done: float = _CONVERGED_DECREASE,
) -> Fit:
    """Return the fit of a model.

    Args:
        model: model to fit.
        data: whitened data.
        start: initial vector, or the model linearised there; None starts at the priors' mean.
        applied: discrepancy in the covariance of the data; None leaves it out.
        from_afar: True first fits with loosened data, for a start far from the solution.
        most_steps: after which the fit is taken as it is, the steps from afar and those of other errors included.
        rough: share of the misfit beyond noise; the fit ends after a step that gains less.
        done: decrease of the cost below which the fit has converged.

    Raises:
        FitFailedError: the model has no equilibrium near the start.
    """
    steps = _Steps(most_steps)

    def least_gain(fit: Fit) -> float:
        return max(done, rough * (fit.misfit - data.size) / fit.scale)

    try:
        if isinstance(start, Fit):
            fit = start.refined()
        else:
            vector = model.priors()[0] if start is None else start
            if not from_afar:
                model.refine(vector)
            fit = linearised(model, data, vector)
        if from_afar:
            for share in _ANNEALING_SHARES:
                fit = _descend(fit.weighed(data.loosened(share), 1.0, None), steps, lambda fit: _MIN_GAIN * fit.misfit)
            fit = fit.refined()
        if applied is not None:
            return _descend(fit.weighed(data, 1.0, applied), steps, lambda _: done)
        fit = fit.weighed(data, 1.0, None)
        scale = _overdispersion(fit.misfit, data, model)
        for _ in range(_RESCALINGS):
            previous_scale = scale
            fit = _descend(fit.weighed(data, scale, None), steps, least_gain)
            scale = _overdispersion(fit.misfit, data, model)
            fit = fit.refined()
            if scale > _SETTLED_RATIO * previous_scale or steps.none:
                break
        return _descend(fit.weighed(data, scale, None), steps, least_gain)
    except (NoShapeError, np.linalg.LinAlgError) as error:
        raise FitFailedError(str(error)) from error


def linearised(
    model: ClosureModel, data: Whitened, vector: FloatArray, *, scale: float = 1.0, applied: Applied | None = None
) -> Fit:
    """Return a model at these parameters, which need not be its optimum.

    Raises:
        NoShapeError: the ring has no solution there.
    """
    prior_mean, _ = model.priors(vector)
    predicted, rows, residuals = [], [], []
    for index in range(len(model.campaign.groups)):
        places, base, derivatives = model.group_derivatives(vector, index)
        dense = np.zeros((model.layout.size, 3, REAL))
        dense[places] = as_real(derivatives)
        predicted.append(base)
        rows.append(dense)
        residuals.append(as_real(data.mean(index, data.orders[index]) - base))
    return Fit(
        model,
        data,
        vector,
        tuple(predicted),
        tuple(rows),
        tuple(residuals),
        prior_mean,
        model.prior_precision(vector),
        scale,
        applied,
    )


class _Steps:
    """Number of steps that remain for a fit."""

    def __init__(self, count: int) -> None:
        self._count = count

    @property
    def none(self) -> bool:
        return self._count <= 0

    def take(self) -> None:
        self._count -= 1


def _descend(fit: Fit, steps: _Steps, least_gain: Callable[[Fit], float]) -> Fit:
    """Return the fit after steps from a linearisation, under its weights."""
    model, data = fit.model, fit.data
    while not steps.none:
        steps.take()
        min_decrease = least_gain(fit)
        change = fit.step
        if float(change @ fit.precision @ change) < min_decrease:
            break
        states = model.layout.states
        change = change / max(1.0, float(np.abs(change[states]).max()) / _MAX_STATE_STEP)
        vector = _line_search(fit, data, change, min_decrease)
        if vector is None:
            break
        previous_cost = fit.cost
        fit = linearised(model, data, vector, scale=fit.scale, applied=fit.applied)
        if previous_cost - fit.cost < min_decrease:
            break
    return fit


def _line_search(fit: Fit, data: Whitened, change: FloatArray, min_decrease: float) -> FloatArray | None:
    """Return the parameters after a full or partial step that improves the fit; None if none does.

    A partial step ends where the parabola through the cost, its slope at the start and its value at the end of the step
    before is lowest, or at a fixed share of the step before where the cost jumps.

    Args:
        fit: where the step begins.
        data: whitened.
        change: the step, at most to the optimum of the linearised model.
        min_decrease: decrease of the cost that is not worth a step, by which the fit would end.
    """
    gradient = fit.slope - fit.prior_precision @ (fit.vector - fit.prior_mean)
    jumps = any(isinstance(effect, SignalEffect) and effect.jumps for effect in fit.model.effects)
    is_bounded, step_share = False, 1.0
    secant_rise: float | None = None
    for _ in range(_MAX_TRIAL_STEPS):
        vector: FloatArray = fit.vector + change
        try:
            cost = _misfit(fit.model, data, vector, fit.applied) / fit.scale
        except (NoShapeError, np.linalg.LinAlgError):
            # A shorter step for all would end before a bound that only one of them meets.
            change, is_bounded = (0.25 * change if is_bounded else _step_inside(fit, change)), True
            secant_rise = None
            continue
        deviation = vector - fit.prior_mean
        rise = cost + float(deviation @ fit.prior_precision @ deviation) - fit.cost
        if rise < 0.0:
            return vector
        if jumps:
            step_share = _FIXED_SHARE
        else:
            if secant_rise is not None and rise * (1.0 - step_share) > step_share * (secant_rise - rise):
                # Rises over the step, extrapolated to its start: at a kink the cost grows there, unlike its slope.
                break
            fall = 2.0 * float(change @ gradient)
            step_share = min(max(0.5 * fall / max(rise + fall, _SMALLEST), _MIN_STEP_SHARE), _MAX_STEP_SHARE)
            secant_rise = step_share * rise
        change = step_share * change
        if float(2.0 * (change @ gradient) - change @ fit.precision @ change) < min_decrease:
            break
    return None


def _step_inside(fit: Fit, change: FloatArray) -> FloatArray:
    """Return the step with ring effects held at the ends of their ranges that it passes; the others follow."""
    layout, bound = fit.model.layout, fit.vector + change
    for effect in fit.model.effects:
        if isinstance(effect, RingEffect):
            where = layout.effect(effect.name)
            bound[where] = np.clip(bound[where], *np.array([(limit.low, limit.high) for limit in effect.parameters]).T)
    step = bound - fit.vector
    fixed = step != change
    if not fixed.any():
        return 0.25 * change
    gradient = fit.slope - fit.prior_precision @ (fit.vector - fit.prior_mean) - fit.precision[:, fixed] @ step[fixed]
    free = ~fixed
    step[free] = np.linalg.solve(fit.precision[np.ix_(free, free)], gradient[free])
    states = layout.states
    step[free] /= max(1.0, float(np.abs(step[states]).max()) / _MAX_STATE_STEP)
    return np.asarray(step)


def _misfit(model: ClosureModel, data: Whitened, vector: FloatArray, applied: Applied | None) -> float:
    """Return the chi-square of the data at these parameters."""
    residual = [
        as_real(data.mean(index, data.orders[index]) - model.predict_mean(vector, index))
        for index in range(len(model.campaign.groups))
    ]
    return chi_square(data, residual, applied)


def _overdispersion(misfit: float, data: Whitened, model: ClosureModel) -> float:
    """Return the misfit per degree of freedom, at least 1."""
    return max(1.0, misfit / max(1, data.size - model.layout.size))
