"""Longitudinal force, torque and losses from the shape of the belt."""

import math
from dataclasses import replace
from functools import lru_cache
from typing import Any

import numpy as np
import pytest

from gateway.core.contacts.contact_timing import MOST_UNSEEN
from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import extended
from gateway.core.estimates.sensor_claims import Tilt
from gateway.core.estimates.tire_data import RUN_OUT_M, TireData
from gateway.core.quantity_catalogue import quantity_of
from gateway.core.reasons import CoreCode, Reason, codes_of
from gateway.core.revolutions.angle_resampling import angle_grid
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.core.trust.reasons import TrustCode
from gateway.forces.asymmetric_belt import asymmetric_shape, curvature_from_signal
from gateway.forces.asymmetric_rows import Force, U, asymmetric_rows, free_begin, free_motion, row_sensitivity
from gateway.forces.asymmetric_solve import AsymmetricSolution, solve_asymmetric
from gateway.forces.lateral_shape import LATERAL
from gateway.forces.longitudinal_force import (
    _LOSS_BY_RUN_OUT,
    HORIZON_REVOLUTIONS,
    NAMES,
    TIRE_HORIZON_REVOLUTIONS,
    LongitudinalForceEstimator,
)
from gateway.forces.reasons import ForceCode
from gateway.ring.belt_shape import MAX_ORDER, orders_about
from gateway.ring.reasons import RingCode
from gateway.ring.rolling_ring import (
    RingParameters,
    RingSolution,
    TreadBlocks,
    block_response,
    loaded_belt,
    solve_rolling_ring,
)
from tests.testkit.exact_ring import BASE_RING, PRESSURE_PA, RADIUS_M, omega_at, on_grid
from tests.testkit.revolution_data import CONDITIONS, OMEGA, make_revolution

LOAD_N = 5000.0
ROUND = replace(CONDITIONS, tire=TireData(runout_m=0.0))
STIFF = replace(BASE_RING, extension_stiffness_n=5e7)
LOSSY = replace(STIFF, foundation_damping_nspm2=100.0)
STD = np.full(61, 1.4e-4)


@lru_cache(maxsize=16)
def ring(torque_nm: float | None, parameters: RingParameters = LOSSY) -> RingSolution:
    return solve_rolling_ring(parameters, LOAD_N, PRESSURE_PA, omega_at(65.0), nodes=960, axle_torque_nm=torque_nm)


def orders(result: RingSolution, offset_m: float = 0.0) -> np.ndarray:
    centre = result.contact_centre_rad
    return curvature_from_signal(orders_about(result.sensor.radial_m, centre, 90), offset_m / RADIUS_M)


def estimates(
    result: RingSolution,
    *,
    noise_mps2: float = 0.5,
    revolutions: int = 16,
    conditions: TireConditions = ROUND,
    waves_m: np.ndarray | float = 0.0,
    lateral_mps2: np.ndarray | float = math.nan,
    seed: int = 3,
) -> dict[str, Estimate]:
    rng = np.random.default_rng(seed)
    average, estimator = RunningAverage(), LongitudinalForceEstimator()
    last: tuple[Estimate, ...] = ()
    for _ in range(revolutions):
        wave = OMEGA**2 * on_grid(result.sensor.radial_m + waves_m) + rng.normal(0.0, noise_mps2, 1024)
        revolution = make_revolution(wave)
        revolution.axes_mps2[LATERAL] = lateral_mps2
        last = estimator.update(revolution, extended(average, revolution), conditions)
    return {estimate.name: estimate for estimate in last}


def test_lateral_axis_in_a_rolled_sensor_is_in_the_errors() -> None:
    """A belt that is steered by its plies bends sideways at both edges of the contact, and opposite at them."""
    ring_result = ring(None)

    def lateral_mps2(n: int) -> np.ndarray:
        ends_rad = [angle_grid(n) - sign * ring_result.half_angle_rad for sign in (-1.0, 1.0)]
        return 60.0 * np.subtract(*(np.exp(-0.5 * (end_rad / 0.05) ** 2) for end_rad in ends_rad))

    plain = estimates(ring_result)["longitudinal_force_n"]
    rolled = estimates(
        ring_result,
        conditions=replace(ROUND, tilt=Tilt(roll_rad=0.1)),
        waves_m=-0.1 * lateral_mps2(len(ring_result.sensor.radial_m)) / OMEGA**2,
        lateral_mps2=lateral_mps2(1024),
    )["longitudinal_force_n"]
    assert abs(rolled.value - plain.value) > 5.0 * plain.std
    assert abs(rolled.value - plain.value) < 1.5 * rolled.std


@pytest.mark.parametrize("torque_nm", [-500.0, None, 60.0, 400.0])
def test_exact_ring_returns_its_force_and_torque(torque_nm: float | None) -> None:
    ring_result = ring(torque_nm)
    forces = solve_asymmetric(orders(ring_result), STD, ring_result.half_angle_rad).forces
    assert forces[Force.LOAD] == pytest.approx(1.0, abs=1e-3)
    assert forces[Force.LONGITUDINAL] * LOAD_N == pytest.approx(ring_result.longitudinal_force_n, rel=0.01, abs=3.0)
    assert forces[Force.TORQUE] * LOAD_N * RADIUS_M == pytest.approx(ring_result.axle_torque_nm, rel=0.01, abs=1.0)


def test_loss_is_rolling_resistance_of_sidewall() -> None:
    ring_result = ring(None)
    forces = solve_asymmetric(orders(ring_result), STD, ring_result.half_angle_rad).forces
    assert forces[Force.LOSS] == pytest.approx(ring_result.rolling_resistance, rel=0.05)
    assert forces[Force.TORQUE] - forces[Force.LONGITUDINAL] == pytest.approx(ring_result.rolling_resistance, rel=0.1)


def test_tread_damping_counts_in_resistance_only() -> None:
    damped = replace(STIFF, tread_damping_nspm2=1e4)
    ring_result = ring(None, damped)
    forces = solve_asymmetric(orders(ring_result), STD, ring_result.half_angle_rad).forces
    assert forces[Force.TORQUE] - forces[Force.LONGITUDINAL] == pytest.approx(ring_result.rolling_resistance, abs=3e-4)
    assert abs(forces[Force.LOSS]) < 0.1 * ring_result.rolling_resistance


def test_extension_of_the_belt_is_within_the_stated_error() -> None:
    ring_result = ring(400.0, replace(LOSSY, extension_stiffness_n=8e6))
    forces = solve_asymmetric(orders(ring_result), STD, ring_result.half_angle_rad).forces
    assert forces[Force.LONGITUDINAL] * LOAD_N == pytest.approx(ring_result.longitudinal_force_n, rel=0.03)
    assert forces[Force.TORQUE] * LOAD_N * RADIUS_M == pytest.approx(ring_result.axle_torque_nm, rel=0.03)


def test_deep_sensor_gives_the_same_forces() -> None:
    deep = solve_rolling_ring(
        LOSSY, LOAD_N, PRESSURE_PA, omega_at(65.0), nodes=960, axle_torque_nm=60.0, sensor_offset_m=6e-3
    )
    plain = solve_asymmetric(orders(ring(60.0)), STD, deep.half_angle_rad).forces
    result = solve_asymmetric(orders(deep, 6e-3), STD, deep.half_angle_rad).forces
    assert result[:3] == pytest.approx(plain[:3], abs=2e-3)


def test_sensitivity_is_the_derivative_of_the_rows() -> None:
    ring_result = ring(60.0)
    position = solve_asymmetric(orders(ring_result), STD, ring_result.half_angle_rad).unknowns.copy()
    # The derivative leaves sidewall damping out.
    position[U.DAMPING] = 0.0
    level, motion = 0.5 * ring_result.half_angle_rad, free_motion(free_begin(ring_result.half_angle_rad))
    rows, forces = row_sensitivity(asymmetric_shape(orders(ring_result), level), motion, position)
    for index in (1, 5, 20, MAX_ORDER + 2, MAX_ORDER + 12):
        step = np.zeros(2 * MAX_ORDER)
        step[index] = 1e-5
        above, below = (
            asymmetric_rows(asymmetric_shape(orders(ring_result) + sign * step, level), motion, position)
            for sign in (1.0, -1.0)
        )
        change = (above.balance - below.balance) / 2e-5
        assert rows[:, index] == pytest.approx(change, abs=0.02 * float(np.abs(change).max()))
        pulled = (above.forces - below.forces)[:3] / 2e-5
        assert forces[:3, index] == pytest.approx(pulled, abs=0.02 * float(np.abs(pulled).max()) + 1e-3)


@pytest.mark.parametrize("torque_nm", [-300.0, 60.0])
def test_noisy_revolutions_give_force_within_errors(torque_nm: float) -> None:
    truth, result = ring(torque_nm), estimates(ring(torque_nm))
    for name, value in (
        ("longitudinal_force_n", truth.longitudinal_force_n),
        ("axle_torque_nm", truth.axle_torque_nm),
        ("rolling_resistance", truth.rolling_resistance),
    ):
        assert abs(result[name].value - value) < 3.0 * result[name].std
    force = result["longitudinal_force_n"]
    assert force.status is Status.VALID
    assert force.std < 0.01 * LOAD_N + 0.03 * abs(force.value)
    assert math.copysign(1.0, force.value) == math.copysign(1.0, torque_nm)


def test_scattering_part_is_what_repeated_drives_scatter() -> None:
    """Eight drives: their scatter is known to 27 %."""
    drives = [estimates(ring(60.0), noise_mps2=2.0, seed=seed) for seed in range(8)]
    for name in NAMES[:3]:
        values, stated = np.array([(drive[name].value, drive[name].scatter_std) for drive in drives]).T
        assert 0.5 < float(np.std(values, ddof=1)) / math.sqrt(float(np.mean(stated**2))) < 1.6, name
        assert all(drive[name].scatter_std < drive[name].std for drive in drives), name
        assert quantity_of(name).correlated_revolutions == HORIZON_REVOLUTIONS
    assert quantity_of("rolling_resistance").correlated_revolutions == TIRE_HORIZON_REVOLUTIONS


def test_waves_of_tread_blocks_are_in_the_errors() -> None:
    """A free tire with 67 blocks of 10 %: no force, but waves that repeat each revolution."""
    ring_result = ring(None)
    blocks = TreadBlocks(67.0, BASE_RING.mass_kgpm, 1e-6, 0.0)
    response = block_response(loaded_belt(ring_result), blocks, ring_result.omega_radps).signal[0]
    waves_m = 0.1 * (response * np.exp(-1j * blocks.count * ring_result.theta_rad)).real
    calm, waving = estimates(ring_result), estimates(ring_result, waves_m=waves_m)
    for name, true in (("longitudinal_force_n", 0.0), ("axle_torque_nm", ring_result.axle_torque_nm)):
        assert abs(waving[name].value - true) < 2.0 * waving[name].std
        assert waving[name].std > 1.2 * calm[name].std


def test_usual_run_out_is_in_the_errors() -> None:
    """An axle at constant height and run-out that is not stated, at eight places of the sensor."""
    rings = [
        solve_rolling_ring(LOSSY, share * LOAD_N, PRESSURE_PA, omega_at(65.0), nodes=960) for share in (0.95, 1.0, 1.05)
    ]
    low, middle, high = rings
    change = (high.sensor.radial_m - low.sensor.radial_m) / (low.axle_height_m - high.axle_height_m)
    pulls, losses = [], 0
    for place_rad in np.arange(8) * (math.pi / 4.0):
        waves_m = RUN_OUT_M * np.cos(middle.theta_rad + place_rad) * change
        result = estimates(middle, conditions=CONDITIONS, waves_m=waves_m)
        for name, true in (("longitudinal_force_n", 0.0), ("axle_torque_nm", middle.axle_torque_nm)):
            assert result[name].status is Status.VALID
            pulls.append((result[name].value - true) / result[name].std)
        for name in NAMES[3:]:
            if result[name].status is Status.VALID:
                assert abs(result[name].value - middle.rolling_resistance) < 2.5 * result[name].std
                assert result[name].std > 0.9 * _LOSS_BY_RUN_OUT * CONDITIONS.tire.runout_m
                losses += 1
    assert losses >= 8
    assert np.abs(pulls).max() < 2.0
    assert 0.4 < np.sqrt(np.square(pulls).mean()) < 1.3


def test_without_load_only_the_ratio_is_given() -> None:
    result = estimates(ring(60.0), revolutions=4, conditions=TireConditions(radius_m=RADIUS_M))
    assert codes_of(result["longitudinal_force_n"].reasons) == (RingCode.NEEDS_LOAD,)
    assert codes_of(result["axle_torque_nm"].reasons) == (RingCode.NEEDS_LOAD,)
    assert result["longitudinal_ratio"].value == pytest.approx(ring(60.0).longitudinal_force_n / LOAD_N, abs=0.02)


def test_run_out_that_looks_like_a_driving_force_is_provisional() -> None:
    """A high spot of 1 mm a quarter of a turn from the sensor swings the load by 4 %: no force, but an asymmetry."""
    more, less = (
        solve_rolling_ring(STIFF, share * LOAD_N, PRESSURE_PA, omega_at(65.0), nodes=960) for share in (1.04, 0.96)
    )
    swing_m = 0.5 * (more.sensor.radial_m - less.sensor.radial_m) * np.sin(more.theta_rad)
    forward, backward = (
        {name: estimates(ring(None, STIFF), waves_m=sign * swing_m)[name] for name in NAMES[:3]} for sign in (1.0, -1.0)
    )
    assert all(abs(estimate.value) > 10.0 * estimate.std for estimate in (*forward.values(), *backward.values()))
    gives_energy = [
        ForceCode.TIRE_GIVES_ENERGY in codes_of(estimate.reasons) and estimate.status is Status.PROVISIONAL
        for estimate in (*forward.values(), *backward.values())
    ]
    # Of the other sign, it looks like a force with a loss.
    assert gives_energy in ([True] * 3 + [False] * 3, [False] * 3 + [True] * 3)


def test_stone_that_looks_like_a_force_is_provisional() -> None:
    """It strikes 0.35 rad ahead of the contact's centre, and the belt rings through the contact."""
    free = ring(None, STIFF)
    since_rad = (free.theta_rad - free.contact_centre_rad + 0.35) % (2.0 * math.pi)
    ringing_mps2 = 200.0 * np.exp(-since_rad / 0.3) * np.sin(10.0 * since_rad)
    ratio = estimates(free, waves_m=ringing_mps2 / OMEGA**2)["longitudinal_ratio"]
    assert ratio.value > 3.0 * ratio.std
    assert ratio.status is Status.PROVISIONAL
    assert codes_of(ratio.reasons) == (ForceCode.ASYMMETRY_NOT_BALANCED,)


def solved_with(monkeypatch: pytest.MonkeyPatch, forces: list[float]) -> dict[str, Estimate]:
    """Return the estimates of a belt whose balance is solved with these forces."""
    from gateway.forces import longitudinal_force

    def solve(*arguments: Any) -> AsymmetricSolution:
        return replace(solve_asymmetric(*arguments), forces=np.array(forces))

    monkeypatch.setattr(longitudinal_force, "solve_asymmetric", solve)
    return estimates(ring(60.0), revolutions=10)


@pytest.mark.parametrize("forces", [[1.0, 2.5, 2.5, 0.01], [1.0, 1.0, 2.5, 0.01]])
def test_force_or_torque_beyond_friction_is_provisional(monkeypatch: pytest.MonkeyPatch, forces: list[float]) -> None:
    result = solved_with(monkeypatch, forces)
    for name in NAMES[:3]:
        assert result[name].status is Status.PROVISIONAL
        assert ForceCode.BEYOND_FRICTION in codes_of(result[name].reasons)


def test_balance_that_does_not_carry_the_load_is_no_belt(monkeypatch: pytest.MonkeyPatch) -> None:
    result = solved_with(monkeypatch, [1.4, 0.1, 0.1, 0.01])
    assert {estimate.status for estimate in result.values()} == {Status.INVALID}
    assert codes_of(result["longitudinal_ratio"].reasons) == (RingCode.NO_BELT_SHAPE,)


def test_strong_noise_leaves_force_not_determined() -> None:
    result = estimates(ring(60.0), noise_mps2=60.0, revolutions=8)
    force = result["longitudinal_force_n"]
    assert force.status is not Status.VALID
    assert TrustCode.FORCE_NOT_DETERMINED in codes_of(force.reasons)


def test_first_revolutions_are_provisional() -> None:
    result = estimates(ring(60.0), revolutions=3)
    assert CoreCode.NOT_SETTLED in codes_of(result["longitudinal_ratio"].reasons)


def test_revolution_that_is_not_used_leaves_the_forces_as_they_are() -> None:
    average, estimator = RunningAverage(), LongitudinalForceEstimator()
    revolution = make_revolution(OMEGA**2 * on_grid(ring(60.0).sensor.radial_m))
    lost = replace(revolution, faults=(Reason(EstimateCode.SAMPLES_LOST),))
    mean = extended(average, revolution)
    assert {estimate.status for estimate in estimator.update(lost, mean, CONDITIONS)} == {Status.INVALID}
    used = estimator.update(revolution, mean, CONDITIONS)
    unused = estimator.update(lost, mean, CONDITIONS)
    assert [(e.name, e.value) for e in unused] == [(e.name, e.value) for e in used]
    assert all(
        e.status is Status.PROVISIONAL and EstimateCode.REVOLUTION_NOT_USED in codes_of(e.reasons) for e in unused
    )


def test_forces_that_are_not_measured_become_uncertain_and_end() -> None:
    average, estimator = RunningAverage(), LongitudinalForceEstimator()
    braking, driving = (make_revolution(OMEGA**2 * on_grid(ring(torque).sensor.radial_m)) for torque in (-500.0, 400.0))
    for _ in range(40):
        last = estimator.update(braking, extended(average, braking), ROUND)
    lost = replace(braking, faults=(Reason(EstimateCode.SAMPLES_LOST),))
    unseen = [estimator.update(lost, extended(average, lost), ROUND) for _ in range(MOST_UNSEEN + 1)]
    for index in range(3):
        stds = [last[index].std, *(each[index].std for each in unseen[:-1])]
        assert stds == sorted(set(stds))
        assert stds[1] < 1.5 * stds[0]
        # As a mean of forces that go on to change by a fiftieth of the load.
        unit = (LOAD_N, LOAD_N * RADIUS_M, 1.0)[index]
        assert 0.08 < math.sqrt(stds[-1] ** 2 - stds[0] ** 2) / unit < 0.16
        assert unseen[-1][index].status is Status.INVALID
    assert all(e.status is Status.PROVISIONAL for e in unseen[-1][3:] if e.name == "damping_loss")
    # What comes after is not mixed with what was before.
    ratio = estimator.update(driving, extended(average, driving), ROUND)[2]
    assert ratio.value == pytest.approx(ring(400.0).longitudinal_force_n / LOAD_N, abs=3.0 * ratio.std)


def test_no_belt_shape_is_invalid_and_not_solved_each_time(monkeypatch: pytest.MonkeyPatch) -> None:
    from gateway.forces import longitudinal_force

    calls = []

    def fails(*arguments: object) -> None:
        calls.append(arguments)
        raise np.linalg.LinAlgError

    monkeypatch.setattr(longitudinal_force, "solve_asymmetric", fails)
    result = estimates(ring(60.0), revolutions=7)
    assert codes_of(result["longitudinal_ratio"].reasons) == (RingCode.NO_BELT_SHAPE,)
    assert len(calls) < 11
