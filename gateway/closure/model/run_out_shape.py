"""Shape of the belt on a tire with run-out: load and sensor radius vary with the wheel angle."""

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from gateway.closure.effects.effect import FIELD_SIZE
from gateway.closure.model.baseline import Shape
from gateway.physics.polynomial_weights import polynomial_weights
from gateway.physics.rolling_ring.sensor_waveform import SensorWaveform
from gateway.types import FloatArray

# Share of the load by which a metre of run-out swings it on a car's tire; on a truck's tire it is half of that.
_SWING_PM: Final = 50.0
# Largest shares by which the loads of the shapes may differ from the middle one. They are few, so that the solutions
# for one height serve its neighbours. Below the first the grid's error would be seen.
_LARGEST: Final[FloatArray] = 0.02 * np.sqrt(2.0) ** np.arange(9)
# Parts of it, at which a polynomial is nowhere far off.
_PARTS: Final = (-1.0, -math.sqrt(0.5), 0.0, math.sqrt(0.5), 1.0)
_THETA: Final[FloatArray] = -math.pi + (2.0 * math.pi / FIELD_SIZE) * np.arange(FIELD_SIZE, dtype=np.float64)


class LoadedShape(NamedTuple):
    """A shape, and the height of the axle above the road."""

    shape: Shape
    axle_height_m: float


def load_steps(cosine_m: float, sine_m: float) -> list[float]:
    """Return the shares of the load by which the five shapes are to differ from the middle one."""
    swing = max(_SWING_PM * math.hypot(cosine_m, sine_m), float(_LARGEST[0]))
    largest = float(_LARGEST[np.argmin(np.abs(np.log(_LARGEST / swing)))])
    return [part * largest for part in _PARTS]


def out_of_round(loaded: Sequence[LoadedShape], radius_m: float, cosine_m: float, sine_m: float) -> Shape:
    """Return the shape of a tire whose radius is larger by cosine cos(theta) + sine sin(theta) where it meets a road.

    The axle keeps its height, so that a round tire with the same deflection has its axle lower by the height on the
    road when the sensor is at theta. Every angle has the shape at its own axle height, a polynomial through those
    given; a parabola would be off by up to 1 % of the change, since the contact's edges move. Off the contact the
    sensor rides on a radius that is larger by the cosine.

    Args:
        loaded: the round tire under five loads, the mean load's in the middle.
        radius_m: belt radius.
        cosine_m: height at the sensor.
        sine_m: height on the road a quarter of a turn after the sensor's bottom.
    """
    middle = loaded[len(loaded) // 2]
    shapes = [load_case.shape for load_case in loaded]
    lower_m = np.array([middle.axle_height_m - load_case.axle_height_m for load_case in loaded])
    weights = polynomial_weights(lower_m, cosine_m * np.cos(_THETA) + sine_m * np.sin(_THETA))
    fields = np.einsum("ks,sfk->fk", weights, np.array([shape.waveform for shape in shapes]))
    fields[0] *= 1.0 + cosine_m / radius_m
    edges = []
    for angles in np.array([(shape.leading_edge_rad, shape.trailing_edge_rad) for shape in shapes]).T:
        middle_rad = float(angles[len(loaded) // 2])
        share = polynomial_weights(lower_m, cosine_m * math.cos(middle_rad) + sine_m * math.sin(middle_rad))
        edges.append(float(share @ angles))
    return Shape(SensorWaveform(*fields), edges[0], edges[1], middle.shape.belt)
