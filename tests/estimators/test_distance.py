"""Distance rolled, over gaps and restarts, and the exact distance of a simulated wheel."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.estimators.distance import DistanceEstimator
from gateway.estimators.estimator import Estimate, Status
from gateway.pipeline.tire_estimates import _Series
from gateway.pipeline.wheel_setup import WheelSetup
from gateway.reasons import Code, Reason, codes_of
from tests.testkit.exact_ring import RADIUS_M, solution
from tests.testkit.revolution_data import CONDITIONS, exact_wave, make_revolution, settled
from tests.testkit.simulated_wheel import last, simulated

REVOLUTION = make_revolution(exact_wave(solution()))
AVERAGE = settled(REVOLUTION)
TURN_M = 2.0 * math.pi * RADIUS_M


def rolled(starts_s: list[float], radius_std_m: float = 0.0) -> Estimate:
    estimator = DistanceEstimator()
    conditions = replace(CONDITIONS, radius_std_m=radius_std_m)
    for start_s in starts_s:
        (result,) = estimator.update(replace(REVOLUTION, start_s=start_s), AVERAGE, conditions)
    return result


def test_distance_is_one_circumference_a_turn() -> None:
    result = rolled([k * REVOLUTION.period_s for k in range(10)], radius_std_m=0.01 * RADIUS_M)
    assert result.value == pytest.approx(10.0 * TURN_M)
    assert result.std == pytest.approx(0.1 * TURN_M)
    assert result.status is Status.VALID


def test_short_gap_counts_whole_turns() -> None:
    result = rolled([k * REVOLUTION.period_s for k in (0, 1, 4.02, 5.02)])
    assert result.value == pytest.approx(6.0 * TURN_M)
    assert result.status is Status.VALID
    assert result.std == 0.0


def test_long_gap_is_bridged_with_its_error() -> None:
    period = REVOLUTION.period_s
    result = rolled([0.0, period, 2.0 * period + 10.0])
    assert result.status is Status.PROVISIONAL
    assert result.value == pytest.approx(3.0 * TURN_M + 10.0 / period * TURN_M)
    # 1 m/s^2 over ten seconds is up to 25 m to either side.
    assert result.std == pytest.approx(25.0 / math.sqrt(3.0))
    (bridged,) = result.reasons
    assert bridged["duration_s"] == pytest.approx(10.0)


def test_turns_between_contacts_that_were_not_seen_need_not_be_whole() -> None:
    estimator = DistanceEstimator()
    for faults, std in (((), 0.0), ((Reason(Code.CONTACT_INTERPOLATED),), 0.5 * TURN_M)):
        (result,) = estimator.update(replace(REVOLUTION, turns=2, faults=faults), AVERAGE, CONDITIONS)
        assert result.std == pytest.approx(std)


def test_restarted_hub_time_makes_the_distance_provisional() -> None:
    result = rolled([100.0, 100.0 + REVOLUTION.period_s, 2.0])
    assert codes_of(result.reasons) == (Code.DISTANCE_INTERRUPTED,)
    assert result.value == pytest.approx(3.0 * TURN_M)


def test_reset_starts_at_zero() -> None:
    estimator = DistanceEstimator()
    estimator.update(REVOLUTION, AVERAGE, CONDITIONS)
    estimator.reset()
    assert estimator.update(REVOLUTION, AVERAGE, CONDITIONS)[0].value == pytest.approx(TURN_M)


def test_unknown_radius_gives_no_distance() -> None:
    (result,) = DistanceEstimator().update(REVOLUTION, AVERAGE, replace(CONDITIONS, radius_m=math.nan))
    assert result.status is Status.INVALID


def test_simulated_distance_over_a_drive() -> None:
    setup = WheelSetup("FL", 0, 0, 0.32, load_n=5000.0, radius_std_m=0.0032)
    tables = "[motion]\nspeed_kmh = [[0, 40], [10, 80], [20, 60]]"
    results, truth = simulated(tables, 20.0, setup, ("kinematic", "distance"))
    result = last(results)
    first, end = results[0].revolution.start_s, results[-1].revolution.start_s + results[-1].revolution.period_s
    shift = truth.hub_s(0.0)
    angles = truth.angle_rad(np.array([first - shift, end - shift]))
    assert result["distance_m"].value == pytest.approx(0.32 * float(angles[1] - angles[0]), rel=1e-4)
    assert result["distance_m"].std == pytest.approx(0.01 * result["distance_m"].value, rel=1e-3)
    omega = truth.omega_radps(0.5 * (results[-1].revolution.start_s + end) - shift)
    assert result["angular_speed_radps"].value == pytest.approx(omega, rel=2e-3)
    assert result["rotation_rpm"].value == pytest.approx(60.0 / results[-1].revolution.period_s, rel=1e-9)


def test_distance_goes_on_where_known_effects_do_not_hold() -> None:
    with_effects = _Series(("kinematic", "distance"))
    without = _Series(("kinematic", "distance"), with_effects)
    shared, separate = (
        [made for made in series.estimators if made.name == "distance"] for series in (with_effects, without)
    )
    assert shared[0] is separate[0]
    assert without.estimators[0] is not with_effects.estimators[0]
