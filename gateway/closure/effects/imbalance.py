"""Imbalance: the hub shaken up and down once a revolution."""

from __future__ import annotations

import numpy as np

from gateway.closure.effects.base import CIRCUMFERENTIAL, NOWHERE, RADIAL, Conditions, Here, Parameter, Stage, bare
from gateway.closure.effects.belt import gravity_projections
from gateway.types import FloatArray

# 20 g at 0.2 m on 40 kg of unsprung mass is 0.1 mm; 150 g, and a wheel hop resonance near order 1, is 3 mm.
_LARGEST_M = 3e-3
_MM = 1e3


class Imbalance:
    """Vertical acceleration of the hub, in step with the wheel."""

    name = "imbalance and hub motion"
    summary = "The hub is shaken vertically once a revolution, and the whole wheel with it; what is in step with it."
    equation = "omega^2 (x cos(theta) + y sin(theta)) felt like gravity: times cos(psi) radially, sin(psi) along"
    parameters = (
        Parameter("cosine_m", "m", -_LARGEST_M, _LARGEST_M, 2e-3, 1e-6, factor=_MM, display_unit="mm"),
        Parameter("sine_m", "m", -_LARGEST_M, _LARGEST_M, 2e-3, 1e-6, factor=_MM, display_unit="mm"),
    )
    seen_by = "Orders 0 and 2 (and what the contact makes of them), radial and circumferential alike; with omega^2."
    confused_with = (
        "On the radial axis alone: torsional ripple of order 2 or 1 (0.9 alike), zero-g offset (0.9), gain (0.8); the "
        "circumferential axis leaves zero-g offset (0.7, 0.55 with two speeds) and gain (0.6). Near wheel hop it does "
        "not go with omega^2."
    )
    already_in = NOWHERE
    stage = Stage.BELT
    axes = (CIRCUMFERENTIAL, RADIAL)
    linear = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one start: the effect is linear."""
        return ((1e-4, 1e-4),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the hub's acceleration on both axes of the wheel's plane."""
        result: FloatArray = np.tensordot(parameters, self.derivative(here, parameters), 1)
        return result

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return omega^2 cos(theta) and sin(theta) of the projections; the heavy spot sits still beside the sensor.

        Rolling the other way it is the mirror image: what came ahead comes behind.
        """
        conditions = here.conditions
        rows = np.stack([bare(here)] * 2)
        felt = conditions.omega_radps**2 * gravity_projections(here)
        waves = (np.cos(here.theta_rad), np.sin(here.theta_rad) * (-1.0 if conditions.reverse else 1.0))
        for row, wave in zip(rows, waves, strict=True):
            row[[CIRCUMFERENTIAL, RADIAL]] = wave * felt
        return rows


EFFECT = Imbalance()
