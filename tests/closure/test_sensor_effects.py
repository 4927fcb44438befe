"""Effects of mounting, element, clock and electronics against the independent simulator, and their derivatives."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.closure.effects.base import (
    CIRCUMFERENTIAL,
    FIELD_SIZE,
    LATERAL,
    RADIAL,
    Conditions,
    Here,
    RingEffect,
    SignalEffect,
    Stage,
)
from gateway.closure.effects.catalogue import MODULES, catalogue
from gateway.closure.ring_options import RingOptions
from gateway.physics.rolling_ring import RingParameters, solve_rolling_ring
from gateway.physics.rolling_ring_waveform import STANDARD_GRAVITY_MPS2, SensorWaveform
from gateway.simulator.plan import WheelPlan, wheel_plans
from gateway.simulator.scenario import parse_scenario
from gateway.simulator.tire_table import LATERAL as LATERAL_COLUMN
from gateway.simulator.tire_table import look_up
from gateway.simulator.wheel import WheelSimulator

G = STANDARD_GRAVITY_MPS2
# High, so that the simulated digital filters are close to analogue ones.
RATE = 25600.0
THETA = -math.pi + 2.0 * math.pi / FIELD_SIZE * np.arange(FIELD_SIZE)
OMEGA = 65.0 / 3.6 / 0.32
CONDITIONS = Conditions(OMEGA, 0.0, 0.32, 5000.0, 2.1e5, 25.0, 25.0, RATE, 0.0)
NAMES = (
    "rolling radius",
    "sample clock error",
    "roll tilt",
    "pitch tilt",
    "gain",
    "gain-temperature drift",
    "zero-g offset",
    "clipping",
    "anti-alias filter",
    "AC coupling",
)


def plan_of(wheel: str = "", sensor: str = "", speed_kmh: float = 65.0, hub: str = "") -> WheelPlan:
    text = f"""
[motion]
speed_kmh = {speed_kmh}
[sensor]
rate_hz = {RATE}
noise_mg_rthz = 0.0
range_g = 250.0
{sensor}
[[hub]]
hub = 0
{hub}
[[wheel]]
position = "W"
wheel = 0
phase_deg = 0.0
{wheel}
"""
    return wheel_plans(parse_scenario(text, "test"))[0]


def samples(plan: WheelPlan, until_s: float = 0.5) -> np.ndarray:
    """Return what the simulated sensor says, (n, 3) m/s^2."""
    simulator = WheelSimulator(plan, np.random.default_rng(1))
    blocks = [simulator.advance(end).counts for end in np.arange(0.25, until_s + 1e-9, 0.25)]
    return np.concatenate(blocks) * np.array(simulator.chain.scale_mps2)


@lru_cache(maxsize=8)
def here_of(speed_kmh: float = 65.0, omega_dot_radps2: float = 0.0, wheel: str = "") -> Here:
    """Return a block of the simulator's tire as the closure's model would have it, without any effect."""
    plan = plan_of(wheel)
    omega = speed_kmh / 3.6 / plan.radius_m
    columns = look_up(plan.table().waveform(5000.0, 2.1e5, OMEGA), THETA).astype(np.float64)
    shape = SensorWaveform(*(columns[:, i] for i in range(6)))
    signal = np.zeros((3, FIELD_SIZE))
    signal[RADIAL], signal[CIRCUMFERENTIAL] = shape.specific_force(omega, omega_dot_radps2)
    signal[LATERAL] = omega**2 * columns[:, LATERAL_COLUMN]
    conditions = replace(CONDITIONS, omega_radps=omega, omega_dot_radps2=omega_dot_radps2)
    return Here(conditions, THETA, signal, shape, *plan.table().edges_rad(5000.0, 2.1e5, OMEGA))


def at_angles(field: np.ndarray, angle_rad: np.ndarray) -> np.ndarray:
    """Return a curve on the grid at any angles, (n, 3)."""
    spectrum = np.fft.rfft(field) / FIELD_SIZE
    spectrum[:, 1:] *= 2.0
    order = np.arange(230)
    turn = np.exp(1j * np.outer(angle_rad + math.pi, order))
    return (turn @ spectrum[:, :230].T).real


def tail(values: np.ndarray, omega_radps: float = OMEGA, rate_hz: float = RATE) -> tuple[np.ndarray, np.ndarray]:
    """Return the last 4000 samples and their angles."""
    place = np.arange(len(values) - 4000, len(values))
    return values[-4000:], omega_radps * place / rate_hz


def effect_of(name: str) -> SignalEffect:
    effect = catalogue()[name]
    assert isinstance(effect, SignalEffect)
    return effect


def applied(here: Here, **parameters: tuple[float, ...]) -> Here:
    """Return the block with effects in, as the engine applies them: by stage, then in the catalogue's order."""
    by_name = {name.replace("_", " "): np.array(values) for name, values in parameters.items()}
    effects = sorted((e for e in catalogue().values() if isinstance(e, SignalEffect)), key=lambda e: e.stage)
    for effect in effects:
        key = effect.name.replace("-", " ")
        if key in by_name:
            here = replace(here, signal_mps2=here.signal_mps2 + effect.contribution(here, by_name.pop(key)))
    assert not by_name
    return here


def rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


@pytest.mark.parametrize(
    ("sensor", "parameters", "close"),
    [
        ("roll_deg = 3.0", {"roll_tilt": (math.radians(3.0),)}, 2e-3),
        ("pitch_deg = -2.0", {"pitch_tilt": (math.radians(-2.0),)}, 2e-3),
        (
            "roll_deg = -4.0\npitch_deg = 3.0",
            {"roll_tilt": (math.radians(-4.0),), "pitch_tilt": (math.radians(3.0),)},
            2e-3,
        ),
        ("gain_error_percent = [0.0, 0.0, 3.0]", {"gain": (0.03,)}, 3e-3),
        ("zero_g_offset_g = [1.0, -2.0, 3.0]", {"zero_g_offset": (G, -2.0 * G, 3.0 * G)}, 3e-3),
        ("bandwidth_hz = 700.0", {"anti_alias_filter": (1.0 / 700.0,)}, 0.01),
        ("bandwidth_hz = 1500.0", {"anti_alias_filter": (1.0 / 1500.0,)}, 0.03),
        ("coupling = 'ac'\nhighpass_hz = 2.0", {"AC_coupling": (2.0,)}, 2e-3),
        (
            "roll_deg = 2.0\npitch_deg = 1.5\ngain_error_percent = [0.0, 0.0, -4.0]\nzero_g_offset_g = [0.5, 1.0, -2.0]"
            "\nbandwidth_hz = 900.0\ncoupling = 'ac'\nhighpass_hz = 1.0",
            {
                "roll_tilt": (math.radians(2.0),),
                "pitch_tilt": (math.radians(1.5),),
                "gain": (-0.04,),
                "zero_g_offset": (0.5 * G, G, -2.0 * G),
                "anti_alias_filter": (1.0 / 900.0,),
                "AC_coupling": (1.0,),
            },
            4e-3,
        ),
    ],
)
def test_a_sensor_with_it_less_one_without_is_the_contribution(sensor: str, parameters: dict, close: float) -> None:
    until_s = 3.0 if "coupling" in sensor else 0.5
    measured, angle = tail(samples(plan_of(sensor=sensor), until_s))
    plain, _ = tail(samples(plan_of(), until_s))
    here = here_of()
    # A contact is found behind the filter: as late as the filter's low orders.
    late = math.sqrt(2.0) * OMEGA / (2.0 * math.pi) * parameters.get("anti_alias_filter", (0.0,))[0]
    expected = at_angles(applied(here, **parameters).signal_mps2, angle - late) - at_angles(here.signal_mps2, angle)
    assert rms(expected) > 2.0
    assert rms(measured - plain - expected) < close * rms(expected) + 0.03


def test_in_reverse_the_sensor_stays_as_it_was_glued() -> None:
    sensor = "pitch_deg = 2.0\nroll_deg = 1.0\nzero_g_offset_g = [3.0, 1.0, 0.5]"
    motion = "[wheel.motion]\ndirection = 'reverse'"
    measured, angle = tail(samples(plan_of(motion, sensor)))
    plain, _ = tail(samples(plan_of(motion)))
    here = here_of(wheel=motion)
    here = replace(here, conditions=replace(here.conditions, reverse=True))
    parameters = {"roll_tilt": (math.radians(1.0),), "pitch_tilt": (math.radians(2.0),)}
    after = applied(here, **parameters, zero_g_offset=(3.0 * G, G, 0.5 * G)).signal_mps2
    # The campaign's circumferential axis points along the rotation.
    difference = (measured - plain) * [-1.0, 1.0, 1.0]
    assert rms(difference - at_angles(after - here.signal_mps2, angle)) < 0.1


def test_gain_drifts_from_the_reference_temperature() -> None:
    drift = "gain_drift_percent_per_k = [0.0, 0.0, 0.1]"
    warm, angle = tail(samples(plan_of("temperature_degc = 45.0", drift)))
    plain, _ = tail(samples(plan_of("temperature_degc = 45.0")))
    here = here_of()
    here = replace(here, conditions=replace(here.conditions, temperature_degc=45.0))
    expected = at_angles(applied(here, gain_temperature_drift=(1e-3, 25.0)).signal_mps2 - here.signal_mps2, angle)
    assert warm - plain == pytest.approx(expected, abs=0.15)
    assert rms(expected[:, RADIAL]) == pytest.approx(0.02 * rms(plain[:, RADIAL]), rel=0.01)
    assert not effect_of("gain-temperature drift").starts((CONDITIONS, CONDITIONS))


@pytest.mark.parametrize("speed_kmh", [50.0, 65.0, 80.0])
def test_a_limit_is_the_same_at_every_speed(speed_kmh: float) -> None:
    limit_g = 110.0
    plan = plan_of(f"[wheel.defect]\nclip_g = {limit_g}", "", speed_kmh)
    omega = speed_kmh / 3.6 / 0.32
    measured, angle = tail(samples(plan), omega)
    plain, _ = tail(samples(plan_of("", "", speed_kmh)), omega)
    here = here_of(speed_kmh)
    expected = at_angles(applied(here, clipping=(1.0 / (limit_g * G), 0.0)).signal_mps2 - here.signal_mps2, angle)
    # On the grid the corners ring a little.
    assert rms(measured - plain - expected) < 0.02 * rms(expected) + 0.1
    assert (rms(expected) > 5.0) == (speed_kmh > 50.0)


def test_the_knee_is_the_mean_of_noisy_clipped_revolutions() -> None:
    here, limit, noise = here_of(), 1250.0, 40.0
    noisy = here.signal_mps2[RADIAL] + noise * np.random.default_rng(1).standard_normal((20_000, FIELD_SIZE))
    mean = np.clip(noisy, -limit, limit).mean(axis=0)
    softly = applied(here, clipping=(1.0 / limit, noise / limit)).signal_mps2[RADIAL]
    hard = applied(here, clipping=(1.0 / limit, 0.0)).signal_mps2[RADIAL]
    assert rms(softly - mean) < 1.15 * noise / math.sqrt(len(noisy))
    assert rms(hard - mean) > 4.0 * rms(softly - mean)


@pytest.mark.parametrize("clock_ppm", [-900.0, 900.0])
def test_a_fast_clock_makes_the_wheel_look_slow(clock_ppm: float) -> None:
    """The rate error stands for a rate that nobody measured: the samples are taken to come at RATE."""
    error_ppm = math.copysign(9000.0, clock_ppm)
    plan = plan_of(sensor=f"rate_error_ppm = {error_ppm}", hub=f"clock_ppm = {clock_ppm}")
    share = (1.0 + error_ppm * 1e-6) * (1.0 + clock_ppm * 1e-6) - 1.0
    measured, angle = tail(samples(plan), OMEGA, RATE * (1.0 + share))
    seen = here_of(65.0 / (1.0 + share))
    after = applied(seen, sample_clock_error=(share,))
    plane = [CIRCUMFERENTIAL, RADIAL]
    assert rms((measured - at_angles(after.signal_mps2, angle))[:, plane]) < 0.3
    assert rms((measured - at_angles(seen.signal_mps2, angle))[:, plane]) > 10.0


def test_a_larger_belt_scales_the_ring_and_leaves_gravity() -> None:
    share = 0.03
    ring = RingParameters.from_numbers(3.08e-3, 0.195, 2.97, 2.53, radius_m=0.32, pressure_pa=2.1e5)
    larger = RingParameters.from_numbers(
        3.08e-3,
        0.195,
        2.97,
        2.53,
        radius_m=0.32 * (1.0 + share),
        pressure_pa=2.1e5,
        extension_stiffness_n=ring.extension_stiffness_n * (1.0 + share) ** 2,
    )
    stated = solve_rolling_ring(ring, 5000.0, 2.1e5, OMEGA, nodes=FIELD_SIZE)
    true = solve_rolling_ring(larger, 5000.0 * (1.0 + share) ** 2, 2.1e5, OMEGA, nodes=FIELD_SIZE)
    omega_dot = 8.0
    # A revolution from contact centre to contact centre, its omega the mean: slower in its first half.
    elapsed = np.where(THETA >= 0.0, THETA - math.pi, THETA + math.pi)

    def block(wave: SensorWaveform) -> np.ndarray:
        signal = np.zeros((3, FIELD_SIZE))
        radial, along = wave.specific_force(OMEGA, omega_dot)
        signal[RADIAL] = radial + 2.0 * omega_dot * elapsed * wave.radial_m
        signal[CIRCUMFERENTIAL] = along + 2.0 * omega_dot * elapsed * wave.circumferential_m
        return signal

    conditions = replace(CONDITIONS, omega_dot_radps2=omega_dot)
    here = Here(conditions, THETA, block(stated.sensor), stated.sensor, -0.24, 0.24)
    after = applied(here, rolling_radius=(share,)).signal_mps2
    assert rms(after - block(true.sensor)) < 2e-4 * rms(after)
    assert rms(after - (1.0 + share) * here.signal_mps2) > 0.1


def test_a_lower_sensor_is_solved_lower() -> None:
    effect = catalogue()["mounting offset"]
    assert isinstance(effect, RingEffect)
    declared = RingOptions(sensor_offset_m=0.002)
    assert effect.options(declared, np.zeros(1), CONDITIONS) == declared
    options = effect.options(declared, np.array([0.006]), CONDITIONS)
    plan = plan_of(sensor="offset_mm = 8.0")
    truth = look_up(plan.table().waveform(5000.0, 2.1e5, OMEGA), THETA)
    ring = plan.tire.ring
    wave = solve_rolling_ring(ring, 5000.0, 2.1e5, OMEGA, nodes=720, sensor_offset_m=options.sensor_offset_m).sensor
    coarse = np.interp(THETA, -math.pi + 2.0 * math.pi / 720 * np.arange(720), wave.circumferential_m)
    assert rms(coarse - truth[:, 1]) < 0.02 * rms(truth[:, 1])
    assert rms(truth[:, 1]) > 0.005


@pytest.mark.parametrize("name", NAMES)
def test_nothing_at_zero_parameters(name: str) -> None:
    effect, here = effect_of(name), here_of(65.0, 5.0)
    zero = np.zeros(len(effect.parameters))
    assert not effect.contribution(here, zero).any()
    assert np.isfinite(effect.derivative(here, zero)).all()


def values_of(effect: SignalEffect, draw: float) -> np.ndarray:
    """Return parameters within their ranges, away from where they are 0."""
    if effect.name == "clipping":
        return np.array([1.0 / (800.0 + 900.0 * draw), 0.002 + 0.05 * draw])
    low = [max(p.low, p.prior_mean - 1.5 * p.prior_std) for p in effect.parameters]
    high = [min(p.high, p.prior_mean + 1.5 * p.prior_std) for p in effect.parameters]
    return np.array([a + (b - a) * (0.02 + 0.96 * draw) for a, b in zip(low, high, strict=True)])


@settings(max_examples=12, deadline=None)
@given(draw=st.floats(0.0, 1.0), omega_dot=st.sampled_from([-9.0, 0.0, 9.0]), reverse=st.booleans())
@pytest.mark.parametrize("name", NAMES)
def test_derivatives_are_those_of_differences(name: str, draw: float, omega_dot: float, reverse: bool) -> None:
    effect, here = effect_of(name), here_of(65.0, omega_dot)
    here = replace(here, conditions=replace(here.conditions, temperature_degc=50.0, reverse=reverse))
    at = values_of(effect, draw)
    rows = effect.derivative(here, at)
    assert rows.shape == (len(at), 3, FIELD_SIZE)
    for place, (row, parameter) in enumerate(zip(rows, effect.parameters, strict=True)):
        step = np.zeros(len(at))
        step[place] = parameter.step
        if abs(at[place]) < 3.0 * parameter.step:
            at = at + 5.0 * step
            row = effect.derivative(here, at)[place]
        # Fourth-order differences.
        near = effect.contribution(here, at + step) - effect.contribution(here, at - step)
        far = effect.contribution(here, at + 2.0 * step) - effect.contribution(here, at - 2.0 * step)
        numeric = (8.0 * near - far) / (12.0 * parameter.step)
        assert np.abs(row - numeric).max() <= 1e-5 * max(np.abs(row).max(), 1.0)


@pytest.mark.parametrize("name", NAMES)
def test_they_act_where_they_say_and_start_within_range(name: str) -> None:
    effect, here = effect_of(name), here_of(65.0, 5.0)
    here = replace(here, conditions=replace(here.conditions, temperature_degc=50.0))
    starts = effect.starts((CONDITIONS, here.conditions))
    assert starts
    for start in starts:
        assert any(start)
        for value, parameter in zip(start, effect.parameters, strict=True):
            assert parameter.low <= value <= parameter.high
        change = effect.contribution(here, np.array(start))
        assert change.shape == here.signal_mps2.shape
        assert set(np.flatnonzero(np.abs(change).max(axis=1) > 1e-9)) <= set(effect.axes)
        if effect.linear:
            assert effect.contribution(here, 2.0 * np.array(start)) == pytest.approx(2.0 * change, rel=1e-12)
            assert np.tensordot(np.array(start), effect.derivative(here, np.array(start)), 1) == pytest.approx(change)


def test_an_ac_coupled_sensor_passes_no_constant() -> None:
    here = here_of()
    ac = replace(here, conditions=replace(here.conditions, ac_coupled=True))
    effect = effect_of("zero-g offset")
    values = np.array([1.0, 2.0, 3.0])
    assert not effect.contribution(ac, values).any()
    assert not effect.derivative(ac, values).any()
    passed = applied(here, AC_coupling=(0.3,)).signal_mps2
    assert np.abs(passed.mean(axis=1)).max() < 1e-9


def test_the_electronics_come_behind_the_element() -> None:
    order = {effect.name: at for at, effect in enumerate(catalogue().values())}
    assert order["roll tilt"] < order["pitch tilt"]
    assert order["gain"] < order["zero-g offset"]
    assert order["clipping"] < order["anti-alias filter"] < order["AC coupling"]
    assert len(MODULES) == len(catalogue())
    stages = [effect_of(name).stage for name in NAMES]
    assert stages == sorted(stages)
    assert effect_of("rolling radius").stage is Stage.BELT


def test_the_filter_leaves_its_delay_to_the_contacts_centre() -> None:
    here = here_of()
    effect = effect_of("anti-alias filter")
    before = np.fft.rfft(here.signal_mps2[RADIAL])[1:6]

    def turned(inverse_corner_s: float) -> np.ndarray:
        added = effect.contribution(here, np.array([inverse_corner_s]))[RADIAL]
        return np.angle(np.fft.rfft(here.signal_mps2[RADIAL] + added)[1:6] / before)

    order_hz = np.arange(1, 6) * here.conditions.omega_radps / (2.0 * math.pi)
    x = order_hz / 600.0
    # A delay would be sqrt(2) x; what is left of the phase begins with the cube.
    assert turned(1.0 / 600.0) == pytest.approx(-math.sqrt(2.0) / 3.0 * x**3, rel=0.05)
    assert turned(1.0 / 300.0) == pytest.approx(8.0 * turned(1.0 / 600.0), rel=0.2)
