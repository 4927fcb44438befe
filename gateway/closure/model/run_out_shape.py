"""Shape of the belt on a tire with run-out: load and sensor radius vary with the wheel angle."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from gateway.closure.effects.effect import FIELD_SIZE
from gateway.closure.model.baseline import Shape
from gateway.physics.rolling_ring.sensor_waveform import SensorWaveform
from gateway.types import FloatArray

# Shares of the load by which the shapes beside the middle one differ from it, and the height from which on it is the
# larger: a millimetre swings the load of a car's tire by 5 %, and the parabola holds within its shapes.
_STEP, _LARGE_STEP, _LARGE_M = 0.04, 0.1, 7e-4
_THETA: Final[FloatArray] = -math.pi + (2.0 * math.pi / FIELD_SIZE) * np.arange(FIELD_SIZE, dtype=np.float64)


class LoadedShape(NamedTuple):
    """A shape, and the height of the axle above the road."""

    shape: Shape
    axle_height_m: float


def load_step(cosine_m: float, sine_m: float) -> float:
    """Return the share of the load by which the shapes beside the middle one are to differ from it."""
    return _STEP if math.hypot(cosine_m, sine_m) < _LARGE_M else _LARGE_STEP


def out_of_round(
    lighter: LoadedShape, middle: LoadedShape, heavier: LoadedShape, radius_m: float, cosine_m: float, sine_m: float
) -> Shape:
    """Return the shape of a tire whose radius is larger by cosine cos(theta) + sine sin(theta) where it meets the road.

    The axle keeps its height, so that the load swings by the vertical stiffness times the height on the road when the
    sensor is at theta; every angle has the shape under its own load, a parabola through three. Off the contact the
    sensor rides on a radius that is larger by the cosine.

    Args:
        lighter: the round tire at (1 - load step) of its load.
        middle: at its load.
        heavier: at (1 + load step) of it.
        radius_m: belt radius.
        cosine_m: height at the sensor.
        sine_m: height on the road a quarter of a turn after the sensor's bottom.
    """
    # Load steps a metre: a lighter load lifts the axle.
    steps_pm = 2.0 / (lighter.axle_height_m - heavier.axle_height_m)
    shapes = (lighter.shape, middle.shape, heavier.shape)
    weights = _parabola(steps_pm * (cosine_m * np.cos(_THETA) + sine_m * np.sin(_THETA)))
    fields = np.einsum("sk,sfk->fk", weights, np.array([shape.waveform for shape in shapes]))
    fields[0] *= 1.0 + cosine_m / radius_m
    edges = []
    for angles in np.array([(shape.leading_edge_rad, shape.trailing_edge_rad) for shape in shapes]).T:
        at = float(angles[1])
        share = _parabola(np.array([steps_pm * (cosine_m * math.cos(at) + sine_m * math.sin(at))]))
        edges.append(float(share[:, 0] @ angles))
    return Shape(SensorWaveform(*fields), edges[0], edges[1], middle.shape.belt)


def _parabola(at: FloatArray) -> FloatArray:
    """Return the weights of values at -1, 0 and 1, (3, n)."""
    return np.stack([0.5 * at * (at - 1.0), 1.0 - at * at, 0.5 * at * (at + 1.0)])
