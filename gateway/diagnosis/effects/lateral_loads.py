"""Lateral loads: ply steer, conicity, side force at a slip angle, and camber.

The first three push, shear or bend the belt sideways. They share the belt's lateral stiffnesses and its response,
`gateway.diagnosis.effects.lateral_response`.
"""

import math
from typing import ClassVar, Final

import numpy as np

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import (
    LATERAL,
    Confounder,
    GroupConditions,
    ModelledBlock,
    Parameter,
    SignalEffect,
    Stage,
)
from gateway.diagnosis.effects.lateral_response import Load, Response, Stiffness, unit_response

# Error of a stiffness, as a logarithm, by the error of an effect's equation.
_EQUATION_STD: Final = 0.15


def _stiffness(name: str) -> Parameter:
    # A factor of 5 either way covers belts from 0.2 to 5 kN m^2 in their plane, sidewalls from 0.05 to 1.2 MPa; tires
    # of one class differ by half as much. Far beyond it a cone looks like roll tilt and ply steer like a yawed sensor.
    return Parameter(f"{name}_ln", "", low=-1.6, high=1.6, prior_std=0.6, step=1e-3, shared_std=_EQUATION_STD)


STIFFNESSES: Final = (_stiffness("bending"), _stiffness("sidewall"), _stiffness("tread"))
"""Logarithms of the belt's in-plane bending, the lateral sidewall's and the tread's stiffness over a car tire's."""

# Cars are set to -3 to 1 deg, for circuits to -5; banked roads lean up to 4 deg (7 %), and suspensions roll.
_MAX_CAMBER_RAD: Final = math.radians(6.0)


class LateralLoad(SignalEffect):
    """Lateral axis = size * omega^2 * d2y/dtheta2 of the belt under a unit of one load.

    Attributes:
        load: the load.
    """

    load: ClassVar[Load]
    axes = (LATERAL,)
    stage = Stage.BELT

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the lateral axis, (3, FIELD_SIZE) m/s^2."""
        change = block.zeros()
        change[LATERAL] = parameters[0] * self._scale(block.conditions) * self._unit(block, parameters).lateral_m
        return change

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return d contribution / d parameters, (4, 3, FIELD_SIZE)."""
        unit, scale = self._unit(block, parameters), self._scale(block.conditions)
        result = np.zeros((4, *block.signal_mps2.shape))
        result[0, LATERAL] = scale * unit.lateral_m
        result[1:, LATERAL] = parameters[0] * scale * unit.derivative_m
        return result

    def _unit(self, block: ModelledBlock, parameters: FloatArray) -> Response:
        return unit_response(block, self.load, Stiffness(*(float(value) for value in parameters[1:])))

    def _scale(self, conditions: GroupConditions) -> float:
        """Return the factor of the unit response: omega^2, with the load's sign where it turns with the direction."""
        return conditions.omega_radps**2


def _start(size: float) -> tuple[tuple[float, ...], ...]:
    # A linear scan finds the sign, and the stiffnesses begin at a car tire's.
    return ((size, 0.0, 0.0, 0.0),)


class PlySteer(LateralLoad):
    """Ply steer paper, Eq. 8 and 13, with the belt's own stiffness and the sticking tread between them."""

    name = "ply steer"
    rank = 200
    summary = "The belt's crossed plies turn bending into in-plane shear, so it moves sideways through the contact."
    equation = (
        "lateral = omega^2 y'', y the belt's sideways shift over theta, belt sheared by gamma = -g (kappa - 1/R); "
        "-g when rolling in reverse"
    )
    source = "ply steer paper, Eq. 8 and 13; docs/explanation/ply-steer.md"
    # g = (t/2) cot(delta): 1.0 to 2.5 mm for plies at 18 to 30 degrees, 1.2 to 1.6 mm apart; less when the belt can
    # curve and twist (docs/explanation/ply-steer.md). Its sign is the order of the plies.
    parameters = (
        Parameter("coupling_length_m", "m", -4e-3, 4e-3, 1.5e-3, 1e-5, factor=1e3, display_unit="mm", by_gain=True),
        *STIFFNESSES,
    )
    observed_in = "lateral axis, orders 1 to 60, around the contact; grows with speed squared; any load"
    confounders = (
        Confounder(
            ("conicity",),
            "one direction of rotation is enough; rolling in reverse decides without a model of the belt",
            "0.04",
        ),
        Confounder(
            ("carcass compliance",),
            "below a slip angle of 0.1 deg it looks like another tread stiffness: a recording at another slip angle",
        ),
        Confounder(("yaw tilt",), "below the neutral layer: two speeds, as gravity leaks too", "0.97"),
    )
    start_values = _start(1.2e-3)
    load = Load.PLY_STEER

    def _scale(self, conditions: GroupConditions) -> float:
        return -super()._scale(conditions) if conditions.reverse else super()._scale(conditions)


class Conicity(LateralLoad):
    """A cone of half angle beta, flattened, has the in-plane curvature beta / R."""

    name = "conicity"
    rank = 210
    summary = "The belt is part of a cone and curves in its own plane where the contact flattens it."
    equation = (
        "lateral = omega^2 y'', y the belt's sideways shift over theta, belt curved by -beta (kappa - 1/R); "
        "the same in both directions of rotation"
    )
    source = "geometry of a flattened cone; docs/explanation/ply-steer.md"
    # In this belt 10 mrad pull some 60 N at 5 kN; tires that pull by more than about 100 N are not sold.
    parameters = (
        Parameter("cone_rad", "rad", -0.05, 0.05, 0.02, 1e-4, factor=1e3, display_unit="mrad", by_gain=True),
        *STIFFNESSES,
    )
    observed_in = "lateral axis, orders 1 to 40, around the contact; grows with speed squared; any load"
    confounders = (
        Confounder(
            ("roll tilt",),
            "two speeds or a declared offset; an AC-coupled sensor, or a free zero-g offset at one speed, leaves only 1"
            " to 4 % of it to separate them",
            "0.98 without its mean",
        ),
        Confounder(("ply steer",), "its sign turns in reverse", "0.04"),
        Confounder(("carcass compliance",), "several loads", "0.2"),
    )
    start_values = _start(0.01)
    load = Load.CONE


class CarcassCompliance(LateralLoad):
    """Side force of a tread that sticks to the road at a slip angle, on a belt that is not rigid sideways."""

    name = "carcass compliance"
    title = "slip angle"
    rank = 220
    summary = "The tire runs at a slip angle (toe, cornering), and its belt deflects sideways under the side force."
    equation = (
        "lateral = omega^2 y'', y the belt's sideways shift over theta, belt pushed by "
        "cy (alpha s - y + y(leading edge)) in the contact; no sliding"
    )
    source = "brush tread without sliding on a beam on an elastic foundation; docs/explanation/ply-steer.md"
    # Beyond about a degree the tread slides over much of the contact, which the equation leaves out.
    parameters = (
        Parameter(
            "slip_angle_rad", "rad", -0.02, 0.02, 0.01, 1e-5, factor=math.degrees(1.0), display_unit="deg", by_gain=True
        ),
        *STIFFNESSES,
    )
    observed_in = "lateral axis, orders 1 to 40, from the contact on; grows with speed squared and with load"
    confounders = (
        Confounder(
            ("ply steer", "tread stiffness"),
            "another slip angle, the only way below 0.1 deg; in reverse ply steer and a toe angle change sign, a "
            "cornering force, which is assumed, does not",
        ),
        Confounder(("conicity",), "several loads", "0.2"),
    )
    start_values = _start(2e-3)
    load = Load.SLIP


class Camber(SignalEffect):
    """Gravity along the axle. The loss of gravity in the wheel's plane, 0.5 % of it at 6 deg, is left out."""

    name = "camber"
    rank = 260
    summary = "The wheel leans from the road's normal, or the road is banked: gravity acts along the axle."
    equation = "adds g sin(camber) to the lateral axis, at every speed"
    source = "projection of gravity on the axle"
    parameters = (
        Parameter(
            "camber_rad",
            "rad",
            -_MAX_CAMBER_RAD,
            _MAX_CAMBER_RAD,
            0.03,
            1e-4,
            factor=math.degrees(1.0),
            display_unit="deg",
        ),
    )
    axes = (LATERAL,)
    observed_in = "order 0 of the lateral axis of a DC-coupled sensor, the same at every speed, load and direction"
    confounders = (
        Confounder(
            ("zero-g offset",),
            "the sensor at rest with the axle level; no recording of a rolling tire separates it from the lateral one",
        ),
        Confounder(("roll tilt",), "it grows with the square of speed"),
    )
    # Nearly linear.
    start_values = ((0.02,),)
    stage = Stage.BELT

    def contribution(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the constant; an AC-coupled sensor does not pass it."""
        change = block.zeros()
        if not block.conditions.ac_coupled:
            change[LATERAL] = STANDARD_GRAVITY_MPS2 * math.sin(float(parameters[0]))
        return change

    def derivative(self, block: ModelledBlock, parameters: FloatArray) -> FloatArray:
        """Return the derivative by the angle."""
        change = block.zeros()
        if not block.conditions.ac_coupled:
            change[LATERAL] = STANDARD_GRAVITY_MPS2 * math.cos(float(parameters[0]))
        return change[None]


EFFECTS: Final = (PlySteer(), Conicity(), CarcassCompliance(), Camber())
