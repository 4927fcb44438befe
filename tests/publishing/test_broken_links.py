"""MQTT over a link that breaks many times: every item arrives, and the exit status tells of a broker that is away."""

import json
import random
from dataclasses import replace
from itertools import count, cycle, islice

import pytest

from gateway.core.clock import SystemClock
from gateway.core.reasons import Reason
from gateway.publishing import mqtt
from gateway.publishing.reasons import PublishingCode
from gateway.publishing.sink import PublishedRevolution, SinkSetting, open_sink
from gateway.publishing.sink_worker import SinkWorker
from tests.publishing.receivers import finish, publish, worker_of
from tests.publishing.scripted_broker import CUTS, ScriptedBroker
from tests.testkit.commands import invoked
from tests.testkit.waiting import until
from tools.mqtt_broker import PROGRAM, Broker


@pytest.fixture
def broker():
    broker = ScriptedBroker()
    yield broker
    broker.close()


def many(items, count: int) -> list[PublishedRevolution]:
    """Return revolutions with numbers of their own."""
    revolutions = [item for item in items if isinstance(item, PublishedRevolution)]
    return [
        replace(item, result=replace(item.result, revolution=replace(item.result.revolution, index=index)))
        for index, item in enumerate(islice(cycle(revolutions), count))
    ]


def publish_over_cuts(items, broker, cuts, confirms: bool) -> set[str]:
    """Publish with a cut in every fourth call that sends a revolution; return the causes that the client stated."""
    name, sink = open_sink(f"mqtt://127.0.0.1:{broker.port}/car?discovery=off", SinkSetting())
    really_publish, really_close = sink._client.publish, sink.close
    ways, number, causes = list(cuts), count(), set()

    def publish(topic, *rest):
        if topic.endswith("/revolution") and ways:
            step = next(number) % 4
            if step == 1 and not confirms:
                broker.swallowed = 2
            elif step == 3:
                # The link breaks in the very call that sends: the case in which the client reports a failure.
                broker.cut(ways.pop(0))
        return really_publish(topic, *rest)

    def close():
        causes.add(sink._refusal)
        really_close()

    sink._client.publish, sink.close = publish, close
    worker = SinkWorker(name, sink, SystemClock())
    worker.start()
    revolutions = many(items, 4 * len(cuts) + 8)
    for item in revolutions:
        worker.offer(item)
    until(lambda: worker.snapshot().waiting == 0, 120.0)
    finish(worker)
    worker.discard()
    assert not ways, "every cut was made"
    assert len(broker.connects) > len(cuts)
    sent = {
        json.loads(message.payload)["index"] for message in broker.messages if message.topic.endswith("/revolution")
    }
    assert sent == set(range(len(revolutions)))
    assert (worker.snapshot().published, worker.snapshot().dropped) == (len(revolutions), 0)
    assert not worker.is_left
    return causes


@pytest.mark.parametrize("confirms", [True, False])
def test_every_item_arrives_over_a_link_that_breaks_in_every_way(items, broker, confirms) -> None:
    causes = publish_over_cuts(items, broker, CUTS, confirms)
    assert any("the broker ended the connection: " in cause for cause in causes)


def test_a_broker_that_swallows_confirmations_is_left_and_gets_the_items_again(items, broker, monkeypatch) -> None:
    """It answers pings, so only the missing confirmations tell; a full window would wait for ever."""
    monkeypatch.setattr(mqtt, "CONFIRM_S", 0.5)
    worker = worker_of(f"mqtt://127.0.0.1:{broker.port}/car?discovery=off")
    worker.start()
    until(lambda: worker.snapshot().state == "up")
    revolutions = many(items, 60)
    broker.swallowed = mqtt.WINDOW
    for item in revolutions:
        worker.offer(item)
    until(lambda: worker.snapshot().waiting == 0)
    finish(worker)
    assert len(broker.connects) == 2
    sent = {
        json.loads(message.payload)["index"] for message in broker.messages if message.topic.endswith("/revolution")
    }
    assert sent == set(range(len(revolutions)))
    assert (worker.snapshot().published, worker.snapshot().dropped) == (len(revolutions), 0)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(10))
def test_every_item_arrives_over_a_hundred_cuts(items, broker, seed) -> None:
    generator = random.Random(seed)
    cuts = [*CUTS, *generator.choices(CUTS, k=100 - len(CUTS))]
    generator.shuffle(cuts)
    publish_over_cuts(items, broker, cuts, confirms=bool(seed % 2))


@pytest.mark.slow
@pytest.mark.skipif(PROGRAM is None, reason="needs mosquitto")
def test_a_broker_that_restarts_a_hundred_times_is_reached_again(items, tmp_path) -> None:
    broker = Broker(tmp_path).start()
    worker = worker_of(f"mqtt://127.0.0.1:{broker.port}/car")
    worker.start()
    try:
        for number, item in enumerate(many(items, 100)):
            until(lambda: worker.snapshot().state == "up")
            worker.offer(item)
            end = broker.stop if number % 2 else broker.kill
            end()
            broker.start()
        finish(worker)
    finally:
        broker.kill()
    worker.discard()
    assert (worker.snapshot().published, worker.snapshot().dropped, worker.is_left) == (100, 0, False)


def test_a_broker_that_refuses_connections_is_reached_when_it_takes_one(items, broker) -> None:
    broker.connect_refusals += [0x97, 0x89, 0x87, 0x9C]  # quota, busy, not authorized, another server
    worker = worker_of(f"mqtt://127.0.0.1:{broker.port}/car")
    publish(worker, [items[0]])
    assert len(broker.connects) == 5
    assert (worker.snapshot().published, worker.is_left) == (1, False)


def test_items_that_the_broker_refuses_count_as_dropped(items, broker) -> None:
    broker.refusals += [0x87, 0x97, 0x10]  # not authorized, quota exceeded; without a subscriber it is taken
    worker = worker_of(f"mqtt://127.0.0.1:{broker.port}/car")
    worker.start()
    for item in items[:-1]:
        worker.offer(item)
    until(lambda: worker.snapshot().dropped == 2)
    assert worker.snapshot().note == Reason(PublishingCode.SINK_REFUSED, error="quota exceeded")
    assert worker.snapshot().is_dropping
    broker.refusals += [0x83]
    worker.offer(items[0])
    finish(worker)
    assert (worker.snapshot().published, worker.snapshot().dropped) == (len(items) - 3, 3)
    assert worker.is_left, "the exit status tells"


def test_exit_status_tells_of_a_broker_that_is_away_at_the_end(broker) -> None:
    line = "live sim:lab?speed=max&duration=2 --plain --publish mqtt://127.0.0.1:{}/car"
    run = invoked(line.format(broker.port))
    assert run.exit_code == 0, run.output
    broker.close()
    run = invoked(line.format(broker.port))
    assert run.exit_code == 1
    assert "connection refused" in run.output.splitlines()[-1]
