"""The belt's radius is not what was stated."""

from __future__ import annotations

import numpy as np

from gateway.closure.effects.base import (
    CIRCUMFERENTIAL,
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
)
from gateway.closure.effects.belt import relative_offset
from gateway.closure.effects.belt_inertia import belt_inertia
from gateway.types import FloatArray


class RollingRadius:
    """Relative error of the stated belt radius: the ring's own accelerations grow with it, gravity does not.

    Nor does what the sensor's depth e below the neutral layer adds: R (k - (e/R) k^2) and -e dk/dtheta, k = R kappa.
    """

    name = "rolling radius"
    summary = "The belt radius (rolling circumference / 2 pi) is larger than stated."
    equation = "adds error (a - gravity - what the offset adds): R is (1 + error) times the stated one"
    # Wear 2 %, make and inflation 1 %, the next tire size 4 %.
    parameters: tuple[Parameter, ...] = (Parameter("error", "", -0.1, 0.1, 0.03, 1e-4, factor=100.0, display_unit="%"),)
    seen_by = "radial axis, any speed: a closed belt's mean is R omega^2; a DC-coupled sensor or a contact"
    confused_with = (
        "sample clock error: the same to every waveform, only a second clock or the stated speed tells; gain, which "
        "scales gravity too (slow recordings tell) and leaves the circumferential axis as it is"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.BELT
    axes: tuple[int, ...] = (CIRCUMFERENTIAL, RADIAL)
    linear = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one percent."""
        return ((0.01,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the share of the ring's accelerations."""
        result: FloatArray = float(parameters[0]) * self.derivative(here, parameters)[0]
        return result

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the ring's accelerations without what the sensor's depth adds."""
        row = belt_inertia(here)
        offset = relative_offset(here)
        if offset:
            radius, square = here.conditions.radius_m, here.conditions.omega_radps**2
            level = here.shape.radial_m / radius
            curvature = level + offset * np.square(level)
            row[RADIAL] += square * radius * offset * np.square(curvature)
            row[CIRCUMFERENTIAL] -= square * here.shape.circumferential_m
        return row[None]


EFFECT = RollingRadius()
