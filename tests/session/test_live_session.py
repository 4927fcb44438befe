"""Threads of a session: nothing dies silently, nothing waits for ever, what is dropped is counted."""

from __future__ import annotations

import threading

import pytest

from gateway.clock import ManualClock, SystemClock
from gateway.errors import SourceError, TreadlinkError
from gateway.io.source import Chunk, LinkEvent, LinkEventKind
from gateway.session.core import SessionCore
from gateway.session.live import LiveSession
from gateway.views.session_summary import ResultSummary

TIMEOUT_S = 20.0


class ListSource:
    """Yields given items, then raises or ends."""

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


def session(sources, vehicle=None, patient=True, core=None):
    core = core or SessionCore(vehicle)
    live = LiveSession(sources, core, SystemClock(), patient=[patient] * len(sources), summary=ResultSummary())
    live.start()
    return live


def test_every_result_reaches_view_and_summary(demo, by_wheel):
    items, vehicle = demo
    source = ListSource(items)
    core = SessionCore(vehicle)
    summary = ResultSummary()
    live = LiveSession([source], core, ManualClock(), patient=[True], summary=summary)
    live.start()
    assert live.wait(TIMEOUT_S)
    snapshot = live.close()
    reference = SessionCore(vehicle)
    expected = [result for item in items for result in reference.take(item)] + reference.finish()
    assert by_wheel(live.results()) == by_wheel(expected)
    assert sum(wheel.revolutions for wheel in summary.wheels()) == len(expected)
    assert snapshot.ended
    assert source.closed


def test_a_source_that_cannot_open_ends_the_session_with_its_own_words():
    failure = SourceError("no serial port '/dev/ttyUSB7'", "Plug the hub in.")
    live = session([ListSource([], failure=failure)])
    assert live.wait(TIMEOUT_S)
    with pytest.raises(SourceError, match="ttyUSB7"):
        live.close()


@pytest.mark.filterwarnings("ignore::pytest.PytestUnhandledThreadExceptionWarning")
def test_a_fault_of_our_own_in_a_thread_is_shown_not_swallowed(demo):
    items, vehicle = demo
    live = session([ListSource(items, failure=ZeroDivisionError("boom"))], vehicle)
    assert live.wait(TIMEOUT_S)
    with pytest.raises(TreadlinkError, match="boom"):
        live.close()


def test_a_core_that_fails_ends_the_session(demo):
    items, vehicle = demo
    core = SessionCore(vehicle)

    def broken(item):
        raise KeyError("lost wheel")

    core.take = broken
    live = session([ListSource(items)], core=core)
    assert live.wait(TIMEOUT_S)
    with pytest.raises(TreadlinkError, match="lost wheel"):
        live.close()


def test_marks_reach_the_recording_side(demo):
    items, vehicle = demo
    seen = []
    core = SessionCore(vehicle)
    take = core.take
    gate = threading.Event()

    def watching(item):
        if isinstance(item, LinkEvent) and item.kind is LinkEventKind.MARK:
            seen.append(item.text)
        return take(item)

    core.take = watching

    class Waiting(ListSource):
        def items(self, stop):
            yield from items[:10]
            gate.wait(TIMEOUT_S)

    live = session([Waiting(items)], core=core)
    live.mark("bump")
    gate.set()
    assert live.wait(TIMEOUT_S)
    live.close()
    assert seen == ["bump"]


def test_a_device_that_outruns_the_core_is_counted_not_waited_for(demo):
    items, vehicle = demo
    core = SessionCore(vehicle)
    hold = threading.Event()
    take = core.take

    def slow(item):
        hold.wait(TIMEOUT_S)
        return take(item)

    core.take = slow
    flood = [Chunk("sim:demo", items[0].host_ns + i, b"\0") for i in range(9000)]
    done = threading.Event()

    class Flood(ListSource):
        def items(self, stop):
            yield from flood
            done.set()

    live = session([Flood([])], patient=False, core=core)
    assert done.wait(TIMEOUT_S), "the reader waited for a core that is behind"
    hold.set()
    assert live.wait(TIMEOUT_S)
    (link,) = live.close().links
    dropped = link.queue_dropped["decoding"]
    assert dropped >= 9000 - 8192 - 1
    assert link.bytes_received + dropped == 9000
