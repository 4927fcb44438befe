"""Quantities over time: constant or piecewise linear."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from pydantic import PlainValidator

from gateway.core.types import FloatArray


@dataclass(frozen=True, slots=True)
class Series:
    """Points (t_s, value), interpolated linearly, held before the first and after the last.

    Attributes:
        points: with increasing times; one point is a constant.
    """

    points: tuple[tuple[float, float], ...]

    @property
    def times_s(self) -> FloatArray:
        """Times of the points."""
        return np.array([time for time, _ in self.points])

    @property
    def values(self) -> FloatArray:
        """Values of the points."""
        return np.array([value for _, value in self.points])

    @property
    def low(self) -> float:
        """Smallest value."""
        return float(self.values.min())

    @property
    def high(self) -> float:
        """Largest value."""
        return float(self.values.max())

    def at(self, time_s: float) -> float:
        """Return the value at a time."""
        return float(np.interp(time_s, self.times_s, self.values))

    def at_times(self, time_s: FloatArray) -> FloatArray | float:
        """Return the values at many times; of a constant, the constant."""
        if len(self.points) == 1:
            return self.points[0][1]
        return np.interp(time_s, self.times_s, self.values)

    @property
    def is_constant(self) -> bool:
        """Whether the value never changes."""
        return self.low == self.high

    def rates_at(self, time_s: FloatArray) -> FloatArray:
        """Return the rates of change per second at many times."""
        rates = np.concatenate(([0.0], np.diff(self.values) / np.diff(self.times_s), [0.0]))
        result: FloatArray = rates[np.searchsorted(self.times_s, time_s, side="right")]
        return result

    def scaled(self, factor: float) -> Series:
        """Return the series in another unit."""
        return Series(tuple((time, factor * value) for time, value in self.points))


def constant(value: float) -> Series:
    """Return a constant series."""
    return Series(((0.0, value),))


def in_range(low: float, high: float) -> PlainValidator:
    """Return the pydantic validator of a `Series` whose values lie from `low` to `high`."""
    allowed = f"a number from {low:g} to {high:g}, or a list of [t_s, value] points with increasing times"

    def read(value: object) -> Series:
        if isinstance(value, Series):
            return value
        points: tuple[tuple[float, float], ...]
        if not isinstance(value, list | tuple):
            points = ((0.0, _number(value, allowed)),)
        else:
            if not value or not all(isinstance(point, list | tuple) and len(point) == 2 for point in value):
                raise ValueError(allowed)
            points = tuple((_number(time, allowed), _number(item, allowed)) for time, item in value)
        for time_s, item in points:
            if not low <= item <= high:
                raise ValueError(f"{allowed}; {item:g} at {time_s:g} s is not")
        if any(later <= earlier for (earlier, _), (later, _) in pairwise(points)):
            raise ValueError(f"{allowed}; the times do not increase")
        return Series(points)

    return PlainValidator(read)


def per_axis(low: float, high: float) -> PlainValidator:
    """Return the pydantic validator of three numbers (circumferential, lateral, radial), or one for all three."""
    allowed = f"a number from {low:g} to {high:g}, or three of them: circumferential, lateral, radial"

    def read(value: object) -> tuple[float, float, float]:
        items = value if isinstance(value, list | tuple) else (value, value, value)
        if len(items) != 3:
            raise ValueError(allowed)
        first, second, third = (_number(item, allowed) for item in items)
        if not low <= min(first, second, third) <= max(first, second, third) <= high:
            raise ValueError(allowed)
        return first, second, third

    return PlainValidator(read)


def checked_text(check: Callable[[str], object]) -> PlainValidator:
    """Return the pydantic validator of a text that `check` accepts; it raises ValueError with what is allowed."""

    def read(value: object) -> str:
        if not isinstance(value, str):
            raise ValueError("text")
        check(value)
        return value

    return PlainValidator(read)


def _number(value: object, allowed: str) -> float:
    if isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value):
        return float(value)
    raise ValueError(allowed)
