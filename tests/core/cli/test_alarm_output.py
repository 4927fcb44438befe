"""Alarms reach every view: plain lines of live and replay, record, the log, summaries and tables."""

import csv
import json
from pathlib import Path

import pytest

from gateway.core.recording.reader import RecordingReader
from tests.testkit.commands import run

LOW = "W1: ALARM at 0.1 s: pressure 210 kPa is below 230 kPa"
# A session hears the silence by its clock, what reads a recording by the next frame.
SESSION_S, RECORDING_S = "4.1 s", "5.0 s"
VEHICLE = """
[tire]
radius_mm = 320
[[wheel]]
hub = 0
wheel = 0
position = "W1"
load_n = 5000
[thresholds]
pressure_min_kpa = 230
"""
SOURCE = "sim:lab?speed=max&duration=8&fault=silence:part=2,at=3"


@pytest.fixture(scope="module")
def vehicle(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("alarms") / "vehicle.toml"
    path.write_text(VEHICLE)
    return path


@pytest.fixture(scope="module")
def recorded(vehicle: Path) -> tuple[Path, str]:
    path = vehicle.parent / "r.mcap"
    return path, run("record", SOURCE, "--config", vehicle, "--out", path)


def has_both(printed: str, silent_s: str = SESSION_S) -> bool:
    summary = printed.partition("alarms\n")[2]
    return (
        LOW in printed
        and f"W1: ALARM at {silent_s}: no samples for" in printed
        and "W1 pressure: from 0.1 s to the end: pressure 210 kPa is below 230 kPa" in summary
        and f"W1 silent: from {silent_s} to the end: no samples for" in summary
    )


def test_live_prints_alarms_as_lines(vehicle: Path) -> None:
    assert has_both(run("live", SOURCE, "--config", vehicle, "--plain"))


def test_record_prints_alarms_once(recorded: tuple[Path, str]) -> None:
    assert has_both(recorded[1])
    assert recorded[1].count(LOW) == 1


def test_replay_prints_alarms_as_lines(recorded: tuple[Path, str]) -> None:
    assert has_both(run("replay", recorded[0], "--speed", "max", "--plain"), RECORDING_S)


def test_recording_keeps_alarms_with_their_values(recorded: tuple[Path, str]) -> None:
    entries = [json.loads(m.data) for m in RecordingReader(recorded[0]).messages() if m.channel.topic == "/log"]
    raised = {entry["values"]["alarm"]["code"]: entry for entry in entries if entry.get("code") == "alarm_raised"}
    assert set(raised) == {"value_below_limit", "samples_silent"}
    assert raised["value_below_limit"]["subject"] == "W1"
    assert raised["value_below_limit"]["level"] == "warning"
    assert raised["value_below_limit"]["values"]["alarm"]["values"] == {
        "quantity": "pressure_pa",
        "value": 210e3,
        "limit": 230e3,
    }


def test_program_log_has_the_alarms(vehicle: Path, tmp_path: Path) -> None:
    log = tmp_path / "log.txt"
    run("--log", log, "live", SOURCE, "--config", vehicle, "--plain")
    assert LOW in log.read_text()


def test_estimate_reports_alarms_and_silence(recorded: tuple[Path, str], tmp_path: Path) -> None:
    rows, table = tmp_path / "rows.json", tmp_path / "rows.csv"
    printed = run("estimate", recorded[0], "--json", rows, "--csv", table)
    summary = printed.partition("alarms\n")[2]
    assert "W1 pressure: from 0." in summary
    assert "W1 silent: from 5.0 s to the end: no samples for 4 s" in summary
    first, *_, low, quiet = map(json.loads, rows.read_text().splitlines())
    assert low["alarm_record"]["code"] == "value_below_limit"
    assert quiet["revolution"] is None
    assert (quiet["position"], quiet["alarm_record"]["code"]) == ("W1", "samples_silent")
    assert quiet["alarm_record"]["standing_at_end"]
    assert quiet["alarm_record"]["first_s"] == pytest.approx(5.0, abs=0.1)
    assert first["alarms"] == "pressure 210 kPa is below 230 kPa"
    (reason,) = first["alarm_reasons"]
    assert (reason["name"], reason["code"]) == ("pressure", "value_below_limit")
    assert reason["values"] == {"quantity": "pressure_pa", "value": 210e3, "limit": 230e3}
    with table.open(newline="") as file:
        assert {row["alarms"] for row in csv.DictReader(file)} == {first["alarms"]}


def test_estimate_gives_the_silence_before_a_revolution(vehicle: Path, tmp_path: Path) -> None:
    recording, rows = tmp_path / "gap.mcap", tmp_path / "rows.json"
    fault = "silence:part=0,at=3,for=4"
    run("simulate", "lab", "--duration", 10, "--fault", fault, "--out", recording)
    printed = run("estimate", recording, "--json", rows)
    assert "hub 0 silent: from 6.0 s to 7." in printed
    results = [json.loads(line) for line in rows.read_text().splitlines()]
    silent = [row["silent_before_s"] for row in results if row["revolution"] is not None]
    assert results[-1]["alarm_record"]["values"]["silence_s"] == pytest.approx(4.0, abs=0.1)
    assert [round(item, 1) for item in silent if item] == [4.0]
