"""Reasons why a diagnosis has no correction for the estimators to subtract."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from gateway.closure.result import Finding, Verdict
from gateway.reasons import Code, Reason
from gateway.views.report.phrases import saved_text, why_unsaved
from tests.testkit.diagnosis_data import empty, ordinary


def named(*names: str, lock: str = "angle") -> tuple[Finding, ...]:
    return tuple(replace(ordinary().findings[0], name=name, lock=lock) for name in names)


def undecided(**changes: object) -> Finding:
    return replace(ordinary().findings[3], verdict=Verdict.INDISTINGUISHABLE, **changes)


@pytest.mark.parametrize(
    ("findings", "reason", "remedy"),
    [
        ((), "no effect was identified", "no correction"),
        (
            (undecided(name="gain", rivals=("rolling radius", "run-out"), decide_with=Reason(Code.RECORD_LIVE)),),
            "gain, rolling radius and run-out cannot be distinguished, so none is identified",
            "Record live, with host time stamps.",
        ),
        ((undecided(name="gain", rivals=(), decide_with=None),), "gain is not certain", "Record at another speed"),
        (named("ply steer"), "ply steer is left for the estimators to measure", "no correction"),
        (named("cavity resonance", lock="time"), "not the same in every revolution", "no correction"),
        (named("mounting offset"), "no solution at the fitted parameters without mounting offset", "belt radius"),
        (
            named("ply steer", "drum", "gain"),
            "at the fitted parameters without drum and gain",
            "belt radius",
        ),
    ],
)
def test_reason_and_remedy(findings, reason, remedy):
    why = why_unsaved(replace(empty(), findings=findings))
    assert reason in why.reason
    assert remedy in why.remedy
    assert why.remedy.endswith(".")


def test_a_search_that_ended_early_says_so():
    why = why_unsaved(replace(empty(), complete=False, unexplained=ordinary().unexplained))
    assert "--budget" in why.remedy


def test_a_large_residual_needs_more_than_no_correction():
    why = why_unsaved(replace(empty(), unexplained=ordinary().unexplained))
    assert "unexplained residuals" in why.remedy
    assert "need no correction" not in why.remedy


def test_saved_and_unsaved_effects_are_listed():
    findings = (*named("gain", "ply steer"), *named("cavity resonance", "edge scatter", lock="time"))
    held = SimpleNamespace(effects=(SimpleNamespace(name="gain"),))
    assert saved_text(replace(empty(), findings=findings, correction=held)) == (
        "gain; ply steer is left for the estimators to measure; "
        "cavity resonance and edge scatter are not the same in every revolution"
    )
    assert saved_text(replace(empty(), findings=named("gain"), correction=held)) == "gain"
