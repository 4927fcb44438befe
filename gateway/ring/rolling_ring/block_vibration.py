"""Vibration of the rolling ring that tread blocks excite: its linear response to a tread stiffness that varies.

The tread has the stiffness kt (1 + Re(a exp(i N phi))) at the material angle phi from the sensor, N blocks a turn. A
fixed point of the road sees phi = theta - Omega t, so the belt is pushed N times a turn by a pattern that moves with
it. With x(theta) the steady shape and Re(a D(theta) exp(-i N Omega t)) the vibration about it,

    A D + rho A Omega^2 (N^2 + 2 i N d/dtheta) D
        + Omega (C + tau_b K_b + tau_t K_t) (d/dtheta - i N) D = -q exp(i N theta)

with A the tangent stiffness of the steady ring and its contact (`force_balance`), q the road's push, C the sidewall's
damper, K_b and K_t the parts of A that bending and tread make, tau their damping times. What passes with the belt
changes at the rate Omega (d/dtheta - i N). The contact's edges need no term, for the push is zero there, and the axle
keeps its height. What leaves the contact are the waves of the free belt; what stays is its vibration on the tread.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Final, NamedTuple, Self

import numpy as np

from gateway.core.types import ComplexArray, FloatArray, IntArray
from gateway.ring.rolling_ring.force_balance import (
    Balance,
    BeltLaw,
    Grid,
    belt_balance,
    belt_stretch,
    edge_tread_npm2,
    following,
    outer,
    preceding,
    ring_grid,
    stretched_tension_n,
)
from gateway.ring.rolling_ring.newton_solver import folded_band
from gateway.ring.rolling_ring.sensor_waveform import angle_derivatives

# Of the tire's state; the rest of a law is its conditions.
_STATE: Final = ("bending_nm2", "tension_width_m", "radial_npm2", "tangential_npm2", "tread_npm2")
# Fourth-order differences: at 960 nodes, those of second order are off by 3 % at the order of 67 blocks.
_FIRST: Final[FloatArray] = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
_FOURTH: Final[FloatArray] = np.array([1.0, -4.0, 6.0, -4.0, 1.0])
_STENCIL: Final = 2
_CENTRAL: Final = {-1: -0.5, 1: 0.5}
_SECOND: Final = {-1: 1.0, 0: -2.0, 1: 1.0}
# Degrees of freedom of a node without shear.
_PLANAR: Final = 2
# Neighbours on either side: two of the stiffness, one more for the rate of bending.
_REACH: Final = 3
# Places in `_Parts.acting` of the sidewall's damper: at rest, and as the belt passes.
_DAMPER_AT_REST: Final = 1
_DAMPER_PASSING: Final = 4


@dataclass(frozen=True, slots=True, eq=False)
class LoadedBelt:
    """A ring rolling steadily under load, or the change of one by a parameter; it equals only itself.

    Attributes:
        law: stiffnesses and conditions; of the losses, the sidewall's.
        state: (N, d) unknowns of the nodes.
        height_m: of the axle.
        traction: friction per push.
        stretch: (N,) of the segments over their length at rest; None for what the nodes' distances give.
    """

    law: BeltLaw
    state: FloatArray
    height_m: float
    traction: float
    stretch: FloatArray | None = None

    def moved(self, slope: Self, step: float) -> Self:
        """Return the belt moved by a step along a slope."""
        fields = {name: getattr(self.law, name) + step * getattr(slope.law, name) for name in _STATE}
        return type(self)(
            replace(self.law, **fields),
            self.state + step * slope.state,
            self.height_m + step * slope.height_m,
            self.traction + step * slope.traction,
            self.stretch,
        )

    def coarser(self) -> Self:
        """Return the belt by every other node, at half of the work.

        Chords of a belt that is bent otherwise than at rest are of another length: the stretch is that of all nodes.
        """
        if len(self.state) % 2:
            return self
        stretch = belt_stretch(self.law.radius_m, self.state) if self.stretch is None else self.stretch
        return replace(self, state=self.state[::2], stretch=stretch.reshape(-1, 2).mean(axis=1))

    def balance(self, law: BeltLaw) -> Balance:
        """Return the balance of the belt under another law."""
        grid = ring_grid(len(self.state))
        tension_n = None if self.stretch is None else stretched_tension_n(law, grid, self.stretch)
        return belt_balance(law, grid, self.state, self.height_m, self.traction, tension_n)

    def scaled(self, factor: float) -> Self:
        """Return a change of a belt times a factor."""
        fields = {name: factor * getattr(self.law, name) for name in _STATE}
        return type(self)(
            replace(self.law, **fields), factor * self.state, factor * self.height_m, factor * self.traction
        )


@dataclass(frozen=True, slots=True)
class TreadBlocks:
    """Blocks of the tread, and what the belt's vibration depends on beyond the steady ring.

    Attributes:
        count: N, that enter the contact each turn.
        mass_kgpm: rho A of belt and tread.
        bending_time_s: tau_b, damping time of the belt's bending.
        tread_time_s: tau_t, damping time of the tread.
    """

    count: float
    mass_kgpm: float
    bending_time_s: float
    tread_time_s: float


class BlockResponse(NamedTuple):
    """What a sensor on the belt reads of the vibration, over omega^2, for a stiffness that varies by 1.

    A real amplitude a = c - i s reads Re(a signal exp(-i N theta)) omega^2 on each axis.

    Attributes:
        signal: (2, N) radial (inward) and circumferential, m.
        by: (4, 2, N) its derivatives by the fields of `TreadBlocks`.
    """

    signal: ComplexArray
    by: ComplexArray


class _Parts(NamedTuple):
    """What acts on the vibration of a belt, as cyclic block bands (7, N, d, d), and the road's push on the nodes.

    Attributes:
        rest: tangent stiffness, all but inertia.
        inertia: of the steady shape, over mass and omega^2.
        losses: (3, ...) of sidewall, belt and tread, for a damping time of 1 s and a rate of 1; of the sidewall's own
            damper.
        passing: (3, ...) likewise, for the rate d/dtheta at which the belt passes what stands still.
        acting: (N, 7 d, 7 d) inertia, losses and passing by node, as they act on the 7 nodes around it.
        push_n: (N, 2).
    """

    rest: FloatArray
    inertia: FloatArray
    losses: FloatArray
    passing: FloatArray
    acting: FloatArray
    push_n: FloatArray


def block_response(
    belt: LoadedBelt, blocks: TreadBlocks, omega_radps: float, sensor_offset_m: float = 0.0
) -> BlockResponse:
    """Return the response of a belt to the stiffness of its tread's blocks.

    Args:
        belt: rolling steadily.
        blocks: of its tread.
        omega_radps: angular speed.
        sensor_offset_m: sensor below (inside) the belt's neutral layer.

    Raises:
        LinAlgError: the belt rings without loss at this frequency.
    """
    parts, grid = _parts(belt), ring_grid(len(belt.state))
    inertia, count = blocks.mass_kgpm * omega_radps**2, blocks.count
    moving, by_count = _moving(belt.law.radius_m, grid, count)
    times_s = np.array([1.0, blocks.bending_time_s, blocks.tread_time_s])
    dynamic = _dynamic(parts, moving, times_s, inertia, omega_radps, count)
    push_load = np.zeros(belt.state.shape, dtype=np.complex128)
    push_load[:, :2] = -parts.push_n * np.exp(1j * count * grid.theta_rad)[:, None]
    solve = _Solver(dynamic)
    vibration = solve(push_load[None])[0]
    windows = vibration[_window(len(vibration))]
    accelerated, *losses = _acting(parts.acting, windows)
    standing, convected = omega_radps * np.reshape(losses, (2, 3, *vibration.shape))
    accelerated[:, :2] += np.tensordot(moving, windows[:, :, :2], axes=(0, 1))
    by_blocks = -1j * np.tensordot(times_s, standing, 1)
    by_blocks[:, :2] += inertia * np.tensordot(by_count, windows[:, :, :2], axes=(0, 1))
    count_load = 1j * grid.theta_rad[:, None] * push_load - by_blocks
    changes = solve(np.stack([count_load, -(omega_radps**2) * accelerated, *(1j * count * standing - convected)[1:]]))
    readings, explicit = _reading(belt, sensor_offset_m)(np.concatenate([vibration[None], changes]), count)
    readings[1] += explicit
    return BlockResponse(readings[0], readings[1:])


def pushed_response(
    belt: LoadedBelt,
    blocks: TreadBlocks,
    omega_radps: float,
    forces_n: ComplexArray,
    lifted_m: FloatArray,
    offset_m: float = 0.0,
    *,
    by_damping: bool = False,
    by_mass_n: ComplexArray | None = None,
) -> ComplexArray:
    """Return what a sensor reads of forces that change N times a turn, over omega^2, (terms, k, 2, N), m.

    A force Re(a f exp(-i N Omega t)) on the nodes reads Re(a signal exp(-i N theta)) omega^2, radial and along. The
    first term is the response. By damping there are two more, so that a sidewall damper c_0 / (1 + z) in place of c_0
    reads the first, plus z times the second, plus z^2 times the third. At resonance, where the response goes with
    1 / c, two are exact. By mass there is one more, the derivative by the mass's logarithm.

    Args:
        belt: rolling steadily.
        blocks: N, which may be 0, and what the vibration depends on.
        omega_radps: angular speed.
        forces_n: (k, N, d) on each node.
        lifted_m: (k,) amplitude by which the axle, and all that it carries, moves up at the same time.
        offset_m: sensor below (inside) the belt's neutral layer.
        by_damping: with the terms of the damping.
        by_mass_n: the part of the forces in proportion to the mass; None without the term of the mass.

    Raises:
        LinAlgError: the belt rings without loss at this frequency.
    """
    parts, inertia, count = _parts(belt), blocks.mass_kgpm * omega_radps**2, blocks.count
    moving, _ = _moving(belt.law.radius_m, ring_grid(len(belt.state)), count)
    times_s = np.array([1.0, blocks.bending_time_s, blocks.tread_time_s])
    solve = _Solver(_dynamic(parts, moving, times_s, inertia, omega_radps, count))
    vibrations = solve(-forces_n)
    terms = [vibrations]
    if by_damping:
        # With S the damper's part of A, A D = f, c = c_0 exp(y), z = exp(-y) - 1: A D' = -S D, A D'' = -S (D + 2 D').
        first = solve(-_damped(parts, vibrations, omega_radps, count))
        second = solve(-_damped(parts, vibrations + 2.0 * first, omega_radps, count))
        terms += [-first, 0.5 * (first + second)]
    if by_mass_n is not None:
        # With S what the mass does to A, f' the forces' part of it: A D' = f' - S D.
        terms.append(solve(-by_mass_n - _accelerated(parts, moving, inertia, vibrations)))
    vibrations[:, :, 1] += lifted_m[:, None]
    readings = _reading(belt, offset_m)(np.concatenate(terms), count)[0]
    return readings.reshape(len(terms), -1, *readings.shape[1:])


def _damped(parts: _Parts, vibrations: ComplexArray, omega_radps: float, count: float) -> ComplexArray:
    """Return what the sidewall's damper does to vibrations (k, N, d), likewise."""
    dof = vibrations.shape[2]
    by_node = parts.acting.reshape(len(parts.acting), -1, dof, parts.acting.shape[2])
    damper = np.ascontiguousarray(by_node[:, [_DAMPER_AT_REST, _DAMPER_PASSING]]).reshape(len(by_node), 2 * dof, -1)
    standing, convected = _acted(damper, vibrations)
    result: ComplexArray = omega_radps * (convected - 1j * count * standing)
    return result


def _accelerated(parts: _Parts, moving: ComplexArray, inertia_npm: float, vibrations: ComplexArray) -> ComplexArray:
    """Return the inertia of vibrations (k, N, d), likewise."""
    (result,) = _acted(np.ascontiguousarray(parts.acting[:, : vibrations.shape[2]]), vibrations)
    result[:, :, :2] += np.tensordot(vibrations[:, _window(len(result[0])), :2], moving, axes=(2, 0))
    accelerated: ComplexArray = inertia_npm * result
    return accelerated


def _acted(acting: FloatArray, vibrations: ComplexArray) -> ComplexArray:
    """Return what parts of a belt do to vibrations (k, N, d), (parts, k, N, d)."""
    return np.stack([_acting(acting, vibration[_window(len(vibration))]) for vibration in vibrations], axis=1)


def _dynamic(
    parts: _Parts, moving: ComplexArray, times_s: FloatArray, inertia_npm: float, omega_radps: float, count: float
) -> ComplexArray:
    """Return the tangent stiffness of a vibration, a cyclic block band of seven."""
    loss = (omega_radps * times_s) @ parts.losses.reshape(3, -1)
    steady = parts.rest + (omega_radps * times_s @ parts.passing.reshape(3, -1)).reshape(parts.rest.shape)
    steady += inertia_npm * parts.inertia
    dynamic: ComplexArray = steady - 1j * count * loss.reshape(steady.shape)
    for axis in (0, 1):
        dynamic[:, :, axis, axis] += (inertia_npm * moving)[:, None]
    return dynamic


# Four megabytes each.
@lru_cache(maxsize=16)
def _parts(belt: LoadedBelt) -> _Parts:
    """Return the parts of a belt; its tangent stiffness is linear in each stiffness, and in the mass."""
    law, grid = replace(belt.law, mass_kgpm=0.0, omega_radps=1.0), ring_grid(len(belt.state))
    law = replace(law, radial_damping_nspm2=0.0, tangential_damping_nspm2=0.0)
    nodes, dof = belt.state.shape
    length = law.radius_m * grid.step_rad

    def tangent(varied_law: BeltLaw) -> FloatArray:
        return belt.balance(varied_law).blocks

    reference = belt.balance(law)
    inertia = tangent(replace(law, mass_kgpm=1.0)) - reference.blocks
    bending = tangent(replace(law, bending_nm2=2.0 * law.bending_nm2)) - reference.blocks
    tension = tangent(replace(law, tension_width_m=2.0 * law.tension_width_m)) - reference.blocks
    edges = length * edge_tread_npm2(law, reference.road, belt.traction)
    sidewall, tread = np.zeros_like(reference.blocks), np.zeros_like(reference.blocks)
    tread[_STENCIL, :, :2, :2] = length * reference.slopes.position[1] + edges
    passing = np.zeros((3, 2 * _REACH + 1, nodes, dof, dof))
    for damping, axis in (
        (belt.law.radial_damping_nspm2, grid.radial),
        (belt.law.tangential_damping_nspm2, grid.along),
    ):
        sidewall[_STENCIL, :, :2, :2] -= length * damping * outer(axis, axis)
        for offset, neighbour in ((1, following(axis)), (-1, preceding(axis))):
            rate = offset * length * damping / (2.0 * grid.step_rad)
            passing[0, _REACH + offset, :, :2, :2] -= rate * outer(axis, neighbour)
    for offset, weight in _CENTRAL.items():
        # The belt bends in its own directions, which turn from node to node; the road stands still.
        rotation = np.eye(dof)
        rotation[:2, :2] = _rotation(-offset * grid.step_rad)
        rate = weight / grid.step_rad
        passing[1, 1 + offset : 6 + offset] += rate * bending @ rotation
    for offset, weight in zip(range(-_STENCIL, _STENCIL + 1), _FIRST, strict=True):
        passing[2, _REACH + offset] += weight / grid.step_rad * tread[_STENCIL]
    bands = [_widened(blocks) for blocks in (reference.blocks, inertia, sidewall, bending, tread)]
    bands[0][_REACH, :, :2, :2] += edges
    if dof == _PLANAR:
        # Second differences take q^2 h^2 / 12 from the tension's stiffness to a wave q, and twice that from bending's.
        correction = bending / 6.0 + tension / 12.0
        for offset, weight in _SECOND.items():
            rotation = _rotation(-offset * grid.step_rad)
            bands[0][1 + offset : 6 + offset] -= weight * correction @ rotation
    losses = np.stack(bands[2:])
    by_node = np.stack([bands[1], *losses, *passing]).transpose(2, 0, 3, 1, 4)
    acting = by_node.reshape(nodes, by_node.shape[1] * dof, -1)
    return _Parts(bands[0], bands[1], losses, passing, acting, length * reference.road.force_npm)


def _rotation(angle_rad: float) -> FloatArray:
    """Return the rotation by an angle, (2, 2)."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return np.array([[cos, -sin], [sin, cos]])


def _widened(blocks: FloatArray) -> FloatArray:
    """Return a cyclic block band of five as one of seven."""
    result = np.zeros((2 * _REACH + 1, *blocks.shape[1:]))
    result[_REACH - _STENCIL : _REACH + _STENCIL + 1] = blocks
    return result


def _acting(acting: FloatArray, windows: ComplexArray) -> ComplexArray:
    """Return (k, N, d) what k parts of a belt do to a vector by its values around each node, (N, 7, d)."""
    nodes, _, dof = windows.shape
    # Real and imaginary parts as two columns: the parts are real.
    columns = windows.reshape(nodes, -1, 1).view(np.float64)
    result: ComplexArray = np.ascontiguousarray(acting @ columns).view(np.complex128)
    return result.reshape(nodes, -1, dof).transpose(1, 0, 2)


@lru_cache(maxsize=16)
def _window(nodes: int) -> IntArray:
    """Return (N, 7) the numbers of the nodes around each."""
    return (np.arange(nodes)[:, None] + np.arange(-_REACH, _REACH + 1)) % nodes


def _moving(radius_m: float, grid: Grid, count: float) -> tuple[ComplexArray, ComplexArray]:
    """Return what the vibration's frequency adds to the inertia over mass and omega^2, and its derivative by N.

    With it the second difference of the steady shape's inertia becomes one of fourth order. (7,) each, by neighbour.
    """
    length = radius_m * grid.step_rad
    weights = np.zeros(2 * _REACH + 1, dtype=np.complex128)
    by_count = np.zeros_like(weights)
    stencil = slice(_REACH - _STENCIL, _REACH + _STENCIL + 1)
    weights[stencil] = length * (2j * count / grid.step_rad * _FIRST + _FOURTH / (12.0 * grid.step_rad**2))
    by_count[stencil] = length * (2j / grid.step_rad * _FIRST)
    weights[_REACH] += length * count**2
    by_count[_REACH] += 2.0 * length * count
    return weights, by_count


class _Solver:
    """A factorised complex cyclic block band."""

    def __init__(self, blocks: ComplexArray) -> None:
        from scipy.linalg.lapack import zgbtrf

        nodes, dof = blocks.shape[1:3]
        self._layout = folded_band(nodes, dof, _REACH)
        half, self._size = self._layout.half, nodes * dof
        band = np.zeros((3 * half + 1) * self._size, dtype=np.complex128)
        band[self._layout.flat] = blocks
        self._factors, self._pivots, info = zgbtrf(band.reshape(self._size, -1).T, half, half, overwrite_ab=True)
        if info != 0:
            raise np.linalg.LinAlgError("the belt rings without loss at the frequency of the tread's blocks")

    def __call__(self, sides: ComplexArray) -> ComplexArray:
        """Return the solutions for right sides (k, N, d)."""
        from scipy.linalg.lapack import zgbtrs

        half, unknown = self._layout.half, self._layout.unknown.reshape(-1)
        columns = np.empty((self._size, len(sides)), dtype=np.complex128, order="F")
        columns[unknown] = sides.reshape(len(sides), -1).T
        solutions, _ = zgbtrs(self._factors, half, half, columns, self._pivots, overwrite_b=True)
        return np.ascontiguousarray(solutions[unknown].T).reshape(sides.shape)


@lru_cache(maxsize=64)
def _reading(belt: LoadedBelt, offset_m: float) -> _Reading:
    return _Reading(belt, offset_m)


class _Reading:
    """A sensor on a vibrating belt: it passes x + D exp(-i N theta), and turns with the belt's section."""

    def __init__(self, belt: LoadedBelt, offset_m: float) -> None:
        neutral = belt.state[:, 0] + 1j * belt.state[:, 1]
        slope, _ = angle_derivatives(neutral)
        theta = ring_grid(len(neutral)).theta_rad
        axis = np.exp(1j * (theta + belt.state[:, 2])) if belt.law.dof == 3 else slope / np.abs(slope)
        _, steady = angle_derivatives(neutral + 1j * offset_m * axis)
        # Of a complex vector's two parts, the real one along each axis is the product with its conjugate.
        self._travel, self._inward = axis, 1j * axis
        self._steady_travel, self._steady_inward = (steady * axis.conj()).real, (steady * (1j * axis).conj()).real
        self._turn_weight = slope / np.abs(slope) ** 2
        self._offset_m = offset_m
        self._order = np.fft.fftfreq(len(neutral), 1.0 / len(neutral))

    def __call__(self, vibrations: ComplexArray, count: float) -> tuple[ComplexArray, ComplexArray]:
        """Return what it reads of vibrations (k, N, d), (k, 2, N), and the derivative by N of the first's reading."""
        x, y = vibrations[:, :, 0], vibrations[:, :, 1]
        if vibrations.shape[2] == 3:
            rotation = vibrations[:, :, 2]
        else:
            rate_x, rate_y = (np.fft.ifft(1j * self._order * np.fft.fft(part)) for part in (x, y))
            rotation = self._turn_weight.real * rate_y - self._turn_weight.imag * rate_x
        lever = self._offset_m * rotation
        spectrum = np.fft.fft(np.stack([x - lever * self._travel.real, y - lever * self._travel.imag], axis=1))
        sensor_order = self._order - count
        readings = self._project(np.fft.ifft(-(sensor_order**2) * spectrum))
        readings[:, 0] -= self._steady_travel * rotation
        readings[:, 1] += self._steady_inward * rotation
        return readings, self._project(np.fft.ifft(2.0 * sensor_order * spectrum[:1]))[0]

    def _project(self, vectors: ComplexArray) -> ComplexArray:
        """Return the inward part and that along the belt of vectors (k, 2, N), likewise."""
        x, y = vectors[:, 0], vectors[:, 1]
        return np.stack([x * axis.real + y * axis.imag for axis in (self._inward, self._travel)], axis=1)
