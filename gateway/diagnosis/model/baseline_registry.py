"""Registry of the baseline models, and of the effects that act on the angle-locked signal."""

from collections.abc import Mapping

from gateway.diagnosis.effects.effect import BaselineModel, Effect, RingEffect, SignalEffect
from gateway.diagnosis.model.baseline import Core
from gateway.diagnosis.model.closure_model import AngleEffect
from gateway.diagnosis.model.exact_baseline import ExactCore
from gateway.diagnosis.model.series_baseline import SeriesCore


def make_core(model: BaselineModel) -> Core:
    """Return a new baseline model."""
    return ExactCore() if model is BaselineModel.EXACT else SeriesCore()


def angle_effects(effects: Mapping[str, Effect]) -> dict[str, AngleEffect]:
    """Return the effects that are locked to the wheel's angle."""
    return {name: effect for name, effect in effects.items() if isinstance(effect, SignalEffect | RingEffect)}
