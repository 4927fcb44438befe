"""Campaigns with a real worker process: what is estimated, once, and what survives faults."""

import json
import math
import shutil
import threading
from collections import Counter
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

from gateway.core.errors import OutputError, RecordingError, TreadlinkError
from gateway.core.estimates.wheel_setup import CorrectedEffect, CorrectionTable, EffectParameter
from gateway.core.recording.reader import RecordingReader
from gateway.core.session.recording_pass import RecordingPass, open_recording
from gateway.fleet.campaign_run import CampaignProgress, find_recordings
from gateway.fleet.recording_estimation import RowsKept
from tests.fleet.conftest import ESTIMATORS
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.faulty_work import faulty_work

EFFECTS = CorrectionTable(
    position="W0",
    omega_radps=np.array([60.0, 80.0]),
    orders_mps2=np.zeros((2, 3, 8), complex),
    effects=(CorrectedEffect("mounting offset", (EffectParameter("offset_m", 0.004, 1e-6, "m"),)),),
    radius_m=0.32,
    omega_range_radps=(60.0, 80.0),
    vehicle="van 7",
)


def rows(tmp_path: Path, table: str) -> list[dict[str, Any]]:
    """Return all rows of a table."""
    results = []
    for path in sorted((tmp_path / "dataset" / table).rglob("*.parquet")):
        with pq.ParquetFile(path) as file:
            results += file.read().to_pylist()
    return results


def names(tmp_path: Path, table: str = "recordings") -> list[str]:
    return sorted(row["recording"] for row in rows(tmp_path, table))


def is_whole(tmp_path: Path) -> bool:
    """Return whether every recording is there once, with all its tables, and nothing is left behind."""
    dataset = tmp_path / "dataset"
    summaries = Counter(row["recording_id"] for row in rows(tmp_path, "recordings"))
    of_revolutions = {row["recording_id"] for row in rows(tmp_path, "revolutions")}
    reference = {".lock", "treadlink-dataset.json", "recordings", "revolutions", "failures"}
    return (
        set(summaries.values()) <= {1}
        and of_revolutions == set(summaries)
        and {path.name for path in dataset.iterdir()} <= reference
    )


def test_rows_equal_those_of_estimate(campaign, recordings, tmp_path):
    path = recordings / "drive0.mcap"
    progress = campaign(path, rows=RowsKept.ALL)
    direct = list(RecordingPass(open_recording(RecordingReader(path)), ESTIMATORS, is_watched=False))
    results = sorted(rows(tmp_path, "revolutions"), key=lambda row: row["revolution"])
    assert progress.estimated == 1
    assert len(results) == len(direct) > 10
    for row, result in zip(results, direct, strict=True):
        softness = next(estimate for estimate in result.estimates if estimate.name == "Bs")
        assert row["host_ns"] == result.host_ns
        assert row["position"] == "W0"
        assert row["Bs"] == (pytest.approx(softness.value, rel=1e-6) if math.isfinite(softness.value) else None)
        assert row["Bs_status"] == softness.status
    (summary,) = rows(tmp_path, "recordings")
    assert summary["revolutions"] == len(direct)
    assert summary["sensor_id"] == "0000b000"
    assert summary["distance_m"] == pytest.approx(len(direct) * 2.0 * 3.14159265 * 0.32)
    assert summary["speed_mps"] == pytest.approx(80.0 / 3.6, rel=1e-3)
    assert summary["Bs"] == pytest.approx(3.08e-3, rel=0.1)
    assert summary["Bs_status"] == "valid"
    assert min(row["Bs_std"] for row in results if row["Bs_std"]) <= summary["Bs_std"]
    assert summary["start_utc"].isoformat().startswith("2023-11-14T22:13:20")


def test_second_run_estimates_nothing(campaign, recordings, tmp_path):
    assert campaign(recordings).estimated == 3
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / "dataset").rglob("*.parquet")}
    again = campaign(recordings)
    assert (again.estimated, again.done_before, again.files_left) == (0, 3, 0)
    assert {path: path.stat().st_mtime_ns for path in (tmp_path / "dataset").rglob("*.parquet")} == before


def test_renamed_copied_and_changed_files(campaign, recordings, made, tmp_path):
    campaign(recordings / "drive0.mcap")
    (recordings / "drive0.mcap").rename(recordings / "moved.mcap")
    shutil.copy(recordings / "moved.mcap", recordings / "copy.mcap")
    campaign_read = campaign(recordings / "moved.mcap", recordings / "copy.mcap", recordings / "drive1.mcap")
    assert (campaign_read.estimated, campaign_read.done_before, campaign_read.copies) == (1, 1, 1)
    assert names(tmp_path) == ["drive0.mcap", "drive1.mcap"]
    # The renamed file changes: its old rows go, wherever they came from.
    shutil.copy(made / "drive2.mcap", recordings / "moved.mcap")
    (recordings / "copy.mcap").unlink()
    assert campaign(recordings / "moved.mcap").estimated == 1
    assert names(tmp_path) == ["drive1.mcap", "moved.mcap"]
    assert is_whole(tmp_path)


def test_copy_keeps_rows_of_changed_original(campaign, recordings, made, tmp_path):
    shutil.copy(recordings / "drive0.mcap", recordings / "copy.mcap")
    campaign(recordings / "drive0.mcap", recordings / "copy.mcap")
    shutil.copy(made / "drive1.mcap", recordings / "drive0.mcap")
    campaign(recordings / "copy.mcap", recordings / "drive0.mcap")
    assert len(rows(tmp_path, "recordings")) == 2
    shutil.copy(made / "drive2.mcap", recordings / "drive0.mcap")
    campaign(recordings / "drive0.mcap", recordings / "copy.mcap")
    assert len(rows(tmp_path, "recordings")) == 2
    assert is_whole(tmp_path)


def test_new_file_with_the_name_of_a_renamed_one_replaces_nothing(campaign, recordings, workers, tmp_path, monkeypatch):
    first, moved = recordings / "run.mcap", recordings / "run_old.mcap"
    (recordings / "drive0.mcap").rename(first)
    campaign(first)
    first.rename(moved)
    (recordings / "drive1.mcap").rename(first)
    is_found = threading.Event()

    def on_progress(progress: CampaignProgress) -> None:
        if progress.done_before:
            is_found.set()

    # The renamed file is found while a worker has the new one.
    wait = workers.wait
    monkeypatch.setattr(workers, "places", lambda: 2)
    monkeypatch.setattr(workers, "wait", lambda timeout_s: wait(timeout_s) if is_found.is_set() else None)
    campaign_read = campaign(first, moved, on_progress=on_progress)
    assert (campaign_read.estimated, campaign_read.done_before) == (1, 1)
    assert len(rows(tmp_path, "recordings")) == 2
    assert is_whole(tmp_path)


def test_exchanged_names_are_followed(campaign, recordings, made, tmp_path):
    first, second = recordings / "drive0.mcap", recordings / "drive1.mcap"
    campaign(first, second)
    shutil.copy(made / first.name, second)
    shutil.copy(made / second.name, first)
    assert campaign(first, second).done_before == 2
    shutil.copy(made / "drive2.mcap", first)
    campaign(first)
    assert names(tmp_path) == ["drive0.mcap", "drive0.mcap"]
    assert is_whole(tmp_path)


def test_other_code_on_a_worker_is_an_error(campaign, recordings, tmp_path):
    with pytest.raises(TreadlinkError, match="another version of the estimators"):
        campaign(recordings / "drive0.mcap", code="other")
    assert rows(tmp_path, "recordings") == rows(tmp_path, "failures") == []


def test_other_settings_need_another_dataset(campaign, recordings):
    campaign(recordings / "drive0.mcap")
    with pytest.raises(OutputError, match="other estimators: kinematic, weak-form, wear; now: kinematic"):
        campaign(recordings / "drive0.mcap", estimators=("kinematic",))
    with pytest.raises(OutputError, match="other kept rows: second; now: none"):
        campaign(recordings / "drive0.mcap", rows=RowsKept.NONE)


def test_bad_file_is_a_failure_row(campaign, recordings, made, tmp_path):
    bad = recordings / "bad.mcap"
    bad.write_text("no recording")
    (recordings / "empty.mcap").write_bytes(b"")
    failures: list[Path] = []
    campaign_read = campaign(recordings, on_failure=lambda path, _: failures.append(path))
    assert (campaign_read.estimated, campaign_read.failed) == (3, 2)
    assert sorted(path.name for path in failures) == ["bad.mcap", "empty.mcap"]
    row = next(row for row in rows(tmp_path, "failures") if row["recording"] == "bad.mcap")
    assert row["code"] == "recording_not_read"
    assert "does not start like an MCAP file" in row["text"]
    assert row["remedy"]
    assert row["is_final"]
    assert json.loads(row["values"])["message"] in row["text"]
    again = campaign(recordings)
    assert (again.failed, again.failed_before, again.done_before) == (0, 2, 3)
    assert campaign(bad, retries_failed=True).failed == 1
    shutil.copy(made / "drive0.mcap", bad)
    (recordings / "drive0.mcap").unlink()
    assert campaign(recordings).failed_before == 1
    assert names(tmp_path, "failures") == ["empty.mcap"]
    assert is_whole(tmp_path)


def test_a_link_to_nothing_is_a_failure(campaign, recordings, tmp_path):
    (recordings / "gone.mcap").symlink_to(recordings / "nothing")
    (recordings / "folder.mcap").mkdir()
    assert [path.name for path in find_recordings([recordings])][-1] == "gone.mcap"
    campaign_read = campaign(recordings / "drive0.mcap", recordings)
    assert (campaign_read.estimated, campaign_read.failed) == (3, 1)
    (row,) = rows(tmp_path, "failures")
    assert (row["recording"], row["is_final"]) == ("gone.mcap", False)


def test_damaged_and_standing_recordings_have_rows(campaign, recordings, tmp_path):
    whole = (recordings / "drive0.mcap").read_bytes()
    (recordings / "cut.mcap").write_bytes(whole[: len(whole) * 3 // 4])
    write_recording(
        recordings / "standing.mcap",
        "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 0\n",
        wheels=("load_n = 4000\n",),
        duration_s=2.5,
    )
    campaign_read = campaign(recordings / "cut.mcap", recordings / "standing.mcap")
    assert (campaign_read.estimated, campaign_read.failed, [path.name for path in campaign_read.damaged]) == (
        2,
        0,
        ["cut.mcap"],
    )
    cut, standing = sorted(rows(tmp_path, "recordings"), key=lambda row: row["recording"])
    assert json.loads(cut["damage"])["code"] == "recording_cut_off"
    assert cut["revolutions"] > 3
    assert standing["revolutions"] == 0
    assert json.loads(standing["missing"])["code"] == "no_revolution"
    assert standing["damage"] is None
    assert standing["samples"] > 4000
    assert [(path.name, position) for path, position, _ in campaign_read.standing] == [("standing.mcap", "W0")]
    assert "the wheel stands still" in campaign_read.standing[0][2]
    again = campaign(recordings / "standing.mcap", recordings / "cut.mcap")
    assert (again.done_before, again.damaged, again.standing) == (2, campaign_read.damaged, campaign_read.standing)


def test_effects_of_another_vehicle_are_noted(campaign, recordings, tmp_path):
    campaign_read = campaign(recordings, effects=(EFFECTS,))
    assert (campaign_read.estimated, campaign_read.failed) == (3, 0)
    noted = {
        row["recording"]: [alarm["text"] for alarm in json.loads(row["alarms"] or "[]")]
        for row in rows(tmp_path, "recordings")
        if row["alarm_count"]
    }
    assert noted == {"drive2.mcap": ["the effects were identified on vehicle van 7, but this is a/b=c ü"]}
    assert campaign_read.alarms == {"effects of another tire": 1}


def test_effects_of_a_silent_wheel_are_noted_on_no_other(campaign, tmp_path):
    folder = tmp_path / "silent"
    folder.mkdir()
    silent = '\n[[wheel]]\nposition = "W9"\nhub = 0\nwheel = 9\ntire.radius_mm = 320.0\n'
    tables = "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 80\n"
    write_recording(
        folder / "drive.mcap",
        tables,
        duration_s=1.6,
        change=lambda toml: toml.replace('name = ""', 'name = "bus"') + silent,
    )
    campaign_read = campaign(folder, effects=(replace(EFFECTS, position="W9"),))
    assert campaign_read.estimated == 1
    assert "effects of another tire" not in campaign_read.alarms


def test_effects_need_a_configuration(campaign, tmp_path):
    folder = tmp_path / "plain"
    folder.mkdir()
    write_recording(folder / "plain.mcap", "[motion]\nspeed_kmh = 80\n", duration_s=1.0, configured=False)
    assert campaign(folder, effects=(EFFECTS,)).failed == 1
    (row,) = rows(tmp_path, "failures")
    assert "the effects belong to wheel W0, but there is no configuration" in row["text"]
    assert row["is_final"]


@pytest.mark.parametrize("table", ["recordings", "revolutions"])
def test_damaged_or_missing_rows_are_estimated_again(campaign, recordings, tmp_path, table):
    campaign(recordings)
    first, second, _ = sorted((tmp_path / "dataset" / table).rglob("*.parquet"))
    first.write_bytes(first.read_bytes()[:-20])
    if table == "revolutions":
        second.unlink()
    campaign_read = campaign(recordings)
    lost = 1 + (table == "revolutions")
    assert (campaign_read.restored, campaign_read.estimated, campaign_read.done_before) == (lost, lost, 3 - lost)
    assert len(names(tmp_path)) == 3
    assert is_whole(tmp_path)


def test_killed_worker_is_tried_once_more(campaign, recordings, tmp_path):
    shutil.move(recordings / "drive0.mcap", recordings / "killed_once.mcap")
    shutil.move(recordings / "drive1.mcap", recordings / "killed.mcap")
    campaign_read = campaign(recordings, work=faulty_work)
    assert (campaign_read.estimated, campaign_read.failed) == (2, 1)
    (row,) = rows(tmp_path, "failures")
    assert (row["recording"], row["code"], row["attempts"]) == ("killed.mcap", "worker_ended", 2)
    assert not row["is_final"]
    assert names(tmp_path) == ["drive2.mcap", "killed_once.mcap"]
    assert is_whole(tmp_path)
    # The circumstances have changed: the next campaign tries it without being asked to.
    assert campaign(recordings).estimated == 1
    assert rows(tmp_path, "failures") == []


@pytest.mark.slow
def test_worker_out_of_memory_is_a_failure(campaign, recordings, tmp_path):
    shutil.move(recordings / "drive0.mcap", recordings / "hog.mcap")
    campaign_read = campaign(recordings, work=faulty_work)
    assert (campaign_read.estimated, campaign_read.failed) == (2, 1)
    (row,) = rows(tmp_path, "failures")
    assert (row["code"], row["attempts"]) == ("worker_memory_above_limit", 2)
    assert "500 MB" in row["text"]
    assert is_whole(tmp_path)


def test_memory_error_is_tried_once_more(campaign, recordings, tmp_path):
    shutil.move(recordings / "drive0.mcap", recordings / "memory_error.mcap")
    assert campaign(recordings / "memory_error.mcap", work=faulty_work).failed == 1
    (row,) = rows(tmp_path, "failures")
    assert (row["code"], row["attempts"]) == ("worker_memory_full", 2)


def test_full_disk_leaves_a_whole_dataset(campaign, recordings, tmp_path):
    campaign(recordings / "drive0.mcap")
    shutil.move(recordings / "drive1.mcap", recordings / "full_disk.mcap")
    with pytest.raises(OutputError, match="cannot be written: File too large"):
        campaign(recordings, work=faulty_work)
    assert is_whole(tmp_path)
    assert campaign(recordings).files == 3
    assert len(names(tmp_path)) == 3


def test_stop_leaves_a_whole_dataset(campaign, recordings, tmp_path):
    stop = threading.Event()

    def after_first(progress: CampaignProgress) -> None:
        if progress.estimated:
            stop.set()

    # What other processes work on when the stop comes may still end.
    stopped = campaign(recordings, stop=stop, on_progress=after_first).estimated
    assert 1 <= stopped <= 3
    assert is_whole(tmp_path)
    again = campaign(recordings)
    assert (again.done_before, again.estimated) == (stopped, 3 - stopped)
    assert is_whole(tmp_path)


def test_file_that_changes_meanwhile_is_tried_again(campaign, recordings, tmp_path):
    path = (recordings / "drive0.mcap").rename(recordings / "grows.mcap")
    assert campaign(path, work=faulty_work).failed == 1
    (row,) = rows(tmp_path, "failures")
    assert (row["code"], row["is_final"]) == ("recording_changed", False)


def test_time_left_rests_on_bytes():
    progress = CampaignProgress(files=100, files_left=1, total_bytes=1000, done_bytes=250, elapsed_s=10.0)
    assert progress.left_s == pytest.approx(30.0)
    assert CampaignProgress(total_bytes=1000).left_s is None


def test_recordings_are_found_in_folders(recordings):
    (recordings / "notes.txt").write_text("")
    (recordings / ".hidden.mcap").write_text("")
    assert [path.name for path in find_recordings([recordings])] == ["drive0.mcap", "drive1.mcap", "drive2.mcap"]
    with pytest.raises(RecordingError, match="does not exist"):
        find_recordings([recordings / "missing"])
    (recordings / "empty").mkdir()
    with pytest.raises(RecordingError, match="no recording in"):
        find_recordings([recordings / "empty"])


def test_error_of_the_thread_that_identifies_files_ends_the_campaign(campaign, recordings, monkeypatch):
    def failing(path, end):
        raise ZeroDivisionError("while hashing")

    monkeypatch.setattr("gateway.fleet.campaign_run.read_content", failing)
    with pytest.raises(ZeroDivisionError, match="while hashing"):
        campaign(recordings)
