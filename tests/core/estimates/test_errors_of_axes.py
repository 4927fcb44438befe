"""Gain, zero and linearity belong to each axis: they have errors as in a data sheet, and a statement each."""

import pytest

from gateway.core.config.vehicle import parse_vehicle
from gateway.core.estimates.estimator import Status
from gateway.core.ring_quantities import RING_NUMBERS, RING_RATIOS
from tests.testkit.simulated_wheel import last, simulated

VEHICLE = """[tire]
radius_mm = 320
radius_std_mm = 1
pressure_kpa = 210
pressure_std_kpa = 1
[[wheel]]
position = "FL"
hub = 0
wheel = 0
load_n = 5000
load_std_n = 50
[wheel.sensor]
{sensor}
"""
SIGNAL = """[sensor]
range_g = 2000
offset_mm = 4
gain_error_percent = [{gains}]
[motion]
speed_kmh = 70
[tire]
cord_angle_deg = 22
ply_separation_mm = 1.5
"""
ESTIMATORS = ("kinematic", "self-calibration", "ply-steer")
LINE = "ply_steer_contact_line_rad"


def setup_of(sensor: str = ""):
    return parse_vehicle(VEHICLE.format(sensor=sensor), "").wheel_setups()[0]


def result_of(gains: str, sensor: str = ""):
    return last(simulated(SIGNAL.format(gains=gains), 5.0, setup_of(sensor), ESTIMATORS)[0])


def test_each_axis_has_the_error_of_a_data_sheet_or_its_own() -> None:
    claims = setup_of().sensor
    assert (claims.gain_std, claims.along_gain_std, claims.lateral_gain_std) == pytest.approx((0.015, 0.06, 0.06))
    assert (claims.nonlinearity_std, claims.lateral_zero_mps2) == pytest.approx((0.005, 1.0))
    stated = setup_of(
        "lateral_gain_std_percent = 1\ncircumferential_gain_std_percent = 2\nnonlinearity_std_percent = 0.1\n"
        "zero_g_std_mps2 = 2\nlateral_zero_g_std_mps2 = 3"
    ).sensor
    assert (stated.gain_std, stated.along_gain_std, stated.lateral_gain_std) == pytest.approx((0.015, 0.02, 0.01))
    assert (stated.nonlinearity_std, stated.zero_g_std_mps2, stated.lateral_zero_mps2) == pytest.approx((1e-3, 2, 3))


def test_a_lateral_gain_as_in_a_data_sheet_leaves_ply_steer_true_within_its_error() -> None:
    true, estimate = result_of("0, 0, 0")[LINE], result_of("0, -15, 0")[LINE]
    assert estimate.value == pytest.approx(0.85 * true.value, rel=0.03)
    assert abs(estimate.value - true.value) < 3.5 * estimate.std
    stated = result_of("0, 0, 0", "lateral_gain_std_percent = 0.1")[LINE]
    assert stated.std < 0.8 * true.std


@pytest.mark.parametrize("gain", [-10, 10])
def test_a_gain_along_the_belt_shows_in_gravity_and_is_in_the_error_of_the_depth(gain: int) -> None:
    depth = result_of(f"{gain}, 0, 0")["sensor_offset_m"]
    assert depth.status is Status.VALID
    assert abs(depth.value - 0.004) > 2e-4
    assert abs(depth.value - 0.004) < 2.0 * depth.std


def test_nonlinearity_widens_the_numbers_where_much_of_the_range_is_used() -> None:
    def stds(range_g: int, sensor: str = "") -> dict[str, float]:
        tables = f"[sensor]\nrange_g = {range_g}\n[motion]\nspeed_kmh = 100"
        result = last(simulated(tables, 4.0, setup_of(sensor), ("kinematic", "weak-form"))[0])
        return {name: result[name].std / abs(result[name].value) for name in (*RING_NUMBERS, *RING_RATIOS)}

    narrow, wide = stds(450), stds(4000)
    linear = stds(450, "nonlinearity_std_percent = 0")
    assert narrow["Ts/Cw"] > 1.2 * wide["Ts/Cw"]
    assert linear["Ts/Cw"] < 1.02 * wide["Ts/Cw"]
