"""The sensor does not pass the steady value, and turns the phase of what changes slowly."""

from __future__ import annotations

import math

import numpy as np

from gateway.closure.effects.base import (
    CIRCUMFERENTIAL,
    LATERAL,
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
)
from gateway.closure.effects.order_filter import ORDER, filtered
from gateway.types import FloatArray


class AcCoupling:
    """A one-pole high-pass on all three axes; a corner of 0 is a DC-coupled sensor."""

    name = "AC coupling"
    summary = "A high-pass behind the element: the mean is lost and the plateaus droop."
    equation = "order n times i n omega / (i n omega + 2 pi corner); order 0 is lost"
    # Charge amplifiers and coupling capacitors: 0.01 to 10 Hz, beyond that the free arc would droop to nothing.
    parameters: tuple[Parameter, ...] = (Parameter("corner_hz", "Hz", 0.0, 20.0, 2.0, 1e-3),)
    seen_by = "lowest orders of all axes, best at low speed; the lost mean of a sensor declared as DC-coupled"
    confused_with = (
        "speed drift within the revolution, which droops alike but with the sign of the acceleration and with speed; "
        "zero-g offset, which changes the mean alone"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.ELECTRIC
    axes: tuple[int, ...] = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    linear = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return a usual corner."""
        return ((0.5,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what the filter changes; any corner but 0 takes the whole mean, also of a sensor declared as DC."""
        corner = float(parameters[0])
        if corner == 0.0:
            return np.zeros_like(here.signal_mps2)
        decay = self._decay(here) * corner
        return filtered(here.signal_mps2, -decay / (1j * ORDER + decay))

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return its derivative by the corner; the mean is lost at once, so it has none."""
        decay = self._decay(here)
        below = 1j * ORDER + decay * float(parameters[0])
        below[0] = 1.0
        return filtered(here.signal_mps2, -decay * 1j * ORDER / below**2)[None]

    @staticmethod
    def _decay(here: Here) -> float:
        """Return by how much a plateau droops per radian and Hz of corner."""
        return 2.0 * math.pi / here.conditions.omega_radps


EFFECT = AcCoupling()
