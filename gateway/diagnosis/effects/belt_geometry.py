"""Geometry and kinematics of the belt's shape: curvature, inclination, gravity, spin, inertia, sensor offset."""

import math
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.diagnosis.effects.effect import CIRCUMFERENTIAL, FIELD_SIZE, RADIAL, ModelledBlock

# Highest order of a derivative. Higher ones are not compared, and the solver's grid makes the highest.
SLOPE_ORDERS: Final = 160
_MIDDLE: Final = FIELD_SIZE // 2
# Circumferential shape over the radius below which it is numeric error or belt extension, not a sensor offset: an
# offset of 0.1 mm makes more.
_OFFSET_VISIBLE_SHARE: Final = 2e-3
# Each step takes 2 e kappa, a tenth, of the error of a curvature away.
_DEPTH_STEPS: Final = 6
_ORDER: Final[FloatArray] = np.arange(FIELD_SIZE // 2 + 1, dtype=np.float64)
_SLOPE: Final[ComplexArray] = np.where(_ORDER <= SLOPE_ORDERS, 1j * _ORDER, 0.0)
_INTEGRAL: Final[ComplexArray] = np.divide(1.0, 1j * _ORDER, out=np.zeros(len(_ORDER), complex), where=_ORDER > 0.0)
# Angle turned since the middle of a revolution, which runs from contact centre to contact centre.
_FROM_MIDDLE_RAD: Final[FloatArray] = np.roll(
    -math.pi + 2.0 * math.pi / FIELD_SIZE * np.arange(FIELD_SIZE), FIELD_SIZE // 2
)


def slopes(curves: FloatArray, count: int = 1) -> FloatArray:
    """Return the first `count` angle derivatives of periodic curves (..., FIELD_SIZE), (count, ..., FIELD_SIZE).

    Orders above SLOPE_ORDERS are left out.
    """
    spectrum = np.fft.rfft(curves, axis=-1)
    powers = _SLOPE ** np.arange(1, count + 1)[(...,) + (None,) * curves.ndim]
    result: FloatArray = np.fft.irfft(spectrum * powers, n=FIELD_SIZE, axis=-1)
    return result


def closed_shape(block: ModelledBlock) -> FloatArray:
    """Return the radial shape with the mean of a closed belt, R; some models leave their mean out."""
    radial = block.shape.radial_m
    return radial + (block.conditions.radius_m - float(radial.mean()))


def inclination(block: ModelledBlock) -> FloatArray:
    """Return the belt angle psi, the integral of kappa R from the contact centre, where the belt lies flat.

    kappa R is the radial shape over R. A circle has psi = theta; in the contact psi stays at 0.
    """
    deviation = np.fft.rfft(closed_shape(block) / block.conditions.radius_m)
    integral = np.fft.irfft(deviation * _INTEGRAL, n=FIELD_SIZE)
    result: FloatArray = block.theta_rad + (integral - integral[_MIDDLE])
    return result


def relative_curvature(block: ModelledBlock) -> FloatArray:
    """Return R kappa of the belt's neutral layer, (FIELD_SIZE,); its mean is 1.

    A sensor at depth e reads V^2 kappa (1 - e kappa) instead. A model with gravity has solved for the belt's direction
    psi, whose derivative by theta it is, whatever the depth; for others the depth comes from `relative_offset`.
    """
    if block.shape.gravity_radial.any():
        return _direction_slope(gravity_projections(block).tobytes(), block.theta_rad.tobytes())
    return _curvature_above(block, relative_offset(block))


@lru_cache(maxsize=64)
def _direction_slope(up: bytes, theta_rad: bytes) -> FloatArray:
    """Return the derivative of the direction of (sine, cosine) by theta, not writable, for it is shared."""
    sine, cosine = np.frombuffer(up).reshape(2, -1)
    deviation_rad = np.arctan2(sine, cosine) - np.frombuffer(theta_rad)
    # Both angles grow by a turn; their difference is far below half of one.
    deviation_rad = np.mod(deviation_rad + math.pi, 2.0 * math.pi) - math.pi
    result: FloatArray = 1.0 + slopes(deviation_rad)[0]
    result.setflags(write=False)
    return result


def _curvature_above(block: ModelledBlock, offset: float) -> FloatArray:
    """Return R kappa from the radial axis of a sensor at a depth e / R; its mean may be missing."""
    level = block.shape.radial_m / block.conditions.radius_m
    level = level - level.mean()
    curvature: FloatArray = 1.0 + level
    for _ in range(_DEPTH_STEPS if offset else 0):
        square = np.square(curvature)
        curvature = 1.0 + level + offset * (square - square.mean())
    return curvature


def gravity_projections(block: ModelledBlock) -> FloatArray:
    """Return the share of an upward acceleration on the circumferential and the radial axis, (2, FIELD_SIZE).

    A model with gravity has solved for them; otherwise they are sin psi and cos psi.
    """
    if block.shape.gravity_radial.any():
        return np.stack([block.shape.gravity_circumferential, block.shape.gravity_radial])
    psi = inclination(block)
    return np.stack([np.sin(psi), np.cos(psi)])


def spin_projections(block: ModelledBlock) -> FloatArray:
    """Return the reaction to angular acceleration on the circumferential and the radial axis, m, (2, FIELD_SIZE).

    The belt's points gain speed along the belt and the axle gains speed forward: R (1 - cos psi) and R sin psi.
    """
    if block.shape.spin_circumferential_m.any():
        return np.stack([block.shape.spin_circumferential_m, block.shape.spin_radial_m])
    psi = inclination(block)
    radius = block.conditions.radius_m
    return np.stack([radius * (1.0 - np.cos(psi)), radius * np.sin(psi)])


def from_mid_revolution(theta_rad: FloatArray) -> FloatArray:
    """Return the angle rolled since mid revolution, -pi to pi.

    A revolution runs from one contact centre to the next: theta in [0, pi) is its first half, [-pi, 0) its second.
    The jump is at the contact centre.
    """
    return np.where(theta_rad >= 0.0, theta_rad - math.pi, theta_rad + math.pi)


def belt_inertia(block: ModelledBlock) -> FloatArray:
    """Return the signal of the ring's motion without gravity, (3, FIELD_SIZE) m/s^2, angular acceleration included."""
    conditions, shape = block.conditions, block.shape
    square = conditions.omega_radps**2 + 2.0 * conditions.omega_dot_radps2 * _FROM_MIDDLE_RAD
    inertia = block.zeros()
    inertia[CIRCUMFERENTIAL] = (
        square * shape.circumferential_m + conditions.omega_dot_radps2 * shape.spin_circumferential_m
    )
    inertia[RADIAL] = square * shape.radial_m + conditions.omega_dot_radps2 * shape.spin_radial_m
    return inertia


def relative_offset(block: ModelledBlock) -> float:
    """Return e / R of a sensor below the neutral layer, estimated from the model's circumferential axis.

    That axis is -(e / R) d(V^2 kappa) / dtheta, the radial one V^2 kappa (1 - e kappa). 0 for a model without offset.
    """
    tangential_m = block.shape.circumferential_m
    if float(np.abs(tangential_m).max()) < _OFFSET_VISIBLE_SHARE * block.conditions.radius_m:
        return 0.0
    if block.shape.gravity_radial.any():
        up = gravity_projections(block)
        return _depth_of(up.tobytes(), block.theta_rad.tobytes(), tangential_m.tobytes(), block.conditions.radius_m)
    offset = 0.0
    for _ in range(_DEPTH_STEPS):
        offset = _depth(tangential_m, block.conditions.radius_m * _curvature_above(block, offset))
    return offset


@lru_cache(maxsize=64)
def _depth_of(up: bytes, theta_rad: bytes, tangential_m: bytes, radius_m: float) -> float:
    """Return e / R by the direction of (sine, cosine), which a model has solved for."""
    return _depth(np.frombuffer(tangential_m), radius_m * _direction_slope(up, theta_rad))


def _depth(tangential_m: FloatArray, curvature_m: FloatArray) -> float:
    """Return e / R by which the circumferential shape is minus the slope of the curvature times R^2; 0 without one."""
    slope = slopes(curvature_m)[0]
    power = float(slope @ slope)
    return -float(tangential_m @ slope) / power if power > 0.0 else 0.0
