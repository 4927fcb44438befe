"""Sensors that are AC-coupled although DC coupling is stated, and good ones that must not be taken for it."""

import pytest

from gateway.estimators.estimator import Status
from gateway.estimators.lost_steady_value import SteadyValueCheck
from gateway.pipeline.wheel_setup import WheelSetup
from gateway.quantity_catalogue import RING_NUMBERS, RING_RATIOS
from gateway.reasons import Code
from tests.testkit.simulated_wheel import last, restated, simulated

SETUP = WheelSetup("FL", 0, 0, 0.32, radius_std_m=0.0032, load_n=5000.0, pressure_pa=210e3)
ESTIMATORS = ("kinematic", "weak-form", "ply-steer", "self-calibration")
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
    results, _ = simulated(tables, 4.0, SETUP, ESTIMATORS)
    for result in results:
        of = {estimate.name: estimate for estimate in result.estimates}
        assert all(of[name].status is Status.INVALID for name in (*RING_NUMBERS, *RING_RATIOS, "gain"))
        assert abs(of["speed_mps"].value - 65.0 / 3.6) < 3.0 * of["speed_mps"].std
    actual = last(results)
    assert {name for name, estimate in actual.items() if estimate.status is Status.VALID} == {*TIMES, "rotation_rpm"}
    (why,) = actual["Cw"].reasons
    assert why.code is Code.NOTHING_FOLLOWS
    assert why["why"].code is Code.COUPLING_CONTRADICTED
    assert why["why"]["share"] == pytest.approx(0.0, abs=0.1)


def test_undeclared_ac_coupling_is_the_only_alarm() -> None:
    _, snapshot = restated(AC + "highpass_hz = 1", 4.0, SETUP, ESTIMATORS)
    assert [flag.name for flag in snapshot.flags] == ["coupling"]


@pytest.mark.parametrize("motion", ["[[0, 0], [1, 0], [4, 60], [6, 60]]", "[[0, 90], [2, 90], [5, 10], [6, 10]]", "20"])
def test_offset_within_its_tolerance_is_no_coupling(motion: str) -> None:
    tables = (
        "[sensor]\nrange_g = 1000\nzero_g_offset_g = [0, 0, -0.3]\ngain_error_percent = [0, 0, 3]\n"
        f"[motion]\nspeed_kmh = {motion}"
    )
    results, _ = simulated(tables, 6.0, SETUP, ESTIMATORS)
    assert len(results) > 10
    codes = {
        inner.code for result in results for e in result.estimates for r in e.reasons for outer in r for inner in outer
    }
    assert Code.COUPLING_CONTRADICTED not in codes


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


def test_rough_road_is_no_coupling() -> None:
    results, _ = simulated(
        "[sensor]\nrange_g = 2000\n[motion]\nspeed_kmh = 60\n[road]\nprofile = 'E'", 6.0, SETUP, ESTIMATORS
    )
    assert len(results) > 20
    codes = {inner.code for result in results for e in result.estimates for r in e.reasons for o in r for inner in o}
    assert Code.COUPLING_CONTRADICTED not in codes


def test_small_loss_may_be_a_zero_offset() -> None:
    assert not any(_lost([0.0] * 5, steady_mps2=50.0))
