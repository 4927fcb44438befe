"""Lateral belt against force balance, closed forms and the findings of the ply steer paper."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.forces.lateral_belt import LateralBelt, LateralSolution, ring_tension, solve_lateral_belt
from gateway.ring.rolling_ring import RingParameters, RingSolution, solve_rolling_ring

RADIUS_M, PRESSURE_PA, LOAD_N = 0.31, 2.5e5, 400 * STANDARD_GRAVITY_MPS2
OMEGA_RADPS = 60.0 / 3.6 / RADIUS_M
RING = RingParameters.from_numbers(3.0833e-3, 0.1953, 2.72, 2.31, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA)
BELT = LateralBelt()


@lru_cache(maxsize=4)
def radial(nodes: int = 1440, omega_radps: float = OMEGA_RADPS) -> RingSolution:
    return solve_rolling_ring(RING, LOAD_N, PRESSURE_PA, omega_radps, nodes=nodes)


def solve(belt: LateralBelt = BELT, slip_deg: float = 0.0, **options: bool) -> LateralSolution:
    return solve_lateral_belt(radial(), belt, slip_angle_rad=math.radians(slip_deg), **options)


def mirrored(values: np.ndarray) -> np.ndarray:
    """Return the values at -theta."""
    return np.roll(values[::-1], 1)


def large_extrema(lateral: np.ndarray) -> list[float]:
    """Return the signs of the extrema of at least a third of the largest; neighbours of equal sign count once."""
    inner = lateral[1:-1]
    turns = (inner - lateral[:-2]) * (lateral[2:] - inner) <= 0.0
    signs = [float(np.sign(v)) for v in inner[turns] if abs(v) > np.abs(lateral).max() / 3.0]
    return [sign for i, sign in enumerate(signs) if i == 0 or sign != signs[i - 1]]


def test_static_shape_is_odd_and_sinusoidal() -> None:
    """Paper, finding 1: sinusoidal under load alone. Odd about the contact centre, one wave of either sign."""
    still = solve(rolling=False)
    even = 0.5 * (still.y_m + mirrored(still.y_m))
    assert np.sqrt(np.mean(even**2)) < 1e-4 * np.sqrt(np.mean(still.y_m**2))
    assert still.y_m.max() == pytest.approx(0.18e-3, abs=0.02e-3)
    assert still.side_force_n == 0.0
    # From the centre to the largest extremum there is one sign on either side.
    before = still.y_m[(still.theta_rad < -0.02) & (still.theta_rad > -0.5)]
    assert np.all(before < 0.0)


def test_rolling_shape_lies_on_one_side() -> None:
    """Finding 2: once rolling, the deformation is mainly oriented to one side."""
    moving = solve()
    assert moving.y_m.min() < -0.5e-3
    assert moving.y_m.max() < 0.1 * -moving.y_m.min()
    assert moving.side_force_n < -50.0


def test_rolling_minus_static_has_one_sign() -> None:
    """Finding 3: the difference has one sign and one extremum, near the contact."""
    change = solve().y_m - solve(rolling=False).y_m
    assert change.max() < 0.02 * -change.min()
    assert abs(radial().theta_rad[np.argmin(change)]) < radial().half_angle_rad


def test_zero_slip_acceleration_has_measured_size() -> None:
    moving = solve()
    high, low = moving.lateral_mps2.argmax(), moving.lateral_mps2.argmin()
    assert moving.lateral_mps2[high] == pytest.approx(30.0, abs=4.0)
    assert moving.lateral_mps2[low] == pytest.approx(-25.0, abs=4.0)
    assert radial().leading_edge_rad < moving.theta_rad[high] < -0.1
    assert 0.1 < moving.theta_rad[low] < radial().trailing_edge_rad
    assert math.degrees(moving.slope_rad.max()) == pytest.approx(0.21, abs=0.02)
    assert large_extrema(moving.lateral_mps2) == [1.0, -1.0]


def test_extrema_depend_on_sign_of_slip() -> None:
    assert large_extrema(solve(slip_deg=-1.0).lateral_mps2) == [1.0]
    assert large_extrema(solve(slip_deg=1.0).lateral_mps2) == [1.0, -1.0]


def test_no_coupling_gives_symmetric_slip() -> None:
    plain = replace(BELT, coupling_length_m=0.0)
    assert not solve(plain).y_m.any()
    remainder, right = solve(plain, 1.0), solve(plain, -1.0)
    assert remainder.lateral_mps2 == pytest.approx(-right.lateral_mps2, abs=1e-9)


def test_other_ply_order_mirrors_solution() -> None:
    other = solve(replace(BELT, coupling_length_m=-BELT.coupling_length_m), -1.0)
    assert other.y_m == pytest.approx(-solve(slip_deg=1.0).y_m, abs=1e-12)


def test_conicity_keeps_sign_when_reversed() -> None:
    cone = replace(BELT, coupling_length_m=0.0, conicity_rad=0.01)
    alone = solve(cone).side_force_n
    assert abs(alone) > 5.0
    # Rolling in the other direction mirrors the tire: the coupling changes sign, the cone does not.
    forward = solve(replace(BELT, conicity_rad=0.01)).side_force_n
    reverse = solve(replace(BELT, conicity_rad=0.01, coupling_length_m=-BELT.coupling_length_m)).side_force_n
    assert 0.5 * (forward + reverse) == pytest.approx(alone, rel=0.02)
    assert 0.5 * (forward - reverse) == pytest.approx(solve().side_force_n, rel=0.02)


@pytest.mark.parametrize("friction", [1.0, 0.3])
@pytest.mark.parametrize("slip_deg", [-2.0, 0.0, 0.7, 4.0])
def test_road_balances_sidewall(friction: float, slip_deg: float) -> None:
    shape = solve(replace(BELT, friction=friction), slip_deg)
    length = RADIUS_M * 2 * math.pi / len(shape.theta_rad)
    sidewall = -BELT.sidewall_stiffness_npm2 * length * shape.y_m.sum()
    assert shape.side_force_n == pytest.approx(-sidewall, abs=1e-5 * LOAD_N)
    bound = friction * radial().contact_pressure_npm / BELT.tread_stiffness_npm2
    assert np.all(np.abs(shape.deflection_m) <= bound + 1e-12)


def test_full_sliding_reaches_friction_limit() -> None:
    gone = solve(replace(BELT, friction=0.2), 10.0)
    assert gone.side_force_n == pytest.approx(0.2 * LOAD_N, rel=1e-3)
    assert abs(gone.aligning_moment_nm) < 1e-3 * 0.2 * LOAD_N


def test_slip_gives_side_force_and_aligning_moment() -> None:
    for sign in (-1.0, 1.0):
        change = solve(slip_deg=sign).side_force_n - solve().side_force_n
        moment = solve(slip_deg=sign).aligning_moment_nm - solve().aligning_moment_nm
        assert sign * change > 500.0
        assert sign * moment < -5.0


def test_harmonic_forcing_matches_timoshenko_beam() -> None:
    """At a light load, order n of the static shape equals the beam's closed form."""
    ring = solve_rolling_ring(RING, 20.0, PRESSURE_PA, OMEGA_RADPS, nodes=2880)
    shape = solve_lateral_belt(ring, BELT, rolling=False)
    curvature = np.fft.rfft(ring.curvature_pm - 1.0 / RADIUS_M)
    result = np.fft.rfft(shape.y_m)
    n = np.arange(1, 21)
    k = n / RADIUS_M
    tension = PRESSURE_PA * RING.tension_width_m * RADIUS_M
    shear, bend = BELT.shear_stiffness_n, BELT.bending_stiffness_nm2
    # With psi eliminated, the shear force is effective * (y' - gamma0), gamma0 = -g (kappa - 1/R).
    effective = shear * bend * k**2 / (shear + bend * k**2)
    forcing = 1j * k * effective * BELT.coupling_length_m * curvature[1:21]
    expected = forcing / ((effective + tension) * k**2 + BELT.sidewall_stiffness_npm2)
    assert np.abs(result[1:21] - expected).max() < 5e-3 * np.abs(expected).max()


def test_solution_does_not_depend_on_grid_and_speed() -> None:
    base = solve()
    fine = solve_lateral_belt(radial(3600), BELT)
    fast = solve_lateral_belt(radial(1440, 2 * OMEGA_RADPS), BELT)
    assert fine.side_force_n == pytest.approx(base.side_force_n, rel=5e-3)
    assert fine.slope_rad.max() == pytest.approx(base.slope_rad.max(), rel=2e-3)
    assert fast.lateral_m == pytest.approx(base.lateral_m, abs=1e-3 * np.abs(base.lateral_m).max())


def test_waveform_is_kinematics_plus_camber() -> None:
    shape = solve_lateral_belt(radial(), BELT, camber_rad=0.03)
    step = shape.theta_rad[1] - shape.theta_rad[0]
    second = (np.roll(shape.y_m, -1) - 2 * shape.y_m + np.roll(shape.y_m, 1)) / step**2
    assert shape.lateral_m == pytest.approx(second, abs=0.03 * np.abs(second).max())
    felt = shape.specific_force(40.0, 9.8)
    assert felt - 1600.0 * shape.lateral_m == pytest.approx(np.full(1440, 9.8 * math.sin(0.03)))
    assert shape.lateral_m.mean() == pytest.approx(0.0, abs=1e-12)


def test_tension_falls_in_contact() -> None:
    tension = ring_tension(radial())
    inflated = PRESSURE_PA * RING.tension_width_m * RADIUS_M
    inside = np.abs(radial().theta_rad) < 0.1
    assert tension[inside].mean() < 0.9 * inflated
    assert 0.5 * inflated < tension.min() < tension.max() < 1.2 * inflated


@pytest.mark.parametrize("name", ["shear_stiffness_n", "bending_stiffness_nm2", "tread_stiffness_npm2"])
def test_invalid_stiffness_raises(name: str) -> None:
    with pytest.raises(ValueError, match=name):
        solve(replace(BELT, **{name: 0.0}))
