"""From scenario to counts: motion, filters, tire table, sensor chain; against closed forms and direct solutions."""

import math

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.ring.rolling_ring import RingParameters, solve_rolling_ring
from gateway.ring.tread_pattern import EdgeWaves
from gateway.simulator.filters import highpass, lowpass, lowpass_noise_gain
from gateway.simulator.motion import MotionProfile
from gateway.simulator.scenario import parse_scenario
from gateway.simulator.sensor import SensorChain, mounting_matrix
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.time_series import Series, constant
from gateway.simulator.tire_model import RING_NODES, TireModel
from gateway.simulator.tire_table import Range, TireTable, look_up
from gateway.simulator.wheel_plan import wheel_plans

RING = RingParameters.from_numbers(3.08e-3, 0.195, 2.97, 2.53, radius_m=0.32, pressure_pa=2.1e5)
QUIET = "noise_mg_rthz = 0.0\nrange_g = 1000.0\n"


def wheel_of(toml: str = "", sensor: str = QUIET, speed: str = "65.0", seed: int = 1) -> WheelSimulator:
    text = f"""
[motion]
speed_kmh = {speed}
[sensor]
{sensor}
[[wheel]]
position = "W"
wheel = 0
phase_deg = 0.0
{toml}
"""
    (plan,) = wheel_plans(parse_scenario(text, "test"))
    return WheelSimulator(plan, np.random.default_rng(seed))


def run(wheel: WheelSimulator, until_s: float) -> np.ndarray:
    """Samples in m/s^2, scaled as the hello states, block by block."""
    blocks = [wheel.advance(end).counts for end in np.arange(0.25, until_s + 1e-9, 0.25)]
    scale = [scale for scale in wheel.chain.scale_mps2 if scale]
    return np.concatenate(blocks) * np.array(scale)


def test_motion_integrates_its_speed() -> None:
    profile = MotionProfile(Series(((0, 36), (2, 72), (5, 0), (8, 0), (9, 36))))
    time = np.linspace(0, 12, 12001)
    motion = profile.at(time)
    numeric = np.concatenate([[0.0], np.cumsum(0.5 * (motion.speed_mps[1:] + motion.speed_mps[:-1]) * 1e-3)])
    assert motion.distance_m == pytest.approx(numeric, abs=1e-6)
    assert profile.at(np.array([1.0, 3.0, 6.0, 20.0])).speed_mps == pytest.approx([15.0, 20 - 20 / 3, 0.0, 10.0])
    assert profile.at(np.array([1.0, 3.0])).acceleration_mps2 == pytest.approx([5.0, -20 / 3])
    assert profile.highest_mps == pytest.approx(20.0)


def test_profile_repeats_and_holds_before_the_first_point() -> None:
    profile = MotionProfile(Series(((0, 36), (1, 72), (2, 36))), repeat=True)
    assert profile.at(np.array([201.0])).speed_mps == pytest.approx(20.0)
    assert profile.at(np.array([200.0])).distance_m == pytest.approx(100 * 30.0)
    held = MotionProfile(Series(((5, 36), (6, 72))))
    assert held.at(np.array([0.0, 4.0, 6.0, 7.0])).speed_mps == pytest.approx([10, 10, 20, 20])


@settings(max_examples=60)
@given(
    st.lists(st.tuples(st.floats(0.1, 20), st.just(0.0) | st.floats(0.1, 200)), min_size=1, max_size=6),
    st.floats(0, 60),
    st.booleans(),
)
@example([(2.0, 0.0), (1.5, 1.0), (5.0, 0.0)], 26.0, True)
def test_time_at_distance_is_the_inverse(steps: list[tuple[float, float]], time_s: float, repeat: bool) -> None:
    times = np.cumsum([step for step, _ in steps])
    points = tuple((float(t), speed) for t, (_, speed) in zip(times, steps, strict=True))
    profile = MotionProfile(Series(((0.0, points[-1][1]), *points)), repeat)
    distance = profile.at(np.array([time_s])).distance_m
    result = profile.time_at(distance)
    assert profile.at(result).distance_m == pytest.approx(distance, abs=1e-6)


def test_time_at_distance_is_start_of_standstill() -> None:
    profile = MotionProfile(Series(((0, 36), (1, 0), (4, 0), (5, 36), (6, 36), (7, 0), (8, 36))), repeat=True)
    assert profile.time_at(np.array([5.0, 5.0 + 1e-9])) == pytest.approx([1.0, 4.0], abs=1e-3)
    ends_standing = MotionProfile(Series(((0, 0), (1, 36), (2, 0), (5, 0))), repeat=True)
    assert ends_standing.time_at(np.array([10.0, 20.0])) == pytest.approx([2.0, 7.0])


def test_time_at_an_unreached_distance_is_infinite() -> None:
    assert MotionProfile(Series(((0, 36), (1, 0)))).time_at(np.array([5.0, 5.1])) == pytest.approx([1.0, math.inf])


@pytest.mark.parametrize("make", [lowpass, highpass])
def test_filters_are_3_db_down_at_their_corner(make) -> None:  # type: ignore[no-untyped-def]
    rate, corner = 9600.0, 200.0
    time = np.arange(19200) / rate
    for factor, loss in ((1.0, 1 / math.sqrt(2)),):
        wave = np.sin(2 * math.pi * factor * corner * time)[:, None]
        settled = make(corner, rate)(wave)[9600:, 0]
        assert math.sqrt(2 * np.mean(settled**2)) == pytest.approx(loss, rel=1e-3)


def test_lowpass_has_two_poles_and_unit_dc_gain() -> None:
    rate = 20000.0
    time = np.arange(40000) / rate
    far = lowpass(100.0, rate)(np.sin(2 * math.pi * 1000.0 * time)[:, None])[20000:]
    assert math.sqrt(2 * np.mean(far**2)) == pytest.approx(0.01, rel=0.05)
    assert lowpass(100.0, rate)(np.full((50, 2), 7.0)) == pytest.approx(7.0)
    assert highpass(1.0, rate)(np.full((50, 2), 7.0)) == pytest.approx(0.0, abs=1e-12)


@given(st.lists(st.integers(0, 50), min_size=1, max_size=10))
@settings(max_examples=30)
def test_filters_do_not_depend_on_block_length(sizes: list[int]) -> None:
    signal = np.random.default_rng(1).standard_normal((sum(sizes), 2))
    whole, parts = lowpass(700.0, 9600.0), lowpass(700.0, 9600.0)
    ends = np.cumsum([0, *sizes])
    pieces = [parts(signal[a:b]) for a, b in zip(ends[:-1], ends[1:], strict=True)]
    assert np.concatenate(pieces) == pytest.approx(whole(signal), abs=1e-12)


def test_lowpass_noise_gain_matches_the_noise() -> None:
    noise = np.random.default_rng(1).standard_normal((200_000, 1))
    assert lowpass(400.0, 9600.0)(noise).std() == pytest.approx(lowpass_noise_gain(400.0, 9600.0), rel=0.01)


@pytest.fixture(scope="module")
def table() -> TireTable:
    tire = TireModel(RING, 2.1e5, sensor_offset_m=0.004)
    return TireTable(tire, Range(4500, 5500), Range(2.0e5, 2.2e5), Range(0, 80))


def test_tire_table_interpolates_the_solution(table: TireTable) -> None:
    load, pressure = 4830.0, 2.07e5
    direct = solve_rolling_ring(
        table.tire.ring_at(pressure), load, pressure, 50.0, nodes=RING_NODES, sensor_offset_m=0.004
    )
    force = look_up(table.waveform(load, pressure, 50.0), direct.theta_rad)
    # Only the table's float32 and the polynomial in load and pressure lie between.
    assert force[:, 0] == pytest.approx(direct.sensor.radial_m, abs=1e-3 * RING.radius_m)
    assert force[:, 1] == pytest.approx(direct.sensor.circumferential_m, abs=1e-3 * RING.radius_m)
    assert force[:, 2:4] == pytest.approx(np.stack(direct.sensor[2:4], axis=1), abs=1e-3)
    edges = table.edges_rad(load, pressure, 50.0)
    assert edges == pytest.approx((direct.leading_edge_rad, direct.trailing_edge_rad), abs=2e-4)


def test_tire_table_without_damping_does_not_depend_on_speed(table: TireTable) -> None:
    assert not table.depends_on_speed
    damped = TireTable(
        TireModel(RingParameters.from_numbers(*RING.numbers(2.1e5), radius_m=0.32, pressure_pa=2.1e5,
                                              foundation_damping_nspm2=200.0), 2.1e5),
        Range(5000, 5000), Range(2.1e5, 2.1e5), Range(0, 80),
    )  # fmt: skip
    assert damped.depends_on_speed
    assert damped.edges_rad(5000, 2.1e5, 0.0)[0] == pytest.approx(-damped.edges_rad(5000, 2.1e5, 0.0)[1], abs=1e-6)
    leading, trailing = damped.edges_rad(5000, 2.1e5, 70.0)
    assert leading + trailing < -0.005


def test_lookup_wraps_around_revolution(table: TireTable) -> None:
    wave = table.waveform(5000, 2.1e5, 50.0)
    angles = np.array([-math.pi, math.pi, 3 * math.pi, math.pi - 1e-15, -math.pi - 1e-12])
    assert look_up(wave, angles) == pytest.approx(np.tile(wave[0], (5, 1)), abs=1e-6)


def test_steady_wheel_samples_equal_ring_specific_force() -> None:
    wheel = wheel_of()
    measured = run(wheel, 0.5)
    omega = 65 / 3.6 / 0.32
    ring = solve_rolling_ring(wheel.plan.tire.ring_at(2.1e5), 5000.0, 2.1e5, omega, nodes=RING_NODES)
    theta = np.mod(np.arange(len(measured)) / 9600.0 * omega + math.pi, 2 * math.pi) - math.pi
    radial, along = ring.sensor.specific_force(omega)
    grid = np.r_[ring.theta_rad, math.pi]
    lsb = 1000 * STANDARD_GRAVITY_MPS2 / 32767
    assert measured[:, 2] == pytest.approx(np.interp(theta, grid, np.r_[radial, radial[0]]), abs=3 * lsb + 0.5)
    assert measured[:, 0] == pytest.approx(np.interp(theta, grid, np.r_[along, along[0]]), abs=3 * lsb + 0.5)
    side = wheel.plan.tire.solve_lateral(ring, 0.0).specific_force(omega)
    assert measured[:, 1] == pytest.approx(np.interp(theta, grid, np.r_[side, side[0]]), abs=lsb + 0.1)
    assert 25.0 < measured[:, 1].max() < 45.0
    assert measured[:, 2].max() / (0.32 * omega**2) == pytest.approx(1.5, abs=0.02)


def test_closure_identity_holds_at_any_acceleration() -> None:
    wheel = wheel_of(speed="[[0, 50], [10, 86]]")
    measured, rate = run(wheel, 4.0)[:, 2], 9600.0
    motion = wheel.plan.motion.at(np.arange(len(measured)) / rate)
    angle = motion.distance_m / 0.32
    whole = angle < angle[-1] // (2 * math.pi) * 2 * math.pi
    omega = motion.speed_mps[whole] / 0.32
    # Mean over angle of s / (R omega^2) is 1; an even grid in time weighs with omega.
    mean = np.sum(measured[whole] / omega) / np.sum(0.32 * omega)
    assert mean == pytest.approx(1.0, abs=1e-3)


def test_standing_wheel_reads_gravity_only() -> None:
    measured = run(wheel_of("camber_deg = 10.0", speed="0.0"), 0.5)
    camber = math.radians(10)
    assert measured[:, 2] == pytest.approx(STANDARD_GRAVITY_MPS2 * math.cos(camber), abs=0.2)
    assert measured[:, 1] == pytest.approx(STANDARD_GRAVITY_MPS2 * math.sin(camber), abs=0.2)


def test_road_noise_has_stated_rms_while_rolling() -> None:
    toml = "[wheel.road]\nrms_mps2 = 20.0\nbandwidth_hz = 300.0\n"
    shaken, still = run(wheel_of(toml), 4.0), run(wheel_of(), 4.0)
    assert (shaken - still).std(axis=0) == pytest.approx(20.0, rel=0.1)
    assert run(wheel_of(toml, speed="0.0"), 0.5).std(axis=0).max() < 0.1


def test_noise_has_data_sheet_density() -> None:
    noisy = run(wheel_of(sensor="noise_mg_rthz = [1.0, 5.0, 20.0]\nrange_g = 500.0\n", speed="0.0"), 4.0)
    density = noisy.std(axis=0) / math.sqrt(4800.0) / (1e-3 * STANDARD_GRAVITY_MPS2)
    assert density == pytest.approx([1.0, 5.0, 20.0], rel=0.03)


def test_bandwidth_delays_the_signal() -> None:
    narrow, wide = run(wheel_of(sensor=QUIET + "bandwidth_hz = 300.0"), 0.5), run(wheel_of(), 0.5)
    lags = [float(np.sum((narrow[20:, 2] - wide[20 - lag : -lag, 2]) ** 2)) for lag in range(1, 20)]
    # Group delay of two Butterworth poles at low frequency: sqrt(2) / (2 pi f).
    assert 1 + int(np.argmin(lags)) == pytest.approx(math.sqrt(2) / (2 * math.pi * 300) * 9600, abs=1.0)


def test_ac_coupling_removes_the_mean() -> None:
    sensor = QUIET + 'coupling = "ac"\nhighpass_hz = 1.0'
    coupled = run(wheel_of(sensor=sensor), 4.0)
    assert coupled[-9600:, 2].mean() == pytest.approx(0.0, abs=10.0)
    assert run(wheel_of(), 4.0)[-9600:, 2].mean() > 1000.0


def test_axes_sign_offset_gain_and_saturation() -> None:
    plain = run(wheel_of(), 0.25)
    upside_down = wheel_of(sensor=QUIET + "radial_sign = -1")
    assert upside_down.chain.scale_mps2[2] < 0
    assert run(upside_down, 0.25) == pytest.approx(plain, abs=0.7)
    hidden = wheel_of(sensor=QUIET + "radial_sign = -1\nsign_declared = false")
    assert run(hidden, 0.25)[:, 2] == pytest.approx(-plain[:, 2], abs=0.7)
    only = wheel_of(sensor=QUIET + 'axes = ["radial", "circumferential"]')
    assert only.chain.axes == 0b101
    assert run(only, 0.25) == pytest.approx(plain[:, [0, 2]])
    shifted = run(wheel_of(sensor=QUIET + "zero_g_offset_g = [0, 0, 2.0]\ngain_error_percent = [0, 0, 1.0]"), 0.25)
    assert shifted[:, 2] == pytest.approx(1.01 * plain[:, 2] + 2 * STANDARD_GRAVITY_MPS2, abs=1.0)
    crossed = run(wheel_of(sensor=QUIET + "cross_axis_percent = 2.0"), 0.25)
    assert crossed == pytest.approx(0.98 * plain + 0.02 * plain.sum(axis=1, keepdims=True), abs=1.0)
    clipped = wheel_of(sensor="noise_mg_rthz = 0.0\nrange_g = 120.0").advance(0.25).counts
    assert clipped[:, 2].max() == 32767


def test_mounting_angles_project_radial_onto_other_axes() -> None:
    tilted = run(wheel_of(sensor=QUIET + "roll_deg = 2.0\npitch_deg = 1.0"), 0.25)
    plain = run(wheel_of(), 0.25)
    assert tilted[:, 1].mean() / tilted[:, 2].mean() == pytest.approx(math.tan(math.radians(2)), rel=0.01)
    assert tilted[:, 0] == pytest.approx(
        math.cos(math.radians(1)) * plain[:, 0] + math.sin(math.radians(1)) * math.cos(math.radians(2)) * plain[:, 2],
        abs=1.0,
    )
    matrix = mounting_matrix(7.0, -11.0)
    assert matrix @ matrix.T == pytest.approx(np.eye(3))


def test_changing_pressure_and_load_fade_without_steps() -> None:
    toml = "pressure_kpa = [[0, 200], [2, 230]]\nload_n = [[0, 3000], [2, 6000]]\n"
    wheel, rate, omega = wheel_of(toml, speed="30.0"), 9600.0, 30 / 3.6 / 0.32
    measured = run(wheel, 2.0)[:, 2]
    steps = np.abs(np.diff(measured, 2))
    borders = np.concatenate([steps[k - 3 : k + 2] for k in range(2400, len(measured) - 2400, 2400)])
    assert borders.max() <= steps.max() * 1.01
    table = wheel.plan.table()
    for time_s in (0.2, 1.1, 1.9):
        index = int(time_s * rate)
        window = slice(index - int(math.pi / omega * rate), index + int(math.pi / omega * rate))
        inside = np.mean(measured[window] < 0.5 * 0.32 * omega**2)
        leading, trailing = table.edges_rad(3000 + 1500 * time_s, (200 + 15 * time_s) * 1e3, omega)
        assert inside * 2 * math.pi == pytest.approx(trailing - leading, rel=0.35)


def test_edge_waves_start_at_edges_and_close_belt() -> None:
    theta = -math.pi + 2 * math.pi * np.arange(2048) / 2048
    wave = EdgeWaves(0.1, order_before=30.0, order_after=50.0, decay_rad=0.8).radial(theta, -0.24, 0.23)
    spectrum = np.abs(np.fft.rfft(wave))
    assert spectrum[:2] == pytest.approx(0.0, abs=1e-9)
    assert np.abs(wave[np.abs(theta) < 0.15]).max() < 0.02
    ahead, behind = wave[(theta > -1.5) & (theta < -0.3)], wave[(theta > 0.3) & (theta < 1.5)]
    crossings = [int(np.count_nonzero(np.diff(np.sign(part)))) for part in (ahead, behind)]
    assert crossings[0] == pytest.approx(1.2 * 30 / math.pi, abs=2)
    assert crossings[1] == pytest.approx(1.2 * 50 / math.pi, abs=2)
    assert np.abs(wave).max() == pytest.approx(0.1, rel=0.2)


def test_scenario_edge_waves_change_samples() -> None:
    waved, plain = run(wheel_of("[wheel.edge_waves]\namplitude_percent = 10.0"), 0.5), run(wheel_of(), 0.5)
    scale = 0.32 * (65 / 3.6 / 0.32) ** 2
    assert 0.05 < np.abs(waved - plain)[:, 2].max() / scale < 0.15


def test_series_and_sensor_keep_their_parameters() -> None:
    series = Series(((0.0, 1.0), (2.0, 5.0)))
    assert [series.at(time) for time in (-1, 1, 9)] == [1.0, 3.0, 5.0]
    assert (series.low, series.high) == (1.0, 5.0)
    assert constant(3.0).at(7.0) == 3.0
    plan = wheel_of().plan
    chain = SensorChain(plan.sensor, np.random.default_rng(1))
    assert chain.range_mps2 == pytest.approx((1000 * STANDARD_GRAVITY_MPS2,) * 3)
