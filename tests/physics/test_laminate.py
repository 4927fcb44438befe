"""Laminate theory against closed forms and its own limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.physics.laminate import (
    Ply,
    belt_slope,
    bending_twisting_angle,
    cord_ply,
    crossed_coupling_length,
    stack,
    steel_belt,
)

RADIUS_M = 0.31


def isotropic(angle_rad: float = 0.0, thickness_m: float = 1e-3) -> Ply:
    modulus, poisson = 5e6, 0.4
    return Ply(modulus, modulus, modulus / (2 * (1 + poisson)), poisson, thickness_m, angle_rad)


def test_one_isotropic_ply_is_a_plate() -> None:
    plate = stack([isotropic()])
    rigidity = 5e6 * 1e-3**3 / (12 * (1 - 0.4**2))
    assert plate.bending[0, 0] == pytest.approx(rigidity)
    assert plate.bending[0, 1] == pytest.approx(0.4 * rigidity)
    assert plate.stretching[2, 2] == pytest.approx(5e6 / 2.8 * 1e-3)
    assert np.abs(plate.coupling).max() < 1e-12 * plate.stretching.max()


@given(st.floats(-math.pi, math.pi))
def test_an_isotropic_ply_does_not_care_how_it_lies(angle_rad: float) -> None:
    assert isotropic(angle_rad).stiffness() == pytest.approx(isotropic().stiffness(), rel=1e-9, abs=1e-3)


def test_cutting_a_ply_in_two_changes_nothing() -> None:
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
def test_coupling_length_agrees_with_the_reference_study(separation_m: float, expected_mm: tuple[float, ...]) -> None:
    for degrees, expected in zip((18, 22, 26, 30), expected_mm, strict=True):
        belt = steel_belt(math.radians(degrees), separation_m)
        assert -belt.coupling_length_m * 1e3 == pytest.approx(expected, abs=0.006)
        assert belt.coupling_length_m == pytest.approx(
            crossed_coupling_length(math.radians(degrees), separation_m), rel=2e-3
        )
        assert 0.73e7 < belt.stretching[2, 2] < 2.7e7


def test_carcass_and_cap_hardly_matter_while_the_belt_is_held_from_twisting() -> None:
    carcass = cord_ply(cord_pa=4e9, rubber_pa=6e6, cord_share=0.3, thickness_m=1e-3, angle_rad=math.pi / 2)
    cap = cord_ply(cord_pa=3e9, rubber_pa=6e6, cord_share=0.3, thickness_m=1e-3, angle_rad=0.0)
    bare, full = steel_belt(0.4, 1.2e-3), steel_belt(0.4, 1.2e-3, inside=[carcass], outside=[cap])
    assert full.coupling_length_m == pytest.approx(bare.coupling_length_m, rel=2e-3)
    # A strip that is free to twist hardly shears at all; cap and carcass hold it back.
    assert abs(bare.released_coupling_length_m) < 0.1 * abs(bare.coupling_length_m)
    assert 0.5 < full.released_coupling_length_m / full.coupling_length_m < 0.9


def test_swapping_the_plies_turns_the_sign() -> None:
    assert steel_belt(-0.4, 1.2e-3).coupling_length_m == pytest.approx(-steel_belt(0.4, 1.2e-3).coupling_length_m)


def test_flattened_belt_slopes_by_a_few_tenths_of_a_degree() -> None:
    """Eq. 18 with k_x = -1/R gives the size the paper measures, and half of the slope that it measures."""
    for degrees in (18, 22, 26, 30):
        length = steel_belt(math.radians(degrees), 1.2e-3).coupling_length_m
        slope = math.degrees(abs(belt_slope(length, -1.0 / RADIUS_M)))
        assert 0.19 < slope < 0.37
        assert math.degrees(abs(bending_twisting_angle(length, -1.0 / RADIUS_M))) == pytest.approx(0.5 * slope)


def test_shear_from_the_whole_law_under_the_papers_conditions() -> None:
    """Eq. 12: N_xy = k_y = k_xy = 0, N_x = N_y = 0, k_x imposed, solved on the full matrix."""
    belt = steel_belt(0.4, 1.2e-3)
    strain = np.linalg.solve(belt.stretching, -belt.coupling[:, 0])
    assert belt_slope(belt.coupling_length_m, 1.0) == pytest.approx(strain[2])


@pytest.mark.parametrize(("change", "name"), [({"cord_share": 1.1}, "cord_share"), ({"rubber_pa": 0.0}, "rubber_pa")])
def test_impossible_plies_are_named(change: dict[str, float], name: str) -> None:
    values = {"cord_pa": 2e11, "rubber_pa": 6e6, "cord_share": 0.2, "thickness_m": 1e-3, "angle_rad": 0.4} | change
    with pytest.raises(ValueError, match=name):
        cord_ply(**values)  # type: ignore[arg-type]


def test_mixture_limits() -> None:
    rubber = cord_ply(cord_pa=2e11, rubber_pa=6e6, cord_share=0.0, thickness_m=1e-3, angle_rad=0.0)
    assert (rubber.along_pa, rubber.across_pa) == pytest.approx((6e6, 6e6))
    steel = cord_ply(cord_pa=2e11, rubber_pa=6e6, cord_share=1.0, thickness_m=1e-3, angle_rad=0.0)
    assert (steel.along_pa, steel.across_pa) == pytest.approx((2e11, 2e11))
