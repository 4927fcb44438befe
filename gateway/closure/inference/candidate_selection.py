"""Selection of the next effect: linear trial, full fit and acceptance tests."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from gateway.closure.inference import acceptance_tests as acceptance
from gateway.closure.inference.candidate_trial import FAR_OFF, Trial, bare, refit, try_effect
from gateway.closure.inference.fit import Fit, FitFailedError
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.model.closure_model import AngleEffect
from gateway.reasons import Reason
from gateway.types import FloatArray

AT_NOISE: Final = 1.2
"""Misfit per degree of freedom at which no further effect is expected."""

# Trials refitted at a step, and the smallest share of the best predicted gain of a refitted trial.
_REFITTED: Final = 4
_LEAST_GAIN_SHARE: Final = 0.4
# Beside a trial that leaves only noise, another must predict this share of its gain.
_EQUAL_GAIN_SHARE: Final = 0.8
# Smallest share of the misfit beyond noise that an added effect must remove. The true cause removes a large part; an
# effect that removes less fits the errors of a larger one.
_LEAST_SHARE: Final = 0.05


@dataclass(frozen=True, slots=True)
class Step:
    """One effect added.

    Attributes:
        effect: the effect.
        before: fit without it.
        after: fit with it.
        gain: (K,) decrease of the held-out misfit of each fold.
        fall: decrease of the misfit on all data.
        reason: reason for its rejection; None if it passes.
    """

    effect: AngleEffect
    before: Fit
    after: Fit
    gain: FloatArray
    fall: float = 0.0
    reason: Reason | None = None


def is_taken(effect: AngleEffect, taken: Sequence[AngleEffect]) -> bool:
    """Return whether an effect, or another form of it, is among those taken."""
    if any(effect.name == other.name for other in taken):
        return True
    return bool(effect.form_of) and any(other.form_of == effect.form_of for other in taken)


def judged(fit: Fit, data: Whitened, left: list[AngleEffect]) -> tuple[list[Step], list[Step]]:
    """Fit the promising effects; return the accepted and the rejected steps."""
    promising = _promising(fit, data, left)
    passed: list[Step] = []
    refused: list[Step] = []
    enough = math.inf
    for trial in promising[:_REFITTED]:
        step = _tried(trial, fit, fit, data) if trial.misfit <= enough else None
        if step is None:
            continue
        (refused if step.reason is not None else passed).append(step)
        if step.reason is None and acceptance.overdispersion(step.after, data) <= AT_NOISE:
            # No trial can be much better than this one; only trials with nearly the same predicted gain are fitted too.
            enough = min(enough, step.after.misfit + (1.0 - _EQUAL_GAIN_SHARE) * step.fall, FAR_OFF * step.after.misfit)
    if enough < math.inf:
        known = {step.effect.name for step in passed}
        others = [trial.effect for trial in promising if trial.effect.name not in known]
        better = _better(fit, min(passed, key=lambda step: price(step, data)), others, data)
        passed += [step for step in better if step.reason is None]
    return passed, refused


def _better(fit: Fit, best: Step, others: list[AngleEffect], data: Whitened) -> list[Step]:
    """Return steps that beat the best one in its place, started from its fit of the other parameters."""
    there = bare(best.after, best.effect, data)
    if there is None:
        return []
    trials = [try_effect(there, data, effect) for effect in others]
    steps = [_tried(t, fit, there, data) for t in trials if t is not None and t.misfit < best.after.misfit]
    return [step for step in steps if step is not None]


def _tried(trial: Trial, fit: Fit, seen_from: Fit, data: Whitened) -> Step | None:
    """Return a trial's fit with the reason to reject it, if any; None without a fit or without evidence."""
    try:
        after = refit(trial, seen_from, data)
    except FitFailedError:
        return None
    gain = fit.held_out() - after.held_out()
    scale, fall = acceptance.overdispersion(after, data), fit.misfit - after.misfit
    if fall / scale < acceptance.evidence_needed(trial.effect) or float(gain.sum()) <= acceptance.spread(gain):
        return None
    if fall < _least_fall(fit, data):
        return None
    # Distortion by effects still missing is tolerated as long as there is a residual left for them.
    reason = acceptance.implausible(after, trial.effect, scale, for_now=scale > AT_NOISE)
    return Step(trial.effect, fit, after, gain, fall, reason or acceptance.uneven(after, trial.effect, scale))


def price(step: Step, data: Whitened) -> float:
    """Return the misfit with a penalty for the number of parameters."""
    scale = acceptance.overdispersion(step.after, data)
    return step.after.misfit + acceptance.PER_PARAMETER * len(step.effect.parameters) * scale


def stands(fit: Fit, effect: AngleEffect, data: Whitened) -> bool:
    """Return whether an effect passes in a fit that contains another one as well."""
    scale = acceptance.overdispersion(fit, data)
    return acceptance.implausible(fit, effect, scale) is None and acceptance.uneven(fit, effect, scale) is None


def _promising(fit: Fit, data: Whitened, left: list[AngleEffect]) -> list[Trial]:
    """Return trials with a sufficient predicted gain, best first."""
    before, least = fit.held_out(), _least_fall(fit, data)
    found = []
    for effect in left:
        trial = try_effect(fit, data, effect)
        if trial is None:
            continue
        gain = float((before - trial.held_out).sum())
        if gain > 0.0 and fit.misfit - trial.misfit > max(0.5 * acceptance.evidence_needed(effect), least):
            found.append((gain, trial))
    found.sort(key=lambda entry: -entry[0])
    best = found[0][0] if found else 0.0
    return [trial for gain, trial in found if gain >= _LEAST_GAIN_SHARE * best]


def _least_fall(fit: Fit, data: Whitened) -> float:
    """Return the smallest decrease of the misfit that justifies an effect."""
    return _LEAST_SHARE * max(0.0, fit.misfit - data.used)
