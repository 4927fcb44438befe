"""The forward model: what a sensor on the exact rolling ring, with tire-locked edge waves, reads; and its derivatives.

The shape of a loaded ring depends on its stiffnesses over the load only, so it is solved at one nominal load number
Q / (p0 R^2), radius 1 and pressure 1, and speed drops out. Numbers at another load number are in proportion to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final, Self

import numpy as np

from gateway.estimators.forward_waves import Packet, packet_basis
from gateway.physics.reference_tire import TABLE_3_NUMBERS
from gateway.physics.rolling_ring import RingParameters, RingSolution, solve_rolling_ring
from gateway.physics.rolling_ring.sensor_waveform import waveform_orders
from gateway.types import ComplexArray, FloatArray

# Table 3's tire: 5000 N, 2.1 bar, 0.32 m.
NOMINAL_LOAD_NUMBER: Final = 5000.0 / (2.1e5 * 0.32**2)
# The ring is solved at this size; the result does not depend on it.
_RADIUS_M: Final = 0.32
_PRESSURE_PA: Final = 2.1e5
_OMEGA_RADPS: Final = 56.0
_LOAD_N: Final = NOMINAL_LOAD_NUMBER * _PRESSURE_PA * _RADIUS_M**2
COARSE_NODES: Final = 480
_GRIDS: Final = (480, 720, 960, 1440)
_NODES_PER_LAYER: Final = 8.0


class P(IntEnum):
    """Places in the vector of parameters. Up to SHEAR, and GAIN and the decays, they are natural logarithms."""

    BS = 0
    CW = 1
    RS = 2
    TS = 3
    TREAD = 4
    EXTENSION = 5
    SHEAR = 6
    DAMPING = 7
    TREAD_DAMPING = 8
    STIFFENING = 9
    TRACTION = 10
    CENTRE = 11
    GAIN = 12
    BEFORE_COSINE = 13
    BEFORE_SINE = 14
    BEFORE_ORDER = 15
    BEFORE_DECAY = 16
    AFTER_COSINE = 17
    AFTER_SINE = 18
    AFTER_ORDER = 19
    AFTER_DECAY = 20


SIZE: Final = len(P)

# Mean and standard deviation of the parameters before the data are seen; 1.5 of a natural logarithm is a factor of 4.5.
PRIORS: Final[dict[P, tuple[float, float]]] = {
    P.BS: (0.0, 2.0),
    P.CW: (0.0, 1.5),
    P.RS: (0.0, 1.5),
    P.TS: (0.0, 1.5),
    P.TREAD: (0.0, 1.0),  # 70 MPa at 5000 N
    P.EXTENSION: (0.5, 1.0),  # 8 MN: steel belts have 3 to 20
    P.SHEAR: (0.0, 1.5),  # shear length 3 mm: 0.7 to 15 mm
    P.DAMPING: (0.0, 0.05),  # loss angle of the sidewall
    P.TREAD_DAMPING: (0.0, 0.05),
    P.STIFFENING: (0.0, 1.0),  # of the sidewall per belt radius: 6 % at 20 mm
    P.TRACTION: (0.0, 0.1),  # axle torque over load and radius
    P.CENTRE: (0.0, 0.05),
    P.GAIN: (0.0, 0.1),
    P.BEFORE_COSINE: (0.0, 0.1),
    P.BEFORE_SINE: (0.0, 0.1),
    P.BEFORE_ORDER: (40.0, 12.0),
    P.BEFORE_DECAY: (0.0, 0.5),  # 1 rad
    P.AFTER_COSINE: (0.0, 0.1),
    P.AFTER_SINE: (0.0, 0.1),
    P.AFTER_ORDER: (40.0, 12.0),
    P.AFTER_DECAY: (0.0, 0.5),
}
PRIOR_MEAN: Final[FloatArray] = np.array([PRIORS[place][0] for place in P])
PRIOR_STD: Final[FloatArray] = np.array([PRIORS[place][1] for place in P])

# Change of a logarithm (of a loss angle: 1) for the derivatives.
_STEP: Final = 1e-3
_REFERENCE = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=_RADIUS_M, pressure_pa=_PRESSURE_PA)
# EI / (GA R^2) at P.SHEAR = 0: a shear length of a hundredth of the radius.
_SHEAR_UNIT: Final = 1e-4
_RING_PARAMETERS: Final = tuple(place for place in P if place < P.CENTRE)


@dataclass(frozen=True, slots=True)
class ForwardSolution:
    """The model at one vector of parameters.

    Attributes:
        parameters: (SIZE,).
        ring: the solved ring.
        orders: (m,) complex coefficients c - i s over R omega^2, orders 0 to m - 1.
    """

    parameters: FloatArray
    ring: RingSolution
    orders: ComplexArray

    @property
    def half_angle_rad(self) -> float:
        """Half of the contact angle."""
        return self.ring.half_angle_rad

    def packets(self) -> tuple[Packet, Packet]:
        """Return the wave packets before and after the contact."""
        p = self.parameters.tolist()
        return (
            Packet(p[P.BEFORE_COSINE], p[P.BEFORE_SINE], p[P.BEFORE_ORDER], math.exp(p[P.BEFORE_DECAY])),
            Packet(p[P.AFTER_COSINE], p[P.AFTER_SINE], p[P.AFTER_ORDER], math.exp(p[P.AFTER_DECAY])),
        )


@dataclass(frozen=True, slots=True)
class ForwardModel:
    """What is known beforehand and not fitted.

    Attributes:
        max_order: highest order of the result.
        shear: whether the belt is shear-flexible; without, P.SHEAR does nothing.
        offset: e / R, sensor below the neutral layer.
        drum: radius of the drum over the belt radius; infinite for a flat road.
        nodes: of the ring.
    """

    max_order: int
    shear: bool = False
    offset: float = 0.0
    drum: float = math.inf
    nodes: int = COARSE_NODES

    def resolving(self, parameters: FloatArray) -> Self:
        """Return the model on a grid that resolves what bending smooths: sqrt(EI / (p0 b R)) at the contact's edges."""
        layer_rad = math.sqrt(TABLE_3_NUMBERS[0] / TABLE_3_NUMBERS[1] * math.exp(parameters[P.BS] - parameters[P.CW]))
        wanted = _NODES_PER_LAYER * 2.0 * math.pi / layer_rad
        nodes = next((nodes for nodes in _GRIDS if nodes >= wanted), _GRIDS[-1])
        return replace(self, nodes=max(nodes, self.nodes))

    def ring(self, parameters: FloatArray) -> RingParameters:
        """Return the ring of a vector of parameters, at the nominal size and load."""
        p = parameters
        factor = np.exp(p[: P.SHEAR])
        bending = _REFERENCE.bending_stiffness_nm2 * factor[P.BS]
        radial = _REFERENCE.radial_stiffness_npm2 * factor[P.RS]
        tread = _REFERENCE.tread_stiffness_npm2 * factor[P.TREAD]
        return replace(
            _REFERENCE,
            bending_stiffness_nm2=bending,
            tension_width_m=_REFERENCE.tension_width_m * factor[P.CW],
            radial_stiffness_npm2=radial,
            tangential_stiffness_npm2=_REFERENCE.tangential_stiffness_npm2 * factor[P.TS],
            tread_stiffness_npm2=tread,
            extension_stiffness_n=_REFERENCE.extension_stiffness_n * factor[P.EXTENSION],
            shear_stiffness_n=bending / (_SHEAR_UNIT * math.exp(p[P.SHEAR]) * _RADIUS_M**2) if self.shear else math.inf,
            foundation_damping_nspm2=p[P.DAMPING] * radial / _OMEGA_RADPS,
            tread_damping_nspm2=p[P.TREAD_DAMPING] * tread / _OMEGA_RADPS,
            sidewall_stiffening_pm=p[P.STIFFENING] / _RADIUS_M,
        )

    def solve(self, parameters: FloatArray, start: RingSolution | None = None) -> ForwardSolution:
        """Return the model at `parameters`.

        Raises:
            RingNotConvergedError: no equilibrium.
            ValueError: a stiffness is out of range.
        """
        ring = solve_rolling_ring(
            self.ring(parameters),
            _LOAD_N,
            _PRESSURE_PA,
            _OMEGA_RADPS,
            nodes=self.nodes,
            sensor_offset_m=self.offset * _RADIUS_M,
            drum_radius_m=self.drum * _RADIUS_M,
            axle_torque_nm=float(parameters[P.TRACTION]) * _LOAD_N * _RADIUS_M,
            start=start if start is not None and len(start.theta_rad) == self.nodes else None,
        )
        return ForwardSolution(parameters, ring, self._orders(parameters, ring))

    def _orders(self, parameters: FloatArray, ring: RingSolution) -> ComplexArray:
        p = parameters
        basis = self.wave_orders(p, ring)
        wave = p[P.BEFORE_COSINE] * basis[0] + p[P.BEFORE_SINE] * basis[1]
        wave += p[P.AFTER_COSINE] * basis[6] + p[P.AFTER_SINE] * basis[7]
        orders: ComplexArray = (waveform_orders(ring.sensor.radial_m / _RADIUS_M, self.max_order) + wave) * self._turn(
            p
        )
        return orders

    def _turn(self, p: FloatArray) -> ComplexArray:
        """Return gain and turn of each order: the waveform is that of theta - centre."""
        turn: ComplexArray = math.exp(p[P.GAIN]) * np.exp(-1j * p[P.CENTRE] * np.arange(self.max_order + 1))
        return turn

    def wave_orders(self, p: FloatArray, ring: RingSolution) -> ComplexArray:
        """Return the orders of both packets' bases, (12, m); orders 0 and 1, which a closed belt lacks, are zero."""
        free = 2.0 * math.pi - 2.0 * ring.half_angle_rad
        sides = (
            (ring.leading_edge_rad, -1, p[P.BEFORE_ORDER], p[P.BEFORE_DECAY]),
            (ring.trailing_edge_rad, 1, p[P.AFTER_ORDER], p[P.AFTER_DECAY]),
        )
        basis = np.concatenate(
            [
                packet_basis(ring.theta_rad, edge, direction, free, float(order), math.exp(decay))
                for edge, direction, order, decay in sides
            ]
        )
        orders = waveform_orders(basis, self.max_order)
        orders[:, :2] = 0.0
        return orders

    def derivatives(self, at: ForwardSolution) -> tuple[ComplexArray, FloatArray]:
        """Return the derivatives of the orders, (SIZE, m), and of the half angle, (SIZE,), by every parameter."""
        p, ring = at.parameters, at.ring
        rows, half_angle = np.zeros((SIZE, self.max_order + 1), dtype=np.complex128), np.zeros(SIZE)
        for place in _RING_PARAMETERS:
            if place is P.SHEAR and not self.shear:
                continue
            moved = p.copy()
            moved[place] += _STEP
            there = self.solve(moved, ring)
            rows[place] = (there.orders - at.orders) / _STEP
            half_angle[place] = (there.half_angle_rad - at.half_angle_rad) / _STEP
        rows[P.CENTRE] = -1j * np.arange(self.max_order + 1) * at.orders
        rows[P.GAIN] = at.orders
        basis = self.wave_orders(p, ring) * self._turn(p)
        for first, packet in ((P.BEFORE_COSINE, basis[:6]), (P.AFTER_COSINE, basis[6:])):
            cosine, sine = p[first], p[first + 1]
            rows[first], rows[first + 1] = packet[0], packet[1]
            rows[first + 2] = cosine * packet[2] + sine * packet[3]
            rows[first + 3] = cosine * packet[4] + sine * packet[5]
        return rows, half_angle

    def refined(self, at: ForwardSolution) -> tuple[ComplexArray, float]:
        """Return orders and half angle at `at`, freed from the grid's error: it falls with the square of the step."""
        fine = replace(self, nodes=2 * self.nodes).solve(at.parameters)
        return (
            fine.orders + (fine.orders - at.orders) / 3.0,
            fine.half_angle_rad + (fine.half_angle_rad - at.half_angle_rad) / 3.0,
        )


def stacked(orders: ComplexArray) -> FloatArray:
    """Return real and imaginary parts side by side, (..., 2 m)."""
    return np.concatenate([orders.real, orders.imag], axis=-1)
