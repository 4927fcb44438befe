"""Registry of the baseline models, and of the effects that act on the angle-locked signal."""

from collections.abc import Mapping

from gateway.closure.effects.effect import BaselineModel, Effect, RingEffect, SignalEffect
from gateway.closure.model.baseline import Core
from gateway.closure.model.closure_model import AngleEffect
from gateway.closure.model.exact_baseline import ExactCore
from gateway.closure.model.series_baseline import SeriesCore


def make_core(model: BaselineModel) -> Core:
    """Return a new baseline model."""
    if model is BaselineModel.EXACT:
        return ExactCore()
    return SeriesCore(model)


def angle_effects(effects: Mapping[str, Effect]) -> dict[str, AngleEffect]:
    """Return the effects that are locked to the wheel's angle."""
    return {name: effect for name, effect in effects.items() if isinstance(effect, SignalEffect | RingEffect)}
