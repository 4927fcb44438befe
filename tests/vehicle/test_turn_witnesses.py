"""A yaw rate of the bus and the course of a receiver: sign and gain of the lateral axis of a wheel alone."""

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.estimates.results import RevolutionResult
from gateway.core.reasons import Code
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.turn_verdict import Witness
from gateway.core.trust.wheel_pairs import WheelPairs
from gateway.forces.reasons import ForceCode
from gateway.forces.shared_turn import SharedTurn
from gateway.vehicle.vehicle_signals import COURSE_RATE, RECEIVER_SIGNALS, Quantity, SignalHistory, VehicleSignal
from gateway.vehicle.vehicle_witness import VehicleJoin
from tests.testkit.curving_car import SPEED_MPS, drive, results

YAW = VehicleSignal("yaw_rate_radps", Quantity.YAW_RATE, "radps", None, None, 1.0)
# Host time of the first sample.
BEGIN_NS = 1_000_000_000


def bus(late_s: float, factor: float = 1.01) -> Iterator[tuple[str, float, float]]:
    """Yield a yaw rate at 50 Hz with an offset and noise, late and with a gain."""
    car, rng = drive(), np.random.default_rng(4)
    for at_s in np.arange(0.0, car.time_s[-1], 0.02):
        rate = float(np.interp(at_s - late_s, car.time_s, car.yaw_radps))
        yield YAW.key, at_s, factor * rate + 0.004 + rng.normal(0.0, 0.003)


def receiver(late_s: float) -> Iterator[tuple[str, float, float]]:
    """Yield a course from north to the right once a second, from 350 degrees on, with the error of its speed."""
    car, rng = drive(), np.random.default_rng(5)
    for at_s in np.arange(1.0, car.time_s[-1], 1.0):
        heading = float(np.interp(at_s, car.time_s, car.heading_rad)) + rng.normal(0.0, 0.05 / SPEED_MPS)
        yield "course_rad", at_s + late_s, (math.radians(350.0) - heading) % (2.0 * math.pi)


def compared(signals: Iterator[tuple[str, float, float]], *wheels: tuple[RevolutionResult, ...]) -> WheelPairs:
    history = SignalHistory((YAW, *RECEIVER_SIGNALS))
    for key, at_s, value in signals:
        history.add(key, BEGIN_NS + round(1e9 * at_s), value)
    pairs = WheelPairs(VehicleJoin(history), SharedTurn({}))
    list(pairs.compared([result for wheel in wheels for result in wheel]))
    return pairs


def alarms(pairs: WheelPairs) -> set[tuple[str, Code]]:
    return {(alarm.position, alarm.reason.code) for alarm in pairs.alarms()}


@pytest.mark.parametrize("late_s", [0.0, 0.3])
@pytest.mark.parametrize("signals", [bus, receiver])
def test_wheel_alone_is_verified_whatever_the_signals_delay(signals, late_s: float) -> None:
    pairs = compared(signals(late_s), results("FL"))
    finding = pairs.axis("FL")
    assert (finding.sign, finding.gain_by) == (1, Witness.YAW_RATE if signals is bus else Witness.COURSE)
    assert finding.gain.value == pytest.approx(1.0, abs=2.5 * finding.gain.std)
    assert finding.gain.std < 0.15
    assert alarms(pairs) == set()


def test_false_gain_of_a_wheel_alone_is_an_alarm() -> None:
    assert alarms(compared(bus(0.1), results("FL", 0.5))) == {("FL", ForceCode.LATERAL_GAIN_CONTRADICTED)}


def test_axis_that_points_to_the_right_is_an_alarm_at_a_wheel_alone() -> None:
    assert alarms(compared(receiver(0.2), results("RL", -1.0))) == {("RL", TrustCode.TURNS_OPPOSITE)}


def test_yaw_rate_with_the_other_sign_does_not_overrule_the_speeds_of_an_axle() -> None:
    pairs = compared(bus(0.1, -1.0), results("FL"), results("FR"))
    assert {pairs.axis(wheel).sign for wheel in ("FL", "FR")} == {1}
    assert alarms(pairs) == {(wheel, TrustCode.YAW_RATE_REVERSED) for wheel in ("FL", "FR")}


@pytest.mark.parametrize("rate_hz", [1, 5, 10])
def test_error_of_the_rate_of_a_course_is_its_scatter_however_often_the_receiver_sends(made, rate_hz: int) -> None:
    result, history, rng = made.result(), SignalHistory(RECEIVER_SIGNALS), np.random.default_rng(6)
    speed_mps = result.revolution.omega_radps * result.conditions.radius_m
    for k in range(600 * rate_hz):
        at_ns = BEGIN_NS + round(1e9 * (k + rng.uniform(0.0, 0.2)) / rate_hz)
        history.add("course_rad", at_ns, rng.normal(0.0, 0.05 / speed_mps) % (2.0 * math.pi))
    join = VehicleJoin(history)
    revolutions = [join.joined(replace(result, host_ns=BEGIN_NS * second)) for second in range(5, 600)]
    rates = [rate for revolution in revolutions for rate in revolution.estimates if rate.name == COURSE_RATE]
    assert len(rates) == len(revolutions)
    assert 0.7 < np.std([rate.value for rate in rates]) / rates[0].std < 1.3
