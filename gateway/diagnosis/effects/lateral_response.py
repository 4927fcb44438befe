"""Lateral response of the belt to unit shear, curvature and drag in the contact.

A shear-flexible beam under tension on the lateral sidewall, a tread that sticks to the road, in closed form order by
order of the wheel. It shares the beam's equations with `gateway.forces.lateral_belt` (docs/explanation/ply-steer.md)
but neither its grid nor its sliding nor its uneven tension, and it needs nothing of the ring but its curvature and the
edges: per length of belt and order k = n / R,

    y D = f - B (i k gamma0 + kappa0),   B = EI k^2 / (1 + EI k^2 / Ks),   D = k^2 (B + T) + ky

with gamma0 = -g dkappa (ply steer), kappa0 = -beta dkappa (a cone) and f = cy (alpha s - y + y(leading edge)) of the
sticking tread in the contact.
"""

from enum import IntEnum
from functools import cached_property, lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.belt_geometry import relative_curvature
from gateway.diagnosis.effects.effect import ModelledBlock

# A 205/55R16 car tire's belt; `Stiffness` fits what differs from it. Only ratios of them matter for the shape.
SHEAR_STIFFNESS_N: Final = 1.6e6
BENDING_STIFFNESS_NM2: Final = 1e3
SIDEWALL_STIFFNESS_NPM2: Final = 2.5e5
TREAD_STIFFNESS_NPM2: Final = 8e6
# Half of the sidewall's stiffness is carried by pressure, half by its structure.
_REFERENCE_PA: Final = 2.1e5
_PRESSURE_SHARE: Final = 0.5
# Tension is p0 b R with the ring paper's b / R, less about half of the third that a contact takes off.
_TENSION_NUMBER: Final = 0.195 * 0.85
_HIGHEST_ORDER: Final = 160
_POINTS: Final = 64
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(_POINTS)
# The belt's answer to a push is looked up by angle in a table so fine that a straight line between two of its points
# is right to 0.2 % of the highest order. A product of matrices would do too, but small ones are slow on many threads.
_TABLE: Final = 8192


class Load(IntEnum):
    """Causes of lateral belt bending; the unit of each is that of its parameter."""

    PLY_STEER = 0  # metre of coupling length g = B16 / A66
    CONE = 1  # radian of the cone's half angle
    SLIP = 2  # radian of slip angle


class Stiffness(NamedTuple):
    """Logarithms of the stiffnesses over the nominal ones; 0 is nominal."""

    bending_ln: float = 0.0
    sidewall_ln: float = 0.0
    tread_ln: float = 0.0


class _Contact:
    """Tread points in the contact, and the response at one to a force at another."""

    def __init__(self, edges_rad: tuple[float, float], orders: NDArray[np.int64], radius_m: float) -> None:
        """Lay out the points.

        Args:
            edges_rad: of the contact, leading and trailing.
            orders: of the wheel, from 0.
            radius_m: of the belt.
        """
        half = 0.5 * (edges_rad[1] - edges_rad[0])
        theta = 0.5 * (edges_rad[0] + edges_rad[1]) + half * _NODES
        self.behind_edge_m = radius_m * (theta - edges_rad[0])
        self._weight_m = half * radius_m * _WEIGHTS
        self._scale = 1.0 / (2.0 * np.pi * radius_m)
        ends = np.append(theta, edges_rad[0])
        self._phase = np.exp(1j * np.outer(orders, ends))
        self._one_sided_weights = np.where(orders == 0, 1.0, 2.0)
        position = np.mod(ends[:, None] - theta, 2.0 * np.pi) * (_TABLE / (2.0 * np.pi))
        self._index = position.astype(np.intp)
        self._fraction = position - self._index

    def beside_edge(self, shapes: ComplexArray) -> FloatArray:
        """Return shapes (..., orders) at the points, minus their value at the leading edge."""
        values: FloatArray = (self._one_sided_weights * shapes @ self._phase).real
        return values[..., :-1] - values[..., -1:]

    def influence(self, compliance: FloatArray) -> FloatArray:
        """Return the belt's response to the tread's force per length at the points, relative to the leading edge."""
        answer = np.fft.irfft(compliance, n=_TABLE) * (_TABLE * self._scale)
        answer = np.append(answer, answer[:1])
        matrix = answer[self._index] * (1.0 - self._fraction) + answer[self._index + 1] * self._fraction
        result: FloatArray = (matrix[:-1] - matrix[-1:]) * self._weight_m
        return result

    def orders_of(self, push_npm: FloatArray) -> ComplexArray:
        """Return the orders of forces per length (..., points)."""
        force = push_npm * self._weight_m * self._scale
        result: ComplexArray = force.astype(np.complex128) @ self._phase[:, :-1].conj().T
        return result

    def total(self, push_npm: FloatArray) -> float:
        """Return the total force, N."""
        return float(push_npm @ self._weight_m)


class Response:
    """Lateral acceleration over omega^2 by a unit of a load.

    Attributes:
        lateral_m: (FIELD_SIZE,) d2y/dtheta2.
        side_force_n: of the road on the tire.
    """

    def __init__(
        self,
        curvature: FloatArray,
        edges_rad: tuple[float, float],
        radius_m: float,
        pressure_pa: float,
        load: Load,
        stiffness: Stiffness,
    ) -> None:
        """Solve belt and tread on a belt of this curvature times its radius, (FIELD_SIZE,)."""
        self._size = len(curvature)
        self._orders = orders = np.arange(min(_HIGHEST_ORDER, self._size // 2 - 1) + 1)
        # The grid begins at -pi: turned, a coefficient belongs to exp(i n theta).
        self._sign = np.where(orders % 2, -1.0, 1.0)
        bent = np.fft.rfft(curvature - 1.0)[: len(orders)] * self._sign / (self._size * radius_m)
        self._forcing: ComplexArray = bent * (1j * orders / radius_m if load is Load.PLY_STEER else load is Load.CONE)
        self._k2 = (orders / radius_m) ** 2
        bending = BENDING_STIFFNESS_NM2 * np.exp(stiffness.bending_ln)
        self._tread = TREAD_STIFFNESS_NPM2 * np.exp(stiffness.tread_ln)
        share = 1.0 + _PRESSURE_SHARE * (pressure_pa / _REFERENCE_PA - 1.0)
        self._sidewall = SIDEWALL_STIFFNESS_NPM2 * share * np.exp(stiffness.sidewall_ln)
        self._shear_factor = 1.0 + bending * self._k2 / SHEAR_STIFFNESS_N
        self._beam = bending * self._k2 / self._shear_factor
        self._whole = self._k2 * (self._beam + _TENSION_NUMBER * pressure_pa * radius_m**2) + self._sidewall

        self._contact = _Contact(edges_rad, orders, radius_m)
        free = self._forcing * self._beam / self._whole
        self._system = self._contact.influence(1.0 / self._whole)
        self._system[np.diag_indices(_POINTS)] += 1.0 / self._tread
        drag = self._contact.behind_edge_m * float(load is Load.SLIP)
        imposed_m: FloatArray = drag - self._contact.beside_edge(free)
        self._push: FloatArray = np.asarray(np.linalg.solve(self._system, imposed_m), dtype=np.float64)
        self.side_force_n = self._contact.total(self._push)
        self.lateral_m = self._second_derivative(free + self._contact.orders_of(self._push) / self._whole)

    @cached_property
    def derivative_m(self) -> FloatArray:
        """(3, FIELD_SIZE) d lateral_m by the logarithms of `Stiffness`."""
        none = np.zeros_like(self._beam)
        beam = np.stack([self._beam / self._shear_factor, none, none])
        whole = np.stack([self._k2 * beam[0], np.full_like(none, self._sidewall), none])
        # Of the compliance 1 / whole.
        slopes = -whole / self._whole**2
        free = self._forcing * (beam / self._whole + self._beam * slopes)
        influences = [self._contact.influence(slope) @ self._push for slope in slopes[:2]]
        system_terms = np.stack([*influences, -self._push / self._tread])
        push: FloatArray = np.linalg.solve(self._system, -(self._contact.beside_edge(free) + system_terms).T).T
        shapes = free + self._contact.orders_of(push) / self._whole + self._contact.orders_of(self._push) * slopes
        return self._second_derivative(shapes)

    def _second_derivative(self, shapes: ComplexArray) -> FloatArray:
        """Return d2/dtheta2 of orders (..., orders) on the grid, not writable, for it is shared."""
        spectrum = np.zeros((*shapes.shape[:-1], self._size // 2 + 1), dtype=np.complex128)
        spectrum[..., : len(self._orders)] = -(self._orders**2) * shapes * self._sign * self._size
        field: FloatArray = np.fft.irfft(spectrum, n=self._size)
        field.setflags(write=False)
        return field


def unit_response(block: ModelledBlock, load: Load, stiffness: Stiffness) -> Response:
    """Return the response on the belt's shape of a block; quick when the shape was seen before.

    The curvature is the neutral layer's, whatever the depth of the sensor that the model has.
    """
    curvature = np.ascontiguousarray(relative_curvature(block), dtype=np.float64)
    conditions = block.conditions
    edges = block.leading_edge_rad, block.trailing_edge_rad
    return _solved(curvature.tobytes(), edges, conditions.radius_m, conditions.pressure_pa, load, stiffness)


@lru_cache(maxsize=64)
def _solved(
    curvature: bytes,
    edges_rad: tuple[float, float],
    radius_m: float,
    pressure_pa: float,
    load: Load,
    stiffness: Stiffness,
) -> Response:
    return Response(np.frombuffer(curvature), edges_rad, radius_m, pressure_pa, load, stiffness)
