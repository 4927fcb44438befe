"""The spectrum of noise behind a resonance, and how strong what shakes a wheel is at a speed."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gateway.closure.effects.base import Conditions
from gateway.types import FloatArray

REFERENCE_MPS: Final = 65.0 / 3.6
"""Speed at which sizes are stated."""


def relative_speed(conditions: Conditions) -> float:
    """Return the speed over 65 km/h. What a road excites is in proportion to it: its slopes are passed faster."""
    return conditions.omega_radps * conditions.radius_m / REFERENCE_MPS


def bell(frequency_hz: FloatArray, centre_hz: float, width_hz: float) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the density of unit power behind a two-pole resonance, and its derivatives.

    B(f) = 2 / (pi width) / (1 + ((f^2 - centre^2) / (f width))^2), integral 1 over f > 0; 0 at f = 0.

    Args:
        frequency_hz: (m,) not negative.
        centre_hz: of the resonance.
        width_hz: between the points of half the power.

    Returns:
        density, d density / d centre, d density / d width; (m,) each, per Hz.
    """
    frequency = np.maximum(frequency_hz, 1e-9)
    away = (frequency - centre_hz * (centre_hz / frequency)) / width_hz
    fall = 1.0 / (1.0 + np.square(away))
    density = (2.0 / (math.pi * width_hz)) * fall
    per_centre = density * fall * away * (4.0 * centre_hz / width_hz) / frequency
    per_width = density / width_hz * (2.0 * fall * np.square(away) - 1.0)
    return density, per_centre, per_width
