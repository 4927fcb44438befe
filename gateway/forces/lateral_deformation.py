"""Lateral deformation of the belt from the lateral axis, by double integration in the order domain.

The lateral axis reads a = Omega^2 d2y/dtheta2 (ply steer paper, Eq. 8), so order n of y is -a_n / (n Omega)^2 and order
n of the slope of the streamline dy/ds, s = R theta, is a_n / (i n Omega^2 R). Integration amplifies low orders: noise
in order n contributes to the slope in proportion to 1/n. Order 0 of a is camber, zero-g offset and roll tilt; it
carries no information on the mean of y, which stays unknown (Eq. 21 leaves it open).

A lateral record is the vector of its coefficients over Omega^2, x = (c_lo .. c_hi, s_lo .. s_hi), in metres. Every
slope of the streamline is then a row times x, and its variance is row C row'.
"""

from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray

ORDERS: Final = range(1, 41)
"""Orders that are integrated.

Truncation at order 40 / 30 / 20 changes a tire's steepest slope by up to 0.0013 / 0.003 / 0.012 deg and the noise
hardly at all, since low orders dominate it. Omitting order 1 would halve the variance of the noise but bias the mean
slope in the first half of the contact by 0.02 to 0.05 deg, so it is kept. A yawed sensor adds gravity to it.
"""
_NUMBERS: Final[FloatArray] = np.arange(ORDERS.start, ORDERS.stop, dtype=np.float64)
# The grid starts at -pi, so odd orders change sign.
_SIGNS: Final[FloatArray] = np.where(_NUMBERS % 2, -1.0, 1.0)


def lateral_coefficients(waveforms: FloatArray) -> FloatArray:
    """Return the coefficients of `ORDERS` of waveforms (..., n) on the angle grid, (..., 2 k).

    Cosines first, then sines; in the unit of the waveforms.
    """
    n = waveforms.shape[-1]
    spectrum = np.fft.rfft(waveforms, axis=-1)[..., ORDERS.start : ORDERS.stop] * (_SIGNS * (2.0 / n))
    return np.concatenate([spectrum.real, -spectrum.imag], axis=-1)


def lateral_waveform(coefficients_m: FloatArray, n: int) -> FloatArray:
    """Return the waveform of `ORDERS` on the angle grid, (n,), in the unit of the coefficients."""
    return _synthesis(_complex(coefficients_m), n)


def deformation(coefficients_m: FloatArray, n: int) -> FloatArray:
    """Return y on the angle grid, (n,) m, without its unknown mean (Eq. 21)."""
    return _synthesis(-_complex(coefficients_m) / _NUMBERS**2, n)


def streamline_slope(coefficients_m: FloatArray, radius_m: float, n: int) -> FloatArray:
    """Return dy/ds on the angle grid, (n,) rad."""
    return _synthesis(_complex(coefficients_m) / (1j * radius_m * _NUMBERS), n)


def slope_row(angle_rad: float, radius_m: float) -> FloatArray:
    """Return the row that gives the slope at an angle, (2 k,) 1/m."""
    n = _NUMBERS
    weight = 1.0 / (n * radius_m)
    result: FloatArray = np.concatenate([np.sin(n * angle_rad) * weight, -np.cos(n * angle_rad) * weight])
    return result


def chord_row(first_rad: float, last_rad: float, radius_m: float) -> FloatArray:
    """Return the row that gives the mean slope between two angles, (2 k,) 1/m."""
    n = _NUMBERS
    weight = 1.0 / (n * n * radius_m * (last_rad - first_rad))
    first, last = n * first_rad, n * last_rad
    cosine, sine = np.cos(first) - np.cos(last), np.sin(first) - np.sin(last)
    result: FloatArray = np.concatenate([cosine * weight, sine * weight])
    return result


def line_row(first_rad: float, last_rad: float, radius_m: float) -> FloatArray:
    """Return the row that gives the slope of the least-squares line through y between two angles, (2 k,) 1/m."""
    n = _NUMBERS
    half, middle = n * (0.5 * (last_rad - first_rad)), n * (0.5 * (last_rad + first_rad))
    # The line's slope is int t y dt / int t^2 dt over t from the middle; int t sin(n t) dt = 2 (sin - x cos) / n^2 at
    # x = n times half the span, and the cosine's is zero.
    weight = 3.0 * n * (np.sin(half) - half * np.cos(half)) / (half**3 * n**2 * radius_m)
    result: FloatArray = np.concatenate([np.sin(middle) * weight, -np.cos(middle) * weight])
    return result


def remove_roll(lateral: FloatArray, radial: FloatArray, roll_rad: FloatArray | float) -> FloatArray:
    """Return the lateral axis corrected for roll tilt, for arrays of any one shape that the tilt broadcasts to.

    A sensor rolled by tau reads cos(tau) lateral + sin(tau) radial on its lateral axis and cos(tau) radial - sin(tau)
    lateral on its radial axis. Gravity is included in both, so its contribution is removed as well.
    """
    result: FloatArray = np.cos(roll_rad) * lateral - np.sin(roll_rad) * radial
    return result


def _complex(coefficients: FloatArray) -> ComplexArray:
    """Return c - i s."""
    k = len(coefficients) // 2
    result: ComplexArray = coefficients[:k] - 1j * coefficients[k:]
    return result


def _synthesis(coefficients: ComplexArray, n: int) -> FloatArray:
    """Return the waveform of complex coefficients c - i s."""
    spectrum = np.zeros(n // 2 + 1, dtype=np.complex128)
    spectrum[ORDERS.start : ORDERS.stop] = coefficients * (_SIGNS * (n / 2.0))
    return np.fft.irfft(spectrum, n=n)
