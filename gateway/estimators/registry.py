"""Registry of estimators."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from typing import TYPE_CHECKING, Final

from gateway.errors import ConfigError

if TYPE_CHECKING:
    from gateway.estimators.estimator import Estimator

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


def in_order(names: Iterable[str]) -> list[str]:
    """Return estimator names in running order, unknown ones last."""
    known = list(ESTIMATORS)
    return sorted(names, key=lambda name: known.index(name) if name in known else len(known))


def make_estimator(name: str) -> Estimator:
    """Return a new estimator.

    Raises:
        ConfigError: no estimator of that name.
    """
    if name not in ESTIMATORS:
        raise ConfigError(f"unknown estimator '{name}'", f"Known estimators: {', '.join(ESTIMATORS)}.")
    module_name, class_name = ESTIMATORS[name].split(":")
    estimator: Estimator = getattr(importlib.import_module(module_name), class_name)()
    return estimator
