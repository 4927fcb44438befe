"""Which recording would tell two explanations apart: tried on conditions that nobody has recorded yet."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final

import numpy as np

from gateway.closure.cores import NoShapeError
from gateway.closure.effects.base import GroupConditions
from gateway.closure.fit import Fit, FitFailedError, fit_model
from gateway.closure.likelihood import Whitened, whiten
from gateway.closure.model import AngleEffect, ClosureModel
from gateway.closure.observation import Block, Campaign, Group
from gateway.closure.witness import CLOCK, HOST_CLOCK
from gateway.types import ComplexArray, FloatArray

# Fall of the misfit at which two explanations count as told apart.
_TOLD_APART: Final = 25.0
# Share of an axis's orders that hold nothing but the sensor's own noise.
_QUIETEST: Final = 0.1
# What is the same at any speed, load, temperature and direction is decided by other means, or not at all.
_AT_REST: Final = {
    frozenset(("camber", "zero-g offset")): "the sensor at rest with the axle level, the tire lifted or off the car, "
    "would decide: its lateral axis reads the zero-g offset alone there"
}
NOTHING: Final = "no recording at another speed, load, temperature or direction tried here would decide"

_OTHERS: Final[tuple[tuple[str, Callable[[GroupConditions], GroupConditions]], ...]] = (
    ("at 1.5 times the speed", lambda c: replace(c, omega_radps=1.5 * c.omega_radps)),
    ("at a quarter of the speed", lambda c: replace(c, omega_radps=0.25 * c.omega_radps)),
    ("at 0.6 times the speed", lambda c: replace(c, omega_radps=0.6 * c.omega_radps)),
    ("rolling the other way round", lambda c: replace(c, reverse=not c.reverse)),
    ("with the tire 20 K warmer", lambda c: replace(c, temperature_degc=c.temperature_degc + 20.0)),
    ("at 1.4 times the load", lambda c: replace(c, load_n=1.4 * c.load_n)),
    ("at 0.7 times the pressure", lambda c: replace(c, pressure_pa=0.7 * c.pressure_pa)),
)


def deciding_recording(final: Fit, effect: AngleEffect, rival: AngleEffect, data: Whitened) -> str:
    """Return the recording that would tell an effect from its rival, in words.

    The final model is taken for true; its prediction under other conditions is added to the campaign, and the rival in
    place of the effect is fitted to both.
    """
    if CLOCK in (effect.name, rival.name):
        return _clock_decides(final.model.campaign)
    at_rest = _AT_REST.get(frozenset((effect.name, rival.name)))
    if at_rest is not None:
        return at_rest
    others = tuple(other for other in final.model.effects if other.name != effect.name)
    best: tuple[float, str] | None = None
    for words, change in _OTHERS:
        gain = _told_apart(final, (*others, rival), change, data)
        if gain is not None and gain > _TOLD_APART and (best is None or gain > best[0]):
            best = (gain, words)
    if best is None:
        return NOTHING
    return f"one more recording {best[1]} would decide"


def _clock_decides(campaign: Campaign) -> str:
    """Return what the hub's clock would have to be compared with."""
    _, std = campaign.clock_error
    if not math.isfinite(std):
        return "a recording made live, with the host's own time stamps, would decide"
    if std > HOST_CLOCK:
        return f"a longer recording made live would decide: the hub's clock is known to {1e6 * std:.0f} ppm so far"
    return f"the hub's clock against one that is better than a host's {1e6 * HOST_CLOCK:.0f} ppm would decide"


def _told_apart(
    final: Fit, effects: tuple[AngleEffect, ...], change: Callable[[GroupConditions], GroupConditions], data: Whitened
) -> float | None:
    campaign, size = final.model.campaign, len(final.model.campaign.groups)
    reference = int(np.argmax([sum(block.count for block in group.blocks) for group in campaign.groups]))
    known = campaign.groups[reference]
    there = change(known.conditions)
    other_state = (there.load_n, there.pressure_pa) != (known.conditions.load_n, known.conditions.pressure_pa)
    state = campaign.states if other_state else known.state
    share = there.omega_radps / known.conditions.omega_radps
    # As long a recording: fewer revolutions where they are slower.
    blocks = tuple(
        Block(max(1, round(share * block.count)), change(block.conditions), block.orders_mps2) for block in known.blocks
    )
    group: Group = replace(known, label="imagined", conditions=there, blocks=blocks, state=state)
    states = campaign.states + int(other_state)
    larger = Campaign(campaign.wheel, campaign.recordings, (*campaign.groups, group), states, {})
    truth = ClosureModel(larger, final.model.core, final.model.effects)
    vector = _carried(final.model, truth, final.vector, known.state, other_state)
    try:
        # Now, not in the first fit: the grid's error at the new conditions must not be in the one and off the other.
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
    # Alike, so that speeds that differ between blocks are not taken for scatter.
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
    """Return how badly the rival does on the recordings at hand alone."""
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
