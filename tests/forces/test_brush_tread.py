"""Brush tread against closed forms on a rigid belt and a bristle-by-bristle solution."""

import math

import numpy as np
import pytest
from scipy.sparse import csc_array, eye_array

from gateway.forces.brush_tread import BrushContact, solve_brush_on_belt

COUNT, HALF_M, STIFFNESS, LOAD_N, FRICTION = 400, 0.075, 8e6, 4000.0, 0.9
STEP_M = 2 * HALF_M / COUNT
PLACE_M = -HALF_M + STEP_M * (np.arange(COUNT) + 1.0)
BOUND_M = FRICTION * 0.75 * LOAD_N / HALF_M * np.clip(1 - (PLACE_M / HALF_M) ** 2, 0, None) / STIFFNESS


def brush_on_given_belt(foot_m: np.ndarray, before_m: float, slip_angle_rad: float) -> BrushContact:
    """March from the leading edge along a belt of known lateral position: Eq. 19 and 20, bristle by bristle."""
    creep = STEP_M * math.tan(slip_angle_rad) - np.diff(foot_m, prepend=before_m)
    deflection = np.empty(COUNT)
    carried = 0.0
    for i, trial in enumerate(creep):
        carried = np.clip(carried + trial, -BOUND_M[i], BOUND_M[i])
        deflection[i] = carried
    return BrushContact(deflection, np.abs(deflection) == BOUND_M, 1)


def rigid_force(slip_angle_rad: float) -> float:
    contact = brush_on_given_belt(np.zeros(COUNT), 0.0, slip_angle_rad)
    return float(contact.deflection_m.sum() * STEP_M * STIFFNESS)


@pytest.mark.parametrize("slip_deg", [-3.0, -0.5, 0.1, 1.0, 2.0, 8.0])
def test_parabolic_pressure_gives_textbook_cubic(slip_deg: float) -> None:
    """F = 3 mu Q z (1 - |z| + z^2 / 3), z = tan(alpha) / tan(alpha at full sliding), mu Q beyond."""
    full = 3 * FRICTION * LOAD_N / (2 * STIFFNESS * HALF_M**2)
    z = math.tan(math.radians(slip_deg)) / full
    cubic = 3 * FRICTION * LOAD_N * z * (1 - abs(z) + z**2 / 3) if abs(z) < 1 else FRICTION * LOAD_N * np.sign(z)
    assert rigid_force(math.radians(slip_deg)) == pytest.approx(cubic, rel=5e-3)


def test_belt_slope_counts_as_slip() -> None:
    """d(delta)/ds = tan(alpha) - y': a belt that slopes by the slip angle stays undeflected."""
    slope = math.tan(0.01)
    foot = slope * STEP_M * np.arange(1, COUNT + 1)
    contact = brush_on_given_belt(foot, 0.0, 0.01)
    assert np.abs(contact.deflection_m).max() < 1e-12


def solve(stiffness_npm: float, slip_angle_rad: float = 0.02, bound: np.ndarray = BOUND_M) -> tuple:
    """Feet on independent springs to the ground; unknown 0 is the node before the contact."""
    belt = csc_array(stiffness_npm * eye_array(COUNT + 1))
    return solve_brush_on_belt(
        belt,
        np.zeros(COUNT + 1),
        np.arange(COUNT + 1),
        STIFFNESS * STEP_M,
        bound,
        slip_angle_rad=slip_angle_rad,
        step_m=STEP_M,
    )


def test_stiff_belt_equals_rigid_belt() -> None:
    _, contact = solve(1e12)
    rigid = brush_on_given_belt(np.zeros(COUNT), 0.0, 0.02)
    assert contact.deflection_m == pytest.approx(rigid.deflection_m, abs=1e-9)
    assert np.array_equal(contact.sliding, rigid.sliding)


def test_soft_belt_balances_bristles_within_friction() -> None:
    foot, contact = solve(3000.0)
    assert foot[1:] * 3000.0 == pytest.approx(STIFFNESS * STEP_M * contact.deflection_m)
    assert np.all(np.abs(contact.deflection_m) <= BOUND_M + 1e-12)
    # The same bristles follow from the belt's shape alone.
    again = brush_on_given_belt(foot[1:], foot[0], 0.02)
    assert contact.deflection_m == pytest.approx(again.deflection_m, abs=1e-12)
    assert contact.sliding.any()
    assert not contact.sliding.all()


def test_frictionless_bristles_stay_undeflected() -> None:
    _, contact = solve(3000.0, bound=np.zeros(COUNT))
    assert not contact.deflection_m.any()


def test_opposite_slip_mirrors_deflection() -> None:
    _, left = solve(3000.0)
    _, right = solve(3000.0, -0.02)
    assert left.deflection_m == pytest.approx(-right.deflection_m)
