"""Rows of the exact balance of a rolling belt that is driven, braked or damped, and the forces that its rim carries.

As in `weak_form_rows`, virtual rotations phi that vanish in the contact leave out contact pressure, contact shear and
tread. Here they run over the whole free belt, and the belt need not be symmetric (docs/explanation/forces.md has the
derivation). Over p0 R^2, with n = i t the inward normal:

    int (Bs (kappa R - 1) + Eta (kappa R)') phi' - int n . F phi = 0,  F(theta) = F_pi + int_theta^pi f,
    f = Cw n_out - (Rs u_r + d u_r') e_r - (Ts u_t + d u_t') e_t

The curvature gives the belt's shape, but neither its place on the rim nor its turn against it, so u contains three
unknown motions: up y0, along the road x0, and a turn chi. The sidewall carries every force between belt and rim. So
the balance of the whole belt gives load, longitudinal force and axle torque from u alone.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.forces.asymmetric_belt import (
    ALONG,
    ANGLES_RAD,
    RADIAL,
    STEP_RAD,
    STEPS,
    AsymmetricShape,
    derivative,
    integral,
)
from gateway.ring.weak_form_rows import dot

# Virtual rotations sin(j pi (theta - theta_b) / (theta_e - theta_b)), j = 1 to ROWS: twice those of the half circle.
ROWS: Final = 64
# Distance of the virtual motion from the contact edge, as in `weak_form_rows`.
CLEARANCE_RAD: Final = 0.02


class U(IntEnum):
    """Unknowns: numbers at load number 1, F_pi, motions over R, dampings."""

    BS = 0
    CW = 1
    RS = 2
    TS = 3
    TENSION = 4
    SHEAR = 5
    RISE = 6
    ADVANCE = 7
    TURN = 8
    DAMPING = 9
    BENDING_DAMPING = 10


class Force(IntEnum):
    """Forces of a belt over p0 R^2, torque over p0 R^3, loss as power over p0 R^2 and belt speed."""

    LOAD = 0
    LONGITUDINAL = 1
    TORQUE = 2
    LOSS = 3


class FreeMotion(NamedTuple):
    """Virtual rotations on the free belt, grid points `begin` to STEPS - `begin`.

    Attributes:
        begin: first grid point.
        rotation: (ROWS, STEPS) phi times the weights of Simpson's rule, 0 in the contact.
        slope: (ROWS, STEPS) likewise its derivative.
    """

    begin: int
    rotation: FloatArray
    slope: FloatArray


@lru_cache(maxsize=64)
def free_motion(begin: int) -> FreeMotion:
    """Return the virtual rotations that begin at grid point `begin`."""
    free_range = slice(begin, STEPS - begin + 1)
    angle = ANGLES_RAD[free_range] - ANGLES_RAD[begin]
    order = np.arange(1, ROWS + 1)[:, np.newaxis] * (math.pi / angle[-1])
    weights = np.full(len(angle), 2.0 * STEP_RAD / 3.0)
    weights[1::2] *= 2.0
    weights[[0, -1]] *= 0.5
    rotation, slope = np.zeros((2, ROWS, STEPS))
    rotation[:, free_range] = np.sin(order * angle) * weights
    slope[:, free_range] = order * np.cos(order * angle) * weights
    return FreeMotion(begin, rotation, slope)


def free_begin(half_angle_rad: float) -> int:
    """Return the grid point at which the virtual motion begins for a contact half angle."""
    return math.ceil((half_angle_rad + CLEARANCE_RAD) / STEP_RAD)


@dataclass(frozen=True, slots=True)
class AsymmetricRows:
    """Rows and forces of one belt at one vector of unknowns.

    Attributes:
        balance: (ROWS,) the rows, 0 in balance.
        forces: (4,) as `Force`.
        by_unknown: (ROWS, 11) derivative of the rows.
        forces_by_unknown: (4, 11) derivative of the forces.
    """

    balance: FloatArray
    forces: FloatArray
    by_unknown: FloatArray
    forces_by_unknown: FloatArray


def asymmetric_rows(shape: AsymmetricShape, motion: FreeMotion, unknowns: FloatArray) -> AsymmetricRows:
    """Return the rows of a belt at `unknowns` (11,), in the order of `U`."""
    tangent = shape.tangent
    normal = 1j * tangent
    position = shape.position + unknowns[U.ADVANCE] + 1j * unknowns[U.RISE]
    rotation = np.exp(-1j * unknowns[U.TURN])
    out, rim_tangent = RADIAL * rotation, ALONG * rotation
    radial, tangential = dot(position, out) - 1.0, dot(position, rim_tangent)
    # Displacements by the three motions, radial and tangential, and themselves: (4, STEPS).
    turn_radial, turn_tangential = -dot(position, rim_tangent), dot(position, out)
    shifts_radial = np.stack([radial, out.imag, out.real, turn_radial])
    shifts_tangential = np.stack([tangential, rim_tangent.imag, rim_tangent.real, turn_tangential])
    rates_radial, rates_tangential = derivative(shifts_radial), derivative(shifts_tangential)
    rs, ts, damping = unknowns[U.RS], unknowns[U.TS], unknowns[U.DAMPING]
    pulls_radial = rs * shifts_radial + damping * rates_radial
    pulls_tangential = ts * shifts_tangential + damping * rates_tangential
    pulls = -(pulls_radial * out + pulls_tangential * rim_tangent)
    # The turn also rotates the directions in which the sidewall pulls.
    pulls[3] -= pulls_tangential[0] * out - pulls_radial[0] * rim_tangent
    by_stiffness = np.stack(
        [-radial * out, -tangential * rim_tangent, -(rates_radial[0] * out + rates_tangential[0] * rim_tangent)]
    )
    # Loads per unit of pressure, Rs, Ts, d, then per unit of y0, x0, chi.
    loads = np.concatenate([(-1j * tangent)[np.newaxis], by_stiffness, pulls[1:]])
    load_integrals = integral(loads)
    sections = load_integrals[:, STEPS // 2, np.newaxis] - load_integrals
    shear_work = dot(sections, normal) @ motion.rotation.T
    by_unknown = np.empty((ROWS, len(U)))
    by_unknown[:, U.BS] = motion.slope @ (shape.curvature - 1.0)
    by_unknown[:, U.BENDING_DAMPING] = motion.slope @ shape.bend_rate
    by_unknown[:, [U.CW, U.RS, U.TS, U.DAMPING, U.RISE, U.ADVANCE, U.TURN]] = -shear_work.T
    by_unknown[:, U.TENSION] = motion.rotation @ normal.real
    by_unknown[:, U.SHEAR] = -motion.rotation @ normal.imag
    linear = [U.BS, U.CW, U.RS, U.TS, U.TENSION, U.SHEAR, U.DAMPING, U.BENDING_DAMPING]
    forces = np.zeros(len(Force))
    forces_by_unknown = np.zeros((len(Force), len(U)))
    side = pulls[0]
    totals, torques = _totals(position, side[np.newaxis])
    forces[: Force.LOSS] = -totals[0].imag, totals[0].real, torques[0]
    columns = [U.RS, U.TS, U.DAMPING, U.RISE, U.ADVANCE, U.TURN]
    totals, torques = _totals(position, np.concatenate([by_stiffness, pulls[1:]]))
    # A shift of the belt also changes the lever of the sidewall's pull.
    lever = np.array([0.0, 0.0, 0.0, *_levers(side)])
    forces_by_unknown[: Force.LOSS, columns] = -totals.imag, totals.real, torques + lever
    rates = rates_radial[0] ** 2 + rates_tangential[0] ** 2
    bends = np.square(shape.bend_rate)
    per_damping, per_bending = STEP_RAD * float(rates.sum()), STEP_RAD * float(bends.sum())
    forces[Force.LOSS] = damping * per_damping + unknowns[U.BENDING_DAMPING] * per_bending
    forces_by_unknown[Force.LOSS, [U.DAMPING, U.BENDING_DAMPING]] = per_damping, per_bending
    shifting = rates_radial[0] * rates_radial[1:] + rates_tangential[0] * rates_tangential[1:]
    forces_by_unknown[Force.LOSS, [U.RISE, U.ADVANCE, U.TURN]] = 2.0 * damping * STEP_RAD * shifting.sum(axis=1)
    return AsymmetricRows(by_unknown[:, linear] @ unknowns[linear], forces, by_unknown, forces_by_unknown)


def row_sensitivity(shape: AsymmetricShape, motion: FreeMotion, unknowns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the derivatives of rows (ROWS, 2 MAX_ORDER) and forces (4, 2 MAX_ORDER) by the orders of the curvature.

    The adjoint of curvature -> angle -> position -> balance, closure included. Damping of the sidewall is left out: it
    changes the derivative, which only weights and follows small changes, by about a hundredth.
    """
    tangent = shape.tangent
    normal = 1j * tangent
    position = shape.position + unknowns[U.ADVANCE] + 1j * unknowns[U.RISE]
    rotation = np.exp(-1j * unknowns[U.TURN])
    out, rim_tangent = RADIAL * rotation, ALONG * rotation
    cw, rs, ts = unknowns[U.CW], unknowns[U.RS], unknowns[U.TS]

    def stiffened(field: ComplexArray) -> ComplexArray:
        restoring: ComplexArray = -(rs * dot(field, out) * out + ts * dot(field, rim_tangent) * rim_tangent)
        return restoring

    side = -(rs * (dot(position, out) - 1.0) * out + ts * dot(position, rim_tangent) * rim_tangent)
    load_integral = integral(-1j * cw * tangent + side)
    section = -unknowns[U.TENSION] + 1j * unknowns[U.SHEAR] + load_integral[STEPS // 2] - load_integral
    # Virtual displacement, from the first edge up to theta = pi and from the last edge down to it.
    steps = motion.rotation * normal
    virtual = np.cumsum(steps, axis=1) - 0.5 * steps
    totals = steps.sum(axis=1, keepdims=True)
    virtual[:, STEPS // 2 :] -= totals
    virtual[:, STEPS // 2] += 0.5 * totals[:, 0]
    by_angle = motion.rotation * dot(section, tangent)
    by_angle -= STEP_RAD * (cw * dot(tangent, virtual) + dot(normal, _remaining(stiffened(virtual))))
    bends = unknowns[U.BS] * shape.bends + unknowns[U.BENDING_DAMPING] * shape.bend_rates
    rows = motion.slope @ bends.T + by_angle @ shape.turns.T
    unit = np.ones(STEPS, dtype=np.complex128)
    levers = -1j * side + stiffened(1j * position)
    moving = np.stack([-stiffened(1j * unit), stiffened(unit), levers])
    forces = np.zeros((len(Force), shape.turns.shape[0]))
    forces[: Force.LOSS] = STEP_RAD * dot(normal, _remaining(moving)) @ shape.turns.T
    # Loss: rates of the displacement that the change of the tangent's angle makes.
    damping, bending = unknowns[U.DAMPING], unknowns[U.BENDING_DAMPING]
    rate_radial = derivative(dot(position, out))
    rate_tangential = derivative(dot(position, rim_tangent))
    loss_gradient = -(derivative(rate_radial) * out + derivative(rate_tangential) * rim_tangent)
    loss = 2.0 * damping * STEP_RAD * dot(normal, _remaining(loss_gradient[np.newaxis])) @ shape.turns.T
    bend = -2.0 * bending * STEP_RAD * derivative(shape.bend_rate) @ shape.bends.T
    forces[Force.LOSS] = loss[0] + bend
    return rows, forces


def _remaining(values: ComplexArray) -> ComplexArray:
    """Return the integral from each grid point to the end of the circle, (k, STEPS), by the trapezoidal rule."""
    tail_sums = np.cumsum(values[:, ::-1], axis=1)[:, ::-1]
    result: ComplexArray = STEP_RAD * (tail_sums - 0.5 * values)
    return result


def _totals(position: ComplexArray, pulls: ComplexArray) -> tuple[ComplexArray, FloatArray]:
    """Return the sums of pulls (k, STEPS) on the belt, and their moments about the axle."""
    moments = (position.real * pulls.imag - position.imag * pulls.real).sum(axis=1)
    return STEP_RAD * pulls.sum(axis=1), STEP_RAD * moments


def _levers(side: ComplexArray) -> tuple[float, float, float]:
    """Return the moments that a pull gains by the belt's rise, advance and turn."""
    total = STEP_RAD * complex(side.sum())
    return -total.real, total.imag, 0.0
