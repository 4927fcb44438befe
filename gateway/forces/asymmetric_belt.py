"""Shape of a belt that is not symmetric about its contact, from all orders of the radial signal.

`belt_shape` uses the cosine orders and a half circle. Damping, torque and an asymmetric contact pressure add sine
orders, so this shape runs over the whole circle, theta = 2 pi j / STEPS, j = 0 at the contact centre. Lengths are over
R. Frame: complex numbers x + i y, y up, the axle at 0 before deflection; the belt moves towards +x in the contact.

Orders are given as one vector of 2 MAX_ORDER values: the cosine orders 1 to MAX_ORDER of kappa R, then the sine orders.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray, IntArray
from gateway.ring.belt_shape import MAX_ORDER

STEPS: Final = 512
STEP_RAD: Final = 2.0 * math.pi / STEPS
ANGLES_RAD: Final[FloatArray] = STEP_RAD * np.arange(STEPS, dtype=np.float64)
# Unit vectors of the undeformed belt, outward and along.
RADIAL: Final[ComplexArray] = -1j * np.exp(1j * ANGLES_RAD)
ALONG: Final[ComplexArray] = np.exp(1j * ANGLES_RAD)

_ORDERS: Final[FloatArray] = np.arange(1, MAX_ORDER + 1, dtype=np.float64)
_COSINES: Final[FloatArray] = np.cos(np.multiply.outer(_ORDERS, ANGLES_RAD))
_SINES: Final[FloatArray] = np.sin(np.multiply.outer(_ORDERS, ANGLES_RAD))
WAVES: Final[FloatArray] = np.concatenate([_COSINES, _SINES])
"""(2 MAX_ORDER, STEPS) curvature of a unit of each order."""
# Angle of the tangent of a unit of each order, up to the angle at theta = 0.
_ROTATIONS: Final[FloatArray] = np.concatenate([_SINES / _ORDERS[:, np.newaxis], -_COSINES / _ORDERS[:, np.newaxis]])
_SLOPES: Final[FloatArray] = np.concatenate([-_SINES * _ORDERS[:, np.newaxis], _COSINES * _ORDERS[:, np.newaxis]])
# Places of the cosine and the sine of order 1 among the orders.
_FIRST: Final = (0, MAX_ORDER)
_CLOSURE_STEPS: Final = 4
_OFFSET_STEPS: Final = 4

_FREQUENCIES: Final = np.fft.fftfreq(STEPS, 1.0 / STEPS)
_INVERSE: Final[ComplexArray] = np.zeros(STEPS, dtype=np.complex128)
_INVERSE[1:] = -1j / _FREQUENCIES[1:]
_INVERSE[STEPS // 2] = 0.0
_DERIVATIVE: Final[ComplexArray] = np.asarray(1j * _FREQUENCIES, dtype=np.complex128)
_DERIVATIVE[STEPS // 2] = 0.0


@dataclass(frozen=True, slots=True)
class AsymmetricShape:
    """A closed belt.

    Attributes:
        curvature: (m,) kappa R.
        bend_rate: (m,) its derivative by theta.
        tangent: (m,) complex; horizontal on average in the middle of the contact.
        position: (m,) complex, -i at theta = 0.
        turns: (2 MAX_ORDER, m) change of the tangent's angle per order, the belt remaining closed and level.
        bends: (2 MAX_ORDER, m) likewise change of the curvature.
        bend_rates: (2 MAX_ORDER, m) likewise change of its derivative.
    """

    curvature: FloatArray
    bend_rate: FloatArray
    tangent: ComplexArray
    position: ComplexArray
    turns: FloatArray
    bends: FloatArray
    bend_rates: FloatArray


@lru_cache(maxsize=256)
def level_part(half_width_rad: float) -> IntArray:
    """Return the grid points within an angle of theta = 0, where the belt lies level on the road."""
    reach = int(half_width_rad / STEP_RAD)
    points = np.concatenate([np.arange(reach + 1), np.arange(STEPS - reach, STEPS)])
    points.setflags(write=False)
    return points


def curvature_from_signal(signal: ComplexArray, offset: float) -> FloatArray:
    """Return the orders of kappa R, (2 MAX_ORDER,), from those of the signal.

    The mean of kappa R over a closed belt is 1, which determines the gain. With a sensor below the neutral layer,
    s = g k (1 - offset k) is solved for k and g together.

    Args:
        signal: (MAX_ORDER + 1,) c - i s of the signal; order 0 real and positive.
        offset: e / R.
    """
    relative = signal[1:] / signal[0].real
    orders = np.concatenate([relative.real, -relative.imag])
    if not offset:
        return orders
    measured = 1.0 + orders @ WAVES
    curvature = measured
    for _ in range(_OFFSET_STEPS):
        read = measured * (1.0 - offset * float(np.square(curvature).mean()))
        # The root that tends to `read` as the offset tends to 0; the maximum keeps an impossible peak from being NaN.
        curvature = 2.0 * read / (1.0 + np.sqrt(np.maximum(1.0 - 4.0 * offset * read, 0.0)))
    curvature_orders: FloatArray = WAVES @ curvature * (2.0 / STEPS) / float(curvature.mean())
    return curvature_orders


def asymmetric_shape(orders: FloatArray, level_rad: float) -> AsymmetricShape:
    """Integrate curvature orders (2 MAX_ORDER,) to a closed belt.

    Order 1, cosine and sine, is adjusted until the integral of the tangent over the revolution vanishes.

    Args:
        orders: of kappa R.
        level_rad: angle from the contact centre within which the mean direction of the belt is that of the road.
    """
    closed = orders.copy()
    angle = ANGLES_RAD + closed @ _ROTATIONS
    for _ in range(_CLOSURE_STEPS):
        tangent = np.exp(1j * angle)
        change = np.linalg.solve(_closing(tangent), -_plane(tangent.mean()))
        closed[list(_FIRST)] += change
        angle = angle + change @ _ROTATIONS[list(_FIRST)]
    level = level_part(level_rad)
    whole_turns = np.where(level > STEPS // 2, 2.0 * math.pi, 0.0)
    angle = angle - float((angle[level] - whole_turns).mean())
    tangent = np.exp(1j * angle)
    gap_by_order = _ROTATIONS @ (1j * tangent) / STEPS
    change = -np.linalg.solve(_closing(tangent), np.stack([gap_by_order.real, gap_by_order.imag])).T
    rotations = _ROTATIONS + change @ _ROTATIONS[list(_FIRST)]
    return AsymmetricShape(
        curvature=1.0 + closed @ WAVES,
        bend_rate=closed @ _SLOPES,
        tangent=tangent,
        position=-1j + integral(tangent),
        turns=rotations - rotations[:, level].mean(axis=1, keepdims=True),
        bends=WAVES + change @ WAVES[list(_FIRST)],
        bend_rates=_SLOPES + change @ _SLOPES[list(_FIRST)],
    )


def _closing(tangent: ComplexArray) -> FloatArray:
    """Return the derivative of the mean tangent by the cosine and the sine of order 1, (2, 2)."""
    gap_by_order = _ROTATIONS[list(_FIRST)] @ (1j * tangent) / STEPS
    return np.stack([gap_by_order.real, gap_by_order.imag])


def _plane(value: complex) -> FloatArray:
    return np.array([value.real, value.imag])


def integral(values: ComplexArray) -> ComplexArray:
    """Return the integral from theta = 0 of fields (..., STEPS); exact if they are band-limited."""
    spectrum = np.fft.fft(values, axis=-1)
    mean = spectrum[..., :1] / STEPS
    antiderivative = np.fft.ifft(spectrum * _INVERSE, axis=-1)
    result: ComplexArray = antiderivative - antiderivative[..., :1] + mean * ANGLES_RAD
    return result


def derivative(values: FloatArray) -> FloatArray:
    """Return the derivative by theta of periodic fields (..., STEPS)."""
    result: FloatArray = np.fft.ifft(np.fft.fft(values, axis=-1) * _DERIVATIVE, axis=-1).real
    return result
