"""Threads of a session: no failure is silent, nothing waits forever, dropped items are counted."""

from __future__ import annotations

import logging
import threading

import pytest

from gateway.clock import ManualClock, SystemClock
from gateway.errors import SourceError, TreadlinkError
from gateway.io.source import Chunk, LinkEvent, LinkEventKind
from gateway.session.core import SessionCore
from gateway.session.live import LiveSession
from gateway.session.recording_stage import Stage
from gateway.views.session_summary import ResultSummary

TIMEOUT_S = 20.0


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
    live = LiveSession(sources, vehicle, SystemClock(), patient=[patient] * len(sources), summary=ResultSummary())
    if change_take is not None:
        live.core.take = change_take(live.core.take)
    live.start()
    return live


def test_every_result_reaches_view_and_summary(demo, by_wheel):
    items, vehicle = demo
    source = ListSource(items)
    summary = ResultSummary()
    live = LiveSession([source], vehicle, ManualClock(), patient=[True], summary=summary)
    live.start()
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    reference = SessionCore(vehicle)
    expected = [result for item in items for result in reference.take(item)] + reference.finish()
    assert by_wheel(live.results()) == by_wheel(expected)
    assert sum(wheel.revolutions for wheel in summary.wheels()) == len(expected)
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
    with caplog.at_level(logging.INFO, "gateway.session"):
        live = session([ListSource(items[:5])], vehicle)
        assert live.wait(TIMEOUT_S)
        live.close()
    messages = [record.getMessage() for record in caplog.records]
    assert "session starts with sim:demo" in messages
    assert "session closed" in messages
