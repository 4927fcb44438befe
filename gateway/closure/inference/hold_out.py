"""Nested hold-out: the whole selection is repeated without a fold and evaluated on that fold."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field, replace
from functools import partial
from types import TracebackType

import numpy as np

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.effects.catalogue import candidates
from gateway.closure.effects.effect import BaselineModel
from gateway.closure.inference.fit import Fit, FitFailedError
from gateway.closure.inference.forward_selection import select
from gateway.closure.inference.likelihood import Whitened, whiten
from gateway.closure.inference.residual import POWER_SHARE, group_residuals, standing_out
from gateway.closure.inference.worker_pool import Processes
from gateway.closure.model.baseline_registry import angle_effects, make_core
from gateway.closure.result import HeldOut
from gateway.types import ComplexArray, FloatArray


@dataclass(frozen=True, slots=True)
class FoldError:
    """Errors on one fold that was held out of the fit.

    Attributes:
        before: sum of squares of the baseline model's error, (m/s^2)^2.
        after: with the effects that the other folds selected.
        empirical: with the mean residual of the other folds added as well.
        noise: lower limit set by the scatter of revolutions.
        curves: number of waveforms in the sums.
        revolutions: number held out.
        effects: names selected without this fold.
        states: share of each tire state in the sums `after` and `noise`: state -> (after, noise).
    """

    before: float
    after: float
    empirical: float
    noise: float
    curves: int
    revolutions: int
    effects: tuple[str, ...]
    states: Mapping[int, tuple[float, float]] = field(default_factory=dict)


class HoldOut:
    """Nested hold-out of several folds, in other processes while the caller continues.

    A context manager: on exit, folds that have not started are cancelled.
    """

    def __init__(
        self,
        campaign: Campaign,
        model: BaselineModel,
        start: FloatArray,
        folds: Sequence[int],
        *,
        without: frozenset[str] = frozenset(),
        jobs: int = 1,
    ) -> None:
        """Start `jobs` - 1 processes.

        Args:
            campaign: the data.
            model: baseline model.
            start: initial parameter vector.
            folds: indices of the folds.
            without: effects excluded from the candidates.
            jobs: number of processes, the caller's included.
        """
        self._folds = tuple(folds)
        # The samples of the deviations are not needed there, and are most of a campaign's size.
        light = replace(campaign, groups=tuple(replace(group, deviations_mps2=()) for group in campaign.groups))
        self._fold = partial(hold_out_fold, light, model, start, without=without)
        others = min(jobs - 1, len(self._folds))
        self._pool = Processes(others) if others > 0 else None
        self._waiting = {fold: self._pool.submit(self._fold, fold) for fold in self._folds} if self._pool else {}

    def __enter__(self) -> HoldOut:
        """Return this hold-out."""
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Cancel folds that have not started."""
        if self._pool is not None:
            self._pool.__exit__(kind, error, trace)

    def errors(self, on_fold: Callable[[int], None] = lambda _: None) -> list[FoldError]:
        """Compute in this process the folds that no other has started, and wait for the rest.

        Args:
            on_fold: called with the number of folds done.

        Returns:
            the folds' errors in order; a fold is missing if the fit without it fails.
        """
        found: dict[int, FoldError | None] = {}
        for fold in reversed(self._folds):
            if fold not in self._waiting or self._waiting[fold].cancel():
                self._waiting.pop(fold, None)
                found[fold] = self._fold(fold)
                on_fold(len(found) + sum(future.done() for future in self._waiting.values()))
        for future in as_completed(self._waiting.values()):
            future.result()
            on_fold(len(found) + sum(future.done() for future in self._waiting.values()))
        found.update((fold, future.result()) for fold, future in self._waiting.items())
        return [error for fold in self._folds if (error := found[fold]) is not None]


def hold_out(
    campaign: Campaign,
    model: BaselineModel,
    start: FloatArray,
    folds: Sequence[int],
    *,
    without: frozenset[str] = frozenset(),
    jobs: int = 1,
    on_fold: Callable[[int], None] = lambda _: None,
) -> list[FoldError]:
    """Run the nested hold-out of several folds and wait for it; see `HoldOut`."""
    with HoldOut(campaign, model, start, folds, without=without, jobs=jobs) as held_out:
        return held_out.errors(on_fold)


def hold_out_fold(
    campaign: Campaign, model: BaselineModel, start: FloatArray, fold: int, without: frozenset[str] = frozenset()
) -> FoldError | None:
    """Return the error of one fold under the fit of all others; None if that fit fails.

    Args:
        campaign: the data.
        model: baseline model.
        start: initial parameter vector; it only starts the search, so nothing leaks from the fold.
        fold: index of the fold.
        without: effects excluded from the candidates.
    """
    core = make_core(model)
    data = whiten(campaign, with_mean=core.mean, unseen=fold)
    effects = {name: e for name, e in angle_effects(candidates(model)).items() if name not in without}
    try:
        selection = select(campaign, core, data.without(fold), effects, start=start)
    except FitFailedError:
        return None
    final = selection.final
    added = _empirical(final, selection.data)
    every = range(len(campaign.groups))
    before, _, curves = _squares(selection.start.predicted, data, fold, every)
    after, noise, _ = _squares(final.predicted, data, fold, every)
    states = {}
    for state in range(campaign.states):
        own = [index for index in every if campaign.groups[index].state == state]
        left, least, count = _squares(final.predicted, data, fold, own)
        if count:
            states[state] = left, least
    corrected = tuple(there + correction for there, correction in zip(final.predicted, added, strict=True))
    empirical, _, _ = _squares(corrected, data, fold, every)
    revolutions = sum(group.blocks[fold].count for group in campaign.groups if fold < len(group.blocks))
    names = tuple(effect.name for effect in final.model.effects)
    return FoldError(before, after, empirical, noise, curves, revolutions, names, states)


def summary(errors: Sequence[FoldError]) -> tuple[HeldOut, float, float]:
    """Return the figures of all folds, the noise floor, and the rms with the empirical correction, m/s^2."""
    curves = max(1, sum(error.curves for error in errors))

    def rms(total: float) -> float:
        return math.sqrt(total / curves)

    held_out = HeldOut(
        rms(sum(error.before for error in errors)),
        rms(sum(error.after for error in errors)),
        sum(error.revolutions for error in errors),
        len(errors),
    )
    return held_out, rms(sum(e.noise for e in errors)), rms(sum(e.empirical for e in errors))


def over_noise(errors: Sequence[FoldError]) -> Mapping[int, float]:
    """Return the ratio of the error with effects to the noise floor, for every held-out tire state."""
    after: dict[int, float] = {}
    noise: dict[int, float] = {}
    for error in errors:
        for state, (left, least) in error.states.items():
            after[state] = after.get(state, 0.0) + left
            noise[state] = noise.get(state, 0.0) + least
    return {state: math.sqrt(left / noise[state]) if noise[state] > 0.0 else math.inf for state, left in after.items()}


def agreement(errors: Sequence[FoldError]) -> Mapping[str, int]:
    """Return the number of folds in which each effect was found."""
    found: dict[str, int] = {}
    for error in errors:
        for name in error.effects:
            found[name] = found.get(name, 0) + 1
    return found


def _squares(
    predicted: Sequence[ComplexArray], data: Whitened, fold: int, groups: Iterable[int]
) -> tuple[float, float, int]:
    """Return the sums over groups and axes of the mean square error and of the noise, and the number of waveforms."""
    error = noise = 0.0
    curves = 0
    for index in groups:
        there, orders, weight = predicted[index], data.orders[index], data.weights[index]
        if fold >= len(orders):
            continue
        used = weight[fold] > 0.0
        error += float((POWER_SHARE * np.abs(orders[fold] - there[fold]) ** 2 * used).sum())
        noise += float((1.0 / np.square(weight[fold][used])).sum())
        curves += int(used.any(axis=1).sum())
    return error, noise, curves


def _empirical(fit: Fit, data: Whitened) -> list[ComplexArray]:
    """Return the mean residual of every group where it exceeds the noise, (3, ORDERS) each."""
    residuals = group_residuals(fit, data)
    keep = standing_out(residuals)
    return [np.where(keep, residual.orders_mps2, 0.0)[None] for residual in residuals]
