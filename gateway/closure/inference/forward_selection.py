"""Forward selection of effects from the catalogue."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.inference import acceptance_tests as acceptance
from gateway.closure.inference.ablation import added_by, taken_out
from gateway.closure.inference.candidate_selection import AT_NOISE, Step, is_taken, judged, price, stands
from gateway.closure.inference.confounders import fit_without
from gateway.closure.inference.fit import Fit, FitFailedError, fit_model
from gateway.closure.inference.lateral_consistency import another_belt
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.model.baseline import Core
from gateway.closure.model.closure_model import AngleEffect, ClosureModel
from gateway.reasons import Reason
from gateway.types import FloatArray

_MOST_EFFECTS: Final = 10
# Ratio of the linear decrease of the misfit to the required one above which an effect is not tested for removal.
_SURELY: Final = 10.0
# Factor on the linear estimate of what an effect explains, below which a full fit tests it.
_SUSPECT: Final = 0.5
# Number of rejected candidates that are tried in pairs.
_PAIRED: Final = 2


@dataclass(slots=True)
class Selection:
    """Result of a selection.

    Attributes:
        start: the baseline model's fit.
        data: data with the errors of the effects' equations in their uncertainty.
        steps: effects added, in order.
        refused: effect -> (reason, decrease of the misfit, gain by fold, fit with it).
    """

    start: Fit
    data: Whitened
    steps: list[Step] = field(default_factory=list)
    refused: dict[str, tuple[Reason | None, float, FloatArray, Fit]] = field(default_factory=dict)

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
    """Add effects until none passes every acceptance test.

    Args:
        campaign: conditions.
        core: baseline model.
        data: whitened; folds of weight 0 are ignored.
        effects: candidates by name.
        start: initial vector of the baseline model.
        on_step: called with a description of each step.

    Raises:
        FitFailedError: the baseline model cannot be fitted.
    """
    on_step("fitting the baseline model")
    first = fit_model(ClosureModel(campaign, core), data, start, from_afar=start is None)
    selection = Selection(first, data)
    while len(selection.steps) < _MOST_EFFECTS:
        fit, judged = selection.final, selection.data
        on_step(f"searching for effect {len(selection.steps) + 1}")
        left = [effect for effect in effects.values() if not is_taken(effect, fit.model.effects)]
        steps = _next_steps(fit, judged, left, selection)
        if not steps:
            break
        selection.steps.extend(steps)
        on_step("found " + " and ".join(step.effect.name for step in steps))
        _prune(selection, judged)
        _doubt(selection, data)
    _judge_leftovers(selection, selection.data)
    return selection


def _doubt(selection: Selection, data: Whitened) -> None:
    """Add the errors of the effects' equations to the variance, if the model can still be fitted."""
    final = selection.final
    errors = [
        [effect.equation_share * np.abs(added[0]) for added in added_by(final, effect)]
        for effect in final.model.effects
    ]
    judged = data.doubting(errors)
    try:
        refitted = fit_model(final.model, judged, final.vector)
    except FitFailedError:
        return
    selection.data = judged
    selection.steps[-1] = replace(selection.steps[-1], after=refitted)


def _next_steps(fit: Fit, data: Whitened, left: list[AngleEffect], selection: Selection) -> list[Step]:
    """Return the best candidate that passes or, if none passes alone, the best pair that passes together."""
    passed, refused = judged(fit, data, left)
    for step in refused:
        selection.refused[step.effect.name] = (step.reason, step.fall, step.gain, step.after)
    if passed:
        step = min(passed, key=lambda step: price(step, data))
        selection.refused.pop(step.effect.name, None)
        return [step]
    if acceptance.overdispersion(fit, data) <= AT_NOISE:
        return []
    refused.sort(key=lambda step: step.after.misfit)
    pairs = []
    for first in refused[:_PAIRED]:
        others = [effect for effect in left if not is_taken(effect, (first.effect,))]
        second, _ = judged(first.after, data, others)
        pairs += [(first, step) for step in second if stands(step.after, first.effect, data)]
    if not pairs:
        return []
    first, second_step = min(pairs, key=lambda pair: price(pair[1], data))
    for step in (first, second_step):
        selection.refused.pop(step.effect.name, None)
    return [replace(first, reason=None), second_step]


def _prune(selection: Selection, data: Whitened) -> None:
    """Remove effects that later ones have made superfluous."""
    while len(selection.steps) > 1:
        final = selection.final
        needless = None
        for step in selection.steps[:-1]:
            needed = acceptance.evidence_needed(step.effect) * acceptance.overdispersion(final, data)
            if taken_out(final, step.effect).fall > _SURELY * needed:
                continue
            without = fit_without(final, step.effect, data)
            if without is None:
                continue
            if without.misfit - final.misfit < acceptance.evidence_needed(step.effect) * acceptance.overdispersion(
                final, data
            ):
                needless = (step, without)
                break
        if needless is None:
            return
        step, without = needless
        selection.steps = [kept for kept in selection.steps if kept is not step]
        selection.steps[-1] = replace(selection.steps[-1], after=without)


def _judge_leftovers(selection: Selection, data: Whitened) -> None:
    """Reject effects that are redundant or that represent effects outside the catalogue."""
    while selection.steps:
        final = selection.final
        scale, seen = acceptance.overdispersion(final, data), final.held_out()
        suspects: list[tuple[float, Step, Reason | None]] = []
        for number, step in enumerate(selection.steps):
            effect, without = step.effect, taken_out(final, step.effect)
            earlier = [other.effect for other in selection.steps[:number]]
            explained, left = acceptance.explained_and_left(final, without.predicted, data)
            firm = acceptance.implausible(final, effect, scale) or another_belt(final, effect, earlier, scale)
            if not firm and not acceptance.of_known_size(effect):
                firm = acceptance.uneven(final, effect, scale) or acceptance.lopsided(final, effect, scale)
            if (
                firm
                or acceptance.useless(effect, without.fall, without.held_out - seen, scale)
                or acceptance.stands_in(effect, _SUSPECT * explained, left)
            ):
                suspects.append((left / max(explained, 1e-300), step, firm))
        worst = _worst(sorted(suspects, key=lambda suspect: -suspect[0]), final, data)
        if worst is None:
            return
        step, reason, refitted = worst
        selection.refused[step.effect.name] = (reason, refitted.misfit - final.misfit, step.gain, final)
        selection.steps = [kept for kept in selection.steps if kept is not step]
        if selection.steps:
            selection.steps[-1] = replace(selection.steps[-1], after=refitted)


def _worst(
    suspects: list[tuple[float, Step, Reason | None]], final: Fit, data: Whitened
) -> tuple[Step, Reason, Fit] | None:
    """Return the first suspect that fails when the model is fitted without it, the reason, and that fit."""
    scale = acceptance.overdispersion(final, data)
    for _, step, firm in suspects:
        effect, without = step.effect, fit_without(final, step.effect, data)
        if without is None:
            continue
        fall, gain = without.misfit - final.misfit, without.held_out() - final.held_out()
        explained, left = acceptance.explained_and_left(final, without.predicted, data)
        reason = firm or acceptance.useless(effect, fall, gain, scale) or acceptance.stands_in(effect, explained, left)
        if reason:
            return step, reason, without
    return None
