"""Grade of the road: a hill and braking by positions differentiated twice, a steady grade, and other axes."""

import math
from functools import cache

import numpy as np
import pytest
from bench_grade import ESTIMATORS, eased, grade_of
from bench_turning import RATE_HZ, random_car
from independent_tire.driving import MARGIN, OVERSAMPLED, Course

from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.reasons import codes_of
from gateway.forces.reasons import ForceCode
from gateway.forces.road_grade import NAME
from tools.generators.lateral_signals import Sensor, disturbed, lateral, radial, samples, through_pipeline

SENSOR = Sensor(noise_mg=5.0, road_mps2=1.0, roll_rad=0.02, yaw_rad=0.01, pitch_rad=-0.02, seed=5)
HILL_RAD = math.radians(4.0)


@cache
def drive(*, is_steady: bool, curve_mps2: float = 0.0) -> list[tuple[float, float, Estimate]]:
    """Return time, true grade and estimate of each revolution of a drive that climbs, and brakes after it."""
    car = random_car(np.random.default_rng(4))
    step = 1.0 / (RATE_HZ * OVERSAMPLED)
    time = step * np.arange(round((8.0 if is_steady else 20.0) / step) + 2 * MARGIN)
    none = np.zeros_like(time)
    braked = none if is_steady else eased(time, [(15.0, -2.5), (17.5, 0.0)])
    speed = 20.0 + np.cumsum(braked) * step
    grade = none + HILL_RAD if is_steady else eased(time, [(5.0, HILL_RAD), (11.0, 0.0)])
    lateral = eased(time, [(4.0, curve_mps2), (7.0, 0.0)])
    course = Course(step, speed, np.cumsum(lateral / speed) * step, car.slip_rad(lateral), none, grade, none)
    values = disturbed(car.tire.felt(course, 0.0)[0], SENSOR)
    results = through_pipeline(values, SENSOR, ESTIMATORS, load_n=car.load_n, pressure_pa=car.pressure_pa)
    rows = []
    for result in results:
        estimate = next(estimate for estimate in result.estimates if estimate.name == NAME)
        rows.append((result.revolution.start_s, grade_of(result, course), estimate))
    return [row for row in rows if math.isfinite(row[1])]


@pytest.mark.parametrize("curve_mps2", [0.0, 4.0, -4.0])
def test_hill_is_climbed_and_braking_is_none(curve_mps2: float) -> None:
    rows = drive(is_steady=False, curve_mps2=curve_mps2)
    for _, truth, estimate in rows:
        assert abs(estimate.value - truth) < 3.5 * estimate.std
    on_hill = [estimate for time_s, _, estimate in rows if 9.0 < time_s < 11.0]
    braking = [estimate for time_s, _, estimate in rows if 15.5 < time_s < 17.5]
    assert np.mean([estimate.value for estimate in on_hill]) == pytest.approx(HILL_RAD, abs=math.radians(0.8))
    # A quarter of a g of braking is 15 deg, were it taken for a grade.
    assert max(abs(estimate.value) for estimate in braking) < math.radians(1.5)
    assert {estimate.status for estimate in braking} == {Status.VALID}
    assert max(estimate.std for estimate in braking) < math.radians(1.5)


def test_steady_grade_is_provisional_and_within_its_error() -> None:
    rows = drive(is_steady=True)
    last = rows[-1][2]
    assert ForceCode.GRADE_NOT_CHANGED in codes_of(last.reasons)
    assert all(estimate.status is Status.PROVISIONAL for _, _, estimate in rows)
    assert abs(last.value - HILL_RAD) < 2.5 * last.std < math.radians(3.0)


@pytest.mark.parametrize("factor", [-1.0, 0.2])
def test_axis_without_gravity_gives_no_grade(factor: float) -> None:
    values = samples(radial(), [(12, lateral(radial()))], SENSOR)
    values[:, 0] *= factor
    *_, last = through_pipeline(values, SENSOR, ["self-calibration", "grade"])
    estimate = next(estimate for estimate in last.estimates if estimate.name == NAME)
    assert estimate.status is Status.INVALID
    assert ForceCode.NO_GRAVITY_ALONG in codes_of(estimate.reasons)
