"""Forward selection over the catalogue: which effects the starting model lacks."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.closure import gates
from gateway.closure.cores import Core
from gateway.closure.fit import Fit, FitFailedError, fit_model
from gateway.closure.likelihood import Whitened
from gateway.closure.model import AngleEffect, ClosureModel
from gateway.closure.observation import Campaign
from gateway.closure.rivals import fit_without
from gateway.closure.trial import Trial, refit, try_effect

FloatArray = NDArray[np.float64]

# Trials refitted in earnest at a step, and the share of the best promise that makes a trial worth it.
_REFITTED: Final = 6
_WORTH: Final = 0.3
_MOST_EFFECTS: Final = 10


@dataclass(frozen=True, slots=True)
class Step:
    """One effect added.

    Attributes:
        effect: which.
        before: the fit without it.
        after: the fit with it.
        gain: (K,) fall of each fold's held-out misfit.
    """

    effect: AngleEffect
    before: Fit
    after: Fit
    gain: FloatArray


@dataclass(slots=True)
class Selection:
    """What a selection came to.

    Attributes:
        start: the starting model's fit.
        steps: effects added, in order.
        refused: effect -> (reason, fall of the misfit, gain by fold, fit with it).
    """

    start: Fit
    steps: list[Step] = field(default_factory=list)
    refused: dict[str, tuple[str, float, FloatArray, Fit]] = field(default_factory=dict)

    @property
    def final(self) -> Fit:
        """The fit with every effect that was added."""
        return self.steps[-1].after if self.steps else self.start


def select(
    campaign: Campaign,
    core: Core,
    data: Whitened,
    effects: Mapping[str, AngleEffect],
    *,
    start: FloatArray | None = None,
    on_step: Callable[[str], None] = lambda _: None,
) -> Selection:
    """Add effects as long as the data ask for one that passes every gate.

    Args:
        campaign: conditions.
        core: starting model.
        data: whitened; folds of weight 0 are not seen.
        effects: candidates by name.
        start: vector of the starting model to begin from.
        on_step: told what is being done.

    Raises:
        FitFailedError: the starting model cannot be fitted.
    """
    on_step("fitting the starting model")
    first = fit_model(ClosureModel(campaign, core), data, start, from_afar=start is None)
    selection = Selection(first)
    while len(selection.steps) < _MOST_EFFECTS:
        fit = selection.final
        on_step(f"looking for effect {len(selection.steps) + 1}")
        taken = {effect.name for effect in fit.model.effects}
        left = [effect for name, effect in effects.items() if name not in taken]
        step = _best_step(fit, data, left, selection)
        if step is None:
            break
        selection.steps.append(step)
        on_step(f"found {step.effect.name}")
        _prune(selection, data)
    _judge_leftovers(selection, data)
    return selection


def _best_step(fit: Fit, data: Whitened, left: list[AngleEffect], selection: Selection) -> Step | None:
    """Return the best candidate that passes; note why others did not."""
    before = fit.held_out()
    promising = _promising(fit, data, left, before)
    fitted: list[tuple[Trial, Fit]] = []
    for trial in promising[:_REFITTED]:
        try:
            fitted.append((trial, refit(trial, data)))
        except FitFailedError:
            continue
    passed: list[tuple[Trial, Fit, FloatArray]] = []
    for trial, after in fitted:
        gain = before - after.held_out()
        scale = gates.overdispersion(after, data)
        reason = _reason_against(fit, after, trial.effect, gain, scale)
        if reason is None:
            continue
        if reason:
            selection.refused[trial.effect.name] = (reason, fit.misfit - after.misfit, gain, after)
        else:
            passed.append((trial, after, gain))
    if not passed:
        return None
    passed.sort(key=lambda entry: entry[1].misfit)
    trial, after, gain = passed[0]
    selection.refused.pop(trial.effect.name, None)
    return Step(trial.effect, fit, after, gain)


def _promising(fit: Fit, data: Whitened, left: list[AngleEffect], before: FloatArray) -> list[Trial]:
    """Return trials that promise something, best first."""
    scale = 1.0
    found = []
    for effect in left:
        trial = try_effect(fit, data, effect)
        if trial is None:
            continue
        gain = float((before - trial.held_out).sum())
        if gain > 0.0 and fit.misfit - trial.misfit > 0.5 * gates.evidence_needed(effect) * scale:
            found.append((gain, trial))
    found.sort(key=lambda entry: -entry[0])
    best = found[0][0] if found else 0.0
    return [trial for gain, trial in found if gain >= _WORTH * best]


def _reason_against(fit: Fit, after: Fit, effect: AngleEffect, gain: FloatArray, scale: float) -> str | None:
    """Return why an effect is refused, empty when it passes, None when there is nothing to speak of."""
    evidence = (fit.misfit - after.misfit) / scale
    seen = gain[gain != 0.0]
    spread = float(np.std(seen, ddof=1)) * math.sqrt(len(seen)) if len(seen) > 1 else 0.0
    if evidence < gates.evidence_needed(effect) or float(gain.sum()) <= spread:
        return None
    return gates.implausible(after, effect, scale, for_now=True) or gates.uneven(after, effect, scale)


def _prune(selection: Selection, data: Whitened) -> None:
    """Take out effects that later ones have made superfluous."""
    while len(selection.steps) > 1:
        final = selection.final
        needless = None
        for step in selection.steps[:-1]:
            without = fit_without(final, step.effect, data)
            if without is None:
                continue
            if without.misfit - final.misfit < gates.evidence_needed(step.effect) * gates.overdispersion(final, data):
                needless = (step, without)
                break
        if needless is None:
            return
        step, without = needless
        last = selection.steps[-1]
        selection.steps = [kept for kept in selection.steps if kept is not step]
        gain = last.before.held_out() - without.held_out()
        selection.steps[-1] = Step(last.effect, last.before, without, gain)


def _judge_leftovers(selection: Selection, data: Whitened) -> None:
    """Refuse effects that leave too much where they act: stand-ins for something the catalogue does not have."""
    while selection.steps:
        final = selection.final
        worst: tuple[float, Step, str, Fit] | None = None
        for step in selection.steps:
            without = fit_without(final, step.effect, data)
            if without is None:
                continue
            explained, left = gates.explained_and_left(final, without, data)
            scale = gates.overdispersion(final, data)
            reason = gates.stands_in(explained, left) or gates.implausible(final, step.effect, scale)
            share = left / max(explained, 1e-300)
            if reason and (worst is None or share > worst[0]):
                worst = (share, step, reason, without)
        if worst is None:
            return
        _, step, reason, without = worst
        selection.refused[step.effect.name] = (reason, without.misfit - final.misfit, step.gain, final)
        selection.steps = [kept for kept in selection.steps if kept is not step]
        if selection.steps:
            last = selection.steps[-1]
            gain = last.before.held_out() - without.held_out()
            selection.steps[-1] = Step(last.effect, last.before, without, gain)
