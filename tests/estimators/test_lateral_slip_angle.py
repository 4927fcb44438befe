"""Slip, its direction and its asymmetry from the lateral axis."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from gateway.estimators.estimator import Estimate, Revolution, Status, TireConditions
from gateway.estimators.slip_angle import (
    NAMES,
    REFERENCE_SETTLED,
    SLIP_NAME,
    SlipAngleEstimator,
    lateral_asymmetry,
    slip_asymmetry,
)
from gateway.physics.lateral_belt import LateralBelt
from gateway.reasons import Code, Reason, codes_of
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


def follow(revolutions: tuple[Revolution, ...], estimator: SlipAngleEstimator) -> list[dict[str, Estimate]]:
    average = settled(revolutions[0])
    return [
        {e.name: e for e in estimator.update(revolution, average, TireConditions(RADIUS_M))}
        for revolution in revolutions
    ]


ZIGZAG = ((60, 0.0), (12, 1.0), (12, 0.0), (12, -1.0), (12, 0.0))
LEFT, RIGHT = slice(63, 70), slice(87, 94)


def mean_of(found: list[dict[str, Estimate]], where: slice, name: str) -> float:
    return float(np.mean([estimates[name].value for estimates in found[where]]))


def test_apparent_slip_has_the_belts_share_and_direction() -> None:
    found = follow(drive(ZIGZAG), SlipAngleEstimator())
    straight, left, right = (math.degrees(mean_of(found, where, NAMES[0])) for where in (slice(40, 58), LEFT, RIGHT))
    assert abs(straight) < 0.01
    assert 0.17 < left < 0.26
    assert -0.26 < right < -0.17
    assert {e[NAMES[1]].value for e in found[LEFT]} == {1.0}
    assert {e[NAMES[1]].value for e in found[RIGHT]} == {-1.0}
    assert np.mean([e[NAMES[1]].value == 0.0 for e in found[20:58]]) > 0.9


def test_apparent_slip_error_is_the_scatter() -> None:
    found = follow(drive(ZIGZAG), SlipAngleEstimator(zero_slope_rad=0.0))
    values = [e[NAMES[0]].value for e in found[10:58]]
    assert found[57][NAMES[0]].std == pytest.approx(np.std(values, ddof=1), rel=0.35)
    assert found[57][NAMES[0]].status is Status.VALID


def test_slip_angle_follows_from_the_belts_share() -> None:
    found = follow(drive(ZIGZAG), SlipAngleEstimator(belt_share=0.21))
    assert math.degrees(mean_of(found, LEFT, SLIP_NAME)) == pytest.approx(1.0, abs=0.12)
    assert math.degrees(mean_of(found, RIGHT, SLIP_NAME)) == pytest.approx(-1.0, abs=0.12)


def test_left_right_asymmetry_needs_ply_steer() -> None:
    found = follow(drive(ZIGZAG), SlipAngleEstimator())
    # One extremum at right slip, two at left, as in Fig. 2 of the paper.
    assert mean_of(found, RIGHT, NAMES[2]) > 0.6
    assert -0.65 < mean_of(found, LEFT, NAMES[2]) < -0.3
    steered = found[-1][NAMES[3]]
    assert steered.status is Status.VALID
    assert steered.value > 0.15
    assert steered.value > 5 * steered.std
    plain = follow(drive(ZIGZAG, replace(BELT, coupling_length_m=0.0)), SlipAngleEstimator())[-1][NAMES[3]]
    assert abs(plain.value) < 0.1


def test_one_side_only_has_no_left_right_asymmetry() -> None:
    last = follow(drive(ZIGZAG)[:75], SlipAngleEstimator())[-1][NAMES[3]]
    assert last.status is Status.INVALID
    assert codes_of(last.reasons) == (Code.NEEDS_BOTH_SLIPS,)


def test_learnt_zero_is_provisional_until_settled() -> None:
    found = follow(drive(ZIGZAG), SlipAngleEstimator())
    assert found[1][NAMES[0]].status is Status.PROVISIONAL
    assert found[20][NAMES[0]].status is Status.PROVISIONAL
    assert found[int(REFERENCE_SETTLED) + 2][NAMES[0]].status is Status.VALID
    assert codes_of(found[int(REFERENCE_SETTLED) + 2][NAMES[0]].reasons) == (Code.ZERO_SLIP_IS_MEAN,)


def test_faulty_revolutions_are_rejected() -> None:
    revolution = drive(ZIGZAG)[0]
    bad = replace(revolution, faults=(Reason(Code.SAMPLES_LOST),))
    found = follow((bad,), SlipAngleEstimator(belt_share=0.2))[0]
    assert set(found) == {*NAMES, SLIP_NAME}
    assert all(e.status is Status.INVALID and Code.SAMPLES_LOST in codes_of(e.reasons) for e in found.values())


def test_pure_asymmetries() -> None:
    wave = np.sin(np.linspace(0, 6, 100))
    assert slip_asymmetry(wave, -wave) == pytest.approx(0.0)
    assert slip_asymmetry(wave + 0.1, -wave + 0.1) > 0.05
    assert math.isnan(slip_asymmetry(wave, wave))
    assert lateral_asymmetry(np.array([0.0, 2.0, -1.0])) == pytest.approx(1 / 3)
    assert lateral_asymmetry(np.array([0.0, -2.0])) == pytest.approx(-1.0)
    assert math.isnan(lateral_asymmetry(np.zeros(4)))
