"""Belts as stated with tolerances: coupling, its errors, and the ply steer that follows."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.forces.belt_laminate import BeltLaminate, StatedPly, coupling_law
from gateway.forces.laminate import crossed_coupling_length

DEG = math.radians(1.0)


def ply(angle_deg: float, share: float = 0.22) -> StatedPly:
    return StatedPly(angle_deg * DEG, 1.2e-3, 200e9, share, 1.0 * DEG, 0.05e-3, 20e9, 0.02)


BELT = BeltLaminate((ply(-24.0), ply(24.0)), 6e6, 1.2e6)


def test_two_crossed_plies_follow_the_closed_form() -> None:
    law = coupling_law(BELT)
    assert law.length_m.value == pytest.approx(crossed_coupling_length(-24.0 * DEG, 1.2e-3), rel=2e-3)
    assert law.imbalance == pytest.approx(0.0, abs=1e-12)
    assert law.b16_n.value / law.a66_npm.value == pytest.approx(law.length_m.value)
    # Twice the paper's phi_z, 0.11 to 0.18 deg for usual belts.
    assert 0.11 < 0.5 * law.slope(0.31).value / DEG < 0.18


def test_tolerances_match_random_belts() -> None:
    rng = np.random.default_rng(5)
    results = []
    for _ in range(400):
        plies = tuple(
            replace(
                layer,
                angle_rad=rng.normal(layer.angle_rad, layer.angle_std_rad),
                thickness_m=rng.normal(layer.thickness_m, layer.thickness_std_m),
                cord_pa=rng.normal(layer.cord_pa, layer.cord_std_pa),
                cord_share=rng.normal(layer.cord_share, layer.cord_share_std),
            )
            for layer in BELT.plies
        )
        laminate = replace(BELT, plies=plies, rubber_pa=rng.normal(6e6, 1.2e6)).laminate()
        results.append((laminate.coupling[0, 2], laminate.stretching[2, 2], laminate.coupling_length_m))
    law = coupling_law(BELT)
    stds = (law.b16_n.std, law.a66_npm.std, law.length_m.std)
    assert stds == pytest.approx(np.std(results, axis=0, ddof=1), rel=0.12)


def test_exact_statement_has_no_error() -> None:
    exact = replace(
        BELT, plies=tuple(StatedPly(p.angle_rad, p.thickness_m, p.cord_pa, p.cord_share) for p in BELT.plies)
    )
    assert coupling_law(replace(exact, rubber_std_pa=0.0)).length_m.std == 0.0
    assert coupling_law(BELT).slope(0.31, 0.0031).std > coupling_law(BELT).slope(0.31).std


def test_rubber_between_plies_adds_its_thickness() -> None:
    gap = StatedPly(0.0, 0.4e-3, 200e9, 0.0)
    wider = replace(BELT, plies=(BELT.plies[0], gap, BELT.plies[1]))
    ratio = coupling_law(wider).length_m.value / coupling_law(BELT).length_m.value
    assert ratio == pytest.approx(1.6 / 1.2, rel=0.01)


def test_outer_ply_turned_over_changes_the_sign() -> None:
    turned = replace(BELT, plies=BELT.plies[::-1])
    assert coupling_law(turned).length_m.value == pytest.approx(-coupling_law(BELT).length_m.value)


def test_unequal_angles_are_not_balanced() -> None:
    assert abs(coupling_law(replace(BELT, plies=(ply(-18.0), ply(30.0)))).imbalance) > 0.2


def test_free_strip_shears_far_less_than_a_held_belt() -> None:
    law = coupling_law(BELT)
    assert 0.0 < law.released_length_m.value < 0.15 * law.length_m.value
