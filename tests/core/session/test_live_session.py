"""Threads of a session: no failure is silent, nothing waits forever, dropped items are counted."""

import logging
import threading

import pytest

from gateway.core.clock import ManualClock, SystemClock
from gateway.core.errors import RecordingError, SourceError, TreadlinkError
from gateway.core.estimates.results import WheelState
from gateway.core.links.playback import Playback
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.run_description import RunDescription, TireIdentity
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.alarms import AlarmName
from gateway.core.session.core import SessionCore
from gateway.core.session.live import LiveSession, Recordings
from gateway.core.session.reasons import SessionCode
from gateway.core.session.recording_stage import Stage
from gateway.core.text.wording import notice_text
from tests.testkit.waiting import TIMEOUT_S, HeldClock, until


class ListSource:
    """A source of given items that then raises or ends."""

    vehicle_toml = None

    def __init__(self, items, link="sim:demo", failure=None):
        self._items, self.link, self._failure = items, link, failure
        self.closed = False

    def items(self, stop):
        for item in self._items:
            if stop.is_set():
                return
            yield item
        if self._failure is not None:
            raise self._failure

    def close(self):
        self.closed = True


def session(sources, vehicle=None, patient=True, change_take=None):
    """Start a session; `change_take` may replace the core's `take` by another function made from it."""
    live = LiveSession(sources, SessionCore(vehicle), SystemClock(), patient=[patient] * len(sources))
    if change_take is not None:
        live.core.take = change_take(live.core.take)
    live.start()
    return live


def test_every_result_reaches_view_and_summary(demo, by_wheel):
    items, vehicle = demo
    source = ListSource(items)
    live = LiveSession([source], SessionCore(vehicle), ManualClock(), patient=[True])
    live.start()
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    reference = SessionCore(vehicle)
    expected = [result for item in items for result in reference.take(item)] + reference.finish()
    assert by_wheel(live.results()) == by_wheel(expected)
    assert sum(wheel.revolutions for wheel in live.summary.wheels()) == len(expected)
    assert snapshot.ended
    assert source.closed


def test_source_that_cannot_open_ends_the_session():
    failure = SourceError("no serial port '/dev/ttyUSB7'", "Plug the hub in.")
    live = session([ListSource([], failure=failure)])
    assert live.wait(TIMEOUT_S)
    with pytest.raises(SourceError, match="ttyUSB7"):
        live.close()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_internal_error_of_a_thread_is_raised(demo):
    items, vehicle = demo
    live = session([ListSource(items, failure=ZeroDivisionError("boom"))], vehicle)
    assert live.wait(TIMEOUT_S)
    with pytest.raises(TreadlinkError, match="boom"):
        live.close()


def test_failing_core_ends_the_session(demo):
    items, vehicle = demo

    def broken(item):
        raise KeyError("lost wheel")

    live = session([ListSource(items)], vehicle, change_take=lambda _: broken)
    assert live.wait(TIMEOUT_S)
    with pytest.raises(TreadlinkError, match="lost wheel"):
        live.close()


def test_marks_reach_the_core(demo):
    items, vehicle = demo
    seen = []
    gate = threading.Event()

    def watching(take):
        def watched(item):
            if isinstance(item, LinkEvent) and item.kind is LinkEventKind.MARK:
                seen.append(item.text)
            return take(item)

        return watched

    class Waiting(ListSource):
        def items(self, stop):
            yield from items[:10]
            gate.wait(TIMEOUT_S)

    live = session([Waiting(items)], vehicle, change_take=watching)
    live.mark("bump")
    gate.set()
    assert live.wait(TIMEOUT_S)
    live.close()
    assert seen == ["bump"]


def test_device_faster_than_the_core_loses_counted_items(demo):
    items, vehicle = demo
    hold = threading.Event()

    def slow(take):
        def held(item):
            hold.wait(TIMEOUT_S)
            return take(item)

        return held

    flood = [Chunk("sim:demo", items[0].host_ns + i, b"\0") for i in range(9000)]
    done = threading.Event()

    class Flood(ListSource):
        def items(self, stop):
            yield from flood
            done.set()

    live = session([Flood([])], vehicle, patient=False, change_take=slow)
    assert done.wait(TIMEOUT_S), "the reader waited for a core that is behind"
    hold.set()
    assert live.wait(TIMEOUT_S)
    (link,) = live.close().links
    dropped = link.queue_dropped[Stage.DECODING]
    assert dropped >= 9000 - 8192 - 1
    assert link.bytes_received + dropped == 9000


def test_session_logs_start_and_end(demo, caplog):
    items, vehicle = demo
    with caplog.at_level(logging.INFO, "gateway.core.session"):
        live = session([ListSource(items[:5])], vehicle)
        assert live.wait(TIMEOUT_S)
        live.close()
    messages = [record.getMessage() for record in caplog.records]
    assert "session starts with sim:demo" in messages
    assert "session closed" in messages


class Held(ListSource):
    """A source that has nothing more to give until its gate opens."""

    def __init__(self, items, link="sim:demo"):
        super().__init__(items, link)
        self.gate, self.waits = threading.Event(), threading.Event()

    def items(self, stop):
        yield from self._items
        self.waits.set()
        self.gate.wait(TIMEOUT_S)


def test_silence_grows_although_no_byte_arrives(demo):
    items, vehicle = demo
    clock, source = HeldClock(items[0].host_ns), Held(items[:-1])
    live = LiveSession([source], SessionCore(vehicle), clock, patient=[False])
    live.start()
    until(lambda: source.waits.is_set() and not live._items)
    clock.advance_ns(25_000_000_000)
    until(lambda: clock.advance_ns(100_000_000) or live.snapshot().links[0].silent_s is not None)
    snapshot = live.snapshot()
    assert {wheel.state for wheel in snapshot.wheels} == {WheelState.SILENT}
    assert [alarm.name for alarm in snapshot.alarms] == [AlarmName.SILENT]
    source.gate.set()
    assert live.wait(TIMEOUT_S)
    (record,) = live.close().alarm_records
    assert (record.position, record.is_standing) == ("hub 0", True)
    assert any(notice.reason.code is SessionCode.ALARM_RAISED for notice in live.notices())


def test_source_that_waits_for_the_core_is_not_silent(demo):
    items, vehicle = demo
    clock, source = HeldClock(items[0].host_ns + 3600 * 10**9), Held(items[:-1])
    live = LiveSession([source], SessionCore(vehicle), clock, patient=[True])
    live.start()
    until(lambda: source.waits.is_set() and not live._items)
    until(lambda: clock.advance_ns(10_000_000_000) or live.snapshot().elapsed_s > 100.0)
    assert not live.snapshot().alarms
    source.gate.set()
    assert live.wait(TIMEOUT_S)
    assert live.close().alarm_records == ()


def test_items_that_wait_are_not_missing(demo):
    items, vehicle = demo
    live = LiveSession([ListSource(items)], SessionCore(vehicle), SystemClock(), patient=[False])
    live._note_time(items[1])
    live._items.put(items[2], 1, timeout_s=0.0)
    assert live._link_times_ns(items[1].host_ns + 10**12) == {"sim:demo": items[1].host_ns}
    live._items.get(0.0)
    assert live._link_times_ns(items[1].host_ns + 10**12) == {"sim:demo": items[1].host_ns + 10**12}


def test_paused_replay_stands_still(demo):
    items, vehicle = demo

    class Replay(ListSource):
        def __init__(self, clock):
            super().__init__(items)
            self.playback = Playback(clock, 1.0)
            self.given = 0

        def items(self, stop):
            for item in self._items:
                if not self.playback.wait_until(item.host_ns, stop, threading.Event()):
                    return
                self.given += 1
                yield item

    clock = HeldClock(0)
    source = Replay(clock)
    live = LiveSession([source], SessionCore(vehicle), clock, patient=[True])
    live.start()
    clock.advance_ns(500_000_000)
    until(lambda: source.given and live.snapshot().elapsed_s == 0.5)
    assert live.pause(True)
    stated = source.given
    clock.advance_ns(60_000_000_000)
    until(lambda: live._clock.now_ns() == clock.now_ns())
    for _ in range(20):
        threading.Event().wait(0.01)
        assert source.given <= stated + 1, "the item in hand may pass"
    assert live.snapshot().elapsed_s == pytest.approx(0.5)
    assert not live.snapshot().alarms, "a pause is no silence"
    assert live.pause(False)
    clock.advance_ns(10_000_000_000)
    assert live.wait(TIMEOUT_S)
    assert live.close().alarm_records == ()
    assert source.given == len(items)


def test_hub_cannot_be_paused(demo):
    items, vehicle = demo
    live = session([ListSource(items[:5])], vehicle)
    assert not live.pause(True)
    assert live.wait(TIMEOUT_S)
    live.close()


def test_mark_without_a_recording_says_so(demo):
    items, vehicle = demo
    source = Held(items[:10])
    live = session([source], vehicle)
    assert not live.mark("bump")
    source.gate.set()
    assert live.wait(TIMEOUT_S)
    live.close()
    (mark,) = [notice for notice in live.notices() if LinkCode.MARK in {inner.code for inner in notice.reason}]
    assert notice_text(mark) == "mark: bump: not kept: nothing is recorded"
    assert not live.mark("late")
    assert notice_text(live.snapshot().notices[-1]) == "mark: late: not kept: nothing is recorded"


def test_mark_after_the_end_of_a_recorded_session_is_not_kept(demo, tmp_path):
    items, vehicle = demo
    writer = RecordingWriter(tmp_path / "r.mcap", start_ns=1)
    source = Held(items[:10])
    live = LiveSession([source], SessionCore(vehicle), SystemClock(), patient=[True], recordings=Recordings(writer))
    live.start()
    assert live.mark("bump")
    source.gate.set()
    assert live.wait(TIMEOUT_S)
    assert not live.mark("late")
    assert notice_text(live.snapshot().notices[-1]) == "mark: late: not kept: nothing is recorded"
    live.close()
    events = [item for item in RecordingReader(tmp_path / "r.mcap").items() if isinstance(item, LinkEvent)]
    assert [event.text for event in events if event.kind is LinkEventKind.MARK] == ["bump"]


def started_in(folder, items, may_record=True):
    """Return a session on a source that waits at its end, so that recordings can begin and end."""
    release = threading.Event()

    class Waiting(ListSource):
        def items(self, stop):
            yield from items[: len(items) // 2]
            release.wait(TIMEOUT_S)
            yield from items[len(items) // 2 :]

    def opened(run):
        return RecordingWriter(folder, start_ns=1, run=run)

    live = LiveSession(
        [Waiting(items)],
        SessionCore(None),
        SystemClock(),
        patient=[True],
        recordings=Recordings(
            begin=opened if may_record else None, run=RunDescription("wet braking", "Ada", tags=("wet",))
        ),
    )
    live.start()
    return live, release


def test_form_describes_the_recording_as_the_options_do(demo, tmp_path):
    live, release = started_in(tmp_path, demo[0])
    assert live.run_form == {"test": "wet braking", "driver": "Ada", "tire": "", "comment": "", "tags": "wet"}
    for wrong, words in (
        ({"tire": "FL"}, "POSITION:KEY=VALUE"),
        ({"tire": "FL:colour=red"}, "no key 'colour'"),
        ({"tire": "FL:wear_mm=1"}, "changes estimates"),
    ):
        with pytest.raises(RecordingError, match=words):
            live.start_recording(wrong)
    assert not list(tmp_path.iterdir()), "a wrong form records nothing"
    form = {"driver": "", "comment": " gusts ", "tags": "wet, night,", "tire": "FL:maker=Acme,dot=3524; FR:dot=3525"}
    live.start_recording(form)
    until(lambda: live.snapshot().recording)
    live.stop_recording()
    (path,) = tmp_path.iterdir()
    tires = {"FL": TireIdentity("Acme", "3524"), "FR": TireIdentity("", "3525")}
    assert RecordingReader(path).info.run == RunDescription("wet braking", "", "gusts", ("wet", "night"), tires)
    assert live.run_form["comment"] == "gusts", "the next recording is asked with it"
    release.set()
    live.close()


def test_recording_begins_and_ends_during_the_session(demo, tmp_path):
    items, _ = demo
    live, release = started_in(tmp_path, items)
    until(lambda: live.snapshot().links[0].connected)
    live.start_recording()
    live.start_recording()  # the one that runs goes on
    until(lambda: live.snapshot().recording)
    live.mark("begun")
    release.set()
    assert live.wait(TIMEOUT_S)
    live.close()
    (path,) = tmp_path.iterdir()
    recorded = RecordingReader(path)
    assert recorded.info.finished
    events = [item for item in recorded.items() if isinstance(item, LinkEvent)]
    assert [event.kind for event in events][:2] == [LinkEventKind.CONNECTED, LinkEventKind.MARK]
    assert events[1].text == "begun"
    assert events[1].details == ()
    data = b"".join(item.data for item in items[len(items) // 2 :] if isinstance(item, Chunk))
    assert b"".join(item.data for item in recorded.items() if isinstance(item, Chunk)) == data
    with pytest.raises(RecordingError, match="begins no recording"):
        live.start_recording()


def test_recording_that_is_ended_is_finished_at_once(demo, tmp_path):
    items, _ = demo
    live, release = started_in(tmp_path, items)
    for number in (1, 2):
        live.start_recording()
        until(lambda: live.snapshot().recording)
        live.stop_recording()
        assert all(RecordingReader(path).info.finished for path in tmp_path.iterdir())
        assert len(list(tmp_path.iterdir())) == number
        until(lambda: not live.snapshot().recording)
    live.mark("lost")
    release.set()
    live.wait(TIMEOUT_S)
    live.close()
    texts = [notice_text(notice) for notice in live.notices()]
    assert sum("finished" in text for text in texts) == 2
    assert any("lost" in text and "not kept" in text for text in texts)


def test_session_that_may_not_record_says_so(demo, tmp_path):
    live, release = started_in(tmp_path, demo[0], may_record=False)
    with pytest.raises(RecordingError, match="begins no recording"):
        live.start_recording()
    release.set()
    live.close()
    assert list(tmp_path.iterdir()) == []
