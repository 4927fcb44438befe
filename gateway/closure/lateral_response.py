"""What the belt does sideways when it is sheared, curved or dragged in the contact: unit responses for the effects.

A shear-flexible beam under tension on the lateral sidewall, a tread that sticks to the road, in closed form order by
order of the wheel. It shares the beam's equations with `gateway.physics.lateral_belt` (docs/ply-steer.md) but neither
its grid nor its sliding nor its uneven tension, and it needs nothing of the ring but the waveform and the edges:
per length of belt and order k = n / R,

    y D = f - B (i k gamma0 + kappa0),   B = EI k^2 / (1 + EI k^2 / Ks),   D = k^2 (B + T) + ky

with gamma0 = -g dkappa (ply steer), kappa0 = -beta dkappa (a cone) and f = cy (alpha s - y + y(leading edge)) of the
sticking tread in the contact.
"""

from __future__ import annotations

from enum import IntEnum
from functools import lru_cache
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gateway.closure.effects.base import Here

FloatArray = NDArray[np.float64]

# A 205/55R16 car tire's belt; `Stiffness` fits what differs from it. Only ratios of them matter for the shape.
SHEAR_STIFFNESS_N: Final = 1.6e6
BENDING_STIFFNESS_NM2: Final = 1e3
SIDEWALL_STIFFNESS_NPM2: Final = 2.5e5
TREAD_STIFFNESS_NPM2: Final = 8e6
# Half of the sidewall's stiffness is carried by pressure, half by its structure.
_REFERENCE_PA: Final = 2.1e5
_PRESSURE_SHARE: Final = 0.5
# Tension is p0 b R with the ring paper's b / R, less about half of the third that a contact takes off.
_TENSION_NUMBER: Final = 0.195 * 0.85
_HIGHEST_ORDER: Final = 160
_POINTS: Final = 64
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(_POINTS)
# The belt's answer to a push is looked up by angle in a table so fine that a straight line between two of its points
# is right to 0.2 % of the highest order. A product of matrices would do too, but small ones are slow on many threads.
_TABLE: Final = 8192


class Load(IntEnum):
    """What bends the belt sideways; the unit of each is that of its parameter."""

    PLY_STEER = 0  # metre of coupling length g = B16 / A66
    CONE = 1  # radian of the cone's half angle
    SLIP = 2  # radian of slip angle


class Stiffness(NamedTuple):
    """Logarithms of the stiffnesses over the nominal ones; 0 is nominal."""

    bending_ln: float = 0.0
    sidewall_ln: float = 0.0
    tread_ln: float = 0.0


class Response(NamedTuple):
    """Lateral acceleration over omega^2 by a unit of a load.

    Attributes:
        lateral_m: (FIELD_SIZE,) d2y/dtheta2.
        derivative_m: (3, FIELD_SIZE) by the logarithms of `Stiffness`.
        side_force_n: of the road on the tire.
    """

    lateral_m: FloatArray
    derivative_m: FloatArray
    side_force_n: float


def unit_response(here: Here, load: Load, stiffness: Stiffness) -> Response:
    """Return the response on the belt's shape at `here`; quick when the shape was seen before.

    The curvature comes from the radial waveform, kappa - 1/R = (s - mean s) / R^2: exact for a sensor on the neutral
    layer, within 2 e/R of itself below it.
    """
    radial = np.ascontiguousarray(here.shape.radial_m, dtype=np.float64)
    at = here.conditions
    edges = here.leading_edge_rad, here.trailing_edge_rad
    return _solved(radial.tobytes(), edges, at.radius_m, at.pressure_pa, load, stiffness)


@lru_cache(maxsize=256)
def _solved(
    radial: bytes, edges: tuple[float, float], radius_m: float, pressure_pa: float, load: Load, at: Stiffness
) -> Response:
    shape = np.frombuffer(radial)
    size = len(shape)
    orders = np.arange(min(_HIGHEST_ORDER, size // 2 - 1) + 1)
    # The grid begins at -pi: turned, a coefficient belongs to exp(i n theta).
    turn = np.where(orders % 2, -1.0, 1.0)
    bent = np.fft.rfft(shape - shape.mean())[: len(orders)] * turn / (size * radius_m**2)
    k2 = (orders / radius_m) ** 2
    bending = BENDING_STIFFNESS_NM2 * np.exp(at.bending_ln)
    tread = TREAD_STIFFNESS_NPM2 * np.exp(at.tread_ln)
    share = 1.0 + _PRESSURE_SHARE * (pressure_pa / _REFERENCE_PA - 1.0)
    sidewall = SIDEWALL_STIFFNESS_NPM2 * share * np.exp(at.sidewall_ln)
    soft = 1.0 + bending * k2 / SHEAR_STIFFNESS_N
    beam = bending * k2 / soft
    whole = k2 * (beam + _TENSION_NUMBER * pressure_pa * radius_m**2) + sidewall
    # By the logarithms of bending, sidewall and tread.
    beam_slope = np.stack([beam / soft, np.zeros_like(beam), np.zeros_like(beam)])
    whole_slope = np.stack([k2 * beam / soft, np.full_like(beam, sidewall), np.zeros_like(beam)])

    forcing = {Load.PLY_STEER: 1j * orders / radius_m * bent, Load.CONE: bent, Load.SLIP: np.zeros_like(bent)}[load]
    free = forcing * beam / whole
    free_slope = forcing * (beam_slope / whole - beam * whole_slope / whole**2)

    half = 0.5 * (edges[1] - edges[0])
    theta = 0.5 * (edges[0] + edges[1]) + half * _NODES
    weight = half * radius_m * _WEIGHTS
    phase = np.exp(1j * np.outer(orders, np.append(theta, edges[0])))
    twice = np.where(orders == 0, 1.0, 2.0)
    apart = np.append(theta, edges[0])[:, None] - theta
    place = np.mod(apart, 2.0 * np.pi) * (_TABLE / (2.0 * np.pi))
    before = place.astype(np.intp)
    share_after = place - before

    # Where the belt would be at the tread's points against the leading edge, and what pushes there do to that.
    def beside_edge(shapes: NDArray[np.complex128]) -> FloatArray:
        values: FloatArray = (twice * shapes @ phase).real
        return values[..., :-1] - values[..., -1:]

    def influence(compliance: FloatArray) -> FloatArray:
        answer = np.fft.irfft(compliance, n=_TABLE) * (_TABLE / (2.0 * np.pi * radius_m))
        answer = np.append(answer, answer[:1])
        matrix = answer[before] * (1.0 - share_after) + answer[before + 1] * share_after
        return (matrix[:-1] - matrix[-1:]) * weight

    system = influence(1.0 / whole)
    system[np.diag_indices(_POINTS)] += 1.0 / tread
    drag = radius_m * (theta - edges[0]) if load is Load.SLIP else 0.0
    push = np.linalg.solve(system, drag - beside_edge(free))
    changed = np.stack([-influence(slope / whole**2) @ push for slope in whole_slope[:2]] + [-push / tread])
    push_slope = np.linalg.solve(system, (-beside_edge(free_slope) - changed).T).T

    back = phase[:, :-1].conj().T / (2.0 * np.pi * radius_m)
    pushed = (push * weight) @ back
    pushed_slope = (push_slope * weight) @ back
    shapes = np.empty((4, len(orders)), dtype=np.complex128)
    shapes[0] = free + pushed / whole
    shapes[1:] = free_slope + pushed_slope / whole - pushed * whole_slope / whole**2
    spectrum = np.zeros((4, size // 2 + 1), dtype=np.complex128)
    spectrum[:, : len(orders)] = -(orders**2) * shapes * turn * size
    fields = np.fft.irfft(spectrum, n=size)
    fields.setflags(write=False)
    return Response(fields[0], fields[1:], float(push @ weight))
