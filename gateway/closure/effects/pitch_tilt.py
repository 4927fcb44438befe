"""The sensor is turned about the lateral axis, beyond what is declared."""

from __future__ import annotations

import math

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
from gateway.closure.effects.leak import turned, turned_slope
from gateway.types import FloatArray


class PitchTilt:
    """Rotation about the lateral axis: radial leaks into +circumferential."""

    name = "pitch tilt"
    summary = (
        "The sensor is turned about the lateral axis: the radial acceleration leaks into the circumferential axis."
    )
    equation = (
        "circumferential reads cos(pitch) circumferential + sin(pitch) radial, radial reads cos(pitch) radial "
        "- sin(pitch) circumferential"
    )
    # As roll: within 5 deg when glued by hand, 20 deg at most.
    parameters: tuple[Parameter, ...] = (
        Parameter("pitch_rad", "rad", -0.35, 0.35, 0.05, 1e-4, factor=math.degrees(1.0), display_unit="deg"),
    )
    seen_by = "circumferential axis: a copy of the radial waveform, in proportion to it at every speed and load"
    confused_with = (
        "zero-g offset of the circumferential axis, which is order 0 alone and does not grow with speed; "
        "mounting offset, whose leak is the radial waveform's slope, not the waveform"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.MOUNTING
    axes: tuple[int, ...] = (CIRCUMFERENTIAL, RADIAL)
    linear = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one: to a percent it is linear."""
        return ((0.02,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what the rotation changes."""
        return turned(here, CIRCUMFERENTIAL, _sense(here) * float(parameters[0]))

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return its derivative by the angle."""
        sense = _sense(here)
        return sense * turned_slope(here, CIRCUMFERENTIAL, sense * float(parameters[0]))[None]


def _sense(here: Here) -> float:
    """Return -1 in reverse, where the circumferential axis of the data is turned to point along the rotation."""
    return -1.0 if here.conditions.reverse else 1.0


EFFECT = PitchTilt()
