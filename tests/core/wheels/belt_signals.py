"""Signals of a sensor on a closed belt of prescribed shape: a generator of its own, without ring and simulator."""

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import fsolve

RADIUS_M, DEPTH_M, GRAVITY_MPS2 = 0.31, 0.003, 9.80665
_POINTS = 4096
_THETA = (np.arange(_POINTS) - _POINTS // 2) * (2.0 * math.pi / _POINTS)


@cache
def shape() -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return curvature times radius and the tangent's angle over theta, (n,) each: flat within 0.22 rad, and closed."""

    def belt(amounts: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        flat = 0.5 * (np.tanh((_THETA + 0.22) / 0.05) - np.tanh((_THETA - 0.22) / 0.05))
        bumps = np.exp(-0.5 * ((np.abs(_THETA) - 0.42) / 0.13) ** 2)
        curvature = (1.0 - flat) * (1.0 + amounts[0]) + amounts[1] * bumps
        angle = np.cumsum(curvature) * (2.0 * math.pi / _POINTS)
        return curvature, angle - angle[_POINTS // 2]

    def gaps(amounts: NDArray[np.float64]) -> tuple[float, float]:
        curvature, angle = belt(amounts)
        return float(curvature.mean()) - 1.0, float(np.cos(angle).mean())

    return belt(fsolve(gaps, np.array([0.05, 0.3])))


def rolled(speed_mps: NDArray[np.float64], rate_hz: float, depth_m: float = DEPTH_M) -> NDArray[np.float64]:
    """Return the samples of the circumferential, lateral and radial axis, (n, 3) m/s^2, at a speed at every sample."""
    curvature, angle = shape()
    omega = speed_mps / RADIUS_M
    omega_dot = np.gradient(omega) * rate_hz
    phase = (np.cumsum(omega) / rate_hz) % (2.0 * math.pi) - math.pi
    slope = np.gradient(curvature, 2.0 * math.pi / _POINTS)
    # What a lateral bend of the belt leaves: a step of the slope at either edge of the contact.
    sideways = 0.02 * np.where(_THETA < 0.0, 1.0, -0.8) * slope

    def over_time(curve: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.interp(phase, _THETA, curve, period=2.0 * math.pi)

    depth = depth_m / RADIUS_M
    radial = RADIUS_M * omega**2 * over_time(curvature * (1.0 - depth * curvature)) + GRAVITY_MPS2 * over_time(
        np.cos(angle)
    )
    along = -depth_m * omega**2 * over_time(slope) + GRAVITY_MPS2 * over_time(np.sin(angle))
    along += RADIUS_M * omega_dot * over_time(1.0 - np.cos(angle))
    lateral = RADIUS_M * omega**2 * over_time(sideways)
    samples = np.stack([along, lateral, radial], axis=1)
    return samples + np.random.default_rng(1).normal(0.0, 3.0, samples.shape)
