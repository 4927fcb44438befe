"""The part of a signal that grows with the size of the belt and the square of its speed: all but gravity."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gateway.closure.effects.base import CIRCUMFERENTIAL, FIELD_SIZE, RADIAL, Here, bare
from gateway.types import FloatArray

# Angle turned since the middle of a revolution, which runs from contact centre to contact centre.
_FROM_MIDDLE_RAD: Final[FloatArray] = np.roll(
    -math.pi + 2.0 * math.pi / FIELD_SIZE * np.arange(FIELD_SIZE), FIELD_SIZE // 2
)


def belt_inertia(here: Here) -> FloatArray:
    """Return what the ring's motion alone makes the sensor read, (3, FIELD_SIZE) m/s^2, speed drift included."""
    conditions, shape = here.conditions, here.shape
    square = conditions.omega_radps**2 + 2.0 * conditions.omega_dot_radps2 * _FROM_MIDDLE_RAD
    inertia = bare(here)
    inertia[CIRCUMFERENTIAL] = (
        square * shape.circumferential_m + conditions.omega_dot_radps2 * shape.spin_circumferential_m
    )
    inertia[RADIAL] = square * shape.radial_m + conditions.omega_dot_radps2 * shape.spin_radial_m
    return inertia
