"""Catalogue of the effects: every instance in `EFFECTS` of a module of this package, in the order of its rank."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from gateway.closure import effects as package
from gateway.closure.effects.effect import BaselineModel, Effect


@cache
def catalogue() -> dict[str, Effect]:
    """Return every effect by name, in the order in which candidates are tried and effects of one stage are applied.

    Raises:
        ValueError: two effects share a name or a rank.
    """
    found: list[Effect] = []
    for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        found += getattr(importlib.import_module(module.name), "EFFECTS", ())
    found.sort(key=lambda effect: effect.rank)
    by_name = {effect.name: effect for effect in found}
    if len(by_name) < len(found) or len({effect.rank for effect in found}) < len(found):
        raise ValueError(f"effects share a name or a rank: {[(effect.rank, effect.name) for effect in found]}")
    return by_name


def candidates(model: BaselineModel) -> dict[str, Effect]:
    """Return the effects that a baseline model lacks and can take.

    Some ring effects act on the exact ring only: a series has no belt that they could act on.
    """
    return {
        name: effect
        for name, effect in catalogue().items()
        if model not in effect.already_in and (model is BaselineModel.EXACT or not effect.needs_exact)
    }


def group_of(effect: Effect) -> str:
    """Return the physical group of an effect, the name of its module in words: `sensor response`."""
    return type(effect).__module__.rpartition(".")[2].replace("_", " ")
