"""Ply steer: a belt of crossed plies shears when the contact bends it flat."""

from __future__ import annotations

from gateway.closure.effects.base import NOWHERE, Here, Parameter, StartModel
from gateway.closure.effects.lateral_load import STIFFNESSES, LateralLoad
from gateway.closure.lateral_response import Load


class PlySteer(LateralLoad):
    """Ply steer paper, Eq. 8 and 13, with the belt's own stiffness and the sticking tread between them."""

    name: str = "ply steer"
    summary: str = (
        "The belt's crossed plies turn bending into in-plane shear, so it moves sideways through the contact."
    )
    equation: str = (
        "lateral = omega^2 y'', y the belt's sideways shift over theta, belt sheared by gamma = -g (kappa - 1/R); "
        "-g when rolling in reverse"
    )
    # g = (t/2) cot(delta): 1.0 to 2.5 mm for plies at 18 to 30 degrees, 1.2 to 1.6 mm apart; less when the belt can
    # curve and twist (docs/ply-steer.md). Its sign is the order of the plies.
    parameters: tuple[Parameter, ...] = (
        Parameter("coupling_length_m", "m", -4e-3, 4e-3, 1.5e-3, 1e-5, factor=1e3, display_unit="mm"),
        *STIFFNESSES,
    )
    seen_by: str = "lateral axis, orders 1 to 60, around the contact; grows with speed squared; any load"
    confused_with: str = (
        "conicity: one direction of rotation is enough (cosine of the two 0.04), rolling in reverse decides without a"
        " model of the belt; a slip angle below 0.1 deg beside it: looks like another stiffness of tread, told by a"
        " recording at another slip angle; a yawed sensor below the neutral layer (cosine 0.97): two speeds, for"
        " gravity leaks too"
    )
    already_in: frozenset[StartModel] = NOWHERE
    load = Load.PLY_STEER
    typical = 1.2e-3

    def _scale(self, here: Here) -> float:
        return -super()._scale(here) if here.conditions.reverse else super()._scale(here)


EFFECT = PlySteer()
