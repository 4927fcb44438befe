"""Which of the effects that are left is to be added: tried, fitted in earnest, and judged."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from gateway.closure import gates
from gateway.closure.fit import Fit, FitFailedError
from gateway.closure.likelihood import Whitened
from gateway.closure.model import AngleEffect
from gateway.closure.trial import FAR_OFF, Trial, bare, refit, try_effect
from gateway.types import FloatArray

AT_NOISE: Final = 1.2
"""Misfit over degrees of freedom at which nothing is left for effects not yet added."""

# Trials refitted in earnest at a step, and the share of the best promise that makes a trial worth it.
_REFITTED: Final = 4
_WORTH: Final = 0.4
# Beside one that leaves nothing but noise, a trial must promise this share of what that one does.
_NEARLY: Final = 0.8
# Share of the misfit beyond noise that an effect must take off to be added: best first, the true one takes off a good
# part of what is left, and what takes off less lives on errors of something bigger.
_LEAST_SHARE: Final = 0.05


@dataclass(frozen=True, slots=True)
class Step:
    """One effect added.

    Attributes:
        effect: which.
        before: the fit without it.
        after: the fit with it.
        gain: (K,) fall of each fold's held-out misfit.
        fall: of the misfit on all data.
        reason: for which it is refused; empty where it is not.
    """

    effect: AngleEffect
    before: Fit
    after: Fit
    gain: FloatArray
    fall: float = 0.0
    reason: str = ""


def is_taken(effect: AngleEffect, taken: Sequence[AngleEffect]) -> bool:
    """Return whether an effect, or another form of it, is among those taken."""
    if any(effect.name == other.name for other in taken):
        return True
    return bool(effect.form_of) and any(other.form_of == effect.form_of for other in taken)


def judged(fit: Fit, data: Whitened, left: list[AngleEffect]) -> tuple[list[Step], list[Step]]:
    """Fit the promising ones of the effects that are left; return those that pass, and those refused for a reason."""
    promising = _promising(fit, data, left)
    passed: list[Step] = []
    refused: list[Step] = []
    enough = math.inf
    for trial in promising[:_REFITTED]:
        step = _tried(trial, fit, fit, data) if trial.misfit <= enough else None
        if step is None:
            continue
        (refused if step.reason else passed).append(step)
        if not step.reason and gates.overdispersion(step.after, data) <= AT_NOISE:
            # Nothing can do better than this one by much; only what promises nearly as much is fitted as well.
            enough = min(enough, step.after.misfit + (1.0 - _NEARLY) * step.fall, FAR_OFF * step.after.misfit)
    if enough < math.inf:
        known = {step.effect.name for step in passed}
        others = [trial.effect for trial in promising if trial.effect.name not in known]
        better = _better(fit, min(passed, key=lambda step: price(step, data)), others, data)
        passed += [step for step in better if not step.reason]
    return passed, refused


def _better(fit: Fit, best: Step, others: list[AngleEffect], data: Whitened) -> list[Step]:
    """Return what does better in the place of the best one, seen from where that one has brought all else."""
    there = bare(best.after, best.effect, data)
    if there is None:
        return []
    trials = [try_effect(there, data, effect) for effect in others]
    steps = [_tried(t, fit, there, data) for t in trials if t is not None and t.misfit < best.after.misfit]
    return [step for step in steps if step is not None]


def _tried(trial: Trial, fit: Fit, seen_from: Fit, data: Whitened) -> Step | None:
    """Return a trial's fit with the reason against it; None where there is none, or nothing to speak of."""
    try:
        after = refit(trial, seen_from, data)
    except FitFailedError:
        return None
    gain = fit.held_out() - after.held_out()
    scale = gates.overdispersion(after, data)
    reason = _reason_against(fit, after, trial.effect, gain, scale, _least_fall(fit, data))
    return None if reason is None else Step(trial.effect, fit, after, gain, fit.misfit - after.misfit, reason)


def price(step: Step, data: Whitened) -> float:
    """Return the misfit with what more parameters cost."""
    scale = gates.overdispersion(step.after, data)
    return step.after.misfit + gates.PER_PARAMETER * len(step.effect.parameters) * scale


def stands(fit: Fit, effect: AngleEffect, data: Whitened) -> bool:
    """Return whether an effect passes in a fit where another one has joined it."""
    scale = gates.overdispersion(fit, data)
    return not gates.implausible(fit, effect, scale) and not gates.uneven(fit, effect, scale)


def _promising(fit: Fit, data: Whitened, left: list[AngleEffect]) -> list[Trial]:
    """Return trials that promise something, best first."""
    before, least = fit.held_out(), _least_fall(fit, data)
    found = []
    for effect in left:
        trial = try_effect(fit, data, effect)
        if trial is None:
            continue
        gain = float((before - trial.held_out).sum())
        if gain > 0.0 and fit.misfit - trial.misfit > max(0.5 * gates.evidence_needed(effect), least):
            found.append((gain, trial))
    found.sort(key=lambda entry: -entry[0])
    best = found[0][0] if found else 0.0
    return [trial for gain, trial in found if gain >= _WORTH * best]


def _least_fall(fit: Fit, data: Whitened) -> float:
    """Return the fall of the misfit from which an effect is worth adding."""
    return _LEAST_SHARE * max(0.0, fit.misfit - data.used)


def _reason_against(
    fit: Fit, after: Fit, effect: AngleEffect, gain: FloatArray, scale: float, least: float
) -> str | None:
    """Return why an effect is refused, empty when it passes, None when there is nothing to speak of."""
    evidence = (fit.misfit - after.misfit) / scale
    if evidence < gates.evidence_needed(effect) or float(gain.sum()) <= gates.spread(gain):
        return None
    if fit.misfit - after.misfit < least:
        return None
    # What other effects may still distort is forgiven as long as there is something left for them.
    return gates.implausible(after, effect, scale, for_now=scale > AT_NOISE) or gates.uneven(after, effect, scale)
