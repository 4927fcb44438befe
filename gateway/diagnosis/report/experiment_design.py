"""Experiment design: the recording that would separate two explanations."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis.angle.fit import Fit, FitFailedError, fit_model
from gateway.diagnosis.angle.likelihood import whiten
from gateway.diagnosis.data.campaign_data import Block, Campaign
from gateway.diagnosis.data.side_information import CLOCK, HOST_CLOCK
from gateway.diagnosis.effects.effect import GroupConditions
from gateway.diagnosis.model.baseline import NoShapeError
from gateway.diagnosis.model.closure_model import AngleEffect, ClosureModel
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.report.imagined_recording import carried, reference_group, shared_places, with_recording

# Reduction of the misfit at which two explanations count as distinguished.
_DISTINGUISHED: Final = 25.0
# Most steps of a fit of the rival, and the share of the misfit below which a step ends it: the fits need to be as exact
# as a choice of recordings.
_STEPS: Final = 4
_ROUGH: Final = 0.02
# Effects independent of speed, load, temperature and direction need another kind of recording.
_AT_STANDSTILL: Final = {frozenset(("camber", "zero-g offset")): Reason(DiagnosisCode.RECORD_AGAIN, how="at_rest")}
NOTHING: Final = Reason(DiagnosisCode.RECORD_AGAIN, how="none_decides")


def _at_ratio(quantity: str, ratio: float) -> Reason:
    return Reason(DiagnosisCode.RECORD_AGAIN, how="ratio", quantity=quantity, ratio=ratio)


_OPTIONS: Final[tuple[tuple[Reason, Callable[[GroupConditions], GroupConditions]], ...]] = (
    (_at_ratio("speed", 1.5), lambda c: replace(c, omega_radps=1.5 * c.omega_radps)),
    (_at_ratio("speed", 0.25), lambda c: replace(c, omega_radps=0.25 * c.omega_radps)),
    (_at_ratio("speed", 0.6), lambda c: replace(c, omega_radps=0.6 * c.omega_radps)),
    (Reason(DiagnosisCode.RECORD_AGAIN, how="reversed"), lambda c: replace(c, reverse=not c.reverse)),
    (
        Reason(DiagnosisCode.RECORD_AGAIN, how="warmer", difference_k=20.0),
        lambda c: replace(c, temperature_degc=c.temperature_degc + 20.0),
    ),
    (_at_ratio("load", 1.4), lambda c: replace(c, load_n=1.4 * c.load_n)),
    (_at_ratio("pressure", 0.7), lambda c: replace(c, pressure_pa=0.7 * c.pressure_pa)),
)


def deciding_recording(final: Fit, effect: AngleEffect, rival: AngleEffect) -> Reason:
    """Return the recording that would distinguish an effect from a confounder.

    The final model is taken as true. Its prediction under other conditions is added to the campaign, and the rival in
    place of the effect is fitted to both.
    """
    if CLOCK in (effect.name, rival.name):
        return _clock_decides(final.model.campaign)
    standstill = _AT_STANDSTILL.get(frozenset((effect.name, rival.name)))
    if standstill is not None:
        return standstill
    others = tuple(entry for entry in final.model.effects if entry.name != effect.name)
    best_option: tuple[float, Reason] | None = None
    for recording, change in _OPTIONS:
        gain = _distinction(final, (*others, rival), change)
        if gain is not None and gain > _DISTINGUISHED and (best_option is None or gain > best_option[0]):
            best_option = (gain, recording)
    return NOTHING if best_option is None else best_option[1]


def _clock_decides(campaign: Campaign) -> Reason:
    """Return the clock comparison that would separate the explanations."""
    _, std = campaign.clock_error
    if not math.isfinite(std):
        return Reason(DiagnosisCode.RECORD_AGAIN, how="live")
    if std > HOST_CLOCK:
        return Reason(DiagnosisCode.RECORD_AGAIN, how="live_longer", clock_std=std)
    return Reason(DiagnosisCode.RECORD_AGAIN, how="better_clock", host_clock=HOST_CLOCK)


def _distinction(
    final: Fit, effects: tuple[AngleEffect, ...], change: Callable[[GroupConditions], GroupConditions]
) -> float | None:
    """Return the misfit that the rivals have with another recording beyond that without it; None if a fit fails."""
    campaign, size = final.model.campaign, len(final.model.campaign.groups)
    reference = reference_group(campaign)
    conditions = change(reference.conditions)
    # The recording has the same duration, so a lower speed gives fewer revolutions.
    speed_ratio = conditions.omega_radps / reference.conditions.omega_radps
    count = max(1, round(speed_ratio * reference.revolutions))
    larger = with_recording(campaign, conditions, count)
    truth = ClosureModel(larger, final.model.core, final.model.effects)
    vector = carried(final.model, truth, final.vector)
    try:
        # Refined here and not in the first fit: the grid's error at the new conditions must be the same in both.
        truth.refine(vector)
        imagined = _as_predicted(larger, truth, vector)
        data = whiten(imagined, truth.core)
        rivals = ClosureModel(imagined, final.model.core, effects)
        start = truth.layout.moved(vector, rivals.layout)
        larger_misfit = fit_model(rivals, data, start, most_steps=_STEPS, rough=_ROUGH).misfit
        recorded = replace(imagined, groups=imagined.groups[:size], states=campaign.states)
        reduced = ClosureModel(recorded, final.model.core, effects)
        reduced_start = start[shared_places(reduced, rivals)]
        misfit = fit_model(reduced, whiten(recorded, truth.core), reduced_start, most_steps=_STEPS, rough=_ROUGH).misfit
    except (FitFailedError, NoShapeError):
        return None
    return larger_misfit - misfit


def _as_predicted(campaign: Campaign, model: ClosureModel, vector: FloatArray) -> Campaign:
    """Return a campaign whose waveforms are those of a model, under the scatter of the recorded ones."""
    groups = []
    for index, group in enumerate(campaign.groups):
        predicted = model.predict_mean(vector, index)
        orders = np.where(np.isfinite(group.blocks[0].orders_mps2), predicted, complex(math.nan, math.nan))
        groups.append(replace(group, blocks=(Block(group.revolutions, group.conditions, orders),)))
    return replace(campaign, groups=tuple(groups))
