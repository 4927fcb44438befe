"""The ring paper's simplified modal model: standing-wave orders from four dimensionless numbers.

Equations are those of "Tire Dimensionless Numbers for Analysis of Tire Characteristics and Intelligent Tire Signals",
with their misprints repaired (docs/explanation/ring-paper-estimator.md lists them). The model is linear about the
undeformed circle and exact for small loads only. Orders n are integers from 1 up; all functions broadcast over them.

Numbers are Bs = EI / (R^4 p0), Cw = b / R, Rs = kw / p0 and Ts = kv / p0 (Eq. 17), in this order; `RingParameters` of
`rolling_ring` turns them into a ring's stiffnesses and back.

Sign: s is the radial sensor signal, positive inward, so that Eq. 27 holds with its printed minus.
"""

import math
from collections.abc import Sequence
from enum import StrEnum

import numpy as np
from numpy.typing import ArrayLike

from gateway.core.types import FloatArray
from gateway.ring.contact_pressure import road_orders


class Kinematics(StrEnum):
    """Factor from the displacement of order n to the reading of a sensor on the ring.

    PRINTED is Eq. 25: n^2, the acceleration in the frame of the road. CORRECTED is n^2 - 1, with the Coriolis and
    centripetal terms of the rotating sensor: 0 at n = 1, 3/4 of the printed factor at n = 2.
    """

    PRINTED = "printed"
    CORRECTED = "corrected"


class RoadForce(StrEnum):
    """Direction of the uniform road push: RADIAL is Eq. 23, VERTICAL includes the small tangential component."""

    RADIAL = "radial"
    VERTICAL = "vertical"


def stiffness_terms(orders: ArrayLike) -> FloatArray:
    """Return the factors of Bs, Cw, Rs and Ts in the denominator of Eq. 19, (n, 4)."""
    square = np.square(np.asarray(orders, dtype=np.float64))
    bend = square - 1.0
    return np.stack([square * bend**2, square * bend, square, np.ones_like(square)], axis=-1)


def modal_stiffness(orders: ArrayLike, numbers: Sequence[float]) -> FloatArray:
    """Return D_n = Bs n^2 (n^2-1)^2 + Cw n^2 (n^2-1) + Rs n^2 + Ts, (n,)."""
    result: FloatArray = stiffness_terms(orders) @ np.asarray(numbers, dtype=np.float64)
    return result


def modal_number(orders: ArrayLike, numbers: Sequence[float]) -> FloatArray:
    """Return the modal tire model number Tm = A_n p0 = -n^2 / (pi D_n), (n,) (Eq. 17 and 19)."""
    square = np.square(np.asarray(orders, dtype=np.float64))
    result: FloatArray = -square / (math.pi * modal_stiffness(orders, numbers))
    return result


def modal_force(
    orders: ArrayLike, load_n: float, radius_m: float, half_angle_rad: float, road: RoadForce = RoadForce.RADIAL
) -> FloatArray:
    """Return alpha_n of a uniform road push, N/m, (n,).

    RADIAL: Q sin(n theta_r) / (n R theta_r), Eq. 22 and 23. VERTICAL: the integral of q (cos theta cos n theta +
    sin theta sin(n theta) / n), whose small-angle limit is RADIAL.
    """
    n = np.asarray(orders, dtype=np.float64)
    if road is RoadForce.RADIAL:
        radial: FloatArray = load_n * np.sin(n * half_angle_rad) / (n * radius_m * half_angle_rad)
        return radial
    vertical: FloatArray = road_orders(n, load_n, radius_m, half_angle_rad).real
    return vertical


def displacement_orders(
    orders: ArrayLike,
    numbers: Sequence[float],
    *,
    load_n: float,
    pressure_pa: float,
    radius_m: float,
    half_angle_rad: float,
    road: RoadForce = RoadForce.RADIAL,
) -> FloatArray:
    """Return the cosine coefficients of the outward displacement w, m, (n,) (Eq. 24)."""
    result: FloatArray = (
        modal_number(orders, numbers) / pressure_pa * modal_force(orders, load_n, radius_m, half_angle_rad, road)
    )
    return result


def signal_orders(
    orders: ArrayLike,
    numbers: Sequence[float],
    *,
    load_n: float,
    pressure_pa: float,
    radius_m: float,
    half_angle_rad: float,
    kinematics: Kinematics = Kinematics.PRINTED,
    road: RoadForce = RoadForce.RADIAL,
) -> FloatArray:
    """Return the cosine coefficients of s / Omega^2, m, (n,) (Eq. 25 to 27).

    PRINTED with RADIAL is Eq. 27 as printed; CORRECTED with VERTICAL is the exact solution of the linear ring.
    """
    square = np.square(np.asarray(orders, dtype=np.float64))
    displacement = displacement_orders(
        orders,
        numbers,
        load_n=load_n,
        pressure_pa=pressure_pa,
        radius_m=radius_m,
        half_angle_rad=half_angle_rad,
        road=road,
    )
    result: FloatArray = displacement * (square if kinematics is Kinematics.PRINTED else square - 1.0)
    return result


def signal_waveform(
    angles_rad: FloatArray, omega_radps: float, radius_m: float, coefficients_m: FloatArray
) -> FloatArray:
    """Return s = Omega^2 (R + sum of c_n cos n theta), coefficients of orders 1 up; m/s^2, shape of the angles."""
    orders = np.arange(1, len(coefficients_m) + 1)
    series = np.cos(np.multiply.outer(angles_rad, orders)) @ coefficients_m
    result: FloatArray = omega_radps**2 * (radius_m + series)
    return result


def pressure_number(load_n: float, pressure_pa: float, radius_m: float, half_angle_rad: float) -> float:
    """Return Pn = Q / (2 p0 theta_r R^2) (Eq. 33)."""
    return load_n / (2.0 * pressure_pa * half_angle_rad * radius_m**2)
