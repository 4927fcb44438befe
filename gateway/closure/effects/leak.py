"""A sensor turned in one plane: the radial axis leaks into another one, and that one into the radial axis."""

from __future__ import annotations

import math

from gateway.closure.effects.base import RADIAL, Here, bare
from gateway.types import FloatArray


def turned(here: Here, axis: int, angle_rad: float) -> FloatArray:
    """Return what a turn changes, (3, FIELD_SIZE): radial leaks into +axis."""
    # cos - 1 without cancellation.
    less, sine = -2.0 * math.sin(0.5 * angle_rad) ** 2, math.sin(angle_rad)
    other, radial = here.signal_mps2[axis], here.signal_mps2[RADIAL]
    change = bare(here)
    change[axis] = less * other + sine * radial
    change[RADIAL] = less * radial - sine * other
    return change


def turned_slope(here: Here, axis: int, angle_rad: float) -> FloatArray:
    """Return the derivative of `turned` by the angle, (3, FIELD_SIZE)."""
    sine, cosine = math.sin(angle_rad), math.cos(angle_rad)
    other, radial = here.signal_mps2[axis], here.signal_mps2[RADIAL]
    change = bare(here)
    change[axis] = cosine * radial - sine * other
    change[RADIAL] = -cosine * other - sine * radial
    return change
