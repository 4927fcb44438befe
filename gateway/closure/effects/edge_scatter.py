"""Contact edge scatter: edges that come a little early or late, another amount each time."""

from __future__ import annotations

from typing import Final

import numpy as np

from gateway.closure.effects.base import CIRCUMFERENTIAL, LATERAL, NOWHERE, RADIAL, Parameter
from gateway.types import FloatArray

# An edge takes its surroundings along, fading over this angle to either side.
REACH_RAD: Final = 0.5
# One edge takes over from the other within this part of the half contact about its middle, where the signal is flat.
_CHANGE: Final = 0.5


def _rms(side: str) -> Parameter:
    # A measured leading edge scatters by 1.9 mm on a drum, a trailing one by 0.5; of 8 mm no contact is known.
    return Parameter(f"{side}_m", "m", 0.0, 8e-3, 2e-3, 1e-6, factor=1e3, display_unit="mm")


class EdgeScatter:
    """Normal scatter of where the contact begins and ends, root mean squares along the belt.

    It is seen in how revolutions differ. Means of revolutions have their edges put back one by one, so nothing of it is
    left in them.
    """

    name = "contact edge scatter"
    summary = "The contact's edges move from revolution to revolution; that scatters the signal where it is steepest."
    equation = "a(theta) = s(theta + early(theta)), early that of the nearer edge, fading 0.5 rad away from it"
    parameters: tuple[Parameter, ...] = (_rms("leading"), _rms("trailing"))
    seen_by = (
        "Revolutions one by one: pulses of the waveform's slope at the edges, of a size of their own each time; the "
        "period, which is short where a contact comes early, tells which edge it is."
    )
    confused_with = (
        "Noise and vibration, which are as strong where there is no contact; a load that drifts, which does not "
        "scatter from one contact to the next."
    )
    already_in = NOWHERE
    axes: tuple[int, ...] = (CIRCUMFERENTIAL, LATERAL, RADIAL)

    def windows(self, theta_rad: FloatArray, half_angle_rad: float) -> FloatArray:
        """Return by how much the edges' places are felt at angles from -pi to pi, (4, ...).

        Leading and trailing edge, then the same growing away from the contact's middle. Angles below 0 belong to the
        next contact, those above to the one before, so either side has its own edge alone.
        """
        side = np.array([-1.0, 1.0]).reshape(2, *(1,) * theta_rad.ndim)
        from_edge = side * theta_rad - half_angle_rad
        felt = 0.5 * (1.0 + np.cos(np.pi * np.minimum(np.abs(from_edge) / REACH_RAD, 1.0)))
        inside = np.clip(side * theta_rad / (_CHANGE * half_angle_rad), -1.0, 1.0)
        felt = felt * 0.5 * (1.0 + np.sin(0.5 * np.pi * inside))
        return np.concatenate((felt, felt * from_edge / REACH_RAD))


EFFECT = EdgeScatter()
