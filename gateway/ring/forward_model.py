"""Forward model of the sensor signal: the exact rolling ring with tire-locked edge waves, and its derivatives.

The shape of a loaded ring depends only on its stiffnesses over the load, and speed drops out. So the ring is solved at
one nominal load number Q / (p0 R^2), that of Table 3. The numbers at another load number are proportional to it.

Edge waves are wave packets that a tread sends along the belt from both edges of the contact. On measured tires they
repeat every revolution, so averaging keeps them (docs/evidence/accuracy.md). At a distance d before the leading edge or
behind the trailing edge a packet is

    (a cos(n d) + b sin(n d)) exp(-d / decay) (1 - exp(-(d / onset)^2)),

with its own order n and decay on each side; it is linear in the amplitudes a and b.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from typing import Final, NamedTuple, Self

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.ring.reference_tire import TABLE_3_LOAD_N, TABLE_3_NUMBERS, TABLE_3_PRESSURE_PA, TABLE_3_RADIUS_M
from gateway.ring.rolling_ring import RingParameters, RingSolution, RingTangent, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import waveform_orders

# The result does not depend on the speed at which the ring is solved.
_OMEGA_RADPS: Final = 56.0
COARSE_NODES: Final = 480
_NODE_COUNTS: Final = (480, 720, 960, 1440)
_NODES_PER_LAYER: Final = 8.0

# Angle over which a packet grows from zero: the edge itself belongs to the ring.
_ONSET_RAD: Final = 0.03


class P(IntEnum):
    """Indices of the parameter vector. BS to SHEAR, GAIN and the decays are natural logarithms."""

    BS = 0
    CW = 1
    RS = 2
    TS = 3
    TREAD = 4
    EXTENSION = 5
    SHEAR = 6
    DAMPING = 7
    TREAD_DAMPING = 8
    BENDING_DAMPING = 9
    STIFFENING = 10
    TRACTION = 11
    ROAD_CURVATURE = 12
    CENTRE = 13
    GAIN = 14
    BEFORE_COSINE = 15
    BEFORE_SINE = 16
    BEFORE_ORDER = 17
    BEFORE_DECAY = 18
    AFTER_COSINE = 19
    AFTER_SINE = 20
    AFTER_ORDER = 21
    AFTER_DECAY = 22


SIZE: Final = len(P)

# Prior mean and standard deviation of the parameters; 1.5 of a natural logarithm is a factor of 4.5.
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
    P.BENDING_DAMPING: (0.0, 0.05),  # loss angle of the belt at the wheel's frequency: 1 ms at 65 km/h
    P.STIFFENING: (0.0, 1.0),  # of the sidewall per belt radius: 6 % at 20 mm
    P.TRACTION: (0.0, 0.1),  # axle torque over load and radius
    P.ROAD_CURVATURE: (0.0, 0.3),  # times the belt radius: 0 for a road, 0.2 to 0.6 for drums
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
PRIOR_MEAN: Final[FloatArray] = np.array([PRIORS[parameter][0] for parameter in P])
PRIOR_STD: Final[FloatArray] = np.array([PRIORS[parameter][1] for parameter in P])

# Step of the numerical derivatives, in the parameter's unit.
_STEP: Final = 1e-3
_REFERENCE = RingParameters.from_numbers(*TABLE_3_NUMBERS, radius_m=TABLE_3_RADIUS_M, pressure_pa=TABLE_3_PRESSURE_PA)
# EI / (GA R^2) at P.SHEAR = 0: a shear length of a hundredth of the radius.
_SHEAR_UNIT: Final = 1e-4
_RING_PARAMETERS: Final = tuple(parameter for parameter in P if parameter < P.CENTRE)


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
    """The model, with what is known beforehand and not fitted.

    Attributes:
        max_order: highest order of the result.
        shear: whether the belt is shear-flexible; without, P.SHEAR does nothing.
        offset: e / R, sensor below the neutral layer.
        offset_std: one standard error of it.
        steady_std: one standard error of the signal's steady value beyond a common gain, over that value.
        nodes: of the ring.
    """

    max_order: int
    shear: bool = False
    offset: float = 0.0
    offset_std: float = 0.0
    steady_std: float = 0.0
    nodes: int = COARSE_NODES

    def resolving(self, parameters: FloatArray) -> Self:
        """Return the model on a grid that resolves the bending layer sqrt(EI / (p0 b R)) at the contact's edges."""
        layer_rad = math.sqrt(TABLE_3_NUMBERS[0] / TABLE_3_NUMBERS[1] * math.exp(parameters[P.BS] - parameters[P.CW]))
        required_nodes = _NODES_PER_LAYER * 2.0 * math.pi / layer_rad
        nodes = next((nodes for nodes in _NODE_COUNTS if nodes >= required_nodes), _NODE_COUNTS[-1])
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
            shear_stiffness_n=bending / (_SHEAR_UNIT * math.exp(p[P.SHEAR]) * TABLE_3_RADIUS_M**2)
            if self.shear
            else math.inf,
            foundation_damping_nspm2=p[P.DAMPING] * radial / _OMEGA_RADPS,
            tread_damping_nspm2=p[P.TREAD_DAMPING] * tread / _OMEGA_RADPS,
            bending_damping_nm2s=p[P.BENDING_DAMPING] * bending / _OMEGA_RADPS,
            sidewall_stiffening_pm=p[P.STIFFENING] / TABLE_3_RADIUS_M,
        )

    def solve(self, parameters: FloatArray, start: RingSolution | None = None) -> ForwardSolution:
        """Return the model at `parameters`.

        Raises:
            RingNotConvergedError: no equilibrium.
            ValueError: a stiffness is out of range.
        """
        ring = solve_rolling_ring(
            self.ring(parameters),
            TABLE_3_LOAD_N,
            TABLE_3_PRESSURE_PA,
            _OMEGA_RADPS,
            nodes=self.nodes,
            sensor_offset_m=self.offset * TABLE_3_RADIUS_M,
            drum_radius_m=_drum_radius_m(parameters),
            axle_torque_nm=_torque_nm(parameters),
            start=start if start is not None and len(start.theta_rad) == self.nodes else None,
        )
        return ForwardSolution(parameters, ring, self._orders(parameters, ring))

    def _orders(self, parameters: FloatArray, ring: RingSolution) -> ComplexArray:
        p = parameters
        basis = self.wave_orders(p, ring)
        wave = p[P.BEFORE_COSINE] * basis[0] + p[P.BEFORE_SINE] * basis[1]
        wave += p[P.AFTER_COSINE] * basis[6] + p[P.AFTER_SINE] * basis[7]
        orders: ComplexArray = (
            waveform_orders(ring.sensor.radial_m / TABLE_3_RADIUS_M, self.max_order) + wave
        ) * self._gain_and_phase(p)
        return orders

    def _gain_and_phase(self, p: FloatArray) -> ComplexArray:
        """Return gain and phase of each order: the waveform is that of theta - centre."""
        factors: ComplexArray = math.exp(p[P.GAIN]) * np.exp(-1j * p[P.CENTRE] * np.arange(self.max_order + 1))
        return factors

    def wave_orders(self, p: FloatArray, ring: RingSolution) -> ComplexArray:
        """Return the orders of both packets' bases, (12, m); orders 0 and 1, which a closed belt lacks, are zero."""
        free_rad = 2.0 * math.pi - 2.0 * ring.half_angle_rad
        sides = (
            (ring.leading_edge_rad, -1, p[P.BEFORE_ORDER], p[P.BEFORE_DECAY]),
            (ring.trailing_edge_rad, 1, p[P.AFTER_ORDER], p[P.AFTER_DECAY]),
        )
        basis = np.concatenate(
            [
                packet_basis(ring.theta_rad, edge, direction, free_rad, float(order), math.exp(decay))
                for edge, direction, order, decay in sides
            ]
        )
        orders = waveform_orders(basis, self.max_order)
        orders[:, :2] = 0.0
        return orders

    def derivatives(self, solution: ForwardSolution) -> tuple[ComplexArray, FloatArray]:
        """Return the derivatives of the orders, (SIZE, m), and of the half angle, (SIZE,), by every parameter."""
        p, ring = solution.parameters, solution.ring
        rows, half_angle = np.zeros((SIZE, self.max_order + 1), dtype=np.complex128), np.zeros(SIZE)
        varied = [parameter for parameter in _RING_PARAMETERS if self.shear or parameter is not P.SHEAR]
        shifted = p + _STEP * np.eye(SIZE)[varied]
        neighbours = RingTangent(ring, drum_radius_m=_drum_radius_m(p), axle_torque_nm=_torque_nm(p)).nearby(
            [self.ring(row) for row in shifted],
            sensor_offset_m=self.offset * TABLE_3_RADIUS_M,
            drum_radii_m=[_drum_radius_m(row) for row in shifted],
            axle_torques_nm=[_torque_nm(row) for row in shifted],
        )
        for parameter, parameters, varied_ring in zip(varied, shifted, neighbours, strict=True):
            rows[parameter] = (self._orders(parameters, varied_ring) - solution.orders) / _STEP
            half_angle[parameter] = (varied_ring.half_angle_rad - solution.half_angle_rad) / _STEP
        rows[P.CENTRE] = -1j * np.arange(self.max_order + 1) * solution.orders
        rows[P.GAIN] = solution.orders
        basis = self.wave_orders(p, ring) * self._gain_and_phase(p)
        for first, packet in ((P.BEFORE_COSINE, basis[:6]), (P.AFTER_COSINE, basis[6:])):
            cosine, sine = p[first], p[first + 1]
            rows[first], rows[first + 1] = packet[0], packet[1]
            rows[first + 2] = cosine * packet[2] + sine * packet[3]
            rows[first + 3] = cosine * packet[4] + sine * packet[5]
        return rows, half_angle

    def systematic_changes(self, solution: ForwardSolution) -> ComplexArray:
        """Return the changes of the orders by one standard error of the offset and of the steady value, (2, m).

        Raises:
            RingNotConvergedError: no equilibrium.
        """
        changes = np.zeros((2, self.max_order + 1), dtype=np.complex128)
        if self.offset_std:
            shifted = replace(self, offset=self.offset + _STEP).solve(solution.parameters, solution.ring)
            changes[0] = (shifted.orders - solution.orders) * (self.offset_std / _STEP)
        changes[1, 0] = self.steady_std
        return changes

    def refined(self, solution: ForwardSolution) -> tuple[ComplexArray, float]:
        """Return orders and half angle extrapolated to zero grid step: the error falls with its square."""
        fine = replace(self, nodes=2 * self.nodes).solve(solution.parameters)
        return (
            fine.orders + (fine.orders - solution.orders) / 3.0,
            fine.half_angle_rad + (fine.half_angle_rad - solution.half_angle_rad) / 3.0,
        )


def _torque_nm(parameters: FloatArray) -> float:
    return float(parameters[P.TRACTION]) * TABLE_3_LOAD_N * TABLE_3_RADIUS_M


def _drum_radius_m(parameters: FloatArray) -> float:
    curvature = float(parameters[P.ROAD_CURVATURE])
    return TABLE_3_RADIUS_M / curvature if curvature else math.inf


def stacked(orders: ComplexArray) -> FloatArray:
    """Return real and imaginary parts side by side, (..., 2 m)."""
    return np.concatenate([orders.real, orders.imag], axis=-1)


class Packet(NamedTuple):
    """Wave packet of one side.

    Attributes:
        cosine: amplitude a, as a share of the signal's mean.
        sine: amplitude b.
        order: waves per revolution.
        decay_rad: angle over which it falls to 1/e.
    """

    cosine: float
    sine: float
    order: float
    decay_rad: float

    @property
    def amplitude(self) -> float:
        """Amplitude at the edge."""
        return math.hypot(self.cosine, self.sine)


def packet_basis(
    theta_rad: FloatArray, edge_rad: float, direction: int, free_rad: float, order: float, decay_rad: float
) -> FloatArray:
    """Return cosine and sine packet and their derivatives by order and by the logarithm of the decay, (6, n).

    Rows: cosine, sine, d cosine / d order, d sine / d order, d cosine / d ln decay, d sine / d ln decay.

    Args:
        theta_rad: (n,) angles.
        edge_rad: where the packet begins.
        direction: +1 behind the trailing edge, -1 ahead of the leading edge.
        free_rad: angle out of contact; the packet ends there.
        order: waves per revolution.
        decay_rad: angle over which it falls to 1/e.
    """
    distance = np.mod(direction * (theta_rad - edge_rad), 2.0 * math.pi)
    envelope = np.where(
        distance < free_rad, np.exp(-distance / decay_rad) * (1.0 - np.exp(-((distance / _ONSET_RAD) ** 2))), 0.0
    )
    cosine, sine = envelope * np.cos(order * distance), envelope * np.sin(order * distance)
    stretch = distance / decay_rad
    return np.stack([cosine, sine, -distance * sine, distance * cosine, stretch * cosine, stretch * sine])
