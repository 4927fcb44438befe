"""Signals of a sensor at the inner liner, from the motion of a node of the belt."""

import math
from typing import Final, NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline

from independent_tire.elements import QUARTER_TURN, Array
from independent_tire.rolling import Belt, History

GRAVITY_MPS2: Final = 9.80665
ANGLES: Final = 2048


class Signals(NamedTuple):
    """Parts of a sensor's specific force over the angle, each (revolutions, ANGLES).

    Specific force is omega^2 shape + g gravity + domega/dt spin. Angles run from -pi in equal steps, 0 below the
    axle. Radial is positive inward, circumferential along the rotation.
    """

    radial_m: Array
    circumferential_m: Array
    gravity_radial: Array
    gravity_circumferential: Array
    spin_radial_m: Array
    spin_circumferential_m: Array


def signals(belt: Belt, history: History, offset_m: float) -> Signals:
    """Return the signals of a sensor `offset_m` below the belt's middle line, over whole revolutions."""
    omega = belt.omega_radps
    position, slope = np.split(history.position_m, 2, axis=1)
    rate, slope_rate = np.split(history.velocity_mps, 2, axis=1)
    bend, slope_bend = np.split(history.acceleration_mps2, 2, axis=1)
    square = np.sum(slope**2, axis=1)
    along = slope / np.sqrt(square)[:, None]
    inward = along @ QUARTER_TURN.T
    # Direction of the belt in the rim's frame: its rate and acceleration.
    turning = _cross(slope, slope_rate) / square
    growing = np.sum(slope * slope_rate, axis=1) / square
    spinning = _cross(slope, slope_bend) / square - 2.0 * growing * turning
    velocity = rate + omega * position @ QUARTER_TURN.T - offset_m * (turning + omega)[:, None] * along
    acceleration = bend + 2.0 * omega * rate @ QUARTER_TURN.T - omega**2 * position
    acceleration = acceleration - offset_m * (spinning[:, None] * along + ((turning + omega) ** 2)[:, None] * inward)
    turned = history.angle_rad + math.pi
    up = np.stack([np.sin(turned), np.cos(turned)], axis=1)
    forward = np.stack([np.cos(turned), -np.sin(turned)], axis=1)
    spin = velocity / omega - belt.radius_m * forward
    parts = [
        _dot(acceleration, inward) / omega**2,
        _dot(acceleration, along) / omega**2,
        _dot(inward, up),
        _dot(along, up),
        _dot(spin, inward),
        _dot(spin, along),
    ]
    first = math.ceil((history.angle_rad[0] - 1e-9 + math.pi) / (2.0 * math.pi))
    grid = -math.pi + 2.0 * math.pi * np.arange(ANGLES) / ANGLES
    revolutions = int((history.angle_rad[-1] + math.pi) / (2.0 * math.pi) + 1e-6) - first
    angles = grid[None, :] + 2.0 * math.pi * (first + np.arange(revolutions))[:, None]
    return Signals(*(CubicSpline(history.angle_rad, part)(angles) for part in parts))


def sampled(belt: Belt, result: Signals, rate_hz: float, revolutions: int) -> tuple[Array, Array, Array]:
    """Return times, radial and circumferential specific force in m/s^2 as sampled, gravity included."""
    time_s = np.arange(int(revolutions * belt.period_s * rate_hz)) / rate_hz
    angle = np.mod(belt.omega_radps * time_s, 2.0 * math.pi)
    mean = [np.mean(part, axis=0) for part in result]
    grid = 2.0 * math.pi * np.arange(ANGLES + 1) / ANGLES
    curves = [CubicSpline(grid, np.append(part, part[0]), bc_type="periodic")(angle) for part in mean]
    square = belt.omega_radps**2
    return (
        time_s,
        square * curves[0] + GRAVITY_MPS2 * curves[2],
        square * curves[1] + GRAVITY_MPS2 * curves[3],
    )


def _cross(a: Array, b: Array) -> Array:
    result: Array = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    return result


def _dot(a: Array, b: Array) -> Array:
    result: Array = np.sum(a * b, axis=1)
    return result
