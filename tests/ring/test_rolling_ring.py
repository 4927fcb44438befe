"""Rolling ring against exact identities, the linear ring and reference values."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.ring.rolling_ring import RingNotConvergedError, RingParameters, RingSolution, solve_rolling_ring
from gateway.ring.rolling_ring.sensor_waveform import angle_derivatives

NUMBERS = (3.0833e-3, 0.1953, 2.9740, 2.5289)
RADIUS_M, PRESSURE_PA, OMEGA_RADPS, LOAD_N = 0.32, 2.1e5, 56.42, 5000.0
RING = RingParameters.from_numbers(*NUMBERS, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA)


def solve(ring: RingParameters = RING, **changes: float) -> RingSolution:
    arguments = {"load_n": LOAD_N, "pressure_pa": PRESSURE_PA, "omega_radps": OMEGA_RADPS, "nodes": 720} | changes
    return solve_rolling_ring(ring, **arguments)  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def base() -> RingSolution:
    return solve(nodes=3600)


def orders(values: np.ndarray, highest: int = 60) -> np.ndarray:
    """Return complex coefficients c - i s of orders 0 to `highest` over theta from -pi."""
    spectrum = np.fft.rfft(values)[: highest + 1] / len(values) * 2.0
    return spectrum * (-1.0) ** np.arange(highest + 1)


def test_base_case_matches_reference_values(base: RingSolution) -> None:
    pressure = base.contact_pressure_npm
    assert base.half_angle_rad == pytest.approx(0.2398, abs=1e-4)
    assert base.deflection_m == pytest.approx(26.3e-3, abs=5e-5)
    assert pressure.max() / pressure[pressure > 0].mean() == pytest.approx(1.22, abs=0.005)
    patch = np.ptp(base.position_m[base.in_contact, 0])
    assert patch == pytest.approx(0.153, abs=1e-3)
    radial = base.sensor.radial_m / RADIUS_M
    assert radial.max() == pytest.approx(1.50, abs=0.005)
    assert radial[1800] == pytest.approx(-0.06, abs=0.002)


def test_pressure_carries_load_between_edges(base: RingSolution) -> None:
    step = base.theta_rad[1] - base.theta_rad[0]
    assert base.contact_pressure_npm.sum() * RADIUS_M * step == pytest.approx(LOAD_N, rel=1e-9)
    touching = base.theta_rad[base.in_contact]
    assert base.leading_edge_rad <= touching[0] <= base.leading_edge_rad + step
    assert base.trailing_edge_rad - step <= touching[-1] <= base.trailing_edge_rad
    assert base.contact_centre_rad == pytest.approx(0.0, abs=1e-9)


def test_belt_is_in_balance(base: RingSolution) -> None:
    """Sidewall pull plus road push is zero: pressure and inertia of a closed, steadily rolling belt sum to zero."""
    out = base.position_m - RADIUS_M * np.stack([np.sin(base.theta_rad), -np.cos(base.theta_rad)], axis=1)
    radial = np.stack([np.sin(base.theta_rad), -np.cos(base.theta_rad)], axis=1)
    along = np.stack([np.cos(base.theta_rad), np.sin(base.theta_rad)], axis=1)
    pull = -RING.radial_stiffness_npm2 * np.sum(out * radial, axis=1)[:, None] * radial
    pull -= RING.tangential_stiffness_npm2 * np.sum(out * along, axis=1)[:, None] * along
    total = pull.sum(axis=0) * RADIUS_M * 2 * math.pi / 3600
    assert total == pytest.approx([0.0, -LOAD_N], abs=1e-4 * LOAD_N)


def test_mean_radial_is_r_omega_squared(base: RingSolution) -> None:
    """The curvature of a closed belt integrates to one turn; belt extension changes this by 0.013 %."""
    assert base.sensor.radial_m.mean() / RADIUS_M == pytest.approx(1.0, abs=2e-4)
    stiff = solve(replace(RING, extension_stiffness_n=5e9))
    assert stiff.sensor.radial_m.mean() / RADIUS_M == pytest.approx(1.0, abs=1e-6)


def test_belt_is_nearly_straight_in_contact(base: RingSolution) -> None:
    inner = np.abs(base.theta_rad) < 0.5 * base.half_angle_rad
    assert np.abs(base.curvature_pm[inner] * RADIUS_M).max() < 0.1
    # s = V^2 kappa, up to the belt's extension and the grid's chords.
    assert base.sensor.radial_m == pytest.approx(RADIUS_M**2 * base.curvature_pm, abs=2e-3 * RADIUS_M)
    assert np.abs(base.sensor.circumferential_m).max() < 1e-3 * RADIUS_M


@pytest.mark.parametrize("speed_kmh", [0.0, 30.0, 120.0])
def test_undamped_shape_does_not_depend_on_speed(speed_kmh: float) -> None:
    moving = solve()
    other = solve(omega_radps=speed_kmh / 3.6 / RADIUS_M)
    assert other.half_angle_rad == pytest.approx(moving.half_angle_rad, rel=1e-4)
    assert other.sensor.radial_m == pytest.approx(moving.sensor.radial_m, abs=1e-4 * RADIUS_M)


def test_grid_refinement_converges(base: RingSolution) -> None:
    reference = orders(base.sensor.radial_m)
    scale = np.abs(reference[1:]).max()
    error = [
        float(np.abs(orders(solve(nodes=nodes).sensor.radial_m) - reference)[1:].max() / scale)
        for nodes in (240, 480, 900)
    ]
    assert error[0] < 5e-3
    assert error[1] < 1e-3
    assert error[2] < 3e-4


def test_light_load_matches_linear_ring() -> None:
    """c_n = (n^2 - 1) n^2 alpha_n / (pi p0 D_n) with the pressure of the exact solution."""
    light = solve(load_n=50.0, nodes=2880)
    n = np.arange(2, 41)
    bs, cw, rs, ts = NUMBERS
    stiffness = bs * n**2 * (n**2 - 1.0) ** 2 + cw * n**2 * (n**2 - 1.0) + rs * n**2 + ts
    theta = light.theta_rad
    road = np.cos(theta) * np.cos(n[:, None] * theta) + np.sin(theta) * np.sin(n[:, None] * theta) / n[:, None]
    alpha = (road * light.contact_pressure_npm).sum(axis=1) * (theta[1] - theta[0])
    linear = (n**2 - 1) * n**2 * alpha / (math.pi * PRESSURE_PA * stiffness)
    exact = -orders(light.sensor.radial_m)[2:41]
    assert np.abs(exact - linear).max() < 5e-3 * np.abs(linear).max()
    assert np.abs(exact.imag).max() < 1e-6 * np.abs(linear).max()


def test_numbers_round_trip() -> None:
    assert RING.numbers(PRESSURE_PA) == pytest.approx(NUMBERS)
    doubled = RING.numbers(2 * PRESSURE_PA)
    assert doubled.Rs == pytest.approx(NUMBERS[2] / 2)
    assert doubled.Cw == pytest.approx(NUMBERS[1])
    assert solve().numbers == pytest.approx(NUMBERS)


def test_offset_sensor_follows_exact_law() -> None:
    """s = V^2 kappa (1 - e kappa) and tangential = -(e/R) ds/dtheta for an inextensible belt."""
    offset_m = 0.008
    belt = replace(RING, extension_stiffness_n=5e9)
    neutral = solve(belt).sensor.radial_m
    sensor = solve(belt, sensor_offset_m=offset_m).sensor
    assert sensor.radial_m == pytest.approx(neutral * (1 - offset_m * neutral / RADIUS_M**2), abs=1e-4 * RADIUS_M)
    slope = angle_derivatives(neutral.astype(complex))[0].real
    assert sensor.circumferential_m == pytest.approx(-offset_m / RADIUS_M * slope, abs=5e-4 * RADIUS_M)


def test_specific_force_adds_gravity_and_acceleration() -> None:
    sensor = solve().sensor
    centre = 360
    still = sensor.specific_force(0.0)
    assert still[0][centre] == pytest.approx(STANDARD_GRAVITY_MPS2, rel=1e-6)
    assert still[0][0] == pytest.approx(-STANDARD_GRAVITY_MPS2, rel=1e-6)
    assert still[1].mean() == pytest.approx(0.0, abs=0.1)
    moving = sensor.specific_force(50.0, gravity_mps2=0.0)
    assert moving[0] == pytest.approx(2500.0 * sensor.radial_m)
    # Angular acceleration: the belt rests on the road in the contact; at the top, axle and rim add R domega/dt each.
    spun = sensor.specific_force(0.0, 10.0, gravity_mps2=0.0)
    assert spun[1][centre] == pytest.approx(0.0, abs=0.05)
    assert spun[1][0] == pytest.approx(2 * 10.0 * RADIUS_M, abs=0.05)


def test_warm_start_needs_fewer_iterations() -> None:
    cold = solve(load_n=5200.0)
    warm = solve(load_n=5200.0, start=solve())  # type: ignore[arg-type]
    assert warm.iterations < cold.iterations
    assert warm.position_m == pytest.approx(cold.position_m, abs=1e-9)
    with pytest.raises(ValueError, match="start has 720 nodes"):
        solve(nodes=480, start=cold)  # type: ignore[arg-type]


@pytest.mark.parametrize("load_n", [20.0, 20000.0])
@pytest.mark.parametrize("pressure_pa", [0.8e5, 4e5])
def test_extreme_conditions_converge(load_n: float, pressure_pa: float) -> None:
    solution = solve(load_n=load_n, pressure_pa=pressure_pa)
    assert 0.01 < solution.half_angle_rad < 0.8


def test_stiff_tread_at_light_bending_converges() -> None:
    """Full Newton steps alternate between two extents of this contact."""
    ring = RingParameters(0.29382, 0.048364, 3.3723, 7.01526e5, 7.96964e5, 3.6754, 2e10, 1.03892e8)
    result = solve_rolling_ring(ring, 5414.2, 242487.0, 34.08, nodes=2880)
    step = result.theta_rad[1] - result.theta_rad[0]
    assert result.contact_pressure_npm.sum() * ring.radius_m * step == pytest.approx(5414.2, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"load_n": 0.0}, "load_n"),
        ({"pressure_pa": -1.0}, "pressure_pa"),
        ({"nodes": 121}, "nodes"),
        ({"drum_radius_m": -0.1}, "drum_radius_m"),
        ({"load_n": math.nan}, "load_n"),
    ],
)
def test_invalid_arguments_raise(change: dict[str, float], name: str) -> None:
    with pytest.raises(ValueError, match=name):
        solve(**change)


def test_unreachable_load_raises() -> None:
    with pytest.raises(RingNotConvergedError, match="no equilibrium"):
        solve(load_n=1e7)
