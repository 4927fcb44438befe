"""Agreement of results that were computed one at a time and in blocks."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from operator import itemgetter
from typing import Any

import numpy as np

from gateway.core.estimates.estimator import Estimate, Revolution, TireConditions
from gateway.core.estimates.results import RevolutionResult

_CONDITIONS = [field.name for field in dataclasses.fields(TireConditions) if field.name != "sensor_offset_m"]
# Largest difference over the standard error.
TOLERANCE = 2e-9


def assert_agree(some: Sequence[RevolutionResult], others: Sequence[RevolutionResult]) -> None:
    """Fail unless both are the same results, wheel by wheel, to `TOLERANCE` of their standard errors."""
    ours, theirs = by_wheel(some), by_wheel(others)
    assert {name: len(results) for name, results in ours.items()} == {n: len(r) for n, r in theirs.items()}
    for name, results in ours.items():
        for index, (first, other) in enumerate(zip(results, theirs[name], strict=True)):
            where, worst = max(differences(first, other).items(), key=itemgetter(1))
            assert worst <= TOLERANCE, f"{where} of result {index} of {name} differs by {worst:.1e} standard errors"


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


def differences(first: RevolutionResult, other: RevolutionResult) -> dict[str, float]:
    """Return the differences of two results by name, in standard errors; infinite where they are no numbers."""
    result = _of_revolution(first.revolution, other.revolution)
    for field in dataclasses.fields(RevolutionResult):
        if field.name not in ("revolution", "estimates"):
            result[field.name] = _of(getattr(first, field.name), getattr(other, field.name))
    result["estimates"] = 0.0 if len(first.estimates) == len(other.estimates) else math.inf
    return result | {a.name: _of_estimate(a, b) for a, b in zip(first.estimates, other.estimates, strict=False)}


def _of_estimate(first: Estimate, other: Estimate) -> float:
    if (first.name, first.status) != (other.name, other.status):
        return math.inf
    scale = first.std if first.std > 0.0 else abs(first.value)
    return max(
        _over(first.value, other.value, scale),
        _over(first.std, other.std, first.std),
        _of(first.reasons, other.reasons),
    )


def _of_revolution(first: Revolution, other: Revolution) -> dict[str, float]:
    scales = {
        "period_s": first.period_std_s,
        "start_s": first.period_std_s,
        "omega_radps": first.omega_radps * first.period_std_s / first.period_s,
        "omega_dot_radps2": first.omega_radps * first.period_std_s / first.period_s**2,
        "leading_edge_rad": first.leading_edge_std_rad,
        "trailing_edge_rad": first.trailing_edge_std_rad,
        "radial_mps2": first.noise_mps2,
        "axes_mps2": first.noise_mps2,
        "orders_mps2": first.noise_mps2 * math.sqrt(2.0 / len(first.radial_mps2)),
    }
    return {
        field.name: _of(getattr(first, field.name), getattr(other, field.name), scales.get(field.name))
        for field in dataclasses.fields(Revolution)
    }


def _of(first: Any, other: Any, scale: float | None = None) -> float:
    """Return the difference of any two values; numbers without a standard error are compared with their size."""
    if isinstance(first, np.ndarray):
        if first.shape != other.shape or (np.isnan(first) != np.isnan(other)).any():
            return math.inf
        difference = float(np.nanmax(np.abs(first - other), initial=0.0))
        return difference / (scale or float(np.nanmax(np.abs(first), initial=0.0)) or 1.0)
    if isinstance(first, float):
        return _over(first, other, scale or abs(first))
    if isinstance(first, TireConditions) and isinstance(other, TireConditions):
        # What is measured about the sensor may be near 0.
        offset = _over(first.sensor_offset_m, other.sensor_offset_m, first.sensor_offset_std_m)
        return max(offset, *(_of(getattr(first, name), getattr(other, name)) for name in _CONDITIONS))
    if dataclasses.is_dataclass(first):
        pairs = [(getattr(first, field.name), getattr(other, field.name)) for field in dataclasses.fields(first)]
        return max((_of(a, b) for a, b in pairs), default=0.0) if type(first) is type(other) else math.inf
    if isinstance(first, Mapping):
        same = isinstance(other, Mapping) and list(first) == list(other)
        return max((_of(first[key], other[key]) for key in first), default=0.0) if same else math.inf
    if isinstance(first, tuple | list):
        same = isinstance(other, tuple | list) and len(first) == len(other)
        return max((_of(a, b) for a, b in zip(first, other, strict=True)), default=0.0) if same else math.inf
    return 0.0 if first == other else math.inf


def _over(first: float, other: float, scale: float) -> float:
    if first == other or (math.isnan(first) and math.isnan(other)):
        return 0.0
    return abs(first - other) / scale if scale > 0.0 else math.inf
