"""Registry of estimators: those of this package and those of plug-ins."""

from __future__ import annotations

import importlib
import logging
from collections.abc import Callable, Iterable
from typing import Final

from gateway.errors import ConfigError
from gateway.estimators.estimator import AngleAverage, Estimate, Estimator, Revolution, TireConditions
from gateway.plugins import Plugin, PluginGroup, load, missing_members, names
from gateway.reasons import Code, Reason

_logger = logging.getLogger(__name__)

# name -> "module:class"; the class is called without arguments, once per wheel. Estimators run in this order: one that
# uses the estimates of others comes after them.
ESTIMATORS: Final[dict[str, str]] = {
    "kinematic": "gateway.estimators.kinematic:KinematicEstimator",
    "self-calibration": "gateway.estimators.self_calibration:SelfCalibrationEstimator",
    "weak-form": "gateway.estimators.weak_form:WeakFormEstimator",
    "ring-modal": "gateway.estimators.ring_modal:RingModalEstimator",
    "ring-paper": "gateway.estimators.ring_paper:RingPaperEstimator",
    "forward": "gateway.estimators.forward:ForwardEstimator",
    "wear": "gateway.estimators.wear:WearEstimator",
    "load": "gateway.estimators.load:LoadEstimator",
    "ply-steer": "gateway.estimators.ply_steer:PlySteerEstimator",
    "slip-angle": "gateway.estimators.slip_angle:SlipAngleEstimator",
    "asynchronous": "gateway.estimators.nonsynchronous:NonsynchronousEstimator",
}

DEFAULT_ESTIMATORS: Final[tuple[str, ...]] = ("kinematic", "weak-form", "wear", "ply-steer")


def estimator_names() -> list[str]:
    """Return the names of all estimators in running order; those of plug-ins run last."""
    return [*ESTIMATORS, *names(PluginGroup.ESTIMATORS, ESTIMATORS)]


def in_order(chosen: Iterable[str]) -> list[str]:
    """Return estimator names in running order, unknown ones last."""
    known = estimator_names()
    return sorted(chosen, key=lambda name: known.index(name) if name in known else len(known))


def make_estimator(name: str) -> Estimator:
    """Return a new estimator.

    Raises:
        ConfigError: no estimator of that name.
        PluginError: it is a plug-in that cannot be used.
    """
    if name in ESTIMATORS:
        module_name, class_name = ESTIMATORS[name].split(":")
        estimator: Estimator = getattr(importlib.import_module(module_name), class_name)()
        return estimator
    found = load(PluginGroup.ESTIMATORS, name, ESTIMATORS, plugin_fault)
    if not callable(found):
        raise ConfigError(f"unknown estimator '{name}'", f"Known estimators: {', '.join(estimator_names())}.")
    return _PluginEstimator(name, found)


def plugin_fault(plugin: Plugin, found: object) -> Reason | None:
    """Return why the object of a plug-in makes no estimator, None when it does."""
    if not callable(found):
        return Reason(Code.PLUGIN_WRONG_TYPE, expected="a class of estimators")
    made = found()
    if fault := missing_members(made, ("update", "reset")):
        return fault
    name = getattr(made, "name", "")
    return None if name == plugin.name else Reason(Code.PLUGIN_NAME_DIFFERS, name=str(name))


class _PluginEstimator:
    """Estimator of a plug-in. An error in it makes its estimates invalid and stops nothing else."""

    def __init__(self, name: str, make: Callable[[], Estimator]) -> None:
        self.name = name
        self._estimator = make()
        self._names: tuple[str, ...] = (name,)

    def update(self, revolution: Revolution, average: AngleAverage, conditions: TireConditions) -> tuple[Estimate, ...]:
        """Return the plug-in's estimates; those that it gave last, without values, when it fails."""
        try:
            found = tuple(self._estimator.update(revolution, average, conditions))
            if not all(isinstance(estimate, Estimate) for estimate in found):
                raise TypeError("update returns other things than estimates")
        except Exception as error:  # code of others may raise anything, and must not end the session
            _logger.warning("estimator %s failed", self.name, exc_info=True)
            failed = Reason(Code.PLUGIN_FAILED, error=f"{type(error).__name__}: {error}")
            return tuple(Estimate.invalid(name, failed) for name in self._names)
        self._names = tuple(estimate.name for estimate in found) or self._names
        return found

    def reset(self) -> None:
        """Forget everything."""
        self._estimator.reset()
