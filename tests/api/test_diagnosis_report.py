"""Diagnosis for programs: options as on the command line, and a result with its report."""

import json
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.io

import gateway
from gateway.api import diagnosis_report
from gateway.api.diagnosis_report import DiagnosisReport
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.effects_file import load_effects
from gateway.diagnosis.views.html import diagnosis_html
from gateway.diagnosis.views.terminal import closure_summary_lines
from tests.api.test_recording_access import correction
from tests.testkit.diagnosis_data import empty, nasty, ordinary


@pytest.fixture
def asked(monkeypatch):
    """Replace the diagnosis by a prepared result; return the arguments that it gets."""
    arguments = {}

    def diagnose(orders, **options):
        arguments.update(options, orders=orders)
        return ordinary()

    monkeypatch.setattr(diagnosis_report, "diagnose_recordings", diagnose)
    return arguments


def test_options_are_those_of_the_command(asked, recorded, recording, tmp_path):
    other = tmp_path / "other.mcap"
    other.write_bytes(b"")
    report = gateway.diagnose(
        [recording, str(other)], wheel="FL", model="paper", reverse=[other], folds=3, empirical=True, keys="keys.toml"
    )
    assert isinstance(report, gateway.DiagnosisReport)
    assert [(order.path, order.reverse) for order in asked["orders"]] == [(recorded, False), (other, True)]
    assert {(order.wheel, order.folds, str(order.key_file)) for order in asked["orders"]} == {("FL", 3, "keys.toml")}
    assert asked["model"] is BaselineModel.PAPER
    assert (asked["empirical"], len(asked["workers"])) == (True, 0)


def test_single_recording_needs_no_list(asked, recorded):
    gateway.diagnose(recorded)
    assert [order.path for order in asked["orders"]] == [recorded]


def test_wrong_options_are_errors(asked, recorded):
    with pytest.raises(gateway.Error, match="given twice"):
        gateway.diagnose([recorded, str(recorded)])
    with pytest.raises(gateway.Error, match="no recording"):
        gateway.diagnose([])
    with pytest.raises(ValueError, match="magic"):
        gateway.diagnose(recorded, model="magic")
    with pytest.raises(ValueError, match="2 to 20"):
        gateway.diagnose(recorded, folds=1)
    with pytest.raises(ValueError, match="at least 1"):
        gateway.diagnose(recorded, jobs=0)
    with pytest.raises(gateway.Error, match="is not in a file") as raised:
        gateway.diagnose(gateway.simulate("lab", duration_s=1.0))
    assert "out=" in raised.value.remedy
    assert not asked


def test_script_needs_no_guard_for_processes(recorded, tmp_path):
    scipy.io.savemat(tmp_path / "x.mat", {"t": np.arange(3.0)})
    script = tmp_path / "script.py"
    script.write_text(
        "import gateway\nprint('begun')\n"
        f"try:\n    gateway.guess_map({str(tmp_path / 'x.mat')!r})\nexcept gateway.Error as error:\n    print(error)\n"
        "from gateway.core.worker_pool import Workers\n"
        "with Workers(1) as workers:\n    print(workers.each[0].submit(abs, -5).result())\n"
    )
    ended = subprocess.run(
        [sys.executable, script],
        capture_output=True, text=True, cwd=Path(gateway.__file__).parents[1], check=True, timeout=120,
        env={**os.environ, "PYTHONPATH": str(Path(gateway.__file__).parents[1])},
    )  # fmt: skip
    assert ended.stdout.count("begun") == 1
    assert "no column looks like" in ended.stdout
    assert ended.stdout.endswith("5\n")


def test_several_wheels_without_a_choice_are_an_error(recorded):
    with pytest.raises(gateway.Error, match="FL"):
        gateway.diagnose(recorded)


def test_report_has_the_figures_of_the_result(tmp_path):
    result = replace(ordinary(), correction=correction("FL"))
    report = DiagnosisReport(result)
    assert report.effects == result.named
    assert report.unexplained == result.unexplained
    assert report.estimates_after["Bs"] == result.estimates_after["Bs"]
    assert report.held_out_rms_mps2 == (result.held_out.rms_before_mps2, result.held_out.rms_after_mps2)
    assert report.summary().splitlines() == closure_summary_lines(result)
    report.report_json(tmp_path / "report.json")
    assert json.loads((tmp_path / "report.json").read_text("utf-8")) == json.loads(json.dumps(report.to_dict()))
    report.save_effects(tmp_path / "fl.json")
    assert load_effects(tmp_path / "fl.json").position == "FL"
    assert repr(report).startswith(f"<DiagnosisReport of {result.wheel}: identified ")


def test_page_is_returned_and_written(tmp_path):
    report, path = DiagnosisReport(empty()), tmp_path / "report.html"
    assert report.report_html(path) == path.read_text("utf-8") == diagnosis_html(empty())
    with pytest.raises(gateway.OutputError, match="already exists"):
        report.report_html(path)


def test_nothing_identified_saves_no_effects(tmp_path):
    with pytest.raises(gateway.Error, match="no effect was identified"):
        DiagnosisReport(empty()).save_effects(tmp_path / "none.json")
    assert list(tmp_path.iterdir()) == []


def test_hostile_names_stay_text_in_a_notebook():
    assert "<script>" not in DiagnosisReport(nasty())._repr_html_()
