"""Rolling ring with damping, friction, drum, shear and stiffening; its tangent and linear solver."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.ring.rolling_ring import RingParameters, RingSolution, RingTangent, solve_rolling_ring
from gateway.ring.rolling_ring.force_balance import BeltLaw, belt_balance, ring_grid
from gateway.ring.rolling_ring.newton_solver import Tangent

RADIUS_M, PRESSURE_PA, OMEGA_RADPS, LOAD_N = 0.32, 2.1e5, 56.42, 5000.0
RING = RingParameters.from_numbers(3.0833e-3, 0.1953, 2.974, 2.5289, radius_m=RADIUS_M, pressure_pa=PRESSURE_PA)


def solve(ring: RingParameters = RING, **changes: float | RingTangent | None) -> RingSolution:
    return solve_rolling_ring(ring, LOAD_N, PRESSURE_PA, OMEGA_RADPS, **({"nodes": 720} | changes))  # type: ignore[arg-type]


@pytest.fixture(scope="module")
def plain() -> RingSolution:
    return solve()


def test_foundation_damping_resists_rolling(plain: RingSolution) -> None:
    damped = solve(replace(RING, foundation_damping_nspm2=200.0))
    assert damped.rolling_resistance == pytest.approx(0.007, abs=2e-4)
    assert damped.contact_centre_rad == pytest.approx(-0.0045, abs=2e-4)
    assert plain.rolling_resistance == pytest.approx(0.0, abs=1e-9)
    # Without friction the axle's power is dissipated in the sidewall.
    u = damped.position_m - RADIUS_M * np.stack([np.sin(damped.theta_rad), -np.cos(damped.theta_rad)], axis=1)
    turned = (u[:, 0] + 1j * u[:, 1]) * np.exp(-1j * damped.theta_rad)
    rate = (np.roll(turned, -1) - np.roll(turned, 1)) * 720 / (4 * math.pi)
    loss_w = 200.0 * OMEGA_RADPS**2 * RADIUS_M * float((np.abs(rate) ** 2).sum()) * 2 * math.pi / 720
    assert damped.axle_torque_nm * OMEGA_RADPS == pytest.approx(loss_w, rel=2e-3)


def test_tread_damping_shifts_contact_to_entry(plain: RingSolution) -> None:
    damped = solve(replace(RING, tread_damping_nspm2=5e4))
    assert -damped.leading_edge_rad > plain.half_angle_rad > damped.trailing_edge_rad
    assert damped.leading_edge_rad == pytest.approx(-0.266, abs=0.003)
    assert damped.trailing_edge_rad == pytest.approx(0.220, abs=0.003)
    assert damped.rolling_resistance == pytest.approx(0.0066, abs=3e-4)


@pytest.mark.parametrize("shear_n", [math.inf, 6e4])
def test_bending_damping_resists_rolling_and_advances_the_trailing_edge(plain: RingSolution, shear_n: float) -> None:
    damping_nm2s = 2e-3
    damped = solve(replace(RING, bending_damping_nm2s=damping_nm2s, shear_stiffness_n=shear_n), nodes=1440)
    # Without friction the axle's power is dissipated in the belt's bending.
    curvature, step_rad = damped.curvature_pm, 2 * math.pi / 1440
    rate = OMEGA_RADPS * (np.roll(curvature, -1) - np.roll(curvature, 1)) / (2 * step_rad)
    loss_w = damping_nm2s * float((rate**2).sum()) * RADIUS_M * step_rad
    assert damped.axle_torque_nm * OMEGA_RADPS == pytest.approx(loss_w, rel=5e-3)
    if math.isinf(shear_n):
        assert damped.rolling_resistance == pytest.approx(0.0042, abs=1e-4)
        assert damped.trailing_edge_rad < plain.trailing_edge_rad - 1e-3


@pytest.mark.parametrize("torque_nm", [0.0, 200.0, -200.0])
def test_friction_balances_axle_torque(torque_nm: float) -> None:
    driven = solve(replace(RING, foundation_damping_nspm2=100.0), axle_torque_nm=torque_nm)
    assert driven.axle_torque_nm == pytest.approx(torque_nm, abs=1e-6)
    assert driven.rolling_resistance == pytest.approx(0.0035, abs=5e-4)
    # Driving torque winds the sidewall up: the belt lags behind the rim by T / (2 pi R^2 kv).
    free = solve(replace(RING, foundation_damping_nspm2=100.0), axle_torque_nm=0.0)
    along = np.stack([np.cos(free.theta_rad), np.sin(free.theta_rad)], axis=1)
    lag = np.einsum("ia,ia->i", free.position_m - driven.position_m, along).mean()
    expected = torque_nm / (2 * math.pi * RADIUS_M**2 * RING.tangential_stiffness_npm2)
    assert lag == pytest.approx(expected, rel=0.1, abs=1e-9)


def test_drum_reverses_curvature() -> None:
    drum = solve(drum_radius_m=0.85)
    inner = np.abs(drum.theta_rad) < 0.4 * drum.half_angle_rad
    assert drum.curvature_pm[inner].mean() == pytest.approx(-1 / 0.85, rel=0.1)
    assert (drum.sensor.radial_m[inner] < 0).all()
    hollow = solve(drum_radius_m=-1.7)
    assert hollow.half_angle_rad > solve().half_angle_rad > drum.half_angle_rad
    far = solve(drum_radius_m=1e6)
    assert far.sensor.radial_m == pytest.approx(solve().sensor.radial_m, abs=1e-4 * RADIUS_M)


def test_stiff_shear_equals_euler_belt(plain: RingSolution) -> None:
    stiff = solve(replace(RING, shear_stiffness_n=1e9))
    assert stiff.half_angle_rad == pytest.approx(plain.half_angle_rad, rel=5e-4)  # grids differ by O(h^2)
    assert stiff.sensor.radial_m == pytest.approx(plain.sensor.radial_m, abs=2e-3 * RADIUS_M)
    soft = solve(replace(RING, shear_stiffness_n=RING.bending_stiffness_nm2 / 0.01**2))
    change = np.abs(soft.sensor.radial_m - plain.sensor.radial_m).max() / RADIUS_M
    assert 0.02 < change < 0.2
    assert soft.sensor.radial_m.mean() / RADIUS_M == pytest.approx(1.0, abs=3e-4)
    # Sheared sections rotate relative to the belt, which the circumferential axis reads even without an offset.
    assert np.abs(soft.sensor.circumferential_m).max() > 20 * np.abs(plain.sensor.circumferential_m).max()


@pytest.mark.parametrize("nodes", [240, 480])
def test_shear_correction_holds_on_any_grid(nodes: int) -> None:
    euler = solve(nodes=nodes)
    size = float(np.ptp(euler.sensor.radial_m))
    changes = []
    for length_m in (1e-5, 1e-3, 2e-3):
        shear = solve(replace(RING, shear_stiffness_n=RING.bending_stiffness_nm2 / length_m**2), nodes=nodes)
        assert np.abs(shear.sensor.circumferential_m - euler.sensor.circumferential_m).max() < 500.0 * length_m**2
        changes.append(float(np.abs(shear.sensor.radial_m - euler.sensor.radial_m).max()) / size)
    assert changes[0] < 1e-5
    assert changes[2] == pytest.approx(4.0 * changes[1], rel=0.02)


@pytest.mark.parametrize("shear_n", [math.inf, 1e5])
def test_shear_flexible_shape_does_not_depend_on_speed(shear_n: float) -> None:
    ring = replace(RING, shear_stiffness_n=shear_n)
    slow = solve_rolling_ring(ring, LOAD_N, PRESSURE_PA, 10.0, nodes=480)
    fast = solve_rolling_ring(ring, LOAD_N, PRESSURE_PA, 100.0, nodes=480)
    assert fast.position_m == pytest.approx(slow.position_m, abs=1e-4 * RADIUS_M)


def test_rotary_inertia_reduces_bending_stiffness() -> None:
    rotary = 3.5 * 0.015**2 / 12
    inertia = solve(replace(RING, rotary_inertia_kgm=rotary))
    softened = RING.bending_stiffness_nm2 - rotary * (RADIUS_M * OMEGA_RADPS) ** 2
    softer = solve(replace(RING, bending_stiffness_nm2=softened))
    assert inertia.position_m == pytest.approx(softer.position_m, abs=1e-12)
    with pytest.raises(ValueError, match="EI - rho I V"):
        solve(replace(RING, rotary_inertia_kgm=1.0))


def test_stiffening_sidewall_deflects_less(plain: RingSolution) -> None:
    stiffer = solve(replace(RING, sidewall_stiffening_pm=5.0))
    softer = solve(replace(RING, sidewall_stiffening_pm=-5.0))
    assert stiffer.deflection_m < plain.deflection_m < softer.deflection_m


def test_softer_tread_lengthens_contact(plain: RingSolution) -> None:
    softer = solve(replace(RING, tread_stiffness_npm2=RING.tread_stiffness_npm2 / 1.1))
    exponent = math.log(softer.half_angle_rad / plain.half_angle_rad) / math.log(1 / 1.1)
    assert exponent == pytest.approx(-0.10, abs=0.015)


LAWS = {
    "plain": {},
    "damped": {
        "radial_damping_nspm2": 200.0,
        "tangential_damping_nspm2": 200.0,
        "tread_damping_nspm2": 1e3,
        "stiffening_pm": 5.0,
    },
    "drum with torque": {"drum_radius_m": 0.85, "torque_nm": 100.0},
    "damped bending": {"bending_damping_nm2s": 0.02, "tread_damping_nspm2": 1e3},
    "shear, damped bending": {"shear_n": 6e4, "bending_damping_nm2s": 0.02},
    "shear, hollow drum, all losses": {
        "shear_n": 6e4,
        "drum_radius_m": -1.5,
        "torque_nm": 100.0,
        "tread_damping_nspm2": 3e3,
        "radial_damping_nspm2": 100.0,
        "tangential_damping_nspm2": 300.0,
    },
}


def belt_law(changes: dict[str, float]) -> BeltLaw:
    return BeltLaw(
        **{  # type: ignore[arg-type]
            "radius_m": RADIUS_M,
            "bending_nm2": 6.8,
            "bending_damping_nm2s": 0.0,
            "tension_width_m": 0.0625,
            "radial_npm2": 6.2e5,
            "tangential_npm2": 5.3e5,
            "stiffening_pm": 0.0,
            "radial_damping_nspm2": 0.0,
            "tangential_damping_nspm2": 0.0,
            "mass_kgpm": 3.5,
            "extension_n": 5e6,
            "shear_n": math.inf,
            "tread_npm2": 7e7,
            "tread_damping_nspm2": 0.0,
            "pressure_pa": PRESSURE_PA,
            "omega_radps": OMEGA_RADPS,
            "load_n": LOAD_N,
            "drum_radius_m": math.inf,
            "torque_nm": None,
        }
        | changes
    )


@pytest.mark.parametrize("changes", LAWS.values(), ids=LAWS.keys())
def test_tangent_matches_finite_differences(changes: dict[str, float]) -> None:
    law = belt_law(changes)
    nodes, height, traction, step = 24, 0.3, 0.05, 1e-7
    grid, rng = ring_grid(nodes), np.random.default_rng(1)
    state = 0.002 * rng.standard_normal((nodes, law.dof))
    state[:, :2] += RADIUS_M * grid.radial
    balance = belt_balance(law, grid, state, height, traction)
    size = len(balance.border)
    dense = np.zeros((nodes, law.dof, nodes, law.dof))
    for offset in range(2 * law.reach + 1):
        for i in range(nodes):
            dense[i, :, (i + offset - law.reach) % nodes, :] += balance.blocks[offset, i]
    for unknown in range(state.size + size):
        ends = []
        for sign in (1.0, -1.0):
            moved, border = state.copy().reshape(-1), [height, traction]
            if unknown < state.size:
                moved[unknown] += sign * step
            else:
                border[unknown - state.size] += sign * step
            ends.append(belt_balance(law, grid, moved.reshape(state.shape), *border))
        slope = (ends[0].residual - ends[1].residual) / (2 * step)
        foot = (ends[0].border - ends[1].border) / (2 * step)
        if unknown < state.size:
            node, axis = divmod(unknown, law.dof)
            expected, expected_foot = dense[:, :, node, axis], balance.rows[:, node, axis]
        else:
            expected, expected_foot = balance.columns[unknown - state.size], balance.corner[:, unknown - state.size]
        assert np.abs(slope - expected).max() < 1e-6 * np.abs(dense).max()
        assert np.abs(foot - expected_foot).max() < 1e-6 * max(1.0, np.abs(balance.rows).max())


@pytest.mark.parametrize(("nodes", "dof", "border"), [(12, 2, 1), (25, 3, 2), (7, 1, 1)])
def test_folded_band_matches_dense_solve(nodes: int, dof: int, border: int) -> None:
    rng = np.random.default_rng(2)
    blocks = rng.standard_normal((5, nodes, dof, dof))
    blocks[2] += 10 * np.eye(dof)
    columns, rows = rng.standard_normal((2, border, nodes, dof))
    corner, below = rng.standard_normal((border, border)), rng.standard_normal((2, border))
    right = rng.standard_normal((2, nodes, dof))
    size = nodes * dof
    dense = np.zeros((size + border, size + border))
    for offset in range(5):
        for i in range(nodes):
            j = (i + offset - 2) % nodes
            dense[i * dof : (i + 1) * dof, j * dof : (j + 1) * dof] += blocks[offset, i]
    dense[:size, size:] = columns.reshape(border, size).T
    dense[size:, :size] = rows.reshape(border, size)
    dense[size:, size:] = corner
    expected = np.linalg.solve(dense, np.concatenate([right.reshape(2, -1), below], axis=1).T).T
    grid = ring_grid(24)
    resting = belt_balance(belt_law({}), grid, RADIUS_M * grid.radial, RADIUS_M, 0.0)
    balance = resting._replace(blocks=blocks, columns=columns, rows=rows, corner=corner)
    x, y = Tangent(balance)(right, below)
    assert np.concatenate([x.reshape(2, -1), y], axis=1) == pytest.approx(expected, abs=1e-9)


NEARBY = {
    "plain": ({}, {}),
    "damped": ({"foundation_damping_nspm2": 200.0, "tread_damping_nspm2": 1e3}, {}),
    "damped bending": ({"bending_damping_nm2s": 2e-3}, {}),
    "drum with torque": ({}, {"drum_radius_m": 0.85, "axle_torque_nm": 100.0}),
    "shear, sensor below the belt": ({"shear_stiffness_n": 6e4}, {"sensor_offset_m": 4e-3}),
}


@pytest.mark.parametrize("conditions", NEARBY.values(), ids=NEARBY.keys())
def test_nearby_solution_is_exact_to_first_order(conditions: tuple[dict[str, float], dict[str, float]]) -> None:
    fields, arguments = conditions
    ring = replace(RING, **fields)
    base = solve(ring, **arguments)
    still = {name: value for name, value in arguments.items() if name != "nodes"}
    offset_m = still.pop("sensor_offset_m", 0.0)
    errors = []
    for step in (4e-3, 1e-3):
        other = replace(
            ring,
            bending_stiffness_nm2=ring.bending_stiffness_nm2 * (1.0 + step),
            radial_stiffness_npm2=ring.radial_stiffness_npm2 * (1.0 - step),
            tread_stiffness_npm2=ring.tread_stiffness_npm2 * (1.0 + step),
        )
        same, near = RingTangent(base, **still).nearby([ring, other], sensor_offset_m=offset_m)
        assert same.sensor.radial_m == pytest.approx(base.sensor.radial_m, abs=1e-6)
        change = near.sensor.radial_m - same.sensor.radial_m
        exact = solve(other, **arguments).sensor.radial_m - base.sensor.radial_m
        errors.append(np.sqrt(np.mean((change - exact) ** 2)) / np.sqrt(np.mean(exact**2)))
        assert near.axle_height_m - same.axle_height_m == pytest.approx(
            solve(other, **arguments).axle_height_m - base.axle_height_m, rel=0.02
        )
    assert errors[1] < 0.003
    assert errors[1] < 0.7 * errors[0]


@pytest.mark.parametrize("conditions", NEARBY.values(), ids=NEARBY.keys())
def test_solution_by_secants_is_that_from_rest(conditions: tuple[dict[str, float], dict[str, float]]) -> None:
    fields, arguments = conditions
    ring = replace(RING, **fields)
    borders = {name: value for name, value in arguments.items() if name in ("drum_radius_m", "axle_torque_nm")}
    near = RingTangent(solve(ring, **arguments), **borders)
    for step in (1e-3, 1e-2, 0.2):
        other = replace(
            ring,
            tension_width_m=ring.tension_width_m * (1.0 - step),
            radial_stiffness_npm2=ring.radial_stiffness_npm2 * (1.0 - step),
        )
        by_secants, from_rest = solve(other, near=near, **arguments), solve(other, **arguments)
        assert by_secants.axle_height_m == pytest.approx(from_rest.axle_height_m, rel=1e-12)
        assert by_secants.axle_torque_nm == pytest.approx(from_rest.axle_torque_nm, rel=1e-7, abs=1e-7)
        assert by_secants.sensor.radial_m == pytest.approx(from_rest.sensor.radial_m, abs=1e-9)


def test_solution_by_secants_ignores_a_ring_of_other_unknowns(plain: RingSolution) -> None:
    sheared = replace(RING, shear_stiffness_n=6e4)
    assert solve(sheared, near=RingTangent(plain)).axle_height_m == pytest.approx(solve(sheared).axle_height_m)


def test_nearby_solution_follows_another_drum(plain: RingSolution) -> None:
    flat, drum = RingTangent(plain).nearby([RING, RING], drum_radii_m=[math.inf, 300.0])
    exact = solve(drum_radius_m=300.0)
    assert drum.axle_height_m - flat.axle_height_m == pytest.approx(exact.axle_height_m - plain.axle_height_m, rel=0.02)


def test_nearby_solution_rejects_an_impossible_ring(plain: RingSolution) -> None:
    with pytest.raises(ValueError, match="tread_stiffness_npm2 must be positive"):
        RingTangent(plain).nearby([replace(RING, tread_stiffness_npm2=-1.0)])
