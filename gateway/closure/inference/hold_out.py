"""Error on held-out revolutions: parameters, discrepancy and choice of the set without the fold that is predicted."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gateway.closure.inference.discrepancy import Applied
from gateway.closure.inference.fit import Fit
from gateway.closure.inference.likelihood import Whitened, as_complex, as_real
from gateway.closure.inference.posterior import Posterior
from gateway.closure.inference.residual import POWER_SHARE
from gateway.closure.inference.set_evidence import Evaluated, log_evidence
from gateway.closure.model.baseline import NoShapeError
from gateway.closure.result import AxisError, HeldOut
from gateway.constants import AXIS_NAMES
from gateway.types import ComplexArray, FloatArray

# Sets among which the choice is repeated without each fold.
_MOST_SETS: Final = 6
_PLACES: Final = 3


@dataclass(frozen=True)
class _Fold:
    """Prediction of one fold by one set.

    Attributes:
        log_evidence: of the other folds.
        predicted: (3, ORDERS) of each group that has the fold, None elsewhere.
        with_discrepancy: likewise, its mean added.
    """

    log_evidence: float
    predicted: list[ComplexArray | None]
    with_discrepancy: list[ComplexArray | None]


@dataclass
class _Sums:
    """Sums of squares over held-out curves of each axis."""

    error: FloatArray
    weighted: FloatArray
    noise: FloatArray
    curves: FloatArray
    coefficients: FloatArray

    @classmethod
    def empty(cls) -> _Sums:
        return cls(*(np.zeros(_PLACES) for _ in range(5)))

    def add(self, error: ComplexArray, weight: FloatArray) -> None:
        used = weight > 0.0
        square = np.abs(error) ** 2 * used
        self.error += (POWER_SHARE * square).sum(axis=1)
        self.weighted += (square * np.square(weight)).sum(axis=1)
        self.noise += np.where(used, 1.0 / np.where(used, weight, 1.0) ** 2, 0.0).sum(axis=1)
        self.curves += used.any(axis=1)
        self.coefficients += 2.0 * used.sum(axis=1) - used[:, 0]

    def rms_mps2(self) -> float:
        return math.sqrt(float(self.error.sum()) / max(float(self.curves.sum()), 1.0))

    def noise_mps2(self) -> float:
        return math.sqrt(float(self.noise.sum()) / max(float(self.curves.sum()), 1.0))


@dataclass(frozen=True)
class HeldOutErrors:
    """Errors on held-out revolutions.

    Attributes:
        summary: before and after, by axis too.
        noise_mps2: rms that a perfect model would leave.
        with_discrepancy_mps2: rms with the mean of the discrepancy added.
        chosen: effects of the set that was chosen without each fold.
        rms_of: rms of each set that was followed through all folds.
    """

    summary: HeldOut
    noise_mps2: float
    with_discrepancy_mps2: float
    chosen: tuple[frozenset[str], ...]
    rms_of: dict[frozenset[str], float]


def hold_out(posterior: Posterior, data: Whitened, also: Sequence[Evaluated] = ()) -> HeldOutErrors:
    """Return the errors of every fold under what the other folds determine.

    Every fold of every group is held out once. The linearised fits are solved again without it, the discrepancy is
    predicted from the others, and the set is chosen by the evidence of the others.

    Args:
        posterior: over the sets.
        data: whitened.
        also: further sets whose error is wanted.
    """
    sets = {one.names: one for one in (*posterior.sets[:_MOST_SETS], posterior.baseline, *also)}
    folds = {names: _folds(one, data) for names, one in sets.items()}
    errors = {names: _Sums.empty() for names in sets}
    after, corrected = _Sums.empty(), _Sums.empty()
    chosen = []
    possible = [one.names for one in posterior.sets[:_MOST_SETS]]
    for fold in range(data.folds):
        best = max(possible, key=lambda names: (folds[names][fold].log_evidence, sorted(names)))
        chosen.append(best)
        for index, orders in enumerate(data.orders):
            if fold >= len(orders):
                continue
            weight = data.weights[index][fold]
            for names in sets:
                predicted = folds[names][fold].predicted[index]
                if predicted is not None:
                    errors[names].add(orders[fold] - predicted, weight)
            predicted, whole = folds[best][fold].predicted[index], folds[best][fold].with_discrepancy[index]
            if predicted is not None and whole is not None:
                after.add(orders[fold] - predicted, weight)
                corrected.add(orders[fold] - whole, weight)
    before = errors[frozenset()]
    revolutions = int(sum(count.sum() for count in data.counts))
    summary = HeldOut(before.rms_mps2(), after.rms_mps2(), revolutions, data.folds, _by_axis(before, after, corrected))
    return HeldOutErrors(
        summary,
        before.noise_mps2(),
        corrected.rms_mps2(),
        tuple(chosen),
        {names: sums.rms_mps2() for names, sums in errors.items()},
    )


def _by_axis(before: _Sums, after: _Sums, corrected: _Sums) -> tuple[AxisError, ...]:
    found = []
    for axis, name in enumerate(AXIS_NAMES):
        curves = float(before.curves[axis])
        if curves <= 0.0:
            continue

        def rms(square: FloatArray, at: int = axis, number: float = curves) -> float:
            return math.sqrt(float(square[at]) / number)

        def weighted(sums: _Sums, at: int = axis) -> float:
            return math.sqrt(float(sums.weighted[at]) / max(float(sums.coefficients[at]), 1.0))

        found.append(
            AxisError(
                axis=name,
                before_mps2=rms(before.error),
                after_mps2=rms(after.error),
                with_discrepancy_mps2=rms(corrected.error),
                noise_mps2=rms(before.noise),
                before_weighted=weighted(before),
                after_weighted=weighted(after),
            )
        )
    return tuple(found)


def _folds(one: Evaluated, data: Whitened) -> list[_Fold]:
    """Return the prediction of every fold by one set."""
    fit = one.fit
    if fit.applied is None:
        raise ValueError("a set is held out with its discrepancy")
    deviations = [_of_blocks(fit, data, index) for index in range(len(data.orders))]
    applied: dict[float, Applied] = {}
    return [_without(fit, data, deviations, fold, applied) for fold in range(data.folds)]


def _of_blocks(fit: Fit, data: Whitened, index: int) -> ComplexArray:
    """Return what the model predicts for each block beyond the group's mean, (blocks, 3, ORDERS)."""
    try:
        blocks = fit.model.predict_group(fit.vector, index)
    except NoShapeError:
        return np.zeros_like(data.orders[index])
    result: ComplexArray = blocks - data.mean(index, blocks)
    return result


def _without(
    fit: Fit, data: Whitened, deviations: Sequence[ComplexArray], fold: int, applied: dict[float, Applied]
) -> _Fold:
    """Return the prediction of one fold by the linear fit to the others."""
    if fit.applied is None:
        raise ValueError("a set is held out with its discrepancy")
    residuals, shares = [], []
    kept = total = 0.0
    for index, counts in enumerate(data.counts):
        others = counts.copy()
        if fold < len(counts) and len(counts) > 1:
            others[fold] = 0.0
        shares.append(float(others.sum() / counts.sum()))
        kept, total = kept + float(others.sum()), total + float(counts.sum())
        blocks = data.orders[index] - deviations[index]
        mean = np.tensordot(others / others.sum(), blocks, axes=1)
        residuals.append(fit.residual[index] + as_real(mean - data.mean(index, blocks)))
    # Folds of nearly the same size share one discrepancy: its information is that of the mean share.
    key = round(kept / total, 2)
    if key not in applied:
        applied[key] = fit.applied.discrepancy.thinned(key).applied(fit.applied.amplitudes)
    weights = [math.sqrt(share / key) for share in shares]
    thin = replace(
        fit,
        rows=tuple(weight * rows for weight, rows in zip(weights, fit.rows, strict=True)),
        residual=tuple(weight * residual for weight, residual in zip(weights, residuals, strict=True)),
        applied=applied[key],
    )
    step = thin.step
    there = thin.moved(step)
    predicted: list[ComplexArray | None] = []
    whole: list[ComplexArray | None] = []
    left = applied[key].mean([rows[-1] for rows in there.weighted])
    for index, counts in enumerate(data.counts):
        if fold >= len(counts) or len(counts) < 2:
            predicted.append(None)
            whole.append(None)
            continue
        by_edges = data.by_edges(index, there.weighted[index][-1], key)
        base = _predicted(fit, data, index, step) + deviations[index][fold] + by_edges
        predicted.append(base)
        own = base.copy()
        for state, axis, coefficients in left:
            if state == fit.model.campaign.groups[index].state:
                scales = fit.applied.discrepancy.scales(state, axis, index)
                own[axis] += as_complex(scales @ coefficients)
        whole.append(own)
    return _Fold(log_evidence(there), predicted, whole)


def _predicted(fit: Fit, data: Whitened, index: int, step: FloatArray) -> ComplexArray:
    """Return the group's prediction after a step, (3, ORDERS), by the linearised model."""
    left = fit.residual[index] - np.tensordot(step, fit.rows[index], axes=1)
    return data.mean(index, data.orders[index]) - as_complex(left)
