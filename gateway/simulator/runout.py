"""A tire that is not round: the high spot presses harder on the road when it comes round."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from gateway.physics.rolling_ring import RingSolution
from gateway.types import FloatArray

# Step of load for the tire's vertical stiffness.
_LOAD_STEP = 0.02


@dataclass(frozen=True, slots=True)
class SolvedPoint:
    """A tire solved under one set of conditions, on the table's angles.

    Attributes:
        ring: the solution.
        planar: (angles, columns) of the ring's waveform, radial shape first.
        lateral: (angles, slips) lateral shapes.
        edges_rad: (2,) leading and trailing contact angle.
    """

    ring: RingSolution
    planar: FloatArray
    lateral: FloatArray
    edges_rad: FloatArray


def with_runout(
    solve: Callable[[float], SolvedPoint], load_n: float, height_m: float, offset_rad: float
) -> SolvedPoint:
    """Return a tire whose radius is larger by height cos(psi) at material angle psi from its high spot.

    The axle stays at its height, so the load swings by stiffness times height as the wheel turns; the sensor meets the
    road under the same load each time (quadratic in the load, three solutions). Off the contact it rides on the
    eccentric circle's radius.

    Args:
        solve: the round tire under a load.
        load_n: mean load.
        height_m: of the high spot.
        offset_rad: material angle from the sensor to the high spot.
    """
    middle = solve(load_n)
    pressed = solve(load_n * (1.0 + _LOAD_STEP))
    stiffness_npm = _LOAD_STEP * load_n / (middle.ring.axle_height_m - pressed.ring.axle_height_m)
    swing_n = stiffness_npm * height_m
    three = (solve(load_n - swing_n), middle, solve(load_n + swing_n))
    theta = np.linspace(-math.pi, math.pi, len(middle.planar))
    weights = _parabola(np.cos(theta + offset_rad))
    at_edges = _parabola(np.cos(middle.edges_rad + offset_rad))
    planar = sum((w[:, None] * point.planar for w, point in zip(weights, three, strict=True)), np.zeros(1))
    planar[:, 0] *= 1.0 + height_m / middle.ring.ring.radius_m * math.cos(offset_rad)
    return SolvedPoint(
        middle.ring,
        planar,
        sum((w[:, None] * point.lateral for w, point in zip(weights, three, strict=True)), np.zeros(1)),
        sum((w * point.edges_rad for w, point in zip(at_edges, three, strict=True)), np.zeros(1)),
    )


def _parabola(at: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the weights of values at -1, 0 and 1."""
    return 0.5 * at * (at - 1.0), 1.0 - at * at, 0.5 * at * (at + 1.0)
