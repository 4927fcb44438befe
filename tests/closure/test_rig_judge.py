"""The rig's judge, on diagnoses written by hand."""

import sys
from pathlib import Path
from typing import Any

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

from closure_rig.draw import Kind, Order, draw
from closure_rig.judge import ALWAYS, CANNOT_TELL, Outcome, judge

from gateway.closure.effects.catalogue import catalogue
from gateway.closure.inference.nonsynchronous_diagnosis import UNKNOWN


def finding(name: str, verdict: str = "named", *rivals: str) -> dict[str, Any]:
    return {"name": name, "verdict": verdict, "rivals": list(rivals)}


def diagnosis(*effects: dict[str, Any], unexplained: int = 0) -> dict[str, Any]:
    return {"effects": list(effects), "unexplained": [{"axis": "radial"}] * unexplained}


EFFECT = draw(Order(Kind.EFFECT, 1, ("roll tilt",), 1)).label
PAIR = draw(Order(Kind.PAIR, 1, ("roll tilt", "torsional ripple"))).label
RADIUS = draw(Order(Kind.EFFECT, 1, ("rolling radius",), 1)).label
OUTSIDE = draw(Order(Kind.OUTSIDE, 1, ("radial kick",), 1)).label
NOTHING = draw(Order(Kind.NOTHING, 1)).label


@pytest.mark.parametrize(
    ("label", "result", "outcome"),
    [
        (EFFECT, diagnosis(finding("roll tilt")), Outcome.EXACT),
        (EFFECT, diagnosis(finding("roll tilt"), finding("gain", "refused")), Outcome.EXACT),
        (EFFECT, diagnosis(), Outcome.MISSED),
        (EFFECT, diagnosis(finding("roll tilt", "refused")), Outcome.MISSED),
        (EFFECT, diagnosis(finding("gain")), Outcome.WRONG),
        (EFFECT, diagnosis(finding("roll tilt"), finding("gain")), Outcome.WRONG),
        (EFFECT, diagnosis(finding("roll tilt", "indistinguishable", "gain")), Outcome.UNSURE),
        (EFFECT, diagnosis(finding("gain", "indistinguishable", "clipping")), Outcome.WRONG),
        (RADIUS, diagnosis(finding("sample clock error", "indistinguishable", "rolling radius")), Outcome.CANNOT_TELL),
        (
            RADIUS,
            diagnosis(
                finding("sample clock error", "indistinguishable", "rolling radius"),
                finding("rolling radius", "indistinguishable", "sample clock error"),
            ),
            Outcome.CANNOT_TELL,
        ),
        (PAIR, diagnosis(finding("roll tilt"), finding("torsional ripple")), Outcome.EXACT),
        (PAIR, diagnosis(finding("torsional ripple")), Outcome.MISSED),
        (NOTHING, diagnosis(), Outcome.NOTHING),
        (NOTHING, diagnosis(unexplained=1), Outcome.NOTHING),
        (NOTHING, diagnosis(finding("gain")), Outcome.FALSE_ALARM),
        (NOTHING, diagnosis(finding("gain", "indistinguishable", "run-out")), Outcome.FALSE_ALARM),
        (OUTSIDE, diagnosis(unexplained=2), Outcome.LEFT),
        (OUTSIDE, diagnosis(finding("gain", "indistinguishable", UNKNOWN), unexplained=1), Outcome.LEFT),
        (NOTHING, diagnosis(finding("gain", "indistinguishable", UNKNOWN)), Outcome.FALSE_ALARM),
        (OUTSIDE, diagnosis(), Outcome.MISSED),
        (OUTSIDE, diagnosis(finding("tread pitch"), unexplained=1), Outcome.WRONG),
    ],
)
def test_outcomes(label: dict[str, Any], result: dict[str, Any], outcome: Outcome) -> None:
    assert judge(result, label).outcome is outcome


def test_paper_model_always_lacks_corrections() -> None:
    always = [finding(name) for name in ALWAYS["paper"] - {"speed drift"}]
    nothing, effect = {**NOTHING, "model": "paper"}, {**EFFECT, "model": "paper"}
    assert judge(diagnosis(*always), nothing).outcome is Outcome.NOTHING
    assert judge(diagnosis(*always[1:]), nothing).outcome is Outcome.MISSED
    assert judge(diagnosis(*always, finding("roll tilt")), effect).outcome is Outcome.EXACT
    assert judge(diagnosis(*always, finding("gain")), nothing).outcome is Outcome.FALSE_ALARM


def test_what_a_stranger_brings_along_may_be_named() -> None:
    creep = draw(Order(Kind.OUTSIDE, 1, ("creeping bond",), 2)).label
    named = diagnosis(finding("pitch tilt"), unexplained=1)
    assert judge(named, creep).outcome is Outcome.WRONG
    assert judge(named, creep, also=("pitch tilt",)).outcome is Outcome.LEFT
    assert judge(diagnosis(unexplained=1), creep, also=("pitch tilt",)).outcome is Outcome.LEFT


def test_computed_rival_may_be_left_open() -> None:
    left_open = diagnosis(finding("roll tilt", "indistinguishable", "gain"))
    asked = []

    def alike(true: str, other: str) -> bool:
        asked.append((true, other))
        return True

    assert judge(left_open, EFFECT, alike).outcome is Outcome.CANNOT_TELL
    assert asked == [("roll tilt", "gain")]


def test_names_match_the_catalogue() -> None:
    reference = set(catalogue())
    for names in (*CANNOT_TELL, *ALWAYS.values()):
        assert names <= reference, names - reference
