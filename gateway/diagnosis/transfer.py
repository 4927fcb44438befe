"""Transfer: the error on other recordings with effects exactly as they were found before."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.errors import TreadlinkError
from gateway.core.reasons import Reason
from gateway.core.revolutions.effect_correction import CorrectedEffect, CorrectedSignal, CorrectionTable
from gateway.core.types import FloatArray
from gateway.diagnosis.angle.discrepancy import Discrepancy
from gateway.diagnosis.angle.fit import Fit, FitFailedError, fit_model
from gateway.diagnosis.angle.likelihood import Whitened, whiten
from gateway.diagnosis.angle.number_estimates import estimates_of
from gateway.diagnosis.angle.residual import PLANE, residual_ratio
from gateway.diagnosis.angle.set_evidence import evaluate
from gateway.diagnosis.bayes.parameter_estimates import fitted_parameter
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.known_effects import known_effects
from gateway.diagnosis.model.baseline import Core
from gateway.diagnosis.model.baseline_registry import make_core
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.remainder.unexplained_orders import unexplained
from gateway.diagnosis.report.findings import sizes_of
from gateway.diagnosis.report.hold_out import alignment_note, hold_out
from gateway.diagnosis.report.report_curves import curves_of, trends_of
from gateway.diagnosis.result import Diagnosis, Finding, HeldOut, Verdict
from gateway.diagnosis.search.set_search import baseline_fit
from gateway.diagnosis.search.tempered_posterior import Posterior

# Effects that do not matter change the error by less than this, either way.
_LARGER: Final = 1.02


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
        report: the same for a page, with waveforms, the tire's numbers and what stays unexplained.
    """

    model: str
    wheel: str
    recordings: tuple[str, ...]
    revolutions: int
    effects: Mapping[str, Mapping[str, float]]
    refitted: tuple[str, ...]
    held_out: HeldOut
    noise_floor_mps2: float
    notes: tuple[Reason, ...]
    report: Diagnosis


def transfer(
    campaign: Campaign, table: CorrectionTable, *, model: BaselineModel = BaselineModel.EXACT, origin: str = "effects"
) -> Transfer:
    """Return the error on a campaign without effects, and with effects whose parameters are kept.

    The tire's own parameters, the contact's centre and a measured depth are fitted again in both cases.

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
    effects = known_effects(table, origin, model)
    discrepancy = Discrepancy(campaign, data)
    try:
        start = baseline_fit(campaign, core, data)
        baseline = evaluate(start, data, discrepancy, None)
        transferred = evaluate(_fit_with_effects(campaign, core, data, effects, start), data, discrepancy, None)
    except FitFailedError as error:
        raise TreadlinkError(
            f"the model cannot be fitted to these recordings: {error}",
            "Check that the effects belong to this tire and sensor.",
        ) from error
    pair = {transferred.names: transferred, baseline.names: baseline}
    masses = {transferred.names: 1.0, baseline.names: 0.0}
    certain = Posterior(pair, masses, masses, (transferred,), (1.0,))
    errors = hold_out(certain, data)
    notes = (
        *_enlarged(errors.summary),
        *alignment_note(errors.summary),
        *table.differences(_signal_of(campaign)),
        *campaign.notes,
    )
    fits = errors.fit_of[baseline.names], errors.fit_of[transferred.names]
    depth = ("sensor depth",) if any(group.conditions.offset_measured for group in campaign.groups) else ()
    (before, determined_before), (after, determined) = (
        estimates_of([(evaluated.fit, 1.0)], left_ratio=math.sqrt(residual_ratio(evaluated.fit, data, PLANE)))
        for evaluated in (baseline, transferred)
    )
    report = Diagnosis(
        model=str(model),
        wheel=campaign.wheel,
        recordings=campaign.recordings,
        assumed=campaign.assumed,
        revolutions=campaign.revolutions,
        rejected=sum(campaign.rejected.values()),
        noise_floor_mps2=errors.noise_mps2,
        held_out=errors.summary,
        findings=tuple(
            _as_finding(transferred.fit, effect, corrected)
            for (effect, _), corrected in zip(effects, table.effects, strict=True)
        ),
        unexplained=unexplained(transferred.fit, data),
        estimates_before=before,
        estimates_after=after,
        determined=determined,
        determined_before=determined_before,
        curves=curves_of(*fits, data),
        trends=trends_of(*fits, data),
        notes=notes,
        stated=campaign.stated,
        load_known=all(group.load_known for group in campaign.groups),
        pressure_known=all(group.pressure_known for group in campaign.groups),
        taken_from=origin,
    )
    return Transfer(
        model=str(model),
        wheel=campaign.wheel,
        recordings=campaign.recordings,
        revolutions=campaign.revolutions,
        effects={corrected.name: {p.name: p.value for p in corrected.parameters} for corrected in table.effects},
        refitted=(*core.names, "contact centre", *depth),
        held_out=errors.summary,
        noise_floor_mps2=errors.noise_mps2,
        notes=notes,
        report=report,
    )


def _as_finding(fit: Fit, effect: AngleEffect, corrected: CorrectedEffect) -> Finding:
    """Return an effect of a file as a finding: parameters and errors are those of the file."""
    in_file = {parameter.name: parameter for parameter in corrected.parameters}
    return Finding(
        name=effect.name,
        verdict=Verdict.NAMED,
        parameters={
            parameter.name: fitted_parameter(parameter, in_file[parameter.name].value, in_file[parameter.name].std)
            for parameter in effect.parameters
            if parameter.name in in_file
        },
        chi2=math.nan,
        rms_mps2=float(np.max(sizes_of(fit, effect))),
        summary=effect.summary,
        equation=effect.equation,
    )


def _enlarged(held_out: HeldOut) -> tuple[Reason, ...]:
    """Return a note where the error is larger with the effects than without."""
    before, after = held_out.rms_before_mps2, held_out.rms_after_mps2
    if not after > _LARGER * before:
        return ()
    return (Reason(DiagnosisCode.EFFECTS_ENLARGE_ERROR, before_mps2=before, after_mps2=after),)


def _signal_of(campaign: Campaign) -> CorrectedSignal:
    return CorrectedSignal(
        sensor_id=campaign.sensor_id,
        vehicle=campaign.vehicle,
        tire=campaign.tire,
        radii_m=tuple({group.conditions.radius_m for group in campaign.groups}),
        # A depth that the samples measured is free in the fit.
        offsets_m=tuple({group.declared_offset_m for group in campaign.groups if not group.conditions.offset_measured}),
    )


def _fit_with_effects(
    campaign: Campaign, core: Core, data: Whitened, effects: list[tuple[AngleEffect, FloatArray]], start: Fit
) -> Fit:
    """Return the fit of the tire's own parameters with the effects held.

    Raises:
        FitFailedError: no fit succeeds.
    """
    fixed_values = {effect.name: values for effect, values in effects}
    model = ClosureModel(campaign, core, [effect for effect, _ in effects], held=fixed_values)
    vector = start.model.layout.moved(start.vector, model.layout)
    nominal, _ = model.priors()
    for name, values in fixed_values.items():
        vector[model.layout.effect(name)] = values
    fits = []
    for start_vector, from_afar in ((vector, False), (nominal, True)):
        try:
            fits.append(fit_model(model, data, start_vector, from_afar=from_afar))
        except FitFailedError:
            continue
    if not fits:
        raise FitFailedError("no equilibrium with these effects")
    return min(fits, key=lambda fit: fit.misfit)
