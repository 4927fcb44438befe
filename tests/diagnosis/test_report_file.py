"""Files of a diagnosis: what stops a report, and why there is no correction to save."""

import errno
import os
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.core.errors import OutputError
from gateway.core.reasons import Reason
from gateway.core.text.output_file import check_target, write_whole
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Finding, Verdict
from gateway.diagnosis.views.diagnosis_json import write_json
from gateway.diagnosis.views.html import write_html
from gateway.diagnosis.views.phrases import saved_text, why_unsaved
from tests.testkit.diagnosis_data import empty, ordinary


@pytest.mark.parametrize("write", [write_html, write_json])
def test_absent_folder_names_the_mkdir_command(tmp_path, write):
    path = tmp_path / "absent" / "report"
    with pytest.raises(OutputError, match="absent") as caught:
        write(empty(), path)
    assert str(path) in str(caught.value)
    assert "mkdir -p" in caught.value.remedy


def test_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "out.json"
    path.write_text("old")

    def full(descriptor: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "fsync", full)
    with pytest.raises(OutputError, match="No space left") as caught:
        write_whole(path, "new", force=True)
    assert str(path) in str(caught.value)
    assert caught.value.remedy
    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["out.json"]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="the system has no /dev/full")
def test_full_device_is_an_error():
    with pytest.raises(OutputError, match="/dev/full"):
        write_whole(Path("/dev/full"), "text")


def test_device_is_written_not_replaced():
    write_whole(Path(os.devnull), "text")
    assert not Path(os.devnull).is_file()


def test_symlink_is_kept(tmp_path):
    (tmp_path / "real").write_text("old")
    link = tmp_path / "link"
    link.symlink_to(tmp_path / "real")
    write_whole(link, "new", force=True)
    assert link.is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_file_mode_is_the_default(tmp_path):
    write_whole(tmp_path / "a", "text")
    (tmp_path / "b").write_text("text")
    assert (tmp_path / "a").stat().st_mode == (tmp_path / "b").stat().st_mode


@pytest.mark.parametrize("name", ["", "x" * 300])
def test_unwritable_target_is_refused_early(tmp_path, name):
    with pytest.raises(OutputError) as caught:
        check_target(tmp_path / name)
    assert caught.value.remedy


def test_existing_target_is_refused_early(tmp_path):
    (tmp_path / "out").write_text("mine")
    with pytest.raises(OutputError, match="already exists"):
        check_target(tmp_path / "out")
    check_target(tmp_path / "out", force=True)
    check_target(tmp_path / "new")


def named(*names: str, lock: str = "angle") -> tuple[Finding, ...]:
    return tuple(replace(ordinary().findings[0], name=name, lock=lock) for name in names)


def undecided(**changes: object) -> Finding:
    return replace(ordinary().findings[3], verdict=Verdict.INDISTINGUISHABLE, **changes)


@pytest.mark.parametrize(
    ("findings", "reason", "remedy"),
    [
        ((), "no effect was identified", "no correction"),
        (
            (
                undecided(
                    name="gain",
                    rivals=("rolling radius", "run-out"),
                    decide_with=Reason(DiagnosisCode.RECORD_AGAIN, how="live"),
                ),
            ),
            "gain, rolling radius and run-out cannot be distinguished, so none is identified",
            "Record live, with host time stamps.",
        ),
        ((undecided(name="gain", rivals=(), decide_with=None),), "gain is not certain", "Record at another speed"),
        (named("ply steer"), "ply steer is left for the estimators to measure", "no correction"),
        (named("cavity resonance", lock="time"), "not the same in every revolution", "no correction"),
        (named("mounting offset"), "no solution at the fitted parameters without mounting offset", "belt radius"),
        (named("ply steer", "drum", "gain"), "at the fitted parameters without drum and gain", "belt radius"),
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
