"""Conicity: a belt that is part of a cone curves in its own plane when the contact flattens it."""

from __future__ import annotations

from gateway.closure.effects.base import NOWHERE, Parameter, StartModel
from gateway.closure.effects.lateral_load import STIFFNESSES, LateralLoad
from gateway.closure.lateral_response import Load


class Conicity(LateralLoad):
    """A cone of half angle beta, flattened, has the in-plane curvature beta / R."""

    name: str = "conicity"
    summary: str = "The belt is part of a cone, and curves in its own plane where the contact flattens it."
    equation: str = (
        "lateral = omega^2 y'', y the belt's sideways shift over theta, belt curved by -beta (kappa - 1/R); "
        "the same in both directions of rotation"
    )
    # In this belt 10 mrad pull some 60 N at 5 kN; tires that pull by more than about 100 N are not sold.
    parameters: tuple[Parameter, ...] = (
        Parameter("cone_rad", "rad", -0.05, 0.05, 0.02, 1e-4, factor=1e3, display_unit="mrad"),
        *STIFFNESSES,
    )
    seen_by: str = "lateral axis, orders 1 to 40, around the contact; grows with speed squared; any load"
    confused_with: str = (
        "roll tilt without its mean (cosine 0.98): an AC-coupled sensor, or a free zero-g offset at one speed, leaves"
        " 1 to 4 % of it to tell them; two speeds or a declared offset decide; ply steer (0.04), which turns its"
        " sign in reverse; a side force (0.2; carcass compliance): several loads"
    )
    already_in: frozenset[StartModel] = NOWHERE
    load = Load.CONE
    typical = 0.01


EFFECT = Conicity()
