"""Next steps of a report: one for everything that is open."""

from dataclasses import replace

import pytest

from gateway.core.reasons import Code, Reason
from gateway.diagnosis.result import Fitted, Law, Scaling, ScalingStatus, Unexplained, Verdict
from gateway.diagnosis.views.next_steps import next_steps
from tests.testkit.diagnosis_data import WARMER, empty, ordinary

KNOWN = Scaling(ScalingStatus.KNOWN, 2.0)
ANGLE = Unexplained("radial", "angle", (12, 52), (80.0, 550.0), (0.86, 0.94), KNOWN, 21.0, 0.1)
LAW = Law(
    "law: local mass", "local mass", True, (), "A part.", "m", "omega^2", "ring", ("radial",),
    {"mass_kg": Fitted(0.01, 1e-4, "kg")}, 90.0, 0.9, 20.0,
)  # fmt: skip
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
        notes=(Reason(Code.ONE_SPEED), "a user's text"),
        determined={"Ts": False},
        load_known=False,
    )
    steps = dict(next_steps(diagnosis))
    assert steps["mounting offset"].startswith("correct the vehicle file")
    assert steps["structural damping"].startswith("save with --save-effects")
    assert "20 K" in steps["gain or clipping"]
    assert steps["camber"] == "record longer, or at another speed or load"
    assert "radial, orders 12 to 52, 49.3 to 53.9 deg" in steps
    assert "state" in steps["not determined: Ts"]
    assert steps["one speed"] == "record at a second speed under the same load and pressure"
    assert len(steps) == 7


def test_a_law_has_a_step_in_place_of_what_it_explains() -> None:
    first, second, *_ = ordinary().findings
    moved = Reason(
        Code.LAW_MOVES_EFFECT, effect="gain", law=LAW.title, parameter="error", value=0.1, without=2.6, unit="%"
    )
    diagnosis = replace(
        empty(),
        findings=(replace(first, name="gain", verdict=Verdict.NAMED), replace(second, name="camber")),
        unexplained=(ANGLE, replace(ANGLE, axis="lateral")),
        laws=(LAW,),
        notes=(moved,),
    )
    steps = dict(next_steps(diagnosis))
    assert "--law-plugin" in steps["law: local mass"]
    assert steps["gain"].startswith("decide on the law first")
    assert not any(about.startswith("radial") for about in steps)
    assert any(about.startswith("lateral") for about in steps)


@pytest.mark.parametrize(
    ("code", "part"),
    [
        (Code.LAW_UNTESTED, "record at another speed and load"),
        (Code.LAW_HAS_RIVALS, "record at another speed and load"),
        (Code.LAW_SIZES_DIFFER, "does not hold for all recordings"),
        (Code.LAW_LEAVES_MUCH, "not the only one"),
    ],
)
def test_a_clue_has_a_step_and_keeps_that_of_the_residual(code: Code, part: str) -> None:
    clue = replace(LAW, certain=False, reasons=(Reason(code),))
    steps = dict(next_steps(replace(empty(), laws=(clue,), unexplained=(ANGLE,))))
    assert part in steps["clue: local mass"]
    assert any(about.startswith("radial") for about in steps)
