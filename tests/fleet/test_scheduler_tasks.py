"""A campaign at the workers of a dask scheduler: plain with a warning, and by TLS with certificates."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
from collections import Counter
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace

import pytest

from gateway.core.clock import ManualClock
from gateway.core.errors import TreadlinkError
from gateway.fleet import recording_estimation
from gateway.fleet.reasons import FleetCode
from gateway.fleet.recording_estimation import Estimated
from gateway.fleet.scheduler_tasks import SchedulerTasks, _check_workers, scheduler_tasks
from tests.fleet.test_campaign_run import is_whole, names
from tests.testkit.commands import invoked

distributed = pytest.importorskip("distributed")

ROOT = Path(__file__).parents[2]
FEW = ("--estimator", "kinematic", "--estimator", "weak-form")
WARNING = "is neither encrypted nor authenticated"


def cluster(**options):
    return distributed.LocalCluster(
        **{"n_workers": 1, "threads_per_worker": 1, "dashboard_address": None, "processes": False, **options}
    )


def run(recordings, tmp_path, address):
    arguments = ["campaign", str(recordings), "--out", str(tmp_path / "dataset"), *FEW, "--scheduler", address]
    return invoked(*arguments)


def test_a_plain_scheduler_is_used_with_a_warning(recordings, tmp_path):
    with cluster() as plain:
        result = run(recordings, tmp_path, plain.scheduler_address)
    assert result.exit_code == 0, result.output
    assert WARNING in result.stderr
    assert "3 recordings estimated" in result.output
    assert is_whole(tmp_path)


def test_a_scheduler_with_certificates_is_used_without_a_word(recordings, tmp_path, monkeypatch):
    pytest.importorskip("cryptography")
    security = distributed.Security.temporary()
    files = {"ca-file": security.tls_ca_file, "client.cert": security.tls_client_cert}
    files["client.key"] = security.tls_client_key
    settings = {}
    for name, content in files.items():
        (tmp_path / name).write_text(content)
        settings[f"distributed.comm.tls.{name}"] = str(tmp_path / name)
    with cluster(protocol="tls", security=security) as secured:
        import dask

        with dask.config.set(settings):
            result = run(recordings, tmp_path, secured.scheduler_address)
        assert result.exit_code == 0, result.output
        assert WARNING not in result.stderr
        assert len(names(tmp_path)) == 3

        (tmp_path / "dataset").rename(tmp_path / "before")
        without = run(recordings, tmp_path, secured.scheduler_address)
        assert "no dask scheduler answers" in str(without.exception)


_released = threading.Event()


def held(order, report):
    _released.wait(60.0)
    return order


def work(order, report):
    report(7)
    if order == "end":
        os.kill(os.getpid(), signal.SIGKILL)
    if order == "memory":
        raise MemoryError
    if order == "fault":
        raise ImportError("no treadlink")
    return order


def result_of(tasks):
    """Return the next result; without one in two minutes the test fails, as where no worker has come back."""
    return next(result for _ in range(120) if (result := tasks.wait(1.0)) is not None)


@pytest.mark.slow
@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request\r\n\r\n", bytes(range(256)) * 16], ids=len)
def test_what_is_no_scheduler_is_an_error_in_time(monkeypatch, answer):
    """It accepts the connection and then says nothing, or something else."""
    monkeypatch.setattr("gateway.fleet.scheduler_tasks._CONNECT_S", 0.5)
    with socket.create_server(("127.0.0.1", 0)) as server:
        connections = []

        def serve():
            with contextlib.suppress(OSError):
                while True:
                    connections.append(server.accept()[0])
                    connections[-1].sendall(answer)

        threading.Thread(target=serve, daemon=True).start()
        address = f"tcp://127.0.0.1:{server.getsockname()[1]}"
        with pytest.raises(TreadlinkError, match="no dask scheduler answers"), scheduler_tasks(address):
            pass
        for connection in connections:
            connection.close()


def test_a_worker_that_ends_is_a_reason():
    import dask

    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        cluster(processes=True) as workers,
        scheduler_tasks(workers.scheduler_address) as tasks,
    ):
        assert tasks.places() == 1
        # The order that ends the worker is the last: whether another one starts is up to the scheduler's computers.
        for order, code in (("fine", None), ("end", FleetCode.WORKER_ENDED)):
            tasks.submit(order, work, order)
            result = result_of(tasks)
            assert (result.ended.code if result.ended else None) == code


def test_full_memory_of_a_worker_is_a_reason_and_a_fault_an_error():
    with cluster() as workers, scheduler_tasks(workers.scheduler_address) as tasks:
        tasks.submit("memory", work, "memory")
        assert result_of(tasks).ended.code == FleetCode.WORKER_MEMORY_FULL
        tasks.submit("fault", work, "fault")
        with pytest.raises(TreadlinkError, match="the workers cannot estimate: ImportError"):
            tasks.wait(60.0)


class StandInScheduler:
    """A client of a scheduler whose workers are told what to send; it does no task, and says which worker has it."""

    def __init__(self, *workers):
        self.last_seen = dict.fromkeys(workers, 0.0)
        self.processing_keys = {worker: [] for worker in workers}
        self.cancelled = []
        self.scheduler = self
        self.subscribe_topic = lambda *_: None

    def sync(self, question, callback_timeout):
        return question()

    def identity(self):
        return {
            "address": "tcp://scheduler",
            "workers": {worker: {"last_seen": seen} for worker, seen in self.last_seen.items()},
        }

    def processing(self):
        return self.processing_keys

    def ncores(self):
        return dict.fromkeys(self.last_seen, 1)

    def cancel(self, futures, force):
        self.cancelled += futures

    def submit(self, work, order, *, key, workers=None, allow_other_workers=False, **_):
        chosen = min(workers or self.processing_keys, key=lambda worker: len(self.processing_keys[worker]))
        self.processing_keys[chosen].append(key)
        return Future()


def passed(tasks, client, clock, seconds, *alive):
    """Let time pass in which some workers send signs of life; return the results."""
    results = []
    for _ in range(seconds):
        clock.advance_ns(10**9)
        for worker in alive:
            client.last_seen[worker] += 1.0
        results.append(tasks.wait(0.0))
    return [result for result in results if result is not None]


def test_a_silent_worker_is_named_and_its_task_given_to_another(caplog):
    client, clock = StandInScheduler("paused", "well"), ManualClock()
    tasks = SchedulerTasks(client, clock)
    tasks.submit("drive", work, "fine")
    assert client.processing_keys["paused"] == ["treadlink-drive-1"]
    tasks._take_position((1.0, ["drive", 5]))
    assert passed(tasks, client, clock, 55, "well") == []
    assert not caplog.records
    assert tasks.places() == 2
    assert passed(tasks, client, clock, 15, "well") == []
    assert "worker paused has sent nothing for 60 s: it is paused, hanging or cut off" in caplog.text
    assert client.processing_keys["well"] == ["treadlink-drive-2"]
    assert len(client.cancelled) == 1
    assert tasks.read_bytes("drive") == 0, "the other begins anew"
    assert tasks.places() == 1, "a silent worker is no place for another task"
    passed(tasks, client, clock, 300, "well")
    assert len(caplog.records) == 1
    for attempt in ("3", "4"):
        # The scheduler balances its workers, and the silent one seems idle: that is no attempt.
        client.processing_keys["paused"] = [client.processing_keys["well"].pop()]
        assert passed(tasks, client, clock, 6, "well") == []
        assert client.processing_keys["well"] == [f"treadlink-drive-{attempt}"]
    # It wakes up: it is a place again, and named again when it falls silent again.
    passed(tasks, client, clock, 10, "well", "paused")
    assert tasks.places() == 2
    # Now the other is silent: two attempts are enough.
    (result,) = passed(tasks, client, clock, 70, "paused")
    assert (result.token, result.ended.code, result.attempts) == ("drive", FleetCode.WORKER_SILENT, 2)
    assert "worker well has sent nothing" in caplog.text


def test_the_only_worker_is_named_when_it_is_silent_and_keeps_its_task(caplog):
    client, clock = StandInScheduler("paused"), ManualClock()
    tasks = SchedulerTasks(client, clock)
    tasks.submit("drive", work, "fine")
    passed(tasks, client, clock, 200)
    assert caplog.text.count("has sent nothing for 60 s") == 1
    assert client.processing_keys["paused"] == ["treadlink-drive-1"]
    client.last_seen["new"], client.processing_keys["new"] = 0.0, []
    passed(tasks, client, clock, 10, "new")
    assert client.processing_keys["new"] == ["treadlink-drive-2"]


@pytest.mark.parametrize("workers", [(), ("killed",)], ids=["never there", "gone midway"])
def test_a_campaign_without_workers_says_so_once_and_goes_on_when_one_comes(caplog, workers):
    client, clock = StandInScheduler(*workers), ManualClock()
    tasks = SchedulerTasks(client, clock)
    passed(tasks, client, clock, 20, *workers)
    assert ("no worker" in caplog.text) is not bool(workers)
    client.last_seen.clear()
    passed(tasks, client, clock, 300)
    assert caplog.text.count("no worker: what is not done waits until one comes, as `dask worker tcp://scheduler`") == 1
    assert tasks.places() == 0
    client.last_seen["new"] = 0.0
    passed(tasks, client, clock, 20, "new")
    client.last_seen.clear()
    passed(tasks, client, clock, 20)
    assert caplog.text.count("no worker") == 2


def test_a_recording_waits_for_a_worker_of_a_scheduler_without_one(monkeypatch, caplog):
    monkeypatch.setattr("gateway.fleet.scheduler_tasks._LOOK_NS", 100_000_000)
    with cluster(n_workers=0) as workers, scheduler_tasks(workers.scheduler_address) as tasks:
        tasks.submit("drive", work, "fine")
        next(True for _ in range(600) if tasks.wait(0.1) is None and "has no worker" in caplog.text)
        workers.scale(1)
        assert result_of(tasks).outcome == "fine"


def test_a_worker_that_is_paused_at_the_start_does_not_hold_the_campaign(monkeypatch):
    monkeypatch.setattr("gateway.fleet.scheduler_tasks._CONNECT_S", 0.05)
    _released.clear()
    try:
        _check_workers(SimpleNamespace(run=lambda *_, **__: _released.wait(60.0)))
        assert not _released.is_set()
    finally:
        _released.set()


def test_a_pause_of_this_computer_is_no_silence_of_workers(caplog):
    client, clock = StandInScheduler("well", "other"), ManualClock()
    tasks = SchedulerTasks(client, clock)
    tasks.submit("drive", work, "fine")
    passed(tasks, client, clock, 20, "well", "other")
    clock.advance_ns(3_600 * 10**9)
    passed(tasks, client, clock, 40, "well", "other")
    assert not caplog.records
    assert not client.cancelled


def test_workers_of_another_version_are_named_before_the_first_recording(recordings, tmp_path, monkeypatch):
    done = []
    with cluster() as workers:
        address = workers.scheduler_address
        with scheduler_tasks(address) as tasks:
            # A worker that joins later is not asked at the start, but before its first recording.
            monkeypatch.setattr("gateway.fleet.scheduler_tasks._own_code", lambda: ("0", "0"))
            tasks.submit("one", lambda order, report: done.append(order), "fine")
            with pytest.raises(TreadlinkError, match=r"the worker \S+ has another treadlink"):
                tasks.wait(60.0)
        assert not done
        result = run(recordings, tmp_path, address)
    assert "1 of 1 workers have another treadlink, or none" in str(result.exception)
    assert "same version" in result.exception.remedy


def test_scheduler_that_ends_is_named_and_what_is_done_is_kept():
    with cluster() as workers, scheduler_tasks(workers.scheduler_address) as tasks:
        tasks.submit("done", work, "fine")
        result = result_of(tasks)
        assert result.ended is None
        _released.clear()
        tasks.submit("lost", held, "fine")
        try:
            workers.close()
            with pytest.raises(TreadlinkError, match="connection to the dask scheduler was lost") as error:
                tasks.wait(60.0)
        finally:
            _released.set()
    assert "repeat the command" in error.value.remedy


@pytest.mark.slow  # dask gives a worker with a task 30 s to end
def test_the_same_command_goes_on_after_the_scheduler_restarted(recordings, tmp_path, monkeypatch):
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    estimated, reached, really_open = [], threading.Event(), recording_estimation.open_recording

    def open_recording(reader, *rest, **options):
        estimated.append(reader.info.path.name)
        if len(estimated) == 2:
            reached.set()
            _released.wait(60.0)
        return really_open(reader, *rest, **options)

    monkeypatch.setattr(recording_estimation, "open_recording", open_recording)
    monkeypatch.setattr("gateway.fleet.scheduler_tasks._CONNECT_S", 1.0)
    _released.clear()
    first = cluster(scheduler_port=port)

    def end():
        reached.wait(60.0)
        first.close()

    thread = threading.Thread(target=end)
    thread.start()
    try:
        result = run(recordings, tmp_path, first.scheduler_address)
    finally:
        reached.set()
        thread.join()
        _released.set()
    assert "connection to the dask scheduler was lost" in str(result.exception)
    assert "repeat the command" in result.exception.remedy
    assert len(names(tmp_path)) == 1
    with cluster(scheduler_port=port) as second:
        again = run(recordings, tmp_path, second.scheduler_address)
    assert again.exit_code == 0, again.output
    assert "2 recordings estimated" in again.output
    assert is_whole(tmp_path)
    assert len(names(tmp_path)) == 3
    assert sorted(Counter(estimated).values()) == [1, 1, 2], "only the one that was cut off is estimated twice"


def test_a_scheduler_that_is_gone_or_silent_is_named(monkeypatch):
    monkeypatch.setattr("gateway.fleet.scheduler_tasks._CONNECT_S", 0.5)
    with cluster() as workers, scheduler_tasks(workers.scheduler_address) as tasks:
        with monkeypatch.context() as silent:
            silent.setattr("gateway.fleet.scheduler_tasks._ANSWER_S", 0.0)
            with pytest.raises(TreadlinkError, match="connection to the dask scheduler was lost"):
                tasks.places()
        workers.close()
        with pytest.raises(TreadlinkError, match="connection to the dask scheduler was lost"):
            tasks.places()


class Strange:
    """A result of a worker that is not treadlink's."""


@pytest.mark.parametrize(
    ("outcome", "message"),
    [
        (Strange(), "a worker returned Strange instead of Estimated"),
        (None, "a worker returned NoneType instead of Estimated"),
        (Estimated(parts={"recordings": Path("/etc/passwd")}), "a worker names '/etc/passwd' as its part"),
        (Estimated(parts={"recordings": Path("dataset/incoming/../../x")}), "as its part"),
    ],
)
def test_results_of_a_strange_worker_end_the_campaign(recordings, tmp_path, monkeypatch, outcome, message):
    monkeypatch.setattr("gateway.fleet.scheduler_tasks._work", lambda *_: outcome)
    with cluster() as workers:
        result = run(recordings, tmp_path, workers.scheduler_address)
    assert message in str(result.exception)
    assert "of your own" in result.exception.remedy
    assert not list((tmp_path / "dataset").rglob("*.parquet"))


def test_strange_events_of_a_scheduler_are_left_out():
    with cluster() as workers, scheduler_tasks(workers.scheduler_address) as tasks:
        _released.clear()
        tasks.submit("one", held, "fine")
        for event in (None, (1.0,), (1.0, "text"), (1.0, ["one", -1]), (1.0, ["one", "9"]), (1.0, ["two", 3])):
            tasks._take_position(event)
        assert tasks.read_bytes("one") == 0
        tasks._take_position((1.0, ["one", 5]))
        assert tasks.read_bytes("one") == 5
        _released.set()


def test_cancelled_tasks_have_no_result():
    with cluster() as workers, scheduler_tasks(workers.scheduler_address) as tasks:
        tasks.submit("one", work, "fine")
        tasks.cancel()
        assert tasks.wait(0.2) is None
        assert tasks.read_bytes("one") == 0


def test_a_campaign_without_scheduler_imports_no_dask():
    code = "import sys, gateway.fleet.campaign_run, gateway.fleet.local_tasks, gateway.fleet.tire_diagnoses\n"
    code += "sys.exit(bool({'dask', 'distributed'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False).returncode == 0
