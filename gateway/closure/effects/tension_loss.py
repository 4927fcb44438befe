"""Geometric tension loss: in the contact the belt turns by a finite angle, which a series about the circle lacks."""

from __future__ import annotations

from dataclasses import replace

from gateway.closure.effects.base import EXACT_ONLY, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.types import FloatArray


class TensionLoss:
    """What the exact ring has over the linear one under the same contact pressure, as a share of it."""

    name = "geometric tension loss"
    summary = "The flattened belt turns by finite angles and loses tension in the contact (a third at 5000 N)."
    equation = "adds what the exact ring reads less what the linear ring under the same contact pressure reads"
    # It is geometry, all or nothing. Two Legendre amounts do not follow the pressure of a high load, and with them it
    # comes out on the exact ring as 1.01 to 1.04 from the corrected series and 1.07 to 1.25 from the printed one.
    parameters = (
        Parameter(
            "share", "", low=0.6, high=1.5, prior_std=0.01, step=0.05, prior_mean=1.0, display_unit="of known size"
        ),
    )
    seen_by = "radial axis, any order, growing with the load; at one load as Cw, Rs and Ts that change with load"
    confused_with = (
        "tension number Cw and sidewall numbers at one load, which take up 91 % of it and end up to 40 % off; pressure "
        "shape and kinematics, 0.5 to 0.9 alike until all are in"
    )
    already_in = EXACT_ONLY
    needs_exact = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return the one start: all of it."""
        return ((1.0,),)

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the share."""
        return replace(options, tension_loss=options.tension_loss + float(parameters[0]))


EFFECT = TensionLoss()
