"""Grade of the road: a hill and braking by positions differentiated twice, a steady grade, and other axes."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from bench_grade import ESTIMATORS, eased, grade_of
from bench_turning import RATE_HZ, random_car
from independent_tire.driving import MARGIN, OVERSAMPLED, Course

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.revolution_block import extended
from gateway.core.reasons import codes_of
from gateway.core.revolutions.sensor_mounting import belt_kinematics
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.forces.reasons import ForceCode
from gateway.forces.road_grade import NAME, RoadGradeEstimator
from tests.testkit.exact_ring import RADIUS_M, solution
from tests.testkit.revolution_data import CONDITIONS, OMEGA, exact_wave, make_revolution
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


def bouncing(seed: int, rise_rad: float, uptime_s: float | None = None) -> list[Estimate]:
    """Return those of 400 revolutions of a hub that bounces, on a grade that rises after half of them.

    Where its uptime at the start is given, the hub restarts after 300 of them.
    """
    rng = np.random.default_rng(seed)
    wave = make_revolution(exact_wave(solution()))
    average = extended(RunningAverage(), wave)
    shape = belt_kinematics(average.radial_mps2, 0.0, 0.5 * (average.leading_edge_rad + average.trailing_edge_rad))
    sine, cosine = np.sin(shape.inclination_rad), np.cos(shape.inclination_rad)
    estimator, given, time_s, speed = RoadGradeEstimator(), [], uptime_s or 0.0, RADIUS_M * OMEGA
    for index in range(400):
        if index == 300 and uptime_s is not None:
            time_s = 2.0
        pace = 1.5 * math.sin(0.4 * time_s)
        period_s = math.tau * RADIUS_M / speed
        force = pace + STANDARD_GRAVITY_MPS2 * math.sin(0.02 + rise_rad * (index >= 200)) + rng.normal(0.0, 0.25)
        along = STANDARD_GRAVITY_MPS2 * sine + pace * (1.0 - cosine) - (force - pace) * cosine
        axes = np.stack([along, np.zeros_like(along), wave.axes_mps2[2]])
        rolled = replace(wave, axes_mps2=axes, start_s=time_s, period_s=period_s, omega_radps=speed / RADIUS_M)
        rolled = replace(rolled, omega_dot_radps2=pace / RADIUS_M)
        given.append(estimator.update(rolled, average, CONDITIONS)[0])
        time_s += period_s
        speed += pace * period_s
    return given


def statuses(seed: int, rise_rad: float) -> list[Status]:
    return [estimate.status for estimate in bouncing(seed, rise_rad)]


@pytest.mark.parametrize("uptime_s", [12.0, 600.0, 7200.0])
def test_a_hub_that_restarts_gives_the_grade_again(uptime_s: float) -> None:
    for estimate in bouncing(11, 0.06, uptime_s)[300:]:
        assert abs(estimate.value - 0.08) < 3.0 * estimate.std
        assert 0.002 < estimate.std < 0.1


def test_noise_of_a_steady_grade_is_no_change_however_long_it_lasts() -> None:
    for seed in range(6):
        assert Status.VALID not in statuses(seed, 0.0)


@pytest.mark.parametrize("rise_rad", [0.06, -0.06])
def test_hill_is_a_change_and_lasts(rise_rad: float) -> None:
    given = statuses(11, rise_rad)
    assert Status.VALID not in given[:200]
    assert set(given[260:]) == {Status.VALID}


@pytest.mark.parametrize("factor", [-1.0, 0.2])
def test_axis_without_gravity_gives_no_grade(factor: float) -> None:
    values = samples(radial(), [(12, lateral(radial()))], SENSOR)
    values[:, 0] *= factor
    *_, last = through_pipeline(values, SENSOR, ["self-calibration", "grade"])
    estimate = next(estimate for estimate in last.estimates if estimate.name == NAME)
    assert estimate.status is Status.INVALID
    assert ForceCode.NO_GRAVITY_ALONG in codes_of(estimate.reasons)
