"""The sensor is turned about the circumferential axis, beyond what is declared."""

from __future__ import annotations

import math

from gateway.closure.effects.base import (
    LATERAL,
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
)
from gateway.closure.effects.leak import turned, turned_slope
from gateway.types import FloatArray


class RollTilt:
    """Rotation about the circumferential axis: radial leaks into +lateral."""

    name = "roll tilt"
    summary = (
        "The sensor is turned about the circumferential axis: the radial acceleration leaks into the lateral axis."
    )
    equation = "lateral reads cos(roll) lateral + sin(roll) radial, radial reads cos(roll) radial - sin(roll) lateral"
    # A sensor glued by hand sits within 5 deg; what is beyond 20 deg the pipeline reports as a wrong mounting.
    parameters: tuple[Parameter, ...] = (
        Parameter("roll_rad", "rad", -0.35, 0.35, 0.05, 1e-4, factor=math.degrees(1.0), display_unit="deg"),
    )
    seen_by = "lateral axis: a copy of the radial waveform, in proportion to it at every speed and load"
    confused_with = (
        "zero-g offset of the lateral axis, which is order 0 alone and does not grow with speed; "
        "ply steer and conicity, whose waveforms are confined to the contact"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.MOUNTING
    axes: tuple[int, ...] = (LATERAL, RADIAL)
    linear = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one: to a percent it is linear."""
        return ((0.02,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what the rotation changes."""
        return turned(here, LATERAL, float(parameters[0]))

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return its derivative by the angle."""
        return turned_slope(here, LATERAL, float(parameters[0]))[None]


EFFECT = RollTilt()
