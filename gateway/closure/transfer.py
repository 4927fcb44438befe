"""Transfer: the error on other recordings with effects exactly as they were found before."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gateway.closure.data.campaign_data import Campaign
from gateway.closure.effects.catalogue import candidates
from gateway.closure.effects.effect import BaselineModel, Parameter
from gateway.closure.inference import criteria
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
from gateway.reasons import Code, Reason
from gateway.signal.effect_correction import OFFSET_TOLERANCE_M, RADIUS_TOLERANCE, CorrectionTable, EffectParameter
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
        notes: limitations of the recordings, and what differs from those in which the effects were found.
    """

    model: str
    wheel: str
    recordings: tuple[str, ...]
    revolutions: int
    effects: Mapping[str, Mapping[str, float]]
    refitted: tuple[str, ...]
    held_out: HeldOut
    noise_floor_mps2: float
    notes: tuple[Reason, ...] = ()


def transfer(
    campaign: Campaign, table: CorrectionTable, *, model: BaselineModel = BaselineModel.EXACT, origin: str = "effects"
) -> Transfer:
    """Return the error on a campaign without effects, and with effects whose parameters are kept.

    The tire's own parameters and the contact's centre are fitted again in both cases.

    Args:
        campaign: the data of one wheel.
        table: the effects; their parameters are used, not their contributions.
        model: baseline model.
        origin: where they come from, for messages.

    Raises:
        TreadlinkError: an effect is not in the catalogue, its parameters are not those of the catalogue or outside of
            their ranges, or a model cannot be fitted.
    """
    core = make_core(model)
    data = whiten(campaign, core)
    if data.folds < 2:
        raise TreadlinkError(
            "a comparison needs at least two revolutions of one recording", "Record longer at a steady speed."
        )
    effects = _known(table, angle_effects(candidates(model)), origin)
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
        effects={one.name: {p.name: p.value for p in one.parameters} for one in table.effects},
        refitted=(*core.names, "contact centre"),
        held_out=errors.summary,
        noise_floor_mps2=errors.noise_mps2,
        notes=(*differences(campaign, table), *campaign.notes),
    )


def differences(campaign: Campaign, table: CorrectionTable) -> tuple[Reason, ...]:
    """Return what differs between a campaign and the recordings of a table, as far as both state it."""
    found: list[Reason] = []
    here, there = campaign.sensor_id, table.sensor_id
    if None not in (here, there) and here != there:
        found.append(Reason(Code.EFFECTS_OF_OTHER_SENSOR, found_on=f"{there:08x}", sensor=f"{here:08x}"))
    if "" not in (campaign.vehicle, table.vehicle) and campaign.vehicle != table.vehicle:
        found.append(Reason(Code.EFFECTS_OF_OTHER_VEHICLE, found_on=table.vehicle, vehicle=campaign.vehicle))
    if "" not in (campaign.tire, table.tire) and campaign.tire != table.tire:
        found.append(Reason(Code.EFFECTS_OF_OTHER_TIRE, found_on=table.tire, tire=campaign.tire))
    radii_m = {group.conditions.radius_m for group in campaign.groups}
    other_m = [radius_m for radius_m in radii_m if abs(radius_m / table.radius_m - 1.0) > RADIUS_TOLERANCE]
    if other_m:
        found.append(Reason(Code.EFFECTS_OF_OTHER_RADIUS, found_m=table.radius_m, radius_m=max(other_m)))
    depths_m = {group.declared_offset_m for group in campaign.groups}
    other_m = [depth_m for depth_m in depths_m if abs(depth_m - table.sensor_offset_m) > OFFSET_TOLERANCE_M]
    if other_m:
        found.append(Reason(Code.EFFECTS_OF_OTHER_OFFSET, found_m=table.sensor_offset_m, offset_m=max(other_m)))
    return tuple(found)


def _known(
    table: CorrectionTable, catalogue: Mapping[str, AngleEffect], origin: str
) -> list[tuple[AngleEffect, FloatArray]]:
    """Return the effects with their values.

    Raises:
        TreadlinkError: an effect is not in the catalogue or stands twice, or its parameters are not those of the
            catalogue or outside of their ranges.
    """
    again = "Create the file again with `treadlink diagnose --save-effects`."
    effects: list[tuple[AngleEffect, FloatArray]] = []
    for one in table.effects:
        effect = catalogue.get(one.name)
        if effect is None:
            raise TreadlinkError(
                f"{origin}: the catalogue has no effect '{one.name}' for this baseline model",
                "Create the file again with `treadlink diagnose --save-effects`, or install the plug-in it came from.",
            )
        if any(effect is other for other, _ in effects):
            raise TreadlinkError(f"{origin}: effect '{one.name}' stands twice", again)
        given = {parameter.name: parameter for parameter in one.parameters}
        names = [parameter.name for parameter in effect.parameters]
        for name in names:
            if name not in given:
                raise TreadlinkError(f"{origin}: effect '{one.name}' lacks the parameter '{name}'", again)
        for name in given:
            if name not in names or sum(parameter.name == name for parameter in one.parameters) > 1:
                raise TreadlinkError(f"{origin}: effect '{one.name}' has no parameter '{name}', or has it twice", again)
        for parameter in effect.parameters:
            _check_range(effect, parameter, given[parameter.name], origin)
        effects.append((effect, np.array([given[name].value for name in names])))
    return effects


def _check_range(effect: AngleEffect, parameter: Parameter, given: EffectParameter, origin: str) -> None:
    """Check a value by the range that a diagnosis allows.

    Raises:
        TreadlinkError: it is outside by more than its standard error allows, or in another unit.
    """
    label = f"{origin}: effect '{effect.name}': parameter '{parameter.name}'"
    if given.unit not in ("", parameter.unit):
        raise TreadlinkError(f"{label} is in {given.unit}, not in {parameter.unit or 'no unit'}", "Correct the file.")
    slack = criteria.BEYOND_BOUND * given.std if math.isfinite(given.std) else 0.0
    # A wide error does not make an impossible value possible.
    slack = min(slack, parameter.high - parameter.low)
    if not parameter.low - slack <= given.value <= parameter.high + slack:
        unit = f" {parameter.unit}" if parameter.unit else ""
        raise TreadlinkError(
            f"{label} is {given.value:g}{unit}, outside its plausible range of {parameter.low:g} to "
            f"{parameter.high:g}{unit}",
            "Create the file again with `treadlink diagnose --save-effects`.",
        )


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
