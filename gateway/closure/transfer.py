"""Transfer: the error on other recordings with effects exactly as they were found before."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.effects.catalogue import candidates
from gateway.closure.effects.effect import BaselineModel
from gateway.closure.inference.discrepancy import Discrepancy
from gateway.closure.inference.fit import Fit, FitFailedError, fit_model
from gateway.closure.inference.hold_out import hold_out
from gateway.closure.inference.likelihood import Whitened, whiten
from gateway.closure.inference.posterior import Posterior
from gateway.closure.inference.set_evidence import evaluate
from gateway.closure.inference.set_search import baseline_fit
from gateway.closure.model.baseline import Core
from gateway.closure.model.baseline_registry import angle_effects, make_core
from gateway.closure.model.closure_model import AngleEffect, ClosureModel
from gateway.closure.result import HeldOut
from gateway.errors import TreadlinkError
from gateway.types import FloatArray


@dataclass(frozen=True, slots=True)
class Transfer:
    """Error on recordings with the effects of other recordings.

    Attributes:
        model: baseline model.
        wheel: position.
        recordings: paths as given.
        revolutions: used.
        effects: names and parameters of the effects, SI, as found before.
        refitted: parameters that were fitted to these recordings.
        held_out: error without the effects and with them, on revolutions that no fit has seen.
        noise_floor_mps2: error that a perfect model would leave.
    """

    model: str
    wheel: str
    recordings: tuple[str, ...]
    revolutions: int
    effects: Mapping[str, Mapping[str, float]]
    refitted: tuple[str, ...]
    held_out: HeldOut
    noise_floor_mps2: float


def transfer(
    campaign: Campaign, found: Mapping[str, Mapping[str, float]], *, model: BaselineModel = BaselineModel.EXACT
) -> Transfer:
    """Return the error on a campaign without effects, and with effects whose parameters are kept.

    The tire's own parameters and the contact's centre are fitted again in both cases.

    Args:
        campaign: the data of one wheel.
        found: parameters, SI, by effect and name.
        model: baseline model.

    Raises:
        TreadlinkError: an effect is not in the catalogue or lacks a parameter, or a model cannot be fitted.
    """
    core = make_core(model)
    data = whiten(campaign, core)
    if data.folds < 2:
        raise TreadlinkError(
            "a comparison needs at least two revolutions of one recording", "Record longer at a steady speed."
        )
    effects = _known(found, angle_effects(candidates(model)))
    discrepancy = Discrepancy(campaign, data)
    try:
        start = baseline_fit(campaign, core, data)
        baseline = evaluate(start, data, discrepancy, None)
        kept = evaluate(_kept(campaign, core, data, effects, start), data, discrepancy, None)
    except FitFailedError as error:
        raise TreadlinkError(
            f"the model cannot be fitted to these recordings: {error}",
            "Check that the effects belong to this tire and sensor.",
        ) from error
    pair = {kept.names: kept, baseline.names: baseline}
    masses = {kept.names: 1.0, baseline.names: 0.0}
    certain = Posterior(pair, masses, masses, (kept,), (1.0,))
    errors = hold_out(certain, data)
    return Transfer(
        model=str(model),
        wheel=campaign.wheel,
        recordings=campaign.recordings,
        revolutions=sum(block.count for group in campaign.groups for block in group.blocks),
        effects=found,
        refitted=(*core.names, "contact centre"),
        held_out=errors.summary,
        noise_floor_mps2=errors.noise_mps2,
    )


def _known(
    found: Mapping[str, Mapping[str, float]], catalogue: Mapping[str, AngleEffect]
) -> list[tuple[AngleEffect, FloatArray]]:
    """Return the effects with their values.

    Raises:
        TreadlinkError: an effect is not in the catalogue, or lacks a parameter.
    """
    effects = []
    for name, values in found.items():
        effect = catalogue.get(name)
        if effect is None:
            raise TreadlinkError(
                f"the catalogue has no effect '{name}' for this baseline model",
                "Create the file again with `treadlink diagnose --save-effects`, or install the plug-in it came from.",
            )
        missing = [parameter.name for parameter in effect.parameters if parameter.name not in values]
        if missing:
            raise TreadlinkError(
                f"effect '{name}' lacks the parameter '{missing[0]}'",
                "Create the file again with `treadlink diagnose --save-effects`.",
            )
        effects.append((effect, np.array([values[parameter.name] for parameter in effect.parameters])))
    return effects


def _kept(
    campaign: Campaign,
    core: Core,
    data: Whitened,
    effects: list[tuple[AngleEffect, FloatArray]],
    start: Fit,
) -> Fit:
    """Return the fit of the tire's own parameters with the effects held.

    Raises:
        FitFailedError: no fit succeeds.
    """
    held = {effect.name: values for effect, values in effects}
    model = ClosureModel(campaign, core, [effect for effect, _ in effects], held=held)
    vector = start.model.layout.moved(start.vector, model.layout)
    nominal, _ = model.priors()
    for name, values in held.items():
        vector[model.layout.effect(name)] = values
    fits = []
    for begin, from_afar in ((vector, False), (nominal, True)):
        try:
            fits.append(fit_model(model, data, begin, from_afar=from_afar))
        except FitFailedError:
            continue
    if not fits:
        raise FitFailedError("no equilibrium with these effects")
    return min(fits, key=lambda fit: fit.misfit)
