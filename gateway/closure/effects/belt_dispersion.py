"""Dispersion of waves on a rolling belt: wave number and decay of those that the tread's blocks send out.

N blocks enter and leave the contact each turn, so a fixed point of the road sees the frequency N Omega. A wave
exp(i (k x - N Omega t)), k waves a turn over the angle x from the contact's middle, has the frequency (N - k) Omega on
the belt. It obeys the inextensible ring under pressure and rotation, of which only quotients by the mass per length
matter:

    (1 + 1/k^2) w^2 + 4 Omega w / k - Omega^2 (k^2 - 3) + i w (a (1 + 1/k^2) + b (k^2 - 1)^2 / R^4)
        = B (k^2 - 1)^2 / R^4 + T (k^2 - 1) / R^2 + S,   w = (N - k) Omega

with B = EI / (rho A), T = p0 b R / (rho A), S the sidewall's stiffness, a and b the losses of sidewall and bending. The
root with negative real part runs ahead of the contact and is seen by a sensor at order N - k, above N; that with a
positive one is behind it, below N. The imaginary part is the decay.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np

from gateway.types import ComplexArray

# kw / (rho A) of the ring paper's tire at 210 kPa. A factor of two moves an order by 0.1.
_SIDEWALL_PS2: Final = 1.8e5
_STEPS: Final = 12
_POLISH: Final = 6
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
    """One wave as the sensor sees it.

    Attributes:
        order: of the sensor's signal.
        decay_per_rad: over the angle from the contact's edge.
        share: change along the belt over that of the sensor's signal, k / (k - N).
        order_by: (5,) derivatives by the fields of `BlockTread`.
        decay_by: likewise.
        share_by: likewise.
    """

    order: float
    decay_per_rad: float
    share: float
    order_by: tuple[float, ...]
    decay_by: tuple[float, ...]
    share_by: tuple[float, ...]


@lru_cache(maxsize=16)
def belt_wave(tread: BlockTread, side: int, omega_radps: float, radius_m: float) -> BeltWave:
    """Return the wave ahead of the contact (side 0) or behind it (side 1)."""
    blocks = max(tread.blocks, _LEAST_BLOCKS)
    bending = max(tread.bending_m4ps2, _LEAST_BENDING)
    tension = max(tread.tension_m2ps2, _LEAST_TENSION)
    sign = -1.0 if side == 0 else 1.0
    at = complex(sign * _undamped(blocks, bending, tension, sign, omega_radps, radius_m))
    loss = tread.sidewall_loss_ps, tread.bending_loss_m4ps
    for _ in range(_POLISH):
        value, slope, by = _balance(at, blocks, bending, tension, *loss, omega_radps, radius_m)
        at -= value / slope
    _, slope, by = _balance(at, blocks, bending, tension, *loss, omega_radps, radius_m)
    number_by: ComplexArray = -by / slope
    for place, held in enumerate((blocks > tread.blocks, bending > tread.bending_m4ps2, tension > tread.tension_m2ps2)):
        if held:
            number_by[place] = 0.0
    order = blocks - at.real
    own = np.zeros(5)
    own[0] = float(blocks == tread.blocks)
    order_by = own - number_by.real
    return BeltWave(
        order=order,
        decay_per_rad=sign * at.imag,
        share=-at.real / order,
        order_by=tuple(order_by.tolist()),
        decay_by=tuple((sign * number_by.imag).tolist()),
        share_by=tuple((-(number_by.real * order - at.real * order_by) / order**2).tolist()),
    )


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
    moved = (1.0 + 1.0 / k**2) * w * w + 4.0 * omega * w / k - omega**2 * (k * k - 3.0)
    held = bending_nm2 * (k * k - 1.0) ** 2 / radius_m**4 + tension_n * (k * k - 1.0) / radius_m**2 + sidewall_npm2
    return held / moved if moved > 0.0 else math.nan


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
