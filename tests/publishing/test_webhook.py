"""Alarms by HTTP: each change arrives, also over a server that is away or refuses, and no secret is shown."""

import json
import threading

import pytest

from gateway.core.clock import SystemClock
from gateway.core.estimates.results import SinkState
from gateway.core.text.wording import text
from gateway.publishing.payloads import messages
from gateway.publishing.sink import SINKS, PublishedAlarm, PublishedRevolution, Sink, SinkError, SinkSetting, open_sink
from gateway.publishing.sink_worker import SinkWorker
from gateway.publishing.webhook import TOKEN
from tests.publishing.receivers import PostServer, finish, publish
from tests.testkit.waiting import until


def worker_of(name: str, sink: Sink) -> SinkWorker:
    return SinkWorker(name, sink, SystemClock(), alarms_only=SINKS["webhook"].alarms_only)


def test_alarms_arrive_and_nothing_else(server, items, monkeypatch) -> None:
    monkeypatch.setenv(TOKEN, "secret")
    name, sink = open_sink(f"webhook:http://127.0.0.1:{server.server_port}/hook/T0P?key=hidden", SinkSetting())
    assert "T0P" not in name
    assert "hidden" not in name
    worker = publish(worker_of(name, sink), items)
    alarms = [next(messages(item)) for item in items if isinstance(item, PublishedAlarm)]
    asked = [(path, authorization, json.loads(body)) for path, authorization, body in server.requests]
    assert asked == [("/hook/T0P?key=hidden", "Bearer secret", alarm) for alarm in alarms]
    assert [alarm["raised"] for alarm in alarms] == [True, False]
    assert worker.snapshot().published == 2, "revolutions are not sent, and not counted"
    assert not worker.is_left


@pytest.mark.parametrize("status", [307, 403, 500])
def test_a_refused_alarm_is_sent_again(server, items, status) -> None:
    server.status = status
    name, sink = open_sink(f"webhook:http://127.0.0.1:{server.server_port}/", SinkSetting())
    worker = worker_of(name, sink)
    worker.start()
    worker.offer(next(item for item in items if isinstance(item, PublishedAlarm)))
    until(lambda: worker.snapshot().state is SinkState.DOWN)
    until(lambda: len(server.requests) > 2)
    assert worker.snapshot().state is SinkState.DOWN, "it is down until the alarm is taken"
    server.status = 200
    finish(worker)
    assert (worker.snapshot().published, worker.snapshot().dropped) == (1, 0)
    assert {path for path, _, _ in server.requests} == {"/"}


@pytest.mark.parametrize("status", [400, 413, 422])
def test_an_alarm_that_is_wrong_for_the_server_holds_no_other_up(server, items, status) -> None:
    server.status = 500
    name, sink = open_sink(f"webhook:http://127.0.0.1:{server.server_port}/", SinkSetting())
    worker = worker_of(name, sink)
    worker.start()
    first, second = (item for item in items if isinstance(item, PublishedAlarm))
    worker.offer(first)
    until(lambda: worker.snapshot().state is SinkState.DOWN)
    server.status = status
    until(lambda: worker.snapshot().dropped == 1)
    assert str(status) in text(worker.snapshot().note)
    server.status = 200
    worker.offer(second)
    finish(worker)
    assert (worker.snapshot().published, worker.snapshot().dropped) == (1, 1)
    assert [json.loads(body)["raised"] for _, _, body in server.requests[-2:]] == [True, False]


def test_path_is_quoted_once(server, items) -> None:
    name, sink = open_sink(f"webhook:http://127.0.0.1:{server.server_port}/a b/ü%20?k=a b", SinkSetting())
    publish(worker_of(name, sink), items)
    assert {path for path, _, _ in server.requests} == {"/a%20b/%C3%BC%20?k=a%20b"}


def test_an_alarm_waits_for_a_server_that_is_away(items) -> None:
    server = PostServer()
    server.server_close()
    name, sink = open_sink(f"webhook:http://127.0.0.1:{server.server_port}/", SinkSetting())
    worker = worker_of(name, sink)
    worker.start()
    worker.offer(next(item for item in items if isinstance(item, PublishedAlarm)))
    until(lambda: worker.snapshot().state is SinkState.DOWN)
    worker.offer(next(item for item in items if isinstance(item, PublishedRevolution)))
    assert worker.snapshot().waiting == 1, "revolutions take no room from alarms"
    back = PostServer(server.server_port)
    thread = threading.Thread(target=back.serve_forever, args=(0.01,))
    thread.start()
    finish(worker)
    back.shutdown()
    thread.join()
    back.server_close()
    assert len(back.requests) == 1


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("webhook:ftp://host/x", "no address of a web server"),
        ("webhook:hooks", "no address of a web server"),
        ("webhook:https://user:word@host/x", "password"),
    ],
)
def test_wrong_addresses_are_named(uri: str, words: str) -> None:
    with pytest.raises(SinkError, match=words) as error:
        open_sink(uri, SinkSetting())
    assert "word@" not in str(error.value)
