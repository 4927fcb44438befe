"""The commands campaign and trends as a user runs them."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from concurrent.futures import Future
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
from click.testing import CliRunner

from gateway.core.cli import treadlink
from gateway.core.errors import ConfigError, OutputError
from gateway.core.estimates.estimator import Status
from gateway.core.reasons import Reason
from gateway.core.recording.file_content import FileContent, read_content
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.diagnosis.result import Diagnosis
from gateway.fleet.dataset import Dataset, Description, opened
from gateway.fleet.local_tasks import LocalTasks
from gateway.fleet.recording_estimation import estimate_names
from gateway.fleet.tire_diagnoses import (
    MOST_RECORDINGS,
    DiagnosisOrder,
    TireOutcome,
    _chosen,
    _tires,
    diagnose_tire,
    diagnose_tires,
    outcome_in,
)
from gateway.fleet.worker_tasks import RunningTask, WorkerTasks
from tests.fleet.conftest import MEMORY_BYTES
from tests.fleet.test_campaign_run import is_whole, names, rows
from tests.testkit.campaign_recordings import write_recording
from tests.testkit.commands import invoked, run
from tests.testkit.diagnosis_data import undrawn

ROOT = Path(__file__).parents[2]
FEW = ("--estimator", "kinematic", "--estimator", "weak-form", "--jobs", "1")


def command(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "gateway.core.cli", *map(str, arguments)]


@pytest.fixture
def started(workers, monkeypatch):
    """Let commands of the test's process use the worker that has started already."""
    monkeypatch.setattr("gateway.fleet.local_tasks.LocalTasks", lambda *_: nullcontext(workers))


@pytest.mark.usefixtures("started")
def test_campaign_and_trends_end_to_end(recordings, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (recordings / "bad.mcap").write_text("no recording")
    arguments = ["campaign", str(recordings), "--out", "dataset", *FEW]
    done = invoked(*arguments)
    assert done.exit_code == 1, done.output
    assert "3 recordings estimated" in done.output
    assert "bad.mcap' is not a recording" in done.output
    assert is_whole(tmp_path)
    printed = run("trends", "dataset", "--html", "t.html", "--json", "t.json", "--csv", "t.csv")
    assert "2 tires of 2 vehicles, 3 recordings, 2023-11-14 to 2023-11-16 (UTC)" in printed
    assert json.loads(Path("t.json").read_text())["failures"] == 1
    assert Path("t.csv").read_text().count("\n") > 40
    assert "a/b=c ü" in Path("t.html").read_text()
    again = invoked("trends", "dataset", "--html", "t.html")
    assert isinstance(again.exception, OutputError)


def told_twice(recordings, tmp_path):
    """Yield what a campaign prints of recordings that lack something, now and when they are known; its status is 1."""
    arguments = ["campaign", str(recordings), "--out", str(tmp_path / "dataset"), *FEW]
    for _ in range(2):
        done = invoked(*arguments)
        assert done.exit_code == 1, done.output
        yield done.output


@pytest.mark.usefixtures("started")
def test_a_wheel_without_a_revolution_is_told_by_status_and_line(recordings, tmp_path):
    write_recording(
        recordings / "standing.mcap",
        "[sensor]\nrate_hz = 2000\n[motion]\nspeed_kmh = 0\n",
        wheels=("load_n = 4000\n",),
        duration_s=2.5,
    )
    for output in told_twice(recordings, tmp_path):
        assert "1 wheel without a revolution" in output
        assert "standing.mcap W0: no revolution is complete in 2.5 s of samples: the wheel stands still" in output


@pytest.mark.usefixtures("started")
def test_a_damaged_recording_is_told_by_status_and_line(recordings, tmp_path):
    cut = recordings / "drive0.mcap"
    cut.write_bytes(cut.read_bytes()[: cut.stat().st_size * 3 // 4])
    for output in told_twice(recordings, tmp_path):
        assert "1 damaged: only the readable part is estimated; `treadlink repair` recovers more\n" in output
        assert f"  {cut}: see treadlink inspect\n" in output


@pytest.mark.usefixtures("started")
def test_a_damaged_recording_without_a_readable_sample_is_a_failure(recordings, tmp_path):
    path = recordings / "drive0.mcap"
    content = bytearray(path.read_bytes())
    content[3_000:] = bytes(len(content) - 3_000)
    path.write_bytes(content)
    output, _ = told_twice(recordings, tmp_path)
    assert "2 recordings estimated" in output
    assert "bytes are not read" in output
    (failure,) = rows(tmp_path, "failures")
    assert (failure["code"], failure["is_final"]) == ("recording_nothing_readable", True)
    assert "no samples were received" in failure["text"] or "no frame was received" in failure["text"]
    assert "treadlink repair" in failure["remedy"]
    assert len(names(tmp_path)) == 2


@pytest.mark.usefixtures("started")
def test_one_recording_is_one(recordings, tmp_path):
    arguments = ["campaign", str(recordings / "drive0.mcap"), "--out", str(tmp_path / "dataset"), *FEW]
    done = invoked(*arguments)
    assert done.output.startswith("1 recording estimated")


def no_workers(*_: object) -> None:
    raise AssertionError("nothing is to be estimated")


def test_no_worker_starts_when_nothing_is_to_do(campaign, recordings, tmp_path, monkeypatch):
    campaign(recordings, estimators=("kinematic", "weak-form"))
    runner = CliRunner()
    monkeypatch.setattr("gateway.fleet.local_tasks.LocalTasks", no_workers)
    result = runner.invoke(treadlink, ["campaign", str(recordings), "--out", str(tmp_path / "dataset"), *FEW])
    assert result.exit_code == 0, result.output
    assert "3 done before" in result.output


def test_unreachable_scheduler_is_an_error(recordings, tmp_path, monkeypatch):
    monkeypatch.setattr("gateway.fleet.scheduler_tasks._CONNECT_S", 0.5)
    arguments = ["campaign", str(recordings), "--out", str(tmp_path / "dataset"), "--scheduler", "tcp://127.0.0.1:9"]
    result = invoked(*arguments)
    assert invoked(*arguments, "--jobs", "2").exit_code == 2
    assert "no dask scheduler answers at 'tcp://127.0.0.1:9'" in str(result.exception)


def end_at_once() -> None:
    os._exit(1)


def test_worker_that_ends_as_it_starts_is_an_error(recordings, tmp_path, monkeypatch):
    monkeypatch.setattr("gateway.fleet.local_tasks._ignore_interrupt", end_at_once)
    result = invoked("campaign", recordings, "--out", tmp_path / "dataset", *FEW)
    assert "the worker processes did not start" in str(result.exception)


def test_signal_that_ends_a_starting_worker_ends_the_campaign(recordings, tmp_path, monkeypatch):
    class Signalled(LocalTasks):
        def wait(self, timeout_s: float) -> None:
            os.kill(os.getpid(), signal.SIGTERM)
            super().wait(60.0)

    monkeypatch.setattr("gateway.fleet.local_tasks._ignore_interrupt", end_at_once)
    monkeypatch.setattr("gateway.fleet.local_tasks.LocalTasks", Signalled)
    result = invoked("campaign", recordings, "--out", tmp_path / "dataset", *FEW)
    assert result.exit_code == 143, result.output


def test_workers_ignore_the_interrupt(workers):
    assert done(workers, interrupt_handler, None) == signal.SIG_IGN


def interrupt_handler(_order: object, _report: object) -> object:
    return signal.getsignal(signal.SIGINT)


def test_the_local_campaign_opens_no_socket():
    """Whoever reaches a port of workers could run programs as the owner of the campaign."""
    # Of other tests in this process.
    before = addresses(os.getpid())
    with LocalTasks(1, MEMORY_BYTES) as tasks:
        assert set(map(tuple, done(tasks, sockets, os.getpid()))) <= before


def sockets(parent: int, _report: object) -> list[tuple[str, int]]:
    with socket.socket() as mine:  # what is looked for can be seen
        mine.bind(("127.0.0.1", 0))
        mine.listen()
        assert mine.getsockname() in addresses(os.getpid())
    return sorted(addresses(parent) | addresses(os.getpid()))


def addresses(pid: int) -> set[tuple[str, int]]:
    """Return the local addresses of the sockets of a process."""
    import psutil

    return {tuple(each.laddr) for each in psutil.Process(pid).net_connections("inet")}


def done(tasks: LocalTasks, work: object, order: object) -> object:
    """Return the outcome of one task."""
    tasks.submit("one", work, order)
    while (result := tasks.wait(1.0)) is None:
        pass
    return result.outcome


@pytest.mark.slow
@pytest.mark.parametrize(("number", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_signal_leaves_a_whole_dataset(recordings, tmp_path, number, status):
    arguments = command("campaign", recordings, "--out", tmp_path / "dataset", *FEW)
    process = subprocess.Popen(
        arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT, start_new_session=True
    )
    while not list((tmp_path / "dataset" / "recordings").rglob("*.parquet")):
        assert process.poll() is None
        time.sleep(0.02)
    os.killpg(process.pid, number) if number == signal.SIGINT else process.send_signal(number)
    out, err = process.communicate(timeout=60.0)
    assert process.returncode == status, err
    assert "stopped: run the same command to continue" in err
    assert "Traceback" not in err
    assert is_whole(tmp_path)
    done = subprocess.run(arguments, capture_output=True, text=True, cwd=ROOT, check=True)
    assert done.stdout.startswith(f"{3 - int(out.split()[0])} recording")
    assert len(names(tmp_path)) == 3


@pytest.mark.slow
def test_two_campaigns_at_once_lose_nothing(recordings, tmp_path):
    arguments = command("campaign", recordings, "--out", tmp_path / "dataset", *FEW)
    both = [
        subprocess.Popen(arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, cwd=ROOT)
        for _ in range(2)
    ]
    outputs = [process.communicate(timeout=120.0) for process in both]
    assert [process.returncode for process in both] == [0, 0]
    assert sorted(int(out.split()[0]) for out, _ in outputs) == [0, 3]
    assert sum("waiting for another campaign" in err for _, err in outputs) == 1
    assert is_whole(tmp_path)
    assert len(names(tmp_path)) == 3


@pytest.mark.slow
def test_campaign_diagnoses_tires(recordings, tmp_path):
    arguments = ["campaign", str(recordings), "--out", str(tmp_path / "dataset"), *FEW, "--diagnose"]
    runner = CliRunner()
    first = runner.invoke(treadlink, arguments)
    assert "tires: 2 diagnosed, 0 done before, 0 without a diagnosis" in first.output, first.output
    result = rows(tmp_path, "diagnoses")
    assert {row["position"] for row in result} == {"W0"}
    assert all(row["held_out_after_mps2"] > 0.0 for row in result)
    whole = [json.loads(row["diagnosis"]) for row in result if row["diagnosis"]]
    assert len(whole) == 2
    assert {len(item["recordings"]) for item in whole} == {1, 2}
    assert "0 diagnosed, 2 done before" in runner.invoke(treadlink, arguments).output


def test_tires_without_a_diagnosis_are_named_with_the_reason(tmp_path):
    part = tmp_path / "part.parquet"
    order = DiagnosisOrder("van 7", "FL", "0000a000", (tmp_path / "gone.mcap",), 0, None, None, part)
    outcome = diagnose_tire(order)
    assert "gone.mcap" in outcome.failure
    assert outcome_in(part) == outcome


def test_a_foreign_file_does_not_stop_the_diagnoses(campaign, recordings, tmp_path):
    campaign(recordings)
    first, *_ = (tmp_path / "dataset" / "recordings").rglob("*.parquet")
    first.with_name("mine.parquet").write_text("no Parquet file")
    first.with_name("a-b-c.parquet").write_text("no Parquet file")
    tires = _tires(tmp_path / "dataset", [read_content(path).recording_id for path in recordings.iterdir()])
    assert [len(rows) for rows in tires.values()] == [1, 2]
    assert isinstance(next(iter(tires.values()))[0]["start_utc"], int)


def test_unknown_tires_are_not_diagnosed_together(tmp_path, monkeypatch):
    rows_of = {("unknown", "FL", ""): [{}, {}]}
    monkeypatch.setattr("gateway.fleet.tire_diagnoses._tires", lambda *_: rows_of)
    with opened(tmp_path / "dataset", Description((), (), "none"), lambda _: False) as dataset:
        counts = diagnose_tires(dataset, no_workers, {}, config=None, key_file=None, stop=threading.Event())
    assert counts.failed == 1
    assert "2 recordings have neither a vehicle's name nor a sensor's number" in counts.reasons[0][1]


class TasksDoneHere(WorkerTasks):
    """Tasks that are done in this process, one at a time, as soon as they are given."""

    def places(self) -> int:
        return 1

    def read_bytes(self, token: str) -> int:
        return 0

    def cancel(self) -> None:
        self._running.clear()

    def _begin(self, task: RunningTask) -> Future[object]:
        future: Future[object] = Future()
        try:
            future.set_result(task.work(task.order, lambda _: None))
        except MemoryError as error:
            future.set_exception(error)
        return future

    def _outcome(self, task: RunningTask) -> object:
        return task.future.result()


@pytest.fixture
def diagnose(tmp_path, monkeypatch):
    """Return what diagnoses tires, each known by a row, and gives the counts and the calls of `on_tire`."""

    def run(tires, why: Exception | None = None):
        def diagnosed(paths, *_: object, **__: object) -> Diagnosis:
            if why is not None:
                raise why
            return replace(undrawn(), recordings=tuple(map(str, paths)))

        calls: list[tuple[int, int]] = []
        pool = TasksDoneHere()
        monkeypatch.setattr("gateway.fleet.tire_diagnoses._tires", lambda *_: tires)
        monkeypatch.setattr("gateway.fleet.tire_diagnoses.diagnose_agreeing", diagnosed)
        with opened(tmp_path / "dataset", Description((), (), "none"), lambda _: False) as dataset:
            counts = diagnose_tires(
                dataset,
                lambda: pool,
                {"a": FileContent(tmp_path / "a.mcap", "a", 1, 1)},
                config=None,
                key_file=None,
                stop=threading.Event(),
                on_tire=lambda *call: calls.append(call),
            )
        return counts, calls

    return run


ROW = {"recording_id": "a", "start_utc": 0, "speed_mean_mps": 20.0}
TIRE = {("van 7", "FL", ""): [ROW]}


def test_tire_whose_worker_had_no_memory_is_diagnosed_by_the_next_run(diagnose, tmp_path):
    for _ in range(2):
        counts, _ = diagnose(TIRE, MemoryError())
        assert [reason for _, reason in counts.reasons] == ["its worker process had no memory left"]
        assert [row["code"] for row in rows(tmp_path, "diagnoses")] == ["worker_memory_full"]
    counts, _ = diagnose(TIRE)
    assert (counts.made, counts.made_before, counts.failed) == (1, 0, 0)
    assert [row["code"] for row in rows(tmp_path, "diagnoses") if row["code"]] == []
    counts, _ = diagnose(TIRE)
    assert (counts.made, counts.made_before) == (0, 1)


def test_tire_with_a_lasting_failure_is_not_diagnosed_again(diagnose):
    diagnose(TIRE, ConfigError("no use", "none"))
    counts, calls = diagnose(TIRE)
    assert (counts.made, counts.failed, calls) == (0, 1, [(0, 0)])


@pytest.mark.parametrize("share", [0.0, 0.5])
def test_tire_whose_file_is_cut_off_is_diagnosed_again(diagnose, tmp_path, share):
    diagnose(TIRE)
    (file,) = (tmp_path / "dataset" / "diagnoses").rglob("*.parquet")
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    counts, _ = diagnose(TIRE)
    assert (counts.made, counts.made_before) == (1, 0)
    assert rows(tmp_path, "diagnoses")


def test_progress_of_the_diagnoses_leaves_out_tires_that_failed_before(diagnose):
    diagnose(TIRE, ConfigError("no use", "none"))
    _, calls = diagnose({**TIRE, ("van 7", "FR", ""): [ROW]})
    assert calls == [(0, 1), (1, 1)]


@pytest.mark.usefixtures("started")
def test_tires_of_moved_recordings_are_diagnosed_where_they_are(recordings, tmp_path, monkeypatch):
    dataset = str(tmp_path / "dataset")
    invoked("campaign", str(recordings), "--out", dataset, *FEW)
    moved = recordings.rename(tmp_path / "moved")
    given: list[Path] = []

    def diagnosed(order: DiagnosisOrder, _: object) -> TireOutcome:
        given.extend(order.paths)
        return TireOutcome()

    monkeypatch.setattr("gateway.fleet.local_tasks.LocalTasks", lambda *_: nullcontext(TasksDoneHere()))
    monkeypatch.setattr("gateway.fleet.tire_diagnoses.diagnose_tire", diagnosed)
    monkeypatch.setattr(Dataset, "replace_files", lambda *_: None)
    done = invoked("campaign", str(moved), "--out", dataset, *FEW, "--diagnose")
    assert "tires: 2 diagnosed, 0 done before, 0 without a diagnosis" in done.output, done.output
    assert sorted(given) == sorted(moved.iterdir())


def test_recordings_that_a_diagnosis_leaves_out_are_in_its_row(tmp_path, monkeypatch):
    reason = Reason(
        DiagnosisCode.RECORDING_LEFT_OUT, recording="b.mcap", reason=Reason(DiagnosisCode.CIRCUMFERENTIAL_REVERSED)
    )
    result = replace(undrawn(), recordings=("a.mcap",), left_out=(reason,))
    monkeypatch.setattr("gateway.fleet.tire_diagnoses.diagnose_agreeing", lambda *_, **__: result)
    part = tmp_path / "part.parquet"
    order = DiagnosisOrder("v", "FL", "", (Path("a.mcap"), Path("b.mcap")), 0, None, None, part)
    outcome = diagnose_tire(order)
    assert outcome.failure == ""
    assert "b.mcap is not used: its circumferential axis" in outcome.left_out[0]
    assert outcome_in(part) == outcome
    with pq.ParquetFile(part) as file:
        row = file.read().to_pylist()[0]
    assert json.loads(row["recordings"]) == ["a.mcap"]
    (stated,) = json.loads(row["left_out"])
    assert stated["code"] == "recording_left_out"
    assert stated["values"]["reason"]["code"] == "circumferential_reversed"
    assert json.loads(row["diagnosis"])["left_out"] == [stated]


def test_diagnosis_takes_recordings_of_all_speeds():
    recorded = [{"speed_mean_mps": float(n), "recording_id": str(n), "start_utc": -n} for n in range(100)]
    chosen = _chosen(recorded)
    assert len(chosen) == MOST_RECORDINGS
    assert {0.0, 99.0} <= {row["speed_mean_mps"] for row in chosen}
    assert chosen == sorted(chosen, key=lambda row: row["start_utc"])


def test_names_of_estimates_are_those_of_tables(campaign, recordings, tmp_path):
    campaign(recordings / "drive0.mcap", estimators=("kinematic", "weak-form", "ring-paper", "load"))
    (row,) = rows(tmp_path, "recordings")
    assert row["other_estimates"] is None
    assert {"estimated_load_n", "ring-paper:Bs"} <= set(
        estimate_names(("kinematic", "weak-form", "ring-paper", "load"))
    )
    assert row["ring-paper:Bs_status"] in set(Status)


def test_workers_print_no_alarms():
    code = (
        "import logging, gateway.fleet.local_tasks as tasks\n"
        "tasks._ignore_interrupt()\n"
        "logging.getLogger('gateway.core.session.alarm_log').warning('FL: ALARM')\n"
        "logging.getLogger('other').warning('shown')"
    )
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stderr == "shown\n"
