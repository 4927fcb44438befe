"""The sensor is turned about the radial axis, beyond what is declared."""

from __future__ import annotations

import math

from gateway.closure.effects.base import (
    CIRCUMFERENTIAL,
    LATERAL,
    NOWHERE,
    Conditions,
    Here,
    Parameter,
    Stage,
    StartModel,
    bare,
)
from gateway.types import FloatArray


class YawTilt:
    """Rotation about the radial axis, the first of the three: circumferential leaks into +lateral."""

    name: str = "yaw tilt"
    summary: str = (
        "The sensor is turned about the radial axis: the circumferential acceleration leaks into the lateral axis."
    )
    equation: str = (
        "lateral reads cos(yaw) lateral + sin(yaw) circumferential, circumferential reads cos(yaw) circumferential "
        "- sin(yaw) lateral"
    )
    # As roll and pitch: glued by hand within 5 deg, beyond 20 deg the pipeline reports a wrong mounting.
    parameters: tuple[Parameter, ...] = (
        Parameter("yaw_rad", "rad", -0.35, 0.35, 0.05, 1e-4, factor=math.degrees(1.0), display_unit="deg"),
    )
    seen_by: str = (
        "lateral axis: a copy of the circumferential one. That is gravity, g sin(theta) at every speed, and below the"
        " neutral layer e/R ds/dtheta, which grows with speed squared"
    )
    confused_with: str = (
        "ply steer, whose waveform has the shape of ds/dtheta (cosine 0.97): gravity's part, order 1 that does not grow"
        " with speed, decides; two speeds, the lower the better"
    )
    already_in: frozenset[StartModel] = NOWHERE
    stage: Stage = Stage.MOUNTING
    axes: tuple[int, ...] = (CIRCUMFERENTIAL, LATERAL)
    linear: bool = False

    def starts(self, conditions: tuple[Conditions, ...]) -> tuple[tuple[float, ...], ...]:
        """Return one: to a percent it is linear."""
        return ((0.02,),)

    def contribution(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return what the rotation changes."""
        yaw = _turned(here, parameters)
        # cos - 1 without cancellation.
        less, sine = -2.0 * math.sin(0.5 * yaw) ** 2, math.sin(yaw)
        along, lateral = here.signal_mps2[CIRCUMFERENTIAL], here.signal_mps2[LATERAL]
        change = bare(here)
        change[CIRCUMFERENTIAL] = less * along - sine * lateral
        change[LATERAL] = less * lateral + sine * along
        return change

    def derivative(self, here: Here, parameters: FloatArray) -> FloatArray:
        """Return its derivative by the angle."""
        yaw = _turned(here, parameters)
        sine, cosine = math.sin(yaw), math.cos(yaw)
        along, lateral = here.signal_mps2[CIRCUMFERENTIAL], here.signal_mps2[LATERAL]
        change = bare(here)
        change[CIRCUMFERENTIAL] = -sine * along - cosine * lateral
        change[LATERAL] = -sine * lateral + cosine * along
        return -change[None] if here.conditions.reverse else change[None]


def _turned(here: Here, parameters: FloatArray) -> float:
    """Return the angle seen along the rotation: rolling in reverse, the sensor's circumferential axis points back."""
    return -float(parameters[0]) if here.conditions.reverse else float(parameters[0])


EFFECT = YawTilt()
