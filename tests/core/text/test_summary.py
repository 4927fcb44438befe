import math
from dataclasses import replace

import numpy as np
import pytest

from gateway.core.estimates.estimator import Estimate, Status, TireConditions
from gateway.core.estimates.reasons import EstimateCode
from gateway.core.estimates.results import AlarmRecord, LinkSnapshot, RevolutionResult, WheelCounters, WheelSnapshot
from gateway.core.reasons import CoreCode, Reason
from gateway.core.revolutions.effect_correction import CorrectedEffect, CorrectionTable
from gateway.core.revolutions.reasons import RevolutionCode
from gateway.core.session.reasons import SessionCode
from gateway.core.text.session_summary import LINE_WIDTH, ResultSummary, effects_line, removed_line, summary_lines
from gateway.core.text.wording import text
from gateway.core.trust.reasons import TrustCode
from gateway.ring.reasons import RingCode
from tests.testkit.revolution_data import plain_revolution

LOST = Reason(EstimateCode.SAMPLES_LOST)
FEW = Reason(CoreCode.NOT_SETTLED, revolutions=3.0, needed=8.0)
OUTSIDE = Reason(RevolutionCode.EFFECTS_OUTSIDE_RANGE, quantity="load_n", value=6500.0, low=4000.0, high=6000.0)


def result(
    position: str, period_s: float, *estimates: Estimate, missing: float = 0.0, faults: tuple[Reason, ...] = ()
) -> RevolutionResult:
    omega = 2 * math.pi / period_s
    revolution = plain_revolution(period_s=period_s, omega_radps=omega, missing_fraction=missing, faults=faults)
    return RevolutionResult(position, 0, revolution, TireConditions(0.5 / math.pi), estimates)


def bs(value: float, status: Status = Status.VALID, *reasons: Reason) -> Estimate:
    return Estimate("Bs", value, 1.2e-5, status, reasons)


def test_sums_per_wheel() -> None:
    summary = ResultSummary()
    summary.add(result("FL", 0.1, bs(3e-3), missing=0.3))
    summary.add(result("RR", 0.2))
    summary.add(result("FL", 0.3, bs(3.083e-3), faults=(LOST,)))
    front, rear = summary.wheels()
    assert (front.position, front.revolutions, front.revolutions_valid) == ("FL", 2, 1)
    assert front.faults == {LOST: 1}
    # 1 m of circumference: distance over time, not the mean of the speeds.
    assert front.distance_m == pytest.approx(2.0)
    assert front.speed_mean_mps == pytest.approx(2.0 / 0.4)
    assert (front.speed_min_mps, front.speed_max_mps) == (pytest.approx(1 / 0.3), pytest.approx(10.0))
    assert front.missing_fraction == pytest.approx(0.3 * 0.1 / 0.4)
    assert front.estimates == (bs(3.083e-3),)
    assert (rear.position, rear.estimates) == ("RR", ())


def test_last_usable_estimate_is_kept() -> None:
    summary = ResultSummary()
    refused = bs(math.nan, Status.INVALID, Reason(EstimateCode.RADIAL_SATURATED))
    summary.add(result("FL", 0.1, refused))
    assert summary.wheels()[0].estimates == (refused,)
    good = bs(3e-3, Status.PROVISIONAL)
    summary.add(result("FL", 0.1, good))
    summary.add(result("FL", 0.1, refused))
    assert summary.wheels()[0].estimates == (good,)


def test_lines_are_aligned_and_rounded_to_the_error() -> None:
    summary = ResultSummary()
    speed = Estimate("speed_mps", 10.00012345, 0.0021, Status.VALID)
    summary.add(result("FL", 0.1, speed, bs(3.0834e-3, Status.PROVISIONAL, FEW), missing=0.01))
    lines = summary_lines(summary.wheels())
    assert lines[0] == "FL"
    by_label = {line.split("  ")[1].strip(): line for line in lines[1:]}
    by_label["Bs"] = by_label["bending stiffness number (Bs)"]
    assert "36.0004 ± 0.0076 km/h" in by_label["speed"]
    assert "(3.083 ± 0.012)e-3" in by_label["Bs"]
    assert f"provisional: {text(FEW)}" in by_label["Bs"]
    assert "36.000 km/h" in by_label["mean speed"]
    assert "1.000 % within completed revolutions" in by_label["samples lost"]
    assert "none with a fault" in by_label["revolutions"]
    column = by_label["revolutions"].index("1")
    assert {line.index(number) for line, number in ((by_label["speed"], "36.0004"), (by_label["Bs"], "(3.083"))} == {
        column
    }


def test_samples_lost_between_revolutions_count() -> None:
    summary = ResultSummary()
    summary.add(result("FL", 0.1))
    states = [WheelSnapshot("FL", counters=WheelCounters(samples=4_000, samples_lost=6_000))]
    assert summary.wheels(states)[0].lost_fraction == pytest.approx(0.6)
    (line,) = (line for line in summary_lines(summary.wheels(states)) if "samples lost" in line)
    assert line.split() == ["samples", "lost", "60.000", "%", "0", "%", "within", "completed", "revolutions"]


def test_silence_is_not_said_to_be_lost_samples() -> None:
    summary = ResultSummary()
    summary.add(result("FL", 0.1))
    counters = WheelCounters(samples=4_000, samples_lost=6_000, samples_silent=6_000, silent_s=20.0)
    (line,) = (
        line
        for line in summary_lines(summary.wheels([WheelSnapshot("FL", counters=counters)]))
        if "samples lost" in line
    )
    assert line.split(maxsplit=4)[2:] == ["0", "%", "besides 20 s of silence"]


def test_values_that_are_not_those_of_the_end_say_so() -> None:
    summary = ResultSummary()
    for _ in range(3):
        summary.add(result("FL", 0.1, bs(3e-3)))
    for _ in range(8):
        summary.add(result("FL", 0.1, bs(math.nan, Status.INVALID, FEW)))
    (front,) = summary.wheels()
    assert front.estimates == (bs(3e-3),)
    assert front.stale["Bs"] == (3, (FEW,))
    words = " ".join(" ".join(summary_lines([front])).split())
    assert f"(3.000 ± 0.012)e-3 of revolution 3 of 11, invalid since: {text(FEW)}" in words
    summary.add(result("FL", 0.1, bs(3.1e-3)))
    assert not summary.wheels()[0].stale


def speed(status: Status, *reasons: Reason) -> Estimate:
    return Estimate("speed_mps", 10.0, 0.1, status, reasons)


def row_of(summary: ResultSummary, label: str) -> str:
    (line,) = (line for line in summary_lines(summary.wheels()) if line.strip().startswith(label))
    return " ".join(line.split())


def test_mean_of_an_invalid_speed_is_not_shown() -> None:
    summary = ResultSummary()
    summary.add(result("FL", 0.1, speed(Status.INVALID, FEW), Estimate.invalid("distance_m", FEW)))
    assert row_of(summary, "mean speed") == "mean speed — invalid"
    assert row_of(summary, "distance").startswith("distance — in 0.10 s; invalid: ")


def test_mean_speed_carries_the_status_of_the_speed() -> None:
    summary = ResultSummary()
    summary.add(result("FL", 0.1, speed(Status.PROVISIONAL, FEW)))
    assert row_of(summary, "mean speed") == "mean speed 36.000 km/h 36.00 to 36.00 km/h; provisional"
    for _ in range(8):
        summary.add(result("FL", 0.1, speed(Status.INVALID, LOST)))
    assert row_of(summary, "mean speed").endswith("; invalid since revolution 2")


def test_lines_of_many_invalid_estimates_are_narrow() -> None:
    names = [f"ply_steer_{part}_rad" for part in ("peak", "first_half", "adhesion_line", "contact_line", "ahead")]
    chance = Reason(EstimateCode.SIGN_NOT_DETERMINED, why="near_zero", errors=1.2)
    summary = ResultSummary()
    summary.add(result("FL", 0.1, *(Estimate.invalid(name, chance) for name in names)))
    lines = summary_lines(summary.wheels())
    assert max(map(len, lines)) <= 98  # commands indent by two more
    labels = " ".join(line[:32].strip() for line in lines)
    for name in names:
        assert name.removesuffix("_rad").replace("_", " ") in labels
    words = " ".join(" ".join(lines).split())
    assert text(chance).split()[-1] in words


def test_shared_reason_is_printed_once() -> None:
    summary = ResultSummary()
    refused = [Estimate.invalid(name, Reason(TrustCode.NOT_FINITE)) for name in ("Bs", "Cw")]
    early = [
        Estimate(name, 2.0, 0.1, Status.PROVISIONAL, (Reason(RingCode.FIT_NOT_CONVERGED),))
        for name in ("Rs_over_Cw", "Ts_over_Cw")
    ]
    summary.add(result("FL", 0.1, *refused, *early))
    lines = summary_lines(summary.wheels(), columns=140)
    (invalid,) = (line for line in lines if "invalid:" in line)
    assert invalid.split()[:3] == ["bending", "stiffness", "number"]
    assert invalid.endswith(f"—            invalid: {text(Reason(TrustCode.NOT_FINITE))}")
    rows = [line.split() for line in lines]
    assert ["Rs/Cw", "2.00", "±", "0.10", "provisional:", *text(Reason(RingCode.FIT_NOT_CONVERGED)).split()] in rows
    assert ["Ts/Cw", "2.00", "±", "0.10", "provisional"] in rows


def test_reason_of_several_numbers_is_printed_once_with_their_names() -> None:
    unverified, not_converged = Reason(TrustCode.NOT_FINITE), Reason(RingCode.FIT_NOT_CONVERGED)
    names = ["Bs", "wear_mm", "Rs_over_Cw", "contact_length_m"]
    estimates = [
        Estimate(name, 2.0, 0.1, status, (unverified, Reason(CoreCode.NOT_SETTLED, revolutions=i, needed=8.0)))
        for i, (name, status) in enumerate(zip(names, (Status.VALID, Status.PROVISIONAL) * 2, strict=True))
    ]
    conicity = Estimate("conicity_slope_rad", 0.0, 0.1, Status.PROVISIONAL, (not_converged,))
    summary = ResultSummary()
    summary.add(
        result("FL", 0.1, *estimates, conicity, Estimate("load_n", 1.0, 1.0, Status.PROVISIONAL, (unverified,)))
    )
    for columns in (78, LINE_WIDTH, 118):
        lines = summary_lines(summary.wheels(), columns=columns)
        words = " ".join(" ".join(lines).split())
        assert words.count(text(unverified)) == words.count(text(not_converged)) == 1
        assert f"of several numbers: bending stiffness number (Bs), wear and 3 more: {text(unverified)}" in words
        assert "load 1.0 ± 1.0 N provisional, see below" in words
        assert max(map(len, lines)) <= columns


def test_faults_and_links_are_printed() -> None:
    summary = ResultSummary()
    summary.add(result("FL", 0.1, faults=(LOST,)))
    link = LinkSnapshot("sim:demo", False, "", 100, 990, 3, 17, 10, 0, 2, 0, None, {"pipeline": 4})
    lines = summary_lines(summary.wheels(), [link])
    assert any(f"0 without a fault; 1 x {text(LOST)}" in line for line in lines)
    assert lines[-1] == (
        "sim:demo: 990 frames, 10 lost (1.00 %), 3 bad CRC, 2 reordered, 17 noise bytes, 4 dropped by pipeline"
    )


def test_alarms_are_listed_with_time_and_value() -> None:
    low = Reason(SessionCode.VALUE_BELOW_LIMIT, quantity="pressure_pa", value=210e3, limit=230e3)
    hub = Reason(SessionCode.HUB_SILENT, silence_s=20.1, wheels=("FL", "FR"))
    alarms = [
        AlarmRecord("FL", "pressure", low, 1, 25.0, 0.5, 25.5, is_standing=True),
        AlarmRecord("hub 0", "silent", hub, 2, 21.4, 3.0, 30.0, is_standing=False),
    ]
    assert summary_lines([], (), alarms)[-3:] == [
        "alarms",
        "  FL pressure: from 0.5 s to the end: pressure 210 kPa is below 230 kPa",
        f"  hub 0 silent: 2 times from 3.0 s to 30.0 s, 21 s in all: {text(hub)}",
    ]


def test_alarm_just_before_the_first_chunk_is_from_zero() -> None:
    low = Reason(SessionCode.VALUE_BELOW_LIMIT, quantity="pressure_pa", value=210e3, limit=230e3)
    alarm = AlarmRecord("FL", "pressure", low, 1, 0.0, -0.004, -0.001, is_standing=False)
    assert "from 0.0 s to 0.0 s" in summary_lines([], (), [alarm])[-1]


def test_session_without_revolutions() -> None:
    assert summary_lines(ResultSummary().wheels()) == ["no revolution was completed"]


@pytest.mark.parametrize(
    ("uncorrected", "says"),
    [
        ((), "FL: subtracted from its axes: roll tilt, imbalance"),
        ((0, 1, 2), f"FL: NOT subtracted from its axes: roll tilt, imbalance: {text(OUTSIDE)}"),
        (
            (0,),
            "FL: subtracted from its axes in 2 of 3 revolutions: roll tilt, imbalance; "
            f"not in the others: {text(OUTSIDE)}",
        ),
    ],
    ids=["all", "none", "some"],
)
def test_effects_line_counts_corrected_revolutions(uncorrected: tuple[int, ...], says: str) -> None:
    summary = ResultSummary()
    for number in range(3):
        single = result("FL", 0.1)
        reason = OUTSIDE if number in uncorrected else None
        summary.add(replace(single, revolution=replace(single.revolution, uncorrected=reason)))
    (wheel,) = summary.wheels()
    assert effects_line(wheel, ["roll tilt", "imbalance"]) == says


def test_removed_line_gives_the_size_on_each_axis() -> None:
    summary = ResultSummary()
    summary.add(result("FL", 0.1))
    (wheel,) = summary.wheels()
    orders = np.zeros((1, 3, 4), dtype=np.complex128)
    orders[0, 2, 3] = 2.0
    table = CorrectionTable("FL", np.array([60.0]), orders, (CorrectedEffect("roll tilt"),), 0.3, (1.0, 500.0))
    line = removed_line(wheel, table)
    assert line.startswith("FL: removed at ")
    assert line.endswith("circumferential 0.00, lateral 0.00, radial 1.41")
    assert removed_line(replace(wheel, uncorrected=1), table) == ""
