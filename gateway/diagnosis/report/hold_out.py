"""Error on held-out revolutions: parameters, discrepancy and choice of the set without the fold that is predicted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Final, Self

import numpy as np

from gateway.core.constants import AXIS_NAMES
from gateway.core.reasons import Reason
from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.discrepancy import Applied
from gateway.diagnosis.angle.fit import Fit, FitFailedError, fit_model
from gateway.diagnosis.angle.likelihood import Whitened, as_complex, as_real
from gateway.diagnosis.angle.residual import PLANE, POWER_SHARE, residual_ratio
from gateway.diagnosis.angle.set_evidence import Evaluated, log_evidence
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.data.contact_edge_timing import TERMS
from gateway.diagnosis.model.baseline import NoShapeError
from gateway.diagnosis.model.closure_model import ClosureModel
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import AsRecorded, AxisError, BlockError, HeldOut
from gateway.diagnosis.search.tempered_posterior import Posterior

# Sets among which the choice is repeated without each fold.
_MOST_SETS: Final = 6
_PLACES: Final = 3
# Ratio of an error as recorded to that with aligned contact edges from which the report names the alignment.
_ALIGNED: Final = 1.02


@dataclass(frozen=True)
class _Fold:
    """Prediction of one fold by one set.

    Attributes:
        log_evidence: of the other folds.
        predicted: (3, ORDERS) of each group that has the fold, None elsewhere.
        with_discrepancy: likewise, its mean added.
        at_best: likewise, with the tire's own parameters of the least error; None where those are no others.
    """

    log_evidence: float
    predicted: list[ComplexArray | None]
    with_discrepancy: list[ComplexArray | None]
    at_best: list[ComplexArray | None] | None = None


@dataclass
class _Sums:
    """Sums of squares over held-out curves of each axis."""

    error: FloatArray
    weighted: FloatArray
    noise: FloatArray
    curves: FloatArray
    coefficients: FloatArray

    @classmethod
    def empty(cls) -> Self:
        return cls(*(np.zeros(_PLACES) for _ in range(5)))

    @classmethod
    def over(cls, predicted: Sequence[Sequence[ComplexArray | None]], data: Whitened) -> Self:
        """Return the sums of what is predicted for each fold and group."""
        sums = cls.empty()
        for fold, group_predictions in enumerate(predicted):
            for index, orders in enumerate(data.orders):
                if (prediction := group_predictions[index]) is not None:
                    sums.add(orders[fold] - prediction, data.weights[index][fold])
        return sums

    def add(self, error: ComplexArray, weight: FloatArray) -> None:
        is_used = weight > 0.0
        square = np.abs(error) ** 2 * is_used
        self.error += (POWER_SHARE * square).sum(axis=1)
        self.weighted += (square * np.square(weight)).sum(axis=1)
        self.noise += np.where(is_used, 1.0 / np.where(is_used, weight, 1.0) ** 2, 0.0).sum(axis=1)
        self.curves += is_used.any(axis=1)
        self.coefficients += 2.0 * is_used.sum(axis=1) - is_used[:, 0]

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
        fit_of: fit to all folds of each of these, with the tire's own parameters whose error is given.
    """

    summary: HeldOut
    noise_mps2: float
    with_discrepancy_mps2: float
    chosen: tuple[frozenset[str], ...]
    rms_of: dict[frozenset[str], float]
    fit_of: dict[frozenset[str], Fit]


def hold_out(posterior: Posterior, data: Whitened, also: Sequence[Evaluated] = ()) -> HeldOutErrors:
    """Return the errors of every fold under what the other folds determine.

    Every fold of every group is held out once. The linearised fits are solved again without it, the discrepancy is
    predicted from the others, and the set is chosen by the evidence of the others.

    Every set is taken at its best: where it leaves much, the tire's own parameters of the highest evidence give room to
    the discrepancy, and those of least squares beside the same effects have the smaller error. Otherwise an effect
    would be credited with what a better fit of the ring alone does.

    Args:
        posterior: over the sets.
        data: whitened.
        also: further sets whose error is wanted.
    """
    sets = {evaluated.names: evaluated for evaluated in (*posterior.sets[:_MOST_SETS], posterior.baseline, *also)}
    refits = {names: _least_squares(evaluated.fit, data) for names, evaluated in sets.items()}
    folds = {names: _at_its_best(_folds(evaluated, data, refits[names]), data) for names, evaluated in sets.items()}
    chosen = _chosen({evaluated.names: folds[evaluated.names] for evaluated in posterior.sets[:_MOST_SETS]}, data.folds)
    errors = {names: _Sums.over([fold.predicted for fold in folds[names]], data) for names in sets}
    followed = [folds[names][fold] for fold, names in enumerate(chosen)]
    after = _Sums.over([fold.predicted for fold in followed], data)
    corrected = _Sums.over([fold.with_discrepancy for fold in followed], data)
    before = errors[frozenset()]
    curves = _curves(
        posterior.best.fit.model.campaign,
        data,
        [fold.predicted for fold in folds[frozenset()]],
        [fold.predicted for fold in followed],
    )
    summary = HeldOut(
        before.rms_mps2(),
        after.rms_mps2(),
        int(sum(count.sum() for count in data.counts)),
        data.folds,
        _by_axis(before, after, corrected),
        *jackknife([curve.sums for curve in curves], [curve.axes for curve in curves]),
        blocks=tuple(curve.block for curve in curves),
        as_recorded=_as_recorded(curves),
    )
    return HeldOutErrors(
        summary,
        before.noise_mps2(),
        corrected.rms_mps2(),
        tuple(chosen),
        {names: sums.rms_mps2() for names, sums in errors.items()},
        {names: (folds[names][0].at_best and refits[names]) or evaluated.fit for names, evaluated in sets.items()},
    )


@dataclass(frozen=True, slots=True)
class _Curve:
    """Errors of one block.

    Attributes:
        block: for the report.
        axes: number of axes.
        sums: (2,) squares over all axes, before and after.
        as_recorded: likewise on its revolutions without alignment; None where they are not aligned.
    """

    block: BlockError
    axes: float
    sums: FloatArray
    as_recorded: FloatArray | None


def _curves(
    campaign: Campaign,
    data: Whitened,
    before: Sequence[Sequence[ComplexArray | None]],
    after: Sequence[Sequence[ComplexArray | None]],
) -> list[_Curve]:
    """Return the errors of every block; predictions are by fold and group."""
    curves = []
    for index, group in enumerate(campaign.groups):
        for fold, block in enumerate(group.blocks):
            predicted = before[fold][index], after[fold][index]
            if predicted[0] is None or predicted[1] is None:
                continue
            weight = data.weights[index][fold]
            variants = [data.orders[index][fold]]
            if block.as_recorded_mps2 is not None:
                variants.append(variants[0] + np.nan_to_num(block.as_recorded_mps2 - block.orders_mps2))
            sums = [_Sums.empty() for _ in range(2 * len(variants))]
            for number, (orders, prediction) in enumerate(product(variants, predicted)):
                sums[number].add(orders - prediction, weight)
            squares = np.array([total.error.sum() for total in sums])
            axes = float(sums[0].curves.sum())
            rms = np.sqrt(squares / max(axes, 1.0)).tolist()
            block_error = BlockError(group.label, block.count, block.conditions.time_s, rms[0], rms[1])
            curves.append(_Curve(block_error, axes, squares[:2], squares[2:] if len(variants) > 1 else None))
    return curves


def jackknife(sums: Sequence[FloatArray], counts: Sequence[float]) -> tuple[float, float, float]:
    """Return standard errors of the rms before and after, and of their ratio, leaving out one block at a time.

    Args:
        sums: of squares before and after in each block, (2,) each.
        counts: of what is summed in each block.

    Returns:
        NaN with fewer than two blocks.
    """
    number = len(sums)
    if number < 2:
        return math.nan, math.nan, math.nan
    squares, weights = np.array(sums), np.array(counts)[:, None]
    rms = np.sqrt((squares.sum(axis=0) - squares) / np.maximum(weights.sum() - weights, 1.0))
    ratio = rms[:, 1] / np.maximum(rms[:, 0], 1e-300)
    statistics = np.column_stack([rms, ratio])
    first, second, third = np.sqrt((number - 1.0) * statistics.var(axis=0)).tolist()
    return first, second, third


def _as_recorded(curves: Sequence[_Curve]) -> AsRecorded | None:
    """Return the errors without alignment of the contact edges; None where nothing is aligned."""
    aligned = sum(curve.block.revolutions for curve in curves if curve.as_recorded is not None)
    if not aligned:
        return None
    squares = sum(curve.sums if curve.as_recorded is None else curve.as_recorded for curve in curves)
    before, after = np.sqrt(squares / sum(curve.axes for curve in curves)).tolist()
    return AsRecorded(before, after, aligned, TERMS * aligned)


def alignment_note(held_out: HeldOut) -> tuple[Reason, ...]:
    """Return the note on revolutions whose contact edges are aligned, with the errors as recorded, where it matters."""
    raw = held_out.as_recorded
    if (
        raw is None
        or max(raw.rms_before_mps2 / held_out.rms_before_mps2, raw.rms_after_mps2 / held_out.rms_after_mps2) <= _ALIGNED
    ):
        return ()
    return (
        Reason(
            DiagnosisCode.EDGES_ALIGNED,
            revolutions=raw.revolutions,
            parameters=raw.parameters,
            before_mps2=raw.rms_before_mps2,
            after_mps2=raw.rms_after_mps2,
        ),
    )


def _least_squares(fit: Fit, data: Whitened) -> Fit | None:
    """Return the fit of the tire's own parameters beside the same effects by the scatter alone, where much is left."""
    if residual_ratio(fit, data, PLANE) < criteria.TEMPERED:
        return None
    model = fit.model
    fixed = {effect.name: fit.vector[model.layout.effect(effect.name)] for effect in model.effects}
    try:
        return fit_model(ClosureModel(model.campaign, model.core, model.effects, held=fixed), data, fit.vector)
    except FitFailedError:
        return None


def _at_its_best(folds: list[_Fold], data: Whitened) -> list[_Fold]:
    """Return the folds with the predictions of the smaller error: by the evidence, or by least squares."""
    at_best = [fold.at_best for fold in folds if fold.at_best is not None]
    if not at_best:
        return folds
    by_evidence, by_scatter = _Sums.over([fold.predicted for fold in folds], data), _Sums.over(at_best, data)
    if by_evidence.rms_mps2() <= by_scatter.rms_mps2():
        return [replace(fold, at_best=None) for fold in folds]
    return [replace(fold, predicted=predicted) for fold, predicted in zip(folds, at_best, strict=True)]


def _chosen(folds: Mapping[frozenset[str], Sequence[_Fold]], count: int) -> list[frozenset[str]]:
    """Return the set that has the highest evidence without each fold."""

    def best_without(fold: int) -> frozenset[str]:
        return max(folds, key=lambda names: (folds[names][fold].log_evidence, sorted(names)))

    return [best_without(fold) for fold in range(count)]


def _by_axis(before: _Sums, after: _Sums, corrected: _Sums) -> tuple[AxisError, ...]:
    errors = []
    for axis, name in enumerate(AXIS_NAMES):
        curves = float(before.curves[axis])
        if curves <= 0.0:
            continue

        def rms(square: FloatArray, index: int = axis, number: float = curves) -> float:
            return math.sqrt(float(square[index]) / number)

        def weighted(sums: _Sums, index: int = axis) -> float:
            return math.sqrt(float(sums.weighted[index]) / max(float(sums.coefficients[index]), 1.0))

        errors.append(
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
    return tuple(errors)


def _folds(evaluated: Evaluated, data: Whitened, refit: Fit | None) -> list[_Fold]:
    """Return the prediction of every fold by one set."""
    fit = evaluated.fit
    deviations = [_of_blocks(fit, data, index) for index in range(len(data.orders))]
    applied: dict[float, Applied] = {}
    return [_fold_prediction(fit, refit, data, deviations, fold, applied) for fold in range(data.folds)]


def _of_blocks(fit: Fit, data: Whitened, index: int) -> ComplexArray:
    """Return what the model predicts for each block beyond the group's mean, (blocks, 3, ORDERS)."""
    try:
        blocks = fit.model.predict_group(fit.vector, index)
    except NoShapeError:
        return np.zeros_like(data.orders[index])
    result: ComplexArray = blocks - data.mean(index, blocks)
    return result


def _fold_prediction(
    fit: Fit,
    refit: Fit | None,
    data: Whitened,
    deviations: Sequence[ComplexArray],
    fold: int,
    applied: dict[float, Applied],
) -> _Fold:
    """Return the prediction of one fold by the linear fit to the others."""
    if fit.applied is None:
        raise ValueError("a set is held out with its discrepancy")
    thin, share = _thinned(fit, data, deviations, fold)
    # Folds of nearly the same size share one discrepancy: its information is that of the mean share.
    if share not in applied:
        applied[share] = fit.applied.discrepancy.thinned(share).applied(fit.applied.amplitudes)
    thin = replace(thin, applied=applied[share])
    updated = thin.moved(thin.step)
    base = _predicted(fit, updated, data, deviations, fold, share)
    discrepancy_means = applied[share].mean([rows[-1] for rows in updated.weighted])
    with_discrepancy: list[ComplexArray | None] = [
        None if predicted is None else predicted + as_complex(mean)
        for predicted, mean in zip(base, discrepancy_means, strict=True)
    ]
    if refit is None:
        return _Fold(log_evidence(updated), base, with_discrepancy)
    # Its effects are those that the other folds determine, the tire's own parameters those of the least error beside.
    change = np.zeros(len(refit.vector))
    for effect in refit.model.effects:
        indices = refit.model.layout.effect(effect.name)
        change[indices] = (updated.vector - refit.vector)[indices]
    thin_refit = _thinned(refit, data, deviations, fold)[0].moved(change)
    thin_refit = replace(thin_refit, prior_mean=thin_refit.prior_mean + change)
    refit_prediction = _predicted(refit, thin_refit.moved(thin_refit.step), data, deviations, fold, share)
    return _Fold(log_evidence(updated), base, with_discrepancy, refit_prediction)


def _thinned(fit: Fit, data: Whitened, deviations: Sequence[ComplexArray], fold: int) -> tuple[Fit, float]:
    """Return a linearised fit with the data of the other folds, each group weighted by its share, and their share."""
    residuals, shares = [], []
    used = total = 0.0
    for index, counts in enumerate(data.counts):
        others = counts.copy()
        if fold < len(counts) and len(counts) > 1:
            others[fold] = 0.0
        shares.append(float(others.sum() / counts.sum()))
        used, total = used + float(others.sum()), total + float(counts.sum())
        blocks = data.orders[index] - deviations[index]
        mean = np.tensordot(others / others.sum(), blocks, axes=1)
        residuals.append(fit.residual[index] + as_real(mean - data.mean(index, blocks)))
    share = round(used / total, 2)
    weights = [math.sqrt(group_share / share) for group_share in shares]
    thin = replace(
        fit,
        rows=tuple(weight * rows for weight, rows in zip(weights, fit.rows, strict=True)),
        residual=tuple(weight * residual for weight, residual in zip(weights, residuals, strict=True)),
    )
    return thin, share


def _predicted(
    fit: Fit, updated: Fit, data: Whitened, deviations: Sequence[ComplexArray], fold: int, share: float
) -> list[ComplexArray | None]:
    """Return the prediction of a fold in every group that has it, (3, ORDERS), by the linearised model.

    Args:
        fit: where the model is linearised.
        updated: at the parameters that the other folds determine.
        data: whitened.
        deviations: of each block from its group's mean.
        fold: to predict.
        share: of the other folds.
    """
    step = updated.vector - fit.vector
    predicted: list[ComplexArray | None] = []
    for index, counts in enumerate(data.counts):
        if fold >= len(counts) or len(counts) < 2:
            predicted.append(None)
            continue
        residual = fit.residual[index] - np.tensordot(step, fit.rows[index], axes=1)
        base = data.mean(index, data.orders[index]) - as_complex(residual)
        predicted.append(base + deviations[index][fold] + data.by_edges(index, updated.weighted[index][-1], share))
    return predicted
