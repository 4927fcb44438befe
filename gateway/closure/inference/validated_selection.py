"""Selection combined with hold-out: an effect is identified only if it is found again without each part of the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.effects.catalogue import candidates
from gateway.closure.effects.effect import BaselineModel
from gateway.closure.inference.findings import findings_of, refused
from gateway.closure.inference.fit import Fit, FitFailedError, fit_model
from gateway.closure.inference.forward_selection import Selection, select
from gateway.closure.inference.hold_out import FoldError, HoldOut, agreement
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.inference.rolling_direction import turned_round
from gateway.closure.model.baseline import Core
from gateway.closure.model.baseline_registry import angle_effects
from gateway.closure.model.closure_model import ClosureModel
from gateway.closure.result import Finding
from gateway.errors import TreadlinkError
from gateway.reasons import Code, Reason

Progress = Callable[[float, str], None]

# Folds of the nested hold-out: each runs the whole selection again.
_OUTER_FOLDS: Final = 5
# Share of folds that must find an effect on their own for it to be named.
_AGREEING: Final = 0.5
# Shares of the time at which selection and hold-out end.
_SELECTED, _HELD_OUT = 0.4, 0.8


@dataclass(frozen=True, slots=True)
class Closed:
    """A selection confirmed by hold-out, the errors of its folds, and the finding of every effect.

    Attributes:
        selection: the last selection.
        errors: errors of its folds.
        findings: finding of every effect.
        undecided: for every effect with confounders the fits with each of them in its place.
    """

    selection: Selection
    errors: list[FoldError]
    findings: list[Finding]
    undecided: list[tuple[Fit, ...]]


def close_loop(
    campaign: Campaign,
    core: Core,
    data: Whitened,
    model: BaselineModel,
    on_progress: Callable[[float, str], None],
    jobs: int,
) -> Closed:
    """Select and hold out; an effect that most folds do not find on their own is excluded, and both are repeated.

    Raises:
        TreadlinkError: the baseline model cannot be fitted, or a recording contradicts its stated direction.
    """
    on_progress = _Forward(on_progress)
    every = angle_effects(candidates(model))
    unsteady: dict[str, Finding] = {}
    try:
        first = fit_model(ClosureModel(campaign, core), data, from_afar=True)
    except FitFailedError as error:
        raise _cannot_be_fitted(model, error) from error
    _check_directions(first, data)
    start = first.vector
    folds = range(min(data.folds, _OUTER_FOLDS))
    while True:
        # The loop ends, since every pass removes at least one candidate.
        effects = {name: effect for name, effect in every.items() if name not in unsteady}
        without = frozenset(unsteady)
        with HoldOut(campaign, model, start, folds, without=without, jobs=jobs) as held_out:
            try:
                selection = select(campaign, core, data, effects, start=start, on_step=_Steps(on_progress))
            except FitFailedError as error:
                raise _cannot_be_fitted(model, error) from error
            errors = held_out.errors(partial(_held, on_progress, len(folds)))
        found_in = agreement(errors)
        doubtful = [s for s in selection.steps if found_in.get(s.effect.name, 0) < _AGREEING * len(errors)]
        if not doubtful:
            break
        for step in doubtful:
            times = found_in.get(step.effect.name, 0)
            reason = Reason(Code.FOUND_IN_FEW_FOLDS, found=times, folds=len(errors))
            unsteady[step.effect.name] = refused(step, selection.final, reason)
    on_progress(_HELD_OUT, "comparing confounders")
    findings, undecided = findings_of(selection, selection.data, every)
    return Closed(selection, errors, [*findings, *unsteady.values()], undecided)


def _cannot_be_fitted(model: BaselineModel, error: FitFailedError) -> TreadlinkError:
    return TreadlinkError(
        f"the baseline model '{model}' cannot be fitted to these recordings: {error}",
        "Check belt radius, load and pressure in the configuration.",
    )


def _check_directions(fit: Fit, data: Whitened) -> None:
    """Reject recordings that contradict their stated direction, which no effect could correct.

    Raises:
        TreadlinkError: one does.
    """
    campaign = fit.model.campaign
    wrong = turned_round(fit, data)
    if not wrong:
        return
    stated = {group.recording for group in campaign.groups if group.conditions.reverse}
    remedies = [
        f"remove --reverse {campaign.recordings[number]}"
        if number in stated
        else f"add --reverse {campaign.recordings[number]}"
        for number in wrong
    ]
    raise TreadlinkError(
        "the sign of the circumferential axis is opposite to that of a rolling tire in "
        + ", ".join(f"'{campaign.recordings[number]}'" for number in wrong),
        f"If the tire rolled in the opposite direction, {' and '.join(remedies)}; otherwise the sensor's axis points "
        "backwards: record or import it with the sign reversed.",
    )


class _Forward:
    """Forwarder of progress that never decreases, since selection and hold-out may be repeated."""

    def __init__(self, on_progress: Progress) -> None:
        self._on_progress = on_progress
        self._share = 0.0

    def __call__(self, share: float, text: str) -> None:
        self._share = max(self._share, share)
        self._on_progress(self._share, text)


class _Steps:
    """Converter of selection steps, whose number is unknown beforehand, to a growing share."""

    def __init__(self, on_progress: Progress) -> None:
        self._on_progress = on_progress
        self._steps = 0

    def __call__(self, text: str) -> None:
        self._steps += 1
        self._on_progress(_SELECTED * (1.0 - 0.85**self._steps), text)


def _held(on_progress: Progress, folds: int, done: int) -> None:
    on_progress(_SELECTED + (_HELD_OUT - _SELECTED) * done / folds, "computing held-out errors")
