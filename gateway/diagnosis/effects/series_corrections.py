"""Series corrections: the share of the exact ring that a linear series about the circle lacks."""

import math
from dataclasses import replace
from typing import Final

from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import EXACT_ONLY, RADIAL, Confounder, GroupConditions, Parameter, RingEffect
from gateway.diagnosis.effects.ring_options import RingOptions
from gateway.ring.reference_tire import TABLE_3_LOAD_NUMBER


class BeltKinematics(RingEffect):
    """Centripetal and Coriolis terms, and a road that pushes vertically, which the ring paper's Eq. 23 and 25 lack."""

    name = "belt kinematics (n^2-1)"
    rank = 10
    summary = "The sensor turns with the belt and the road pushes vertically: order n of the deflection reads n^2 - 1."
    equation = "order n reads (n^2 - 1) w_n of a vertical push in place of n^2 w_n of a radial one, w the deflection"
    source = "correction of the ring paper's Eq. 23 and 25"
    # All or nothing. On the exact ring at 3000 to 8000 N it is fitted as 0.69 to 0.84 beside the pressure shape alone,
    # and as 1.01 to 1.08 when the belt's tension loss is in as well.
    parameters = (
        Parameter(
            "share", "", low=0.6, high=1.4, prior_std=0.01, step=0.05, prior_mean=1.0, display_unit="of known size"
        ),
    )
    axes = (RADIAL,)
    observed_in = "radial axis, lowest orders: all of order 1, a quarter of order 2; any speed and load"
    confounders = (
        Confounder(("gravity",), "it is order 1 only and does not grow with speed"),
        Confounder(("sidewall numbers (Rs, Ts)",)),
    )
    start_values = ((1.0,),)
    already_in = EXACT_ONLY
    needs_exact = False
    option = "kinematics"


class PressureShape(RingEffect):
    """Even Legendre coefficients of the contact pressure, linear in the logarithm of the load number."""

    name = "pressure shape"
    rank = 20
    summary = "The contact pressure is not uniform: it falls towards the edges, and in the middle under high load."
    equation = (
        "q = Q / (2 R theta_r) (1 + a_2 P_2(x) + a_4 P_4(x) + a_6 P_6(x)), a_m = P_m + G_m ln(L / L_0), "
        "L = Q / (p0 R^2)"
    )
    source = "Legendre expansion about the ring paper's uniform pressure (Eq. 22)"
    # The exact ring runs from a parabola (-0.97, -0.02) at 1000 N through (-0.36, -0.59) at 5000 N to (-0.17, -0.60)
    # at 8000 N. A pressure cannot be negative at the edges, 1 + a_2 + a_4 >= 0, except that a uniform road force over a
    # contact found a few percent too long imitates it.
    parameters = (
        Parameter("P2", "", low=-1.3, high=0.5, prior_std=1.0, step=0.02),
        Parameter("P4", "", low=-1.1, high=0.5, prior_std=1.0, step=0.02),
        Parameter("P6", "", low=-1.0, high=1.0, prior_std=1.0, step=0.02),
        # Between 3000 and 8000 N the exact ring's G_2 is 0.6 on average, its G_4 -0.3.
        Parameter("G2", "", low=-1.5, high=1.5, prior_std=0.7, step=0.02),
        Parameter("G4", "", low=-1.5, high=1.5, prior_std=0.7, step=0.02),
        Parameter("G6", "", low=-1.5, high=1.5, prior_std=0.7, step=0.02),
    )
    axes = (RADIAL,)
    observed_in = "radial axis, orders above pi / theta_r, about 12; several loads for its change with load"
    confounders = (
        Confounder(("bending stiffness (Bs)",)),
        Confounder(
            ("geometric tension loss", "belt kinematics (n^2-1)"), "a fit with all three: alone, each is biased"
        ),
        Confounder(("anti-alias filter",), "another speed: it goes with frequency, not with order"),
    )
    # The exact ring's shapes at nominal and at low load.
    start_values = ((-0.35, -0.6, 0.0, 0.0, 0.0, 0.0), (-0.9, -0.1, 0.0, 0.0, 0.0, 0.0))
    already_in = EXACT_ONLY
    needs_exact = False

    def options(self, options: RingOptions, parameters: FloatArray, conditions: GroupConditions) -> RingOptions:
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


class TensionLoss(RingEffect):
    """Difference between the exact ring and the linear one under the same contact pressure, as a share of it."""

    name = "geometric tension loss"
    rank = 30
    summary = "The flattened belt turns by finite angles and loses tension in the contact (a third at 5000 N)."
    equation = "adds the exact ring's waveform less that of the linear ring under the same contact pressure"
    source = "finite rotation of the exact ring, which a series about the circle lacks"
    # It is geometry, all or nothing. Two Legendre coefficients do not follow the pressure of a high load, and with them
    # it is fitted on the exact ring as 1.01 to 1.04 from the corrected series and 1.07 to 1.25 from the printed one.
    parameters = (
        Parameter(
            "share", "", low=0.6, high=1.5, prior_std=0.01, step=0.05, prior_mean=1.0, display_unit="of known size"
        ),
    )
    axes = (RADIAL,)
    observed_in = "radial axis, any order, growing with the load; at one load as Cw, Rs and Ts that change with load"
    confounders = (
        Confounder(
            ("tension number (Cw) and sidewall numbers (Rs, Ts)",),
            "several loads; at one load they absorb 91 % of it and are up to 40 % off",
        ),
        Confounder(
            ("pressure shape", "belt kinematics (n^2-1)"),
            "a fit with all three: alone, each is biased",
            "0.5 to 0.9 until all are in",
        ),
    )
    start_values = ((1.0,),)
    already_in = EXACT_ONLY
    needs_exact = False
    option = "tension_loss"


EFFECTS: Final = (BeltKinematics(), PressureShape(), TensionLoss())
