"""Slip, its direction and its asymmetry from the lateral axis."""

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from gateway.core.estimates.estimator import Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.tire_data import TireData
from gateway.core.reasons import Reason, codes_of
from gateway.forces.lateral_belt import LateralBelt
from gateway.forces.reasons import ForceCode
from gateway.forces.slip_angle import (
    MEAN_NAME,
    NAMES,
    REFERENCE_SETTLED,
    SLIP_NAME,
    SlipAngleEstimator,
    lateral_asymmetry,
)
from gateway.forces.slip_calibration import SlipCalibration
from gateway.simulator.truth import slopes_of
from tests.testkit.revolution_data import settled
from tools.generators.lateral_signals import RADIUS_M, Sensor, lateral, radial, samples, through_pipeline

SENSOR = Sensor(noise_mg=5.0, roll_rad=0.01)
BELT = LateralBelt()


@lru_cache(maxsize=8)
def drive(slips_deg: tuple[tuple[int, float], ...], belt: LateralBelt = BELT) -> tuple[Revolution, ...]:
    """Return revolutions at a sequence of slip angles, (count, deg)."""
    ring = radial(4000.0)
    shapes = [(count, replace(lateral(ring, belt, math.radians(slip)))) for count, slip in slips_deg]
    values = samples(ring, shapes, SENSOR)
    return tuple(r.revolution for r in through_pipeline(values, SENSOR) if not r.revolution.faults)


def follow(
    revolutions: tuple[Revolution, ...], estimator: SlipAngleEstimator, law: SlipCalibration | None = None
) -> list[dict[str, Estimate]]:
    average = settled(revolutions[0])
    conditions = TireConditions(RADIUS_M, tire=TireData(added=(law,)))
    return [{e.name: e for e in estimator.update(revolution, average, conditions)} for revolution in revolutions]


@lru_cache(maxsize=1)
def calibration() -> SlipCalibration:
    """Return the calibration of BELT from its true shapes."""
    results = [first_half(slip) for slip in (-0.1, 0.0, 0.1)]
    ring = radial(4000.0)
    half = ring.half_angle_rad
    return SlipCalibration(
        belt_share=(results[2] - results[0]) / math.radians(0.2),
        belt_share_std=0.004,
        zero_rad=results[1],
        zero_std_rad=math.radians(0.008),
        saturation_prad=2.0,
        saturation_std_prad=1.0,
        zero_share_correlation=0.0,
        share_saturation_correlation=0.0,
        slip_range_rad=(math.radians(-1.0), math.radians(1.0)),
        half_angle_range_rad=(half, half),
        pressure_range_pa=(2.1e5, 2.1e5),
    )


def first_half(slip_deg: float) -> float:
    ring = radial(4000.0)
    shape = lateral(ring, BELT, math.radians(slip_deg)).y_m
    return slopes_of(shape, RADIUS_M, ring.leading_edge_rad, ring.trailing_edge_rad).first_half_rad


ZIGZAG = ((60, 0.0), (12, 1.0), (12, 0.0), (12, -1.0), (12, 0.0))
LEFT_TURN, RIGHT_TURN = slice(63, 70), slice(87, 94)


def mean_of(result: list[dict[str, Estimate]], where: slice, name: str) -> float:
    return float(np.mean([estimates[name].value for estimates in result[where]]))


def test_apparent_slip_has_the_belts_share_and_direction() -> None:
    result = follow(drive(ZIGZAG), SlipAngleEstimator())
    straight, remainder, right = (
        math.degrees(mean_of(result, where, NAMES[0])) for where in (slice(40, 58), LEFT_TURN, RIGHT_TURN)
    )
    assert abs(straight) < 0.01
    assert 0.17 < remainder < 0.26
    assert -0.26 < right < -0.17
    assert {e[NAMES[1]].value for e in result[LEFT_TURN]} == {1.0}
    assert {e[NAMES[1]].value for e in result[RIGHT_TURN]} == {-1.0}
    assert np.mean([e[NAMES[1]].value == 0.0 for e in result[20:58]]) > 0.9


def test_apparent_slip_error_is_the_scatter() -> None:
    exact = replace(calibration(), zero_std_rad=0.0)
    result = follow(drive(ZIGZAG), SlipAngleEstimator(), exact)
    values = [e[NAMES[0]].value for e in result[10:58]]
    assert result[57][NAMES[0]].std == pytest.approx(np.std(values, ddof=1), rel=0.35)
    assert result[57][NAMES[0]].status is Status.VALID
    # A part of the error is shared: the roll, whose own error grows where slip turns the wheel.
    assert result[57][NAMES[0]].scatter_std == pytest.approx(result[57][NAMES[0]].std, rel=0.02)


def test_slip_angle_follows_from_the_belts_share() -> None:
    result = follow(drive(ZIGZAG), SlipAngleEstimator(), calibration())
    assert math.degrees(mean_of(result, LEFT_TURN, SLIP_NAME)) == pytest.approx(1.0, abs=0.12)
    assert math.degrees(mean_of(result, RIGHT_TURN, SLIP_NAME)) == pytest.approx(-1.0, abs=0.12)
    errors = [(e[SLIP_NAME].value - math.radians(1.0)) / e[SLIP_NAME].std for e in result[LEFT_TURN]]
    assert np.abs(errors).max() < 3.5
    assert {e[SLIP_NAME].status for e in result[LEFT_TURN]} == {Status.VALID}
    straight = result[57][SLIP_NAME]
    assert straight.scatter_std < straight.std
    assert straight.scatter_std == pytest.approx(np.std([e[SLIP_NAME].value for e in result[10:58]], ddof=1), rel=0.35)


def test_constant_slip_is_measured_with_a_calibration() -> None:
    mean = follow(drive(((60, 0.8),)), SlipAngleEstimator(), calibration())[-1][MEAN_NAME]
    assert mean.status is Status.VALID
    assert abs(mean.value - math.radians(0.8)) < 3.0 * mean.std
    assert mean.value > 5.0 * mean.std
    assert mean.std < math.radians(0.09)


def test_constant_slip_is_not_reported_as_zero_without_one() -> None:
    result = follow(drive(((60, 0.8),)), SlipAngleEstimator())[-1]
    assert abs(result[NAMES[0]].value) < math.radians(0.05)
    for name in NAMES[:2]:
        assert result[name].status is Status.PROVISIONAL
        assert ForceCode.ZERO_SLIP_IS_MEAN in codes_of(result[name].reasons)
    assert SLIP_NAME not in result


def test_slip_outside_the_calibration_is_provisional() -> None:
    law = replace(
        calibration(), slip_range_rad=(math.radians(-0.3), math.radians(0.3)), half_angle_range_rad=(0.1, 0.12)
    )
    result = follow(drive(((60, 0.8),)), SlipAngleEstimator(), law)[-1][MEAN_NAME]
    assert result.status is Status.PROVISIONAL
    assert {ForceCode.SLIP_OUTSIDE_CALIBRATION, EstimateCode.HALF_ANGLE_OUTSIDE_CALIBRATION} <= set(
        codes_of(result.reasons)
    )


def test_slip_beyond_the_law_is_invalid() -> None:
    law = replace(calibration(), saturation_prad=40.0)
    result = follow(drive(((60, 0.8),)), SlipAngleEstimator(), law)[-1][MEAN_NAME]
    assert result.status is Status.INVALID
    assert codes_of(result.reasons) == (ForceCode.SLIP_BEYOND_LAW,)


def test_left_right_asymmetry_needs_ply_steer() -> None:
    result = follow(drive(ZIGZAG), SlipAngleEstimator())
    # One extremum at right slip, two at left, as in Fig. 2 of the paper.
    assert mean_of(result, RIGHT_TURN, NAMES[2]) > 0.6
    assert -0.65 < mean_of(result, LEFT_TURN, NAMES[2]) < -0.3
    steered = result[-1][NAMES[3]]
    assert steered.status is Status.VALID
    assert steered.value > 0.15
    assert steered.value > 3 * steered.std
    true = sum(lateral_asymmetry(lateral(radial(4000.0), BELT, math.radians(slip)).lateral_m) for slip in (-1.0, 1.0))
    assert steered.value == pytest.approx(true, abs=2 * steered.std)
    plain = follow(drive(ZIGZAG, replace(BELT, coupling_length_m=0.0)), SlipAngleEstimator())[-1][NAMES[3]]
    assert abs(plain.value) < 0.1


def test_one_side_only_has_no_left_right_asymmetry() -> None:
    last = follow(drive(ZIGZAG)[:75], SlipAngleEstimator())[-1][NAMES[3]]
    assert last.status is Status.INVALID
    assert codes_of(last.reasons) == (ForceCode.NEEDS_BOTH_SLIPS,)


def test_learnt_zero_is_provisional_until_settled() -> None:
    result = follow(drive(ZIGZAG), SlipAngleEstimator())
    assert result[1][NAMES[0]].status is Status.PROVISIONAL
    assert result[20][NAMES[0]].status is Status.PROVISIONAL
    assert result[int(REFERENCE_SETTLED) + 2][NAMES[2]].status is Status.VALID
    assert codes_of(result[int(REFERENCE_SETTLED) + 2][NAMES[0]].reasons) == (ForceCode.ZERO_SLIP_IS_MEAN,)


def test_faulty_revolutions_are_rejected() -> None:
    revolution = drive(ZIGZAG)[0]
    bad = replace(revolution, faults=(Reason(EstimateCode.SAMPLES_LOST),))
    result = follow((bad,), SlipAngleEstimator(), calibration())[0]
    assert set(result) == {*NAMES, SLIP_NAME, MEAN_NAME}
    assert all(e.status is Status.INVALID and EstimateCode.SAMPLES_LOST in codes_of(e.reasons) for e in result.values())


def test_asymmetry_of_a_waveform() -> None:
    assert lateral_asymmetry(np.array([0.0, 2.0, -1.0])) == pytest.approx(1 / 3)
    assert lateral_asymmetry(np.array([0.0, -2.0])) == pytest.approx(-1.0)
    assert math.isnan(lateral_asymmetry(np.zeros(4)))


@pytest.mark.parametrize("noise_mg", [5.0, 20.0])
@pytest.mark.parametrize("slip_deg", [-1.0, 0.0, 1.0])
def test_asymmetry_is_true_within_its_error(slip_deg: float, noise_mg: float) -> None:
    sensor = Sensor(noise_mg=noise_mg, roll_rad=0.02)
    ring = radial(4000.0)
    shape = lateral(ring, BELT, math.radians(slip_deg))
    results = through_pipeline(samples(ring, [(70, shape)], sensor), sensor)
    estimates = [e[NAMES[2]] for e in follow(tuple(r.revolution for r in results), SlipAngleEstimator())][50:]
    assert all(e.status is Status.VALID for e in estimates)
    # What is left out beyond order 40 moves it by at most 0.02.
    errors = np.array([(e.value - lateral_asymmetry(shape.lateral_m)) / math.hypot(e.std, 0.02) for e in estimates])
    assert np.abs(errors).max() < 3.0
    assert np.sqrt((errors**2).mean()) > 0.2
    scatter = np.std([e.value for e in estimates])
    assert scatter == pytest.approx(estimates[-1].scatter_std, rel=0.5)


def test_asymmetry_hidden_by_noise_has_the_error_of_its_range() -> None:
    sensor = Sensor(noise_mg=5.0)
    ring = radial(4000.0)
    flat = replace(lateral(ring, BELT, 0.0), lateral_m=np.zeros_like(ring.theta_rad))
    results = through_pipeline(samples(ring, [(70, flat)], sensor), sensor)
    last = follow(tuple(r.revolution for r in results), SlipAngleEstimator())[-1][NAMES[2]]
    assert last.std > 0.5
