"""Shapes of wave packets on the belt's free part."""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, Protocol, Self

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.effect import FIELD_SIZE, ModelledBlock

# A tire-locked packet swells from nothing over this angle: the edge itself belongs to the ring.
_ONSET_RAD: Final = 0.03
_ORDER: Final = np.arange(FIELD_SIZE // 2 + 1, dtype=np.float64)
_SIGNED_ORDERS: Final = np.stack([_ORDER, -_ORDER])
# The grid begins at -pi. Half of either side's coefficients make the real part.
_ON_GRID: Final = 0.5 * FIELD_SIZE * (-1.0) ** _ORDER
# Turn over the free belt below which a wave has the coefficients of this one.
_SHORT: Final = 1e-5


class Contact(Protocol):
    """What waves depend on of a block."""

    @property
    def leading_edge_rad(self) -> float:
        """Negative."""
        ...

    @property
    def trailing_edge_rad(self) -> float:
        """Positive."""
        ...


@dataclass(frozen=True, slots=True)
class FreeBelt:
    """The belt's free part, seen from both contact edges.

    Attributes:
        distance_rad: (2, FIELD_SIZE) from the leading edge against the rolling, from the trailing edge along it.
        swell: (2, FIELD_SIZE) onset of a packet from either edge, 0 in the contact.
    """

    distance_rad: FloatArray
    swell: FloatArray

    def packet(self, side: int, order: float, decay_per_rad: float) -> ComplexArray:
        """Return a packet from the leading (side 0) or the trailing edge, exp((i order - decay) d), (FIELD_SIZE,)."""
        result: ComplexArray = self.swell[side] * np.exp((1j * order - decay_per_rad) * self.distance_rad[side])
        return result


def free_belt(block: ModelledBlock) -> FreeBelt:
    """Return the belt's free part."""
    from_leading_rad = np.mod(block.leading_edge_rad - block.theta_rad, 2.0 * math.pi)
    length = 2.0 * math.pi - (block.trailing_edge_rad - block.leading_edge_rad)
    outside = from_leading_rad < length
    distance = np.stack([from_leading_rad, np.where(outside, length - from_leading_rad, 0.0)])
    swell = -np.expm1(np.square(distance) * -(_ONSET_RAD**-2.0))
    swell[0] *= outside
    return FreeBelt(distance, swell)


@dataclass(frozen=True, slots=True)
class Running:
    """exp(i order d) over the free belt, d = angle from the leading (side 0) or the trailing edge (1), of some orders.

    Fourier coefficients are integrals: samples of a curve that begins with a step would have the aliases of its high
    orders.

    Attributes:
        curves: Fourier coefficients of orders m and -m, (n, 2, FIELD_SIZE // 2 + 1).
    """

    curves: ComplexArray
    _beyond: ComplexArray
    _end: ComplexArray
    _length_rad: float

    @classmethod
    def of(cls, block: Contact, side: int, orders: ComplexArray) -> Self:
        """Return the waves of complex orders (n,) from one edge of a block's contact."""
        length = 2.0 * math.pi - (block.trailing_edge_rad - block.leading_edge_rad)
        edge, direction = (block.leading_edge_rad, 1.0) if side == 0 else (block.trailing_edge_rad, -1.0)
        z = orders[:, None, None] + direction * _SIGNED_ORDERS
        edge_phases, length_phases = _phases(edge, direction * length)
        # The exponential of a sum: that over the orders of the grid serves every wave and block of the same edges.
        end = np.exp(1j * length * orders)[:, None, None] * length_phases
        short = np.abs(z) < _SHORT / length
        if short.any():
            z[short], end[short] = _SHORT / length, np.exp(1j * _SHORT)
        # From here on a coefficient is that of a constant but for a turn of its phase.
        return cls(edge_phases * ((end - 1.0) / (1j * z)), z, edge_phases * end, length)

    def by_order(self) -> ComplexArray:
        """Return the derivatives of the coefficients by each order, of their shape."""
        result: ComplexArray = (self._length_rad * self._end - self.curves) / self._beyond
        return result


@lru_cache(maxsize=64)
def _phases(edge_rad: float, length_rad: float) -> tuple[ComplexArray, ComplexArray]:
    """Return exp(-i m edge) / (2 pi) and exp(i m length) of the orders m and -m, (2, FIELD_SIZE // 2 + 1) each."""
    edge_phases = np.exp(-1j * edge_rad * _SIGNED_ORDERS) / (2.0 * math.pi)
    length_phases = np.exp(1j * length_rad * _SIGNED_ORDERS)
    for phases in (edge_phases, length_phases):
        phases.setflags(write=False)
    return edge_phases, length_phases


def spectrum_of(coefficients: ComplexArray) -> ComplexArray:
    """Return what `numpy.fft.rfft` gives of the real part of a curve on the model's grid, (..., FIELD_SIZE // 2 + 1).

    Args:
        coefficients: of its orders m and -m, (..., 2, FIELD_SIZE // 2 + 1).
    """
    result: ComplexArray = _ON_GRID * (coefficients[..., 0, :] + np.conj(coefficients[..., 1, :]))
    return result


def pulse(block: Contact, order: float, place_rad: float, width_rad: float) -> ComplexArray:
    """Return exp(i order x - x^2 / (2 width^2)), x = angle ahead of the leading edge less the place.

    Returns:
        The Fourier coefficients of orders m and -m, (2, FIELD_SIZE // 2 + 1).
    """
    phase = np.exp(-1j * (block.leading_edge_rad - place_rad) * _SIGNED_ORDERS)
    size = width_rad / math.sqrt(2.0 * math.pi) * np.exp(-0.5 * np.square(width_rad * (order + _SIGNED_ORDERS)))
    result: ComplexArray = phase * size
    return result


def pulse_by(curve: ComplexArray, order: float, width_rad: float) -> ComplexArray:
    """Return the derivatives of a pulse by order, place and width, (3, 2, FIELD_SIZE // 2 + 1)."""
    order_offset = order + _SIGNED_ORDERS
    by = [-(width_rad**2) * order_offset, 1j * _SIGNED_ORDERS, 1.0 / width_rad - width_rad * np.square(order_offset)]
    return np.stack([factor * curve for factor in by])
