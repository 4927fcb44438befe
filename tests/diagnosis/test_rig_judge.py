"""The rig's judge, on diagnoses written by hand, and its scores: shares, bounds, reliability and tables."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from closure_rig.draw import Kind, Order, draw
from closure_rig.figure import draw_confusion, draw_reliability
from closure_rig.judge import ALWAYS, CANNOT_TELL, Outcome, judge
from closure_rig.score import Share, confusion, false_names, reliability, report

from gateway.diagnosis.effects.catalogue import catalogue
from gateway.diagnosis.spectrum.nonsynchronous_diagnosis import UNKNOWN


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


NUMBER = {"quantity": "Bs", "state": [4000.0, 2e5], "value": 1.1, "std": 0.05, "true": 1.0, "determined": True}


def line(number: int, outcome: str, **more: Any) -> dict[str, Any]:
    """A line of results; by default a gain of twice the detection limit."""
    return {
        "number": number,
        "stratum": "effect",
        "kind": "effect",
        "model": "exact",
        "truth": ["gain"],
        "outside": None,
        "strengths": {"gain": 2.0},
        "sizes": {"gain": [0.01, "%"]},
        "outcome": outcome,
        "named": [],
        "open": [],
        "probability": {},
        "unexplained": [],
        "held_out": {"before_mps2": 1.2, "after_mps2": 1.05, "floor_mps2": 1.0},
        "numbers": [{**NUMBER, "when": "before"}, {**NUMBER, "when": "after", "std": 0.1}],
        "parameters": [],
        "cpu_s": 2.0,
        **more,
    }


RIGHT = line(1, "exactly right", named=["gain"], probability={"gain": 0.95, "run-out": 0.01})
MISSED = line(2, "missed", strengths={"gain": 0.5}, probability={"gain": 0.3})
WRONG = line(3, "wrong name", named=["gain", "yaw tilt"], probability={"gain": 0.92, "yaw tilt": 0.91})
NO_EFFECT = line(4, "nothing, rightly", stratum="nothing", kind="nothing", truth=[], strengths={}, sizes={})
OUTSIDE_CASE = line(
    5,
    "unexplained, rightly",
    stratum="outside",
    kind="outside",
    truth=[],
    outside="radial kick",
    strengths={"radial kick": 9.0},
    sizes={"radial kick": [1.5, "m/s^2 at 65 km/h"]},
    unexplained=[{"axis": "radial"}],
)
ALL = [RIGHT, MISSED, WRONG, NO_EFFECT, OUTSIDE_CASE]


def test_bounds_are_those_of_clopper_and_pearson() -> None:
    assert Share(0, 300).below == pytest.approx(1.0 - 0.05 ** (1.0 / 300.0))
    assert Share(0, 300).below < 0.01
    assert Share(300, 300).below == 1.0
    assert Share(8, 10).interval == pytest.approx((0.4439, 0.9748), abs=1e-4)


def test_false_names_leave_out_what_a_model_lacks() -> None:
    assert false_names(WRONG) == {"yaw tilt"}
    assert not false_names(line(1, "exactly right", named=["gain", "gravity"], model="paper"))
    assert false_names(line(1, "wrong name", named=["gain", "gravity"])) == {"gravity"}
    bond = line(1, "unexplained, rightly", named=["pitch tilt"], truth=[], outside="creeping bond")
    assert not false_names(bond)


def test_reliability_counts_true_effects_by_probability() -> None:
    bins = {(entry.low, entry.high): entry for entry in reliability(ALL)}
    assert bins[0.9, 0.98].share == Share(2, 3)
    assert bins[0.9, 0.98].mean == pytest.approx(np.mean([0.95, 0.92, 0.91]))
    assert bins[0.3, 0.7].share == Share(1, 1)
    assert bins[0.0, 0.02].share == Share(0, 1)
    certain = line(1, "exactly right", probability={"gain": 1.0})
    assert [entry.share for entry in reliability([certain])][-1] == Share(1, 1)


def test_report_has_a_column_for_each_version() -> None:
    text = "\n".join(report({"old": ALL, "new": [RIGHT, NO_EFFECT]}))
    assert "exactly right" in text
    assert "0/1 (0.0 %), below 95.0 %" in text
    assert "1.7 to 3" in text
    assert "found 1/2 (50.0 %), wrong 1" in text
    assert "rms 2.00" in text
    assert "rms 1.00" in text
    assert "mean 2.0, median 2.0, most 2.0" in text
    assert "old 3, from exact, gain (2): wrong name: gain + yaw tilt" in text


def test_smallest_strength_needs_nine_of_ten_from_there_on() -> None:
    cases = [line(n, "exactly right" if n > 3 else "missed", strengths={"gain": 0.5 * n}) for n in range(1, 12)]
    text = "\n".join(report({"new": cases}))
    assert "below 1 0/1, 1 to 3 2/4, above 6/6, from 2 (0.01)" in text


def test_confusion_is_a_share_of_cases() -> None:
    truths, says, share = confusion(ALL)
    row = share[truths.index("gain")]
    assert row[says.index("gain")] == pytest.approx(2 / 3)
    assert row[says.index("yaw tilt")] == pytest.approx(1 / 3)
    assert row[says.index("no name")] == pytest.approx(1 / 3)
    assert share[truths.index("(radial kick)"), says.index("unexplained")] == 1.0
    assert share[truths.index("nothing"), says.index("no name")] == 1.0
    truths, says, share = confusion([{**WRONG, "named": ["no such effect"]}])
    assert share[truths.index("gain"), says.index("no such effect")] == 1.0


def test_figures_are_deterministic(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    for folder in ("a", "b"):
        draw_confusion(ALL, tmp_path / folder / "confusion.svg")
        draw_reliability({"old": ALL, "none": [NO_EFFECT]}, tmp_path / folder / "reliability.svg")
    for name, text in (("confusion.svg", "radial kick"), ("reliability.svg", "probability given")):
        first = (tmp_path / "a" / name).read_text()
        assert first == (tmp_path / "b" / name).read_text()
        assert text in first
