"""Registry of estimators: those of this package and those of plug-ins."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Final, TypeGuard

from gateway.core.errors import ConfigError
from gateway.core.feature import Registry, added, object_of
from gateway.core.nearest_name import did_you_mean
from gateway.core.plugins import Plugin, load, missing_members, names
from gateway.core.quantity import Quantity
from gateway.core.quantity_catalogue import declare, quantities_of
from gateway.core.reasons import CoreCode, Reason
from gateway.core.removed_names import replacement

if TYPE_CHECKING:
    from gateway.core.estimates.estimator import Estimator

_NAME: Final = re.compile(r"[A-Za-z][A-Za-z0-9_.-]{0,59}")
# Each name is a column of every table; the estimators of this package have at most a dozen.
_MAX_QUANTITIES: Final = 100

# name -> "module:class"; the class is called without arguments, once per wheel. Estimators run in this order: one that
# uses the estimates of others comes after them.
ESTIMATORS: Final[Mapping[str, str]] = {
    "kinematic": "gateway.core.estimates.kinematic:KinematicEstimator",
    "distance": "gateway.core.estimates.distance:DistanceEstimator",
    "self-calibration": "gateway.core.trust.self_calibration:SelfCalibrationEstimator",
    **added(Registry.NUMBERS),
    "wear": "gateway.core.estimates.wear:WearEstimator",
    "load": "gateway.core.estimates.load:LoadEstimator",
    **added(Registry.ESTIMATORS),
}

DEFAULT_ESTIMATORS: Final[tuple[str, ...]] = ("kinematic", "distance", "weak-form", "wear", "ply-steer", "turning")
# A recording has its own column of the distance; the mean of a growing one says nothing, nor does that of turns.
CAMPAIGN_ESTIMATORS: Final[tuple[str, ...]] = tuple(
    name for name in ESTIMATORS if name in {*DEFAULT_ESTIMATORS, "self-calibration", "load"} - {"distance", "turning"}
)
"""What trends of a fleet need beyond the defaults: errors of the sensors and measured loads."""


def estimator_names() -> list[str]:
    """Return the names of all estimators in running order; those of plug-ins run last."""
    return [*ESTIMATORS, *names(Registry.ESTIMATORS, ESTIMATORS)]


def in_order(chosen: Iterable[str]) -> list[str]:
    """Return estimator names in running order, unknown ones last."""
    names = estimator_names()
    return sorted(chosen, key=lambda name: names.index(name) if name in names else len(names))


def make_estimator(name: str) -> Estimator:
    """Return a new estimator.

    Raises:
        ConfigError: no estimator of that name.
        PluginError: it is a plug-in that cannot be used.
    """
    if name in ESTIMATORS:
        estimator: Estimator = object_of(ESTIMATORS[name])()
        return estimator
    loaded = load(Registry.ESTIMATORS, name, ESTIMATORS, plugin_fault)
    if not callable(loaded):
        if (remedy := replacement("--estimator", name)) is not None:
            raise ConfigError(f"the estimator '{name}' was removed", remedy)
        hint = did_you_mean(name, estimator_names())
        raise ConfigError(f"unknown estimator '{name}'", f"{hint}Known estimators: {', '.join(estimator_names())}.")
    from gateway.core.estimates.plugin_estimator import PluginEstimator

    return PluginEstimator(name, loaded, [quantity.name for quantity in quantities_of(name)])


def plugin_fault(plugin: Plugin, loaded: object) -> Reason | None:
    """Return why the object of a plug-in makes no estimator, None when it does."""
    if not callable(loaded):
        return Reason(CoreCode.PLUGIN_REFUSED, why="wrong_type", expected="a class of estimators")
    estimator = loaded()
    if fault := missing_members(estimator, ("update", "reset")):
        return fault
    name = getattr(estimator, "name", "")
    if name != plugin.name:
        return Reason(CoreCode.PLUGIN_REFUSED, why="name_differs", name=str(name))
    quantities = getattr(estimator, "quantities", None)
    if not _are_quantities(quantities):
        return Reason(
            CoreCode.PLUGIN_REFUSED, why="wrong_type", expected="an estimator with a tuple `quantities` of `Quantity`"
        )
    clash = declare(plugin.name, quantities)
    return (
        Reason(CoreCode.PLUGIN_REFUSED, why="quantity_taken", name=clash[0], by=clash[1]) if clash is not None else None
    )


def _are_quantities(declared: object) -> TypeGuard[tuple[Quantity, ...]]:
    """Return whether these are quantities whose names can be columns of every table."""
    return (
        isinstance(declared, tuple)
        and 0 < len(declared) <= _MAX_QUANTITIES
        and all(
            isinstance(item, Quantity) and type(item.name) is str and _NAME.fullmatch(item.name) for item in declared
        )
        and len({item.name for item in declared}) == len(declared)
    )
