"""Contact pressure of the road on the belt: shapes over the contact, and their modal forces.

A shape is a sum of Legendre polynomials over the contact, x = (theta - centre) / contact half angle from -1 to 1:

    q(theta) = Q / (2 R theta_r) (1 + sum a_m P_m(x))

a_2 and a_4 are symmetric (a parabola has a_2 = -1); a_1 and a_3 shift the pressure towards one edge. The road pushes
vertically. On the exact ring a_2 is -0.98 at 1000 N, -0.36 at 5000 N and -0.17 at 8000 N, a_4 is -0.02, -0.59 and
-0.60.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from gateway.core.types import ComplexArray, FloatArray


def unit_road_orders(
    orders: ArrayLike, half_angle_rad: float, degrees: int, centre_rad: float = 0.0
) -> tuple[ComplexArray, ComplexArray]:
    """Return the modal force of each Legendre polynomial times R / Q, and its derivative by the contact half angle.

    The modal force of a vertical push is alpha_n - i beta_n = int q (cos theta + i sin(theta) / n) e^(-i n theta): its
    radial part, and its tangential part through the inextensible ring's v' = -w; waves of orders n - 1 and n + 1.

    Args:
        orders: (n,) from 1 up.
        half_angle_rad: theta_r.
        degrees: highest degree of the polynomials.
        centre_rad: centre of the contact.

    Returns:
        two arrays (degrees + 1, n); row 0 is the uniform push.
    """
    n = np.asarray(orders, dtype=np.float64)
    x, weighted = _quadrature(degrees, math.ceil(float(n.max(initial=1.0)) * half_angle_rad / _PHASE_STEP_RAD))
    value = np.zeros((degrees + 1, *n.shape), dtype=np.complex128)
    slope = np.zeros_like(value)
    for neighbour, weight in ((n - 1.0, 0.5 * (1.0 + 1.0 / n)), (n + 1.0, 0.5 * (1.0 - 1.0 / n))):
        wave = (weight * np.exp(-1j * neighbour * centre_rad))[..., np.newaxis] * np.exp(
            -1j * half_angle_rad * np.multiply.outer(neighbour, x)
        )
        value += np.moveaxis(wave @ weighted.T, -1, 0)
        slope += neighbour * np.moveaxis((-1j * x * wave) @ weighted.T, -1, 0)
    return value, slope


# Phase in rad of the waves over half a contact from which the quadrature uses more points.
_PHASE_STEP_RAD: Final = 10.0


@lru_cache(maxsize=32)
def _quadrature(degrees: int, steps: int) -> tuple[FloatArray, FloatArray]:
    """Return Gauss points (k,) on -1 to 1 and half the weight times each polynomial, (degrees + 1, k).

    Exact to rounding for waves with a phase of up to `steps` times _PHASE_STEP_RAD.
    """
    x, weights = np.polynomial.legendre.leggauss(20 + degrees + 8 * steps)
    polynomials = np.polynomial.legendre.legvander(x, degrees).T
    result: FloatArray = 0.5 * weights * polynomials
    return x, result


def road_orders(
    orders: ArrayLike,
    load_n: float,
    radius_m: float,
    half_angle_rad: float,
    shape: Sequence[float] = (),
    centre_rad: float = 0.0,
) -> ComplexArray:
    """Return alpha_n - i beta_n of a vertical push, N/m, (n,); Eq. 12's integrals with the tangential part added."""
    value, _ = unit_road_orders(orders, half_angle_rad, len(shape), centre_rad)
    amounts = np.array([1.0, *shape], dtype=np.complex128)
    result: ComplexArray = load_n / radius_m * np.tensordot(amounts, value, axes=1)
    return result
