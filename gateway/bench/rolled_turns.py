"""Turns of a slowly rolled wheel by gravity in its sensor, and the radius over a measured distance.

Source: at a walking pace the sensor feels gravity, which turns once per revolution in the plane of the radial and the
circumferential axis. The zero errors of the axes move the centre of this circle, which is fitted (Kasa, "A circle
fitting procedure and its error analysis", IEEE Trans. Instrum. Meas. 25, 1976). Radius = distance / (2 pi turns).
"""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from firmware_protocol.messages import Axis
from gateway.bench.heard_sensors import Window
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray

# The angle at either end: in the contact the belt is flat, over some 0.25 rad to both sides.
_ANGLE_STD_RAD: Final = 0.15
# A tape along the floor and marks on it.
_DISTANCE_STD_M: Final = 0.01
# Beyond these shares of gravity the circle is none of gravity: an axis is missing, AC-coupled or wrongly scaled.
_CIRCLE: Final = (0.7, 1.3)
_MIN_WINDOWS: Final = 20
# Each pass takes the centripetal acceleration of the one before from the radial axis: 1 m/s^2 at 2 km/h.
_PASSES: Final = 3
_SMOOTHING: Final = np.full(5, 0.2)


class RolledRadius(NamedTuple):
    """Radius of a rolled wheel.

    Attributes:
        turns: of the wheel.
        radius_m: distance over turns.
        std_m: its standard error.
    """

    turns: float
    radius_m: float
    std_m: float


def rolled_radius(windows: Sequence[Window], distance_m: float) -> RolledRadius | None:
    """Return the radius of a wheel that has rolled a distance from standstill to standstill.

    None where gravity shows no turns, or less than one.
    """
    if len(windows) < _MIN_WINDOWS:
        return None
    means = np.array([window.mean_mps2 for window in windows])
    seconds = np.array([window.duration_s for window in windows])
    radial, circumferential = means[:, Axis.RADIAL], means[:, Axis.CIRCUMFERENTIAL]
    if not np.isfinite(radial).all() or not np.isfinite(circumferential).all():
        return None
    centripetal = np.zeros_like(radial)
    turns = 0.0
    for _ in range(_PASSES):
        angle = _angles(radial - centripetal, circumferential)
        if angle is None:
            return None
        turns = abs(float(angle[-1] - angle[0])) / (2.0 * math.pi)
        if turns < 1.0:
            return None
        omega_radps = np.convolve(np.gradient(angle) / seconds, _SMOOTHING, mode="same")
        centripetal = omega_radps**2 * distance_m / (2.0 * math.pi * turns)
    radius_m = distance_m / (2.0 * math.pi * turns)
    relative_std = math.hypot(_DISTANCE_STD_M / distance_m, math.sqrt(2.0) * _ANGLE_STD_RAD / (2.0 * math.pi * turns))
    return RolledRadius(turns, radius_m, radius_m * relative_std)


def _angles(radial_mps2: FloatArray, circumferential_mps2: FloatArray) -> FloatArray | None:
    """Return the unwrapped angle of gravity (n,) about the fitted centre of its circle, None where it is none."""
    x, y = radial_mps2, circumferential_mps2
    fitted, *_ = np.linalg.lstsq(np.column_stack([2.0 * x, 2.0 * y, np.ones(len(x))]), x * x + y * y, rcond=None)
    square = float(fitted[2] + fitted[0] ** 2 + fitted[1] ** 2)
    low, high = _CIRCLE
    if not low * STANDARD_GRAVITY_MPS2 <= math.sqrt(max(square, 0.0)) <= high * STANDARD_GRAVITY_MPS2:
        return None
    angle: FloatArray = np.unwrap(np.arctan2(y - fitted[1], x - fitted[0]))
    return angle
