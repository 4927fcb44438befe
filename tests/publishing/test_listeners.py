"""Listeners under strangers: connections that say nothing, requests that cannot be read, and too much of everything."""

import json
import logging
import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack, closing, contextmanager, suppress
from unittest.mock import patch
from urllib.request import urlopen

import pytest
from websockets.sync.client import connect

from gateway.core.clock import SystemClock
from gateway.publishing import origin_gate, page_listener, prometheus
from gateway.publishing.admission import HEAD_S, MOST_CONNECTIONS, MOST_OF_A_PEER, Admission
from gateway.publishing.foxglove_server import FoxgloveSink
from gateway.publishing.page_server import PageSink
from gateway.publishing.prometheus import PrometheusEndpoint
from gateway.publishing.sink import PublishedState, Sink
from gateway.publishing.sink_worker import SinkWorker
from tests.testkit.waiting import TIMEOUT_S, until

STOP = threading.Event()


class Session:
    """What the page asks a session for."""

    may_record = True

    def __init__(self) -> None:
        self.run_form: dict[str, str] = {}
        self.asked: list[str] = []

    def mark(self, text: str) -> None:
        self.asked.append("mark")

    def start_recording(self, form: object) -> None:
        self.asked.append("record")

    def stop_recording(self) -> None:
        self.asked.append("stop")


SESSION = Session()
LISTENERS: dict[str, Callable[[], Sink]] = {
    "page": lambda: PageSink("127.0.0.1", 0, lambda: SESSION),
    "foxglove": lambda: FoxgloveSink("127.0.0.1", 0),
    "prometheus": lambda: PrometheusEndpoint("127.0.0.1", 0),
}


@contextmanager
def opened(name: str, head_s: float = 3.0 * TIMEOUT_S) -> Iterator[Sink]:
    assert prometheus._Handler.timeout == origin_gate.HEAD_S == page_listener.HEAD_S == HEAD_S
    with pytest.MonkeyPatch.context() as patched, closing(LISTENERS[name]()) as sink:
        patched.setattr(prometheus._Handler, "timeout", head_s)
        patched.setattr(origin_gate, "HEAD_S", head_s)
        patched.setattr(page_listener, "HEAD_S", head_s)
        sink.open(STOP)
        yield sink


@pytest.fixture
def page() -> Iterator[Sink]:
    SESSION.asked.clear()
    with opened("page") as sink:
        yield sink


def wait_for_end(connection: socket.socket) -> None:
    """Read until the other side has ended a connection."""
    connection.settimeout(TIMEOUT_S)
    with suppress(ConnectionError):
        while connection.recv(1 << 16):
            pass


def hold(stack: ExitStack, listener: Sink, count: int) -> list[socket.socket]:
    """Open connections, each when the one before is judged: those beyond the backlog would wait for seconds."""
    judged = stack.enter_context(patch.object(Admission, "admit", autospec=True, side_effect=Admission.admit))
    held: list[socket.socket] = []
    while len(held) < count:
        held.append(stack.enter_context(socket.create_connection(("127.0.0.1", listener.port))))
        until(lambda: judged.call_count == len(held))
    return held


@pytest.mark.parametrize("name", LISTENERS)
def test_idle_connections_of_one_peer_are_bounded(name: str) -> None:
    with opened(name) as listener, ExitStack() as stack:
        for connection in hold(stack, listener, MOST_OF_A_PEER + 20)[MOST_OF_A_PEER:]:
            wait_for_end(connection)


@pytest.mark.parametrize("name", LISTENERS)
@pytest.mark.parametrize("part", [b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"])
def test_a_request_that_does_not_come_ends_its_connection(name: str, part: bytes, caplog, capsys) -> None:
    with (
        caplog.at_level(logging.INFO),
        opened(name, head_s=0.3) as listener,
        socket.create_connection(("127.0.0.1", listener.port)) as connection,
    ):
        connection.sendall(part)
        wait_for_end(connection)
    assert "Traceback" not in caplog.text + "".join(capsys.readouterr())


def is_open(page: PageSink) -> bool:
    try:
        with urlopen(f"http://127.0.0.1:{page.port}/", timeout=TIMEOUT_S) as answer:
            return answer.status == 200
    except OSError:
        return False


def test_the_page_is_there_again_when_strangers_are_gone(page) -> None:
    with ExitStack() as stack:
        hold(stack, page, MOST_OF_A_PEER)
    until(lambda: is_open(page))


def test_all_peers_together_are_bounded() -> None:
    admitting = Admission()
    admitted = [admitting.admit(f"10.0.0.{number}") for number in range(MOST_CONNECTIONS + 5)]
    assert admitted.count(True) == MOST_CONNECTIONS
    admitting.release("10.0.0.1")
    assert admitting.admit("10.0.0.2")
    assert not admitting.admit("10.0.0.3")


@pytest.mark.parametrize(
    ("request_line", "headers", "status"),
    [
        ("GET /", ["Host: ["], 400),
        ("GET /", ["Host: 127.0.0.1", "Host: evil.example"], 400),
        ("GET /", [], 400),
        ("GET //[", ["Host: 127.0.0.1"], 400),
        ("GET /" + "[" * 4000, ["Host: 127.0.0.1"], 404),
        ("POST /", ["Host: 127.0.0.1"], 405),
        ("PUT /", ["Host: 127.0.0.1"], 405),
        ("TRACE /", ["Host: 127.0.0.1"], 405),
        ("GET /", ["Host: 127.0.0.1"], 200),
    ],
)
def test_requests_are_answered_without_a_traceback(page, caplog, request_line, headers, status) -> None:
    with caplog.at_level(logging.INFO), socket.create_connection(("127.0.0.1", page.port)) as connection:
        connection.sendall("\r\n".join([f"{request_line} HTTP/1.1", *headers, "", ""]).encode())
        connection.settimeout(TIMEOUT_S)
        answer = connection.makefile("rb").readline()
    assert int(answer.split()[1]) == status
    assert "Traceback" not in caplog.text


def test_one_client_cannot_flood_marks_and_recordings(page) -> None:
    origin = f"http://127.0.0.1:{page.port}"
    with connect(f"ws://127.0.0.1:{page.port}/", origin=origin, open_timeout=TIMEOUT_S) as connection:  # type: ignore[arg-type]
        for _ in range(300):
            connection.send(json.dumps({"mark": "m"}))
            connection.send(json.dumps({"record": True}))
        said = [json.loads(connection.recv(TIMEOUT_S)) for _ in range(600)]
    refused = [message for message in said if message["type"] == "said" and "more than" in message["text"]]
    # The flood takes well under a second, or a few on a busy computer: five marks a second, four recordings in ten.
    assert len(refused) > 400
    assert SESSION.asked.count("record") <= 8


def test_the_gate_accepts_again_after_an_error(monkeypatch) -> None:
    """Without a free descriptor, accept fails for a while."""
    really_accept, errors = socket.socket.accept, [OSError(24, "Too many open files")] * 2

    def accept(self):
        if errors:
            raise errors.pop()
        return really_accept(self)

    monkeypatch.setattr(socket.socket, "accept", accept)
    with (
        opened("foxglove") as sink,
        connect(f"ws://127.0.0.1:{sink.port}", subprotocols=["foxglove.sdk.v1"], open_timeout=TIMEOUT_S) as viewer,
    ):
        assert viewer.recv(TIMEOUT_S)
    assert not errors


def fill(connection: socket.socket) -> None:
    """Send until the other side ends the connection."""
    while True:
        connection.sendall(bytes(1 << 20))


def test_a_viewer_that_takes_nothing_is_left(monkeypatch) -> None:
    monkeypatch.setattr(origin_gate, "_SEND_LIMIT", struct.pack("ll", 0, 100_000))
    with socket.create_server(("127.0.0.1", 0)) as server:
        gate = origin_gate.OriginGate("127.0.0.1", 0, server.getsockname(), frozenset())
        try:
            with socket.create_connection(("127.0.0.1", gate.port)) as viewer:
                viewer.sendall(b"GET / HTTP/1.1\r\nUpgrade: websocket\r\n\r\n")
                sender, _ = server.accept()
                sender.settimeout(TIMEOUT_S)
                with sender, pytest.raises(ConnectionError):
                    fill(sender)
                until(lambda: not gate._open)
        finally:
            gate.close()


@pytest.mark.parametrize("kind", ["foxglove", "prometheus"])
def test_a_client_that_reads_nothing_holds_nobody(items, kind: str) -> None:
    """It asks, and takes no answer; items go on, and another client is served."""
    sink = LISTENERS[kind]()
    worker = SinkWorker(kind, sink, SystemClock())
    worker.start()
    until(lambda: sink.port)
    request = {
        "foxglove": b"GET / HTTP/1.1\r\nHost: x\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        b"Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n"
        b"Sec-WebSocket-Protocol: foxglove.sdk.v1\r\n\r\n",
        "prometheus": b"GET /metrics HTTP/1.1\r\nHost: x\r\n\r\n",
    }[kind]
    with socket.socket() as deaf:
        deaf.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1024)
        deaf.connect(("127.0.0.1", sink.port))
        deaf.sendall(request)
        for item in items:
            worker.offer(item)
        counted = sum(not isinstance(item, PublishedState) for item in items)
        until(lambda: worker.snapshot().published == counted)
        if kind == "prometheus":
            until(lambda: b"treadlink_" in urlopen(f"http://127.0.0.1:{sink.port}/metrics", timeout=TIMEOUT_S).read())
        else:
            with connect(f"ws://127.0.0.1:{sink.port}", subprotocols=["foxglove.sdk.v1"]) as viewer:
                assert viewer.recv(TIMEOUT_S)
    worker.abandon()
    assert worker.join(TIMEOUT_S)
    worker.discard()
    assert worker.snapshot().dropped == 0
