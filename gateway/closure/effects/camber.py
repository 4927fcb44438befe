"""The wheel leans, or the road is banked, and nobody declares it."""

from __future__ import annotations

import math
from typing import Final

from gateway.closure.effects.base import (
    LATERAL,
    NOWHERE,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
    bare,
)
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.types import FloatArray

# Cars are set to -3 to 1 deg, for circuits to -5; banked roads lean up to 4 deg (7 %), and suspensions roll.
_MOST_RAD: Final = math.radians(6.0)


class Camber:
    """Gravity along the axle. What it takes from gravity in the wheel's plane, 0.5 % of it at 6 deg, is not in it."""

    name = "camber"
    summary = "The wheel leans towards the road's normal, or the road is banked: gravity is felt along the axle."
    equation = "adds g sin(camber) to the lateral axis, at every speed"
    parameters: tuple[Parameter, ...] = (
        Parameter("camber_rad", "rad", -_MOST_RAD, _MOST_RAD, 0.03, 1e-4, factor=math.degrees(1.0), display_unit="deg"),
    )
    seen_by = "order 0 of the lateral axis of a DC-coupled sensor, the same at every speed, load and direction"
    confused_with = (
        "zero-g offset of the lateral axis: no recording of a rolling tire tells them, but the sensor at rest with the "
        "axle level; roll tilt, which grows with the square of speed"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.BELT
    axes: tuple[int, ...] = (LATERAL,)
    linear = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one: it is nearly linear."""
        return ((0.02,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the constant; an AC-coupled sensor does not pass it."""
        change = bare(here)
        if not here.conditions.ac_coupled:
            change[LATERAL] = STANDARD_GRAVITY_MPS2 * math.sin(float(parameters[0]))
        return change

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return its derivative by the angle."""
        change = bare(here)
        if not here.conditions.ac_coupled:
            change[LATERAL] = STANDARD_GRAVITY_MPS2 * math.cos(float(parameters[0]))
        return change[None]


EFFECT = Camber()
