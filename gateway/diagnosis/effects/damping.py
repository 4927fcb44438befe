"""Damping: viscous losses of the sidewall, of the tread and of the belt in bending."""

from typing import Final

from gateway.diagnosis.effects.effect import Confounder, Parameter, RingEffect


class StructuralDamping(RingEffect):
    """Viscous sidewall with one damping time for radial and tangential deflection (c_n of the ring paper's Eq. 11)."""

    name = "structural damping"
    rank = 40
    summary = "Losses in the sidewall: the deflection lags behind the road, the contact leans forward."
    equation = "adds c omega du/dtheta to the sidewall's force, c = damping time * kw; loss angle omega * damping time"
    source = "ring paper, Eq. 11 (c_n), on the exact ring"
    # 3.3e-4 s is a rolling resistance of 0.7 % at 65 km/h; 2e-3 s would be 4 %, more than any tire has. Losses are
    # never negative.
    parameters = (
        Parameter("damping_time_s", "s", low=0.0, high=2e-3, prior_std=1e-3, step=2e-5, factor=1e3, display_unit="ms"),
    )
    observed_in = "radial axis, sine part of orders 2 to 8, growing as omega^3; two speeds separate it from geometry"
    confounders = (
        Confounder(
            ("contact asymmetry",), "it does not grow with speed", "0.98 at one speed, 0.96 over 40 to 100 km/h"
        ),
        Confounder(("tread damping (shifted pressure)",), "it acts in higher orders"),
        Confounder(("contact centre",)),
    )
    # A rolling resistance of about 0.7 %.
    start_values = ((3e-4,),)
    option = "damping_time_s"


class TreadDamping(RingEffect):
    """Viscous tread with one damping time."""

    name = "tread damping (shifted pressure)"
    title = "tread damping"
    rank = 50
    summary = "Losses in the tread: the contact pressure and the contact itself shift towards the leading edge."
    equation = "q = kt (penetration + damping time * omega d(penetration)/dtheta) where positive"
    source = "Kelvin-Voigt tread on the exact ring"
    # 7e-4 s is a rolling resistance of 0.66 % at 65 km/h; 3e-3 s is about 3 %, more than any tire has.
    parameters = (
        Parameter(
            "damping_time_s", "s", low=0.0, high=3e-3, prior_std=1.5e-3, step=5e-6, factor=1e3, display_unit="ms"
        ),
    )
    observed_in = "radial axis, sine part of orders above 8, at both contact edges; grows faster than omega^2"
    confounders = (
        Confounder(("structural damping", "contact asymmetry"), "they act in lower orders", "-0.3"),
        Confounder(("contact centre",)),
    )
    # A rolling resistance of about 0.5 %.
    start_values = ((5e-4,),)
    option = "tread_damping_time_s"


class BendingDamping(RingEffect):
    """Viscous bending of the belt with one damping time."""

    name = "bending damping"
    rank = 55
    summary = "Losses in the belt as it bends and straightens at the contact edges, which delay its curvature."
    equation = "M = EI (kappa - 1/R + damping time * omega dkappa/dtheta)"
    source = "Kelvin-Voigt belt on the exact ring"
    # Rubber's loss factor of 0.1 to 0.3 at the 50 to 200 Hz of a contact edge is 1e-4 to 1e-3 s.
    parameters = (
        Parameter("damping_time_s", "s", low=0.0, high=3e-3, prior_std=1e-3, step=2e-6, factor=1e3, display_unit="ms"),
    )
    observed_in = "radial axis, sine part of orders above 8, at both contact edges; grows faster than omega^2"
    confounders = (
        Confounder(("tread damping (shifted pressure)",), "it acts in lower orders and only in the contact"),
        Confounder(("anti-alias filter",), "its delay is that of every order, and does not grow with speed"),
        Confounder(("contact centre",)),
    )
    start_values = ((2e-4,),)
    option = "bending_damping_time_s"


EFFECTS: Final = (StructuralDamping(), TreadDamping(), BendingDamping())
