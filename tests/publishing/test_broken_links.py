"""MQTT over a link that breaks many times: every item arrives, and the exit status tells of a broker that is away."""

import json
import socket
from contextlib import suppress
from itertools import count

import pytest
from click.testing import CliRunner

from gateway.cli import treadlink
from gateway.clock import SystemClock
from gateway.publishing.sink import SinkSetting, open_sink
from gateway.publishing.sink_worker import SinkWorker
from tests.publishing.scripted_broker import ScriptedBroker
from tests.testkit.waiting import TIMEOUT_S, until

CUTS = 12


@pytest.fixture
def broker():
    broker = ScriptedBroker()
    yield broker
    broker.close()


@pytest.mark.parametrize("says_goodbye", [True, False])
@pytest.mark.parametrize("confirms", [True, False])
def test_every_item_arrives_over_a_link_that_breaks_many_times(items, broker, says_goodbye, confirms) -> None:
    name, sink = open_sink(f"mqtt://127.0.0.1:{broker.port}/car?discovery=off", SinkSetting())
    really_publish = sink._client.publish
    number = count()

    def publish(topic, *rest):
        if topic.endswith("/revolution") and len(broker.connects) <= CUTS:
            step = next(number) % 4
            if step == 1 and not confirms:
                broker.confirms.clear()
            elif step == 3:
                # The link breaks in the very call that sends: the case in which the client reports a failure.
                if says_goodbye:
                    broker.say_goodbye()
                else:
                    with suppress(OSError, AttributeError):  # it is closed already
                        sink._client.socket().shutdown(socket.SHUT_RDWR)
                broker.confirms.set()
        return really_publish(topic, *rest)

    sink._client.publish = publish
    worker = SinkWorker(name, sink, SystemClock())
    worker.start()
    for item in items:
        worker.offer(item)
    until(lambda: worker.snapshot().waiting == 0)
    broker.confirms.set()
    worker.finish()
    assert worker.join(TIMEOUT_S)
    worker.discard()
    assert len(broker.connects) > CUTS
    sent = [json.loads(message.payload) for message in broker.messages if message.topic.endswith("/revolution")]
    assert len({(each["wheel"], each["index"]) for each in sent}) == len(items) - 3
    assert (worker.snapshot().published, worker.snapshot().dropped) == (len(items) - 1, 0)
    assert not worker.is_left


def test_exit_status_tells_of_a_broker_that_is_away_at_the_end(broker) -> None:
    line = "live sim:lab?speed=max&duration=2 --plain --publish mqtt://127.0.0.1:{}/car"
    run = CliRunner().invoke(treadlink, line.format(broker.port))
    assert run.exit_code == 0, run.output
    broker.close()
    run = CliRunner().invoke(treadlink, line.format(broker.port))
    assert run.exit_code == 1
    assert "connection refused" in run.output.splitlines()[-1]
