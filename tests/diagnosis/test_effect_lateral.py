"""Ply steer, conicity, slip angle and yaw tilt against the lateral belt and the simulator."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import least_squares

from gateway.diagnosis.bayes.parameter_estimates import fitted_parameter
from gateway.diagnosis.effects.effect import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    LATERAL,
    RADIAL,
    ModelledBlock,
    SignalEffect,
)
from gateway.diagnosis.effects.lateral_loads import STIFFNESSES, CarcassCompliance, Conicity, PlySteer
from gateway.diagnosis.effects.lateral_response import Load, Stiffness, unit_response
from gateway.diagnosis.effects.mounting import YawTilt
from gateway.forces.laminate import crossed_coupling_length
from gateway.forces.lateral_belt import LateralBelt, solve_lateral_belt
from gateway.ring.rolling_ring.sensor_waveform import SensorWaveform
from gateway.simulator.scenario import parse_scenario
from gateway.simulator.sensor import mounting_matrix
from gateway.simulator.wheel_plan import wheel_plans
from tests.diagnosis.belt_data import CONDITIONS, OMEGA, THETA
from tests.testkit.exact_ring import PRESSURE_PA, on_grid, solution

PLY_STEER, CONICITY, CARCASS_COMPLIANCE, YAW_TILT = PlySteer(), Conicity(), CarcassCompliance(), YawTilt()
EFFECTS = (PLY_STEER, CONICITY, CARCASS_COMPLIANCE)
# The nominal belt of the effects, and one whose stiffnesses all differ.
NOMINAL = LateralBelt()
OTHER = LateralBelt(
    shear_stiffness_n=1.2e6, bending_stiffness_nm2=2.5e3, sidewall_stiffness_npm2=1.8e5, tread_stiffness_npm2=1.2e7
)


def block(load_n: float = 5000.0, *, reverse: bool = False, omega: float = OMEGA) -> ModelledBlock:
    ring = solution(load_n)
    conditions = replace(CONDITIONS, omega_radps=omega, load_n=load_n, reverse=reverse)
    shape = SensorWaveform(*(on_grid(curve, FIELD_SIZE) for curve in ring.sensor))
    signal = np.zeros((3, FIELD_SIZE))
    signal[RADIAL] = omega**2 * shape.radial_m
    return ModelledBlock(conditions, THETA, signal, shape, ring.leading_edge_rad, ring.trailing_edge_rad)


def on_belt(load: Load, belt: LateralBelt, load_n: float = 5000.0) -> tuple[np.ndarray, float]:
    """Return the lateral axis over omega^2 of the lateral belt under a typical size of one load, and that size."""
    size = {Load.PLY_STEER: 1.2e-3, Load.CONE: 0.01, Load.SLIP: math.radians(0.2)}[load]
    solved = solve_lateral_belt(
        solution(load_n),
        replace(
            belt,
            coupling_length_m=size if load is Load.PLY_STEER else 0.0,
            conicity_rad=size if load is Load.CONE else 0.0,
        ),
        slip_angle_rad=size if load is Load.SLIP else 0.0,
    )
    return on_grid(solved.lateral_m, FIELD_SIZE), size


def left_over(target_m: np.ndarray, load: Load, modelled: ModelledBlock) -> tuple[float, float]:
    """Return the relative residual of the best size on the best plausible belt, and that size."""
    limits = np.array([(parameter.low, parameter.high) for parameter in EFFECTS[load].parameters[1:]])

    def fitted(stiffness: np.ndarray) -> tuple[float, np.ndarray]:
        column = unit_response(modelled, load, Stiffness(*stiffness)).lateral_m
        size = float(column @ target_m / (column @ column))
        return size, (target_m - size * column) / np.linalg.norm(target_m)

    best = least_squares(lambda x: fitted(x)[1], np.zeros(3), bounds=limits.T, diff_step=1e-4)
    size, rest = fitted(best.x)
    return float(np.linalg.norm(rest)), size


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda effect: effect.name)
def test_lateral_response_has_no_mean(effect: SignalEffect) -> None:
    assert not effect.contribution(block(), np.array([0.0, 0.5, -0.5, 0.5])).any()
    made = effect.contribution(block(), np.array(effect.start_values[0]))
    assert abs(made[LATERAL].mean()) < 1e-9 * np.abs(made[LATERAL]).max()


@pytest.mark.parametrize("load_n", [2000.0, 5000.0, 8000.0])
@pytest.mark.parametrize("load", Load)
def test_nominal_response_matches_the_lateral_belt(load: Load, load_n: float) -> None:
    """The difference is tension that falls in the contact, and bristles that slide at the trailing edge."""
    target, size = on_belt(load, NOMINAL, load_n)
    made = size * unit_response(block(load_n), load, Stiffness()).lateral_m
    assert np.std(made - target) < 0.025 * target.std()


def test_side_force_matches_the_lateral_belt() -> None:
    solved = solve_lateral_belt(solution(), LateralBelt())
    force = 1.2e-3 * unit_response(block(), Load.PLY_STEER, Stiffness()).side_force_n
    assert force == pytest.approx(solved.side_force_n, rel=0.02)


@pytest.mark.parametrize("load", Load)
def test_other_belt_is_fitted_at_own_load_only(load: Load) -> None:
    """One direction of rotation separates the three: with three stiffnesses free none imitates another."""
    target, size = on_belt(load, OTHER)
    selected, result = left_over(target, load, block())
    assert selected < 0.015
    assert result == pytest.approx(size, rel=0.35)
    for other in Load:
        if other is not load:
            assert left_over(target, other, block())[0] > 0.6


def test_ply_steer_and_conicity_are_nearly_orthogonal() -> None:
    """At standstill one is odd and the other even about the contact's middle; the rolling tread mixes them little."""
    columns = [unit_response(block(), load, Stiffness()).lateral_m for load in Load]
    unit = np.array([column / np.linalg.norm(column) for column in columns])
    ply_cone, ply_slip, cone_slip = (unit @ unit.T)[[0, 0, 1], [1, 2, 2]]
    assert abs(ply_cone) < 0.06
    assert abs(ply_slip) < 0.15
    assert abs(cone_slip) < 0.25


@pytest.mark.parametrize("load_n", [2000.0, 5000.0, 8000.0])
def test_tilted_sensor_resembles_lateral_loads_but_differs(load_n: float) -> None:
    """Roll without its mean resembles conicity, yaw ply steer; plausible belts leave 1 to 4 %."""
    position = block(load_n)
    radial = position.shape.radial_m - position.shape.radial_m.mean()
    for leak, load in ((radial, Load.CONE), (np.gradient(radial, THETA), Load.PLY_STEER)):
        column = unit_response(position, load, Stiffness()).lateral_m
        assert abs(leak @ column) > 0.95 * np.linalg.norm(leak) * np.linalg.norm(column)
        assert 0.003 < left_over(leak, load, position)[0] < 0.06


@pytest.mark.parametrize("reverse", [False, True])
def test_yaw_turns_circumferential_into_lateral(reverse: bool) -> None:
    position = block(reverse=reverse)
    position.signal_mps2[CIRCUMFERENTIAL] = 9.8 * position.shape.gravity_circumferential
    position.signal_mps2[LATERAL] = 3.0
    yaw = np.array([0.03])
    # The simulator's mounting acts on the sensor's own axes: rolling in reverse, its first one points back.
    back = np.diag([-1.0 if reverse else 1.0, 1.0, 1.0])
    expected = back @ mounting_matrix(0.0, 0.0, math.degrees(0.03)) @ back @ position.signal_mps2
    assert position.signal_mps2 + YAW_TILT.contribution(position, yaw) == pytest.approx(expected, abs=1e-9)
    assert not YAW_TILT.contribution(position, np.zeros(1)).any()
    step = 1e-5
    numeric = (YAW_TILT.contribution(position, yaw + step) - YAW_TILT.contribution(position, yaw - step)) / (2.0 * step)
    assert YAW_TILT.derivative(position, yaw)[0] == pytest.approx(numeric, abs=1e-6 * np.abs(numeric).max())


def test_response_follows_direction_and_speed() -> None:
    parameters = np.array([1e-3, 0.1, 0.0, 0.0])
    for effect, sign in zip(EFFECTS, (-1.0, 1.0, 1.0), strict=True):
        forward = effect.contribution(block(), parameters)
        assert np.array_equal(effect.contribution(block(reverse=True), parameters), sign * forward)
        assert effect.contribution(block(omega=2.0 * OMEGA), parameters) == pytest.approx(4.0 * forward)


@pytest.mark.parametrize("direction", ["forward", "reverse"])
@pytest.mark.parametrize(
    ("wheel", "effect", "size"),
    [
        ("[wheel.tire]\ncord_angle_deg = 24.0\nply_separation_mm = 1.2\n", PLY_STEER, "ply"),
        ("[wheel.tire]\ncord_angle_deg = 0.0\nconicity_deg = 0.5\n", CONICITY, math.radians(0.5)),
        ("slip_angle_deg = 0.2\n[wheel.tire]\ncord_angle_deg = 0.0\n", CARCASS_COMPLIANCE, math.radians(0.2)),
    ],
)
def test_lateral_axis_matches_the_simulator(
    direction: str, wheel: str, effect: SignalEffect, size: float | str
) -> None:
    keys, _, tables = wheel.partition("[wheel.tire]")
    text = (
        f'[[wheel]]\nposition = "W"\nwheel = 0\nload_n = 5000.0\npressure_kpa = 210.0\n{keys}[wheel.tire]{tables}'
        f'[wheel.motion]\ndirection = "{direction}"\n'
    )
    plan = wheel_plans(parse_scenario(text, "test"))[0]
    ring = plan.tire.solve(5000.0, PRESSURE_PA, OMEGA)
    simulated = OMEGA**2 * on_grid(plan.tire.solve_lateral(ring, plan.slip_angle_rad.at(0.0)).lateral_m, FIELD_SIZE)
    amount = crossed_coupling_length(math.radians(24.0), 1.2e-3) if isinstance(size, str) else size
    made = effect.contribution(block(reverse=direction == "reverse"), np.array([amount, 0.0, 0.0, 0.0]))[LATERAL]
    assert np.std(made - simulated) < 0.025 * simulated.std()


def test_error_of_a_stiffness_includes_that_of_the_equation() -> None:
    assert fitted_parameter(STIFFNESSES[0], 0.3, 0.08).std == pytest.approx(math.hypot(0.08, 0.15))
    assert fitted_parameter(PlySteer.parameters[0], 1e-3, 2e-6).std == 2e-6
