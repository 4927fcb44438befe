"""Carcass compliance: a slip angle drags the tread sideways, and belt and sidewall give way."""

from __future__ import annotations

import math

from gateway.closure.effects.base import NOWHERE, Parameter, StartModel
from gateway.closure.effects.lateral_load import STIFFNESSES, LateralLoad
from gateway.closure.lateral_response import Load


class CarcassCompliance(LateralLoad):
    """Side force of a tread that sticks to the road at a slip angle, on a belt that is not rigid sideways."""

    name: str = "carcass compliance"
    summary: str = (
        "The tire runs at a slip angle (toe, cornering), and its belt gives way sideways under the side force."
    )
    equation: str = (
        "lateral = omega^2 y'', y the belt's sideways shift over theta, belt pushed by "
        "cy (alpha s - y + y(leading edge)) in the contact; no sliding"
    )
    # Beyond about a degree the tread slides over much of the contact, which is not in it.
    parameters: tuple[Parameter, ...] = (
        Parameter("slip_angle_rad", "rad", -0.02, 0.02, 0.01, 1e-5, factor=math.degrees(1.0), display_unit="deg"),
        *STIFFNESSES,
    )
    seen_by: str = "lateral axis, orders 1 to 40, from the contact on; grows with speed squared and with load"
    confused_with: str = (
        "beside ply steer, a softer or stiffer tread (below 0.1 deg nothing tells them but another slip angle);"
        " conicity (cosine 0.2): several loads. In reverse a cornering force stays and a toe angle turns its sign, as"
        " ply steer does; it is taken to stay."
    )
    already_in: frozenset[StartModel] = NOWHERE
    load = Load.SLIP
    typical = 2e-3


EFFECT = CarcassCompliance()
