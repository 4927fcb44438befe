"""Samples that were lost or repeated without a mark: the revolution has a fault, and nothing else changes."""

import math

import numpy as np
import pytest

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Hello, SampleBlock
from gateway.core.config.validation import parse_document
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import Code
from gateway.core.wheels.reasons import WheelCode
from gateway.core.wheels.sample_buffer import SampleBuffer
from gateway.core.wheels.timebase import HostClock
from gateway.core.wheels.unmarked_loss import UnmarkedLossCheck
from gateway.core.wheels.wheel_pipeline import WheelPipeline, _dips, _may_hide_contacts
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate
from tests.testkit.simulated_wheel import restated, simulated

SETUP = WheelSetup("FL", 0, 0, 0.32, radius_std_m=0.0032, load_n=5000.0, pressure_pa=210e3)
ESTIMATORS = ("kinematic", "weak-form")
FAST = "[sensor]\nrange_g = 1000\n[motion]\nspeed_kmh = 90"
BRAKING = "[sensor]\nrange_g = 1000\n[motion]\nspeed_kmh = [[0, 100], [1, 100], [3.6, 10], [4, 10]]"
ROUGH = "[sensor]\nrange_g = 1000\n[motion]\nspeed_kmh = 60\n[road]\nprofile = 'F'"
OF_LOSS = (WheelCode.SAMPLES_LOST_UNMARKED, WheelCode.SAMPLES_REPEATED_UNMARKED)


def faults_of(results: tuple[RevolutionResult, ...]) -> dict[int, tuple[Code, float]]:
    """Return code and number of samples of the unmarked losses, by revolution."""
    return {
        index: (fault.code, float(fault["count"]))
        for index, result in enumerate(results)
        for fault in result.revolution.faults
        if fault.code in OF_LOSS
    }


@pytest.mark.parametrize("axes", ["", '\naxes = ["radial"]'])
@pytest.mark.parametrize("count", [10, 50, 200, -20, -50])
def test_one_loss_is_a_fault_of_its_revolution_alone(count: int, axes: str) -> None:
    tables = FAST.replace("range_g = 1000", "range_g = 1000" + axes)
    span = (20_000, 20_000 + abs(count))
    results, snapshot = restated(
        tables, 4.0, SETUP, ESTIMATORS, lost=(span,) if count > 0 else (), repeated=() if count > 0 else (span,)
    )
    ((position, (code, actual)),) = faults_of(results).items()
    assert code is (WheelCode.SAMPLES_LOST_UNMARKED if count > 0 else WheelCode.SAMPLES_REPEATED_UNMARKED)
    assert actual == pytest.approx(abs(count), rel=0.1, abs=1.5)
    assert snapshot.flags == ()
    for other, result in enumerate(results):
        speed, *_ = result.estimates
        assert (speed.status is Status.VALID) is (other != position)
        assert abs(speed.value - 25.0) < 3.0 * speed.std
    last = {estimate.name: estimate for estimate in results[-1].estimates}
    assert last["Rs"].status is Status.VALID


def test_several_losses_are_each_found() -> None:
    results, _ = restated(FAST, 4.0, SETUP, ESTIMATORS, lost=((30_100, 30_140), (20_000, 20_040), (12_000, 12_040)))
    assert len(faults_of(results)) == 3
    assert results[-1].estimates[0].status is Status.VALID


@pytest.mark.parametrize("tables", [BRAKING, ROUGH])
def test_braking_and_rough_roads_lose_nothing(tables: str) -> None:
    assert faults_of(simulated(tables, 4.0, SETUP, ESTIMATORS)[0]) == {}


def test_loss_while_braking_is_found() -> None:
    """At 1 g the speed falls by 3 % in a revolution, about what the loss adds."""
    check, speed, period = UnmarkedLossCheck(), 25.0, 0.0
    results = []
    for turn in range(12):
        period = 2.0 * math.pi * 0.32 / speed * 9600.0
        lost = 30.0 if turn == 8 else 0.0
        results.append(check.missing(period - lost, speed * speed / 0.32))
        speed -= 9.81 * period / 9600.0
    assert [turn for turn, count in enumerate(results) if count] == [8]
    assert results[8] == pytest.approx(30.0, rel=0.1)


def test_skidding_wheel_loses_nothing() -> None:
    """The mean follows the speed of the wheel, however suddenly that changes."""
    check = UnmarkedLossCheck()
    for speed in (25.0, 25.0, 25.0, 24.9, 21.0, 24.5, 20.0, 24.0, 23.8):
        assert check.missing(2.0 * math.pi * 0.32 / speed * 9600.0, speed * speed / 0.32) == 0.0


def test_another_gain_is_no_loss() -> None:
    check = UnmarkedLossCheck()
    assert [check.missing(772.0, 1950.0 * gain) for gain in (1.0, 1.0, 1.0, 1.0, 0.9, 0.9, 0.9)] == [0.0] * 7


def test_a_lasting_change_is_no_loss() -> None:
    """The sampling rate is another one from the fifth revolution on; three revolutions later that is the new state."""
    check = UnmarkedLossCheck()
    results = [check.missing(period, 1950.0) for period in [772.0] * 5 + [740.0] * 10]
    assert results[5] == pytest.approx(32.0, rel=0.05)
    assert not any(results[8:])


def test_product_of_several_turns_tells_how_many() -> None:
    check = UnmarkedLossCheck()
    assert check.turns(100.0, 900.0) == 1
    for _ in range(4):
        check.missing(100.0, 900.0)
    assert check.turns(100.0, 900.0) == 1
    assert check.turns(300.0, 100.0) == 1  # a third of the speed
    assert check.turns(300.0, 900.0) == 3
    assert check.turns(2000.0, 880.0) == 20
    assert check.turns(155.0, 900.0) == 1  # no whole number
    assert check.turns(155.0, 900.0, is_whole=False) == 2


def test_wheel_without_load_loses_neither_distance_nor_averages() -> None:
    """A contact of 60 N is not seen for 1.5 s at 65 km/h: 13 turns in a few revolutions."""
    load = "load_n = [[0, 5000], [3, 5000], [3.02, 60], [4.5, 60], [4.52, 5000]]"
    names = ("kinematic", "distance", "self-calibration", "weak-form")
    results, truth = simulated("[sensor]\nrange_g = 500\nrate_hz = 4800", 9.0, SETUP, names, load)
    spanning = [result for result in results if result.revolution.turns > 1]
    assert spanning
    for result in spanning:
        assert WheelCode.SEVERAL_TURNS in [fault.code for fault in result.revolution.faults]
        speed = result.estimates[0]
        assert speed.status is Status.PROVISIONAL
        assert speed.value == pytest.approx(truth.speed_mps(3.7), rel=0.02)
    actual = {estimate.name: estimate for estimate in results[-1].estimates}
    first, end = results[0].revolution, results[-1].revolution
    turns = len(truth.bottom_times_s(first.start_s - 0.02, end.start_s + end.period_s + 0.02)) - 1
    assert actual["distance_m"].value == pytest.approx(2.0 * math.pi * 0.32 * turns, rel=0.012)
    numbers = truth.numbers(8.0)
    for name in ("Bs/Cw", "Rs/Cw"):
        true = getattr(numbers, name[:2]) / numbers.Cw
        assert actual[name].status is Status.VALID
        assert abs(actual[name].value - true) < 3.0 * actual[name].std
    assert actual["contact_length_m"].std < 0.05 * actual["contact_length_m"].value


@pytest.mark.parametrize("reach_turns", [0.047, 0.06])
def test_gaps_at_every_second_contact_do_not_halve_a_valid_speed(reach_turns: float) -> None:
    """Loss from the start on: no revolution tells what one turn is, but radius and rate as stated do."""
    simulation = simulate(
        parse_document(Scenario, f"{FAST}\n[[wheel]]\nposition = 'FL'\nwheel = 0", "test"), duration_s=3
    )
    decoder = FrameDecoder()
    frames = [frame.message for chunk in simulation.chunks("link", 10**18) for frame in decoder.feed(chunk.data)]
    hello = next(message for message in frames if isinstance(message, Hello))
    samples = np.concatenate([message.counts for message in frames if isinstance(message, SampleBlock)])
    bottoms = simulation.truth["FL"].bottom_times_s(0.0, 3.0) * hello.rate_hz
    reach = reach_turns * float(np.diff(bottoms).mean())
    wheel, host, first = WheelPipeline(SETUP, ("kinematic", "distance")), HostClock(), 0
    wheel.hello(hello)
    results: list[RevolutionResult] = []
    for hidden in bottoms[1::2]:
        end = round(hidden - reach)
        ticks_us = [round(first * 1e6 / hello.rate_hz)]
        results += wheel.samples(first, ticks_us, hello.axes, samples[first:end], host)
        first = round(hidden + reach)
    assert len(results) > 8
    for result in results:
        speed, revolution = result.estimates[0], result.revolution
        assert speed.status is Status.PROVISIONAL
        assert speed.value == pytest.approx(25.0, rel=0.02)
        assert WheelCode.SEVERAL_TURNS in [fault.code for fault in revolution.faults]
    rolled_m = results[-1].estimates[-1].value
    assert rolled_m == pytest.approx(2.0 * math.pi * SETUP.radius_m * 2 * len(results), rel=1e-9)


@pytest.mark.parametrize("scale", [0.1, -0.1])
def test_contact_that_was_passed_over_dips_between_two(scale: float) -> None:
    """Of two turns, in samples of 100 m/s^2 that read nothing in a contact of a twentieth of a turn."""
    counts = np.full((400, 1), round(100.0 / scale), np.int16)
    without = counts.copy()
    counts[190:210] = 0
    rough = without + np.random.default_rng(1).normal(0.0, abs(20.0 / scale), without.shape).astype(np.int16)

    def dips(samples: np.ndarray) -> bool:
        return _dips(samples, 0, 0.4 * 100.0 / scale, scale)

    for samples, lost, expected in (
        (counts, 0, True), (without, 0, False), (rough, 0, False), (without, 5, True),
    ):  # fmt: skip
        buffer = SampleBuffer(500, 1)
        buffer.reset(0)
        buffer.append(samples[:200], 0)
        if lost:
            buffer.bridge(lost, samples[200], 0)
        buffer.append(samples[200:], 0)
        assert _may_hide_contacts(buffer, 10.0, 390.0, 2, dips) is expected
