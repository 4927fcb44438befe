"""Tests of `treadlink diagnose` and --effects as a user runs them; the diagnosis itself is tested elsewhere."""

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from gateway.core.clock import ManualClock
from gateway.core.errors import OutputError, TreadlinkError
from gateway.core.reasons import Reason
from gateway.core.recording.file_content import check_distinct
from gateway.core.revolutions.effect_correction import CorrectedEffect, CorrectionTable, EffectParameter
from gateway.core.text import wording
from gateway.diagnosis import campaign_diagnosis
from gateway.diagnosis.campaign import reading_orders
from gateway.diagnosis.closed_loop import SEARCHED
from gateway.diagnosis.data.campaign_data import Campaign
from gateway.diagnosis.effects.effect import BaselineModel
from gateway.diagnosis.effects_file import effects_text, load_effects
from gateway.diagnosis.reasons import DiagnosisCode
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import invoked
from tests.testkit.diagnosis_data import empty, ordinary, undrawn

AT_60 = "[motion]\nspeed_kmh = 60.0"
OMEGA = 60 / 3.6 / 0.32


def table(**changes):
    orders = np.zeros((2, 3, 8), complex)
    orders[:, 2, 3] = [20.0, 45.0 - 10.0j]
    made = CorrectionTable(
        position="W0",
        omega_radps=np.array([0.8, 1.2]) * OMEGA,
        orders_mps2=orders,
        effects=(CorrectedEffect("mounting offset", (EffectParameter("offset_m", 0.004, 1e-6, "m"),)),),
        radius_m=0.32,
        omega_range_radps=(0.8 * OMEGA, 1.2 * OMEGA),
        sensor_id=0xB000,
    )
    return replace(made, **changes)


@pytest.fixture(scope="module")
def recording(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("diagnose") / "steady.mcap", AT_60, duration_s=6.0)


@pytest.fixture(scope="module")
def pair(tmp_path_factory):
    return write_recording(tmp_path_factory.mktemp("diagnose") / "pair.mcap", AT_60, wheels=("", ""), duration_s=4.0)


@pytest.fixture
def closed(monkeypatch):
    """Replace the diagnosis by a prepared result, and record its arguments."""
    asked = []
    answer = [replace(ordinary(), correction=table())]

    def diagnose(campaign, **options):
        asked.append((campaign, options))
        options["on_progress"](0.5, "halfway\x1b[2J")
        return answer[0]

    monkeypatch.setattr("gateway.diagnosis.campaign_diagnosis.diagnose", diagnose)
    # Without --jobs no other process, whose imports would take most of the time.
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    return asked, answer


def run(*arguments):
    return invoked("diagnose", *arguments)


def refused(*arguments):
    result = run(*arguments)
    assert isinstance(result.exception, TreadlinkError), result.output
    assert result.exception.remedy
    return str(result.exception), result.exception.remedy


def test_options_reach_the_diagnosis(closed, recording):
    asked, _ = closed
    result = run(recording, "--model", "paper", "--empirical", "--jobs", "2", "--folds", "4", "--budget", "500")
    assert result.exit_code == 0, result.output
    ((campaign, options),) = asked
    assert isinstance(campaign, Campaign)
    assert campaign.wheel == "W0"
    assert campaign.folds == 4
    assert not campaign.groups[0].conditions.reverse
    assert options["model"] is BaselineModel.PAPER
    assert options["empirical"] is True
    assert not options["expired"]()


def test_result_names_command_and_recordings(closed, recording, tmp_path):
    out = tmp_path / "result one.json"
    assert run(recording, "--model", "paper", "--empirical", "--reverse", recording, "--json", out).exit_code == 0
    origin = json.loads(out.read_text())["origin"]
    words = f"{recording} --model paper --reverse {recording} --json '{out}' --empirical"
    assert origin["command"].split("diagnose ", 1)[1] == words
    (single,) = origin["recordings"]
    assert single["sha256"] == hashlib.sha256(Path(recording).read_bytes()).hexdigest()
    assert 0.0 < single["first_s"] < single["last_s"]


def test_search_ends_with_the_budget(closed, recording):
    asked, _ = closed
    assert run(recording, "--budget", "1e-9").exit_code == 0
    assert asked[0][1]["expired"]()
    assert run(recording).exit_code == 0
    assert not asked[1][1]["expired"]()
    assert run(recording, "--budget", "0").exit_code == 2


def test_budget_counts_reading_and_says_how_long_each_part_took(monkeypatch, recording):
    clock = ManualClock()
    expired = []

    def read(*_, **__):
        clock.advance_ns(3 * 10**9)
        return Campaign("W0", (str(recording),), (), 0, {})

    def diagnose(_, **options):
        expired.append(options["expired"]())
        clock.advance_ns(2 * 10**9)
        expired.append(options["expired"]())
        options["on_progress"](SEARCHED, "computing held-out errors")
        clock.advance_ns(10**9)
        return replace(
            undrawn(),
            complete=False,
            notes=(Reason(DiagnosisCode.SEARCH_ENDED_EARLY, sets=2, untried=("pitch tilt", "toe")),),
        )

    monkeypatch.setattr(campaign_diagnosis, "read_campaign", read)
    monkeypatch.setattr(campaign_diagnosis, "diagnose", diagnose)
    result = campaign_diagnosis.diagnose_recordings(reading_orders([recording]), budget_s=5.0, clock=clock)
    assert expired == [False, True]
    early, spent, *_ = result.notes
    assert early.code is DiagnosisCode.SEARCH_ENDED_EARLY
    assert (spent.code, spent["limit_s"]) == (DiagnosisCode.TIME_LIMIT_SPENT, 5.0)
    assert (spent["reading_s"], spent["search_s"], spent["after_s"]) == pytest.approx((3.0, 2.0, 1.0))
    assert wording.text(spent) == (
        "the limit of 5 s is for reading (3 s), fit and search (2 s): the step under way at the limit was finished. "
        "Test on unseen revolutions and figures are not counted (1 s)"
    )
    assert campaign_diagnosis.diagnose_recordings(reading_orders([recording]), clock=clock).notes == (early,)


def test_summary_and_all_files_are_written(closed, recording, tmp_path):
    json_path, html_path, effects_path = (tmp_path / name for name in ("a.json", "a.html", "a.effects.json"))
    result = run(recording, "--json", json_path, "--html", html_path, "--save-effects", effects_path)
    assert result.exit_code == 0, result.output
    lines = result.output.splitlines()
    assert sum(line.startswith("written: ") for line in lines) == 3
    assert 8 <= len(lines) - 3 <= 18
    assert "held-out rms" in result.output
    assert "\x1b" not in result.output
    figures = json.loads(json_path.read_text())
    assert figures["held_out"]["rms_before_mps2"] == pytest.approx(ordinary().held_out.rms_before_mps2)
    assert html_path.read_text().startswith("<!doctype html>")
    assert load_effects(effects_path).effects == table().effects


def test_notes_on_recordings_are_reported(closed, recording, tmp_path):
    """Two recordings with the same start time."""
    again = write_recording(tmp_path / "again.mcap", AT_60, seed=7, duration_s=4.0)
    out = tmp_path / "a.json"
    assert run(recording, again, "--json", out, "--jobs", "1").exit_code == 0
    assert "in the order of the command" in out.read_text()


def test_reverse_recordings_must_be_among_the_recordings(closed, recording):
    asked, _ = closed
    assert run(recording, "--reverse", recording).exit_code == 0
    assert asked[0][0].groups[0].conditions.reverse
    message, _ = refused(recording, "--reverse", "other.mcap")
    assert "other.mcap" in message


def test_several_wheels_require_a_choice(closed, pair):
    message, remedy = refused(pair)
    assert "W0, W1" in message
    assert "--wheel" in remedy
    assert run(pair, "--wheel", "W1").exit_code == 0
    assert closed[0][0][0].wheel == "W1"


def test_invalid_arguments_are_reported_before_the_work(closed, recording, tmp_path):
    asked, _ = closed
    there = tmp_path / "there.json"
    there.write_text("precious")
    assert "already exists" in refused(recording, "--json", there)[0]
    assert "exact" in refused(recording, "--model", "paper", "--save-effects", tmp_path / "e.json")[0]
    assert "given twice" in refused(recording, recording)[0]
    assert "no folder" in refused(recording, "--html", tmp_path / "none" / "a.html")[0]
    for output in ("--json", "--html"):
        assert "is an input" in refused(recording, "--effects", there, output, there, "--force")[0]
    assert asked == []
    assert there.read_text() == "precious"
    assert run(recording, "--json", there, "--force").exit_code == 0
    assert there.read_text() != "precious"


def test_missing_recordings_and_unknown_models_are_reported(closed, tmp_path):
    assert "does not exist" in refused(tmp_path / "absent.mcap")[0]
    assert run().exit_code == 2
    assert run(tmp_path / "a.mcap", "--model", "cubic").exit_code == 2
    assert closed[0] == []


def test_effects_file_requires_an_identified_effect(closed, recording, tmp_path):
    closed[1][0] = replace(empty(), correction=None)
    out, effects = tmp_path / "a.json", tmp_path / "e.json"
    message, _ = refused(recording, "--json", out, "--save-effects", effects)
    assert "no effect was identified" in message
    assert out.exists()
    assert not effects.exists()


def test_saved_and_unsaved_effects_are_reported(closed, recording, tmp_path):
    first = replace(ordinary().findings[0], name="mounting offset")
    ply_steer = replace(first, name="ply steer")
    closed[1][0] = replace(ordinary(), findings=(first, ply_steer), correction=table())
    path = tmp_path / "e.json"
    lines = run(recording, "--save-effects", path).output.splitlines()
    assert lines[-1] == f"written: {path} with mounting offset; ply steer is left for the estimators to measure"


def test_one_unwritable_file_does_not_prevent_the_others(closed, recording, tmp_path, monkeypatch):
    def full(*_arguments, **_options):
        raise OutputError("the disk is full", "Free some space.")

    monkeypatch.setattr("gateway.diagnosis.views.diagnosis_json.write_whole", full)
    closed[1][0] = replace(empty(), correction=None)
    html, effects = tmp_path / "a.html", tmp_path / "e.json"
    result = run(recording, "--json", tmp_path / "a.json", "--html", html, "--save-effects", effects)
    assert str(result.exception) == "the disk is full"
    assert f"written: {html}" in result.output
    assert f"'{effects}' is not written: no effect was identified. live and" in result.output
    assert html.exists()


def test_outputs_need_different_names(closed, recording, tmp_path):
    path = tmp_path / "a"
    message, remedy = refused(recording, "--json", path, "--html", tmp_path / "." / "a")
    assert "one file" in message
    assert "a name of its own" in remedy
    assert closed[0] == []
    assert run(recording, "--json", "/dev/null", "--save-effects", "/dev/null").exit_code == 0


def test_folder_is_not_a_recording(closed, tmp_path):
    message, remedy = refused(tmp_path)
    assert "is a folder" in message
    assert "*.mcap" in remedy


class TestEffectsFiles:
    @pytest.fixture
    def saved(self, closed, recording, tmp_path):
        path = tmp_path / "w0.effects.json"
        assert run(recording, "--save-effects", path).exit_code == 0
        return path

    def radial_of(self, path, recording, *more):
        out = path.with_suffix(".csv")
        result = invoked("estimate", recording, "--csv", out, "--force", *more)
        assert result.exit_code == 0, result.exception
        return out.read_text(), result.output

    def test_estimate_subtracts_and_reports_effects(self, saved, recording, tmp_path):
        plain, _ = self.radial_of(tmp_path / "plain", recording)
        freed, printed = self.radial_of(tmp_path / "freed", recording, "--effects", saved)
        assert "subtracted from its axes: mounting offset" in printed
        assert plain.splitlines()[0] == freed.splitlines()[0]
        assert plain.splitlines()[-1] != freed.splitlines()[-1]

    def test_effects_beyond_their_load_range_are_not_subtracted(self, closed, recording, tmp_path):
        closed[1][0] = replace(ordinary(), correction=table(load_range_n=(3000.0, 4000.0)))
        path = tmp_path / "w0.effects.json"
        assert run(recording, "--save-effects", path).exit_code == 0
        _, printed = self.radial_of(tmp_path / "off", recording, "--effects", path)
        assert "NOT subtracted from its axes: mounting offset: 5000 N is outside the 3000 N to 4000 N" in printed
        result = invoked("replay", recording, "--speed", "max", "--plain", "--effects", path)
        assert "W0: subtracted from its axes at 48 km/h to 72 km/h, 3000 to 4000 N: mounting offset" in result.output

    def test_replay_subtracts_effects_reproducibly(self, saved, recording, tmp_path):
        def lines(*more):
            arguments = ["replay", str(recording), "--speed", "max", "--plain", *map(str, more)]
            result = invoked(*arguments)
            assert result.exit_code == 0, result.exception
            return [line for line in result.output.splitlines() if line.startswith("W0 ")]

        corrected = lines("--effects", saved)
        assert corrected != lines()
        assert corrected == lines("--effects", saved)

    def test_estimate_notes_another_vehicle(self, recording, tmp_path):
        path = tmp_path / "w0.effects.json"
        path.write_text(effects_text(table(vehicle="test car")))
        car = tmp_path / "car.toml"
        car.write_text(
            '[vehicle]\nname = "other"\n[tire]\nradius_mm = 320\n[[wheel]]\nposition = "W0"\nhub = 0\nwheel = 0\n'
        )
        _, printed = self.radial_of(tmp_path / "other", recording, "--effects", path, "--config", car)
        assert "W0: the effects were identified on vehicle test car, but this is other" in printed

    def test_effects_of_another_vehicle_are_rejected(self, saved, tmp_path):
        other = write_recording(tmp_path / "bare.mcap", AT_60, duration_s=3.0, configured=False)
        result = invoked("estimate", other, "--effects", saved)
        assert isinstance(result.exception, TreadlinkError)
        assert "no configuration" in str(result.exception)


def test_effects_of_another_recording_have_a_page(recording, tmp_path):
    path, page = tmp_path / "w0.effects.json", tmp_path / "a.html"
    path.write_text(effects_text(table()))
    result = run(recording, "--effects", path, "--html", page)
    assert result.exit_code == 0, result.output
    assert f"written: {page}" in result.output
    text = page.read_text()
    assert f"as found in {path}" in text
    assert hashlib.sha256(Path(recording).read_bytes()).hexdigest() in text


def test_effects_of_another_recording_exclude_a_search(closed, recording, tmp_path):
    path = tmp_path / "w0.effects.json"
    assert run(recording, "--save-effects", path).exit_code == 0
    result = run(recording, "--effects", path, "--empirical")
    assert result.exit_code == 2
    assert "--empirical" in result.output
    for ignored in (("--wheel", "W0"), ("--budget", "5")):
        result = run(recording, "--effects", path, *ignored)
        assert result.exit_code == 2
        assert "leave out --wheel, --budget and --self-test" in result.output


@pytest.mark.parametrize(
    "command", [("diagnose",), ("estimate",), ("orders",), ("replay", "--speed", "max", "--plain")]
)
def test_every_command_checks_the_effects_alike(recording, tmp_path, command):
    def refusal(effects, change=lambda text: text):
        path = tmp_path / "w0.effects.json"
        path.write_text(change(effects_text(table(effects=effects))))
        arguments = [command[0], str(recording), *command[1:], "--effects", str(path)]
        result = invoked(*arguments)
        assert isinstance(result.exception, TreadlinkError), result.output
        assert result.exception.remedy
        return str(result.exception)

    offset = EffectParameter("offset_m", 0.004, 1e-6, "m")
    assert "no effect 'flux capacitor'" in refusal((CorrectedEffect("flux capacitor"),))
    in_mm = replace(offset, value=4.0, unit="mm")
    assert "is in mm, not in m" in refusal((CorrectedEffect("mounting offset", (in_mm,)),))
    far = replace(offset, value=0.4)
    assert "outside its plausible range" in refusal((CorrectedEffect("mounting offset", (far,)),))
    reference = (CorrectedEffect("mounting offset", (offset,)),)
    assert "was edited after diagnose" in refusal(reference, lambda text: text.replace("0.004", "0.008"))


def test_list_effects_needs_no_recording():
    listed = run("--list-effects")
    assert listed.exit_code == 0, listed.output
    assert "SENSOR RESPONSE" in listed.output
    single = run("--list-effects", "yaw")
    assert "yaw tilt" in single.output
    assert "SENSOR RESPONSE" not in single.output
    assert {"name", "equation", "confounders"} <= json.loads(run("--list-effects", "json").output)[0].keys()
    assert run("--list-effects", "markdown").output.startswith("# Effects\n")
    message, _ = refused("--list-effects", "nonsense")
    assert "nonsense" in message


def test_copies_are_recognised_by_content(closed, recording, tmp_path):
    copy = tmp_path / "again.mcap"
    copy.write_bytes(recording.read_bytes())
    message, remedy = refused(recording, copy)
    assert f"'{copy}' is a copy of '{recording}'" in message
    assert remedy == "Give each recording once."
    assert refused(recording, copy, "--effects", tmp_path / "e.json")[0] == message
    assert closed[0] == []
    # Of the same size only.
    copy.write_bytes(recording.read_bytes()[:-1] + b"\0")
    check_distinct([recording, copy])
