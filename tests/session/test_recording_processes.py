"""Work on recordings in several processes: results, progress, errors and lost processes."""

from __future__ import annotations

import os
import signal

import pytest

from gateway.errors import RecordingError, TreadlinkError
from gateway.session.recording_processes import work_on_recordings
from tests.testkit.recording_work import die_at_three, double, fail_at_three, own_process


@pytest.mark.parametrize("jobs", [1, 2])
def test_work_gives_each_result_and_all_bytes(jobs):
    read = []
    assert dict(work_on_recordings(double, [1, 2, 4], jobs, read.append)) == {0: 2, 1: 4, 2: 8}
    assert sum(read) == 7


def test_processes_take_the_largest_first():
    """One process stays alone with the largest order from the start, so the other does all the rest."""
    work = work_on_recordings(own_process, [1, 2, 3], 2, lambda _: None, sizes=[1, 5, 2])
    places = [place for place, _ in work]
    assert places[0] != 0
    assert sorted(places) == [0, 1, 2]


@pytest.mark.parametrize("jobs", [1, 2])
def test_work_error_keeps_its_remedy(jobs):
    with pytest.raises(RecordingError, match="three") as caught:
        list(work_on_recordings(fail_at_three, [1, 3, 3, 1], jobs, lambda _: None))
    assert caught.value.remedy == "Count to two."


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="this system has no SIGKILL")
def test_terminated_process_is_reported():
    with pytest.raises(TreadlinkError, match="terminated from outside") as caught:
        list(work_on_recordings(die_at_three, [3, 1], 2, lambda _: None))
    assert "--jobs 1" in caught.value.remedy


def test_closed_work_leaves_no_process():
    work = work_on_recordings(own_process, [1, 2], 2, lambda _: None)
    _, first = next(work)
    work.close()
    with pytest.raises(ProcessLookupError):
        os.kill(first, 0)
