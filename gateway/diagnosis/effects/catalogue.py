"""Catalogue of the effects: those in `EFFECTS` of the modules of this package and of plug-ins, in order of rank."""

import importlib
import pkgutil
from functools import cache
from itertools import takewhile

from gateway.core.feature import Registry
from gateway.core.plugins import Plugin, PluginStatus, imported, installed, load_all, statuses
from gateway.core.reasons import CoreCode, Reason
from gateway.diagnosis import effects as package
from gateway.diagnosis.effects.effect import BaselineModel, Effect


@cache
def catalogue() -> dict[str, Effect]:
    """Return every effect by name, in the order in which candidates are tried and effects of one stage are applied.

    Raises:
        ValueError: two effects of this package share a name or a rank.
    """
    effects = list(_builtin())
    for added in load_all(Registry.EFFECTS, (), plugin_fault).values():
        effects += _effects_of(added)
    effects.sort(key=lambda effect: effect.rank)
    by_name = {effect.name: effect for effect in effects}
    if len(by_name) < len(effects) or len({effect.rank for effect in effects}) < len(effects):
        raise ValueError(f"effects share a name or a rank: {[(effect.rank, effect.name) for effect in effects]}")
    return by_name


def plugin_statuses() -> list[PluginStatus]:
    """Return the effects of plug-ins with the verdict."""
    return statuses(Registry.EFFECTS, (), plugin_fault)


def plugin_fault(plugin: Plugin, loaded: object) -> Reason | None:
    """Return why the object of a plug-in holds no effects for the catalogue, None when it does."""
    effects = _effects_of(loaded)
    if not effects:
        return Reason(
            CoreCode.PLUGIN_REFUSED, why="wrong_type", expected="a sequence of gateway.diagnosis.effects.effect.Effect"
        )
    registered = [(effect, "treadlink") for effect in _builtin()]
    for predecessor in takewhile(lambda candidate: candidate != plugin, installed(Registry.EFFECTS)):
        registered += [(effect, predecessor.package) for effect in _effects_of(imported(predecessor))]
    for effect in effects:
        for rival, owner in registered:
            if effect.name == rival.name or effect.rank == rival.rank:
                return Reason(
                    CoreCode.PLUGIN_REFUSED, why="effect_taken", effect=rival.name, rank=str(rival.rank), by=owner
                )
        registered.append((effect, plugin.package))
    return None


def plugin_effects() -> frozenset[str]:
    """Return the names of the effects that plug-ins add."""
    return frozenset(catalogue()) - {effect.name for effect in _builtin()}


def _effects_of(loaded: object) -> tuple[Effect, ...]:
    if not isinstance(loaded, tuple | list) or not all(isinstance(effect, Effect) for effect in loaded):
        return ()
    return tuple(loaded)


@cache
def _builtin() -> tuple[Effect, ...]:
    effects: list[Effect] = []
    for module in pkgutil.iter_modules(package.__path__, f"{package.__name__}."):
        effects += getattr(importlib.import_module(module.name), "EFFECTS", ())
    return tuple(effects)


def candidates(model: BaselineModel) -> dict[str, Effect]:
    """Return the effects that a baseline model lacks and can take.

    Some ring effects act on the exact ring only: a series has no belt that they could act on.
    """
    return {
        name: effect
        for name, effect in catalogue().items()
        if model not in effect.already_in and (model is BaselineModel.EXACT or not effect.needs_exact)
    }


def corrections(model: BaselineModel) -> tuple[str, ...]:
    """Return the effects that a baseline model lacks by its equations, and the exact ring has; none for the latter."""
    return tuple(name for name, effect in candidates(model).items() if BaselineModel.EXACT in effect.already_in)


def group_of(effect: Effect) -> str:
    """Return the physical group of an effect, the name of its module in words: `sensor response`."""
    return type(effect).__module__.rpartition(".")[2].replace("_", " ")
