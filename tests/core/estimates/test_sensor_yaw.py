"""A sensor that is turned about its radial axis alone, as a hand glues it: roll and pitch are none."""

import math

import pytest

from gateway.core.estimates.disagreement import error_of
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.sensor_claims import HAND_MOUNTED_YAW_STD_RAD, Tilt
from gateway.core.estimates.wheel_setup import WheelSetup
from tests.testkit.simulated_wheel import last, simulated

SETUP = WheelSetup("FL", 0, 0, 0.32, radius_std_m=0.0032, load_n=5000.0, pressure_pa=210e3)
TABLES = """[sensor]
range_g = 2000
offset_mm = 4
yaw_deg = {yaw}
[motion]
speed_kmh = 90
[tire]
cord_angle_deg = 22
ply_separation_mm = 1.5
"""
ESTIMATORS = ("kinematic", "self-calibration", "ply-steer")


def results_at(yaw: float):
    return last(simulated(TABLES.format(yaw=yaw), 5.0, SETUP, ESTIMATORS)[0])


@pytest.fixture(scope="module")
def straight():
    return results_at(0.0)


@pytest.mark.parametrize("yaw", [3.0, 10.0, -20.0, 45.0])
def test_depth_and_ply_steer_of_a_turned_sensor_are_true_within_their_errors(straight, yaw: float) -> None:
    result = results_at(yaw)
    depth = result["sensor_offset_m"]
    assert depth.status is not Status.VALID or abs(depth.value - 0.004) < 3.5 * depth.std
    for name in ("ply_steer_contact_line_rad", "ply_steer_peak_rad", "ply_steer_adhesion_line_rad"):
        estimate = result[name]
        if estimate.status is Status.VALID:
            assert abs(estimate.value - straight[name].value) < 3.5 * estimate.std


def test_a_yaw_that_shows_is_the_error_whatever_roll_and_pitch_are() -> None:
    assert Tilt.of(0.0, 0.0, (0.35, 0.05)).yaw_std_rad == pytest.approx(math.hypot(0.35, 0.05))
    assert Tilt.of(0.0, 0.0, (0.05, 0.05)).yaw_std_rad == HAND_MOUNTED_YAW_STD_RAD
    assert Tilt.of(0.0, 0.0).yaw_std_rad == HAND_MOUNTED_YAW_STD_RAD
    assert Tilt.of(math.nan, math.nan).yaw_std_rad == HAND_MOUNTED_YAW_STD_RAD
    # A sensor that is askew about two axes may be so about the third.
    assert Tilt.of(0.1, 0.1).yaw_std_rad == pytest.approx(0.1)


def test_a_measured_error_replaces_what_was_expected_of_it() -> None:
    assert error_of(0.0, 0.1, 1.0) == pytest.approx(0.1, rel=0.01)
    assert error_of(0.0, 10.0, 1.0) == pytest.approx(1.0, rel=0.01)
    assert error_of(5.0, 0.1, 1.0) == pytest.approx(5.0, rel=0.01)
