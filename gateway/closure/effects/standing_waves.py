"""Tire-locked edge waves: packets from both edges of the contact that stand still on the road, part of the shape."""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.closure.effects.base import CIRCUMFERENTIAL, NOWHERE, RADIAL, Conditions, Here, Stage
from gateway.closure.effects.edge_waves import EFFECT as TRAVELLING
from gateway.closure.effects.edge_waves import NO_PITCH, ORDERS_AFTER, ORDERS_BEFORE, no_wave
from gateway.types import FloatArray

# A linear fit from here sees slopes by shape through these amplitudes: with small ones it would leap.
_START: Final = (0.3, 0.3, 40.0, 2.5, 0.3, 0.3, 40.0, 2.5)
_DECAYS: Final = (5.0, 1.4, 0.7)


class StandingWaves:
    """Decaying packets from the leading and the trailing edge that are a part of the belt's steady shape."""

    name = "tire-locked edge waves"
    summary = "The belt's steady shape ripples outside the contact, from both its edges, alike in every revolution."
    equation = (
        "R omega^2 (a cos(n d) + b sin(n d)) exp(-decay d) on either side, d = distance from the edge; orders 0 and 1 "
        "taken out; circumferential: -(e/R) times its slope"
    )
    parameters = TRAVELLING.parameters[: len(_START)]
    seen_by = "Radial, outside the contact, above the ring's own orders; with omega^2; circumferential with an offset."
    confused_with = (
        "Travelling edge waves, whose circumferential share has another size and sign, and whose orders change with "
        "speed; tread pitch of the same order (0.9 alike), which is in the contact as well; torsional ripple of that "
        "order (0.6, which is all around); edge scatter and shear flexibility at the edges themselves (0.2)."
    )
    form_of = "edge waves"
    already_in = NOWHERE
    stage = Stage.BELT
    axes = (CIRCUMFERENTIAL, RADIAL)
    linear = False
    # After, before, and after again now that the packet before is known.
    scan = ((6, ORDERS_AFTER), (2, ORDERS_BEFORE), (6, ORDERS_AFTER), (3, _DECAYS), (7, _DECAYS))

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one start; `scan` goes on from it."""
        return (_START,)

    def reason_against(self, parameters: FloatArray, std: FloatArray) -> str:
        """Refuse packets that end within one wave."""
        return no_wave(parameters, std)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the packets: those that travel, without a pitch."""
        return TRAVELLING.contribution(here, np.concatenate([parameters, NO_PITCH]))

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the derivatives by amplitudes and shapes."""
        return TRAVELLING.derivative(here, np.concatenate([parameters, NO_PITCH]))[: len(parameters)]


EFFECT = StandingWaves()
