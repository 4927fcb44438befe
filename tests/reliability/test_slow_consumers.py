"""Whoever is slow holds up nobody else: view, terminal, disk, estimators; what is dropped is counted by stage."""

from __future__ import annotations

import threading
from collections import Counter

import pytest

from gateway.cli.session_setup import RunningSession, end_session, run_plain
from gateway.config.vehicle import parse_vehicle
from gateway.errors import RecordingError, TreadlinkError
from gateway.io.source import Chunk
from gateway.recording.reader import RecordingReader
from gateway.recording.writer import RecordingWriter
from gateway.session import live as live_module
from gateway.session import recording_stage
from gateway.session.bounded_buffer import Buffer
from gateway.session.core import SessionCore
from tests.reliability.sessions import TIMEOUT_S, Items, SlowWriter, start
from tests.reliability.streams import simulated


@pytest.fixture(scope="module")
def lab():
    items, toml = simulated("sim:lab?speed=max&duration=6&seed=4")
    return items, parse_vehicle(toml, "lab")


def link_bytes(items) -> bytes:
    return b"".join(item.data for item in items if isinstance(item, Chunk))


def test_a_stuck_disk_does_not_hold_up_the_estimates(lab) -> None:
    items, vehicle = lab
    writer = SlowWriter()
    core = SessionCore(vehicle, recorder=writer)
    seen = threading.Event()
    live = start(Items(items, before_end=lambda: seen.wait(TIMEOUT_S)), core, patient=False)
    results = []
    while len(results) < 45:  # of 53; the disk has not taken a byte yet
        results += live.results()
        assert not live.wait(0.01)
    assert writer.items == []
    seen.set()
    writer.gate.set()
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    assert link_bytes(writer.items) == link_bytes(items), "nothing that arrived is missing from the recording"
    assert writer.closed
    assert not snapshot.links[0].queue_dropped


def test_a_disk_stuck_for_too_long_loses_topics_first_and_says_what(lab, monkeypatch) -> None:
    items, vehicle = lab
    size = len(link_bytes(items))
    monkeypatch.setattr(recording_stage, "MOST_BYTES", size)
    writer = SlowWriter()
    core = SessionCore(vehicle, recorder=writer)
    done = threading.Event()
    live = start(Items(items, before_end=lambda: done.wait(TIMEOUT_S)), core, patient=False)
    notices: list[str] = []
    while not any("MISSING FROM THE RECORDING" in text for text in notices):
        notices += live.notices()
        assert not live.wait(0.01)
    results = []
    while len(results) < 45:
        results += live.results()
        assert not live.wait(0.01)
    done.set()
    writer.gate.set()
    assert live.wait(TIMEOUT_S)
    dropped = live.close().links[0].queue_dropped
    chunks = [item for item in items if isinstance(item, Chunk)]
    kept = [item for item in writer.items if isinstance(item, Chunk)]
    assert dropped["recording"] == len(chunks) - len(kept) > 0
    assert len(link_bytes(kept)) > 0.7 * size
    assert kept == chunks[: len(kept)]
    assert dropped["recorded topics"] > 0
    assert "decoding" not in dropped
    notices += live.notices()
    assert Counter(notices).most_common(1)[0][1] == 1, "each is told once"


def test_estimates_that_fall_behind_do_not_touch_the_recording(lab, tmp_path, monkeypatch) -> None:
    items, vehicle = lab
    monkeypatch.setattr(live_module, "_QUEUE_ITEMS", 50)
    path = tmp_path / "r.mcap"
    core = SessionCore(vehicle, recorder=RecordingWriter(path, start_ns=items[0].host_ns))
    gate = threading.Event()
    take = core.take

    def slow(item):
        assert gate.wait(TIMEOUT_S)
        return take(item)

    core.take = slow
    live = start(Items(items, before_end=gate.set), core, patient=False)
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    chunks = [item for item in items if isinstance(item, Chunk)]
    assert snapshot.links[0].queue_dropped["decoding"] >= len(chunks) - 51
    assert any("does not keep up with decoding" in text for text in snapshot.notices)
    assert link_bytes(RecordingReader(path).items()) == link_bytes(items)


def test_a_view_that_fetches_nothing(lab, monkeypatch) -> None:
    items, vehicle = lab
    monkeypatch.setattr(live_module, "_RESULT_ITEMS", 10)
    live = start(Items(items), SessionCore(vehicle))
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    last = live.results()
    assert len(last) == 10
    revolutions = snapshot.wheels[0].counters.revolutions
    assert last[-1].revolution.index == revolutions - 1
    assert snapshot.links[0].queue_dropped == {"view": revolutions - 10}


def test_a_blocked_terminal_does_not_hold_up_the_session(lab) -> None:
    items, vehicle = lab
    live = start(Items(items), SessionCore(vehicle))
    printed: list[str] = []

    def terminal(line: str) -> None:
        # Control-S was pressed: the first line goes out when everything else is over.
        assert live.wait(TIMEOUT_S)
        printed.append(line)

    session = RunningSession(live, live._summary, None, live._core)
    run_plain(session, None, terminal)
    end_session(session, printed.append)
    assert any("revolutions" in line for line in printed)
    assert sum(line.startswith("W1 ") and "km/h" not in line for line in printed) > 40


def test_a_fault_of_our_own_in_the_recording_ends_the_session_by_name(lab) -> None:
    items, vehicle = lab
    writer = SlowWriter()
    writer.error = ZeroDivisionError("in the writer")
    writer.gate.set()
    live = start(Items(items), SessionCore(vehicle, recorder=writer))
    assert live.wait(TIMEOUT_S)
    with pytest.raises(TreadlinkError, match="in the writer"):
        live.close()
    assert writer.closed


def test_a_fault_in_the_core_leaves_a_finished_recording(lab, tmp_path) -> None:
    items, vehicle = lab
    path = tmp_path / "r.mcap"
    core = SessionCore(vehicle, recorder=RecordingWriter(path, start_ns=items[0].host_ns))
    handed_over = threading.Event()

    def broken(item):
        assert handed_over.wait(TIMEOUT_S)
        raise KeyError("lost wheel")

    core.take = broken
    live = start(Items(items, before_end=handed_over.set), core)
    assert live.wait(TIMEOUT_S)
    with pytest.raises(TreadlinkError, match="lost wheel"):
        live.close()
    reader = RecordingReader(path)
    assert link_bytes(reader.items()) == link_bytes(items)
    assert reader.info.finished


def test_a_disk_that_hangs_for_good_is_told_not_waited_for(lab, monkeypatch) -> None:
    items, vehicle = lab
    monkeypatch.setattr(recording_stage, "_STUCK_S", 0.2)
    writer = SlowWriter()
    core = SessionCore(vehicle, recorder=writer)
    live = start(Items(items), core)
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    assert core.recording_fault is not None
    assert "has taken nothing for 0.2 s" in core.recording_fault
    assert any("RECORDING STOPPED" in text for text in snapshot.notices)
    writer.gate.set()


def test_the_stage_tells_of_a_full_disk_once_and_goes_on_taking() -> None:
    from gateway.clock import SystemClock

    writer = SlowWriter()
    writer.error = RecordingError("disk full", "Free space.")
    writer.gate.set()
    failures: list[BaseException] = []
    stage = recording_stage.RecordingStage(writer, SystemClock(), failures.append)
    assert stage.offer(Chunk("a", 1, b"x"))
    stage._thread.join(TIMEOUT_S)
    with pytest.raises(RecordingError, match="disk full"):
        stage.tick(1)
    stage.tick(2)
    assert stage.offer(Chunk("a", 2, b"y"))
    stage.close()
    assert writer.closed
    assert failures == []


def test_a_buffer_is_bounded_in_bytes_and_in_items() -> None:
    buffer: Buffer[bytes] = Buffer(100, 10_000)
    taken = sum(buffer.put(bytes(1000), 1000) for _ in range(50))
    assert taken == 7
    assert buffer.dropped == 43
    assert not buffer.put(b"", 0, below=0.5)
    small: Buffer[bytes] = Buffer(100, 10_000_000)
    assert sum(small.put(b"", 0) for _ in range(150)) == 100
    assert [small.get() for _ in range(101)][-1] is None
    assert Buffer(1, 1).put(b"one always fits", 10_000)


def test_a_patient_producer_waits_for_room() -> None:
    buffer: Buffer[int] = Buffer(1, 1 << 20)
    assert buffer.put(1, 1)
    assert not buffer.put(2, 1, timeout_s=0.01)
    assert buffer.dropped == 0
    taker = threading.Thread(target=lambda: buffer.get(TIMEOUT_S))
    taker.start()
    assert buffer.put(2, 1, timeout_s=TIMEOUT_S)
    taker.join()
    assert buffer.get() == 2
