"""Belt kinematics: a sensor that turns with the belt reads n^2 - 1, not n^2, of a standing deformation."""

from __future__ import annotations

from dataclasses import replace

from gateway.closure.effects.base import CORRECTED, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray


class BeltKinematics:
    """What Eq. 25 lacks, and Eq. 23 with it: centripetal and Coriolis terms, and a road that pushes vertically."""

    name = "belt kinematics (n^2-1)"
    summary = "The sensor turns with the belt and the road pushes vertically: order n of the deflection reads n^2 - 1."
    equation = "order n reads (n^2 - 1) w_n of a vertical push in place of n^2 w_n of a radial one, w the deflection"
    # It is either so or not. On the exact ring at 3000 to 8000 N it comes out as 0.69 to 0.84 beside the pressure's
    # shape alone, and as 1.01 to 1.08 when the belt's tension loss is in as well.
    parameters = (
        Parameter(
            "share", "", low=0.6, high=1.4, prior_std=0.01, step=0.05, prior_mean=1.0, display_unit="of known size"
        ),
    )
    seen_by = "radial axis, lowest orders: all of order 1, a quarter of order 2; any speed and load"
    confused_with = "gravity (order 1 only, does not grow with speed); sidewall numbers Rs and Ts"
    already_in = CORRECTED
    needs_exact = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return the one start: all of it."""
        return ((1.0,),)

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the share of the corrected kinematics."""
        return replace(options, kinematics=options.kinematics + float(parameters[0]))


EFFECT = BeltKinematics()
