"""Shape of the belt on a tire with run-out: load and sensor radius vary with the wheel angle."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.angle_orders import THETA
from gateway.diagnosis.model.baseline import Shape
from gateway.ring.polynomial_weights import polynomial_weights
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform

# Share of the load by which a metre of run-out swings it on a car's tire; on a truck's tire it is half of that.
_SWING_PM: Final = 50.0
# Shares by which the loads of the shapes may differ from the middle one. They are few, so that the solutions for one
# height serve its neighbours. With smaller ones the grid's error would be seen.
_STEPS: Final[FloatArray] = 0.02 * np.sqrt(2.0) ** np.arange(-1, 9)
_LAST_LEVEL: Final = len(_STEPS) - 2
# Seven loads are those of two polynomials of five each, one of which swings them by more.
_NARROW_NODES: Final = [1, 2, 3, 4, 5]
_WIDE_NODES: Final = [0, 1, 3, 5, 6]


class LoadedShape(NamedTuple):
    """A shape, and the height of the axle above the road."""

    shape: Shape
    axle_height_m: float


def load_steps(cosine_m: float, sine_m: float) -> list[float]:
    """Return the shares of the load by which the five or seven shapes are to differ from the middle one."""
    level, share = _level(cosine_m, sine_m)
    steps = _STEPS[level : level + (3 if share > 0.0 else 2)].tolist()
    return [*(-step for step in reversed(steps)), 0.0, *steps]


def _level(cosine_m: float, sine_m: float) -> tuple[int, float]:
    """Return the index of the least load step, and the share of the polynomial that swings the load by more.

    The share changes smoothly with the height: a fit would not come to rest at a height where a shape jumps from one
    polynomial to the next.
    """
    swing = _SWING_PM * math.hypot(cosine_m, sine_m)
    steps = 2.0 * math.log2(max(swing / float(_STEPS[1]), 1e-9)) + 0.5
    level = min(max(math.floor(steps), 0), _LAST_LEVEL - 1)
    fraction = min(max(steps - level, 0.0), 1.0)
    return level, fraction * fraction * (3.0 - 2.0 * fraction)


def out_of_round(loaded: Sequence[LoadedShape], radius_m: float, cosine_m: float, sine_m: float) -> Shape:
    """Return the shape of a tire whose radius is larger by cosine cos(theta) + sine sin(theta) where it meets a road.

    The axle keeps its height, so that a round tire with the same deflection has its axle lower by the height on the
    road when the sensor is at theta. Every angle has the shape at its own axle height, a polynomial through those
    given; a parabola would be off by up to 1 % of the change, since the contact's edges move. Off the contact the
    sensor rides on a radius that is larger by the cosine.

    Args:
        loaded: the round tire under the loads of `load_steps`.
        radius_m: belt radius.
        cosine_m: height at the sensor.
        sine_m: height on the road a quarter of a turn after the sensor's bottom.
    """
    middle = loaded[len(loaded) // 2]
    shapes = [load_case.shape for load_case in loaded]
    lower_m = np.array([middle.axle_height_m - load_case.axle_height_m for load_case in loaded])
    _, share = _level(cosine_m, sine_m)
    weights = _weights(lower_m, cosine_m * np.cos(THETA) + sine_m * np.sin(THETA), share)
    fields = np.einsum("ks,sfk->fk", weights, np.array([shape.waveform for shape in shapes]))
    fields[0] *= 1.0 + cosine_m / radius_m
    edges = []
    for angles in np.array([(shape.leading_edge_rad, shape.trailing_edge_rad) for shape in shapes]).T:
        middle_rad = float(angles[len(loaded) // 2])
        height_m = cosine_m * math.cos(middle_rad) + sine_m * math.sin(middle_rad)
        edges.append(float(_weights(lower_m, height_m, share) @ angles))
    return Shape(SensorWaveform(*fields), edges[0], edges[1], middle.shape.belt)


def _weights(nodes_m: FloatArray, height_m: FloatArray | float, share: float) -> FloatArray:
    """Return the weights (..., k) of five or seven heights (k,) for those wanted (...), a share by the wider ones."""
    if len(nodes_m) == len(_NARROW_NODES):
        return polynomial_weights(nodes_m, height_m)
    weights = np.zeros((*np.shape(height_m), len(nodes_m)))
    weights[..., _NARROW_NODES] = (1.0 - share) * polynomial_weights(nodes_m[_NARROW_NODES], height_m)
    weights[..., _WIDE_NODES] += share * polynomial_weights(nodes_m[_WIDE_NODES], height_m)
    return weights
