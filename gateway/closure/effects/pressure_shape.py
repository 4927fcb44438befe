"""Pressure shape: the contact pressure is not uniform, and changes its shape with load."""

from __future__ import annotations

import math
from dataclasses import replace

from gateway.closure.effects.base import EXACT_ONLY, Conditions, Parameter
from gateway.closure.ring_options import RingOptions
from gateway.physics.reference_tire import TABLE_3_LOAD_NUMBER
from gateway.types import FloatArray


class PressureShape:
    """Even Legendre amounts of the contact pressure, straight over the logarithm of the load number."""

    name = "pressure shape"
    summary = "The contact pressure falls towards the edges (and in the middle under high load) and is not uniform."
    equation = (
        "q = Q / (2 R theta_r) (1 + a_2 P_2(x) + a_4 P_4(x) + a_6 P_6(x)), a_m = P_m + G_m ln(L / L_0), "
        "L = Q / (p0 R^2)"
    )
    # The exact ring runs from a parabola (-0.97, -0.02) at 1000 N through (-0.36, -0.59) at 5000 N to (-0.17, -0.60)
    # at 8000 N; a pressure cannot be negative at the edges, 1 + a_2 + a_4 >= 0, but for what a uniform road force over
    # a contact found a few percent too long feigns.
    parameters = (
        Parameter("P2", "", low=-1.3, high=0.5, prior_std=1.0, step=0.02),
        Parameter("P4", "", low=-1.1, high=0.5, prior_std=1.0, step=0.02),
        Parameter("P6", "", low=-1.0, high=1.0, prior_std=1.0, step=0.02),
        # Between 3000 and 8000 N the exact ring's G_2 is 0.6 on average, its G_4 -0.3.
        Parameter("G2", "", low=-1.5, high=1.5, prior_std=0.7, step=0.02),
        Parameter("G4", "", low=-1.5, high=1.5, prior_std=0.7, step=0.02),
        Parameter("G6", "", low=-1.5, high=1.5, prior_std=0.7, step=0.02),
    )
    seen_by = "radial axis, orders above pi / theta_r, about 12; several loads for its change with load"
    confused_with = (
        "bending (Bs); tension loss and kinematics until all are in; an anti-alias filter (goes with frequency, not "
        "order: another speed)"
    )
    already_in = EXACT_ONLY
    needs_exact = False
    # Of the exact ring's own pressure at 3000 to 6000 N three amounts, straight over the load, leave so much.
    equation_share = 0.03

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return the exact ring's shapes at low and at nominal load."""
        return ((-0.35, -0.6, 0.0, 0.0, 0.0, 0.0), (-0.9, -0.1, 0.0, 0.0, 0.0, 0.0))

    def options(self, options: RingOptions, parameters: FloatArray, conditions: Conditions) -> RingOptions:
        """Return the options with the pressure's shape at this load."""
        load_number = conditions.load_n / (conditions.pressure_pa * conditions.radius_m**2)
        growth = math.log(load_number / TABLE_3_LOAD_NUMBER)
        p2, p4, p6, g2, g4, g6 = (float(value) for value in parameters)
        return replace(
            options,
            pressure_p2=options.pressure_p2 + p2 + g2 * growth,
            pressure_p4=options.pressure_p4 + p4 + g4 * growth,
            pressure_p6=options.pressure_p6 + p6 + g6 * growth,
        )


EFFECT = PressureShape()
