"""Output of the bench: hand-checked counts and a reproducible figure."""

from __future__ import annotations

import json
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "tools"))

import closure_rig.run as rig_run
from closure_rig.draw import Kind, Order
from closure_rig.figure import draw_confusion
from closure_rig.judge import Judgement, Outcome
from closure_rig.run import kept, run
from closure_rig.score import by_effect, confusion, summary

RIGHT = Judgement(
    Outcome.EXACT,
    truth=("gain",),
    named=("gain",),
    open=(),
    unexplained=False,
    ratio=1.02,
    kind="effect",
    size="middle",
    seed=1,
)
MISSED = replace(RIGHT, outcome=Outcome.MISSED, named=(), unexplained=True, ratio=1.2, size="small")
WRONG = replace(RIGHT, outcome=Outcome.WRONG, named=("run-out", "yaw tilt"), size="small")
LEFT = replace(RIGHT, outcome=Outcome.LEFT, truth=("(stiff splice)",), named=(), unexplained=True, kind="outside")
NOTHING = replace(RIGHT, outcome=Outcome.NOTHING, truth=(), named=(), kind="nothing", size="")
ALL = [RIGHT, RIGHT, MISSED, WRONG, LEFT, NOTHING]


def test_summary_counts_by_kind_and_size() -> None:
    lines = summary(ALL)
    assert "effect small" in lines[0]
    assert "0/2 right" in lines[0]
    assert "2/2 right (100.0 %)" in lines[1]
    assert any(line.startswith("outside middle") and "1/1 right" in line for line in lines)
    assert any(line.startswith("nothing") and "1/1 right" in line for line in lines)
    assert "83.3 % of 6" in lines[-1]


def test_smallest_size_found() -> None:
    gain = next(line for line in by_effect(ALL) if line.startswith("gain"))
    assert " 0/2   2/2   0/0  from 0.03 %" in gain
    assert "also named: run-out 1, yaw tilt 1" in gain or "also named: yaw tilt 1, run-out 1" in gain


def test_confusion_is_a_share_of_cases() -> None:
    truths, says, share = confusion(ALL)
    row = share[truths.index("gain")]
    assert row[says.index("gain")] == pytest.approx(0.5)
    assert row[says.index("run-out")] == pytest.approx(0.25)
    assert row[says.index("unexplained")] == pytest.approx(0.25)
    assert share[truths.index("(stiff splice)"), says.index("unexplained")] == 1.0
    assert share[truths.index("nothing"), says.index("no name")] == 1.0
    stranger = replace(RIGHT, named=("no such effect",), outcome=Outcome.WRONG)
    truths, says, share = confusion([stranger])
    assert share[truths.index("gain"), says.index("no such effect")] == 1.0


def test_figure_is_deterministic(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    draw_confusion(ALL, tmp_path / "a.svg")
    draw_confusion(ALL, tmp_path / "b.svg")
    text = (tmp_path / "a.svg").read_text()
    assert text == (tmp_path / "b.svg").read_text()
    assert "stiff splice" in text


def test_diagnosis_gets_recordings_and_failure_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[list[str]] = []

    def refuse(given: rig_run.Recorded, model: str) -> str:
        seen.append(sorted(path.name for path in given.paths[0].parent.iterdir()))
        raise RuntimeError("no")

    monkeypatch.setattr(rig_run, "_diagnose", refuse)
    trial = run(Order(Kind.EFFECT, 1, ("gain",), 1), seconds=0.3)
    assert trial.judgement.outcome is Outcome.FAILED
    assert trial.fault == "RuntimeError: no"
    # Recordings and what was declared of them; the label lies elsewhere.
    assert seen == [["declared.json", *(f"run-{number}.mcap" for number in range(1, 8))]]
    assert np.isnan(trial.judgement.ratio)


def test_bracketed_name_is_not_an_outsider() -> None:
    right = replace(RIGHT, truth=("tread damping (shifted pressure)",), named=("tread damping (shifted pressure)",))
    assert by_effect([right])[0].split()[:4] == ["tread", "damping", "(shifted", "pressure)"]


def test_saved_diagnosis_is_judged_like_the_original(tmp_path: Path) -> None:
    label = {"kind": "effect", "truth": ["gain"], "outside": "", "sizes": {"gain": {"size": "middle"}}, "seed": 3}
    said = {
        "model": "exact",
        "effects": [{"name": "gain", "verdict": "named", "rivals": []}],
        "unexplained": [],
        "noise_floor_mps2": 2.0,
        "held_out": {"rms_after_mps2": 2.1},
    }
    (tmp_path / "effect-gain-1-3.label.json").write_text(json.dumps(label))
    (tmp_path / "effect-gain-1-3.json").write_text(json.dumps(said))
    (tmp_path / "effect-gain-1-4.label.json").write_text(json.dumps({**label, "seed": 4}))
    right, failed = kept(tmp_path)
    assert (right.outcome, right.named, right.seed) == (Outcome.EXACT, ("gain",), 3)
    assert right.ratio == pytest.approx(1.05)
    assert (failed.outcome, failed.truth, failed.seed) == (Outcome.FAILED, ("gain",), 4)
