"""Shapes of wave packets on the belt's free part."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.closure.effects.effect import ModelledBlock
from gateway.types import ComplexArray, FloatArray

# A packet swells from nothing over this angle, as measured ones do: the edge itself belongs to the ring.
_ONSET_RAD: Final = 0.03


@dataclass(frozen=True, slots=True)
class FreeBelt:
    """The belt's free part, seen from both contact edges.

    Attributes:
        distance_rad: (2, FIELD_SIZE) from the leading edge against the rolling, from the trailing edge along it.
        swell: (2, FIELD_SIZE) onset of a packet from either edge, 0 in the contact.
    """

    distance_rad: FloatArray
    swell: FloatArray


def free_belt(block: ModelledBlock) -> FreeBelt:
    """Return the belt's free part."""
    ahead = np.mod(block.leading_edge_rad - block.theta_rad, 2.0 * math.pi)
    length = 2.0 * math.pi - (block.trailing_edge_rad - block.leading_edge_rad)
    outside = ahead < length
    distance = np.stack([ahead, np.where(outside, length - ahead, 0.0)])
    swell = -np.expm1(np.square(distance) * -(_ONSET_RAD**-2.0))
    swell[0] *= outside
    return FreeBelt(distance, swell)


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet cos + i sin, and the factors that give its derivatives.

    Attributes:
        curve: (FIELD_SIZE,).
        order_by: (FIELD_SIZE,) factor that makes it its derivative by the order.
        shape_by: one such factor for each parameter of its envelope.
    """

    curve: ComplexArray
    order_by: ComplexArray
    shape_by: tuple[ComplexArray | FloatArray, ...]


def decaying(free: FreeBelt, side: int, order: float, decay: float) -> Packet:
    """Return a packet that decays from the leading (side 0) or the trailing edge (1); its shape is the decay."""
    distance = free.distance_rad[side]
    return Packet(free.swell[side] * np.exp((1j * order - decay) * distance), 1j * distance, (-distance,))


def pulse(free: FreeBelt, order: float, place_rad: float, width_rad: float) -> Packet:
    """Return a packet ahead of the contact with a Gaussian envelope; its shape are place and width."""
    from_it = free.distance_rad[0] - place_rad
    relative = from_it / width_rad
    square = np.square(relative)
    curve = free.swell[0] * np.exp(1j * order * from_it - 0.5 * square)
    return Packet(curve, 1j * from_it, (relative / width_rad - 1j * order, square / width_rad))
