"""A slow, dead or faulty receiver holds nothing: its buffer is bounded, drops are counted, it is reached again."""

import threading
from dataclasses import replace

import pytest

from gateway.core.clock import ManualClock, SystemClock
from gateway.core.estimates.results import RevolutionResult, SinkState
from gateway.core.links.reconnect import Backoff
from gateway.core.reasons import CoreCode, Reason
from gateway.publishing import publisher as publisher_module
from gateway.publishing import sink_worker
from gateway.publishing.publisher import Publisher, open_publisher
from gateway.publishing.reasons import PublishingCode
from gateway.publishing.sink import (
    PublishedRevolution,
    PublishedState,
    SinkDownError,
    SinkError,
    SinkRefusedError,
    SinkSetting,
    open_sink,
)
from gateway.publishing.sink_worker import SinkWorker
from tests.publishing.receivers import Receiver, finish
from tests.testkit.waiting import TIMEOUT_S, HeldClock, until


class PausesClock(HeldClock):
    """A held clock that keeps the lengths of the pauses on it."""

    def __init__(self) -> None:
        super().__init__()
        self.pauses_ms: list[float] = []

    def sleep_until_ns(self, deadline_ns: int, stop: threading.Event | None = None) -> bool:
        self.pauses_ms.append((deadline_ns - self.now_ns()) * 1e-6)
        return super().sleep_until_ns(deadline_ns, stop)


def begin(receiver: Receiver, *, max_items: int = 8192, clock=None) -> SinkWorker:
    worker = SinkWorker("test:x", receiver, clock or SystemClock(), max_items=max_items)
    worker.start()
    return worker


def test_receiver_gets_items_in_order(items) -> None:
    receiver = Receiver()
    worker = begin(receiver)
    for item in items:
        worker.offer(item)
    finish(worker)
    assert receiver.taken == list(items[:-1])
    assert receiver.states == 1
    result = worker.snapshot()
    assert (result.published, result.dropped, result.waiting) == (len(items) - 1, 0, 0)
    assert result.note.code is CoreCode.SINK_CLOSED


def test_stalled_receiver_is_bounded_and_counted(items) -> None:
    receiver, clock = Receiver(), ManualClock()
    receiver.gate.clear()
    worker = begin(receiver, max_items=20, clock=clock)
    worker.offer(items[0])
    assert receiver.entered.wait(TIMEOUT_S)
    for item in items[1:61]:
        worker.offer(item)
    clock.advance_ns(1_500_000_000)
    result = worker.snapshot()
    assert (result.state, result.note.code) == (SinkState.STALLED, PublishingCode.SINK_STALLED)
    assert result.since_s == pytest.approx(1.5, abs=0.01)
    assert result.is_dropping
    # One in the hand of the thread, 19 of 20 places: the last one is for alarms.
    assert (result.published, result.waiting, result.dropped) == (0, 20, 41)
    worker.offer(items[-3])
    assert worker.snapshot().waiting == 21
    receiver.gate.set()
    until(lambda: worker.snapshot().published == 21)
    clock.advance_ns(11_000_000_000)
    after = worker.snapshot()
    assert (after.state, after.is_dropping, after.dropped) == (SinkState.UP, False, 41)
    worker.abandon()


def test_lost_receiver_is_reached_again_with_the_same_item(items) -> None:
    receiver = Receiver()
    worker = begin(receiver)
    worker.offer(items[0])
    until(lambda: receiver.taken)
    receiver.present.clear()
    worker.offer(items[1])
    until(lambda: receiver.opened > 3)
    down = worker.snapshot()
    assert (down.state, down.note.code, down.waiting) == (SinkState.DOWN, PublishingCode.SINK_LOST, 1)
    receiver.present.set()
    finish(worker)
    assert receiver.taken == list(items[:2])
    assert worker.snapshot().dropped == 0


def test_receiver_that_ends_each_connection_is_tried_less_and_less_often(items, monkeypatch) -> None:
    monkeypatch.setattr(sink_worker, "BACKOFF", Backoff(first_ns=10_000_000, cap_ns=50_000_000))
    receiver, clock = Receiver(), PausesClock()
    lasted_ms = iter([0, 0, 49, 0, 0, 51, 0, 0])

    def send(item, stop) -> None:
        clock.advance_ns(next(lasted_ms, 0) * 1_000_000)
        raise SinkDownError("the broker ended the connection")

    receiver.send = send
    worker = begin(receiver, clock=clock)
    worker.offer(items[0])
    until(lambda: len(clock.pauses_ms) >= 8)
    worker.abandon()
    assert worker.join(TIMEOUT_S)
    # Doubling to the longest pause; a connection that has lasted longer begins anew.
    assert clock.pauses_ms[:8] == [10, 20, 40, 50, 50, 10, 10, 20]


def test_stall_that_ends_in_a_loss_is_one_absence(items) -> None:
    receiver, clock = Receiver(), HeldClock()
    receiver.gate.clear()
    worker = begin(receiver, clock=clock)
    worker.offer(items[0])
    assert receiver.entered.wait(TIMEOUT_S)
    clock.advance_ns(5_000_000_000)
    receiver.present.clear()
    receiver.gate.set()
    until(lambda: worker.snapshot().state is SinkState.DOWN)
    assert worker.snapshot().since_s == pytest.approx(5.0, abs=0.01)
    receiver.present.set()
    until(lambda: worker.snapshot().state is SinkState.UP)
    assert worker.snapshot().since_s == 0.0
    worker.abandon()


def test_fault_of_an_output_costs_one_item_only(items) -> None:
    receiver = Receiver()
    receiver.poison = items[1]
    worker = begin(receiver)
    for item in items[:3]:
        worker.offer(item)
    finish(worker)
    assert receiver.taken == [items[0], items[2]]
    assert (worker.snapshot().published, worker.snapshot().dropped) == (2, 1)


def test_reader_that_left_gets_nothing_more(items) -> None:
    receiver = Receiver()
    receiver.has_left = True
    worker = begin(receiver)
    worker.offer(items[0])
    until(lambda: worker.has_ended)
    assert worker.join(TIMEOUT_S)
    worker.offer(items[1])
    worker.discard()
    assert (worker.snapshot().published, worker.snapshot().dropped) == (0, 2)
    assert receiver.opened == 1


def test_states_replace_each_other(items) -> None:
    receiver = Receiver()
    receiver.gate.clear()
    worker = begin(receiver, max_items=5)
    state = items[-1]
    assert isinstance(state, PublishedState)
    for index in range(100):
        worker.offer(replace(state, host_ns=index))
    assert worker.snapshot().dropped == 0
    receiver.gate.set()
    finish(worker)
    assert 1 <= receiver.states <= 2


def test_state_that_comes_while_one_is_taken_is_sent(items) -> None:
    class Offering(ManualClock):
        """A clock at whose look a newer state comes."""

        def now_ns(self) -> int:
            for state in newer:
                newer.clear()
                worker.offer(state)
            return super().now_ns()

    newer: list[PublishedState] = []
    worker = SinkWorker("test:x", Receiver(), Offering())
    states = [replace(items[-1], host_ns=index) for index in range(2)]
    worker.offer(states[0])
    newer.append(states[1])
    assert [worker._next(), worker._next(), worker._state] == [*states, None]


def test_end_of_a_session_is_told_after_a_lost_connection(items) -> None:
    receiver, clock = Receiver(), PausesClock()
    receiver.present.clear()
    worker = SinkWorker("test:x", receiver, clock)
    ended = replace(items[-1], snapshot=replace(items[-1].snapshot, ended=True))
    for state, remaining in ((replace(ended, snapshot=replace(ended.snapshot, ended=False)), None), (ended, ended)):
        worker._pending_item = state
        worker._stop.set()
        worker._back_off(Reason(PublishingCode.SINK_LOST, error="x", interval_s=1.0))
        assert worker._pending_item is remaining


def test_unconfirmed_items_count_as_dropped(items) -> None:
    receiver = Receiver()
    receiver.unconfirmed = 2
    worker = begin(receiver)
    for item in items[:5]:
        worker.offer(item)
    finish(worker)
    assert (worker.snapshot().published, worker.snapshot().dropped) == (3, 2)


def test_drops_are_told_by_what_causes_them(items) -> None:
    class Refusing(Receiver):
        refused = 0

        def send(self, item, stop) -> None:
            count, self.refused = self.refused, 0
            if count:
                raise SinkRefusedError("quota exceeded", count)
            super().send(item, stop)

    receiver = Refusing()
    worker = begin(receiver, max_items=20, clock=ManualClock())
    worker.offer(items[0])
    until(lambda: worker.snapshot().published == 1)
    receiver.refused = 1
    worker.offer(items[1])
    until(lambda: worker.snapshot().dropped == 1)
    assert worker.snapshot().note == Reason(PublishingCode.SINK_REFUSED, error="quota exceeded")
    until(lambda: worker.snapshot().published == 1)  # the second, in place of the first
    receiver.gate.clear()
    for item in items[2:40]:
        worker.offer(item)
    assert worker.snapshot().note == Reason(PublishingCode.SINK_FULL)
    receiver.gate.set()
    finish(worker)


def test_end_leaves_a_dead_receiver_and_waits_for_a_slow_one(items, monkeypatch) -> None:
    monkeypatch.setattr(publisher_module, "FINISH_STUCK_S", 0.2)
    dead, slow = Receiver(), Receiver()
    dead.gate.clear()
    slow.send = lambda item, stop: (threading.Event().wait(0.02), slow.taken.append(item))[1]
    workers = [SinkWorker(name, sink, SystemClock()) for name, sink in (("dead", dead), ("slow", slow))]
    publisher = Publisher(workers, SystemClock())
    results = [item.result for item in items[:30]]
    publisher.take(results, 0)
    first, second = publisher.close()
    assert (first.published, first.dropped) == (0, 30)
    assert (second.published, second.dropped) == (30, 0)


def test_published_revolutions_carry_no_waveforms(items) -> None:
    receiver = Receiver()
    publisher = Publisher([SinkWorker("x", receiver, SystemClock())], SystemClock())
    result = items[0].result
    publisher.take([result], 0)
    publisher.close()
    (taken,) = receiver.taken
    assert isinstance(taken, PublishedRevolution)
    light = taken.result.revolution
    assert light.radial_mps2.size == light.axes_mps2.size == light.orders_mps2.size == 0
    assert taken.result.estimates == result.estimates
    assert isinstance(taken.result, RevolutionResult)


@pytest.mark.parametrize(
    ("uri", "message"),
    [
        ("nope:x", "unknown live output"),
        ("jsonl:", "no target"),
        ("jsonl:/nosuch/folder/x", "cannot publish"),
        ("jsonl:-?colour=red", "no option 'colour'"),
        ("jsonl:-?append=perhaps", "not allowed"),
        ("mqtt://user:secret@host/x", "password"),
        ("mqtt:///prefix", "no host"),
        ("mqtt://host/a+b", "cannot contain"),
        ("mqtt://host/a?keepalive=0", "keepalive"),
        ("mqtt://host/a?ca=x.pem", "no option 'ca'"),
        ("mqtts://host/a?ca=/nosuch.pem", "cannot use ca="),
        ("mqtts://host/a?key=/nosuch.pem", "key without cert"),
        ("mqtt://host:99999/a", "Port out of range"),
        ("foxglove://127.0.0.1:8765/path", "path"),
        ("can:nosuch:x", "does not name"),
        ("can:virtual", "does not name"),
        ("can:virtual:x?base_id=0x7f0", "leaves no room"),
        ("can:virtual:x?base_id=abc", "not a number"),
    ],
)
def test_wrong_addresses_are_refused_before_the_session(uri: str, message: str) -> None:
    with pytest.raises(SinkError, match=message.replace("'", ".")) as result:
        open_sink(uri, SinkSetting())
    assert result.value.remedy
    assert "secret" not in str(result.value) + result.value.remedy


def test_an_output_given_twice_is_refused(tmp_path) -> None:
    uri = f"jsonl:{tmp_path}/x"
    with pytest.raises(SinkError, match="given twice"):
        open_publisher([uri, f"{uri}?states=yes"], SinkSetting(), SystemClock())
    assert open_publisher([], SinkSetting(), SystemClock()) is None


def test_missing_package_names_the_extra(monkeypatch) -> None:
    import sys

    monkeypatch.setitem(sys.modules, "paho", None)
    monkeypatch.setitem(sys.modules, "paho.mqtt", None)
    monkeypatch.setitem(sys.modules, "paho.mqtt.client", None)
    monkeypatch.delitem(sys.modules, "gateway.publishing.mqtt", raising=False)
    with pytest.raises(SinkError) as result:
        open_sink("mqtts://host/x", SinkSetting())
    assert "treadlink[mqtt]" in result.value.remedy


def test_states_are_wanted_at_the_interval_of_the_output() -> None:
    worker = SinkWorker("x", Receiver(), ManualClock(), state_interval_s=0.25)
    wanted = [worker.wants_state(round(at_s * 1e9)) for at_s in (0.0, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6)]
    assert wanted == [True, False, False, True, False, False, True]
