"""States that a broker keeps after a session: they say that it is over, and none has a number of it."""

import json

import jsonschema
import pytest

from gateway.clock import SystemClock
from gateway.publishing.line_schema import line_schema
from gateway.publishing.sink import SinkSetting, open_sink
from gateway.publishing.sink_worker import SinkWorker
from tests.publishing.scripted_broker import Received, ScriptedBroker
from tests.testkit.waiting import TIMEOUT_S

EXPIRES_AFTER_30_S = b"\x02\x00\x00\x00\x1e"
PRESENT = {"rate_hz", "speed_mps", "pressure_pa", "temperature_degc", "load_n", "battery_percent", "rssi_dbm"}


@pytest.fixture
def published(items):
    """All messages of a session with one state."""
    broker = ScriptedBroker()
    name, sink = open_sink(f"mqtt://127.0.0.1:{broker.port}/car?discovery=off", SinkSetting())
    worker = SinkWorker(name, sink, SystemClock())
    worker.start()
    worker.offer(items[-1])
    worker.finish()
    assert worker.join(TIMEOUT_S)
    broker.close()
    return broker


def of_states(broker: ScriptedBroker) -> dict[str, list[Received]]:
    topics = {message.topic for message in broker.messages if message.topic != "car/status"}
    return {topic: [message for message in broker.messages if message.topic == topic] for topic in topics}


def test_last_states_have_no_numbers_and_say_that_the_session_is_over(published) -> None:
    states = of_states(published)
    assert len(states) == 4 + 1 + 1
    for topic, (_, last) in states.items():
        payload = json.loads(last.payload)
        jsonschema.Draft202012Validator(line_schema()).validate(payload)
        assert last.is_retained
        assert not PRESENT & payload.keys()
        assert payload["alarms"] == []
        expected = {"wheel": ("state", "no data"), "link": ("connected", False), "session": ("ended", True)}
        name, value = expected[payload["type"]]
        assert payload[name] == value, topic
    assert published.messages[-1][:2] == ("car/status", b"offline")


def test_states_of_a_gateway_that_dies_expire(published) -> None:
    assert b"car/status" in published.connects[0]
    assert b"offline" in published.connects[0], "the last will"
    for present, last in of_states(published).values():
        assert present.properties == EXPIRES_AFTER_30_S
        assert last.properties == b""
