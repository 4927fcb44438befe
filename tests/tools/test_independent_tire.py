"""The independent tire's matrices, road and sensor, which need no exudyn."""

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from independent_tire.__main__ import write
from independent_tire.elements import COORDINATES, Mesh, belt_matrices
from independent_tire.rolling import Belt, History, RoadForce, roll
from independent_tire.sensor import ANGLES, signals
from independent_tire.sideways import Sides, bend_sideways
from independent_tire.steady import SteadyBelt, roll_steadily
from independent_tire.tires import TIRES

from gateway.forces.lateral_belt import LateralBelt, solve_lateral_belt
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring

RADIUS_M = 0.32
MESH = Mesh(24, RADIUS_M)
BELT = replace(TIRES[0], elements=24, sinking_m=0.02, friction=0.5, tread_damping_nspm2=2e4)


def test_matrices_of_a_circle() -> None:
    matrices = belt_matrices(MESH)
    resting = MESH.resting
    whole = 2.0 * math.pi * RADIUS_M
    east = np.tile([1.0, 0.0, 0.0, 0.0], MESH.count)
    assert east @ matrices.mass @ east == pytest.approx(whole)
    assert 0.5 * resting @ matrices.area @ resting == pytest.approx(math.pi * RADIUS_M**2, rel=1e-4)
    assert abs(matrices.coriolis + matrices.coriolis.T).max() < 1e-12
    # A blown-up circle moves along the radius only.
    assert resting @ matrices.along @ resting < 1e-6 * (resting @ matrices.radial @ resting)


@pytest.mark.parametrize("drum_radius_m", [math.inf, 0.85])
def test_road_derivatives_match_differences(drum_radius_m: float) -> None:
    road = RoadForce(replace(BELT, drum_radius_m=drum_radius_m), MESH)
    rng = np.random.default_rng(1)
    size = COORDINATES * MESH.count
    position, rate, time_s = rng.normal(size=size) * 1e-4, rng.normal(size=size) * 0.1, BELT.period_s
    result = road.at(time_s, position, rate)
    assert result.push_n > 0.0
    for kind, step in ((0, 1e-8), (1, 1e-6)):
        rows, columns, values = road.triplets(result, 1.0 - kind, float(kind)).T
        stiffness = np.zeros((size, size))
        np.add.at(stiffness, (rows.astype(int), columns.astype(int)), values)
        for column in (0, 1, 2, 3, size - 2):
            change = np.zeros((2, size))
            change[kind, column] = step
            above = road.at(time_s, position + change[0], rate + change[1]).force
            below = road.at(time_s, position - change[0], rate - change[1]).force
            assert -(above - below) / (2.0 * step) == pytest.approx(
                stiffness[:, column], abs=1e-4 * max(1.0, float(np.abs(stiffness).max()))
            )


def resting_history(belt: Belt) -> History:
    """A wheel that turns without touching the road."""
    count = 2 * ANGLES + 1
    still, none = np.zeros((count, COORDINATES)), np.zeros(count)
    return History(
        angle_rad=-math.pi + np.linspace(0.0, 4.0 * math.pi, count),
        position_m=np.tile(Mesh(belt.elements, belt.radius_m).resting[:COORDINATES], (count, 1)),
        velocity_mps=still,
        acceleration_mps2=still,
        load_n=none + 1000.0,
        drag_n=none,
        torque_nm=none - 3.2,
        edges_rad=np.tile([-0.1, 0.1], (count, 1)),
    )


def test_sensor_of_a_free_wheel_feels_its_own_radius(tmp_path: Path) -> None:
    result = signals(BELT, resting_history(BELT), 0.01)
    assert result.radial_m.shape == (2, ANGLES)
    assert result.radial_m == pytest.approx(np.full((2, ANGLES), BELT.radius_m - 0.01))
    assert np.abs(result.circumferential_m).max() < 1e-12
    # Below the axle gravity's reaction points inward.
    assert result.gravity_radial[0, ANGLES // 2] == pytest.approx(1.0)
    assert result.gravity_radial[0, 0] == pytest.approx(-1.0)
    write(tmp_path / "free.npz", BELT, resting_history(BELT))
    with np.load(tmp_path / "free.npz") as remaining:
        about = json.loads(str(remaining["description"]))
        assert about["rolling_resistance"] == pytest.approx(0.01)
        assert remaining["samples_0"].shape[0] == 3


def test_missing_exudyn_is_a_clear_error(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "exudyn", None)
    with pytest.raises(RuntimeError, match="pip install exudyn"):
        roll(BELT)


@pytest.mark.parametrize("slip_scale", [2e-3, 1.0, 2.0])
def test_friction_grows_with_slip_over_its_scale(slip_scale: float) -> None:
    road = RoadForce(replace(BELT, slip_scale=slip_scale, tread_damping_nspm2=0.0, friction=0.5), MESH)
    road.road_mps = -BELT.speed_mps
    still = np.zeros(COORDINATES * MESH.count)
    result = road.at(BELT.period_s, still, still)
    # The belt slides at nearly twice its speed over a road that moves the other way.
    assert abs(result.drag_n) / result.push_n == pytest.approx(0.5 * math.tanh(1.96 / slip_scale), rel=0.02)


@pytest.fixture(scope="module")
def steady() -> SteadyBelt:
    belt = replace(TIRES[1], elements=240, friction=0.8, slip_scale=0.04, traction=-0.1)
    return roll_steadily(belt, 4000.0)


def test_steady_belt_agrees_with_the_ring(steady: SteadyBelt) -> None:
    """Energies of cubic elements against forces on a chain of nodes."""
    belt = replace(steady.belt, friction=0.0, traction=0.0)
    free = roll_steadily(belt, 4000.0, steady)
    ring = RingParameters(
        radius_m=belt.radius_m,
        tension_width_m=belt.tension_width_m,
        bending_stiffness_nm2=belt.bending_nm2,
        radial_stiffness_npm2=belt.radial_npm2,
        tangential_stiffness_npm2=belt.tangential_npm2,
        mass_kgpm=belt.mass_kgpm,
        extension_stiffness_n=belt.extension_n,
        tread_stiffness_npm2=belt.tread_npm2,
        foundation_damping_nspm2=belt.sidewall_damping_nspm2,
    )
    omega = belt.omega_radps
    solved = solve_rolling_ring(ring, 4000.0, belt.pressure_pa, omega, nodes=1440, sensor_offset_m=0.004)
    assert free.edges_rad == pytest.approx((solved.leading_edge_rad, solved.trailing_edge_rad), abs=3e-4)
    assert belt.radius_m - free.height_m == pytest.approx(solved.deflection_m, rel=1e-4)
    for ours, theirs in zip(free.signals(0.004), solved.sensor, strict=True):
        mine, other = np.fft.rfft(ours)[:60] / len(ours), np.fft.rfft(theirs)[:60] / len(theirs)
        assert np.abs(mine - other).max() < 2e-3 * np.abs(other).max()
    sides = Sides(1.6e6, 1e3, 2.5e5, 8e6, 1.0, coupling_m=1.2e-3, conicity_rad=0.003)
    for slip_rad in (0.0, 0.02):
        bent = bend_sideways(free, sides, slip_rad)
        beam = solve_lateral_belt(solved, LateralBelt(conicity_rad=0.003), slip_angle_rad=slip_rad)
        assert bent.y_m == pytest.approx(beam.y_m[::6], abs=2e-3 * np.abs(beam.y_m).max())
        assert bent.side_force_n == pytest.approx(beam.side_force_n, rel=5e-3)


def test_steady_belt_carries_its_load_and_is_pulled_as_asked(steady: SteadyBelt) -> None:
    assert steady.push_n == pytest.approx(4000.0, rel=1e-6)
    # Braked: the road pushes the belt along its motion, and runs faster than it.
    assert steady.drag_n == pytest.approx(400.0, rel=1e-5)
    assert steady.road_share > 1.0
