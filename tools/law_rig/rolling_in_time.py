"""A belt that rolls in time: every node's motion under unilateral contact, with finite local changes.

The belt is followed in the frame of the rim. A node of mass m at y obeys

    m (y'' + 2 Omega J y' - Omega^2 y) = F(y) - c y' + road,

F the finite forces of tension, bending, pressure and sidewall; the road's normal turns round. A change of mass,
sidewall, tread or axle is finite and acts on its own nodes. Newmark's method; the response to a change is the last
revolution less that without it. Nothing here is linear, of a pattern, or of the first order, as the library's laws are.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from scipy.linalg.lapack import dgbtrf, dgbtrs

from gateway.core.types import FloatArray, IntArray
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring
from gateway.ring.rolling_ring.equilibrium import _law
from gateway.ring.rolling_ring.force_balance import (
    BeltLaw,
    belt_balance,
    ring_grid,
)
from gateway.ring.rolling_ring.newton_solver import FoldedBand, folded_band

NODES: Final = 720
STEPS: Final = 1080
"""Steps of a revolution: three for each two nodes that enter the contact."""

_REVOLUTIONS: Final = 3
_NEWTON: Final = 4
_DONE_M: Final = 1e-8
# Slight loss at frequencies that the grid does not resolve.
_GAMMA, _BETA = 0.55, 0.2756
_SPIN: Final = np.array([[0.0, -1.0], [1.0, 0.0]])
_DAMPING_NSPM2: Final = 120.0


def _no_axle(_: FloatArray) -> FloatArray:
    return np.zeros_like(_)


@dataclass(frozen=True)
class LocalChange:
    """What differs at nodes, by the angle from the middle of the change, (N,) arrays; or of the axle, by the angle.

    Attributes:
        mass: share of rho A.
        sidewall: share of kw and kv.
        tread_m: height of the tread.
        tread_stiffness: share of the tread's stiffness.
        axle_m: height of the axle by the wheel's angle.
    """

    mass: FloatArray = field(default_factory=lambda: np.zeros(NODES))
    sidewall: FloatArray = field(default_factory=lambda: np.zeros(NODES))
    tread_m: FloatArray = field(default_factory=lambda: np.zeros(NODES))
    tread_stiffness: FloatArray = field(default_factory=lambda: np.zeros(NODES))
    axle_m: Callable[[FloatArray], FloatArray] = _no_axle


@dataclass(frozen=True)
class Rolling:
    """Conditions of a rolling belt."""

    ring: RingParameters
    load_n: float
    pressure_pa: float
    omega_radps: float


class _Belt:
    """The forces of a belt in the frame of its rim."""

    def __init__(self, conditions: Rolling, change: LocalChange) -> None:
        self.grid = ring_grid(NODES)
        ring, omega = conditions.ring, conditions.omega_radps
        law = _law(ring, conditions.load_n, conditions.pressure_pa, omega, NODES, math.inf, None)
        self.omega, self.change, self.tread_npm2 = omega, change, law.tread_npm2
        # At rest in this frame: inertia is added here, the road too.
        self.law: BeltLaw = replace(law, omega_radps=0.0)
        self.length_m = law.radius_m * self.grid.step_rad
        self.mass_kg = law.mass_kgpm * self.length_m * (1.0 + change.mass)
        self.damping = _DAMPING_NSPM2 * self.length_m
        steady = solve_rolling_ring(ring, conditions.load_n, conditions.pressure_pa, omega, nodes=NODES)
        self.height_m, self.start = steady.axle_height_m, steady.position_m

    def inside(self, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the forces of the belt and its sidewall, (N, 2), and the tangent of the unchanged ones."""
        balance = belt_balance(self.law, self.grid, y, 10.0 * self.law.radius_m, 0.0)
        force, change = balance.residual.copy(), self.change
        if change.sidewall.any():
            out = y - self.law.radius_m * self.grid.radial
            for stiff, axis in ((self.law.radial_npm2, self.grid.radial), (self.law.tangential_npm2, self.grid.along)):
                pull = stiff * change.sidewall * np.einsum("ia,ia->i", out, axis)
                force -= self.length_m * pull[:, None] * axis
        return force, balance.blocks

    def road(self, y: FloatArray, angle_rad: float) -> tuple[FloatArray, FloatArray]:
        """Return the road's force on the nodes, (N, 2), and its tangent, (N, 2, 2)."""
        up = np.array([math.sin(angle_rad), math.cos(angle_rad)])
        height = self.height_m + float(self.change.axle_m(np.array([angle_rad]))[0])
        stiff = self.length_m * self.tread_npm2 * (1.0 + self.change.tread_stiffness)
        push = stiff * (-height - y @ up + self.change.tread_m)
        touching = push > 0.0
        force = np.where(touching, push, 0.0)[:, None] * up
        return force, -np.where(touching, stiff, 0.0)[:, None, None] * np.outer(up, up)

    def axle_force(self, angle_rad: float) -> FloatArray:
        """Return the inertia that the axle's own acceleration adds, (N, 2)."""
        step = 1e-3
        z = self.change.axle_m(angle_rad + step * np.array([-1.0, 0.0, 1.0]))
        acceleration = self.omega**2 * float(z[0] - 2.0 * z[1] + z[2]) / step**2
        up = np.array([math.sin(angle_rad), math.cos(angle_rad)])
        force: FloatArray = -self.mass_kg[:, None] * acceleration * up
        return force


def last_revolution(conditions: Rolling, change: LocalChange) -> FloatArray:
    """Return the positions of all nodes in space over the last revolution, (STEPS, N, 2), axle's motion included."""
    belt = _Belt(conditions, change)
    omega, step_s = conditions.omega_radps, 2.0 * math.pi / conditions.omega_radps / STEPS
    layout = folded_band(NODES, 2, 2)
    diagonal = np.eye(2)
    y = belt.start.copy()
    # Steady shape standing in space: in the rim's frame it moves backwards past the nodes.
    v = _standing_velocity(y, omega)
    a = np.zeros_like(y)
    recorded = np.empty((STEPS, NODES, 2))
    mass = belt.mass_kg[:, None]
    by_velocity, by_acceleration = _GAMMA / (_BETA * step_s), 1.0 / (_BETA * step_s**2)
    inertia = np.zeros((NODES, 2, 2))
    inertia += belt.mass_kg[:, None, None] * (
        (by_acceleration - omega**2) * diagonal + 2.0 * omega * by_velocity * _SPIN
    )
    inertia += belt.damping * by_velocity * diagonal
    total = _REVOLUTIONS * STEPS
    for number in range(1, total + 1):
        angle = 2.0 * math.pi * number / STEPS
        axle = belt.axle_force(angle)
        guess_v, guess_a = v, a
        new = y + step_s * v + 0.5 * step_s**2 * a
        factors = None
        for iteration in range(_NEWTON):
            acc = (new - y - step_s * guess_v) * by_acceleration - (0.5 / _BETA - 1.0) * guess_a
            vel = guess_v + step_s * ((1.0 - _GAMMA) * guess_a + _GAMMA * acc)
            inside, blocks = belt.inside(new)
            road, by_road = belt.road(new, angle)
            residual = inside + road + axle - belt.damping * vel
            residual -= mass * (acc + 2.0 * omega * vel @ _SPIN.T - omega**2 * new)
            if factors is None or iteration == 3:
                tangent = -blocks
                tangent[2] += inertia - by_road
                factors = _factorised(tangent, layout)
            change_m = _solved(factors, residual, layout)
            new = new + change_m
            if np.abs(change_m).max() < _DONE_M:
                break
        acc = (new - y - step_s * guess_v) * by_acceleration - (0.5 / _BETA - 1.0) * guess_a
        v = guess_v + step_s * ((1.0 - _GAMMA) * guess_a + _GAMMA * acc)
        a, y = acc, new
        row = number - (total - STEPS) - 1
        if row >= 0:
            cos, sin = math.cos(angle), math.sin(angle)
            recorded[row, :, 0] = cos * y[:, 0] - sin * y[:, 1]
            recorded[row, :, 1] = sin * y[:, 0] + cos * y[:, 1] + float(change.axle_m(np.array([angle]))[0])
    return recorded


def _standing_velocity(shape: FloatArray, omega: float) -> FloatArray:
    """Return the velocity in the rim's frame of nodes that pass a shape that stands in space."""
    along = _derivative(shape)
    turned = np.stack([-shape[:, 1], shape[:, 0]], axis=1)
    return omega * (along - turned)


def _derivative(shape: FloatArray) -> FloatArray:
    spectrum = np.fft.fft(shape[:, 0] + 1j * shape[:, 1])
    order = np.fft.fftfreq(len(shape), 1.0 / len(shape))
    slope = np.fft.ifft(1j * order * spectrum)
    return np.stack([slope.real, slope.imag], axis=1)


def _factorised(tangent: FloatArray, layout: FoldedBand) -> tuple[FloatArray, FloatArray]:
    size, half = 2 * NODES, layout.half
    band = np.zeros((3 * half + 1) * size)
    band[layout.flat] = tangent
    factors, pivots, _ = dgbtrf(band.reshape(size, -1).T, half, half, overwrite_ab=True)
    return factors, pivots


def _solved(factors: tuple[FloatArray, FloatArray], right: FloatArray, layout: FoldedBand) -> FloatArray:
    side = np.empty(2 * NODES)
    side[layout.unknown] = right
    solution, _ = dgbtrs(factors[0], layout.half, layout.half, side, factors[1])
    result: FloatArray = solution[layout.unknown]
    return result


def read_by(positions_m: FloatArray, nodes: IntArray, depth_m: float) -> FloatArray:
    """Return what sensors below nodes read over omega^2, radial and along, (k, 2, STEPS) from theta = -pi on.

    A sensor's axes follow the belt as it lies at the time, not the node's path.

    Args:
        positions_m: (STEPS, N, 2) of the nodes.
        nodes: (k,) numbers of nodes.
        depth_m: of the sensors below the neutral layer.
    """
    belt = positions_m[..., 0] + 1j * positions_m[..., 1]
    order = np.fft.fftfreq(NODES, 1.0 / NODES)
    slope = np.fft.ifft(1j * order * np.fft.fft(belt, axis=1), axis=1)[:, nodes]
    along = slope / np.abs(slope)
    inward = 1j * along
    rate = np.fft.fftfreq(STEPS, 1.0 / STEPS)[:, None]
    path = belt[:, nodes] + depth_m * inward
    acceleration = np.fft.ifft(-(rate**2) * np.fft.fft(path, axis=0), axis=0)
    read = np.stack([(acceleration * inward.conj()).real, (acceleration * along.conj()).real])
    # Sample k of a node is at its material angle plus (k + 1) steps; -pi is to be first.
    first = ring_grid(NODES).theta_rad[nodes] / (2.0 * math.pi) * STEPS + 1.0
    shifts = np.rint(first).astype(int) + STEPS // 2
    return np.stack([np.roll(read[:, :, k], shift, axis=1) for k, shift in enumerate(shifts.tolist())])
