"""Agreement of results that were computed one at a time and in blocks."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np

from gateway.estimators.estimator import Estimate, Revolution, TireConditions
from gateway.pipeline.results import RevolutionResult

_CONDITIONS = [field.name for field in dataclasses.fields(TireConditions) if field.name != "sensor_offset_m"]
# Largest difference over the standard error.
TOLERANCE = 1e-9


def assert_agree(some: Sequence[RevolutionResult], others: Sequence[RevolutionResult]) -> None:
    """Fail unless both are the same results, wheel by wheel, to `TOLERANCE` of their standard errors."""
    ours, theirs = by_wheel(some), by_wheel(others)
    assert {name: len(results) for name, results in ours.items()} == {n: len(r) for n, r in theirs.items()}
    for name, results in ours.items():
        for place, (one, other) in enumerate(zip(results, theirs[name], strict=True)):
            where, worst = max(differences(one, other).items(), key=itemgetter(1))
            assert worst <= TOLERANCE, f"{where} of result {place} of {name} differs by {worst:.1e} standard errors"


def values_of(value: Any) -> Any:
    """Return a result as comparable values: arrays bit by bit, and NaN equal to NaN."""
    if isinstance(value, np.ndarray):
        return value.tobytes()
    if dataclasses.is_dataclass(value):
        return tuple(values_of(getattr(value, field.name)) for field in dataclasses.fields(value))
    if isinstance(value, Mapping):
        return tuple((values_of(key), values_of(item)) for key, item in value.items())
    if isinstance(value, tuple | list):
        return tuple(values_of(item) for item in value)
    # Equality of dataclasses with NaN differs between versions of Python.
    return repr(value)


def by_wheel(results: Sequence[RevolutionResult]) -> dict[str, list[RevolutionResult]]:
    """Return the results of each wheel in their order."""
    wheels: dict[str, list[RevolutionResult]] = {}
    for result in results:
        wheels.setdefault(result.position, []).append(result)
    return wheels


def differences(one: RevolutionResult, other: RevolutionResult) -> dict[str, float]:
    """Return the differences of two results by name, in standard errors; infinite where they are no numbers."""
    found = _of_revolution(one.revolution, other.revolution)
    for field in dataclasses.fields(RevolutionResult):
        if field.name not in ("revolution", "estimates"):
            found[field.name] = _of(getattr(one, field.name), getattr(other, field.name))
    found["estimates"] = 0.0 if len(one.estimates) == len(other.estimates) else math.inf
    return found | {a.name: _of_estimate(a, b) for a, b in zip(one.estimates, other.estimates, strict=False)}


def _of_estimate(one: Estimate, other: Estimate) -> float:
    if (one.name, one.status) != (other.name, other.status):
        return math.inf
    scale = one.std if one.std > 0.0 else abs(one.value)
    return max(
        _over(one.value, other.value, scale), _over(one.std, other.std, one.std), _of(one.reasons, other.reasons)
    )


def _of_revolution(one: Revolution, other: Revolution) -> dict[str, float]:
    scales = {
        "period_s": one.period_std_s,
        "start_s": one.period_std_s,
        "omega_radps": one.omega_radps * one.period_std_s / one.period_s,
        "omega_dot_radps2": one.omega_radps * one.period_std_s / one.period_s**2,
        "leading_edge_rad": one.leading_edge_std_rad,
        "trailing_edge_rad": one.trailing_edge_std_rad,
        "radial_mps2": one.noise_mps2,
        "axes_mps2": one.noise_mps2,
        "orders_mps2": one.noise_mps2 * math.sqrt(2.0 / len(one.radial_mps2)),
    }
    return {
        field.name: _of(getattr(one, field.name), getattr(other, field.name), scales.get(field.name))
        for field in dataclasses.fields(Revolution)
    }


def _of(one: Any, other: Any, scale: float | None = None) -> float:
    """Return the difference of any two values; numbers without a standard error are compared with their size."""
    if isinstance(one, np.ndarray):
        if one.shape != other.shape or (np.isnan(one) != np.isnan(other)).any():
            return math.inf
        difference = float(np.nanmax(np.abs(one - other), initial=0.0))
        return difference / (scale or float(np.nanmax(np.abs(one), initial=0.0)) or 1.0)
    if isinstance(one, float):
        return _over(one, other, scale or abs(one))
    if isinstance(one, TireConditions) and isinstance(other, TireConditions):
        # What is measured about the sensor may be near 0.
        offset = _over(one.sensor_offset_m, other.sensor_offset_m, one.sensor_offset_std_m)
        return max(offset, *(_of(getattr(one, name), getattr(other, name)) for name in _CONDITIONS))
    if dataclasses.is_dataclass(one):
        pairs = [(getattr(one, field.name), getattr(other, field.name)) for field in dataclasses.fields(one)]
        return max((_of(a, b) for a, b in pairs), default=0.0) if type(one) is type(other) else math.inf
    if isinstance(one, Mapping):
        same = isinstance(other, Mapping) and list(one) == list(other)
        return max((_of(one[key], other[key]) for key in one), default=0.0) if same else math.inf
    if isinstance(one, tuple | list):
        same = isinstance(other, tuple | list) and len(one) == len(other)
        return max((_of(a, b) for a, b in zip(one, other, strict=True)), default=0.0) if same else math.inf
    return 0.0 if one == other else math.inf


def _over(one: float, other: float, scale: float) -> float:
    if one == other or (math.isnan(one) and math.isnan(other)):
        return 0.0
    return abs(one - other) / scale if scale > 0.0 else math.inf
