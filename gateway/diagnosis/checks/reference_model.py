"""The exact ring on the same data: the error of the reference models' equations."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis import criteria
from gateway.diagnosis.angle.discrepancy import Discrepancy
from gateway.diagnosis.angle.fit import Fit, FitFailedError, fit_model
from gateway.diagnosis.angle.likelihood import whiten
from gateway.diagnosis.angle.number_estimates import estimates_of
from gateway.diagnosis.angle.set_evidence import evaluate
from gateway.diagnosis.effects.catalogue import candidates
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.model.baseline_registry import make_core
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.result import Fitted


@dataclass(frozen=True, slots=True)
class OnExactRing:
    """What the exact ring gives on the same data.

    Attributes:
        numbers: estimates.
        parameters: of each effect by name, (K,).
        absent: chi-square of the sizes of those effects that it has at nothing, by name.
    """

    numbers: Mapping[str, Fitted]
    parameters: Mapping[str, FloatArray]
    absent: Mapping[str, float]


def on_exact_ring(fit: Fit) -> OnExactRing | None:
    """Return what the exact ring gives with the effects of a fit that starts from a series.

    A series leaves errors of its equations, which its parameters and those of effects absorb where no residual shows
    them.

    Returns:
        None if the fit is one of the exact ring, or the exact ring cannot be fitted.
    """
    model = fit.model
    if model.core.model is BaselineModel.EXACT:
        return None
    possible = candidates(BaselineModel.EXACT)
    core = make_core(BaselineModel.EXACT)
    reference = ClosureModel(model.campaign, core, tuple(effect for effect in model.effects if effect.name in possible))
    vector, _ = reference.priors()
    for effect in reference.effects:
        vector[reference.layout.effect(effect.name)] = fit.vector[model.layout.effect(effect.name)]
    data = whiten(model.campaign, core)
    concentrations = () if fit.applied is None else fit.applied.discrepancy.concentrations
    discrepancy = Discrepancy(model.campaign, data, concentrations=concentrations)
    try:
        exact = evaluate(fit_model(reference, data, vector, from_afar=True), data, discrepancy, None)
    except FitFailedError:
        return None
    estimates, _ = estimates_of([(exact.fit, 1.0)])
    layout = reference.layout
    parameters = {effect.name: exact.fit.vector[layout.effect(effect.name)] for effect in reference.effects}
    # What fits worse than the series and the noise says nothing about the effects.
    fits = exact.fit.misfit / data.size < criteria.FITS_AS_WELL * max(1.0, fit.misfit / fit.data.size)
    sizes = {effect.name: _size_chi2(exact.fit, effect) for effect in reference.effects} if fits else {}
    absent = {name: chi2 for name, chi2 in sizes.items() if chi2 < criteria.AT_NOTHING}
    return OnExactRing(estimates, parameters, absent)


def _size_chi2(fit: Fit, effect: AngleEffect) -> float:
    """Return the chi-square of an effect's sizes against nothing; shapes, which have a prior mean, say nothing."""
    sizes = [index for index, parameter in enumerate(effect.parameters) if parameter.prior_mean == 0.0]
    if not sizes:
        return math.inf
    indices = np.arange(len(fit.vector))[fit.model.layout.effect(effect.name)][sizes]
    values = fit.vector[indices]
    return float(values @ np.linalg.solve(fit.covariance[np.ix_(indices, indices)], values))
