"""Geometrically exact shape of the belt from the radial signal: curvature, tangent angle and position.

An inextensible belt that rolls steadily passes every point with V = R Omega. A sensor on it reads s = V^2 kappa, or
s = V^2 kappa (1 - e kappa) at e below the neutral layer. The curvature integrated twice is the shape of the belt.

Only the part symmetric about the contact centre is used: the cosine orders of the signal. Damping and torque add odd
terms, which affect the symmetric force balance to second order only. Lengths are over R.
Frame: complex numbers x + i y, y up, the axle at 0; theta = 0 is the lowest point of the undeformed belt, where its
tangent is +1; the outward normal is -i times the tangent. Shapes are given on theta = pi j / HALF_STEPS, j = 0 to
HALF_STEPS; the other half is the mirror image. Leading axes are waveforms.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray

HALF_STEPS: Final = 256
STEP_RAD: Final = math.pi / HALF_STEPS
ANGLES_RAD: Final[FloatArray] = np.linspace(0.0, math.pi, HALF_STEPS + 1)
# Unit vectors of the undeformed belt, outward and along.
RADIAL: Final[ComplexArray] = -1j * np.exp(1j * ANGLES_RAD)
ALONG: Final[ComplexArray] = np.exp(1j * ANGLES_RAD)
# Highest order used: a tire's shape has decayed there, and on a real tire nothing above order 110 is repeatable.
MAX_ORDER: Final = 90

_ORDERS: Final[FloatArray] = np.arange(MAX_ORDER + 1, dtype=np.float64)
# (HALF_STEPS + 1, MAX_ORDER + 1) cosines, and sin(n theta) / n, the integral of the cosines.
COSINES: Final[FloatArray] = np.cos(np.multiply.outer(ANGLES_RAD, _ORDERS))
_SINES: Final[FloatArray] = np.concatenate(
    [ANGLES_RAD[:, np.newaxis], np.sin(np.multiply.outer(ANGLES_RAD, _ORDERS[1:])) / _ORDERS[1:]], axis=1
)
# Weights of the trapezoidal rule over 0 to pi, which is exact for band-limited even functions.
TRAPEZOID: Final[FloatArray] = np.full(HALF_STEPS + 1, STEP_RAD)
TRAPEZOID[[0, -1]] *= 0.5
_CLOSING: Final[FloatArray] = TRAPEZOID * _SINES[:, 1]
# From values on the half circle to cosine orders.
_ANALYSIS: Final[FloatArray] = COSINES * TRAPEZOID[:, np.newaxis] * (2.0 / math.pi)
_ANALYSIS[:, 0] *= 0.5

_CLOSURE_STEPS: Final = 3
_OFFSET_STEPS: Final = 4
# 1 / n, to integrate a series without its mean; the highest order has no integral on the grid.
_FREQUENCIES: Final = np.fft.fftfreq(2 * HALF_STEPS, 0.5 / HALF_STEPS)
_INVERSE: Final[FloatArray] = np.zeros(2 * HALF_STEPS)
_INVERSE[1:] = 1.0 / _FREQUENCIES[1:]
_INVERSE[HALF_STEPS] = 0.0


@dataclass(frozen=True, slots=True)
class BeltShape:
    """Closed belts, symmetric about theta = 0.

    Attributes:
        orders: (b, MAX_ORDER + 1) cosine orders of the curvature over its mean; order 0 is 1, and order 1 is chosen to
            close the belt.
        curvature: (b, m) kappa R.
        angle_rad: (b, m) direction of the tangent, 0 at theta = 0.
        tangent: (b, m) complex.
        position: (b, m) complex, -i at theta = 0; the deflection at the contact, which moves the belt up, is not
            included.
    """

    orders: FloatArray
    curvature: FloatArray
    angle_rad: FloatArray
    tangent: ComplexArray
    position: ComplexArray


def orders_about(
    waveform: FloatArray, centre_rad: FloatArray | float = 0.0, max_order: int = MAX_ORDER
) -> ComplexArray:
    """Return the orders c - i s about `centre_rad` of waveforms on the angle grid: c cos n theta + s sin n theta.

    Args:
        waveform: (..., n), theta = -pi + 2 pi k / n, n > 2 MAX_ORDER.
        centre_rad: (...) angle of the contact's centre.
        max_order: orders above it are set to zero, for example above the sampled band.

    Returns:
        (..., MAX_ORDER + 1), in the unit of the waveform; order 0 is the mean.
    """
    n = waveform.shape[-1]
    spectrum = np.fft.rfft(waveform, axis=-1)[..., : MAX_ORDER + 1]
    phase = np.multiply.outer(np.asarray(centre_rad) - math.pi, _ORDERS)
    orders: ComplexArray = spectrum * np.exp(1j * phase) * (2.0 / n)
    orders[..., 0] *= 0.5
    orders[..., max_order + 1 :] = 0.0
    return orders


def curvature_orders(signal_orders: FloatArray, offset: FloatArray | float = 0.0) -> FloatArray:
    """Return the cosine orders of kappa R from those of the signal, whose gain may be unknown.

    The mean of kappa R over a closed belt is 1, which determines the gain. With an offset, s = g k (1 - offset k) is
    solved for k and the gain g together.

    Args:
        signal_orders: (b, MAX_ORDER + 1) of s; order 0 positive.
        offset: e / R, the sensor's distance below the neutral layer over the belt radius; (b, 1) or one for all.

    Returns:
        (b, MAX_ORDER + 1), order 0 is 1; NaN where the mean is not positive.
    """
    mean = signal_orders[:, :1]
    with np.errstate(divide="ignore", invalid="ignore"):
        relative: FloatArray = np.where(mean > 0.0, signal_orders / mean, math.nan)
    if not np.any(offset):
        return relative
    signal = relative @ COSINES.T
    curvature = signal
    quadruple = -4.0 * offset
    for _ in range(_OFFSET_STEPS):
        square = (np.square(curvature) @ TRAPEZOID / math.pi)[:, np.newaxis]
        read = signal * (1.0 - offset * square)
        # The root that tends to `read` as the offset tends to 0; the maximum keeps an impossible peak from being NaN.
        root = read * quadruple
        root += 1.0
        np.maximum(root, 0.0, out=root)
        np.sqrt(root, out=root)
        root += 1.0
        read *= 2.0
        curvature = np.divide(read, root, out=read)
    orders: FloatArray = curvature @ _ANALYSIS
    orders /= orders[:, :1]
    return orders


def belt_shape(orders: FloatArray) -> BeltShape:
    """Integrate curvature orders (b, MAX_ORDER + 1), order 0 being 1, to closed belts.

    Order 1 is adjusted until the integral of the tangent over the revolution vanishes.
    """
    closed, angle = _closed(orders)
    tangent: ComplexArray = np.empty(angle.shape, dtype=np.complex128)
    tangent.real, tangent.imag = np.cos(angle), np.sin(angle)
    return BeltShape(
        orders=closed,
        curvature=closed @ COSINES.T,
        angle_rad=angle,
        tangent=tangent,
        position=-1j + integrate_from_zero(tangent),
    )


def _closed(orders: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return curvature orders with the order 1 that closes the belt, and the direction of the tangent."""
    closed = orders.copy()
    angle = closed @ _SINES.T
    for _ in range(_CLOSURE_STEPS):
        gap = np.cos(angle) @ TRAPEZOID
        slope = np.sin(angle) @ _CLOSING
        change = gap / slope
        closed[:, 1] += change
        angle += change[:, np.newaxis] * _SINES[:, 1]
    return closed, angle


def gravity_orders(orders: FloatArray) -> FloatArray:
    """Return the cosine orders of gravity along the normal of a belt over g, (b, MAX_ORDER + 1).

    A sensor on the belt reads g cos(psi), psi being the angle of the normal from the vertical.

    Args:
        orders: (b, MAX_ORDER + 1) cosine orders of the curvature, as for `belt_shape`.
    """
    _, angle = _closed(orders)
    result: FloatArray = np.cos(angle) @ _ANALYSIS
    return result


def integrate_from_zero(values: ComplexArray) -> ComplexArray:
    """Return the integral from theta = 0 of mirror-symmetric fields, (..., m); exact if band-limited.

    The x component must be even and the y component odd about theta = 0 and pi, like the tangent. For fields of the
    opposite symmetry, such as forces, integrate -1j times the field and multiply by 1j.
    """
    # Such a field has a real spectrum. Its mean has an x component only and integrates to a ramp.
    spectrum = np.fft.hfft(values, axis=-1)
    mean = spectrum[..., :1] / (2 * HALF_STEPS)
    integral = -1j * np.fft.ihfft(spectrum * _INVERSE, axis=-1)
    result: ComplexArray = integral - integral[..., :1] + mean * ANGLES_RAD
    return result
