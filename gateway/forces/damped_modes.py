"""Damped modal solution of the ring paper's flexible ring: its Eq. 10 to 12 with their misprints repaired.

The ring is linear about the undeformed circle, inextensible (Eq. 8), and rolls steadily. Displacement and signal are
complex orders c - i s: w(theta) = Re sum w_n e^(i n theta), theta the material angle of the sensor. Radial and
tangential damping of the sidewall, c_w and c_v, are apart: c_n = c_v + c_w n^2.

The undamped model without speed, which the dimensionless numbers come from, is `gateway.ring.ring_series`. At
zero damping both agree to rounding, because the belt's inertia and the tension that it causes cancel
(`dynamic_stiffness`).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from gateway.core.types import ComplexArray, FloatArray
from gateway.ring.ring_series import Kinematics
from gateway.ring.rolling_ring import RingParameters


class ModalCoefficients(NamedTuple):
    """Mass, gyroscopic term, damping and stiffness of each order in Eq. 11, (n,) each.

    Attributes:
        mass_kgpm: m_n = rho A (1 + n^2).
        gyroscopic_nspm2: g_n = -4 rho A n Omega.
        damping_nspm2: c_n = c_v + c_w n^2.
        stiffness_npm2: k_n.
    """

    mass_kgpm: FloatArray
    gyroscopic_nspm2: FloatArray
    damping_nspm2: FloatArray
    stiffness_npm2: FloatArray


def modal_coefficients(
    orders: ArrayLike, ring: RingParameters, pressure_pa: float, omega_radps: float
) -> ModalCoefficients:
    """Return m_n, g_n, c_n and k_n (below Eq. 11).

    The tension is sigma A = p0 b R + rho A R^2 Omega^2, the sum of inflation tension and centrifugal tension. The paper
    prints sigma / R^2 for sigma A / R^2.
    """
    square = np.square(np.asarray(orders, dtype=np.float64))
    mass, radius = ring.mass_kgpm, ring.radius_m
    tension = pressure_pa * ring.tension_width_m * radius + mass * (radius * omega_radps) ** 2
    stiffness = (
        (ring.bending_stiffness_nm2 / radius**4 * square + tension / radius**2) * np.square(1.0 - square)
        - pressure_pa * ring.tension_width_m / radius * (1.0 - square)
        + ring.tangential_stiffness_npm2
        + ring.radial_stiffness_npm2 * square
        - mass * (1.0 + square) * omega_radps**2
    )
    return ModalCoefficients(
        mass * (1.0 + square),
        -4.0 * mass * np.sqrt(square) * omega_radps,
        ring.foundation_damping_nspm2 * (ring.tangential_damping_ratio + square),
        stiffness,
    )


def dynamic_stiffness(orders: ArrayLike, ring: RingParameters, pressure_pa: float, omega_radps: float) -> ComplexArray:
    """Return K_n + i c_n n Omega, N/m^2, K_n = k_n - m_n (n Omega)^2 - g_n n Omega (the root of Eq. 11, signed)."""
    passing = np.asarray(orders, dtype=np.float64) * omega_radps
    mass, gyroscopic, damping, stiffness = modal_coefficients(orders, ring, pressure_pa, omega_radps)
    result: ComplexArray = stiffness - mass * passing**2 - gyroscopic * passing + 1j * damping * passing
    return result


def phase_lag(orders: ArrayLike, ring: RingParameters, pressure_pa: float, omega_radps: float) -> FloatArray:
    """Return n gamma_n, rad: the argument of the dynamic stiffness (below Eq. 12)."""
    result: FloatArray = np.angle(dynamic_stiffness(orders, ring, pressure_pa, omega_radps))
    return result


def displacement_orders(
    orders: ArrayLike, ring: RingParameters, pressure_pa: float, omega_radps: float, road_npm: ComplexArray
) -> ComplexArray:
    """Return the outward displacement's orders w_n = -n^2 (alpha_n - i beta_n) / (pi (K_n + i c_n n Omega)), m.

    This is Eq. 10 to 12 with A_n F_n complex, so that sign and phase are kept.

    Args:
        orders: (n,) from 1 up.
        ring: the tire; its tread and extensibility do not enter.
        pressure_pa: p0.
        omega_radps: angular speed.
        road_npm: (n,) alpha_n - i beta_n, from `contact_pressure.road_orders`.
    """
    square = np.square(np.asarray(orders, dtype=np.float64))
    result: ComplexArray = -square / math.pi * road_npm / dynamic_stiffness(orders, ring, pressure_pa, omega_radps)
    return result


def signal_orders(
    orders: ArrayLike,
    ring: RingParameters,
    pressure_pa: float,
    omega_radps: float,
    road_npm: ComplexArray,
    kinematics: Kinematics = Kinematics.CORRECTED,
) -> ComplexArray:
    """Return the orders of s / Omega^2, m, (n,): (n^2 - 1) w_n, or n^2 w_n as Eq. 25 prints it."""
    square = np.square(np.asarray(orders, dtype=np.float64))
    factor = square if kinematics is Kinematics.PRINTED else square - 1.0
    result: ComplexArray = factor * displacement_orders(orders, ring, pressure_pa, omega_radps, road_npm)
    return result
