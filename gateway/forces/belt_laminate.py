"""Laminate of a tire's belt as stated with tolerances, and the ply steer that follows from it."""

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from gateway.core.types import FloatArray
from gateway.forces.laminate import Laminate, cord_ply, stack

# Relative lower limit of a modulus or thickness within its tolerance.
_MIN_FRACTION = 1e-3


@dataclass(frozen=True, slots=True)
class StatedPly:
    """One ply with the standard errors of its values.

    Attributes:
        angle_rad: of the cords from the belt's length, positive to the left of forward.
        thickness_m: of the ply with its rubber.
        cord_pa: modulus of the cords along themselves.
        cord_share: volume share of the cords, 0 for a layer of rubber.
        angle_std_rad: one standard error.
        thickness_std_m: one standard error.
        cord_std_pa: one standard error.
        cord_share_std: one standard error.
    """

    angle_rad: float
    thickness_m: float
    cord_pa: float
    cord_share: float
    angle_std_rad: float = 0.0
    thickness_std_m: float = 0.0
    cord_std_pa: float = 0.0
    cord_share_std: float = 0.0


@dataclass(frozen=True, slots=True)
class BeltLaminate:
    """Plies of a belt from the inside out, and their rubber.

    Attributes:
        plies: from the inside out.
        rubber_pa: modulus of the rubber between the cords.
        rubber_std_pa: one standard error, common to all plies.
    """

    plies: tuple[StatedPly, ...]
    rubber_pa: float
    rubber_std_pa: float = 0.0

    def laminate(self) -> Laminate:
        """Return the stiffness of the stated values."""
        return stack(
            [
                cord_ply(
                    cord_pa=ply.cord_pa,
                    rubber_pa=self.rubber_pa,
                    cord_share=ply.cord_share,
                    thickness_m=ply.thickness_m,
                    angle_rad=ply.angle_rad,
                )
                for ply in self.plies
            ]
        )


class Tolerated(NamedTuple):
    """A value with the standard error that the stated tolerances give it."""

    value: float
    std: float


@dataclass(frozen=True, slots=True)
class CouplingLaw:
    """Bending-shear coupling of a laminate (ply steer paper, Eq. 10 to 18).

    Attributes:
        b16_n: B16.
        a66_npm: A66.
        length_m: B16 / A66 of a belt that is kept from twisting and from curving across (Eq. 12).
        released_length_m: the same of a strip that is free to do both.
        imbalance: A16 / A66, 0 for plies at opposite angles (Eq. 11).
    """

    b16_n: Tolerated
    a66_npm: Tolerated
    length_m: Tolerated
    released_length_m: Tolerated
    imbalance: float

    def slope(self, radius_m: float, radius_std_m: float = 0.0) -> Tolerated:
        """Return the slope of a belt bent flat, -k_x B16 / A66 at k_x = -1 / R: twice the paper's phi_z (Eq. 18)."""
        value = self.length_m.value / radius_m
        return Tolerated(value, math.hypot(self.length_m.std / radius_m, value * radius_std_m / radius_m))


@lru_cache(maxsize=64)
def coupling_law(belt: BeltLaminate) -> CouplingLaw:
    """Return the coupling of a belt with its standard errors.

    The tolerances are independent of each other, apart from the rubber's, which all plies share. Each moves the result
    by half its change from one standard error below to one above.
    """
    laminate = belt.laminate()
    moves = [_delta(replace(belt, rubber_pa=_clamp(belt.rubber_pa, sign * belt.rubber_std_pa)) for sign in (-1.0, 1.0))]
    for index, ply in enumerate(belt.plies):
        for lower, upper in _one_by_one(ply):
            moves.append(
                _delta(
                    replace(belt, plies=(*belt.plies[:index], changed, *belt.plies[index + 1 :]))
                    for changed in (lower, upper)
                )
            )
    stds = np.sqrt(np.sum(np.square(moves), axis=0)).tolist()
    b16, a66, length, released_length = (
        Tolerated(value, std) for value, std in zip(_values(laminate).tolist(), stds, strict=True)
    )
    return CouplingLaw(b16, a66, length, released_length, float(laminate.stretching[0, 2] / laminate.stretching[2, 2]))


def _one_by_one(ply: StatedPly) -> list[tuple[StatedPly, StatedPly]]:
    """Return the ply with each of its values one standard error lower and higher."""
    shares = [min(max(ply.cord_share + sign * ply.cord_share_std, 0.0), 1.0) for sign in (-1.0, 1.0)]
    pairs = [
        tuple(replace(ply, angle_rad=ply.angle_rad + sign * ply.angle_std_rad) for sign in (-1.0, 1.0)),
        tuple(replace(ply, thickness_m=_clamp(ply.thickness_m, sign * ply.thickness_std_m)) for sign in (-1.0, 1.0)),
        tuple(replace(ply, cord_pa=_clamp(ply.cord_pa, sign * ply.cord_std_pa)) for sign in (-1.0, 1.0)),
        tuple(replace(ply, cord_share=share) for share in shares),
    ]
    return [(lower, upper) for lower, upper in pairs]


def _delta(belts: Iterable[BeltLaminate]) -> FloatArray:
    lower, upper = (_values(belt.laminate()) for belt in belts)
    result: FloatArray = 0.5 * (upper - lower)
    return result


def _values(laminate: Laminate) -> FloatArray:
    return np.array(
        [
            laminate.coupling[0, 2],
            laminate.stretching[2, 2],
            laminate.coupling_length_m,
            laminate.released_coupling_length_m,
        ]
    )


def _clamp(value: float, change: float) -> float:
    return max(value + change, _MIN_FRACTION * value)
