"""Simulated wheels of a vehicle that turns: speeds of left and right wheels, and what the sensor reads."""

import math
from itertools import islice

import numpy as np
import pytest

from gateway.core.errors import ConfigError
from gateway.simulator.motion import MotionProfile
from gateway.simulator.path import speed_beside, yaw_over_time
from gateway.simulator.receiver import EARTH_RADIUS_M, SimulatedReceiver
from gateway.simulator.scenario import parse_scenario
from gateway.simulator.sensor import SensorChain
from gateway.simulator.simulated_wheel import WheelSimulator
from gateway.simulator.time_series import Series, constant
from gateway.simulator.wheel_plan import WheelPlan, wheel_plans

SCENARIO = """
[sensor]
noise_mg_rthz = 0.0
[[wheel]]
position = "L"
wheel = 0
phase_deg = 0.0
[[wheel]]
position = "R"
wheel = 1
side = "right"
phase_deg = 0.0
[motion]
speed_kmh = 54.0
"""


def plans(motion: str = "") -> tuple[WheelPlan, ...]:
    return wheel_plans(parse_scenario(SCENARIO + motion, "test"))


def read(plan: WheelPlan, seconds: float = 0.4) -> np.ndarray:
    """Return the samples of a wheel in raw counts, (n, 3)."""
    return WheelSimulator(plan, np.random.default_rng(1)).advance(seconds).counts.astype(float)


def test_outer_wheels_of_a_curve_are_faster_by_yaw_rate_times_track() -> None:
    inner, outer = plans("yaw_rate_degps = 12.0\ntrack_m = 1.6")
    speeds = [float(plan.motion.at(np.array([3.0])).speed_mps[0]) for plan in (inner, outer)]
    assert speeds[1] - speeds[0] == pytest.approx(math.radians(12.0) * 1.6)
    assert sum(speeds) / 2.0 == pytest.approx(15.0)
    back = plans('yaw_rate_degps = 12.0\ntrack_m = 1.6\ndirection = "reverse"')
    assert float(back[0].motion.at(np.array([3.0])).speed_mps[0]) == pytest.approx(speeds[1])


def test_curvature_over_distance_is_a_yaw_rate_over_time() -> None:
    curvature = Series(((0.0, 0.0), (100.0, 0.0), (150.0, 0.02), (300.0, 0.02)))
    yaw = yaw_over_time(Series(((0.0, 36.0), (10.0, 72.0))), curvature)
    # 10 m/s and 1 m/s^2: after 8 s 112 m at 18 m/s, and for good 20 m/s in a curve of 50 m.
    assert yaw.at(8.0) == pytest.approx(18.0 * 0.02 * 12.0 / 50.0, rel=1e-3)
    assert yaw.at(1000.0) == pytest.approx(0.4, rel=1e-6)
    assert yaw_over_time(constant(50.0), constant(0.0)).is_constant
    assert speed_beside(constant(36.0), yaw, 0.5).values[-1] == pytest.approx(36.0 - 3.6 * 0.2, rel=1e-6)


def test_lateral_axis_reads_coriolis_and_centripetal_acceleration() -> None:
    straight, turning = (
        read(plans(motion)[0])[:, 1] for motion in ("track_m = 0.0", "yaw_rate_degps = 20\ntrack_m = 0.0")
    )
    plan = plans()[0]
    scale = SensorChain(plan.sensor, np.random.default_rng(0), plan.defect).scale_mps2[1]
    added = (turning - straight) * scale
    speed, yaw = 15.0, math.radians(20.0)
    time_s = np.arange(len(added)) / plan.sample_rate_hz
    whole = time_s < 6 * math.tau * plan.radius_m / speed
    angle = speed / plan.radius_m * time_s[whole]
    assert added[whole].mean() == pytest.approx(speed * yaw, rel=0.02)
    assert 2.0 * (added[whole] * np.cos(angle)).mean() == pytest.approx(-2.0 * speed * yaw, rel=0.03)
    assert 2.0 * (added[whole] * np.sin(angle)).mean() == pytest.approx(0.0, abs=0.02 * speed * yaw)


def test_lateral_axis_reads_the_angular_acceleration_of_a_turn() -> None:
    straight, turning = (
        read(plans(motion)[0])[:, 1]
        for motion in ("track_m = 0.0", "yaw_rate_degps = [[0, -30], [0.4, 30]]\ntrack_m = 0.0")
    )
    plan = plans()[0]
    added = (turning - straight) * SensorChain(plan.sensor, np.random.default_rng(0), plan.defect).scale_mps2[1]
    time_s = np.arange(len(added)) / plan.sample_rate_hz
    angle = 15.0 / plan.radius_m * time_s
    turns = np.column_stack([time_s, np.ones(len(added))])
    rows = np.column_stack([turns, turns * np.cos(angle)[:, np.newaxis], np.sin(angle)])
    expected_mps2 = -plan.radius_m * math.radians(150.0)
    assert np.linalg.lstsq(rows, added, rcond=None)[0][-1] == pytest.approx(expected_mps2, rel=0.1)


@pytest.mark.parametrize("yaw_degps", [20.0, -20.0])
def test_slip_heads_into_the_curve(yaw_degps: float) -> None:
    slip = f"slip_angle_deg = {math.copysign(5.0, yaw_degps)}"
    steered = SCENARIO.replace("phase_deg = 0.0", f"phase_deg = 0.0\n{slip}", 1)
    straight, turning = (
        read(wheel_plans(parse_scenario(steered + motion, "test"))[0])[:, 0]
        for motion in ("track_m = 0.0", f"yaw_rate_degps = {yaw_degps}\ntrack_m = 0.0")
    )
    plan = plans()[0]
    scale = SensorChain(plan.sensor, np.random.default_rng(0), plan.defect).scale_mps2[0]
    added = (turning - straight) * scale
    time_s = np.arange(len(added)) / plan.sample_rate_hz
    whole = time_s < 3 * math.tau * plan.radius_m / 15.0
    angle = 15.0 / plan.radius_m * time_s[whole]
    forward = 15.0 * math.radians(20.0) * math.sin(math.radians(5.0))
    assert -2.0 * (added[whole] * np.cos(angle)).mean() == pytest.approx(forward, rel=0.05)


def test_grade_and_bank_turn_gravity() -> None:
    level, sloping = (read(plans(motion)[0]) for motion in ("", "grade_deg = 10.0\nbank_deg = 4.0"))
    plan = plans()[0]
    scale = np.array(SensorChain(plan.sensor, np.random.default_rng(0), plan.defect).scale_mps2)
    added = (sloping - level) * scale
    time_s = np.arange(len(added)) / plan.sample_rate_hz
    whole = time_s < 6 * math.tau * plan.radius_m / 15.0
    angle = 15.0 / plan.radius_m * time_s[whole]
    forward, leftward = 9.80665 * math.sin(math.radians(10.0)), 9.80665 * math.sin(math.radians(4.0))
    assert added[whole, 1].mean() == pytest.approx(leftward, rel=0.03)
    # Uphill the sensor reads forward; at the contact it travels backward.
    assert 2.0 * (added[whole, 0] * np.cos(angle)).mean() == pytest.approx(-forward, rel=0.1)
    assert 2.0 * (added[whole, 2] * np.sin(angle)).mean() == pytest.approx(forward, rel=0.1)


@pytest.mark.parametrize("motion", ["yaw_rate_degps = 5.0\nrepeat = true", "yaw_rate_degps = 5.0\ncurvature_pkm = 1.0"])
def test_paths_that_nobody_can_follow_are_refused(motion: str) -> None:
    with pytest.raises(ConfigError, match=r"motion\.(yaw_rate|curvature)"):
        plans(motion)


def test_receiver_follows_the_path() -> None:
    # A quarter circle of 100 m to the left, at 10 m/s.
    yaw = Series(((0.0, 0.1), (5.0 * math.pi, 0.1), (5.0 * math.pi + 1e-6, 0.0)))
    mounted = SimulatedReceiver(MotionProfile(constant(36.0)), 2.0, np.random.default_rng(1), yaw)
    lines = [sentences.data.decode().split(",") for sentences in islice(mounted.sentences(10**18), 0, 33)]
    north, east = (
        [
            math.radians(int(line[column][: 2 + column // 5]) + float(line[column][2 + column // 5 :]) / 60.0)
            for line in lines
        ]
        for column in (3, 5)
    )
    moved = np.array([north[-1] - north[0], (east[-1] - east[0]) * math.cos(north[0])]) * EARTH_RADIUS_M
    assert moved == pytest.approx([100.0, -100.0 - 10.0 * (16.0 - 5.0 * math.pi)], abs=8.0)
    assert (float(lines[0][8]), float(lines[-1][8])) == pytest.approx((0.0, 270.0), abs=0.3)
