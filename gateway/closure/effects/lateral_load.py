"""What ply steer, conicity and carcass compliance have in common: one load on the belt, three stiffnesses."""

from __future__ import annotations

from typing import ClassVar, Final

import numpy as np

from gateway.closure.effects.base import LATERAL, Conditions, Here, Parameter, Stage, bare
from gateway.closure.lateral_response import Load, Response, Stiffness, unit_response
from gateway.types import FloatArray


def _stiffness(name: str) -> Parameter:
    # A factor of 5 either way holds belts from 0.2 to 5 kN m^2 in their plane, sidewalls from 0.05 to 1.2 MPa; tires of
    # one class differ by half as much. Far beyond it a cone looks like roll tilt and ply steer like a yawed sensor.
    return Parameter(f"{name}_ln", "", low=-1.6, high=1.6, prior_std=0.6, step=1e-3)


STIFFNESSES: Final = (_stiffness("bending"), _stiffness("sidewall"), _stiffness("tread"))
"""Logarithms of the belt's in-plane bending, the lateral sidewall's and the tread's stiffness over a car tire's."""


class LateralLoad:
    """Lateral axis = size * omega^2 * d2y/dtheta2 of the belt under a unit of one load.

    Attributes:
        load: which one.
        typical: size that a fit starts from.
    """

    load: ClassVar[Load]
    typical: ClassVar[float]
    stage: Stage = Stage.BELT
    axes: tuple[int, ...] = (LATERAL,)
    linear: bool = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one start: a linear scan finds the sign, and the stiffnesses begin at a car tire's."""
        return ((self.typical, 0.0, 0.0, 0.0),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the lateral axis, (3, FIELD_SIZE) m/s^2."""
        added = bare(here)
        added[LATERAL] = parameters[0] * self._scale(here) * self._unit(here, parameters).lateral_m
        return added

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return d contribution / d parameters, (4, 3, FIELD_SIZE)."""
        unit, scale = self._unit(here, parameters), self._scale(here)
        result = np.zeros((4, *here.signal_mps2.shape))
        result[0, LATERAL] = scale * unit.lateral_m
        result[1:, LATERAL] = parameters[0] * scale * unit.derivative_m
        return result

    def _unit(self, here: Here, parameters: FloatArray) -> Response:
        return unit_response(here, self.load, Stiffness(*(float(value) for value in parameters[1:])))

    def _scale(self, here: Here) -> float:
        """Return the factor of the unit response: omega^2, with the load's sign where it turns with the direction."""
        return here.conditions.omega_radps**2
