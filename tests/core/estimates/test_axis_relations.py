"""Axes that are swapped, late or without their steady value, motion of the hub, and good ones that show none of it."""

import pytest

from gateway.core.estimates.estimator import Status
from gateway.core.estimates.lost_steady_value import SteadyValueCheck
from gateway.core.estimates.results import RevolutionResult, WheelSnapshot
from gateway.core.estimates.wheel_setup import WheelSetup
from gateway.core.reasons import Code
from gateway.core.ring_quantities import RING_NUMBERS, RING_RATIOS
from gateway.core.trust.reasons import TrustCode
from tests.testkit.simulated_wheel import last, restated, simulated

SETUP = WheelSetup(
    "FL", 0, 0, 0.32, radius_std_m=0.0032, load_n=5000.0, load_std_n=50.0, pressure_pa=210e3, pressure_std_pa=1e3
)
ESTIMATORS = ("kinematic", "self-calibration", "weak-form", "longitudinal-force", "ply-steer")
SECONDS = 5.0
SLOPES = ("ply_steer_peak_rad", "ply_steer_first_half_rad", "ply_steer_contact_line_rad")
OF_AXES = (TrustCode.AXES_SWAPPED, TrustCode.AXIS_LATE, TrustCode.GRAVITY_ABSENT)


def tables(speed_kmh: float | str, sensor: str = "", others: str = "") -> str:
    return (
        f"[motion]\nspeed_kmh = {speed_kmh}\n[tire]\ncord_angle_deg = 22\nply_separation_mm = 1.4\n"
        f"[sensor]\nrange_g = 1000\nrate_hz = 4800\noffset_mm = 2.0\n{sensor}\n{others}"
    )


def rolled(speed_kmh: float, **changes) -> tuple[tuple[RevolutionResult, ...], WheelSnapshot]:
    return restated(tables(speed_kmh), SECONDS, SETUP, ESTIMATORS, **changes)


def codes_of(snapshot: WheelSnapshot) -> list[Code]:
    return [flag.reason.code for flag in snapshot.flags if flag.reason.code in OF_AXES]


@pytest.mark.parametrize("speed_kmh", [40.0, 65.0, 120.0])
def test_axes_in_order_and_in_time_raise_nothing(speed_kmh: float) -> None:
    results, snapshot = rolled(speed_kmh)
    assert codes_of(snapshot) == []
    result = last(results)
    assert result["ply_steer_contact_line_rad"].status is Status.VALID
    assert result["sensor_offset_m"].status is Status.VALID


def test_first_revolution_of_a_car_that_accelerates_does_not_make_an_axis_late() -> None:
    """Its acceleration is not measured, and turns the gravity that the circumferential axis reads."""
    text = tables("[[0, 25], [4, 75]]").replace("offset_mm = 2.0", "offset_mm = 0.0")
    results, _ = simulated(text, 2.0, SETUP, ESTIMATORS)
    assert [result.revolution.assumed_steady for result in results[:3]] == [True, False, False]
    doubts = {
        reason["why"].code
        for result in results
        for reason in last((result,))["pitch_tilt_rad"].reasons
        if reason.code is TrustCode.MAY_CHANGE_BY
    }
    assert TrustCode.AXIS_LATE not in doubts


@pytest.mark.parametrize("speed_kmh", [40.0, 120.0])
def test_swapped_axes_are_seen_at_every_speed(speed_kmh: float) -> None:
    results, snapshot = rolled(speed_kmh, channels=(1, 0, 2))
    assert TrustCode.AXES_SWAPPED in codes_of(snapshot)
    result = last(results)
    for name in (*SLOPES, "pitch_tilt_rad", "sensor_offset_m"):
        assert result[name].status is Status.INVALID, name
    assert result["speed_mps"].status is Status.VALID
    # The axis along the belt is there, under another name.
    conditions = results[-1].conditions
    assert conditions.sensor_offset_m == pytest.approx(2e-3, abs=1e-4)


@pytest.mark.parametrize("samples", [5, 12])
@pytest.mark.parametrize("speed_kmh", [65.0, 120.0])
def test_late_lateral_axis_has_no_slopes(speed_kmh: float, samples: int) -> None:
    results, snapshot = rolled(speed_kmh, late=(0, samples, 0))
    (reason,) = (flag.reason for flag in snapshot.flags if flag.reason.code is TrustCode.AXIS_LATE)
    assert reason["axis"] == "lateral"
    assert reason["late_s"] == pytest.approx(samples / 4800.0, rel=0.15)
    result = last(results)
    for name in SLOPES:
        # A small one beside its own error may stay, as not determined.
        assert result[name].status is not Status.VALID, name
    assert result["sensor_offset_m"].status is Status.VALID


@pytest.mark.parametrize("samples", [5, 12])
def test_late_circumferential_axis_gives_no_depth(samples: int) -> None:
    results, snapshot = rolled(65.0, late=(samples, 0, 0))
    (reason,) = (flag.reason for flag in snapshot.flags if flag.reason.code is TrustCode.AXIS_LATE)
    assert reason["axis"] == "circumferential"
    assert reason["late_s"] == pytest.approx(samples / 4800.0, rel=0.1)
    result = last(results)
    assert result["sensor_offset_m"].status is Status.INVALID
    assert result["pitch_tilt_rad"].status is Status.INVALID
    assert result["ply_steer_contact_line_rad"].status is Status.VALID


@pytest.mark.parametrize("amplitude_mps2", [1.0, 3.0])
def test_motion_of_the_hub_is_in_the_errors(amplitude_mps2: float) -> None:
    hub = f"[vibration]\nimbalance_mps2 = {amplitude_mps2}"
    still, _ = simulated(tables(65.0), SECONDS, SETUP, ESTIMATORS)
    moved, truth = simulated(tables(65.0, others=hub), SECONDS, SETUP, ESTIMATORS)
    conditions = moved[-1].conditions
    assert conditions.hub_mps2 == pytest.approx(0.5 * amplitude_mps2, rel=0.2)
    assert still[-1].conditions.hub_mps2 < 0.12
    numbers, result, before = truth.numbers(1.0), last(moved), last(still)
    for name in ("Bs/Cw", "Rs/Cw", "Ts/Cw"):
        true = getattr(numbers, name[:2]) / numbers.Cw
        assert abs(result[name].value - true) < 3.0 * result[name].std, name
        assert result[name].std > before[name].std, name
    assert abs(result["longitudinal_force_n"].value) < 3.0 * result["longitudinal_force_n"].std


@pytest.mark.parametrize(("along_g", "lateral_g"), [(0.0, 1.0), (0.0, 2.0), (1.8, 0.6)])
def test_zero_of_the_lateral_axis_is_in_the_error_of_the_roll(along_g: float, lateral_g: float) -> None:
    """The shape of the lateral axis shows a large one; else another axis says that the statement does not hold."""
    results, _ = simulated(tables(65.0, f"zero_g_offset_g = [{along_g}, {lateral_g}, 0.0]"), SECONDS, SETUP, ESTIMATORS)
    roll = last(results)["sensor_roll_rad"]
    assert abs(roll.value) > 0.009 * min(lateral_g, 1.0)
    assert abs(roll.value) < 2.0 * roll.std


@pytest.mark.parametrize(("roll", "pitch", "yaw"), [(0.0, 10.0, 10.0), (10.0, 10.0, -10.0), (6.0, -6.0, 6.0)])
def test_yaw_of_a_tilted_sensor_is_in_the_error_of_its_depth(roll: float, pitch: float, yaw: float) -> None:
    askew = tables(65.0, f"roll_deg = {roll}\npitch_deg = {pitch}\nyaw_deg = {yaw}")
    depth = last(restated(askew, SECONDS, SETUP, ESTIMATORS)[0])["sensor_offset_m"]
    sure = last(rolled(65.0)[0])["sensor_offset_m"]
    assert depth.status is Status.VALID
    assert abs(sure.value - 2e-3) < 3.0 * sure.std < 2.5e-4
    assert abs(depth.value - 2e-3) > 2.5 * sure.std
    assert abs(depth.value - 2e-3) < 3.0 * depth.std


STATED_SETUP = WheelSetup("FL", 0, 0, 0.32, radius_std_m=0.0032, load_n=5000.0, pressure_pa=210e3)
STEADY_ESTIMATORS = ("kinematic", "weak-form", "ply-steer", "self-calibration")
AC = '[sensor]\nrange_g = 1000\ncoupling = "ac"\ncoupling_declared = false\n'
TIMES = (
    "speed_mps",
    "angular_speed_radps",
    "leading_edge_rad",
    "trailing_edge_rad",
    "contact_length_m",
    "contact_fraction",
)


@pytest.mark.parametrize("corner_hz", [0.1, 1.0, 5.0])
@pytest.mark.parametrize("axes", ["", 'axes = ["radial"]\n'])
def test_undeclared_ac_coupling_leaves_times_only(corner_hz: float, axes: str) -> None:
    tables = f"{AC}{axes}highpass_hz = {corner_hz}"
    results, _ = simulated(tables, 4.0, STATED_SETUP, STEADY_ESTIMATORS)
    for result in results:
        of = {estimate.name: estimate for estimate in result.estimates}
        assert all(of[name].status is Status.INVALID for name in (*RING_NUMBERS, *RING_RATIOS, "gain"))
        assert abs(of["speed_mps"].value - 65.0 / 3.6) < 3.0 * of["speed_mps"].std
    actual = last(results)
    assert {name for name, estimate in actual.items() if estimate.status is Status.VALID} == {*TIMES, "rotation_rpm"}
    (why,) = actual["Cw"].reasons
    assert why.code is TrustCode.NOTHING_FOLLOWS
    assert why["why"].code is TrustCode.COUPLING_CONTRADICTED
    assert why["why"]["share"] == pytest.approx(0.0, abs=0.1)


def test_undeclared_ac_coupling_is_the_only_alarm() -> None:
    _, snapshot = restated(AC + "highpass_hz = 1", 4.0, STATED_SETUP, STEADY_ESTIMATORS)
    assert [flag.name for flag in snapshot.flags] == ["coupling"]


@pytest.mark.parametrize(
    ("tables", "count"),
    [
        *(
            (
                "[sensor]\nrange_g = 1000\nzero_g_offset_g = [0, 0, -0.3]\ngain_error_percent = [0, 0, 3]\n"
                f"[motion]\nspeed_kmh = {motion}",
                10,
            )
            for motion in ("[[0, 0], [1, 0], [4, 60], [6, 60]]", "[[0, 90], [2, 90], [5, 10], [6, 10]]", "20")
        ),
        ("[sensor]\nrange_g = 2000\n[motion]\nspeed_kmh = 60\n[road]\nprofile = 'E'", 20),
    ],
    ids=["driving off", "braking", "slow", "rough road"],
)
def test_offset_within_its_tolerance_and_rough_road_are_no_coupling(tables: str, count: int) -> None:
    results, _ = simulated(tables, 6.0, STATED_SETUP, STEADY_ESTIMATORS)
    assert len(results) > count
    codes = {
        inner.code for result in results for e in result.estimates for r in e.reasons for outer in r for inner in outer
    }
    assert TrustCode.COUPLING_CONTRADICTED not in codes


def _lost(shares: list[float], steady_mps2: float = 1000.0) -> list[bool]:
    check = SteadyValueCheck()
    results = []
    for share in shares:
        check._take(share * steady_mps2, (share - 1.0) * steady_mps2, steady_mps2)
        results.append(check._is_lost)
    return results


def test_decaying_steady_value_is_lost() -> None:
    """A high-pass that starts from rest passes the steady value at first."""
    lost = _lost([0.9**turn for turn in range(12)])
    assert not lost[0]
    assert all(lost[6:])


def test_one_rough_revolution_loses_nothing() -> None:
    assert not any(_lost([1.0, 1.1, 0.9, 0.4, 1.0, 0.3, 0.9, 1.0]))


def test_steady_value_counts_again_after_many_revolutions() -> None:
    lost = _lost([0.0, 0.0, *[1.0] * 20])
    assert lost[10]
    assert not lost[-1]


def test_small_loss_may_be_a_zero_offset() -> None:
    assert not any(_lost([0.0] * 5, steady_mps2=50.0))
