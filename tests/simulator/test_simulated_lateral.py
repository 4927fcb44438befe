"""The lateral axis of the simulator and the matching truth; tread pitch, AC coupling and an inextensible belt."""

import math
from itertools import pairwise

import numpy as np
import pytest

from firmware_protocol.messages import Coupling
from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.ring.tread_pattern import TreadPitch
from gateway.simulator.scenario import load_scenario, parse_scenario
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.simulation import simulate
from gateway.simulator.tire_table import LATERAL, Range, TireTable, look_up
from gateway.simulator.truth import WheelTruth, slopes_of
from gateway.simulator.wheel_plan import wheel_plans
from tests.testkit.simulated_wheel import results_of

QUIET = "[sensor]\nnoise_mg_rthz = 0.0\nrange_g = 1000.0\n"
OMEGA = 65.0 / 3.6 / 0.32
# Of the range of 1000 g; the square of the rate of slip is felt by less.
COUNT_MPS2 = 0.31


def plan_of(wheel: str = "", tables: str = ""):
    text = f'{QUIET}{tables}\n[[wheel]]\nposition = "W"\nwheel = 0\nphase_deg = 0.0\n{wheel}\n'
    return wheel_plans(parse_scenario(text, "test"))[0]


def truth_of(wheel: str = "", tables: str = "") -> WheelTruth:
    return WheelTruth(plan_of(wheel, tables), 0.0)


def run(wheel: str = "", tables: str = "", until_s: float = 0.5) -> np.ndarray:
    simulator = WheelSimulator(plan_of(wheel, tables), np.random.default_rng(1))
    blocks = [simulator.advance(end).counts for end in np.arange(0.25, until_s + 1e-9, 0.25)]
    return np.concatenate(blocks) * np.array(simulator.chain.scale_mps2)


@pytest.mark.parametrize("slip_deg", [-0.7, 0.13, 0.9])
def test_lateral_table_interpolates_the_belt_under_slip(slip_deg: float) -> None:
    tire, slip = plan_of().tire, math.radians(slip_deg)
    table = TireTable(
        tire, Range(5000, 5000), Range(2.1e5, 2.1e5), Range(0, 60), Range(-math.radians(1), math.radians(1))
    )
    direct = tire.solve_lateral(tire.solve(5000.0, 2.1e5, OMEGA), slip)
    result = look_up(table.waveform(5000.0, 2.1e5, OMEGA, slip), direct.theta_rad)[:, LATERAL]
    # Where sliding begins, a kink moves with the slip angle; there the polynomial is at its worst.
    assert np.std(result - direct.lateral_m) < 0.003 * direct.lateral_m.std()
    assert np.abs(result - direct.lateral_m).max() < 0.02 * np.abs(direct.lateral_m).max()


def test_wide_and_narrow_sweeps_agree() -> None:
    tire, position = plan_of().tire, (5000.0, 2.1e5, OMEGA, math.radians(0.2))
    waves = [
        TireTable(tire, Range(5000, 5000), Range(2.1e5, 2.1e5), Range(0, 60), Range(-math.radians(w), math.radians(w)))
        .waveform(*position)[:, LATERAL]
        for w in (0.2, 6.0)
    ]  # fmt: skip
    assert np.std(waves[1] - waves[0]) < 0.03 * waves[0].std()


def test_belt_without_crossed_plies_does_not_steer() -> None:
    assert np.abs(run("[wheel.tire]\ncord_angle_deg = 0.0")[:, 1]).max() < 0.1
    assert np.abs(run()[:, 1]).max() > 20.0
    mirrored = run("[wheel.tire]\ncord_angle_deg = 26.0")
    assert mirrored[:, 1] == pytest.approx(-run()[:, 1], abs=0.7)


def test_ply_steer_follows_rotation_and_conicity_follows_side() -> None:
    tire = "[wheel.tire]\nconicity_deg = 0.6"
    right = f'side = "right"\n{tire}'
    reverse = '[motion]\ndirection = "reverse"'
    ahead, back = truth_of(tire).ply_steer(0.0), truth_of(tire, reverse).ply_steer(0.0)
    plain, turned = truth_of().ply_steer(0.0), truth_of(right).ply_steer(0.0)
    ply_steer = 0.5 * (ahead.first_half_rad - back.first_half_rad)
    conicity = 0.5 * (ahead.first_half_rad + back.first_half_rad)
    assert ply_steer == pytest.approx(plain.first_half_rad, rel=1e-6)
    assert abs(conicity) > math.radians(0.01)
    assert turned.first_half_rad == pytest.approx(ply_steer - conicity, rel=1e-6)


def test_reverse_rolling_flips_the_circumferential_axis() -> None:
    tire = "[wheel.tire]\nfoundation_damping_nspm2 = 100.0\ncord_angle_deg = 0.0"
    ahead, back = run(tire), run(tire, '[motion]\ndirection = "reverse"')
    assert back[:, 0] == pytest.approx(-ahead[:, 0], abs=0.7)
    assert back[:, 1:] == pytest.approx(ahead[:, 1:], abs=1e-9)


def test_camber_ramp_rotates_gravity() -> None:
    text = "camber_deg = [[0, 0], [2, 20]]\n[wheel.tire]\ncord_angle_deg = 0.0\n[wheel.motion]\nspeed_kmh = 0.0"
    measured = run(text, until_s=2.0)
    camber = np.radians(10.0 * np.arange(len(measured)) / 9600.0)
    assert measured[:, 1] == pytest.approx(STANDARD_GRAVITY_MPS2 * np.sin(camber), abs=0.2)
    assert measured[:, 2] == pytest.approx(STANDARD_GRAVITY_MPS2 * np.cos(camber), abs=0.2)
    assert truth_of(text).camber_rad(1.5) == pytest.approx(math.radians(15.0))


def test_slip_changes_lateral_axis_only() -> None:
    swept, straight = run("slip_angle_deg = [[0, 0], [1, 1]]", until_s=1.5), run(until_s=1.5)
    held = run("slip_angle_deg = 1.0", until_s=1.5)
    assert swept[:, [0, 2]] == pytest.approx(straight[:, [0, 2]], abs=COUNT_MPS2)
    assert swept[-2400:, 1] == pytest.approx(held[-2400:, 1], abs=0.7)
    # One extremum stands out at one sign of slip; at 1 deg the waveform is no longer that of straight running.
    assert np.abs(swept[-2400:, 1] - straight[-2400:, 1]).max() > 20.0
    assert truth_of("slip_angle_deg = [[0, 0], [1, 1]]").slip_angle_rad(0.5) == pytest.approx(math.radians(0.5))


def test_slopes_of_a_parabola_in_the_contact() -> None:
    # y = c (theta - b)^2 / 2 inside, so that every definition has a closed form.
    radius, leading, trailing, c, b = 0.3, -0.25, 0.2, -2e-3, 0.1
    theta = -math.pi + 2 * math.pi * np.arange(1440) / 1440
    # Continued smoothly to a closed curve: the window is 1 over the contact.
    window = np.exp(-(np.maximum(np.abs(theta) - 0.6, 0.0) ** 2) / 0.1)
    result = slopes_of(window * 0.5 * c * (theta - b) ** 2, radius, leading, trailing)
    # The line through the contact rises; the slope is steepest at the leading edge and rises up to b.
    assert result.peak_rad == pytest.approx(c * (leading - b) / radius, rel=1e-2)
    middle = 0.5 * (leading + trailing)
    assert result.first_half_rad == pytest.approx(c * (0.5 * (leading + middle) - b) / radius, rel=1e-3)
    assert result.adhesion_line_rad == pytest.approx(c * (0.5 * (leading + b) - b) / radius, rel=1e-2)


def test_demo_has_ply_steer_and_sweep_has_both_signs() -> None:
    for truth in (WheelTruth(plan, 0.0) for plan in wheel_plans(load_scenario("demo"))):
        for slope in truth.ply_steer(3.0):
            assert 0.1 < math.degrees(slope) < 0.25
        assert truth.slopes(3.0) == truth.ply_steer(3.0)
    (plan,) = wheel_plans(load_scenario("slip"))
    assert (plan.slip_angle_rad.low, plan.slip_angle_rad.high) == pytest.approx((-math.radians(1), math.radians(1)))
    results = [WheelTruth(plan, 0.0).slopes(t).first_half_rad for t in (15.0, 20.0, 25.0)]
    assert all(low < high for low, high in pairwise(results))


def test_ply_steer_estimates_match_the_truth() -> None:
    text = "[scenario]\nseed = 3\n[sensor]\nroll_deg = 1.0\n[[wheel]]\nposition = 'FL'\nwheel = 0\n"
    simulation = simulate(parse_scenario(text, "test"), duration_s=8.0)
    setup = WheelSetup("FL", 0, 0, 0.32, load_n=5000.0, pressure_pa=210e3)
    results = results_of(simulation.chunks("link", 10**18), setup, ("ply-steer",))
    estimates = {estimate.name: estimate for estimate in results[-1].estimates}
    truth = simulation.truth["FL"].ply_steer(8.0)
    for name, value in zip(("peak", "first_half", "adhesion_line"), truth, strict=True):
        estimate = estimates[f"ply_steer_{name}_rad"]
        assert estimate.value == pytest.approx(value, abs=math.radians(0.01)), name
        assert abs(estimate.value - value) < 4.0 * estimate.std, name


def test_fully_sliding_tread_is_simulated() -> None:
    measured = run("slip_angle_deg = 12.0")
    assert np.isfinite(measured).all()


PATTERN = "[wheel.tread_pitch]\namplitude_percent = 5.0\nblocks = 60.0\nreach_rad = 0.2\nphase_deg = 40.0\n"


def wheel_of(wheel: str = "", sensor: str = "", tire: str = "", direction: str = "forward") -> WheelSimulator:
    text = (
        f'[motion]\ndirection = "{direction}"\n[sensor]\nnoise_mg_rthz = 0.0\nrange_g = 1000.0\n{sensor}\n'
        f'[tire]\n{tire}\n[[wheel]]\nposition = "W"\nwheel = 0\nphase_deg = -180.0\n{wheel}'
    )
    return WheelSimulator(wheel_plans(parse_scenario(text, "test"))[0], np.random.default_rng(1))


def read(wheel: WheelSimulator, until_s: float = 0.5) -> np.ndarray:
    return wheel.advance(until_s).counts * np.array(wheel.chain.scale_mps2)


def test_blocks_fill_the_contact_and_fade_beyond_it() -> None:
    theta = -math.pi + 2 * math.pi * np.arange(2048) / 2048
    wave = TreadPitch(0.05, blocks=70.0, reach_rad=0.1).radial(theta, -0.24, 0.22)
    inside = (theta > -0.24) & (theta < 0.22)
    assert np.sqrt(np.mean(wave[inside] ** 2)) == pytest.approx(0.05 / math.sqrt(2.0), rel=0.05)
    assert np.abs(wave[np.abs(theta) > 0.8]).max() < 1e-6
    at_reach = np.abs(theta - 0.32) < 0.05
    assert np.abs(wave[at_reach]).max() == pytest.approx(0.05 * math.exp(-0.5 * 0.5**2), rel=0.1)


@pytest.mark.parametrize(("direction", "sign"), [("forward", 1.0), ("reverse", -1.0)])
def test_scenario_tread_blocks_change_samples(direction: str, sign: float) -> None:
    wheel = wheel_of(PATTERN, direction=direction)
    added = read(wheel)[:, 2] - read(wheel_of(direction=direction))[:, 2]
    theta = np.mod(OMEGA * np.arange(len(added)) / 9600.0, 2 * math.pi) - math.pi
    edges = wheel.plan.table().edges_rad(5000.0, 2.1e5, OMEGA)
    expected = 0.32 * OMEGA**2 * TreadPitch(0.05, 60.0, 0.2, sign * math.radians(40.0)).radial(theta, *edges)
    assert added == pytest.approx(expected, abs=1.0)
    assert np.abs(added).max() > 40.0


def test_blocks_tilt_an_offset_sensor() -> None:
    sensor = "offset_mm = 5.0"
    along = read(wheel_of(PATTERN, sensor))[:, 0] - read(wheel_of("", sensor))[:, 0]
    assert np.abs(along).max() == pytest.approx(0.005 / 0.32 * 60.0 * 0.05 * 0.32 * OMEGA**2, rel=0.1)


def test_undeclared_ac_coupling_is_simulated() -> None:
    hidden = wheel_of(sensor='coupling = "ac"\nhighpass_hz = 2.0\ncoupling_declared = false')
    assert hidden.chain.coupling == Coupling.DC
    assert hidden.chain.highpass_hz == 0.0
    stated = wheel_of(sensor='coupling = "ac"\nhighpass_hz = 2.0')
    assert stated.chain.coupling == Coupling.AC
    coupled = read(hidden, 3.0)
    assert coupled == pytest.approx(read(stated, 3.0))
    assert abs(coupled[-4800:, 2].mean()) < 15.0


def test_inextensible_belt_closes_to_its_mean() -> None:
    radial = read(wheel_of(tire="extension_stiffness_mn = 20000.0"), 0.11138)[:, 2]
    per_turn = 2 * math.pi / OMEGA * 9600.0
    assert len(radial) == math.ceil(per_turn)
    mean = (radial.sum() - (len(radial) - per_turn) * radial[-1]) / per_turn
    assert mean == pytest.approx(0.32 * OMEGA**2, rel=5e-5)
