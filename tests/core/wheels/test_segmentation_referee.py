"""Contacts of wheels made by independent formulas: difficult cases, and properties that hold for any wheel."""

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.results import WheelState
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.wheels.wheels import Pipeline
from tools.generators.segmentation_signals import MEASURED, Case, Verdict, judge, make_signal, segment


def verdict(case: Case) -> Verdict:
    signal = make_signal(case)
    return judge(signal, segment(signal)[0])


def knots(times, speeds):
    return lambda t: np.interp(t, times, speeds)


def drawn(seed: int, **changes) -> Case:
    """Return a random wheel, sensor and coupling."""
    rng = np.random.default_rng(seed)
    ac = rng.random() < 0.4
    case = Case(
        rate_hz=float(rng.choice((2000, 3200, 4800, 9600, 25600))),
        radius_m=float(rng.uniform(0.25, 0.55)),
        half_rad=float(rng.uniform(0.08, 0.5)),
        shape=str(rng.choice(("ring", "packets"))),
        density_mg=float(np.exp(rng.uniform(np.log(0.125), np.log(15.0)))),
        highpass_hz=float(np.exp(rng.uniform(np.log(0.05), np.log(2.0)))) if ac else 0.0,
        lowpass_hz=float(rng.choice((0.0, 500.0, 1000.0))),
        offset_g=0.0 if ac else float(rng.uniform(-5.0, 5.0)),
        gain=float(rng.uniform(0.9, 1.1)),
        sign=int(rng.choice((-1, 1))),
        seed=seed,
    )
    for name, value in changes.items():
        setattr(case, name, value)
    return case


@pytest.mark.parametrize("seed", range(12))
def test_constant_speed(seed: int):
    kmh = (10.0, 14.0, 25.0, 60.0, 120.0, 250.0)[seed % 6]
    if kmh == 10.0:
        result = verdict(drawn(seed, kmh=10.5, duration_s=7.0, radius_m=0.35, half_rad=0.3))
    else:
        result = verdict(drawn(seed, kmh=kmh, duration_s=5.0 if kmh < 30.0 else 2.0))
    assert result.due >= 4
    assert (result.missed, result.false) == (0, 0)
    assert np.abs(result.centre_percent).max() < 0.6
    assert abs(result.bias_percent) < 0.1


@pytest.mark.parametrize("seed", range(3))
def test_acceleration_from_standstill(seed: int):
    result = verdict(drawn(seed, kmh=lambda t: 3.0 * 3.6 * t, duration_s=9.0))
    assert result.due >= 30
    assert (result.missed, result.false) == (0, 0)


@pytest.mark.parametrize("seed", range(4))
def test_emergency_braking_to_standstill(seed: int):
    """At 8 m/s^2 the wheel may stop so soon after a contact that the contact has no trailing flank."""
    result = verdict(drawn(seed, kmh=lambda t: np.clip(150.0 - 8.0 * 3.6 * t, 0.0, None), duration_s=7.0))
    assert result.due >= 20
    assert result.missed <= 1
    assert result.false == 0


@pytest.mark.parametrize("seed", [1, 2])
def test_town_traffic_with_stops_and_impacts(seed: int):
    speed = knots([0, 4, 8, 10, 14, 19, 22], [30, 55, 0, 0, 45, 12, 40])
    result = verdict(drawn(seed, kmh=speed, duration_s=22.0, road_mps2=2.0, impacts_per_s=0.3))
    assert result.due >= 45
    assert result.missed <= 2
    assert result.false <= 1


def test_hard_braking_then_acceleration_is_tracked():
    # Where the wheel starts to accelerate, the period expected from constant deceleration is twice the true one.
    case = drawn(5, kmh=knots([0, 5, 8.5, 13], [40, 40, 12, 60]), duration_s=12.0, radius_m=0.5, half_rad=0.2)
    result = verdict(case)
    assert result.due >= 30
    assert (result.missed, result.false) == (0, 0)


def test_noise_of_70_mg_at_low_speed():
    for seed in range(3):
        result = verdict(
            drawn(seed, kmh=20.0, duration_s=6.0, density_mg=70.0, radius_m=0.32, half_rad=0.25, rate_hz=9600.0)
        )
        assert (result.missed, result.false) == (0, 0)
        assert np.abs(result.centre_percent).max() < 2.0


def test_rough_road():
    for seed in range(3):
        result = verdict(drawn(seed, kmh=60.0, duration_s=4.0, road_mps2=20.0, half_rad=0.25))
        assert (result.missed, result.false) == (0, 0)
        assert np.abs(result.centre_percent).max() < 1.0


def test_impact_on_contact_loses_no_revolution():
    signal = make_signal(drawn(3, kmh=30.0, duration_s=6.0, radius_m=0.32, half_rad=0.25, rate_hz=9600.0))
    hit = int(signal.contacts[8])
    signal.radial_mps2[hit - 200 : hit - 150] += 2500.0 * np.sin(np.pi * np.arange(50) / 50)
    signal.radial_mps2[hit - 60 : hit + 20] -= 2000.0 * np.sin(np.pi * np.arange(80) / 80)
    result = judge(signal, segment(signal)[0])
    assert (result.missed, result.false) == (0, 0)
    assert result.predicted in (0, 2)


def test_lost_frames_and_bursts():
    total = Verdict()
    for seed in range(6):
        result = verdict(drawn(seed, kmh=120.0, duration_s=4.0, loss=0.03, burst=0.001, rate_hz=9600.0))
        total.due += result.due
        total.missed += result.missed
        total.false += result.false
        total.predicted += result.predicted
        assert np.abs(result.centre_percent).max() < 1.5
    assert total.due > 250
    assert total.missed <= 0.01 * total.due
    assert total.false == 0
    assert total.predicted >= 10


@pytest.mark.parametrize("range_g", [40.0, 60.0, 120.0])
def test_contacts_of_clipped_sensor_are_found(range_g: float):
    # R Omega^2 is 107 g
    for coupling in (0.0, 0.5):
        case = Case(kmh=65.0, shape="packets", range_g=range_g, highpass_hz=coupling, seed=4)
        result = verdict(case)
        assert (result.missed, result.false) == (0, 0)


@pytest.mark.parametrize("seed", range(5))
def test_creeping_gives_no_false_revolution(seed: int):
    for kmh in (3.0, 6.5, 9.0):
        assert verdict(drawn(seed, kmh=kmh, duration_s=9.0)).false == 0


@pytest.mark.parametrize("acceleration", [1.0, 2.5, 6.0])
def test_reversal_is_not_a_revolution(acceleration: float):
    for seed, kmh in ((1, 8.0), (2, 15.0), (3, 25.0)):
        turned = 4.0 + 2.0 * kmh / 3.6 / acceleration
        speed = knots([0.0, 4.0, turned, 20.0], [kmh, kmh, -kmh, -kmh])
        result = verdict(drawn(seed, kmh=speed, duration_s=turned + 5.0, highpass_hz=0.0, offset_g=1.0, half_rad=0.3))
        assert result.false == 0
        assert result.missed <= 1


def test_inverted_overshoot_is_not_a_contact():
    """With a wrong sign and a slow start, overshoots are in view before three contacts are."""
    for seed in range(6):
        case = Case(kmh=lambda t: 3.0 * 3.6 * t, duration_s=6.0, radius_m=0.5, half_rad=0.42, sign=-1, seed=seed)
        signal = make_signal(case)
        pairs, segmenter = segment(signal)
        assert judge(signal, pairs).false == 0
        assert segmenter.sign == -1


@pytest.mark.parametrize("value", ["kept", "zero", "end of range"])
def test_stuck_sensor_recovers(value: str):
    signal = make_signal(Case(kmh=50.0, duration_s=14.0, range_g=500.0, seed=2))
    first, end = 4 * 9600, 10 * 9600
    stuck = {"kept": signal.radial_mps2[first], "zero": 0.0, "end of range": 500.0 * STANDARD_GRAVITY_MPS2}[value]
    signal.radial_mps2[first:end] = stuck
    pairs, segmenter = segment(signal)
    inside = [pair for pair in pairs if pair.end.centre > first + 2000 and pair.start.centre < end - 2000]
    assert inside == []
    assert len([pair for pair in pairs if pair.start.centre > end]) >= 24
    assert segmenter.state is WheelState.ROLLING
    segmenter = segment(make_signal(Case(kmh=50.0, duration_s=9.0, frozen_s=(4.0, 9.0), seed=2)))[1]
    assert segmenter.state is WheelState.STANDSTILL


@pytest.mark.skipif(not MEASURED.exists(), reason="the measured recording is not here")
@pytest.mark.parametrize("kmh", [11.0, 40.0, 110.0, 230.0])
def test_measured_tire_at_other_speeds(kmh: float):
    for seed in range(2):
        result = verdict(
            drawn(seed, kmh=kmh, duration_s=7.0 if kmh < 20.0 else 2.5, shape="measured", half_rad=0.2, range_g=500.0)
        )
        assert (result.missed, result.false) == (0, 0)
        # The leading edge alone jitters by 0.1 % of the circumference.
        assert np.abs(result.centre_percent).max() < 0.8
        assert 0.5 < np.sqrt(np.mean(np.square(result.z))) < 2.0


def test_faulty_signal_does_not_depend_on_chunks():
    case = drawn(9, kmh=knots([0, 3, 5, 7, 9], [60, 60, 0, 0, 25]), duration_s=10.0, loss=0.03, impacts_per_s=0.5)
    signal = make_signal(case)
    whole = segment(signal)[0]
    assert whole
    for chunk in (36, 997, 20000):
        assert segment(signal, chunk)[0] == whole


def test_changed_rate_restarts_segmentation(to_frames):
    slow = make_signal(Case(kmh=65.0, duration_s=3.0, rate_hz=4800.0, seed=1))
    fast = make_signal(Case(kmh=65.0, duration_s=3.0, rate_hz=9600.0, seed=1))
    pipeline = Pipeline((WheelSetup("FL", 0, 0, 0.32),), WheelSetup("", 0, 0, 0.32), estimators=("kinematic",))
    results = pipeline.frames("a", to_frames(slow.radial_mps2, 4800.0), 10**18)
    first = len(results)
    after = to_frames(fast.radial_mps2, 9600.0, start_us=3_000_000)
    results += pipeline.frames("a", after, 10**18 + 3 * 10**9) + pipeline.finish()
    assert first >= 22
    assert len(results) - first >= 22
    periods = [result.revolution.period_s for result in results]
    assert periods == pytest.approx([2 * np.pi * 0.32 / (65 / 3.6)] * len(periods), rel=0.005)


def test_same_hub_number_on_two_links(to_frames):
    pipeline = Pipeline((WheelSetup("FL", 0, 0, 0.32),), WheelSetup("", 0, 0, 0.32), estimators=("kinematic",))
    results = []
    streams = [
        (link, to_frames(make_signal(Case(kmh=kmh, duration_s=3.0, seed=1)).radial_mps2))
        for link, kmh in (("a", 40.0), ("b", 90.0))
    ]
    for index in range(0, len(streams[0][1]), 10):
        for link, frames in streams:
            results += pipeline.frames(link, frames[index : index + 10], 10**18 + index * 3_750_000)
    results += pipeline.finish()
    periods: dict[str, list[float]] = {}
    for result in results:
        periods.setdefault(result.position, []).append(result.revolution.period_s)
    assert sorted(periods) == ["FL", "hub0.wheel0 on b"]
    for position, kmh in (("FL", 40.0), ("hub0.wheel0 on b", 90.0)):
        assert np.median(periods[position]) == pytest.approx(2 * np.pi * 0.32 / (kmh / 3.6), rel=0.001)
