"""Wave packets that a tread sends along the belt from both edges of the contact, as a linear-in-amplitude model.

On measured tires they repeat every revolution, so averaging keeps them (docs/accuracy.md). Before the leading edge and
behind the trailing edge, d away from it,

    (a cos(n d) + b sin(n d)) exp(-d / decay) (1 - exp(-(d / onset)^2)),

with an order n and a decay of its own on each side.
"""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np

from gateway.types import FloatArray

# A packet swells from nothing over this angle: the edge itself is the ring's.
_ONSET_RAD: Final = 0.03


class Packet(NamedTuple):
    """One side's packet.

    Attributes:
        cosine: amplitude a, as a share of the signal's mean.
        sine: amplitude b.
        order: waves a revolution.
        decay_rad: angle over which it falls to 1/e.
    """

    cosine: float
    sine: float
    order: float
    decay_rad: float

    @property
    def amplitude(self) -> float:
        """Size at the edge."""
        return math.hypot(self.cosine, self.sine)


def packet_basis(
    theta_rad: FloatArray, edge_rad: float, direction: int, free_rad: float, order: float, decay_rad: float
) -> FloatArray:
    """Return cosine and sine packet, and their derivatives by order and by the logarithm of the decay, (6, n).

    Rows: cosine, sine, d cosine / d order, d sine / d order, d cosine / d ln decay, d sine / d ln decay.

    Args:
        theta_rad: (n,) angles.
        edge_rad: where the packet begins.
        direction: +1 for the one behind the trailing edge, -1 for the one ahead of the leading edge.
        free_rad: angle out of contact; the packet ends there.
        order: waves a revolution.
        decay_rad: its decay.
    """
    distance = np.mod(direction * (theta_rad - edge_rad), 2.0 * math.pi)
    envelope = np.where(
        distance < free_rad, np.exp(-distance / decay_rad) * (1.0 - np.exp(-((distance / _ONSET_RAD) ** 2))), 0.0
    )
    cosine, sine = envelope * np.cos(order * distance), envelope * np.sin(order * distance)
    stretch = distance / decay_rad
    return np.stack([cosine, sine, -distance * sine, distance * cosine, stretch * cosine, stretch * sine])
