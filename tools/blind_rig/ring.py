"""A loaded rolling ring as a chain of nodes, solved by Newton's method with a complex-step tangent.

Every force derives from the node's neighbours: tension and bending of the chain, pressure on the enclosed area, a
sidewall of springs and dashpots, and a unilateral tread on a flat road or a drum. Nothing of `gateway.ring` is used.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csc_matrix, eye_array, kron
from scipy.sparse.linalg import splu

Array = NDArray[Any]

NODES: Final = 2880
GRAVITY_MPS2: Final = 9.80665
_COLOURS: Final = 5
_ORDERS: Final = 300
_WAVES: Final = 140
# Losses of vibrations, which the steady shape hardly shows: of the belt in bending, and of the sidewall.
_LOSS_S: Final = 2e-5
_DAMPING_NSPM2: Final = 80.0


@dataclass(frozen=True)
class Ring:
    """A tire as a ring; numbers as of the ring paper's table.

    Attributes:
        bs, cw, rs, ts: bending, tension, radial and tangential sidewall numbers.
        radius_m, pressure_pa, mass_kgpm: belt radius, inflation pressure, mass per length.
        tread_npm2: tread stiffness.
        extension_n: EA of the belt.
        sidewall_damping_nspm2: dashpot of the sidewall.
        drum_pm: curvature of the road, 1/m; 0 for flat.
    """

    bs: float = 2.9e-3
    cw: float = 0.205
    rs: float = 2.8
    ts: float = 2.4
    radius_m: float = 0.315
    pressure_pa: float = 2.2e5
    mass_kgpm: float = 3.2
    tread_npm2: float = 6.5e7
    extension_n: float = 4e8
    sidewall_damping_nspm2: float = 0.0
    drum_pm: float = 0.0


@dataclass(frozen=True)
class Shape:
    """Signal of a sensor over the angle: (2, N) inward and along, of inertia over Omega^2 and of gravity."""

    inertia_m: Array
    gravity_mps2: Array


class _Chain:
    def __init__(self, ring: Ring, load_n: float, omega_radps: float, nodes: int) -> None:
        self.ring, self.load_n, self.nodes = ring, load_n, nodes
        self.h = 2.0 * math.pi / nodes
        self.theta = (np.arange(nodes) - nodes // 2) * self.h
        self.out = np.stack([np.sin(self.theta), -np.cos(self.theta)])
        self.along = np.stack([np.cos(self.theta), np.sin(self.theta)])
        r, p = ring.radius_m, ring.pressure_pa
        self.ei = np.full(nodes, ring.bs * p * r**4)
        # Cw is the pressure's tension b p R over p R^2.
        self.tension = ring.cw * p * r * r
        self.centrifugal = ring.mass_kgpm * r * r * omega_radps**2
        self.omega = omega_radps

    def forces(self, x: Array, height: Any, ei: Array | None = None) -> tuple[Array, Array]:
        """Return the force on every node (2, N), and the road's push of each; with another EI (N,), complex."""
        ring, h = self.ring, self.h
        r, p = ring.radius_m, ring.pressure_pa
        step = np.roll(x, -1, axis=1) - x
        length = np.sqrt(step[0] ** 2 + step[1] ** 2)
        t = step / length
        normal = np.stack([-t[1], t[0]])
        before = np.roll(t, 1, axis=1)
        turned = np.arcsin(before[0] * t[1] - before[1] * t[0])
        moment = (self.ei if ei is None else ei) * (turned - h) / (r * h)
        rest = 2.0 * r * math.sin(0.5 * h)
        pull = self.tension + self.centrifugal + ring.extension_n * (length / rest - 1.0)
        inner = pull * t + (moment - np.roll(moment, -1)) / length * normal
        total = inner - np.roll(inner, 1, axis=1)
        chord = 0.5 * (np.roll(x, -1, axis=1) - np.roll(x, 1, axis=1))
        total = total + self.tension / r * np.stack([chord[1], -chord[0]])
        second = np.roll(x, -1, axis=1) - 2.0 * x + np.roll(x, 1, axis=1)
        total = total - self.centrifugal / (r * h) * second
        moved = x - r * self.out
        radial, tangential = (moved * self.out).sum(0), (moved * self.along).sum(0)
        up = r * h * p * np.stack([ring.rs * radial, ring.ts * tangential])
        if ring.sidewall_damping_nspm2:
            rate = 0.5 * r * self.omega * ring.sidewall_damping_nspm2
            up = up + rate * np.stack([np.roll(c, -1) - np.roll(c, 1) for c in (radial, tangential)])
        total = total - up[0] * self.out - up[1] * self.along
        if ring.drum_pm:
            centre = np.stack([-x[0], -height - 1.0 / ring.drum_pm - x[1]])
            distance = np.sqrt(centre[0] ** 2 + centre[1] ** 2)
            depth, toward = 1.0 / ring.drum_pm - distance, -centre / distance
        else:
            depth, toward = -x[1] - height, np.array([[0.0], [1.0]])
        push = np.where(depth.real > 0.0, depth, 0.0) * (ring.tread_npm2 * r * h) * toward
        return total + push, push

    def tangent(self, x: Array, height: float) -> Any:
        """Return the tangent of all forces and of the load, (2 N + 1, 2 N + 1)."""
        n, tiny = self.nodes, 1e-30
        rows, columns, values = [], [], []
        index = np.arange(n)
        load_row = np.zeros(2 * n)
        for colour in range(_COLOURS):
            chosen = index[index % _COLOURS == colour]
            for axis in range(2):
                moved = x.astype(complex)
                moved[axis, chosen] += 1j * tiny
                force, push = self.forces(moved, height)
                change = force.imag / tiny
                for offset in range(-2, 3):
                    target = (chosen + offset) % n
                    for component in range(2):
                        rows.append(2 * target + component)
                        columns.append(2 * chosen + axis)
                        values.append(change[component, target])
                load_row[2 * chosen + axis] = push[1].imag[chosen] / tiny
        force, push = self.forces(x.astype(complex), height + 1j * tiny)
        by_height = force.imag / tiny
        for component in range(2):
            rows.append(2 * index + component)
            columns.append(np.full(n, 2 * n))
            values.append(by_height[component])
        rows.append(np.full(2 * n + 1, 2 * n))
        columns.append(np.arange(2 * n + 1))
        values.append(np.append(load_row, push[1].imag.sum() / tiny))
        return csc_matrix(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=(2 * n + 1, 2 * n + 1)
        )

    def solve(self, x: Array, height: float, load_n: float, passes: int = 60) -> tuple[Array, float]:
        """Return the shape under a load and the axle's height.

        Raises:
            RuntimeError: it does not converge.
        """
        for _ in range(passes):
            force, push = self.forces(x, height)
            residual = np.append(force.T.ravel(), push[1].sum() - load_n)
            step = -splu(self.tangent(x, height)).solve(residual)
            longest = float(np.abs(step).max())
            factor = min(1.0, 2e-3 / longest)
            x = x + factor * step[:-1].reshape(-1, 2).T
            height += factor * float(step[-1])
            if longest < 1e-9:
                return x, height
        raise RuntimeError("the ring does not converge")

    def loaded(self) -> tuple[Array, float]:
        """Return the shape under the load from the round ring."""
        x, height = self.ring.radius_m * self.out, self.ring.radius_m - 2e-3
        for share in (0.1, 0.4, 1.0):
            x, height = self.solve(x, height, share * self.load_n)
        return x, height

    def answer(self, x: Array, height: float, stiffer: Array, count: int) -> Array:
        """Return what shares of EI (N,), complex, that pass the road `count` times a turn move beside x, (2, N)."""
        pushes = [self.forces(x, height, ei)[0] for ei in (0.0 * self.ei, self.ei * stiffer)]
        return self.vibrating(self.tangent(x, height), count)(pushes[0] - pushes[1])

    def vibrating(self, tangent: Any, count: int) -> Callable[[Array], Array]:
        """Return what solves for the motion (2, N) under forces (2, N) that turn `count` times a turn."""
        ring, n, h, steady = self.ring, self.nodes, self.h, self.ei
        # Beside the steady balance: d/dt is -i count omega, a point of the belt has d/dt + omega d/dtheta.
        next_to, last = eye_array(n, k=1) + eye_array(n, k=1 - n), eye_array(n, k=-1) + eye_array(n, k=n - 1)
        slope, curve = (next_to - last) / (2.0 * h), (next_to - 2.0 * eye_array(n) + last) / h**2
        length, rate = ring.radius_m * h, -1j * count * self.omega
        added = -ring.mass_kgpm * length * (rate**2 * eye_array(n) + 2.0 * rate * self.omega * slope)
        steadily, damping = ring.sidewall_damping_nspm2, max(ring.sidewall_damping_nspm2, _DAMPING_NSPM2)
        added = added - length * (damping * rate * eye_array(n) + (damping - steadily) * self.omega * slope)
        bending = float(steady[0]) * h / ring.radius_m**3
        added = added - _LOSS_S * bending * (rate * eye_array(n) + self.omega * slope) @ curve @ curve
        factors = splu(csc_matrix(tangent[: 2 * n, : 2 * n] + kron(added, eye_array(2))))
        return lambda force: np.asarray(factors.solve(force.T.ravel().astype(complex)).reshape(-1, 2).T)


def _derivative(curve: Array, times: int, orders: int) -> Array:
    n = curve.shape[-1]
    spectrum = np.fft.rfft(curve, axis=-1)
    order = np.arange(spectrum.shape[-1])
    fade = np.clip((1.4 * orders - order) / (0.4 * orders), 0.0, 1.0)
    result: Array = np.fft.irfft(spectrum * (1j * order) ** times * fade, n=n, axis=-1)
    return result


def _read(x: Array, tangent: Array, depth_m: float, orders: int) -> Shape:
    t = tangent / np.sqrt((tangent**2).sum(0))
    out = np.stack([t[1], -t[0]])
    acceleration = _derivative(x - depth_m * out, 2, orders)
    inertia = np.stack([-(acceleration * out).sum(0), (acceleration * t).sum(0)])
    gravity = GRAVITY_MPS2 * np.stack([-out[1], t[1]])
    return Shape(inertia, gravity)


def rolled(
    ring: Ring, load_n: float, omega_radps: float, depth_m: float, stiffer: Callable[[Array], Array] | None = None
) -> Shape:
    """Return what a sensor reads over a revolution, angle -pi first; `stiffer` as in a case."""
    chain = _Chain(ring, load_n, omega_radps, NODES)
    x, height = chain.loaded()
    tangent = _derivative(x, 1, _ORDERS)
    if stiffer is not None:
        shares = np.fft.fft(np.roll(stiffer(chain.theta), -(NODES // 2))) / NODES
        moved, turned = np.zeros_like(x), np.zeros_like(x)
        for count in range(_WAVES):
            wave = (2.0 if count else 1.0) * shares[count] * np.exp(1j * count * chain.theta)
            answer = chain.answer(x, height, wave, count)
            # The sensor meets the wave where it is itself.
            there = np.exp(-1j * count * chain.theta)
            moved += (answer * there).real
            turned += ((np.roll(answer, -1, axis=1) - np.roll(answer, 1, axis=1)) / (2.0 * chain.h) * there).real
        x, tangent = x + moved, tangent + turned
    return _read(x, tangent, depth_m, _ORDERS)
