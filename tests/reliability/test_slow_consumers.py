"""A slow view, terminal, disk or estimator delays nothing else; dropped items are counted by stage."""

import threading
from collections import Counter

import pytest

from gateway.core.cli.session_setup import RunningSession, end_session, run_plain
from gateway.core.cli.stop_signals import StopRequest
from gateway.core.clock import ManualClock
from gateway.core.errors import RecordingError, TreadlinkError
from gateway.core.links.source import Chunk
from gateway.core.reasons import Notice, Reason
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session import live as live_module
from gateway.core.session import recording_stage
from gateway.core.session.bounded_buffer import Buffer
from gateway.core.session.core import SessionCore
from gateway.core.session.live import LiveSession
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_stage import Stage
from gateway.core.session.session_opening import OpenedSession
from tests.reliability.sessions import TIMEOUT_S, Items, SlowWriter, prepare, start
from tests.reliability.streams import link_bytes


def test_stuck_disk_does_not_delay_estimates(lab) -> None:
    items, vehicle = lab
    writer = SlowWriter()
    seen = threading.Event()
    live = start(Items(items, before_end=lambda: seen.wait(TIMEOUT_S)), vehicle, writer, patient=False)
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


def test_disk_stuck_too_long_loses_topics_first(lab, monkeypatch) -> None:
    items, vehicle = lab
    size = len(link_bytes(items))
    monkeypatch.setattr(recording_stage, "MAX_BYTES", size)
    writer = SlowWriter()
    done = threading.Event()
    live = start(Items(items, before_end=lambda: done.wait(TIMEOUT_S)), vehicle, writer, patient=False)
    notices: list[Notice] = []
    while not any(notice.reason == Reason(SessionCode.STAGE_BEHIND, stage="recording") for notice in notices):
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
    remaining = [item for item in writer.items if isinstance(item, Chunk)]
    assert dropped[Stage.RECORDING] == len(chunks) - len(remaining) > 0
    assert len(link_bytes(remaining)) > 0.7 * size
    assert remaining == chunks[: len(remaining)]
    assert dropped[Stage.TOPICS] > 0
    assert Stage.DECODING not in dropped
    notices += live.notices()
    assert Counter(notices).most_common(1)[0][1] == 1, "each is reported once"


def test_slow_estimates_do_not_affect_the_recording(lab, tmp_path, monkeypatch) -> None:
    items, vehicle = lab
    monkeypatch.setattr(live_module, "_QUEUE_ITEMS", 50)
    path = tmp_path / "r.mcap"
    gate = threading.Event()

    def read():
        yield from items[:-1]
        gate.set()  # the end of the link waits for room, which the core makes
        yield items[-1]

    writer = RecordingWriter(path, start_ns=items[0].host_ns)
    live = prepare(Items(read()), vehicle, writer, patient=False)
    take = live.core.take

    def slow(item):
        assert gate.wait(TIMEOUT_S)
        return take(item)

    live.core.take = slow
    live.start()
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    chunks = [item for item in items if isinstance(item, Chunk)]
    # One batch is in the hands of the core, another one waits.
    assert snapshot.links[0].queue_dropped[Stage.DECODING] >= len(chunks) - 2 * 50 - 1
    assert len(chunks) > 150
    assert any(notice.reason == Reason(SessionCode.STAGE_BEHIND, stage="decoding") for notice in snapshot.notices)
    assert link_bytes(RecordingReader(path).items()) == link_bytes(items)


@pytest.mark.parametrize(("took", "patient", "is_told"), [(3.0, False, True), (0.5, False, False), (3.0, True, False)])
def test_session_that_falls_behind_says_so_before_it_drops(lab, took: float, patient: bool, is_told: bool) -> None:
    items, vehicle = lab
    clock = ManualClock(items[0].host_ns)
    live = LiveSession([Items(items)], SessionCore(vehicle), clock, patient=[patient])
    take, taken_ns, told_s = live.core.take, [items[0].host_ns], []
    live.core.late = told_s.append

    def slow(item):
        # The work on an item takes so many times as long as the item lasted.
        clock.advance_ns(max(0, round(took * (item.host_ns - taken_ns[0]))))
        taken_ns[0] = max(taken_ns[0], item.host_ns)
        return take(item)

    live.core.take = slow
    live.start()
    assert live.wait(TIMEOUT_S)
    late = [notice.reason for notice in live.close().notices if notice.reason.code is SessionCode.RESULTS_LATE]
    assert [reason["late_s"] >= 3.0 for reason in late] == [True] * is_told
    assert max(told_s, default=0.0) >= 3.0 if is_told else max(told_s, default=0.0) < 0.1


def test_idle_view_keeps_latest_results(lab, monkeypatch) -> None:
    items, vehicle = lab
    monkeypatch.setattr(live_module, "_RESULT_ITEMS", 10)
    live = start(Items(items), vehicle)
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    last = live.results()
    assert len(last) == 10
    revolutions = snapshot.wheels[0].counters.revolutions
    assert last[-1].revolution.index == revolutions - 1
    assert snapshot.links[0].queue_dropped == {Stage.VIEW: revolutions - 10}


def test_blocked_terminal_does_not_delay_the_session(lab) -> None:
    items, vehicle = lab
    live = start(Items(items), vehicle)
    printed: list[str] = []

    def terminal(text: str) -> None:
        # As after Control-S: the first line is written after everything else has ended.
        assert live.wait(TIMEOUT_S)
        printed.extend(text.splitlines())

    session = RunningSession(OpenedSession(live, None, None, ()))
    run_plain(session, StopRequest(), terminal)
    end_session(session, printed.append)
    assert any("revolutions" in line for line in printed)
    assert sum(line.startswith("W1 ") and "km/h" not in line for line in printed) > 40


def test_error_of_the_core_leaves_a_finished_recording(lab, tmp_path) -> None:
    items, vehicle = lab
    path = tmp_path / "r.mcap"
    handed_over = threading.Event()
    writer = RecordingWriter(path, start_ns=items[0].host_ns)
    live = prepare(Items(items, before_end=handed_over.set), vehicle, writer)

    def broken(item):
        assert handed_over.wait(TIMEOUT_S)
        raise KeyError("lost wheel")

    live.core.take = broken
    live.start()
    assert live.wait(TIMEOUT_S)
    with pytest.raises(TreadlinkError, match="lost wheel"):
        live.close()
    reader = RecordingReader(path)
    assert link_bytes(reader.items()) == link_bytes(items)
    assert reader.info.finished


def test_hanging_disk_is_reported_without_waiting(lab, monkeypatch) -> None:
    items, vehicle = lab
    monkeypatch.setattr(recording_stage, "_STUCK_S", 0.2)
    writer = SlowWriter()
    live = start(Items(items), vehicle, writer)
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    assert live.core.recording.fault is not None
    assert "takes no data for 0.2 s" in live.core.recording.fault
    assert any(notice.reason.code is SessionCode.RECORDING_STOPPED for notice in snapshot.notices)
    writer.gate.set()


def test_stage_reports_a_full_disk_once() -> None:
    from gateway.core.clock import SystemClock

    writer = SlowWriter()
    writer.error = RecordingError("disk full", "Free space.")
    writer.gate.set()
    stage = recording_stage.RecordingStage(writer, SystemClock())
    assert stage.offer(Chunk("a", 1, b"x"))
    stage._thread.join(TIMEOUT_S)
    with pytest.raises(RecordingError, match="disk full"):
        stage.tick(1)
    stage.tick(2)
    assert stage.offer(Chunk("a", 2, b"y"))
    stage.close()
    assert writer.closed


def test_buffer_is_bounded_in_bytes_and_items() -> None:
    buffer: Buffer[bytes] = Buffer(100, 10_000)
    taken = sum(buffer.put(bytes(1000), 1000) for _ in range(50))
    assert taken == 7
    assert buffer.dropped == 43
    assert not buffer.put(b"", 0, below=0.5)
    small: Buffer[bytes] = Buffer(100, 10_000_000)
    assert sum(small.put(b"", 0) for _ in range(150)) == 100
    assert [small.get() for _ in range(101)][-1] is None
    assert Buffer(1, 1).put(b"one always fits", 10_000)


def test_producer_with_timeout_waits_for_room() -> None:
    buffer: Buffer[int] = Buffer(1, 1 << 20)
    assert buffer.put(1, 1)
    assert not buffer.put(2, 1, timeout_s=0.01)
    assert buffer.dropped == 0
    taker = threading.Thread(target=lambda: buffer.get(TIMEOUT_S))
    taker.start()
    assert buffer.put(2, 1, timeout_s=TIMEOUT_S)
    taker.join()
    assert buffer.get() == 2
