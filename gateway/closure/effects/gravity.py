"""Gravity along the belt's own directions."""

from __future__ import annotations

import numpy as np

from gateway.closure.effects.base import CIRCUMFERENTIAL, CORRECTED, RADIAL, Conditions, Here, Parameter, Stage, bare
from gateway.closure.effects.belt import gravity_projections
from gateway.constants import STANDARD_GRAVITY_MPS2
from gateway.types import FloatArray


class Gravity:
    """Specific force of a sensor that turns with the belt in the field of the earth."""

    name = "gravity"
    summary = "The sensor's axes turn in the earth's field, with the belt's own angle, not the wheel's."
    equation = "radial g cos(psi), circumferential g sin(psi); psi = integral of kappa R dtheta from the contact"
    parameters = (
        # It is 9.80665 m/s^2 within 0.3 % anywhere on earth; what is left of the range is for the sensor's gain and for
        # what the model's psi is off by.
        Parameter("gravity_share", "", 0.8, 1.2, 0.01, 1e-3, prior_mean=1.0, display_unit="of known size"),
    )
    seen_by = "Order 1 and those that the contact makes of it, radial and circumferential; constant over speed."
    confused_with = (
        "At one speed any error of order 1 (the paper's n^2 for n^2 - 1 is one): gravity is the same at every speed "
        "and loud on the circumferential axis. Imbalance makes orders 0 and 2."
    )
    already_in = CORRECTED
    stage = Stage.BELT
    axes = (CIRCUMFERENTIAL, RADIAL)
    linear = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one start: the effect is linear."""
        return ((1.0,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return share * g on both axes of the wheel's plane."""
        result: FloatArray = float(parameters[0]) * self.derivative(here, parameters)[0]
        return result

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return g times its projections."""
        row = bare(here)
        row[[CIRCUMFERENTIAL, RADIAL]] = STANDARD_GRAVITY_MPS2 * gravity_projections(here)
        return row[np.newaxis]


EFFECT = Gravity()
