"""Work on recordings in several processes: results, progress, errors and lost processes."""

import os
import signal
from concurrent.futures.process import BrokenProcessPool

import pytest

from gateway.core.errors import RecordingError
from gateway.core.worker_pool import WorkerLostError, Workers
from tests.testkit.recording_work import (
    LOST,
    die_at_three,
    double,
    fail_at_three,
    interrupt_itself,
    own_process,
    second_after_loss,
)


@pytest.mark.parametrize("others", [0, 1, 2])
def test_work_gives_each_result_and_all_bytes(others):
    read = []
    with Workers(others) as workers:
        # Twice: the second work does not count the bytes of the first.
        for _ in range(2):
            assert dict(workers.work_on(double, [1, 2, 4], read.append)) == {0: 2, 1: 4, 2: 8}
    assert sum(read) == 14


def test_this_process_works_too_and_the_largest_is_taken_first():
    with Workers(1) as workers:
        results = dict(workers.work_on(own_process, [1, 2, 3], lambda _: None, sizes=[1, 5, 2]))
    # The other process was given the largest before this one took any.
    assert results[1] != os.getpid()
    assert results[2] == os.getpid()


def test_a_single_recording_needs_no_other_process():
    with Workers(1) as workers:
        assert list(workers.work_on(own_process, [1], lambda _: None)) == [(0, os.getpid())]


@pytest.mark.parametrize("orders", [[1, 3, 3, 1], [3, 1], [1, 3]])
@pytest.mark.parametrize("others", [0, 1])
def test_work_error_keeps_its_remedy(orders, others):
    with pytest.raises(RecordingError, match="three") as caught, Workers(others) as workers:
        list(workers.work_on(fail_at_three, orders, lambda _: None))
    assert caught.value.remedy == "Count to two."


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no SIGKILL")
def test_terminated_process_is_reported():
    with pytest.raises(WorkerLostError, match="terminated from outside") as caught, Workers(1) as workers:
        list(workers.work_on(die_at_three, [3, 1], lambda _: None))
    assert "--jobs 1" in caught.value.remedy


def test_process_lost_between_two_recordings_is_reported(monkeypatch):
    def work() -> None:
        with Workers(1) as workers:
            (worker,) = workers.each
            submit, stated = worker.submit, []

            def lost_after_one(*work):
                stated.append(work)
                if len(stated) > 1:
                    LOST.set()
                    raise BrokenProcessPool
                return submit(*work)

            monkeypatch.setattr(worker, "submit", lost_after_one)
            list(workers.work_on(second_after_loss, [1, 2, 3], lambda _: None))

    with pytest.raises(WorkerLostError, match="terminated from outside"):
        work()


def test_processes_of_a_background_command_ignore_ctrl_c_as_it_does():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Workers(1) as workers:
            assert dict(workers.work_on(interrupt_itself, [1, 2], lambda _: None)) == {0: 1, 1: 2}
    finally:
        signal.signal(signal.SIGINT, before)


def test_closed_work_and_workers_leave_no_process():
    with Workers(1) as workers:
        work = workers.work_on(own_process, [1, 2, 3], lambda _: None)
        result = {pid for _, pid in work} - {os.getpid()}
        work = workers.work_on(own_process, [1, 2, 3], lambda _: None)
        next(work)
        work.close()
    (other,) = result
    with pytest.raises(ProcessLookupError):
        os.kill(other, 0)
