"""Listeners under strangers: connections that say nothing, requests that cannot be read, and too much of everything."""

import json
import logging
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from urllib.request import urlopen

import pytest
from websockets.sync.client import connect

from gateway.core.clock import SystemClock
from gateway.publishing import admission
from gateway.publishing.admission import MOST_CONNECTIONS, MOST_OF_A_PEER, Admission
from gateway.publishing.foxglove_server import FoxgloveSink
from gateway.publishing.page_server import PageSink
from gateway.publishing.prometheus import PrometheusEndpoint
from gateway.publishing.sink import Sink
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


@pytest.fixture(params=list(LISTENERS))
def listener(request) -> Iterator[Sink]:
    sink = LISTENERS[request.param]()
    sink.open(STOP)
    yield sink
    sink.close()


@pytest.fixture
def page() -> Iterator[PageSink]:
    SESSION.asked.clear()
    sink = PageSink("127.0.0.1", 0, lambda: SESSION)
    sink.open(STOP)
    yield sink
    sink.close()


def is_ended(connection: socket.socket) -> bool:
    """Return whether the other side has ended a connection."""
    connection.settimeout(TIMEOUT_S)
    try:
        while connection.recv(1 << 16):
            pass
    except ConnectionError:
        return True
    except TimeoutError:
        return False
    return True


def test_idle_connections_of_one_peer_are_bounded(listener) -> None:
    with ExitStack() as stack:
        held = [
            stack.enter_context(socket.create_connection(("127.0.0.1", listener.port)))
            for _ in range(MOST_OF_A_PEER + 20)
        ]
        assert all(map(is_ended, held[MOST_OF_A_PEER:]))


@pytest.mark.parametrize("part", [b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: 127.0.0.1\r\n"])
def test_a_request_that_does_not_come_ends_its_connection(listener, part: bytes, caplog, capsys) -> None:
    with caplog.at_level(logging.INFO), socket.create_connection(("127.0.0.1", listener.port)) as connection:
        connection.sendall(part)
        clock = SystemClock()
        begin_ns = clock.now_ns()
        assert is_ended(connection)
        assert clock.now_ns() - begin_ns < 3e9 * admission.HEAD_S
    assert "Traceback" not in caplog.text + "".join(capsys.readouterr())


def is_open(page: PageSink) -> bool:
    try:
        with urlopen(f"http://127.0.0.1:{page.port}/", timeout=TIMEOUT_S) as answer:
            return answer.status == 200
    except OSError:
        return False


def test_the_page_is_there_again_when_strangers_are_gone(page) -> None:
    with ExitStack() as stack:
        for _ in range(MOST_OF_A_PEER):
            stack.enter_context(socket.create_connection(("127.0.0.1", page.port)))
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
