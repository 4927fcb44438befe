"""Experiment design: the recording that would separate two explanations."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.closure.data.campaign_data import Block, Campaign, Group
from gateway.closure.data.side_information import CLOCK, HOST_CLOCK
from gateway.closure.effects.effect import GroupConditions
from gateway.closure.inference.fit import Fit, FitFailedError, fit_model
from gateway.closure.inference.likelihood import Whitened, whiten
from gateway.closure.model.baseline import NoShapeError
from gateway.closure.model.closure_model import AngleEffect, ClosureModel
from gateway.reasons import Code, Reason
from gateway.types import ComplexArray, FloatArray

# Reduction of the misfit at which two explanations count as distinguished.
_DISTINGUISHED: Final = 25.0
# Share of an axis's orders that hold nothing but the sensor's own noise.
_QUIETEST: Final = 0.1
# Effects independent of speed, load, temperature and direction need another kind of recording.
_AT_REST: Final = {frozenset(("camber", "zero-g offset")): Reason(Code.RECORD_AT_REST)}
NOTHING: Final = Reason(Code.NO_RECORDING_DECIDES)

_OTHERS: Final[tuple[tuple[Reason, Callable[[GroupConditions], GroupConditions]], ...]] = (
    (Reason(Code.RECORD_AT_SPEED, speed_ratio=1.5), lambda c: replace(c, omega_radps=1.5 * c.omega_radps)),
    (Reason(Code.RECORD_AT_SPEED, speed_ratio=0.25), lambda c: replace(c, omega_radps=0.25 * c.omega_radps)),
    (Reason(Code.RECORD_AT_SPEED, speed_ratio=0.6), lambda c: replace(c, omega_radps=0.6 * c.omega_radps)),
    (Reason(Code.RECORD_REVERSED), lambda c: replace(c, reverse=not c.reverse)),
    (Reason(Code.RECORD_WARMER, difference_k=20.0), lambda c: replace(c, temperature_degc=c.temperature_degc + 20.0)),
    (Reason(Code.RECORD_AT_LOAD, load_ratio=1.4), lambda c: replace(c, load_n=1.4 * c.load_n)),
    (Reason(Code.RECORD_AT_PRESSURE, pressure_ratio=0.7), lambda c: replace(c, pressure_pa=0.7 * c.pressure_pa)),
)


def deciding_recording(final: Fit, effect: AngleEffect, rival: AngleEffect, data: Whitened) -> Reason:
    """Return the recording that would distinguish an effect from a confounder.

    The final model is taken as true. Its prediction under other conditions is added to the campaign, and the rival in
    place of the effect is fitted to both.
    """
    if CLOCK in (effect.name, rival.name):
        return _clock_decides(final.model.campaign)
    at_rest = _AT_REST.get(frozenset((effect.name, rival.name)))
    if at_rest is not None:
        return at_rest
    others = tuple(other for other in final.model.effects if other.name != effect.name)
    best: tuple[float, Reason] | None = None
    for recording, change in _OTHERS:
        gain = _distinction(final, (*others, rival), change, data)
        if gain is not None and gain > _DISTINGUISHED and (best is None or gain > best[0]):
            best = (gain, recording)
    return NOTHING if best is None else best[1]


def _clock_decides(campaign: Campaign) -> Reason:
    """Return the clock comparison that would separate the explanations."""
    _, std = campaign.clock_error
    if not math.isfinite(std):
        return Reason(Code.RECORD_LIVE)
    if std > HOST_CLOCK:
        return Reason(Code.RECORD_LIVE_FOR_LONGER, clock_std=std)
    return Reason(Code.COMPARE_CLOCK, host_clock=HOST_CLOCK)


def _distinction(
    final: Fit, effects: tuple[AngleEffect, ...], change: Callable[[GroupConditions], GroupConditions], data: Whitened
) -> float | None:
    campaign, size = final.model.campaign, len(final.model.campaign.groups)
    reference = int(np.argmax([sum(block.count for block in group.blocks) for group in campaign.groups]))
    known = campaign.groups[reference]
    there = change(known.conditions)
    other_state = (there.load_n, there.pressure_pa) != (known.conditions.load_n, known.conditions.pressure_pa)
    state = campaign.states if other_state else known.state
    share = there.omega_radps / known.conditions.omega_radps
    # The recording has the same duration, so a lower speed gives fewer revolutions.
    blocks = tuple(
        Block(max(1, round(share * block.count)), change(block.conditions), block.orders_mps2) for block in known.blocks
    )
    group: Group = replace(known, label="imagined", conditions=there, blocks=blocks, state=state)
    states = campaign.states + int(other_state)
    larger = Campaign(campaign.wheel, campaign.recordings, (*campaign.groups, group), states, {})
    truth = ClosureModel(larger, final.model.core, final.model.effects)
    vector = _carried(final.model, truth, final.vector, known.state, other_state)
    try:
        # Refined here and not in the first fit: the grid's error at the new conditions must be the same in both.
        truth.refine(vector)
        predicted = truth.predict(vector)
        rivals = ClosureModel(larger, final.model.core, effects)
        weight, variance = _as_recorded(truth, vector, data, reference, predicted[-1])
        imagined = Whitened(tuple(predicted), (*data.weights, weight), (*data.variance, variance))
        old = _misfit(imagined, rivals, truth, vector, size)
        new = fit_model(rivals, imagined, truth.layout.moved(vector, rivals.layout)).misfit
    except (FitFailedError, NoShapeError):
        return None
    return new - old


def _as_recorded(
    truth: ClosureModel, vector: FloatArray, data: Whitened, reference: int, predicted: ComplexArray
) -> tuple[FloatArray, FloatArray]:
    """Return weights and variance of the imagined recording, the campaign's last, (blocks, 3, ORDERS) each.

    Its scatter is the reference's at another speed: the sensor's own is white in time, so a revolution's goes with
    omega; the rest is the ring's, and goes with omega^4. What equations and computing leave is of what is read there.
    """
    last = len(truth.campaign.groups) - 1
    known, there = truth.campaign.groups[reference], truth.campaign.groups[last]
    counts = np.array([block.count for block in known.blocks], dtype=np.float64)
    one = (data.variance[reference] * counts[:, None, None]).mean(axis=0)
    one = np.where(one > 0.0, one, np.nan)
    quiet = np.isfinite(one).any(axis=1)
    own = np.zeros((3, 1))
    own[quiet] = np.nanquantile(one[quiet], _QUIETEST, axis=1)[:, None]
    ratio = there.conditions.omega_radps / known.conditions.omega_radps
    scatter = np.minimum(one, own) * ratio + np.maximum(one - own, 0.0) * ratio**4
    # Equal conditions, so that speed differences between blocks do not count as scatter.
    alike = tuple(replace(block, orders_mps2=predicted.mean(axis=0)) for block in there.blocks)
    alone = replace(truth.campaign, groups=(replace(there, blocks=alike, variance=scatter),))
    recorded = whiten(alone, with_mean=truth.core.mean)
    left = []
    for effect in truth.effects:
        without = vector.copy()
        without[truth.layout.effect(effect.name)] = 0.0
        left.append([effect.equation_share * np.abs(predicted[0] - truth.predict_group(without, last)[0])])
    doubted = recorded.doubting(left)
    return doubted.weights[0], doubted.variance[0]


def _misfit(data: Whitened, rivals: ClosureModel, truth: ClosureModel, vector: FloatArray, groups: int) -> float:
    """Return the misfit of the confounder on the existing recordings alone."""
    weights = (*data.weights[:groups], *(np.zeros_like(weight) for weight in data.weights[groups:]))
    at_hand = Whitened(data.orders, weights, data.variance)
    return fit_model(rivals, at_hand, truth.layout.moved(vector, rivals.layout)).misfit


def _carried(
    model: ClosureModel, larger: ClosureModel, vector: FloatArray, state: int, other_state: bool
) -> FloatArray:
    """Return the parameters in the larger campaign: a state like the reference's, the contact's centre at 0."""
    result = np.zeros(larger.layout.size)
    for known in range(model.campaign.states):
        result[larger.layout.state(known)] = vector[model.layout.state(known)]
    if other_state:
        result[larger.layout.state(model.campaign.states)] = vector[model.layout.state(state)]
    for index in range(len(model.campaign.groups)):
        result[larger.layout.centre(index)] = vector[model.layout.centre(index)]
    for effect in model.effects:
        result[larger.layout.effect(effect.name)] = vector[model.layout.effect(effect.name)]
    return result
