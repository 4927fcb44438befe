"""Contact with the road: axle torque, drum curvature, jitter of the contact edges."""

from typing import Final

import numpy as np

from gateway.core.reasons import Reason
from gateway.core.types import FloatArray
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    LATERAL,
    RADIAL,
    Confounder,
    Parameter,
    RingEffect,
    ScatterEffect,
)
from gateway.diagnosis.reasons import DiagnosisCode

EDGE_REACH_RAD: Final = 0.5
"""Angle to either side of a contact edge over which its displacement fades."""

# One edge takes over from the other within this part of the half contact about its middle, where the signal is flat.
_TRANSITION_SHARE: Final = 0.5
# Smallest plausible curvature of a hollow road, an inner drum of 5 m radius.
_MIN_HOLLOW_PM: Final = -0.2
# Standard errors from 0 at which the road is hollow.
_HOLLOW_SIGMAS: Final = 3.0


class ContactAsymmetry(RingEffect):
    """Driving (positive) or braking torque at the axle, beyond that of the losses, over load and belt radius."""

    name = "contact asymmetry"
    title = "axle torque"
    rank = 60
    summary = "A driving or braking torque winds the belt up against the rim; leading and trailing edge differ."
    equation = (
        "axle torque = that of the losses + traction * Q R, carried by friction in proportion to q along the contact"
    )
    source = "friction along the belt of the exact ring"
    # Drive torque at steady speed is 1 to 5 % of the load; hard braking up to 50 %, beyond which tires slip.
    parameters = (
        Parameter("traction", "", low=-0.5, high=0.5, prior_std=0.2, step=2e-3, factor=100.0, display_unit="%"),
    )
    observed_in = "radial axis, sine part of all orders, as omega^2 at every speed alike"
    confounders = (
        Confounder(
            ("structural damping",),
            "it grows with speed; or a recording of braking against one of driving",
            "0.98 at one speed",
        ),
        Confounder(("contact centre",)),
    )
    # Driving and braking at 5 % of the load.
    start_values = ((0.05,), (-0.05,))
    option = "traction"


class DrumCurvature(RingEffect):
    """Curvature of the road in the rolling direction, 0 on a flat one."""

    name = "drum curvature"
    rank = 100
    summary = "The road is a drum: the sensor reads less than zero in the contact (more, inside a drum)."
    equation = "in contact kappa = -1 / R_d, s = -(R omega)^2 / R_d"
    source = "kinematics of a belt that follows the drum"
    # Drums have radii of 0.5 to 2.5 m, inner drums of 1.9 m and more.
    parameters = (Parameter("curvature_pm", "1/m", low=-0.6, high=2.1, prior_std=1.0, step=0.01),)
    observed_in = "radial axis, level in the contact against the level outside, as omega^2"
    confounders = (
        Confounder(("sidewall stiffening",), similarity="-0.7"),
        Confounder(
            ("mounting offset",),
            "the mean, or the circumferential axis",
            "-0.9 where neither mean nor circumferential axis is available",
        ),
        Confounder(("tread stiffness",)),
    )
    # A drum of 1.7 m diameter and an inner drum of 3.8 m.
    start_values = ((1.2,), (-0.5,))
    option = "drum_curvature_pm"

    def reason_against(self, parameters: FloatArray, std: FloatArray) -> Reason | None:
        """Reject a hollow road larger than any inner drum; an outer one may be large, as real roads are crowned."""
        curvature, error = float(parameters[0]), float(std[0])
        if not _MIN_HOLLOW_PM < curvature < -_HOLLOW_SIGMAS * error:
            return None
        return Reason(DiagnosisCode.HOLLOW_ROAD, radius_m=-1.0 / curvature)


def _rms(side: str) -> Parameter:
    # A measured leading edge has a jitter of 1.9 mm on a drum, a trailing one 0.5; no contact with 8 mm is known.
    return Parameter(f"{side}_m", "m", 0.0, 8e-3, 2e-3, 1e-6, factor=1e3, display_unit="mm")


class ContactEdgeJitter(ScatterEffect):
    """Normal scatter of the positions of the contact edges, root mean squares along the belt.

    It is visible in the differences between revolutions. Before revolutions are averaged their edges are moved back to
    the mean positions one by one, so the means contain none of it.
    """

    name = "contact edge scatter"
    title = "contact-edge jitter"
    rank = 400
    summary = "The contact edges move from revolution to revolution, which scatters the signal where it is steepest."
    equation = "a(theta) = s(theta + early(theta)), early that of the nearer edge, fading 0.5 rad away from it"
    source = "first-order displacement of the waveform"
    parameters = (_rms("leading"), _rms("trailing"))
    axes = (CIRCUMFERENTIAL, LATERAL, RADIAL)
    observed_in = (
        "single revolutions: pulses with the waveform's slope at the edges, of a different size each time; the period,"
        " which is short where a contact comes early, identifies the edge"
    )
    confounders = (
        Confounder(("noise", "road vibration"), "they are as strong outside the contact"),
        Confounder(("a load that drifts",), "it does not scatter from one contact to the next"),
    )

    def windows(self, theta_rad: FloatArray, half_angle_rad: float) -> FloatArray:
        """Return the weight of the edges' displacements at angles from -pi to pi, (4, ...).

        Leading and trailing edge, then the same growing away from the contact's middle. Angles below 0 belong to the
        next contact, those above to the one before, so either side has its own edge alone.
        """
        side = np.array([-1.0, 1.0]).reshape(2, *(1,) * theta_rad.ndim)
        from_edge = side * theta_rad - half_angle_rad
        weight = 0.5 * (1.0 + np.cos(np.pi * np.minimum(np.abs(from_edge) / EDGE_REACH_RAD, 1.0)))
        ramp = np.clip(side * theta_rad / (_TRANSITION_SHARE * half_angle_rad), -1.0, 1.0)
        weight = weight * 0.5 * (1.0 + np.sin(0.5 * np.pi * ramp))
        return np.concatenate((weight, weight * from_edge / EDGE_REACH_RAD))


CONTACT_EDGE_JITTER: Final = ContactEdgeJitter()
EFFECTS: Final = (ContactAsymmetry(), DrumCurvature(), CONTACT_EDGE_JITTER)
