"""Laminate theory against closed forms and limiting cases."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.forces.laminate import Ply, cord_ply, crossed_coupling_length, stack

RADIUS_M = 0.31
STEEL_MODULUS_PA, RUBBER_MODULUS_PA, STEEL_SHARE = 200e9, 6e6, 0.22


def steel_belt(angle_rad: float, thickness_m: float, inside: Sequence[Ply] = (), outside: Sequence[Ply] = ()):
    """Two equal steel plies at +angle (inner) and -angle (outer) that touch, between carcass and cap."""
    inner, outer = (
        cord_ply(
            cord_pa=STEEL_MODULUS_PA,
            rubber_pa=RUBBER_MODULUS_PA,
            cord_share=STEEL_SHARE,
            thickness_m=thickness_m,
            angle_rad=angle,
        )
        for angle in (angle_rad, -angle_rad)
    )
    return stack([*inside, inner, outer, *outside])


def isotropic(angle_rad: float = 0.0, thickness_m: float = 1e-3) -> Ply:
    modulus, poisson = 5e6, 0.4
    return Ply(modulus, modulus, modulus / (2 * (1 + poisson)), poisson, thickness_m, angle_rad)


def test_isotropic_ply_is_a_plate() -> None:
    plate = stack([isotropic()])
    rigidity = 5e6 * 1e-3**3 / (12 * (1 - 0.4**2))
    assert plate.bending[0, 0] == pytest.approx(rigidity)
    assert plate.bending[0, 1] == pytest.approx(0.4 * rigidity)
    assert plate.stretching[2, 2] == pytest.approx(5e6 / 2.8 * 1e-3)
    assert np.abs(plate.coupling).max() < 1e-12 * plate.stretching.max()


@given(st.floats(-math.pi, math.pi))
def test_isotropic_ply_has_no_direction(angle_rad: float) -> None:
    assert isotropic(angle_rad).stiffness() == pytest.approx(isotropic().stiffness(), rel=1e-9, abs=1e-3)


def test_split_ply_equals_whole_ply() -> None:
    whole = stack([isotropic(0.3, 2e-3)])
    halves = stack([isotropic(0.3), isotropic(0.3)])
    assert halves.matrix == pytest.approx(whole.matrix, rel=1e-9, abs=1e-9)


@given(st.floats(0.2, 1.2), st.floats(0.5e-3, 2e-3))
def test_crossed_plies_couple_bending_with_shear_only(angle_rad: float, separation_m: float) -> None:
    belt = steel_belt(angle_rad, separation_m)
    scale = belt.stretching[0, 0]
    assert abs(belt.stretching[0, 2]) < 1e-9 * scale  # Eq. 11
    assert abs(belt.stretching[1, 2]) < 1e-9 * scale
    assert abs(belt.coupling[0, 0]) < 1e-9 * scale * separation_m
    assert abs(belt.bending[0, 2]) < 1e-9 * scale * separation_m**2
    assert abs(belt.coupling[0, 2]) > 1e-3 * belt.stretching[2, 2] * separation_m
    assert belt.matrix == pytest.approx(belt.matrix.T)
    assert np.linalg.eigvalsh(belt.matrix).min() > 0.0


@pytest.mark.parametrize(
    ("separation_m", "expected_mm"), [(1.2e-3, (1.85, 1.48, 1.23, 1.04)), (1.6e-3, (2.46, 1.98, 1.64, 1.39))]
)
def test_coupling_length_matches_reference_values(separation_m: float, expected_mm: tuple[float, ...]) -> None:
    for degrees, expected in zip((18, 22, 26, 30), expected_mm, strict=True):
        belt = steel_belt(math.radians(degrees), separation_m)
        assert -belt.coupling_length_m * 1e3 == pytest.approx(expected, abs=0.006)
        assert belt.coupling_length_m == pytest.approx(
            crossed_coupling_length(math.radians(degrees), separation_m), rel=2e-3
        )
        assert 0.73e7 < belt.stretching[2, 2] < 2.7e7


def test_carcass_and_cap_matter_only_when_released() -> None:
    carcass = cord_ply(cord_pa=4e9, rubber_pa=6e6, cord_share=0.3, thickness_m=1e-3, angle_rad=math.pi / 2)
    cap = cord_ply(cord_pa=3e9, rubber_pa=6e6, cord_share=0.3, thickness_m=1e-3, angle_rad=0.0)
    bare, full = steel_belt(0.4, 1.2e-3), steel_belt(0.4, 1.2e-3, inside=[carcass], outside=[cap])
    assert full.coupling_length_m == pytest.approx(bare.coupling_length_m, rel=2e-3)
    # A strip that is free to twist hardly shears; cap and carcass resist the twist.
    assert abs(bare.released_coupling_length_m) < 0.1 * abs(bare.coupling_length_m)
    assert 0.5 < full.released_coupling_length_m / full.coupling_length_m < 0.9


def test_swapped_plies_change_the_sign() -> None:
    assert steel_belt(-0.4, 1.2e-3).coupling_length_m == pytest.approx(-steel_belt(0.4, 1.2e-3).coupling_length_m)


def test_flattened_belt_slopes_as_the_paper_measures() -> None:
    """The slope -k_x B16 / A66 with k_x = -1/R is a few tenths of a degree."""
    for degrees in (18, 22, 26, 30):
        length = steel_belt(math.radians(degrees), 1.2e-3).coupling_length_m
        assert 0.19 < math.degrees(abs(length / RADIUS_M)) < 0.37


def test_shear_per_curvature_is_minus_coupling_length() -> None:
    """Eq. 12: N_xy = k_y = k_xy = 0, N_x = N_y = 0, k_x imposed, solved on the full matrix."""
    belt = steel_belt(0.4, 1.2e-3)
    strain = np.linalg.solve(belt.stretching, -belt.coupling[:, 0])
    assert -belt.coupling_length_m == pytest.approx(strain[2])


@pytest.mark.parametrize(("change", "name"), [({"cord_share": 1.1}, "cord_share"), ({"rubber_pa": 0.0}, "rubber_pa")])
def test_invalid_ply_raises(change: dict[str, float], name: str) -> None:
    values = {"cord_pa": 2e11, "rubber_pa": 6e6, "cord_share": 0.2, "thickness_m": 1e-3, "angle_rad": 0.4} | change
    with pytest.raises(ValueError, match=name):
        cord_ply(**values)  # type: ignore[arg-type]


def test_mixture_reaches_both_pure_materials() -> None:
    rubber = cord_ply(cord_pa=2e11, rubber_pa=6e6, cord_share=0.0, thickness_m=1e-3, angle_rad=0.0)
    assert (rubber.along_pa, rubber.across_pa) == pytest.approx((6e6, 6e6))
    steel = cord_ply(cord_pa=2e11, rubber_pa=6e6, cord_share=1.0, thickness_m=1e-3, angle_rad=0.0)
    assert (steel.along_pa, steel.across_pa) == pytest.approx((2e11, 2e11))
