"""What a sensor on the rolling ring reads of a change at one place of the belt, the tread or the rim, to first order.

A property that changes at the material angle phi0 from the sensor by W(phi - phi0) is a sum of patterns

    W(phi) = Re sum_N c_N W_N exp(i N phi),  c_0 = 1 / (2 pi),  c_N = 1 / pi,  W_N the transform of W,

each of which passes a point of the road N times a turn. It pushes the nodes of the steadily rolling ring by f exp(i N
theta), f what the change does to the balance of the steady shape, and the ring answers as in `block_vibration`, inertia
and losses included. A rim that is bent moves the axle instead, by z(theta) = H W(theta + phi0): the ring is pressed to
the road by as much, and carries its mass along. A tire that is out of round is pressed to the road likewise, and its
axle keeps its height.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from enum import Flag, StrEnum, auto
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray, FloatArray
from gateway.ring.rolling_ring.block_vibration import LoadedBelt, TreadBlocks, pushed_response
from gateway.ring.rolling_ring.force_balance import edge_tread_npm2, following, preceding, ring_grid, segment_turn

PATTERNS: Final = 129
"""Patterns 0 to 128 of a turn: the highest order that is compared is 109."""

# Share of the critical damping of the belt on its sidewall: tires have 2 to 8 %.
_SIDEWALL_RATIO: Final = 0.04


class Change(StrEnum):
    """Kind of a change; the response is that to a unit of the quantity times its width in radians.

    BENDING: share of EI. KINK: belt's own angle, rad. MASS: share of rho A. SIDEWALL: share of kw and kv. TREAD: height
    of the tread, m. TREAD_STIFFNESS: share of kt. RIM: height of the axle, m. RUN_OUT: radius of the tire, its axle at
    one height, m.
    """

    BENDING = "bending"
    KINK = "kink"
    MASS = "mass"
    SIDEWALL = "sidewall"
    TREAD = "tread"
    TREAD_STIFFNESS = "tread stiffness"
    RIM = "rim"
    RUN_OUT = "run-out"


class Slope(Flag):
    """Parameters by which a response has terms beside its value: two of the damping, one of the mass."""

    NONE = 0
    DAMPING = auto()
    MASS = auto()


def local_response(
    belt: LoadedBelt,
    omega_radps: float,
    loss_s: float,
    offset_m: float,
    changes: Sequence[Change],
    counts: Sequence[int] = range(PATTERNS),
    *,
    slopes: Slope = Slope.NONE,
    log_mass: float = 0.0,
) -> ComplexArray:
    """Return the reading of kinds of change and patterns, (terms, kinds, counts, 2, N), m; radial and along.

    Pattern N of amplitude a reads Re(a response exp(-i N theta)) omega^2. Terms are those of `pushed_response`; the
    damper is the sidewall's usual one at the law's mass, or the belt's own where that is larger.

    Args:
        belt: rolling steadily.
        omega_radps: angular speed.
        loss_s: damping time of belt and tread.
        offset_m: sensor below (inside) the belt's neutral layer.
        changes: kinds.
        counts: N of the patterns.
        slopes: parameters with terms.
        log_mass: logarithm of the belt's mass over that of its law, which no steady shape shows.

    Raises:
        LinAlgError: the belt rings without loss.
    """
    law = belt.law
    damping = 2.0 * _SIDEWALL_RATIO * math.sqrt(law.radial_npm2 * law.mass_kgpm)
    lossy = replace(
        belt,
        law=replace(
            law,
            mass_kgpm=law.mass_kgpm * math.exp(log_mass),
            radial_damping_nspm2=max(law.radial_damping_nspm2, damping),
            tangential_damping_nspm2=max(law.tangential_damping_nspm2, damping),
        ),
    )
    heavier = replace(lossy, law=replace(lossy.law, mass_kgpm=2.0 * lossy.law.mass_kgpm))
    by_damping, by_mass = Slope.DAMPING in slopes, Slope.MASS in slopes
    terms = 1 + 2 * by_damping + by_mass
    result = np.empty((terms, len(changes), len(counts), 2, len(belt.state)), dtype=np.complex128)
    lifted = np.array([float(change is Change.RIM) for change in changes])
    for number, count in enumerate(counts):
        blocks = TreadBlocks(count, lossy.law.mass_kgpm, loss_s, loss_s)
        forces = np.stack([_force_n(lossy, omega_radps, count, change) for change in changes])
        by_mass_n = None
        if by_mass:
            by_mass_n = np.stack([_force_n(heavier, omega_radps, count, change) for change in changes]) - forces
        result[:, :, number] = pushed_response(
            lossy, blocks, omega_radps, forces, lifted, offset_m, by_damping=by_damping, by_mass_n=by_mass_n
        )
    return result


def _force_n(belt: LoadedBelt, omega_radps: float, count: int, change: Change) -> ComplexArray:
    """Return what a unit of a kind of change adds to the force on each node, (N, d)."""
    steady = _steady(belt)[change]
    if change in (Change.BENDING, Change.KINK):
        return _by_moment(belt, steady, count)
    grid = ring_grid(len(belt.state))
    force = np.zeros(belt.state.shape, dtype=np.complex128)
    if change in (Change.RIM, Change.RUN_OUT):
        # Road and axle stand still in space.
        force[:, :2] = steady
        if change is Change.RUN_OUT:
            return force
        # The axle's acceleration acts on all nodes alike.
        force[:, 1] += belt.law.mass_kgpm * belt.law.radius_m * grid.step_rad * (count * omega_radps) ** 2
        return force
    square = omega_radps**2 if change is Change.MASS else 1.0
    force[:, :2] = square * steady * np.exp(1j * count * grid.theta_rad)[:, None]
    return force


@lru_cache(maxsize=4)
def _steady(belt: LoadedBelt) -> dict[Change, FloatArray]:
    """Return what a unit of each kind acts with on the steady shape.

    Moments (N,) of bending and kink; loads (N, 2) of mass (over omega^2), sidewall, and the road by tread, its
    stiffness and axle.
    """
    law, grid = belt.law, ring_grid(len(belt.state))
    position, step = belt.state[:, :2], grid.step_rad
    length = law.radius_m * step
    stiffness = law.bending_nm2 / length
    if law.dof == 2:
        angle = segment_turn(grid, following(position) - position)
        moment = stiffness * (angle - preceding(angle))
    else:
        moment = stiffness * (following(belt.state[:, 2]) - belt.state[:, 2])
    kink = np.full(len(position), -law.bending_nm2 / law.radius_m)
    inertia = -(law.mass_kgpm * law.radius_m / step) * (following(position) - 2.0 * position + preceding(position))
    displacement = position - law.radius_m * grid.radial
    pull = np.zeros_like(position)
    for stiffness_npm2, axis in ((law.radial_npm2, grid.radial), (law.tangential_npm2, grid.along)):
        deflection = np.einsum("ia,ia->i", displacement, axis)
        pull -= (length * stiffness_npm2 * deflection * (1.0 + law.stiffening_pm * np.abs(deflection)))[:, None] * axis
    balance = belt.balance(law)
    road = balance.road
    edges_npm2 = edge_tread_npm2(law, road, belt.traction)
    by_height = balance.slopes.height + edges_npm2[:, :, 1]
    push = road.pressure_npm[:, None]
    touching = push > 0.0
    by_approach = np.where(touching, law.tread_npm2 * road.force_npm / np.where(touching, push, 1.0), 0.0)
    by_approach -= np.einsum("iab,ib->ia", edges_npm2, road.normal)
    return {
        Change.BENDING: moment,
        Change.KINK: kink,
        Change.MASS: inertia,
        Change.SIDEWALL: pull,
        Change.TREAD: length * by_approach,
        Change.TREAD_STIFFNESS: length * road.force_npm,
        Change.RIM: length * by_height,
        Change.RUN_OUT: -length * by_height,
    }


def _by_moment(belt: LoadedBelt, moment: FloatArray, count: int) -> ComplexArray:
    """Return the force on each node by a pattern of the belt's moment, (N, d)."""
    grid = ring_grid(len(belt.state))
    result = np.zeros(belt.state.shape, dtype=np.complex128)
    if belt.law.dof == 2:
        varied = moment * np.exp(1j * count * grid.theta_rad)
        # The second derivative of a moment, to fourth order.
        varied -= (following(varied) - 2.0 * varied + preceding(varied)) / 12.0
        span = following(belt.state) - belt.state
        square = np.square(span).sum(axis=1)
        normal = np.stack([-span[:, 1], span[:, 0]], axis=1)
        shear = ((varied - following(varied)) / square)[:, None] * normal
        result[:] = shear - preceding(shear)
    else:
        varied = moment * np.exp(1j * count * (grid.theta_rad + 0.5 * grid.step_rad))
        result[:, 2] = varied - preceding(varied)
    return result
