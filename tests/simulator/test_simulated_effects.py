"""Vibration, run-out, jitter, blows and broken sensors, each against its closed form."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import Environment, HubStatus, SampleBlock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.errors import ConfigError
from gateway.simulator.disturbances import EdgeJitter
from gateway.simulator.filters import band_noise_gain, loose_mass, resonator
from gateway.simulator.motion import MotionProfile, Ripple, WheelRotation
from gateway.simulator.scenario import parse_scenario, vehicle_toml
from gateway.simulator.sensor import mounting_matrix
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.simulation import simulate
from gateway.simulator.time_series import Series
from gateway.simulator.tire_table import look_up
from gateway.simulator.truth import WheelTruth
from gateway.simulator.wheel_plan import WheelPlan, wheel_plans

RATE = 9600.0
OMEGA = 65.0 / 3.6 / 0.32
G = STANDARD_GRAVITY_MPS2


def scenario_of(wheel: str = "", sensor: str = "", speed: str = "65.0"):
    text = f"""
[motion]
speed_kmh = {speed}
[sensor]
noise_mg_rthz = 0.0
range_g = 1000.0
{sensor}
[[wheel]]
position = "W"
wheel = 0
phase_deg = 0.0
{wheel}
"""
    return parse_scenario(text, "test")


def plan_of(wheel: str = "", sensor: str = "", speed: str = "65.0") -> WheelPlan:
    return wheel_plans(scenario_of(wheel, sensor, speed))[0]


def run(wheel: str = "", sensor: str = "", speed: str = "65.0", until_s: float = 1.0) -> np.ndarray:
    simulator = WheelSimulator(plan_of(wheel, sensor, speed), np.random.default_rng(1))
    blocks = [simulator.advance(end).counts for end in np.arange(0.25, until_s + 1e-9, 0.25)]
    return np.concatenate(blocks) * np.array(simulator.chain.scale_mps2)


def shapes(plan: WheelPlan, samples: int) -> np.ndarray:
    """Waveform columns of a steady wheel at its samples."""
    table = plan.table().waveform(5000.0, 2.1e5, OMEGA)
    return look_up(table, plan.rotation(0.0).at(np.arange(samples) / RATE).angle_rad)


def test_ripple_angle_and_time_are_inverse() -> None:
    rotation = WheelRotation(MotionProfile(Series(((0, 50), (3, 80)))), 0.3, 0.4, Ripple(0.05, 3.0, 0.7))
    time = np.linspace(0.0, 3.0, 30001)
    turning = rotation.at(time)
    step = time[1]
    assert np.gradient(turning.angle_rad, step)[1:-1] == pytest.approx(turning.omega_radps[1:-1], rel=1e-5)
    assert np.gradient(turning.omega_radps, step)[1:-1] == pytest.approx(turning.omega_dot_radps2[1:-1], abs=0.1)
    assert rotation.times_at(turning.angle_rad[::500]) == pytest.approx(time[::500], abs=1e-9)


def test_integer_order_ripple_repeats_and_keeps_period() -> None:
    plan = plan_of("[wheel.vibration]\nripple_percent = 2.0\nripple_order = 12.0")
    truth, plain = WheelTruth(plan, 0.3), WheelTruth(plan_of(), 0.3)
    bottoms = truth.bottom_times_s(0.0, 3.0)
    assert np.diff(bottoms) == pytest.approx(2 * math.pi / OMEGA, rel=1e-12)
    assert len(bottoms) == len(plain.bottom_times_s(0.0, 3.0))
    assert np.cos(truth.angle_rad(bottoms)) == pytest.approx(1.0)


def test_ripple_samples_equal_shape_at_rippled_speed() -> None:
    wheel = "[wheel.vibration]\nripple_percent = 1.0\nripple_order = 2.0"
    measured, plan = run(wheel), plan_of(wheel)
    turning, shape = plan.rotation(0.0).at(np.arange(len(measured)) / RATE), shapes(plan, len(measured))
    expected = turning.omega_radps**2 * shape[:, 0] + G * shape[:, 2] + turning.omega_dot_radps2 * shape[:, 4]
    assert measured[:, 2] == pytest.approx(expected, abs=0.5)
    assert turning.omega_radps.max() / OMEGA == pytest.approx(1.01, abs=1e-4)


@pytest.mark.parametrize(("speed", "factor"), [(65.0, 1.0), (32.5, 0.25)])
def test_imbalance_is_order_one_and_quadratic_in_speed(speed: float, factor: float) -> None:
    wheel = "[wheel.vibration]\nimbalance_mps2 = 8.0\nimbalance_deg = 40.0"
    shaken = run(wheel, speed=str(speed)) - run(speed=str(speed))
    angle = plan_of(speed=str(speed)).rotation(0.0).at(np.arange(len(shaken)) / RATE).angle_rad
    free = np.abs(np.mod(angle + math.pi, 2 * math.pi) - math.pi) > 1.2
    # Away from the contact the belt is inclined nearly as a rigid wheel: orders 0 and 2 of the radial axis.
    expected = factor * 8.0 * np.cos(angle + math.radians(40.0)) * np.cos(angle)
    assert shaken[free, 2] == pytest.approx(expected[free], abs=0.8 * factor + 0.6)
    assert np.abs(shaken[:, 1]).max() < 0.7


def test_hub_bounce_has_stated_size_and_band() -> None:
    wheel = "[wheel.vibration]\nhub_rms_mps2 = 20.0\nhub_hz = 100.0\nhub_bandwidth_hz = 60.0"
    bounced = run(wheel, until_s=8.0) - run(until_s=8.0)
    # The two axes in the wheel's plane share a vertical acceleration.
    assert math.hypot(*bounced[:, [0, 2]].std(axis=0)) == pytest.approx(20.0, rel=0.05)
    assert run(wheel, speed="0.0").std(axis=0).max() < 0.1


def test_cavity_is_a_radial_line_at_its_frequency() -> None:
    wheel = "[wheel.vibration]\ncavity_rms_mps2 = 25.0\ncavity_hz = 230.0\ncavity_bandwidth_hz = 8.0"
    line = (run(wheel, until_s=16.0) - run(until_s=16.0))[:, 2]
    assert line.std() == pytest.approx(25.0, rel=0.1)
    power, frequency = np.abs(np.fft.rfft(line)) ** 2, np.fft.rfftfreq(len(line), 1 / RATE)
    assert float((power * frequency).sum() / power.sum()) == pytest.approx(230.0, abs=15.0)
    # A Lorentzian bell has half of its power within its width.
    assert power[np.abs(frequency - 230.0) < 4.0].sum() / power.sum() == pytest.approx(0.5, abs=0.1)


def test_resonances_have_their_gain() -> None:
    time = np.arange(38400) / RATE

    def gain(section, hz: float) -> float:
        return math.sqrt(2.0) * float(section(np.sin(2 * math.pi * hz * time)[:, None])[19200:].std())

    assert gain(resonator(300.0, 20.0, RATE), 300.0) == pytest.approx(1.0, abs=1e-3)
    assert gain(resonator(300.0, 20.0, RATE), 310.0) == pytest.approx(1 / math.sqrt(2), abs=0.02)
    assert gain(loose_mass(800.0, 5.0, RATE), 800.0) == pytest.approx(math.sqrt(26.0), rel=2e-2)
    assert gain(loose_mass(800.0, 5.0, RATE), 20.0) == pytest.approx(1.0, abs=2e-3)
    assert loose_mass(800.0, 5.0, RATE)(np.full((50, 2), 7.0)) == pytest.approx(7.0)
    for resonance_hz, quality in ((800.0, 5.0), (2500.0, 15.0), (3700.0, 10.0)):
        for hz in (300.0, 600.0, 1200.0):
            x = hz / resonance_hz
            expected = abs((1.0 + 1j * x / quality) / (1.0 - x * x + 1j * x / quality))
            assert gain(loose_mass(resonance_hz, quality, RATE), hz) == pytest.approx(expected, rel=0.02)
    noise = resonator(300.0, 20.0, RATE)(np.random.default_rng(1).standard_normal((400_000, 1)))
    assert noise.std() == pytest.approx(band_noise_gain(300.0, 20.0, RATE), rel=0.05)


def test_stone_strikes_once_per_revolution_and_rings() -> None:
    table = "[wheel.impact]\namplitude_mps2 = 300.0\nat_deg = 100.0\nfrequency_hz = 700.0\ndecay_ms = 3.0"
    ringing = (run(table) - run())[:, 2]
    time, period = np.arange(len(ringing)) / RATE, 2 * math.pi / OMEGA
    expected = np.zeros(len(time))
    for struck in math.radians(100.0) / OMEGA + period * np.arange(9):
        since = np.maximum(time - struck, 0.0)
        expected += 300.0 * np.exp(-since / 3e-3) * np.sin(2 * math.pi * 700.0 * since)
    assert ringing == pytest.approx(expected, abs=0.7)
    stopping = "[[0, 40], [1, 0], [2, 0], [3, 40]]"
    assert np.isfinite(run(table, speed=stopping, until_s=3.0)).all()


@settings(max_examples=12)
@given(st.floats(0.001, 0.02), st.floats(0.0, 0.02), st.integers(1, 5))
def test_jitter_moves_only_the_contact_edges(lead: float, trail: float, parts: int) -> None:
    angle = np.linspace(0.0, 2 * math.pi * 300, 300 * 800, endpoint=False)
    jitter = EdgeJitter(lead, trail, np.random.default_rng(3))
    moved = np.concatenate([jitter.shifted(piece, (-0.2, 0.2)) for piece in np.array_split(angle, parts)])
    within = np.mod(angle + math.pi, 2 * math.pi) - math.pi
    leading, trailing = ((moved - angle)[np.abs(within - edge) < 0.004] for edge in (-0.2, 0.2))
    assert leading.std() == pytest.approx(lead, rel=0.15, abs=1e-3 * trail)
    assert trailing.std() == pytest.approx(trail, rel=0.15, abs=1e-3 * lead)
    # Neither edge moves the other one, however short the contact is.
    together = min(len(leading), len(trailing))
    assert abs(np.mean(leading[:together] * trailing[:together])) < 0.25 * lead * trail + 1e-3 * (lead**2 + trail**2)
    assert (moved - angle)[np.abs(within) > 0.71] == pytest.approx(0.0, abs=1e-12)
    assert (np.diff(moved) > 0.0).all()


def test_scenario_jitter_moves_leading_edge_only() -> None:
    moved = (run("[wheel.road]\nleading_jitter_mm = 4.0", until_s=2.0) - run(until_s=2.0))[:, 2]
    angle = plan_of().rotation(0.0).at(np.arange(len(moved)) / RATE).angle_rad
    within = np.mod(angle + math.pi, 2 * math.pi) - math.pi
    leading, trailing = np.abs(within + 0.25) < 0.1, (within > 0.27) & (within < 0.5)
    assert moved[leading].std() > 20.0
    assert moved[trailing].std() < 1.0


def test_high_spot_raises_contact_load() -> None:
    round_plan, plan = plan_of(), plan_of("[wheel.tire]\nrunout_mm = 1.0\nrunout_deg = 0.0")
    tire = round_plan.tire
    height = [tire.solve(load, 2.1e5, OMEGA).axle_height_m for load in (5000.0, 5100.0)]
    swing = 100.0 / (height[0] - height[1]) * 1e-3
    assert 100.0 < swing < 400.0
    gain = 1.0 + 1.0 / 320.0
    wave = plan.table().waveform(5000.0, 2.1e5, OMEGA)
    for angle, load in ((0.0, 5000.0 + swing), (math.pi, 5000.0 - swing), (0.5 * math.pi, 5000.0)):
        direct = tire.solve(load, 2.1e5, OMEGA)
        position = np.array([angle])
        expected = np.interp(
            position, np.r_[direct.theta_rad, math.pi], np.r_[direct.sensor.radial_m, direct.sensor.radial_m[0]]
        )
        assert look_up(wave, position)[0, 0] == pytest.approx(gain * expected[0], abs=2e-4)
    wider = np.subtract(
        plan.table().edges_rad(5000.0, 2.1e5, OMEGA), round_plan.table().edges_rad(5000.0, 2.1e5, OMEGA)
    )
    half = round_plan.table().edges_rad(5000.0, 2.1e5, OMEGA)[1]
    # The half angle grows as load to the 0.73.
    assert wider[1] / half == pytest.approx(0.73 * swing / 5000.0 * math.cos(half), rel=0.15)
    assert wider[0] == pytest.approx(-wider[1], rel=1e-3)


def test_driving_torque_acts_on_ring() -> None:
    tire = plan_of("[wheel.tire]\naxle_torque_nm = 200.0").tire
    driven = tire.solve(5000.0, 2.1e5, OMEGA)
    assert driven.axle_torque_nm == pytest.approx(200.0, rel=1e-6)
    assert driven.longitudinal_force_n == pytest.approx(200.0 / driven.axle_height_m, rel=0.1)


def test_electrical_tone_bypasses_the_lowpass() -> None:
    sensor = "bandwidth_hz = 100.0\n"
    added = run(sensor=f"{sensor}tone_mg = [0, 2000, 4000]\ntone_hz = 1000.0") - run(sensor=sensor)
    wave = np.sin(2 * math.pi * 1000.0 * np.arange(len(added)) / RATE)
    assert added == pytest.approx(np.outer(wave, [0.0, 2.0 * G, 4.0 * G]), abs=0.7)


def test_gain_and_offset_drift_with_temperature() -> None:
    sensor = "gain_drift_percent_per_k = [0, 0, 0.02]\nzero_g_drift_mg_per_k = [0, 100, 0]"
    warm, cold = run("temperature_degc = 75.0", sensor), run("temperature_degc = 25.0", sensor)
    assert cold == pytest.approx(run(), abs=1e-9)
    assert warm[:, 2] == pytest.approx(1.01 * cold[:, 2], abs=0.7)
    assert warm[:, 1] == pytest.approx(cold[:, 1] + 5.0 * G, abs=0.7)


def test_loose_sensor_rings_on_its_mounting() -> None:
    loose, firm = run('[wheel.defect]\naxes = ["radial"]\nloose_hz = 250.0\nloose_q = 20.0'), run()
    assert loose[:, :2] == pytest.approx(firm[:, :2], abs=1e-9)
    expected = loose_mass(250.0, 20.0, RATE)(firm[:, 2:])[:, 0]
    assert loose[:, 2] == pytest.approx(expected, abs=3.0)
    assert np.abs(loose - firm)[:, 2].max() > 50.0


def test_element_saturates_below_declared_range() -> None:
    clipped = run('[wheel.defect]\naxes = ["radial"]\nclip_g = 110.0')
    assert clipped == pytest.approx(np.minimum(run(), [1e9, 1e9, 110.0 * G]), abs=0.4)
    assert clipped[:, 2].max() == pytest.approx(110.0 * G, abs=0.4)


def test_channels_stick_or_die_at_stated_time() -> None:
    plain = run(until_s=1.0)
    stuck = run('[wheel.defect]\naxes = ["radial"]\nstuck_from_s = 0.4')
    position = math.ceil(0.4 * RATE)
    assert stuck[:position] == pytest.approx(plain[:position])
    assert (stuck[position:, 2] == plain[position - 1, 2]).all()
    assert stuck[:, :2] == pytest.approx(plain[:, :2])
    border = run("[wheel.defect]\nstuck_from_s = 0.5")
    assert (border[4800:] == plain[4799]).all()
    dead = run("[wheel.defect]\ndead_from_s = 0.3")
    assert (dead[math.ceil(0.3 * RATE) :] == 0.0).all()
    assert dead[: math.ceil(0.3 * RATE)] == pytest.approx(plain[: math.ceil(0.3 * RATE)])


def test_silent_wheel_and_stuck_pressure_are_transmitted() -> None:
    other = '[[wheel]]\nposition = "X"\nwheel = 1\n'
    wheel = "pressure_kpa = [[0, 200], [10, 300]]\n[wheel.defect]\nsilent_from_s = 6.0\npressure_stuck_from_s = 2.0\n"
    simulation = simulate(scenario_of(wheel + other), duration_s=8.0)
    decoder, frames = FrameDecoder(), []
    for chunk in simulation.chunks("link", 0):
        frames += decoder.feed(chunk.data)
    ours = [frame for frame in frames if frame.wheel == 0]
    assert max(frame.tick_us for frame in ours) < 6.0e6
    assert max(frame.tick_us for frame in frames if frame.wheel == 1) > 7.9e6
    assert any(isinstance(f.message, HubStatus) and f.tick_us > 6.5e6 for f in frames)
    assert sum(isinstance(f.message, SampleBlock) for f in ours) == pytest.approx(6.0 * RATE / 36, abs=2)
    reported = {f.tick_us * 1e-6: f.message.pressure_pa for f in ours if isinstance(f.message, Environment)}
    for time_s, pressure in reported.items():
        assert pressure == pytest.approx(200e3 + 10e3 * min(time_s, 2.0), abs=200.0)
    assert simulation.truth["W"].pressure_pa(5.0) == pytest.approx(250e3)
    assert decoder.counters.sources[(0, 0)].lost == 0


def test_misstatements_change_the_vehicle_file_only() -> None:
    stated = "[wheel.stated]\nload_n = 4500.0\npressure_kpa = 230.0\noffset_mm = 3.0\nroll_deg = 0.0\nradius_mm = 316.0"
    sensor = "offset_mm = 8.0\nroll_deg = 2.0"
    assert run(stated, sensor) == pytest.approx(run("", sensor))
    (setup,) = parse_vehicle(vehicle_toml(scenario_of(stated, sensor)), "test").wheel_setups()
    assert (setup.load_n, setup.pressure_pa, setup.radius_m) == pytest.approx((4500.0, 230e3, 0.316))
    assert setup.sensor.offset_m == pytest.approx(3e-3)
    assert "roll_deg = 0.0" in vehicle_toml(scenario_of(stated, sensor))
    assert "roll_deg = 2.0" in vehicle_toml(scenario_of("", sensor))


def test_vehicle_file_omits_reversed_sensor() -> None:
    upside_down = "roll_deg = 180.0\nyaw_deg = 90.0"
    parse_vehicle(vehicle_toml(scenario_of("", upside_down)), "test")
    assert "roll_deg = 0.0" in vehicle_toml(scenario_of("", upside_down))
    turned, plain = run("", upside_down), run()
    assert turned[:, 2] == pytest.approx(-plain[:, 2], abs=0.7)
    assert turned[:, 1] == pytest.approx(-plain[:, 0], abs=0.7)
    assert turned[:, 0] == pytest.approx(-plain[:, 1], abs=0.7)
    matrix = mounting_matrix(7.0, -11.0, 23.0)
    assert matrix @ matrix.T == pytest.approx(np.eye(3))


def test_fast_sample_clock_takes_more_samples() -> None:
    fast, plain = run(sensor="rate_error_ppm = 10000.0"), run()
    assert len(fast) == pytest.approx(1.01 * len(plain), abs=1)
    position = np.arange(len(plain) - 1) * 1.01
    assert np.interp(position, np.arange(len(fast)), fast[:, 2]) == pytest.approx(plain[:-1, 2], abs=15.0)


def test_effects_do_not_change_each_others_noise() -> None:
    noisy = "noise_mg_rthz = 20.0\nrange_g = 1000.0"
    text = f"[sensor]\n{noisy}\n[[wheel]]\nposition = 'W'\nwheel = 0\n"

    def counts(extra: str) -> np.ndarray:
        (plan,) = wheel_plans(parse_scenario(text + extra, "test"))
        return WheelSimulator(plan, np.random.default_rng(1)).advance(0.25).counts[:, :2]

    assert (counts("") == counts("[wheel.vibration]\ncavity_rms_mps2 = 9.0")).all()


def test_faults_of_effect_tables_are_reported_by_key() -> None:
    text = """
[sensor]
rate_hz = 2000.0
[vibration]
ripple_percent = 30.0
[defect]
axes = ["up"]
loose_hz = 950.0
[[wheel]]
position = "W"
wheel = 0
side = "top"
slip_angle_deg = 40.0
[wheel.stated]
load_n = 1.0
"""
    with pytest.raises(ConfigError) as caught:
        parse_scenario(text, "test")
    for key in ("ripple_percent", "defect.axes", "loose_hz: 950.0", "side", "slip_angle_deg", "stated.load_n"):
        assert key in str(caught.value)
