"""Rows of the exact balance of a rolling belt, linear in the four numbers.

They state the virtual work of a geometrically exact belt on an elastic sidewall, for virtual rotations phi of its
tangent that vanish in the contact (docs/explanation/estimators.md has the derivation). Such a motion neither stretches
the belt nor moves it on the road, so tension, belt inertia, contact pressure, contact shear and tread drop out. Over p0
R^2:

    Bs int (psi' - 1) phi' - int n . (F - tension x) phi = 0,  F(theta) = - int_theta^pi f,
    f = -Cw n_out + Rs u_r e_r + Ts u_t e_t

The tension is that of the belt at theta = pi; it keeps the belt closed. One more row, the vertical balance, contains
the load: 2 int_0^pi f . y = Q / (p0 R^2). All is per waveform, on the half circle of `belt_shape`. u contains the
deflection y0 of the belt in the contact, in which the rows are linear as well.

Unknowns, in this order everywhere: Bs, Cw, Rs, Ts, tension / (p0 R^2), y0 / R. None of them can be negative.
"""

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple, TypeVar

import numpy as np

from gateway.core.compiled import core
from gateway.core.revolutions.order_spectrum import ORDER_COUNT
from gateway.core.types import ComplexArray, FloatArray
from gateway.ring.belt_shape import (
    ALONG,
    ANGLES_RAD,
    COSINES,
    HALF_STEPS,
    RADIAL,
    STEP_RAD,
    TRAPEZOID,
    BeltShape,
    integrate_from_zero,
)

# Virtual rotations sin(j pi (theta - theta_c) / (pi - theta_c)), j = 1 to ROWS: orders up to about 35. The numbers need
# two thirds of them; the others show waves that are not the belt's shape, of order 30 on real tires.
ROWS: Final = 32
# Distance of the virtual motion from the contact edge, which is known to some milliradians only.
CLEARANCE_RAD: Final = 0.02
UNKNOWNS: Final = 6
# The covariance of the rows is computed on every second grid point and from orders up to 60.
STRIDE: Final = 2
SENSITIVE_ORDERS: Final = ORDER_COUNT
_COARSE_COSINES: Final[FloatArray] = COSINES[::STRIDE, :SENSITIVE_ORDERS] * (STRIDE * TRAPEZOID[::STRIDE, np.newaxis])

_Values = TypeVar("_Values", FloatArray, ComplexArray)


class VirtualMotion(NamedTuple):
    """Virtual rotations on the free part of the half circle, first point `begin`.

    Attributes:
        begin: index of theta_c on the half circle.
        rotation: (ROWS, m) phi.
        slope: (ROWS, m) its derivative.
        weights: (m,) Simpson's rule.
        bending: (ROWS, SENSITIVE_ORDERS) derivative of the bending's rows over Bs by the orders of the curvature.
    """

    begin: int
    rotation: FloatArray
    slope: FloatArray
    weights: FloatArray
    bending: FloatArray


@lru_cache(maxsize=64)
def virtual_motion(begin: int) -> VirtualMotion:
    """Return the virtual rotations that begin at grid index `begin`; HALF_STEPS - begin must be even."""
    angle = ANGLES_RAD[begin:] - ANGLES_RAD[begin]
    order = np.arange(1, ROWS + 1)[:, np.newaxis] * (math.pi / angle[-1])
    weights = np.full(len(angle), 2.0 * STEP_RAD / 3.0)
    weights[1::2] *= 2.0
    weights[[0, -1]] *= 0.5
    slope = order * np.cos(order * angle)
    bending = slope[:, ::STRIDE] @ _COARSE_COSINES[begin // STRIDE :]
    return VirtualMotion(begin, np.sin(order * angle), slope, weights, bending)


def motion_begin(half_angle_rad: float) -> int:
    """Return the grid index at which the virtual motion begins for a contact half angle."""
    begin = math.ceil((half_angle_rad + CLEARANCE_RAD) / STEP_RAD)
    return begin + (HALF_STEPS - begin) % 2


@dataclass(frozen=True, slots=True)
class BalanceRows:
    """Rows of the balance of each waveform: constant @ numbers + y0 * rise @ numbers.

    Attributes:
        shape: the belts.
        motion: the virtual motion.
        constant: (b, ROWS + 1, 5) factors of Bs, Cw, Rs, Ts, tension; the last row is the vertical balance.
        rise: (b, ROWS + 1, 5) their change per deflection y0 / R.
        forces: (b, 3, m) F of Cw, Rs and Ts on the half circle, without deflection.
    """

    shape: BeltShape
    motion: VirtualMotion
    constant: FloatArray
    rise: FloatArray
    forces: ComplexArray


def balance_rows(shape: BeltShape, begin: int) -> BalanceRows:
    """Return the rows of belts (b waveforms) for a virtual motion that begins at `begin`."""
    motion = virtual_motion(begin)
    count = len(shape.orders)
    normal = 1j * shape.tangent
    displacement = shape.position - RADIAL
    radial_pull = dot(displacement, RADIAL) * RADIAL
    pulls = np.stack([radial_pull, displacement - radial_pull], axis=1)
    forces = np.empty((count, 3, HALF_STEPS + 1), dtype=np.complex128)
    # Pressure: f = n = 1j times the tangent, whose integral the position is.
    forces[:, 0] = 1j * (shape.position - shape.position[:, -1:])
    integral = 1j * integrate_from_zero(-1j * pulls)
    forces[:, 1:] = integral - integral[..., -1:]
    free_range = slice(begin, None)
    # Integrands of phi: F . n of Cw, Rs, Ts, tension, and of Rs, Ts per deflection.
    integrands = np.empty((count, 6, len(motion.weights)))
    integrands[:, :3] = dot(forces[..., free_range], normal[:, np.newaxis, free_range])
    integrands[:, 3] = -normal.real[:, free_range]
    integrands[:, 4:] = dot(_RISE_FORCES[:, free_range], normal[:, np.newaxis, free_range])
    by_rotation = (integrands * motion.weights) @ motion.rotation.T
    bend = ((shape.curvature[:, free_range] - 1.0) * motion.weights) @ motion.slope.T
    constant = np.zeros((count, ROWS + 1, 5))
    rise = np.zeros((count, ROWS + 1, 5))
    constant[:, :ROWS, 0] = bend
    constant[:, :ROWS, 1:] = -by_rotation[:, :4].transpose(0, 2, 1)
    rise[:, :ROWS, 2:4] = -by_rotation[:, 4:].transpose(0, 2, 1)
    constant[:, ROWS, 2:4] = 2.0 * pulls.imag @ TRAPEZOID
    rise[:, ROWS, 2:4] = 2.0 * _RISE_PULLS.imag @ TRAPEZOID
    return BalanceRows(shape, motion, constant, rise, forces)


def row_sensitivity(rows: BalanceRows, unknowns: FloatArray) -> FloatArray:
    """Return the derivative of the rows at `unknowns` (b, 6) by the cosine orders of the relative signal.

    It is the adjoint of curvature -> angle -> position -> balance, including the closure of the belt and the
    calibration by the mean.

    Returns:
        (b, ROWS + 1, SENSITIVE_ORDERS); column 0 is the derivative by the relative error of the mean.
    """
    shape, motion = rows.shape, rows.motion
    coarse = slice(None, None, STRIDE)
    rotation = motion.rotation[:, coarse]
    bs, cw, rs, ts, tension, deflection = unknowns.T[:, :, np.newaxis]
    tangent = shape.tangent[:, coarse]
    force = cw * rows.forces[:, 0, coarse] + rs * rows.forces[:, 1, coarse] + ts * rows.forces[:, 2, coarse] - tension
    force += deflection * (rs * _RISE_FORCES[0, coarse] + ts * _RISE_FORCES[1, coarse])
    axial = dot(tangent, force)
    by_angle = np.empty((len(tangent), ROWS + 1, tangent.shape[1]))
    for index, row in enumerate(by_angle):
        by_angle_of(tangent[index], axial[index], rotation, unknowns[index, 1:4], row)
    bs = bs[..., np.newaxis]
    by_order: FloatArray = by_angle @ _COARSE_REMAINING
    by_order[:, :ROWS] += bs * motion.bending
    closing = np.sin(shape.angle_rad[:, coarse]) @ _COARSE_REMAINING
    by_order -= by_order[:, :, 1:2] * (closing / closing[:, 1:2])[:, np.newaxis, :]
    by_order[:, :, 1] = 0.0
    by_order[:, :, 0] = -(by_order[:, :, 2:] @ shape.orders[:, 2:SENSITIVE_ORDERS, np.newaxis])[..., 0]
    return by_order


def _by_angle_by_numpy(
    tangent: ComplexArray, axial: FloatArray, rotation: FloatArray, numbers: FloatArray, out: FloatArray
) -> None:
    """Set the derivative of the rows of one belt by the angle of its tangent, (ROWS + 1, m), on the coarse grid.

    Args:
        tangent: (m,) of the belt.
        axial: (m,) force along it.
        rotation: (ROWS, f) virtual rotations at the last f points, 0 before.
        numbers: (3,) Cw, Rs, Ts.
        out: the result.
    """
    cw, rs, ts = numbers
    free_range, rim_tangent = slice(len(tangent) - rotation.shape[1], None), ALONG[::STRIDE]
    # Virtual displacement int n phi, 0 in the contact; the last row's is vertical.
    displacement = np.zeros(out.shape, dtype=np.complex128)
    displacement[:ROWS, free_range] = _running(1j * tangent[free_range] * rotation)
    displacement[ROWS] = 2.0j
    # Derivative by the angle: the belt beyond the point moves along its normal, which changes the work of the sidewall,
    conjugate = tangent.conj()
    radial = (rs - ts) * (rim_tangent * displacement.conj()).imag
    out[:] = (conjugate * _remaining(ts * displacement - radial * (1j * rim_tangent))).imag
    # and pressure and axial force rotate.
    out[:ROWS] -= cw * (conjugate * displacement[:ROWS]).real
    out[:ROWS, free_range] += axial[free_range] * rotation


def _by_angle_by_core(
    tangent: ComplexArray, axial: FloatArray, rotation: FloatArray, numbers: FloatArray, out: FloatArray
) -> None:
    """As `_by_angle_by_numpy`."""
    assert core is not None
    belt = np.ascontiguousarray(tangent).view(np.float64)
    contiguous = np.ascontiguousarray(rotation), np.ascontiguousarray(numbers)
    core.row_sensitivity(belt, _COARSE_ALONG, axial, *contiguous, STRIDE * STEP_RAD, np.empty(len(belt)), out)


by_angle_of = _by_angle_by_numpy if core is None else _by_angle_by_core


def dot(first: ComplexArray, second: ComplexArray) -> FloatArray:
    """Return the scalar product of plane vectors."""
    product: FloatArray = first.real * second.real + first.imag * second.imag
    return product


def _running(values: _Values) -> _Values:
    """Return the trapezoidal integral from the first point of the coarse grid."""
    total: _Values = np.cumsum(values, axis=-1)
    half = 0.5 * values
    total -= half
    total -= half[..., :1]
    total *= STRIDE * STEP_RAD
    return total


def _remaining(values: _Values) -> _Values:
    """Return the trapezoidal integral from each point of the coarse grid to the last."""
    total = _running(values)
    return total[..., -1:] - total


# From the derivative by the angle, on the coarse grid, to that by the orders of the curvature, its integral.
_COARSE_REMAINING: Final[FloatArray] = _remaining(np.eye(len(_COARSE_COSINES))) @ _COARSE_COSINES
_COARSE_ALONG: Final[FloatArray] = ALONG[::STRIDE].copy().view(np.float64)
_RISE_PULLS: Final[ComplexArray] = np.stack([RADIAL.imag * RADIAL, ALONG.imag * ALONG])


def _rise_forces() -> ComplexArray:
    integral = 1j * integrate_from_zero(-1j * _RISE_PULLS)
    forces: ComplexArray = integral - integral[..., -1:]
    return forces


_RISE_FORCES: Final[ComplexArray] = _rise_forces()
