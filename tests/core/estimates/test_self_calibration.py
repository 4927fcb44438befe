"""Self-calibration of simulated sensors with known errors, through the whole pipeline."""

import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.constants import STANDARD_GRAVITY_MPS2
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.revolution_block import extended
from gateway.core.estimates.wheel_setup import SensorClaims, WheelSetup
from gateway.core.reasons import Reason, codes_of
from gateway.core.revolutions.synchronous_average import RunningAverage
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.refuted_sums import Equations, speed_errors
from gateway.core.trust.self_calibration import SelfCalibrationEstimator
from tests.testkit.simulated_wheel import last, simulated

SETUP = WheelSetup("FL", 0, 0, 0.32)
ESTIMATORS = ("kinematic", "self-calibration")
FAULTY = """[sensor]
range_g = 1000
gain_error_percent = [0, 0, 1.5]
zero_g_offset_g = [0.3, -0.2, 0.4]
offset_mm = 5
roll_deg = 2
pitch_deg = -1.5
"""
TWO_SPEEDS = FAULTY + "[motion]\nspeed_kmh = [[0, 40], [20, 100]]"
# The radial axis is reduced by the cosines of both tilts.
TRUE_GAIN = 1.015 * math.cos(math.radians(2)) * math.cos(math.radians(1.5))


def within(estimate, truth: float, errors: float = 3.0) -> bool:
    return abs(estimate.value - truth) < errors * estimate.std


def test_two_speeds_separate_gain_and_offset() -> None:
    result = last(simulated(TWO_SPEEDS, 20.0, SETUP, ESTIMATORS)[0])
    gain, offset = result["gain"], result["zero_g_offset_mps2"]
    assert gain.status is Status.VALID
    assert within(gain, TRUE_GAIN)
    assert gain.std < 5e-4
    assert offset.status is Status.VALID
    assert within(offset, 0.4 * STANDARD_GRAVITY_MPS2)
    assert offset.std < 0.2


def test_tilts_and_mounting_offset_are_recovered() -> None:
    result = last(simulated(TWO_SPEEDS, 20.0, SETUP, ESTIMATORS)[0])
    assert within(result["roll_tilt_rad"], math.radians(2))
    # The gain of the lateral axis scales it, and a yaw turns a part of the pitch into it.
    assert math.radians(0.03) < result["roll_tilt_rad"].std < math.radians(0.15)
    assert within(result["pitch_tilt_rad"], math.radians(-1.5))
    assert result["pitch_tilt_rad"].std < math.radians(0.05)
    assert within(result["sensor_offset_m"], 0.005)
    assert result["sensor_offset_m"].std < 0.0002


def test_one_speed_leaves_gain_provisional() -> None:
    result = last(simulated(FAULTY, 12.0, SETUP, ESTIMATORS)[0])
    assert result["zero_g_offset_mps2"].status is Status.INVALID
    assert codes_of(result["zero_g_offset_mps2"].reasons) == (TrustCode.NEEDS_TWO_SPEEDS,)
    assert result["gain"].status is Status.PROVISIONAL
    assert codes_of(result["gain"].reasons) == (TrustCode.NEEDS_TWO_SPEEDS,)
    assert within(result["gain"], TRUE_GAIN)
    assert 0.002 < result["gain"].std < 0.012
    assert result["roll_tilt_rad"].status is Status.PROVISIONAL
    assert within(result["roll_tilt_rad"], math.radians(2))
    assert result["gain_per_degc"].status is Status.INVALID


def test_gain_follows_temperature() -> None:
    tables = (
        "[sensor]\nrange_g = 1000\ngain_drift_percent_per_k = 0.04\n[motion]\nspeed_kmh = [[0, 40], [10, 90], [30, 50]]"
    )
    results, _ = simulated(tables, 30.0, SETUP, ESTIMATORS, "temperature_degc = [[0, 20], [30, 60]]")
    result = last(results)
    assert result["gain_per_degc"].status is Status.VALID
    assert result["gain_per_degc"].value == pytest.approx(4e-4, abs=max(5e-5, 3 * result["gain_per_degc"].std))
    # The simulated gain holds at the reference temperature, 25 degC.
    assert result["gain"].value == pytest.approx(1.0 + 4e-4 * 35.0, abs=1e-3)


def test_ac_coupling_leaves_only_the_gain() -> None:
    tables = FAULTY + "coupling = 'ac'\nhighpass_hz = 0.05"
    setup = WheelSetup("FL", 0, 0, 0.32, sensor=SensorClaims(offset_m=0.005))
    result = last(simulated(tables, 16.0, setup, ESTIMATORS)[0])
    for name in ("zero_g_offset_mps2", "roll_tilt_rad", "gain_per_degc"):
        assert result[name].status is Status.INVALID
        assert codes_of(result[name].reasons) == (TrustCode.AC_COUPLED,)
    assert result["gain"].status is Status.PROVISIONAL
    assert within(result["gain"], TRUE_GAIN, 2.0)
    assert within(result["pitch_tilt_rad"], math.radians(-1.5))
    assert within(result["sensor_offset_m"], 0.005)


def test_saturated_signal_is_rejected() -> None:
    result = last(simulated("[sensor]\nrange_g = 132", 8.0, SETUP, ESTIMATORS)[0])
    for name in ("gain", "pitch_tilt_rad", "sensor_offset_m", "roll_tilt_rad"):
        assert result[name].status is Status.INVALID
        assert EstimateCode.RADIAL_SATURATED in codes_of(result[name].reasons)


def test_radial_axis_alone_gives_the_gain() -> None:
    result = last(simulated("[sensor]\naxes = ['radial']", 8.0, SETUP, ESTIMATORS)[0])
    assert within(result["gain"], 1.0)
    assert result["sensor_offset_m"].reasons == (Reason(TrustCode.AXIS_MISSING, axis="circumferential"),)
    assert result["roll_tilt_rad"].reasons == (Reason(TrustCode.AXIS_MISSING, axis="lateral"),)


def test_first_revolution_does_not_deny_an_axis_that_the_sensor_has() -> None:
    first = last(simulated(FAULTY, 3.0, SETUP, ESTIMATORS)[0][:1])
    for name in ("pitch_tilt_rad", "sensor_offset_m"):
        assert first[name].status is Status.INVALID
        assert first[name].reasons == (Reason(TrustCode.NEEDS_REVOLUTIONS, needed=2.0, count=1.0),)


def test_wrong_stated_offset_is_reported() -> None:
    setup = WheelSetup("FL", 0, 0, 0.32, sensor=SensorClaims(offset_m=0.001))
    result = last(simulated(FAULTY, 12.0, setup, ESTIMATORS)[0])
    assert result["sensor_offset_m"].reasons == (Reason(TrustCode.OTHER_OFFSET_STATED, stated_m=0.001),)
    assert result["sensor_offset_m"].status is Status.VALID


def test_offset_known_no_better_than_a_contradicting_statement_is_provisional() -> None:
    setup = WheelSetup("FL", 0, 0, 0.32, sensor=SensorClaims(offset_m=0.001, offset_std_m=1e-4))
    result = last(simulated(FAULTY, 12.0, setup, ESTIMATORS)[0])["sensor_offset_m"]
    assert result.status is Status.PROVISIONAL
    assert within(result, 0.005)


@pytest.mark.parametrize("offset_mm", [0.0, 5.0])
def test_reverse_rolling_gives_offset_and_pitch(offset_mm: float) -> None:
    tables = FAULTY.replace("offset_mm = 5", f"offset_mm = {offset_mm}") + "[motion]\ndirection = 'reverse'"
    results, _ = simulated(tables, 5.0, SETUP, ESTIMATORS)
    for result in (last(results[:10]), last(results)):
        offset = result["sensor_offset_m"]
        assert offset.status is Status.VALID
        assert codes_of(offset.reasons) == (TrustCode.AXIS_AGAINST_ROLLING,)
        assert within(offset, 1e-3 * offset_mm)
        assert within(result["pitch_tilt_rad"], math.radians(-1.5))


def test_change_of_direction_starts_calibration_again() -> None:
    results, _ = simulated(FAULTY, 12.0, SETUP, ESTIMATORS)
    estimator, average = SelfCalibrationEstimator(), RunningAverage()
    turned = np.array([[-1.0], [1.0], [1.0]])
    for number, result in enumerate(results[:60]):
        revolution = result.revolution
        if number >= 20:
            revolution = replace(revolution, axes_mps2=revolution.axes_mps2 * turned)
        actual = estimator.update(revolution, extended(average, revolution), result.conditions)
        offset = {estimate.name: estimate for estimate in actual}["sensor_offset_m"]
        assert (TrustCode.AXIS_AGAINST_ROLLING in codes_of(offset.reasons)) is (number >= 31)
    assert within(offset, 0.005)


@pytest.mark.parametrize("yaw_deg", [40.0, -40.0])
def test_yawed_axis_still_turns_in_gravity(yaw_deg: float) -> None:
    result = last(simulated(f"[sensor]\nyaw_deg = {yaw_deg}\n[motion]\nspeed_kmh = 50", 4.0, SETUP, ESTIMATORS)[0])
    assert result["sensor_offset_m"].status is Status.VALID


def test_axis_without_gravity_gives_no_offset() -> None:
    """A sensor that is turned by 90 deg has its circumferential and lateral axes swapped."""
    tables = "[sensor]\noffset_mm = 5\nyaw_deg = 90\n[motion]\nspeed_kmh = 50"
    results, _ = simulated(tables, 4.0, SETUP, (*ESTIMATORS, "ply-steer"))
    result = last(results)
    for name in ("sensor_offset_m", "pitch_tilt_rad"):
        assert codes_of(result[name].reasons) == (TrustCode.GRAVITY_ABSENT,)
        assert result[name].status is Status.INVALID
    assert result["ply_steer_peak_rad"].status is Status.INVALID
    assert TrustCode.MAY_CHANGE_BY in codes_of(result["ply_steer_peak_rad"].reasons)
    assert result["contact_length_m"].status is not Status.INVALID


def test_errors_cover_road_noise() -> None:
    tables = "[sensor]\noffset_mm = 8\nrange_g = 1000\n[road]\nrms_mps2 = 5\n[motion]\nspeed_kmh = [[0, 50], [16, 90]]"
    result = last(simulated(tables, 16.0, SETUP, ESTIMATORS)[0])
    assert within(result["gain"], 1.0, 4.0)
    assert within(result["sensor_offset_m"], 0.008)
    assert within(result["pitch_tilt_rad"], 0.0)


@pytest.mark.parametrize(
    ("steady_mps2", "least", "most"),
    [((1000.0, 1000.0), math.inf, math.inf), ((12_300.0, 12_700.0), 20.0, 50.0), ((700.0, 1600.0), 0.0, 0.2)],
)
def test_zero_offset_error_grows_as_speeds_approach(
    steady_mps2: tuple[float, float], least: float, most: float
) -> None:
    rows = np.array([[steady, 1.0] for steady in steady_mps2])
    (aa, ab), (_, bb) = (rows.T @ rows).tolist()
    assert least <= speed_errors(Equations(aa, ab, bb)).zero_mps2 <= most


@pytest.mark.parametrize(
    "speed_kmh",
    [
        "[[0, 65], [4, 65], [4.5, 130], [5, 130], [5.3, 65], [8, 65]]",
        "[[0, 80], [3, 80], [4.5, 0], [6, 0], [8, 60], [10, 60]]",
    ],
)
def test_means_of_a_wheel_that_spins_or_stops_give_no_zero_offset(speed_kmh: str) -> None:
    tables = f"[sensor]\nrange_g = 1000\n[motion]\nspeed_kmh = {speed_kmh}"
    for result in simulated(tables, 10.0, SETUP, ESTIMATORS)[0]:
        offset = {estimate.name: estimate for estimate in result.estimates}["zero_g_offset_mps2"]
        assert offset.status is not Status.VALID or within(offset, 0.0)


def test_errors_of_the_mounting_cover_a_sensor_that_comes_loose() -> None:
    results, _ = simulated("[sensor]\nrange_g = 1000\noffset_mm = 3", 12.0, SETUP, ESTIMATORS)
    first = results[40].revolution.index
    estimator, average = SelfCalibrationEstimator(), RunningAverage()
    for result in results:
        revolution = result.revolution
        # It tips forward and to the side, to 3 deg within 40 revolutions, and stays there.
        tilt_rad = math.radians(min(max(revolution.index - first, 0) / 40.0, 1.0) * 3.0)
        along, lateral, radial = revolution.axes_mps2
        axes = np.array([along + math.sin(tilt_rad) * radial, lateral + math.sin(tilt_rad) * radial, radial])
        tipped = replace(revolution, axes_mps2=axes)
        made = estimator.update(tipped, extended(average, tipped), result.conditions)
        estimates = {estimate.name: estimate for estimate in made}
        if revolution.index > first + 15:
            assert within(estimates["pitch_tilt_rad"], tilt_rad)
            assert within(estimates["roll_tilt_rad"], tilt_rad)
    assert estimates["pitch_tilt_rad"].std < math.radians(3.0)
