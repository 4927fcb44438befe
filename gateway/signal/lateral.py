"""Lateral deformation of the belt from the lateral axis, by double integration in the order domain.

The lateral axis reads a = Omega^2 d2y/dtheta2 (ply steer paper, Eq. 8), so order n of y is -a_n / (n Omega)^2 and order
n of the slope of the streamline dy/ds, s = R theta, is a_n / (i n Omega^2 R). Integration favours low orders: noise in
a trusted order n reaches the slope as 1/n. Order 0 of a is camber, zero-g offset and roll tilt and says nothing of y,
whose mean stays unknown (Eq. 21 leaves it open).

A lateral record is used as the vector of its coefficients over Omega^2, x = (c_lo .. c_hi, s_lo .. s_hi), metres; every
slope of the streamline is then a row times x, and its variance is row C row'.
"""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

LOWEST_ORDER: Final = 1
HIGHEST_ORDER: Final = 40


def trusted_orders(order_max: int, lowest: int = LOWEST_ORDER, highest: int = HIGHEST_ORDER) -> range:
    """Return the orders that are integrated: from `lowest` to `highest` as far as the sampling carries them.

    Cutting at order 40 / 30 / 20 costs up to 0.0013 / 0.003 / 0.012 deg of a tire's steepest slope and adds hardly any
    noise, which lives on the low orders. Leaving order 1 out would halve the noise's variance but cost 0.02 to 0.05 deg
    of the mean slope in the first half of the contact, so it is kept; gravity reaches it through the sensor's yaw.
    """
    return range(lowest, min(highest, order_max) + 1)


def lateral_coefficients(waveforms: FloatArray, orders: range) -> FloatArray:
    """Return the coefficients of the trusted orders of waveforms (..., n) on the angle grid, (..., 2 k).

    Cosines first, then sines; in the unit of the waveforms.
    """
    n = waveforms.shape[-1]
    spectrum = np.fft.rfft(waveforms, axis=-1)[..., orders.start : orders.stop] * (_signs(orders) * 2.0 / n)
    return np.concatenate([spectrum.real, -spectrum.imag], axis=-1)


def deformation(coefficients_m: FloatArray, orders: range, n: int) -> FloatArray:
    """Return y on the angle grid, (n,) m, without its unknown mean (Eq. 21)."""
    number = np.arange(orders.start, orders.stop)
    return _synthesis(coefficients_m, orders, -1.0 / number**2, n)


def streamline_slope(coefficients_m: FloatArray, orders: range, radius_m: float, n: int) -> FloatArray:
    """Return dy/ds on the angle grid, (n,) rad."""
    number = np.arange(orders.start, orders.stop)
    return _synthesis(coefficients_m, orders, 1.0 / (1j * number * radius_m), n)


def lateral_waveform(coefficients_m: FloatArray, orders: range, n: int) -> FloatArray:
    """Return the waveform of the trusted orders on the angle grid, (n,), in the unit of the coefficients."""
    return _synthesis(coefficients_m, orders, np.ones(len(orders)), n)


def slope_row(angle_rad: float, orders: range, radius_m: float) -> FloatArray:
    """Return the row that gives the slope at an angle, (2 k,) 1/m."""
    n = np.arange(orders.start, orders.stop, dtype=np.float64)
    result: FloatArray = np.concatenate([np.sin(n * angle_rad), -np.cos(n * angle_rad)]) / (np.tile(n, 2) * radius_m)
    return result


def chord_row(first_rad: float, last_rad: float, orders: range, radius_m: float) -> FloatArray:
    """Return the row that gives the mean slope between two angles, (2 k,) 1/m."""
    n = np.arange(orders.start, orders.stop, dtype=np.float64)
    span = radius_m * (last_rad - first_rad)
    rise = np.concatenate([np.cos(n * first_rad) - np.cos(n * last_rad), np.sin(n * first_rad) - np.sin(n * last_rad)])
    result: FloatArray = rise / (np.tile(n * n, 2) * span)
    return result


def line_row(first_rad: float, last_rad: float, orders: range, radius_m: float) -> FloatArray:
    """Return the row that gives the slope of the least-squares line through y between two angles, (2 k,) 1/m."""
    n = np.arange(orders.start, orders.stop, dtype=np.float64)
    half, middle = 0.5 * (last_rad - first_rad), 0.5 * (last_rad + first_rad)
    # int t sin(n t) dt over -half..half; that of t cos(n t) is zero. Over int t^2 dt it is the line's slope.
    moment = 2.0 * (np.sin(n * half) - n * half * np.cos(n * half)) / n**2
    weight = moment / (2.0 / 3.0 * half**3)
    line = np.concatenate([np.sin(n * middle) * weight, -np.cos(n * middle) * weight])
    result: FloatArray = line / (np.tile(n * n, 2) * radius_m)
    return result


def remove_roll(lateral: FloatArray, radial: FloatArray, roll_rad: float) -> FloatArray:
    """Return the lateral axis without what a roll tilt mixes into it; any arrays of one shape.

    A sensor rolled by tau reads cos(tau) lateral + sin(tau) radial on its lateral axis and cos(tau) radial - sin(tau)
    lateral on its radial axis, gravity included, so gravity's share goes with it.
    """
    result: FloatArray = math.cos(roll_rad) * lateral - math.sin(roll_rad) * radial
    return result


def _synthesis(coefficients: FloatArray, orders: range, factors: NDArray[np.generic], n: int) -> FloatArray:
    """Return the waveform of coefficients, each order times a complex factor."""
    k = len(orders)
    spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
    spectrum[orders.start : orders.stop] = (
        (coefficients[:k] - 1j * coefficients[k:]) * factors * (_signs(orders) * n / 2.0)
    )
    return np.fft.irfft(spectrum, n=n)


def _signs(orders: range) -> FloatArray:
    """The grid starts at -pi."""
    result: FloatArray = np.where(np.arange(orders.start, orders.stop) % 2, -1.0, 1.0)
    return result
