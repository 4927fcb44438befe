"""What a belt's shape says beyond its curvature: inclination, projections of gravity, spin, slope, sensor's offset."""

from __future__ import annotations

import math
from typing import Final

import numpy as np

from gateway.closure.effects.base import FIELD_SIZE, Here
from gateway.types import ComplexArray, FloatArray

# Orders above it are not compared, and a solver's grid makes the highest ones; derivatives leave them out.
SLOPE_ORDERS: Final = 160
_MIDDLE: Final = FIELD_SIZE // 2
# Share of the radius below which the circumferential shape is the solver's, or a stretching belt's, and no offset's: a
# tenth of a millimetre of offset makes more.
_SEEN: Final = 2e-3
_ORDER: Final[FloatArray] = np.arange(FIELD_SIZE // 2 + 1, dtype=np.float64)
_SLOPE: Final[ComplexArray] = np.where(_ORDER <= SLOPE_ORDERS, 1j * _ORDER, 0.0)
_INTEGRAL: Final[ComplexArray] = np.divide(1.0, 1j * _ORDER, out=np.zeros(len(_ORDER), complex), where=_ORDER > 0.0)


def slopes(curves: FloatArray, count: int = 1) -> FloatArray:
    """Return the first `count` derivatives by the angle of periodic curves (..., FIELD_SIZE), (count, ..., FIELD_SIZE).

    Orders above SLOPE_ORDERS are left out.
    """
    spectrum = np.fft.rfft(curves, axis=-1)
    powers = _SLOPE ** np.arange(1, count + 1)[(...,) + (None,) * curves.ndim]
    result: FloatArray = np.fft.irfft(spectrum * powers, n=FIELD_SIZE, axis=-1)
    return result


def without_low_orders(curves: FloatArray) -> FloatArray:
    """Return curves (..., FIELD_SIZE) less their orders 0 and 1, which the curvature of a closed belt lacks."""
    spectrum = np.fft.rfft(curves, axis=-1)
    spectrum[..., :2] = 0.0
    result: FloatArray = np.fft.irfft(spectrum, n=FIELD_SIZE, axis=-1)
    return result


def closed_shape(here: Here) -> FloatArray:
    """Return the radial shape with the mean that a closed belt has, R; a model may leave its mean out."""
    radial = here.shape.radial_m
    return radial + (here.conditions.radius_m - float(radial.mean()))


def inclination(here: Here) -> FloatArray:
    """Return the belt's own angle psi: the integral of kappa R from the contact's centre, where the belt lies flat.

    kappa R is the radial shape over R. A circle has psi = theta; in the contact psi stays at 0.
    """
    deviation = np.fft.rfft(closed_shape(here) / here.conditions.radius_m)
    bend = np.fft.irfft(deviation * _INTEGRAL, n=FIELD_SIZE)
    result: FloatArray = here.theta_rad + (bend - bend[_MIDDLE])
    return result


def gravity_projections(here: Here) -> FloatArray:
    """Return what of an upward acceleration the circumferential and the radial axis feel, (2, FIELD_SIZE).

    A model with gravity has solved for them; otherwise sin psi and cos psi.
    """
    if here.shape.gravity_radial.any():
        return np.stack([here.shape.gravity_circumferential, here.shape.gravity_radial])
    psi = inclination(here)
    return np.stack([np.sin(psi), np.cos(psi)])


def spin_projections(here: Here) -> FloatArray:
    """Return the reaction to angular acceleration on the circumferential and the radial axis, m, (2, FIELD_SIZE).

    The belt's points gain speed along the belt and the axle forwards: R (1 - cos psi) and R sin psi.
    """
    if here.shape.spin_circumferential_m.any():
        return np.stack([here.shape.spin_circumferential_m, here.shape.spin_radial_m])
    psi = inclination(here)
    radius = here.conditions.radius_m
    return np.stack([radius * (1.0 - np.cos(psi)), radius * np.sin(psi)])


def from_mid_revolution(theta_rad: FloatArray) -> FloatArray:
    """Return the angle rolled since mid revolution, -pi to pi.

    A revolution runs from one contact's centre to the next: theta in [0, pi) is its first half, [-pi, 0) its second.
    The jump is at the contact's centre.
    """
    return np.where(theta_rad >= 0.0, theta_rad - math.pi, theta_rad + math.pi)


def relative_offset(here: Here) -> float:
    """Return e / R of a sensor below the neutral layer, by what the model's circumferential axis shows of it.

    That axis is -(e / R) d(V^2 kappa) / dtheta, the radial one V^2 kappa (1 - e kappa); 0 for a model without.
    """
    along = here.shape.circumferential_m
    if float(np.abs(along).max()) < _SEEN * here.conditions.radius_m:
        return 0.0
    radial, offset = here.shape.radial_m, 0.0
    for _ in range(2):
        slope = slopes(radial + (offset / here.conditions.radius_m) * np.square(radial))[0]
        power = float(slope @ slope)
        if not power > 0.0:
            return 0.0
        offset = -float(along @ slope) / power
    return offset
