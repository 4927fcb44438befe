"""Confounders: other effects of the catalogue that explain the same as one that was added."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

from gateway.closure.inference import acceptance_tests as acceptance
from gateway.closure.inference.candidate_trial import FAR_OFF, bare, refit, try_effect
from gateway.closure.inference.fit import Fit, FitFailedError, fit_model
from gateway.closure.inference.likelihood import Whitened
from gateway.closure.model.closure_model import AngleEffect, ClosureModel

# Confounders whose misfit differs from the effect's by no more than this, times the overdispersion, are equivalent.
_ALIKE: Final = 10.0
# A linear trial that recovers less than this share of what the effect explains is not worth a fit.
_WORTH: Final = 0.7


def rivals_of(final: Fit, effect: AngleEffect, effects: Mapping[str, AngleEffect], data: Whitened) -> dict[str, Fit]:
    """Return fits of the effects that explain as much in place of `effect`, the rest of the final model kept."""
    without = bare(final, effect, data)
    if without is None:
        return {}
    scale = acceptance.overdispersion(final, data)
    misfit = without.linear_misfit()
    most = min(misfit - _WORTH * (misfit - final.misfit), FAR_OFF * final.misfit)
    taken = {other.name for other in final.model.effects}
    found: dict[str, Fit] = {}
    for name, rival in effects.items():
        if name in taken:
            continue
        trial = try_effect(without, data, rival)
        if trial is None or trial.misfit > most:
            continue
        try:
            fit = refit(trial, without, data)
        except FitFailedError:
            continue
        near = fit.misfit - final.misfit < _ALIKE * scale
        if near and not acceptance.implausible(fit, rival, scale) and not acceptance.uneven(fit, rival, scale):
            found[name] = fit
    return found


def fit_without(fit: Fit, effect: AngleEffect, data: Whitened) -> Fit | None:
    """Return the fit with one effect removed; None if the fit fails."""
    effects = tuple(other for other in fit.model.effects if other.name != effect.name)
    model = ClosureModel(fit.model.campaign, fit.model.core, effects)
    try:
        return fit_model(model, data, fit.model.layout.moved(fit.vector, model.layout))
    except FitFailedError:
        return None
