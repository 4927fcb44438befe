"""Dispersion of waves on a rolling belt: wave number, decay and near field of those that the tread's blocks send out.

N blocks enter and leave the contact each turn, so a fixed point of the road sees the frequency N Omega. A wave
exp(i (k x - N Omega t)), k waves a turn over the angle x from the contact's middle, has the frequency (N - k) Omega on
the belt. It obeys the inextensible ring under pressure and rotation, of which only quotients by the mass per length
matter:

    (1 + 1/k^2) w^2 + 4 Omega w / k - Omega^2 (k^2 - 3) + i w (a (1 + 1/k^2) + b (k^2 - 1)^2 / R^4)
        = B (k^2 - 1)^2 / R^4 + T (k^2 - 1) / R^2 + S,   w = (N - k) Omega

with B = EI / (rho A), T = p0 b R / (rho A), S the sidewall's stiffness, a and b the losses of sidewall and bending. The
root with negative real part runs ahead of the contact and is seen by a sensor at order N - k, above N; that with a
positive one is behind it, below N. The imaginary part is the decay.

Bending is of fourth order in k, so two waves leave the contact on each side: k_p, which propagates, and k_e, the near
field, k_e^2 = -(T / R^2 + Omega^2) R^4 / B - k_p^2 but for losses and small terms, which ends within a wave. The road
holds the belt's slope at the contact's edge x = 0, so that the deflection there is

    w = Re{A (exp(i k_p x) - (k_p / k_e) exp(i k_e x)) exp(-i N Omega t)},   dw/dx = 0.

At the sensor's place on the belt, x = Omega t, either part turns at its order n = N - k and has the acceleration
(n Omega)^2 w, so the near field has rho = -(k_p / k_e) (n_e / n_p)^2 of the propagating part.
"""

import cmath
import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.core.types import ComplexArray

# kw / (rho A) of the ring paper's tire at 210 kPa. A factor of two moves an order by 0.1.
_SIDEWALL_PS2: Final = 1.8e5
_STEPS: Final = 12
_NEWTON_STEPS: Final = 20
_TOLERANCE: Final = 1e-13
_SMALLEST: Final = 1e-300
# Over the wave number.
_LONGEST_STEP: Final = 0.3
# Steps to the loss that bending has at the near field's own frequency.
_LOSS_ITERATIONS: Final = 3
# A fit may pass through values that carry no wave.
_LEAST_BLOCKS: Final = 5.0
_LEAST_BENDING: Final = 1e-2
_LEAST_TENSION: Final = 10.0


@dataclass(frozen=True, slots=True)
class BlockTread:
    """Belt and tread as far as waves depend on them.

    Attributes:
        blocks: N, that enter the contact each turn.
        bending_m4ps2: EI / (rho A).
        tension_m2ps2: p0 b R / (rho A), without the part of rotation.
        sidewall_loss_ps: damper of the sidewall over the mass, c / (rho A).
        bending_loss_m4ps: bending damper over the mass.
    """

    blocks: float
    bending_m4ps2: float
    tension_m2ps2: float
    sidewall_loss_ps: float
    bending_loss_m4ps: float


@dataclass(frozen=True, slots=True)
class BeltWave:
    """One wave from an edge of the contact as the sensor sees it.

    It has two parts, that which propagates and the near field: size exp(i order d) at the angle d from the edge.

    Attributes:
        orders: (2,) N - k, 1/rad, turned so that the real part is the order and the imaginary one the decay.
        sizes: (2,) over the propagating part: 1 and rho.
        shares: (2,) change along the belt over that of the sensor's signal, k / (k - N).
        orders_by: (2, 5) derivatives by the fields of `BlockTread`.
        sizes_by: likewise.
        shares_by: likewise.
    """

    orders: ComplexArray
    sizes: ComplexArray
    shares: ComplexArray
    orders_by: ComplexArray
    sizes_by: ComplexArray
    shares_by: ComplexArray

    @property
    def order(self) -> float:
        """Of the propagating part."""
        return float(self.orders[0].real)

    @property
    def decay_per_rad(self) -> float:
        """Of the propagating part, over the angle from the contact's edge."""
        return float(self.orders[0].imag)


@lru_cache(maxsize=32)
def belt_wave(tread: BlockTread, side: int, omega_radps: float, radius_m: float) -> BeltWave:
    """Return the wave ahead of the contact (side 0) or behind it (side 1)."""
    blocks = max(tread.blocks, _LEAST_BLOCKS)
    bending = max(tread.bending_m4ps2, _LEAST_BENDING)
    tension = max(tread.tension_m2ps2, _LEAST_TENSION)
    sign = -1.0 if side == 0 else 1.0
    belt = blocks, bending, tension, tread.sidewall_loss_ps, tread.bending_loss_m4ps, omega_radps, radius_m
    real = sign * _undamped(blocks, bending, tension, sign, omega_radps, radius_m)
    k, k_by = np.empty(2, complex), np.empty((2, 5), complex)
    for part, start in enumerate((complex(real), _near_field(real, sign, belt))):
        k[part], k_by[part] = _root(start, belt)
    # Where a value is held at its least, nothing depends on it.
    free = np.array([blocks == tread.blocks, bending == tread.bending_m4ps2, tension == tread.tension_m2ps2, 1.0, 1.0])
    k_by *= free
    n, n_by = blocks - k, free * np.eye(5)[0] - k_by
    rho = -(k[0] / k[1]) * (n[1] / n[0]) ** 2
    rho_by = rho * (k_by[0] / k[0] - k_by[1] / k[1] + 2.0 * (n_by[1] / n[1] - n_by[0] / n[0]))
    shares_by = -(k_by * n[:, None] - k[:, None] * n_by) / np.square(n)[:, None]
    wave_fields = n, np.array([1.0, rho]), -k / n, n_by, np.stack([np.zeros(5), rho_by]), shares_by
    # Behind the contact the angle from the edge runs with the sensor, whose signal turns with -n.
    return BeltWave(*(wave_fields if side == 0 else (np.conj(values) for values in wave_fields)))


def mass_of_wave(
    order: float,
    blocks: float,
    bending_nm2: float,
    tension_n: float,
    sidewall_npm2: float,
    omega: float,
    radius_m: float,
) -> float:
    """Return rho A, kg/m, of a belt without losses whose wave a sensor sees at an order; NaN where none has it.

    Args:
        order: seen by the sensor, N - k.
        blocks: N.
        bending_nm2: EI.
        tension_n: p0 b R, without the part of rotation.
        sidewall_npm2: radial stiffness.
        omega: angular speed, rad/s.
        radius_m: of the belt.
    """
    k = blocks - order
    if k == 0.0:
        return math.nan
    w = order * omega
    inertia = (1.0 + 1.0 / k**2) * w * w + 4.0 * omega * w / k - omega**2 * (k * k - 3.0)
    stiffness = bending_nm2 * (k * k - 1.0) ** 2 / radius_m**4 + tension_n * (k * k - 1.0) / radius_m**2 + sidewall_npm2
    return stiffness / inertia if inertia > 0.0 else math.nan


def _undamped(blocks: float, bending: float, tension: float, sign: float, omega_radps: float, radius_m: float) -> float:
    """Return the number of waves a turn without losses and curvature of the ring, by Newton's method from above."""
    # Convex and positive beyond its only positive root, from which side the steps are monotonic.
    fourth, second = bending / radius_m**4, tension / radius_m**2 + omega_radps**2
    n = 10.0 * blocks
    for _ in range(_STEPS):
        w = (blocks - sign * n) * omega_radps
        value = fourth * n**4 + second * n * n + _SIDEWALL_PS2 - w * w
        slope = 4.0 * fourth * n**3 + 2.0 * second * n + 2.0 * sign * omega_radps * w
        n = max(n - value / slope, 1.5)
    return n


def _near_field(real: float, sign: float, belt: tuple[float, ...]) -> complex:
    """Return the wave number of the near field without sidewall and curvature of the ring, from the undamped wave's."""
    blocks, bending, tension, _, bending_loss, omega, radius = belt
    tension_term = tension * radius**2 + omega**2 * radius**4
    k = complex(0.0, sign * math.sqrt(tension_term / bending + real * real))
    for _ in range(_LOSS_ITERATIONS if bending_loss else 0):
        root = cmath.sqrt(-tension_term / (bending - 1j * bending_loss * (blocks - k) * omega) - real * real)
        k = root if root.imag * sign > 0.0 else -root
    return k


def _root(start: complex, belt: tuple[float, ...]) -> tuple[complex, ComplexArray]:
    """Return the balance's root near a value, by Newton's method, and its derivatives by the five fields, (5,)."""
    root = start
    for _ in range(_NEWTON_STEPS):
        value, slope, _ = _balance(root, *belt)
        step = value / slope
        # A longer one could reach the root of another wave.
        root -= step * min(1.0, _LONGEST_STEP * abs(root) / max(abs(step), _SMALLEST))
        if abs(step) <= _TOLERANCE * abs(root):
            break
    _, slope, by = _balance(root, *belt)
    return root, -by / slope


def _balance(
    k: complex,
    blocks: float,
    bending: float,
    tension: float,
    sidewall_loss: float,
    bending_loss: float,
    omega: float,
    radius_m: float,
) -> tuple[complex, complex, ComplexArray]:
    """Return the equation's left side minus its right one, its derivative by k and those by the five fields."""
    w = (blocks - k) * omega
    mass, bent = 1.0 + 1.0 / k**2, (k * k - 1.0) ** 2 / radius_m**4
    pulled, loss = (k * k - 1.0) / radius_m**2, sidewall_loss * (1.0 + 1.0 / k**2)
    value = mass * w * w + 4.0 * omega * w / k - omega**2 * (k * k - 3.0)
    value += 1j * w * (loss + bending_loss * bent) - bending * bent - tension * pulled - _SIDEWALL_PS2
    by_w = 2.0 * mass * w + 4.0 * omega / k + 1j * (loss + bending_loss * bent)
    bent_by, pulled_by = 4.0 * k * (k * k - 1.0) / radius_m**4, 2.0 * k / radius_m**2
    slope = -omega * by_w - 2.0 * w * w / k**3 - 4.0 * omega * w / k**2 - 2.0 * omega**2 * k
    slope += 1j * w * (-2.0 * sidewall_loss / k**3 + bending_loss * bent_by) - bending * bent_by - tension * pulled_by
    by = np.array([omega * by_w, -bent, -pulled, 1j * w * mass, 1j * w * bent])
    return value, slope, by
