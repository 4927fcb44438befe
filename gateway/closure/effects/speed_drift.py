"""Speed that changes within the revolution."""

from __future__ import annotations

import numpy as np

from gateway.closure.effects.base import CIRCUMFERENTIAL, CORRECTED, RADIAL, Conditions, Here, Parameter, Stage, bare
from gateway.closure.effects.belt import closed_shape, from_mid_revolution, spin_projections
from gateway.types import FloatArray


class SpeedDrift:
    """A wheel that speeds up or slows down steadily through a revolution."""

    name = "speed drift"
    summary = "The wheel's speed changes within the revolution: a sawtooth on omega^2, and the reaction to the change."
    equation = "domega/dt (2 theta' s / omega^2 + spin), theta' = angle rolled since mid revolution"
    parameters = (
        # The acceleration is measured, by the periods, to a few percent of what it has to be to be seen at all.
        Parameter("share", "", 0.8, 1.2, 0.01, 1e-3, prior_mean=1.0, display_unit="of known size"),
    )
    seen_by = "Sine orders falling with 1/n, in proportion to the measured acceleration; its sign turns when braking."
    confused_with = (
        "Damping and traction make sine orders too, but without the jump at the contact, and at constant speed. "
        "AC coupling tilts the revolution likewise, whatever the acceleration."
    )
    already_in = CORRECTED
    stage = Stage.BELT
    axes = (CIRCUMFERENTIAL, RADIAL)
    linear = True

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one start: the effect is linear."""
        return ((1.0,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return the share of what the measured acceleration does; it needs R omega^2 though a model lacks its mean."""
        result: FloatArray = float(parameters[0]) * self.derivative(here, parameters)[0]
        return result

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return domega/dt (2 theta' shape + spin)."""
        row = bare(here)
        if here.conditions.omega_dot_radps2:
            twice = 2.0 * from_mid_revolution(here.theta_rad)
            along, radial = spin_projections(here)
            row[CIRCUMFERENTIAL] = twice * here.shape.circumferential_m + along
            row[RADIAL] = twice * closed_shape(here) + radial
            row *= here.conditions.omega_dot_radps2
        return row[np.newaxis]


EFFECT = SpeedDrift()
