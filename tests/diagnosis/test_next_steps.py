"""Next steps of a report: one for everything that is open."""

from dataclasses import replace

import pytest

from gateway.core.reasons import Reason
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Fitted, Scaling, ScalingStatus, Unexplained, Verdict
from gateway.diagnosis.views.next_steps import next_steps
from tests.testkit.diagnosis_data import WARMER, empty, ordinary

KNOWN = Scaling(ScalingStatus.KNOWN, 2.0)
ANGLE = Unexplained("radial", "angle", (12, 52), (80.0, 550.0), (0.86, 0.94), KNOWN, 21.0, 0.1)
TIME = Unexplained("lateral", "time", None, (47.0, 53.0), None, KNOWN, 3.0, 0.1)


def step_for(residual: Unexplained) -> str:
    diagnosis = replace(
        empty(),
        findings=(),
        notes=(),
        unexplained=(residual,),
        estimates_after={"contact_half_angle_rad": Fitted(0.17, 0.001, "rad")},
        determined={},
    )
    ((_, step),) = next_steps(diagnosis)
    return step


@pytest.mark.parametrize(
    ("residual", "part"),
    [
        (ANGLE, "49.3 to 53.9 deg behind the sensor"),
        (replace(ANGLE, scaling=Scaling(ScalingStatus.ONE_SPEED)), "record at a second speed"),
        (replace(ANGLE, angle_rad=(-0.3, -0.1)), "at the contact"),
        (replace(ANGLE, angle_rad=None, orders=(3, 3)), "turn the tire on its rim"),
        (replace(ANGLE, changes=True), "one state at a time"),
        (replace(ANGLE, lock="place"), "49.3 to 53.9 deg behind the sensor"),
        (replace(ANGLE, lock="turns"), "every second turn"),
        (replace(TIME, lock="samples"), "repair or replace"),
        (replace(TIME, narrow=True, centre_hz=50.02), "a source of 50.0 Hz"),
        (
            replace(TIME, narrow=True, centre_hz=7.0, scaling=Scaling(ScalingStatus.ONE_SPEED)),
            "record at a second speed: a source of 7.0 Hz keeps its frequency",
        ),
        (replace(TIME, orders=(3, 4), centre_order=3.58), "3.58 times as fast as the wheel"),
        (TIME, "record at a second speed"),
        (replace(TIME, speeds=(2, 2)), "keeps its frequency"),
    ],
)
def test_step_follows_from_the_residual(residual: Unexplained, part: str) -> None:
    assert part in step_for(residual)


def test_every_open_end_has_a_step() -> None:
    first, second, *_ = ordinary().findings
    diagnosis = replace(
        ordinary(),
        findings=(
            replace(first, name="mounting offset", verdict=Verdict.NAMED),
            replace(second, name="structural damping", verdict=Verdict.NAMED),
            replace(second, name="gain", verdict=Verdict.INDISTINGUISHABLE, rivals=("clipping",), decide_with=WARMER),
            replace(second, name="camber", verdict=Verdict.REFUSED, probability=0.8, reason=None),
        ),
        unexplained=(ANGLE,),
        notes=(Reason(DiagnosisCode.ONE_SPEED), "a user's text"),
        determined={"Ts": False},
        load_known=False,
    )
    steps = dict(next_steps(diagnosis))
    assert steps["mounting offset"].startswith("state it in the vehicle file")
    assert steps["structural damping"].startswith("nothing to repair: use the estimates after. To have it subtracted")
    assert "20 K" in steps["gain or clipping"]
    assert steps["camber"] == "record longer, or at another speed or load"
    assert "radial, orders 12 to 52, 49.3 to 53.9 deg" in steps
    assert "state" in steps["not determined: Ts"]
    assert steps["one speed"] == "record at a second speed under the same load and pressure"
    assert len(steps) == 7


def test_step_of_several_open_ends_stands_once() -> None:
    other = replace(ANGLE, axis="circumferential", lock="turns")
    diagnosis = replace(empty(), unexplained=(replace(ANGLE, lock="turns"), other))
    (step,) = (step for step in next_steps(diagnosis) if "second turn" in step.step)
    assert "radial" in step.about
    assert "circumferential" in step.about


def test_a_search_that_ended_early_asks_for_time_and_not_for_what_it_has_not_explained() -> None:
    note = Reason(DiagnosisCode.SEARCH_ENDED_EARLY)
    diagnosis = replace(
        empty(), unexplained=(ANGLE,), notes=(note,), determined={"Ts": False, "tread_stiffness_npm2": False}
    )
    assert next_steps(diagnosis) == [
        ("the search ended at its time limit", "give it more time: a larger --budget, or none")
    ]
    abouts = [step.about for step in next_steps(replace(diagnosis, notes=()))]
    assert any("tread stiffness" in about for about in abouts)
    assert not any("npm2" in about for about in abouts)
