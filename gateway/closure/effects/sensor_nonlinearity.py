"""The radial axis is not straight: its sensitivity changes with the acceleration itself."""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.closure.effects.base import (
    NOWHERE,
    RADIAL,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
)
from gateway.types import FloatArray

# R omega^2 of a car's tire at 65 km/h: where its sensor works.
_SHOWN_AT_MPS2: Final = 1000.0
# Data sheets of high-g elements allow 0.5 to 2 % of full scale; 3 % of the reading at 2000 m/s^2 (200 g) by either term
# is beyond any that is sold. Two larger ones of opposite sign would pass for any gain at one speed.
_LARGEST: Final = 0.03
_LARGEST_AT_MPS2: Final = 2000.0
# Half a percent there, by either term.
_START: Final = tuple(0.005 / _LARGEST_AT_MPS2**power for power in (1, 2))


def _term(name: str, unit: str, power: int) -> Parameter:
    most = _LARGEST / _LARGEST_AT_MPS2**power
    return Parameter(
        name,
        unit,
        low=-most,
        high=most,
        prior_std=0.4 * most,
        step=1e-3 * most,
        factor=100.0 * _SHOWN_AT_MPS2**power,
        display_unit=f"% at {_SHOWN_AT_MPS2:.0f} m/s^2",
    )


class SensorNonlinearity:
    """Quadratic and cubic error of the radial axis."""

    name = "sensor nonlinearity"
    summary = "The radial axis reads more or less in proportion the larger what it reads: its response is bent."
    equation = "adds square * a^2 + cube * a^3 to the radial axis, a its acceleration"
    parameters: tuple[Parameter, ...] = (
        _term("square_s2pm", "s^2/m", 1),
        _term("cube_s4pm2", "s^4/m^2", 2),
    )
    seen_by = (
        "radial axis: free arc, overshoot and contact by different shares; two speeds: the square is a gain that grows "
        "with omega^2, the cube one with omega^4; needs a DC-coupled sensor"
    )
    confused_with = (
        "gain, rolling radius and run-out, which scale overshoot and free arc alike, and all speeds; clipping, which "
        "leaves all below its limit as it is; belt extension, whose order 0 grows with omega^4 as the square's does"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.ELEMENT
    axes: tuple[int, ...] = (RADIAL,)
    linear = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one: it is linear in its parameters."""
        return (_START,)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what the bend adds to the radial axis."""
        change: FloatArray = np.tensordot(parameters, self.derivative(here, parameters), 1)
        return change

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the radial axis' square and cube."""
        radial = here.signal_mps2[RADIAL]
        change = np.zeros((2, *here.signal_mps2.shape))
        change[0, RADIAL] = radial * radial
        change[1, RADIAL] = radial * change[0, RADIAL]
        return change


EFFECT = SensorNonlinearity()
