"""Baseline models by name, and the effects that act on the angle-locked signal."""

from __future__ import annotations

from collections.abc import Mapping

from gateway.closure.cores import Core
from gateway.closure.effects.base import BaselineModel, Effect, RingEffect, SignalEffect
from gateway.closure.exact_core import ExactCore
from gateway.closure.model import AngleEffect
from gateway.closure.series_core import SeriesCore


def make_core(model: BaselineModel) -> Core:
    """Return a new baseline model."""
    if model is BaselineModel.EXACT:
        return ExactCore()
    return SeriesCore(model)


def angle_effects(effects: Mapping[str, Effect]) -> dict[str, AngleEffect]:
    """Return the effects that are locked to the wheel's angle."""
    return {name: effect for name, effect in effects.items() if isinstance(effect, SignalEffect | RingEffect)}
