"""Wave packets on the belt's free part: their shapes, and what the road's view of them does to order and slope.

A wave exp(i (N Omega t + m phi)) of N waves a revolution at a place of the road and m waves around the belt is of order
n = N + m for a sensor, which rides at phi = Omega t. Along the belt it changes by m an angle where the sensor's signal
changes by n: by the share kappa = m / n = 1 - N / n, rolling speed over phase speed, positive ahead of the contact and
negative behind it for a wave that runs away from it. N = 0 stands still on the road, kappa is 1. A tread of N pitches
thus makes waves of order N / (1 - V / c) ahead of the contact and N / (1 + V / c) behind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.closure.effects.base import Here
from gateway.types import ComplexArray, FloatArray

REFERENCE_MPS: Final = 20.0
"""Speed at which orders are told."""

# A packet swells from nothing over this angle, as measured ones do: the edge itself is the ring's.
_ONSET_RAD: Final = 0.03
# Pitch from which waves travel at a speed of their own; those of less stand still on the road, whatever its speed.
_TRAVELLING: Final = 15.0
_LEAST_ORDER: Final = 1.0
# Logarithm of the most that an order may change by with speed.
_MOST: Final = 5.0


@dataclass(frozen=True, slots=True)
class Seen:
    """What a sensor sees of a packet.

    Attributes:
        stretch: its order over that at REFERENCE_MPS.
        share: kappa.
        stretch_by: derivatives of `stretch` by the order at REFERENCE_MPS and by the pitch.
        share_by: likewise.
    """

    stretch: float
    share: float
    stretch_by: tuple[float, float]
    share_by: tuple[float, float]


def seen(order: float, pitch: float, speed_mps: float) -> Seen:
    """Return what a sensor sees of a packet.

    With the phase speed constant, order goes with speed to the power kappa / (1 - kappa) = (n - N) / N. That power
    fades to 0 with N, where the packet stands still on the road.

    Args:
        order: at REFERENCE_MPS.
        pitch: waves a revolution that the road sees, N.
        speed_mps: rolling speed.
    """
    square = pitch**2 + _TRAVELLING**2
    power = pitch * (order - pitch) / square
    ratio = math.log(speed_mps / REFERENCE_MPS)
    stretch = math.exp(min(max(power * ratio, -_MOST), _MOST))
    by_order = stretch * ratio * pitch / square
    by_pitch = stretch * ratio * (order - 2.0 * pitch * (1.0 + power)) / square
    # A fit on its way may ask for what is no wave any more.
    there = max(order * stretch, _LEAST_ORDER)
    share_by = (pitch * (stretch + order * by_order) / there**2, pitch * order * by_pitch / there**2 - 1.0 / there)
    return Seen(stretch, 1.0 - pitch / there, (by_order, by_pitch), share_by)


@dataclass(frozen=True, slots=True)
class Free:
    """The belt's free part, seen from both edges.

    Attributes:
        distance_rad: (2, FIELD_SIZE) from the leading edge against the rolling, from the trailing edge along it.
        swell: (2, FIELD_SIZE) of a packet from either edge, 0 in the contact.
    """

    distance_rad: FloatArray
    swell: FloatArray


def free_part(here: Here) -> Free:
    """Return the belt's free part."""
    ahead = np.mod(here.leading_edge_rad - here.theta_rad, 2.0 * math.pi)
    length = 2.0 * math.pi - (here.trailing_edge_rad - here.leading_edge_rad)
    outside = ahead < length
    distance = np.stack([ahead, np.where(outside, length - ahead, 0.0)])
    swell = -np.expm1(np.square(distance) * -(_ONSET_RAD**-2.0))
    swell[0] *= outside
    return Free(distance, swell)


@dataclass(frozen=True, slots=True)
class Packet:
    """A packet cos + i sin, and what makes its derivatives of it.

    Attributes:
        curve: (FIELD_SIZE,).
        order_by: (FIELD_SIZE,) factor that makes it its derivative by the order.
        shape_by: one such factor for each parameter of its envelope.
    """

    curve: ComplexArray
    order_by: ComplexArray
    shape_by: tuple[ComplexArray | FloatArray, ...]


def decaying(free: Free, side: int, order: float, decay: float) -> Packet:
    """Return a packet that decays from the leading (side 0) or the trailing edge (1); its shape is the decay."""
    distance = free.distance_rad[side]
    return Packet(free.swell[side] * np.exp((1j * order - decay) * distance), 1j * distance, (-distance,))


def pulse(free: Free, order: float, place_rad: float, width_rad: float) -> Packet:
    """Return a packet about a place ahead of the contact, a normal curve wide; its shape are place and width."""
    from_it = free.distance_rad[0] - place_rad
    relative = from_it / width_rad
    square = np.square(relative)
    curve = free.swell[0] * np.exp(1j * order * from_it - 0.5 * square)
    return Packet(curve, 1j * from_it, (relative / width_rad - 1j * order, square / width_rad))
