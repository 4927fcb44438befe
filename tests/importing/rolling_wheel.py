"""Columns of a measurement of rolling wheels, with the speeds and angles that were put in."""

from dataclasses import dataclass

import numpy as np

from gateway.core.types import FloatArray

RADIUS_M = 0.32


@dataclass(frozen=True)
class RollingWheel:
    """A wheel whose speed varies slowly.

    Attributes:
        times_s: (n,) times.
        angle_rad: (n,) angle of the sensor, 0 at the contact centre, increasing.
        speed_mps: (n,) speed.
        axes_mps2: (n, 3) circumferential, lateral, radial.
    """

    times_s: FloatArray
    angle_rad: FloatArray
    speed_mps: FloatArray
    axes_mps2: FloatArray


def rolling(rate_hz: float = 9600.0, seconds: float = 4.0, speed_mps: float = 18.0, seed: int = 1) -> RollingWheel:
    """Return a wheel: V^2/R, in the contact 0 between two peaks; with noise, and 2 % of acceleration a second."""
    times = np.arange(round(rate_hz * seconds)) / rate_hz
    speed = speed_mps * (1.0 + 0.02 * times)
    turned = speed_mps * (times + 0.01 * times**2) / RADIUS_M + 1.0
    angle = (turned + np.pi) % (2 * np.pi) - np.pi
    inside = 0.5 * (1 - np.tanh((np.abs(angle) - 0.2) / 0.02))
    peaks = 0.4 * np.exp(-(((np.abs(angle) - 0.3) / 0.05) ** 2))
    steady = speed**2 / RADIUS_M
    noise = np.random.default_rng(seed).normal(size=(len(times), 3)) * 0.01 * steady[:, None]
    edge = np.exp(-(((angle - 0.25) / 0.05) ** 2)) - np.exp(-(((angle + 0.25) / 0.05) ** 2))
    clean = np.column_stack((0.6 * steady * edge, 0.1 * steady * edge**2, steady * (1 - inside + peaks)))
    return RollingWheel(times, turned, speed, clean + noise)
