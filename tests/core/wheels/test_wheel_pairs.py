"""Left and right wheels that slip to one side, or to opposite ones."""

from dataclasses import replace
from itertools import chain

import numpy as np
import pytest

from gateway.core.estimates.estimator import Estimate, Revolution, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.quantity_catalogue import declared
from gateway.core.reasons import Code, Reason
from gateway.core.revolutions.axis_relations import Lag
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.wheel_pairs import WheelPairs
from tests.testkit.exact_ring import solution
from tests.testkit.revolution_data import exact_wave, make_revolution
from tests.testkit.simulated_wheel import restated

REVOLUTION = make_revolution(exact_wave(solution()))
(OF_AXLE,) = (quantity.name for quantity in declared() if quantity.is_of_axle)


def results(
    position: str,
    directions: list[float],
    late_s: float = 0.0,
    radius_m: float = 0.32,
    revolution: Revolution = REVOLUTION,
) -> list[RevolutionResult]:
    """Return a revolution of each direction, one after the other, of a wheel whose radius is stated within 0.3 %."""
    return [
        RevolutionResult(
            position,
            round(1e9 * ((index + 1) * revolution.period_s + late_s)),
            revolution,
            TireConditions(radius_m, radius_std_m=0.003 * radius_m),
            (
                Estimate(OF_AXLE, direction, float("nan"), Status.PROVISIONAL),
                Estimate("speed_mps", radius_m * revolution.omega_radps, 0.06, Status.VALID),
                Estimate("ply_steer_peak_rad", 0.01, 0.001, Status.VALID),
            ),
        )
        for index, direction in enumerate(directions)
    ]


def alarms(*taken: RevolutionResult) -> dict[str, Code]:
    pairs = WheelPairs()
    for _ in pairs.compared(list(taken)):
        pass
    return {alarm.position: alarm.reason.code for alarm in pairs.alarms()}


def rows(*taken: RevolutionResult) -> dict[tuple[str, int], dict[str, Estimate]]:
    """Return the estimates of each result as compared, by wheel and time."""
    compared = WheelPairs().compared(list(taken))
    return {(item.position, item.host_ns): {e.name: e for e in item.estimates} for item, _ in compared}


TURNS = [1.0, 1.0, 1.0, 0.0, 0.0, -1.0, -1.0, -1.0, -1.0, 1.0, 1.0, 1.0]
BACK = [-turn for turn in TURNS]


@pytest.mark.parametrize(("left_wheel", "right_wheel"), [("FL", "FR"), ("rear.left", "rear.right")])
def test_opposite_slip_is_an_alarm_at_both_wheels(left_wheel: str, right_wheel: str) -> None:
    opposite = dict.fromkeys((left_wheel, right_wheel), TrustCode.LATERAL_SLIP_APART)
    assert alarms(*results(left_wheel, TURNS), *results(right_wheel, BACK, 0.01)) == opposite
    assert alarms(*results(left_wheel, TURNS), *results(right_wheel, TURNS, 0.01)) == {}


def test_alarm_of_slip_ends_with_the_latest_revolutions() -> None:
    """However long the wheels have slipped apart, as where contacts of one were wrong for a while."""
    apart, together = [1.0] * 1000, [1.0] * 200
    left_wheel, right = results("FL", apart + together), results("FR", [-1.0] * 1000 + together, 0.01)
    assert alarms(*left_wheel[:1000], *right[:1000]) != {}
    assert alarms(*left_wheel, *right) == {}


def test_order_of_the_revolutions_does_not_matter() -> None:
    left_wheel, right = results("FL", TURNS), results("FR", BACK, 0.02)
    alternating = list(chain.from_iterable(zip(left_wheel, right, strict=True)))
    assert alarms(*alternating) == alarms(*right, *left_wheel) == alarms(*left_wheel, *right) != {}


def test_slip_that_lost_revolutions_repeat_says_nothing() -> None:
    """An average stays as it was through them, so they are no further pairs of revolutions."""
    lost = replace(REVOLUTION, faults=(Reason(EstimateCode.SAMPLES_LOST),))
    left_wheel, right = results("FL", [1.0] * 40, revolution=lost), results("FR", [-1.0] * 40, 0.01, revolution=lost)
    assert alarms(*left_wheel, *right) == {}
    assert alarms(*results("FL", [1.0] * 40), *results("FR", [-1.0] * 40, 0.01)) != {}


def test_few_revolutions_or_another_axle_say_nothing() -> None:
    assert alarms(*results("FL", TURNS[:7]), *results("FR", BACK[:7])) == {}
    assert alarms(*results("FL", TURNS), *results("RR", BACK)) == {}
    # At another time.
    assert alarms(*results("FL", TURNS), *results("FR", BACK, 100.0)) == {}


def test_revolutions_without_host_times_say_nothing() -> None:
    left_wheel, right = (
        [replace(result, host_ns=0) for result in results(*item)] for item in (("FL", [1.0] * 12), ("FR", [-1.0] * 12))
    )
    assert alarms(*left_wheel, *right) == {}


def test_wheels_that_slip_by_chance_say_nothing() -> None:
    rng = np.random.default_rng(1)
    left_wheel, right = (rng.choice([-1.0, 1.0], 200).tolist() for _ in range(2))
    assert alarms(*results("FL", left_wheel), *results("FR", right)) == {}


def test_rows_of_both_wheels_have_the_contradiction_of_their_slip() -> None:
    left_wheel, right = results("FL", TURNS * 12), results("FR", BACK * 12, 0.02)
    judged = rows(*left_wheel, *right)
    assert judged == rows(*chain.from_iterable(zip(left_wheel, right, strict=True)))
    for position in ("FL", "FR"):
        of_wheel = [judged[key] for key in sorted(judged) if key[0] == position]
        statuses = [estimates["ply_steer_peak_rad"].status for estimates in of_wheel]
        # From ten seconds behind the comparison on, as live.
        first = statuses.index(Status.PROVISIONAL)
        assert 9.0 < first * REVOLUTION.period_s < 13.0
        assert set(statuses[first:]) == {Status.PROVISIONAL}
        (reason,) = of_wheel[-1]["ply_steer_peak_rad"].reasons
        assert reason.code is TrustCode.LATERAL_SLIP_APART
        assert all(estimates["speed_mps"].status is Status.VALID for estimates in of_wheel)


@pytest.mark.parametrize(("radius_m", "apart"), [(0.32, False), (0.323, False), (0.34, True), (0.30, True)])
def test_wheels_that_roll_apart_doubt_each_other(radius_m: float, apart: bool) -> None:
    """At 65 km/h a curve explains 2.6 %: 0.26 g over the widest track."""
    straight = [0.0] * 280
    left_wheel, right = results("FL", straight), results("FR", straight, 0.01, radius_m)
    expected = dict.fromkeys(("FL", "FR"), TrustCode.WHEELS_ROLL_APART) if apart else {}
    assert alarms(*left_wheel, *right) == expected
    last = {key[0]: estimates for key, estimates in rows(*left_wheel, *right).items()}
    for position, item, other in (("FL", 0.32, radius_m), ("FR", radius_m, 0.32)):
        speed = last[position]["speed_mps"]
        assert speed.status is (Status.PROVISIONAL if apart else Status.VALID)
        if apart:
            assert speed.reasons[0]["effect"] == pytest.approx(abs(other / item - 1.0))


@pytest.mark.parametrize(("slow_radius_m", "goes_on"), [(0.34, True), (0.32, False)])
def test_a_slow_stretch_does_not_end_what_a_fast_one_has_shown(slow_radius_m: float, goes_on: bool) -> None:
    """At 22 km/h a curve would explain the 6 % that none explains at 65 km/h; speeds that agree end the alarm."""
    fast, straight = [0.0] * 160, [0.0] * 160
    slow = replace(REVOLUTION, period_s=3.0 * REVOLUTION.period_s, omega_radps=REVOLUTION.omega_radps / 3.0)
    begin_s = len(fast) * REVOLUTION.period_s
    taken = [
        *chain(results("FL", fast), results("FR", fast, 0.01, 0.34)),
        *chain(results("FL", straight, begin_s, 0.32, slow), results("FR", straight, begin_s, slow_radius_m, slow)),
    ]
    assert alarms(*taken) == (dict.fromkeys(("FL", "FR"), TrustCode.WHEELS_ROLL_APART) if goes_on else {})
    assert alarms(*taken[320:]) == {}


CAR = """
[motion]
speed_kmh = 40.0
[road]
rms_mps2 = 2.0
bandwidth_hz = 400.0
[tire]
cord_angle_deg = 22
ply_separation_mm = 1.4
[sensor]
range_g = 1000
rate_hz = 9600
offset_mm = 2.0
noise_mg_rthz = 5.0
"""
SETUP = WheelSetup("FL", 0, 0, 0.32, radius_std_m=0.0032, load_n=5000.0, pressure_pa=210e3)
SAMPLES = 2
ALONG = ("pitch_tilt_rad", "sensor_offset_m")


def rolled(position: str, seed: int, late: int) -> tuple[list[RevolutionResult], list[Code]]:
    """Return the results of a wheel, the last one again 11 s later, and what its own signal says."""
    results, snapshot = restated(
        CAR, 8.0, SETUP, ("kinematic", "ply-steer", "self-calibration"), late=(late, 0, 0), seed=seed
    )
    moved = [
        replace(
            item, position=position, host_ns=10**18 + round(1e9 * (item.revolution.start_s + item.revolution.period_s))
        )
        for item in results
    ]
    return [*moved, replace(moved[-1], host_ns=moved[-1].host_ns + 11 * 10**9)], [f.reason.code for f in snapshot.flags]


@pytest.mark.parametrize("late", [(0, 0, 0), (0, SAMPLES, 0), (SAMPLES, SAMPLES, SAMPLES)])
def test_lag_of_an_axis_that_one_wheel_alone_has_is_a_reason_on_what_rests_on_it(late: tuple[int, int, int]) -> None:
    """0.2 ms at 40 km/h are below what a wheel reports; a lag of the whole kind of sensor is none of one wheel."""
    wheels = [
        rolled(position, seed, lag) for position, seed, lag in zip(("FL", "FR", "RL"), (4, 5, 6), late, strict=True)
    ]
    assert TrustCode.AXIS_LATE not in [code for _, codes in wheels for code in codes]
    taken = [*chain.from_iterable(results for results, _ in wheels)]
    is_apart = len(set(late)) > 1
    assert alarms(*taken) == ({"FR": TrustCode.AXIS_LATER_THAN_OTHERS} if is_apart else {})
    judged = rows(*taken)
    for results, _ in wheels:
        last = judged[results[-1].position, results[-1].host_ns]
        with_reason = {
            name
            for name, each in last.items()
            if TrustCode.AXIS_LATER_THAN_OTHERS in [reason.code for reason in each.reasons]
        }
        assert (set(ALONG) <= with_reason) is (is_apart and results[-1].position == "FR")
        assert with_reason.isdisjoint({"speed_mps", "ply_steer_contact_line_rad"})
        if with_reason:
            assert all(last[name].status is not Status.VALID for name in with_reason)
            (reason,) = [each for each in last[ALONG[0]].reasons if each.code is TrustCode.AXIS_LATER_THAN_OTHERS]
            assert reason["axis"] == "circumferential"
            assert abs(reason["late_s"] - SAMPLES / 9600.0) < 3.0 * reason["std_s"] < 0.1e-3


@pytest.mark.parametrize(
    ("late_ms", "is_late"), [((0.5, 0.5, 0.5), True), ((0.0, 0.0, 0.5), False), ((0.0, 0.5, -0.5), False)]
)
def test_lag_that_only_one_renewal_shows_is_none(late_ms: tuple[float, ...], is_late: bool) -> None:
    """Lost samples may make a lag of an average, which the next one does not have."""
    of_wheels = {"FL": (0.0,) * 3, "FR": late_ms, "RL": (0.0,) * 3}
    taken = [
        replace(item, axis_lags=(Lag(1e-3 * lag + 1e-6 * number, 0.1e-3), None))
        for position, lags in of_wheels.items()
        for number, (item, lag) in enumerate(zip(results(position, [1.0] * len(lags)), lags, strict=True))
    ]
    latest = max(item.host_ns for item in taken) + 11 * 10**9
    taken += [replace(item, host_ns=latest) for item in taken[len(late_ms) - 1 :: len(late_ms)]]
    assert alarms(*taken) == ({"FR": TrustCode.AXIS_LATER_THAN_OTHERS} if is_late else {})


@pytest.mark.parametrize(("own_ms", "is_late"), [(0.0, False), (0.6, True)])
def test_lag_that_follows_the_driving_is_compared_at_its_time(own_ms: float, is_late: bool) -> None:
    """Acceleration looks like a lag at all wheels; the one that turns more slowly shows it some revolutions later."""
    driving_ms = np.array([0.4, 0.5, -0.1, 0.45, -0.4, 0.5, -0.4, 0.4])
    (item,) = results("FL", [1.0])
    taken: list[RevolutionResult] = []
    for position, own, later_s in (("FL", own_ms, 0.4), ("FR", 0.0, 0.0), ("RL", 0.0, 0.2), ("RR", 0.0, 0.1)):
        for tenth in range(540):
            renewed_s = 6.0 * min((tenth - 10 * later_s) // 60, len(driving_ms) - 1) + later_s
            lag_ms = float(np.interp(renewed_s / 6.0, np.arange(len(driving_ms)), driving_ms)) + own
            lags = Lag(1e-3 * lag_ms, 0.07e-3), None
            at_ns = 10**18 + 10**8 * tenth
            taken.append(
                replace(item, position=position, host_ns=at_ns, axis_lags=lags if renewed_s > 0 else (None, None))
            )
    taken.sort(key=lambda item: item.host_ns)
    pairs, seen = WheelPairs(), set()
    for result in taken:
        list(pairs.compared([result]))
        seen |= {alarm.position for alarm in pairs.alarms() if alarm.name == "axis lag"}
    assert seen == ({"FL"} if is_late else set())
