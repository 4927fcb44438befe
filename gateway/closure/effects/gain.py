"""The radial axis reads too much or too little, in proportion."""

from __future__ import annotations

from gateway.closure.effects.base import (
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
    bare,
)
from gateway.types import FloatArray


class Gain:
    """Relative gain error of the radial axis."""

    name = "gain"
    summary = "The radial axis reads too much in proportion to what it should, gravity included."
    equation = "adds error times the radial acceleration to the radial axis"
    # Data sheets of high-g elements allow 5 to 15 % over lots and life.
    parameters: tuple[Parameter, ...] = (Parameter("error", "", -0.2, 0.2, 0.05, 1e-4, factor=100.0, display_unit="%"),)
    seen_by = (
        "radial axis, any speed and load: a closed belt's mean is R omega^2; needs a DC-coupled sensor or a contact"
    )
    confused_with = (
        "rolling radius and sample clock error, which leave gravity (order 1 at low speed) as it is and scale the "
        "circumferential axis too; mounting offset at one load without circumferential axis; zero-g offset at one speed"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.ELEMENT
    axes: tuple[int, ...] = (RADIAL,)
    linear = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one percent."""
        return ((0.01,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the share of the radial axis."""
        change = bare(here)
        change[RADIAL] = float(parameters[0]) * here.signal_mps2[RADIAL]
        return change

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the radial axis."""
        change = bare(here)
        change[RADIAL] = here.signal_mps2[RADIAL]
        return change[None]


EFFECT = Gain()
