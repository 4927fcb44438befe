"""Matrices of a closed belt of cubic elements, in the frame that turns with the rim.

Coordinates of a node: x, y and their derivatives by the length of the belt, as in the absolute nodal coordinate
formulation. Axle at the origin. Node i rests at R (sin theta, -cos theta), theta = 2 pi i / N - pi, so the belt is
counter-clockwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix

Array = NDArray[np.float64]

COORDINATES = 4
_GAUSS = 8
QUARTER_TURN: Array = np.array([[0.0, -1.0], [1.0, 0.0]])


@dataclass(frozen=True)
class Mesh:
    """A closed belt.

    Attributes:
        count: number of elements and nodes.
        radius_m: of the resting belt.
    """

    count: int
    radius_m: float

    @property
    def length_m(self) -> float:
        """Length of an element."""
        return 2.0 * math.pi * self.radius_m / self.count

    @cached_property
    def theta_rad(self) -> Array:
        """(N,) resting angles of the nodes."""
        angles: Array = 2.0 * math.pi * np.arange(self.count) / self.count - math.pi
        return angles

    @cached_property
    def resting(self) -> Array:
        """(4 N,) coordinates of the resting circle."""
        theta = self.theta_rad
        position = self.radius_m * np.stack([np.sin(theta), -np.cos(theta)], axis=1)
        slope = np.stack([np.cos(theta), np.sin(theta)], axis=1)
        return np.concatenate([position, slope], axis=1).reshape(-1)

    @cached_property
    def points(self) -> GaussPoints:
        """Gauss points of all elements."""
        position, weight = np.polynomial.legendre.leggauss(_GAUSS)
        return GaussPoints(self, 0.5 * (position + 1.0), 0.5 * weight * self.length_m)


class GaussPoints:
    """Interpolation of the coordinates to Gauss points, and integrals over the belt.

    Attributes:
        shape: (2 P, 4 N) sparse, coordinates to positions of the points, x and y in turn.
        slope: (2 P, 4 N) likewise derivatives by length.
        weight_m: (P,) length of belt that a point stands for.
        theta_rad: (P,) resting angles.
        at: (p,) points of an element, 0 to 1.
        values: (4, p) shape functions there, of `shapes_at`.
        slopes: (4, p) their derivatives by length.
        element_weight_m: (p,) lengths of an element's points.
    """

    def __init__(self, mesh: Mesh, position: Array, weight_m: Array) -> None:
        """Lay out the points `position` (0 to 1) of every element."""
        length, x = mesh.length_m, position
        values = self.shapes_at(position, length)
        slopes = np.stack([(6 * x**2 - 6 * x) / length, 1 - 4 * x + 3 * x**2, (6 * x - 6 * x**2) / length,
                           3 * x**2 - 2 * x])  # fmt: skip
        self.at, self.values, self.slopes, self.element_weight_m = position, values, slopes, weight_m
        self.shape = _interpolation(mesh.count, values)
        self.slope = _interpolation(mesh.count, slopes)
        self.weight_m = np.tile(weight_m, mesh.count)
        places = np.arange(mesh.count)[:, None] + x[None, :]
        self.theta_rad: Array = (2.0 * math.pi * places / mesh.count - math.pi).reshape(-1)

    @staticmethod
    def shapes_at(position: Array, length_m: float) -> Array:
        """Return (4, p) shape functions of an element at points 0 to 1: place, slope, next place, next slope."""
        x, length = position, length_m
        return np.stack([1 - 3 * x**2 + 2 * x**3, length * (x - 2 * x**2 + x**3), 3 * x**2 - 2 * x**3,
                         length * (x**3 - x**2)])  # fmt: skip

    def form(self, left: csr_matrix, block: Array, right: csr_matrix) -> csr_matrix:
        """Return the integral of left^T block right over the belt; `block` is (2, 2) or (P, 2, 2)."""
        count = len(self.weight_m)
        blocks = np.broadcast_to(block, (count, 2, 2)) * self.weight_m[:, None, None]
        rows = np.repeat(2 * np.arange(count)[:, None] + np.arange(2), 2, axis=1).reshape(-1)
        columns = np.tile(2 * np.arange(count)[:, None] + np.arange(2), (1, 2)).reshape(-1)
        middle = csr_matrix((blocks.reshape(-1), (rows, columns)), shape=(2 * count, 2 * count))
        return csr_matrix(left.T @ middle @ right)


def _interpolation(count: int, values: Array) -> csr_matrix:
    """Return the sparse matrix of (4, p) shape functions in every element."""
    per_element = values.shape[1]
    rows, columns, entries = [], [], []
    for element in range(count):
        following = (element + 1) % count
        for point in range(per_element):
            for axis in range(2):
                row = 2 * (element * per_element + point) + axis
                for node, offset, number in ((element, 0, 0), (element, 2, 1), (following, 0, 2), (following, 2, 3)):
                    rows.append(row)
                    columns.append(COORDINATES * node + offset + axis)
                    entries.append(values[number, point])
    return csr_matrix((entries, (rows, columns)), shape=(2 * count * per_element, COORDINATES * count))


@dataclass(frozen=True)
class BeltMatrices:
    """Constant matrices of the belt in the rim's frame; all (4 N, 4 N) sparse.

    Attributes:
        mass: per unit of mass per length.
        coriolis: 2 J integrated, per unit of mass per length and angular speed.
        area: second derivative of the enclosed area: force of a pressure of 1 N/m^2 on a width of 1 m, over position.
        radial: sidewall, per unit of radial stiffness per length.
        along: sidewall, per unit of tangential stiffness per length.
    """

    mass: csr_matrix
    coriolis: csr_matrix
    area: csr_matrix
    radial: csr_matrix
    along: csr_matrix


def belt_matrices(mesh: Mesh, mass_share: Array | None = None) -> BeltMatrices:
    """Return the matrices of a belt; `mass_share` (P,) is the mass per length at the Gauss points over the unit."""
    points = mesh.points
    heavy = np.ones((len(points.theta_rad), 1, 1)) if mass_share is None else mass_share[:, None, None]
    out = np.stack([np.sin(points.theta_rad), -np.cos(points.theta_rad)], axis=1)
    forward = np.stack([np.cos(points.theta_rad), np.sin(points.theta_rad)], axis=1)
    # The area is half the integral of x y' - y x'; its gradient is symmetric in position.
    half = points.form(points.shape, -0.5 * QUARTER_TURN, points.slope)
    return BeltMatrices(
        mass=points.form(points.shape, heavy * np.eye(2), points.shape),
        coriolis=points.form(points.shape, 2.0 * heavy * QUARTER_TURN, points.shape),
        area=csr_matrix(half + half.T),
        radial=points.form(points.shape, out[:, :, None] * out[:, None, :], points.shape),
        along=points.form(points.shape, forward[:, :, None] * forward[:, None, :], points.shape),
    )
