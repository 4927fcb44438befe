"""Classical laminate theory of a steel belt: a belt of crossed plies shears when it is bent.

Ply steer paper, Eq. 10 to 18, with its misprints repaired (docs/explanation/ply-steer.md): gamma is engineering shear
throughout, as Eq. 13 needs (Eq. 14's factor one half is dropped); Eq. 13 is the N_xy row of Eq. 10 and Eq. 18's angle
phi_z is half of the belt's slope.

The simulator uses the closed form `crossed_coupling_length`. For a belt whose plies are known, build it with `cord_ply`
and `stack`, and pass `Laminate.coupling_length_m` to `lateral_belt.LateralBelt`:

    inner, outer = (
        cord_ply(cord_pa=200e9, rubber_pa=6e6, cord_share=0.22, thickness_m=1.2e-3, angle_rad=angle)
        for angle in (0.4, -0.4)
    )
    belt = LateralBelt(coupling_length_m=stack([inner, outer]).coupling_length_m)

Axes: x along the belt, y across it, z outward; ply angles from x towards y; plies are listed from the inside out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gateway.core.types import FloatArray

# Rubber is incompressible; 0.49 keeps its constants finite.
RUBBER_POISSON_RATIO: Final = 0.49
STEEL_POISSON_RATIO: Final = 0.3


@dataclass(frozen=True, slots=True)
class Ply:
    """One layer of parallel cords in rubber.

    Attributes:
        along_pa: E1, modulus along the cords.
        across_pa: E2, modulus across them.
        shear_pa: G12.
        poisson_ratio: nu12.
        thickness_m: of the layer.
        angle_rad: of the cords from the belt's length.
    """

    along_pa: float
    across_pa: float
    shear_pa: float
    poisson_ratio: float
    thickness_m: float
    angle_rad: float

    def stiffness(self) -> FloatArray:
        """Return the plane-stress stiffness in the belt's axes, (3, 3), Pa, for (eps_x, eps_y, gamma_xy)."""
        minor = self.poisson_ratio * self.across_pa / self.along_pa
        denominator = 1.0 - self.poisson_ratio * minor
        cord_stiffness = np.array(
            [
                [self.along_pa, self.poisson_ratio * self.across_pa, 0.0],
                [self.poisson_ratio * self.across_pa, self.across_pa, 0.0],
                [0.0, 0.0, self.shear_pa * denominator],
            ]
        )
        c, s = math.cos(self.angle_rad), math.sin(self.angle_rad)
        # Strain in the cords' axes from strain in the belt's axes, engineering shear.
        to_cord = np.array([[c * c, s * s, c * s], [s * s, c * c, -c * s], [-2.0 * c * s, 2.0 * c * s, c * c - s * s]])
        result: FloatArray = to_cord.T @ cord_stiffness @ to_cord / denominator
        return result


@dataclass(frozen=True, slots=True)
class Laminate:
    """Stiffness of a stack of plies per width (Eq. 10): (N, M) = [[A, B], [B, D]] (eps0, k).

    Attributes:
        stretching: A, (3, 3), N/m.
        coupling: B, (3, 3), N.
        bending: D, (3, 3), N m.
    """

    stretching: FloatArray
    coupling: FloatArray
    bending: FloatArray

    @property
    def matrix(self) -> FloatArray:
        """The 6 by 6 of Eq. 10."""
        result: FloatArray = np.block([[self.stretching, self.coupling], [self.coupling, self.bending]])
        return result

    @property
    def coupling_length_m(self) -> float:
        """B16 / A66: minus the shear per curvature of a belt bent along its length only (Eq. 12 and 13).

        The slope of the streamline, which a sensor on the belt measures, is dv/dx = gamma = -k_x B16 / A66. The paper's
        bending-twisting angle phi_z (Eq. 18) is half of it.
        """
        return float(self.coupling[0, 2] / self.stretching[2, 2])

    @property
    def released_coupling_length_m(self) -> float:
        """Coupling length of a narrow strip that is free to curve across and to twist: only k_x is imposed.

        Eq. 12 holds the belt from curving across and twisting. A tire's belt lies between the two.
        """
        others = [0, 1, 2, 4, 5]
        strain = np.linalg.solve(self.matrix[np.ix_(others, others)], -self.matrix[others, 3])
        return float(-strain[2])


def cord_ply(
    *,
    cord_pa: float,
    rubber_pa: float,
    cord_share: float,
    thickness_m: float,
    angle_rad: float,
) -> Ply:
    """Return a ply of cords in rubber: rule of mixtures along (E1, nu12), Halpin-Tsai across (E2, xi 2; G12, xi 1).

    Args:
        cord_pa: modulus of the cord along itself.
        rubber_pa: modulus of the rubber.
        cord_share: volume share of the cords, between 0 and 1.
        thickness_m: of the ply.
        angle_rad: of the cords from the belt's length.

    Raises:
        ValueError: a share outside 0 to 1, or a modulus or thickness that is not positive.
    """
    if not 0.0 <= cord_share <= 1.0:
        raise ValueError(f"cord_share must lie between 0 and 1, not {cord_share:g}")
    for name, value in (("cord_pa", cord_pa), ("rubber_pa", rubber_pa), ("thickness_m", thickness_m)):
        if not value > 0.0:
            raise ValueError(f"{name} must be positive, not {value:g}")
    cord_shear = cord_pa / (2.0 * (1.0 + STEEL_POISSON_RATIO))
    rubber_shear = rubber_pa / (2.0 * (1.0 + RUBBER_POISSON_RATIO))
    return Ply(
        along_pa=cord_share * cord_pa + (1.0 - cord_share) * rubber_pa,
        across_pa=_halpin_tsai(cord_pa, rubber_pa, cord_share, 2.0),
        shear_pa=_halpin_tsai(cord_shear, rubber_shear, cord_share, 1.0),
        poisson_ratio=cord_share * STEEL_POISSON_RATIO + (1.0 - cord_share) * RUBBER_POISSON_RATIO,
        thickness_m=thickness_m,
        angle_rad=angle_rad,
    )


def stack(plies: Sequence[Ply]) -> Laminate:
    """Return the laminate of plies listed from the inside out, about the middle of its thickness."""
    edges = np.cumsum([0.0, *(ply.thickness_m for ply in plies)])
    edges -= 0.5 * edges[-1]
    laminate = [np.zeros((3, 3)) for _ in range(3)]
    for ply, low, high in zip(plies, edges[:-1], edges[1:], strict=True):
        stiffness = ply.stiffness()
        for power, total in enumerate(laminate, start=1):
            total += stiffness * (high**power - low**power) / power
    return Laminate(*laminate)


def crossed_coupling_length(angle_rad: float, separation_m: float) -> float:
    """Return B16 / A66 of two crossed plies of inextensible cords: -(t_sep / 2) cot(delta)."""
    return -0.5 * separation_m / math.tan(angle_rad)


def _halpin_tsai(cord: float, rubber: float, share: float, shape: float) -> float:
    ratio = cord / rubber
    eta = (ratio - 1.0) / (ratio + shape)
    return rubber * (1.0 + shape * eta * share) / (1.0 - eta * share)
