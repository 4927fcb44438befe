"""Turn rates of wheels against each other, the track and what is no wheel: signs, gains, and wheels elsewhere."""

from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import treadlink
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import RevolutionResult
from gateway.core.reasons import Code
from gateway.core.trust.reasons import TrustCode
from gateway.core.trust.turn_verdict import Witness
from gateway.core.trust.wheel_pairs import WheelPairs
from gateway.forces.curve_gain import CurveGain, Rate
from gateway.forces.reasons import ForceCode
from gateway.forces.shared_turn import SharedTurn
from tests.testkit.commands import run
from tests.testkit.curving_car import TRACK_M, results

TRACKS = dict.fromkeys(("FL", "FR"), (TRACK_M, 0.03))
PLY_STEER = "ply_steer_contact_line_rad"


def compared(
    *wheels: Iterable[RevolutionResult], tracks: dict[str, tuple[float, float]] | None = None
) -> tuple[WheelPairs, dict[str, dict[str, Estimate]]]:
    """Return the comparison, and the estimates of the last revolution of each wheel."""
    pairs = WheelPairs(turns=SharedTurn(tracks or {}))
    last = {
        result.position: {each.name: each for each in result.estimates}
        for result, _ in pairs.compared([result for wheel in wheels for result in wheel])
    }
    return pairs, last


def alarms(pairs: WheelPairs) -> set[tuple[str, Code]]:
    return {(alarm.position, alarm.reason.code) for alarm in pairs.alarms()}


def test_track_width_refutes_a_gain_that_both_wheels_share() -> None:
    truth = compared(results("FL"), results("FR"))[1]["FL"][PLY_STEER]
    pairs, before = compared(results("FL", 0.5), results("FR", 0.5))
    # Without the track the ply steer is valid and false by its share.
    assert alarms(pairs) == set()
    assert before["FL"][PLY_STEER].status is Status.VALID
    assert before["FL"][PLY_STEER].value == pytest.approx(0.5 * truth.value, rel=0.03)
    finding = pairs.axis("FL")
    assert (finding.sign, finding.gain_by) == (1, None)
    assert finding.track_m.value == pytest.approx(TRACK_M / 0.5, abs=2.5 * finding.track_m.std)
    pairs, after = compared(results("FL", 0.5), results("FR", 0.5), tracks=TRACKS)
    assert alarms(pairs) == {(wheel, ForceCode.LATERAL_GAIN_CONTRADICTED) for wheel in ("FL", "FR")}
    assert Status.VALID not in {after[wheel][PLY_STEER].status for wheel in ("FL", "FR")}
    finding = pairs.axis("FL")
    assert finding.gain.value == pytest.approx(0.5, abs=2.5 * finding.gain.std)


def test_default_estimators_verify_the_signs_of_a_car_that_turns(tmp_path: Path) -> None:
    run("simulate", "town", "--out", tmp_path / "town.mcap", "--duration", 30)
    with treadlink.open(tmp_path / "town.mcap") as recording:
        for position in recording:
            estimates = recording[position].estimates()
            reasons = estimates["reasons"][estimates["name"] == PLY_STEER]
            assert "the sign is not verified" in reasons[9]
            assert "the sign is not verified" not in reasons[-1]


def test_few_curves_show_the_sign_but_no_track() -> None:
    wheels = [list(results(position)) for position in ("FL", "FR")]
    pairs, _ = compared(*(wheel[: len(wheel) // 3] for wheel in wheels))
    finding = pairs.axis("FL")
    assert finding.sign == 1
    assert np.isnan(finding.track_m.value)


def test_track_width_verifies_a_gain_as_stated() -> None:
    pairs, last = compared(results("FL"), results("FR"), tracks=TRACKS)
    assert alarms(pairs) == set()
    for wheel in ("FL", "FR"):
        finding = pairs.axis(wheel)
        assert (finding.sign, finding.gain_by) == (1, Witness.TRACK)
        assert finding.gain.value == pytest.approx(1.0, abs=2.5 * finding.gain.std)
        assert finding.gain.std < 0.13
    assert last["FL"][PLY_STEER].status is Status.VALID


def test_wheel_that_two_others_contradict_is_named_alone() -> None:
    pairs, last = compared(results("FL"), results("FR", 0.5), results("RL"))
    assert alarms(pairs) == {("FR", ForceCode.LATERAL_GAIN_CONTRADICTED)}
    assert pairs.axis("FR").contradictions[0].reason["witness"] == "wheels"
    assert last["FR"][PLY_STEER].status is not Status.VALID
    assert last["FL"][PLY_STEER].status is last["RL"][PLY_STEER].status is Status.VALID


def test_of_two_wheels_that_turn_apart_neither_is_named() -> None:
    pairs, last = compared(results("FL", 0.5), results("RL"))
    assert alarms(pairs) == {(wheel, ForceCode.WHEELS_TURN_APART) for wheel in ("FL", "RL")}
    assert Status.VALID not in {last[wheel][PLY_STEER].status for wheel in ("FL", "RL")}


def test_wheel_of_another_vehicle_is_named() -> None:
    elsewhere = [replace(result, position="RL") for result in results("FL", straight=True)]
    pairs, last = compared(results("FL"), results("FR"), elsewhere)
    assert alarms(pairs) == {("RL", ForceCode.TURNS_UNRELATED)}
    assert last["RL"][PLY_STEER].status is Status.INVALID
    assert last["FL"][PLY_STEER].status is Status.VALID


def swapped(first: str, second: str) -> list[list[RevolutionResult]]:
    """Return the wheels of a car of which two are stated at each other's place."""
    swaps = {first: second, second: first}
    wheels = {position: results(swaps.get(position, position)) for position in ("FL", "FR", "RL", "RR")}
    return [[replace(result, position=position) for result in taken] for position, taken in wheels.items()]


def test_left_and_right_wheel_that_are_swapped_are_named() -> None:
    pairs, last = compared(*swapped("FL", "FR"))
    assert alarms(pairs) == {(wheel, TrustCode.LATERAL_AXIS_REVERSED) for wheel in ("FL", "FR")}
    assert {last[wheel][PLY_STEER].status for wheel in ("FL", "FR")} == {Status.PROVISIONAL}
    assert last["RL"][PLY_STEER].status is last["RR"][PLY_STEER].status is Status.VALID


@pytest.mark.parametrize(("first", "second", "sign"), [("FL", "RL", 1), ("FL", "RR", 0)])
def test_wheels_of_one_body_that_are_swapped_otherwise_turn_alike(first: str, second: str, sign: int) -> None:
    pairs, _ = compared(*swapped(first, second))
    # A diagonal leaves no axle with a left and a right wheel, so that no sign is verified.
    assert {pairs.axis(position).sign for position in ("FL", "FR", "RL", "RR")} == {sign}
    assert alarms(pairs) == set()


@pytest.mark.parametrize("axis", [1, -1])
def test_sign_of_a_wheel_alone_on_its_axle_follows_from_the_others(axis: int) -> None:
    pairs, last = compared(results("FL"), results("FR"), results("RL", axis))
    assert pairs.axis("RL").sign == axis
    noted = {reason.code for reason in last["RL"][PLY_STEER].reasons}
    assert (TrustCode.LATERAL_SIGN_UNVERIFIED in noted) is (axis < 0)
    assert alarms(pairs) == ({("RL", TrustCode.TURNS_OPPOSITE)} if axis < 0 else set())


def test_one_wheel_straights_and_silent_wheels_say_nothing() -> None:
    assert alarms(compared(results("RL", -1))[0]) == set()
    left_wheel = results("FL", straight=True)
    straight = compared(left_wheel, [replace(result, position="FR") for result in left_wheel], tracks=TRACKS)[0]
    assert alarms(straight) == set()
    assert straight.axis("FL").gain_by is None
    silent = compared(results("FL"), results("FR", 0.5)[:100], results("RL"), tracks=TRACKS)[0]
    assert alarms(silent) == set()
    assert (silent.axis("FR").gain_by, silent.axis("RL").gain_by) == (None, None)


@pytest.mark.parametrize("gain", [1.0, 0.5])
def test_lost_revolutions_change_no_verdict(gain: float) -> None:
    rng = np.random.default_rng(3)
    wheels = [
        [result for result in results(wheel, axis) if rng.random() > 0.2]
        for wheel, axis in (("FL", 1.0), ("FR", gain), ("RL", 1.0))
    ]
    expected = {("FR", ForceCode.LATERAL_GAIN_CONTRADICTED)} if gain < 1.0 else set()
    assert alarms(compared(*wheels)[0]) == expected


def test_order_of_the_wheels_does_not_matter() -> None:
    wheels = [results("FL"), results("FR", 0.5), results("RL")]
    mixed = sorted((result for wheel in wheels for result in wheel), key=lambda result: result.host_ns)
    assert compared(*wheels)[1] == compared(*reversed(wheels))[1] == compared(mixed)[1]


@pytest.mark.parametrize("late_s", [0.0, 0.8])
def test_witness_that_is_late_and_has_an_offset_gives_the_gain(late_s: float) -> None:
    rng, gain = np.random.default_rng(2), CurveGain(1.0)
    time = np.arange(0.0, 160.0, 0.15)
    truth = np.where(time % 10.0 > 5.0, 0.2, 0.0) * np.where(time % 20.0 > 10.0, 1.0, -1.0)
    for at_s, rate in zip(time, truth, strict=True):
        late = 0.004 + float(np.interp(at_s - late_s, time, truth))
        gain.take(at_s, 0.15, Rate(0.8 * rate + rng.normal(0.0, 0.006), 0.008), Rate(late, 0.006), 12.0)
    assert gain.gain.value == pytest.approx(0.8, abs=2.0 * gain.gain.std)
    assert gain.gain.std < 0.06


def test_angles_across_a_gap_are_left_out() -> None:
    gain = CurveGain()
    for at_s in (*np.arange(0.0, 5.0, 0.15), *np.arange(50.0, 55.0, 0.15)):
        gain.take(at_s, 0.15, Rate(0.2 * (4.0 < at_s < 5.0), 0.01), Rate(0.2, 0.01), 12.0)
    assert gain.gain.curves == 0
