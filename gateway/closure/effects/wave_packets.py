"""Wave packets on the belt's free part: their shapes, and their order and slope as a rotating sensor sees them.

A wave exp(i (N Omega t + m phi)), with N waves a revolution at a fixed point of the road and m waves around the belt,
is of order n = N + m for a sensor, which is at phi = Omega t. Along the belt it changes by m an angle where the
sensor's signal changes by n. The ratio is kappa = m / n = 1 - N / n, rolling speed over phase speed, positive ahead of
the contact and negative behind it for a wave that runs away from it. N = 0 is stationary on the road, and kappa is 1.
A tread of N pitches thus makes waves of order N / (1 - V / c) ahead of the contact and N / (1 + V / c) behind.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.closure.effects.effect import ModelledBlock
from gateway.types import ComplexArray, FloatArray

REFERENCE_MPS: Final = 20.0
"""Speed at which orders are stated."""

# A packet swells from nothing over this angle, as measured ones do: the edge itself belongs to the ring.
_ONSET_RAD: Final = 0.03
# Pitch above which waves travel at a speed of their own; those below are stationary on the road, whatever its speed.
_TRAVELLING_PITCH: Final = 15.0
_MIN_ORDER: Final = 1.0
# Largest logarithm of the ratio by which an order may change with speed.
_MAX_LOG_STRETCH: Final = 5.0


@dataclass(frozen=True, slots=True)
class SensorView:
    """Order and slope of a packet as the sensor sees them at one speed.

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


def sensor_view(order: float, pitch: float, speed_mps: float) -> SensorView:
    """Return order and slope of a packet as the sensor sees them.

    With the phase speed constant, order goes with speed to the power kappa / (1 - kappa) = (n - N) / N. That power
    fades to 0 with N, where the packet is stationary on the road.

    Args:
        order: at REFERENCE_MPS.
        pitch: waves a revolution at a fixed point of the road, N.
        speed_mps: rolling speed.
    """
    square = pitch**2 + _TRAVELLING_PITCH**2
    power = pitch * (order - pitch) / square
    ratio = math.log(speed_mps / REFERENCE_MPS)
    stretch = math.exp(min(max(power * ratio, -_MAX_LOG_STRETCH), _MAX_LOG_STRETCH))
    by_order = stretch * ratio * pitch / square
    by_pitch = stretch * ratio * (order - 2.0 * pitch * (1.0 + power)) / square
    # A fit may pass through orders that are no wave.
    order_seen = max(order * stretch, _MIN_ORDER)
    share_by = (
        pitch * (stretch + order * by_order) / order_seen**2,
        pitch * order * by_pitch / order_seen**2 - 1.0 / order_seen,
    )
    return SensorView(stretch, 1.0 - pitch / order_seen, (by_order, by_pitch), share_by)


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
