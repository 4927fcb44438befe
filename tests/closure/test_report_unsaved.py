"""Why there is nothing for estimators to take off."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import pytest

from gateway.closure.contribution import _MEASURED
from gateway.closure.diagnosis import Finding, Verdict
from gateway.views.report.unsaved import MEASURED, saved_text, why_unsaved
from tests.testkit.diagnosis_data import empty, ordinary


def named(*names: str, lock: str = "angle") -> tuple[Finding, ...]:
    return tuple(replace(ordinary().findings[0], name=name, lock=lock) for name in names)


def undecided(**changes: object) -> Finding:
    return replace(ordinary().findings[3], verdict=Verdict.INDISTINGUISHABLE, **changes)


def test_what_is_left_to_estimators_is_what_the_closure_leaves_out():
    assert MEASURED == _MEASURED


@pytest.mark.parametrize(
    ("findings", "reason", "remedy"),
    [
        ((), "no effect was named", "no correction"),
        (
            (undecided(name="gain", rivals=("rolling radius", "run-out"), decide_with="a longer recording decides"),),
            "gain, rolling radius and run-out cannot be told apart, so none is named",
            "A longer recording decides.",
        ),
        ((undecided(name="gain", rivals=(), decide_with=""),), "gain is not certain", "Record at another speed"),
        (named("ply steer"), "ply steer is left for the estimators to measure", "no correction"),
        (named("cavity resonance", lock="time"), "not the same in every revolution", "no correction"),
        (named("mounting offset"), "without mounting offset the ring does not stand", "belt radius"),
        (named("ply steer", "drum", "gain"), "without drum and gain the ring does not stand", "belt radius"),
    ],
)
def test_the_reason_and_what_to_do(findings, reason, remedy):
    told = why_unsaved(replace(empty(), findings=findings))
    assert reason in told.reason
    assert remedy in told.remedy
    assert told.remedy.endswith(".")


def test_what_a_saved_file_holds_and_what_it_does_not():
    findings = (*named("gain", "ply steer"), *named("cavity resonance", "edge scatter", lock="time"))
    held = SimpleNamespace(effects=(SimpleNamespace(name="gain"),))
    assert saved_text(replace(empty(), findings=findings, correction=held)) == (
        "gain; ply steer is left for the estimators to measure; "
        "cavity resonance and edge scatter are not the same in every revolution"
    )
    assert saved_text(replace(empty(), findings=named("gain"), correction=held)) == "gain"
