"""Selection and hold-out together: what is called by its name has been found again without each part of the data."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Final

from gateway.closure.cores import Core
from gateway.closure.diagnosis import Finding
from gateway.closure.direction import turned_round
from gateway.closure.effects.base import BaselineModel
from gateway.closure.effects.catalogue import candidates
from gateway.closure.findings import findings_of, refused
from gateway.closure.fit import Fit, FitFailedError, fit_model
from gateway.closure.held_out import FoldError, HoldOut, agreement
from gateway.closure.likelihood import Whitened
from gateway.closure.model import ClosureModel
from gateway.closure.observation import Campaign
from gateway.closure.selection import Selection, select
from gateway.closure.starting import angle_effects
from gateway.errors import TreadlinkError

Progress = Callable[[float, str], None]

# Folds of the nested hold-out: each runs the whole selection again.
_OUTER_FOLDS: Final = 5
# Share of folds that must have come to an effect by themselves for it to be called by its name.
_AGREEING: Final = 0.5
# Shares of the time at which selecting, holding out and comparing rivals end.
_SELECTED, _HELD_OUT = 0.4, 0.8


@dataclass(frozen=True, slots=True)
class Closed:
    """A selection that holds out, the errors of its folds, and what became of every effect.

    Attributes:
        selection: the last one.
        errors: of its folds.
        findings: what became of every effect.
        undecided: for every effect with rivals the fits with each of them in its place.
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
    """Select, and hold out; an effect that most folds do not come to by themselves is taken out, and all done again.

    Raises:
        TreadlinkError: the starting model cannot be fitted, or a recording is of the other direction than stated.
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
        # Ends: every time around there is one candidate less at least.
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
            reason = f"found in {times} of {len(errors)} folds only when one fold is left out"
            unsteady[step.effect.name] = refused(step, selection.final, reason)
    on_progress(_HELD_OUT, "comparing rivals")
    findings, undecided = findings_of(selection, selection.data, every)
    return Closed(selection, errors, [*findings, *unsteady.values()], undecided)


def _cannot_be_fitted(model: BaselineModel, error: FitFailedError) -> TreadlinkError:
    return TreadlinkError(
        f"the starting model '{model}' cannot be fitted to these recordings: {error}",
        "Check belt radius, load and pressure in the configuration.",
    )


def _check_directions(fit: Fit, data: Whitened) -> None:
    """Refuse recordings that contradict the direction they are said to be of: no effect could make good for that.

    Raises:
        TreadlinkError: one does.
    """
    campaign = fit.model.campaign
    wrong = turned_round(fit, data)
    if not wrong:
        return
    stated = {group.recording for group in campaign.groups if group.conditions.reverse}
    remedies = [
        f"leave out --reverse {campaign.recordings[number]}"
        if number in stated
        else f"say --reverse {campaign.recordings[number]}"
        for number in wrong
    ]
    raise TreadlinkError(
        "the circumferential axis is the opposite of a rolling tire's in "
        + ", ".join(f"'{campaign.recordings[number]}'" for number in wrong),
        f"If the tire rolled the other way round than stated, {' and '.join(remedies)}; if it did not, "
        "the sensor's axis points backwards: record or import it with its sign turned.",
    )


class _Forward:
    """Passes progress on, but never back: selecting and holding out may begin anew."""

    def __init__(self, on_progress: Progress) -> None:
        self._on_progress = on_progress
        self._share = 0.0

    def __call__(self, share: float, text: str) -> None:
        self._share = max(self._share, share)
        self._on_progress(self._share, text)


class _Steps:
    """Turns the steps of a selection, whose number nobody knows beforehand, into a share that always grows."""

    def __init__(self, on_progress: Progress) -> None:
        self._on_progress = on_progress
        self._steps = 0

    def __call__(self, text: str) -> None:
        self._steps += 1
        self._on_progress(_SELECTED * (1.0 - 0.85**self._steps), text)


def _held(on_progress: Progress, folds: int, done: int) -> None:
    on_progress(_SELECTED + (_HELD_OUT - _SELECTED) * done / folds, "holding out")
