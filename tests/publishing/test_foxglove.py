"""Foxglove's server with a real WebSocket client, and web pages only from an allowed origin."""

import json
import struct
import threading
from collections import defaultdict
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from typing import Any
from unittest.mock import Mock

import pytest
from hypothesis import given
from hypothesis import strategies as st
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from gateway.core.clock import SystemClock
from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import Notice, Reason
from gateway.publishing.foxglove_server import FoxgloveSink, channel_schema
from gateway.publishing.origin_gate import is_admitted
from gateway.publishing.sink_worker import SinkWorker
from tests.publishing.receivers import finish
from tests.testkit.waiting import TIMEOUT_S, until


class Viewer:
    """A client of the protocol foxglove.sdk.v1 that subscribes to everything."""

    def __init__(self, socket: ClientConnection) -> None:
        self._socket = socket
        self.channels: dict[int, dict[str, Any]] = {}
        self.messages: dict[str, list[tuple[int, bytes]]] = defaultdict(list)

    def read_all(self) -> None:
        """Take what the server has sent."""
        with suppress(TimeoutError):
            while True:
                self._take(self._socket.recv(0.05))

    def _take(self, message: str | bytes) -> None:
        if isinstance(message, bytes):
            if message[0] == 1:
                subscription, time_ns = struct.unpack_from("<IQ", message, 1)
                self.messages[self.channels[subscription]["topic"]].append((time_ns, message[13:]))
            return
        document = json.loads(message)
        if document["op"] == "advertise":
            self.channels |= {channel["id"]: channel for channel in document["channels"]}
            self._subscribe(channel["id"] for channel in document["channels"])
        elif document["op"] == "status" and "Unknown channel ID" in document["message"]:
            # The server advertises a channel a moment before it accepts subscriptions to it.
            self._subscribe([int(document["message"].split()[-1])])

    def _subscribe(self, ids: Iterable[int]) -> None:
        wanted = [{"id": number, "channelId": number} for number in ids]
        self._socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))


@pytest.fixture
def sink():
    sink = FoxgloveSink("127.0.0.1", 0)
    yield sink
    sink.close()


def begin(sink: FoxgloveSink) -> SinkWorker:
    worker = SinkWorker("foxglove://x", sink, SystemClock())
    worker.start()
    until(lambda: worker.snapshot().state == "up")
    return worker


def test_viewer_gets_numbers_states_and_log(items, sink) -> None:
    worker = begin(sink)
    wanted = {"/wheel/FL/revolution", "/wheel/FL/waveform", "/log", "/alarm", "/session"}
    address = f"ws://127.0.0.1:{sink.port}"
    with connect(address, subprotocols=["foxglove.sdk.v1"], open_timeout=TIMEOUT_S) as socket:
        viewer = Viewer(socket)
        for _ in range(100):  # what was sent before a subscription does not come, so it is sent again
            if wanted <= set(viewer.messages):
                break
            sink._logged = None
            sink._shown_revolutions.clear()
            for item in (*items[:8], *items[-3:]):
                worker.offer(item)
            viewer.read_all()
    worker.abandon()
    worker.join(TIMEOUT_S)
    time_ns, payload = viewer.messages["/wheel/FL/revolution"][0]
    document = json.loads(payload)
    sent = next(item for item in items if item.result.position == "FL" and item.host_ns == time_ns)
    speed = next(estimate for estimate in sent.result.estimates if estimate.name == "speed_mps")
    assert document["speed_mps"] == speed.value
    waveform = json.loads(viewer.messages["/wheel/FL/waveform"][0][1])
    assert len(waveform["radial_mps2"]) == len(waveform["theta_rad"]) > 100
    assert json.loads(viewer.messages["/alarm"][0][1])["reason"]["code"] == "value_below_limit"
    assert b"sim:demo: connected" in b"".join(message for _, message in viewer.messages["/log"])
    by_topic = {channel["topic"]: channel for channel in viewer.channels.values()}
    assert by_topic["/log"]["schemaName"] == "foxglove.Log"
    schema = json.loads(by_topic["/wheel/FL/revolution"]["schema"])
    assert by_topic["/wheel/FL/revolution"]["schemaEncoding"] == "jsonschema"
    assert schema["properties"]["speed_mps"]["type"] == "number"


def test_notice_that_comes_again_is_logged_each_time_it_comes(items) -> None:
    sink, log = FoxgloveSink("127.0.0.1", 0), Mock()
    sink._log = log
    connected, lost, again = (
        Notice("hub", Reason(code)) for code in (LinkCode.LINK_CONNECTED, LinkCode.LINK_LOST, LinkCode.LINK_CONNECTED)
    )
    for notices in ((connected,), (connected, lost, again), (connected, lost, again), (lost, again)):
        snapshot = replace(items[-1].snapshot, notices=notices)
        sink.send(replace(items[-1], snapshot=snapshot), threading.Event())
    sink.close()
    assert log.log.call_count == 3


def test_port_in_use_is_named_and_waited_for(items, sink) -> None:
    first = begin(sink)
    worker = SinkWorker("foxglove://y", FoxgloveSink("127.0.0.1", sink.port), SystemClock())
    worker.start()
    worker.offer(items[0])
    until(lambda: worker.snapshot().state == "down")
    assert "cannot listen on 127.0.0.1:" in worker.snapshot().note["error"]
    finish(first)
    finish(worker)
    assert worker.snapshot().published == 1


@pytest.mark.parametrize("kind", ["revolution", "alarm", "wheel", "link", "session"])
def test_channel_schemas_use_plain_types_only(kind: str) -> None:
    def check(schema: Any) -> None:
        if isinstance(schema, dict):
            assert not {"$ref", "oneOf", "anyOf", "enum", "const", "patternProperties"} & set(schema)
            for value in schema.values():
                check(value)

    schema = channel_schema("", kind)
    check(schema)
    assert schema["title"] == f"treadlink.{kind.capitalize()}"
    assert schema["type"] == "object"


ALLOWED = "https://viewer.example"


@pytest.mark.parametrize("origin", ["https://evil.example", "null", "http://localhost:8765", ALLOWED + ".evil"])
def test_server_refuses_other_web_pages(origin: str) -> None:
    sink = FoxgloveSink("127.0.0.1", 0, frozenset((ALLOWED,)))
    sink.open(threading.Event())
    try:
        address = f"ws://127.0.0.1:{sink.port}"
        with pytest.raises(InvalidStatus, match="403"):
            connect(address, subprotocols=["foxglove.sdk.v1"], origin=origin)
        for admitted in (ALLOWED, None):
            with connect(address, subprotocols=["foxglove.sdk.v1"], origin=admitted) as viewer:
                assert "serverInfo" in str(viewer.recv(10.0))
    finally:
        sink.close()


NAMES = st.sampled_from(["Origin", "ORIGIN", "origin ", " origin", "oRiGiN"])


@given(st.lists(st.tuples(NAMES, st.text(st.characters(codec="latin-1", exclude_characters="\r\n"))), min_size=1))
def test_only_the_allowed_origin_alone_is_admitted(origins: list[tuple[str, str]]) -> None:
    lines = ["GET / HTTP/1.1", "Upgrade: websocket", *(f"{name}: {value}" for name, value in origins)]
    stated = [value.strip() for _, value in origins]
    assert is_admitted("\r\n".join(lines).encode("latin-1"), frozenset((ALLOWED,))) == (stated == [ALLOWED])


def test_what_is_no_websocket_is_refused() -> None:
    assert not is_admitted(b"GET / HTTP/1.1\r\nHost: x", frozenset())
    assert not is_admitted(b"POST / HTTP/1.1\r\nUpgrade: websocket", frozenset())
