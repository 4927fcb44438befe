"""The sign of lateral axes by the outer wheel of a curve, which rolls faster."""

from dataclasses import replace

import numpy as np
import pytest

from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.results import RevolutionResult
from gateway.core.reasons import Reason
from gateway.core.trust.lateral_signs import LateralSign
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.turn_verdict import TURN_RATE
from gateway.core.trust.wheel_pairs import ALARM, WheelPairs
from tests.testkit.exact_ring import solution
from tests.testkit.revolution_data import exact_wave, make_revolution

REVOLUTION = make_revolution(exact_wave(solution()))
RADIUS_M, TRACK_M = 0.32, 1.55
SPEED_MPS = RADIUS_M * REVOLUTION.omega_radps
NOTE = Reason(TrustCode.LATERAL_SIGN_UNVERIFIED)
# Straights and a curve to the left of 0.1 g for 3 s.
CURVE = np.concatenate([np.zeros(60), np.full(round(3.0 / REVOLUTION.period_s), 0.98 / SPEED_MPS), np.zeros(160)])


def results(position: str, rates_radps: np.ndarray, axis: float, lever_m: float, seed: int) -> list[RevolutionResult]:
    """Return revolutions of a wheel `lever_m` to the right, whose axis reads the turn rate times `axis`."""
    rng = np.random.default_rng(seed)
    read = axis * rates_radps + rng.normal(0.0, 0.006, len(rates_radps)) + 0.004
    speeds = 0.995 * (SPEED_MPS + rates_radps * lever_m) * (1.0 + rng.normal(0.0, 5e-4, len(rates_radps)))
    return [
        RevolutionResult(
            position,
            round(1e9 * (index + 1) * REVOLUTION.period_s),
            replace(REVOLUTION, omega_radps=float(speed) / RADIUS_M),
            TireConditions(RADIUS_M, radius_std_m=0.003 * RADIUS_M),
            (
                Estimate("ply_steer_peak_rad", 0.01, 0.001, Status.VALID, (NOTE,)),
                Estimate(TURN_RATE, float(rate), 0.01, Status.VALID),
            ),
        )
        for index, (rate, speed) in enumerate(zip(read, speeds, strict=True))
    ]


def judged(
    rates_radps: np.ndarray, left_axis: float, right_axis: float
) -> tuple[dict[str, set[Reason]], dict[str, Status], WheelPairs]:
    """Return reasons and status of the ply steer of the last revolution of either wheel, and the comparison."""
    pairs = WheelPairs()
    taken = [
        *results("FL", rates_radps, left_axis, -0.5 * TRACK_M, 1),
        *results("FR", rates_radps, right_axis, 0.5 * TRACK_M, 2),
    ]
    reasons, statuses = {}, {}
    for result, _ in pairs.compared(taken):
        reasons[result.position] = set(result.estimates[0].reasons)
        statuses[result.position] = result.estimates[0].status
    return reasons, statuses, pairs


@pytest.mark.parametrize("rates_radps", [CURVE, -CURVE])
def test_first_curve_verifies_the_sign_of_both_axes(rates_radps: np.ndarray) -> None:
    reasons, _, pairs = judged(rates_radps, 1.0, 1.0)
    assert reasons == {"FL": set(), "FR": set()}
    assert list(pairs.alarms()) == []


def test_axis_that_points_to_the_right_is_an_alarm_at_its_wheel() -> None:
    reasons, statuses, pairs = judged(CURVE, 1.0, -1.0)
    assert reasons["FL"] == set()
    assert reasons["FR"] == {NOTE, Reason(TrustCode.LATERAL_AXIS_REVERSED, other="FL")}
    assert statuses == {"FL": Status.VALID, "FR": Status.PROVISIONAL}
    assert [(alarm.position, alarm.name) for alarm in pairs.alarms()] == [("FR", ALARM)]


@pytest.mark.parametrize(("axis", "turn_axis", "sign"), [(1.0, 0.0, 1), (-1.0, 0.0, -1), (-1.0, 1.0, 0)])
def test_side_force_shows_the_sign_where_turn_rates_do_not(axis: float, turn_axis: float, sign: int) -> None:
    rng, shown = np.random.default_rng(4), LateralSign()
    for index, rate_radps in enumerate(CURVE):
        # The belt's shift warms up with the tire, and turn rates of a tire that is not known yet scatter.
        shift_m = axis * 2e-3 * rate_radps + 1e-7 * index + rng.normal(0.0, 2e-5)
        ratio = 1.0 + TRACK_M * rate_radps / SPEED_MPS + rng.normal(0.0, 3e-4)
        shown.take(turn_axis * rate_radps + rng.normal(0.0, 0.01), SPEED_MPS, ratio, shift_m)
    assert shown.sign == sign


def test_shift_of_a_tire_that_warms_up_is_no_curve() -> None:
    rng, shown = np.random.default_rng(5), LateralSign()
    for index in range(4000):
        # A thousandth of the radius and a tenth of a millimetre.
        ratio = 1.0 + 2.5e-7 * index + rng.normal(0.0, 5e-4)
        shown.take(float(rng.normal(0.0, 0.006)), SPEED_MPS, ratio, 2.5e-8 * index + rng.normal(0.0, 2e-5))
    assert shown.sign == 0


def test_straights_say_nothing_of_the_sign() -> None:
    reasons, _, _ = judged(np.zeros(len(CURVE)), 1.0, -1.0)
    assert reasons == {"FL": {NOTE}, "FR": {NOTE}}


def braking(position: str, radius_m: float, seed: int) -> list[RevolutionResult]:
    """Return revolutions of a wheel on a straight from 28 to 9 m/s, whose turn rate strays for some revolutions."""
    speed_mps, deceleration_mps2, time_s, stray_radps = 28.0, 2.5, 0.0, 0.0
    rng, taken = np.random.default_rng(seed), []
    while speed_mps > 9.0:
        period_s = 2.0 * np.pi * radius_m / speed_mps
        middle_mps = speed_mps - 0.5 * deceleration_mps2 * period_s
        speed_mps, time_s = speed_mps - deceleration_mps2 * period_s, time_s + period_s
        stray_radps = 0.8 * stray_radps + rng.normal(0.0, 0.006)
        revolution = replace(
            REVOLUTION,
            omega_radps=middle_mps / radius_m,
            omega_dot_radps2=-deceleration_mps2 / radius_m,
            period_s=period_s,
        )
        estimates = (Estimate(TURN_RATE, stray_radps, 0.01, Status.VALID),)
        conditions = TireConditions(radius_m, radius_std_m=0.003 * radius_m)
        taken.append(RevolutionResult(position, round(1e9 * time_s), revolution, conditions, estimates))
    return taken


def test_braking_is_no_curve_though_the_wheels_revolve_at_other_times() -> None:
    verified = []
    for seed in range(6):
        pairs = WheelPairs()
        for _ in pairs.compared([*braking("FL", 0.32, 2 * seed), *braking("FR", 0.3205, 2 * seed + 1)]):
            pass
        verified += [position for position in ("FL", "FR") if pairs.axis(position).sign]
    assert verified == []


def test_revolution_without_an_acceleration_is_no_curve() -> None:
    """The first one of a wheel has no neighbour before it, and the belt's shift has not settled."""
    rng, taken = np.random.default_rng(6), []
    for position, start_s in (("FL", 0.0), ("FR", 0.02)):
        wheel, time_s = braking(position, 0.32, 1), start_s
        for index, item in enumerate(wheel[:60]):
            time_s += item.revolution.period_s
            omega_dot_radps2 = item.revolution.omega_dot_radps2
            slower_radps = omega_dot_radps2 * start_s
            revolution = replace(
                item.revolution,
                omega_radps=item.revolution.omega_radps + slower_radps,
                omega_dot_radps2=omega_dot_radps2 if index or start_s else 0.0,
            )
            shift_m = -3e-4 - 1.7e-4 * np.exp(-index / 2.0) + rng.normal(0.0, 5e-6)
            estimates = (Estimate("belt_shift_m", shift_m, 1e-4, Status.VALID),)
            taken.append(replace(item, host_ns=round(1e9 * time_s), revolution=revolution, estimates=estimates))
    pairs = WheelPairs()
    list(pairs.compared(taken))
    assert [pairs.axis(position).sign for position in ("FL", "FR")] == [0, 0]


def test_rates_without_a_difference_of_speeds_say_nothing() -> None:
    rng = np.random.default_rng(3)
    sign = LateralSign()
    for rate in rng.normal(0.0, 0.1, 400):
        sign.take(float(rate), 18.0, 1.0 + float(rng.normal(0.0, 1e-3)))
    sign.take(float("nan"), 18.0, 1.0)
    assert sign.sign == 0


@pytest.mark.parametrize(("wrong", "right", "sign"), [(900, 0, -1), (900, 300, 1), (30_000, 300, 1), (900, 100, -1)])
def test_sign_that_was_wrong_ends_with_the_latest_curves(wrong: int, right: int, sign: int) -> None:
    """Straights behind it contradict nothing."""
    rng, taken = np.random.default_rng(5), LateralSign()
    axis = np.repeat([-1.0, 1.0], [wrong, right])
    rates = np.where(np.arange(len(axis)) // 40 % 3 == 1, 0.2, 0.0) + rng.normal(0.0, 0.006, len(axis))
    ratios = 1.0 + TRACK_M * rates / SPEED_MPS + rng.normal(0.0, 5e-4, len(axis))
    for rate, ratio in zip([*(axis * rates), *rng.normal(0.0, 0.006, 3000)], [*ratios, *[1.0] * 3000], strict=True):
        taken.take(float(rate), SPEED_MPS, float(ratio))
    assert taken.sign == sign


@pytest.mark.parametrize("missing", [0.0, 0.05])
def test_revolutions_with_gaps_say_nothing_of_a_pair(missing: float) -> None:
    taken = [
        replace(item, revolution=replace(item.revolution, missing_fraction=missing))
        for position, lever, axis in (("FL", -0.5, 1.0), ("FR", 0.5, -1.0))
        for item in results(position, CURVE, axis, lever * TRACK_M, 7)
    ]
    pairs = WheelPairs()
    list(pairs.compared(taken))
    assert bool(list(pairs.alarms())) is not bool(missing)
