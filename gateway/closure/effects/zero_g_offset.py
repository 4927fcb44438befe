"""The sensor reads something where there is nothing."""

from __future__ import annotations

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
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.types import FloatArray


def _offset(axis: str) -> Parameter:
    # Elements for 200 to 2000 g: 1 to 2 g as a rule, 1 % of full scale at worst.
    return Parameter(
        f"{axis}_mps2", "m/s^2", -300.0, 300.0, 20.0, 0.01, factor=1.0 / STANDARD_GRAVITY_MPS2, display_unit="g"
    )


class ZeroGOffset:
    """Constant added to each axis."""

    name = "zero-g offset"
    summary = "The sensor adds a constant to each axis, whatever the speed."
    equation = "adds to each axis a constant of its own"
    parameters: tuple[Parameter, ...] = (_offset("circumferential"), _offset("lateral"), _offset("radial"))
    seen_by = "order 0 of a DC-coupled sensor; the radial axis needs two speeds"
    confused_with = (
        "gain and rolling radius (radial), roll tilt (lateral), pitch tilt (circumferential): all of these grow with "
        "the square of speed; camber, which is a constant of the lateral axis too"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage = Stage.ELEMENT
    axes: tuple[int, ...] = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    linear = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one for all three axes."""
        return ((5.0, 5.0, 5.0),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the constants; an AC-coupled sensor does not pass them."""
        return np.repeat((_passed(here) * parameters)[:, None], here.signal_mps2.shape[1], axis=1)

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return ones, each on its axis."""
        change = np.zeros((3, *here.signal_mps2.shape))
        change[[0, 1, 2], [0, 1, 2]] = _passed(here)[:, None]
        return change


def _passed(here: Here) -> FloatArray:
    """Return by how much each constant shows; in reverse the data's circumferential axis is turned round."""
    if here.conditions.ac_coupled:
        return np.zeros(3)
    return np.array([-1.0 if here.conditions.reverse else 1.0, 1.0, 1.0])


EFFECT = ZeroGOffset()
