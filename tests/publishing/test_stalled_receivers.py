"""HTTP servers that swallow a request, never answer, or reset: each is left in time, and gets what waits again."""

import socket
import struct
import threading
from contextlib import suppress

import pytest

from gateway.publishing import influx, webhook
from gateway.publishing.sink import PublishedAlarm, PublishedRevolution
from tests.publishing.receivers import finish, worker_of
from tests.testkit.waiting import TIMEOUT_S, until

RESET = struct.pack("ii", 1, 0)
ANSWER = b"HTTP/1.1 204 No Content\r\nConnection: close\r\nContent-Length: 0\r\n\r\n"


class HostileServer:
    """Treats the first connections as told, and answers the others.

    Attributes:
        taken: bodies of requests that were answered.
    """

    def __init__(self, ways: list[str]) -> None:
        self.ways, self.taken, self._held = ways, [], []
        self._server = socket.create_server(("127.0.0.1", 0))
        self.port = self._server.getsockname()[1]
        threading.Thread(target=self._serve, daemon=True).start()

    def close(self) -> None:
        with suppress(OSError):
            self._server.shutdown(socket.SHUT_RDWR)
        for end in (self._server, *self._held):
            end.close()

    def _serve(self) -> None:
        with suppress(OSError):
            while True:
                connection, _ = self._server.accept()
                self._held.append(connection)
                with suppress(OSError):
                    self._treat(connection, self.ways.pop(0) if self.ways else "answer")

    def _treat(self, connection: socket.socket, way: str) -> None:
        if way == "never reads":
            return
        connection.settimeout(TIMEOUT_S)
        with connection.makefile("rb") as file:
            lines = iter(file.readline, b"\r\n")
            size = max(int(line.split(b":")[1]) for line in lines if line.lower().startswith(b"content-length"))
            body = file.read(size)
        if way == "swallows":
            return
        if way == "resets":
            connection.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, RESET)
        elif way == "answers half":
            connection.sendall(ANSWER[:10])
        elif way == "lies":
            connection.sendall(b"\x00\xff lies\r\n\r\n")
        else:
            self.taken.append(body)
            connection.sendall(ANSWER)
        connection.close()


WAYS = ["never reads", "swallows", "resets", "answers half", "lies", "swallows"]


@pytest.mark.parametrize("kind", ["influx", "webhook"])
def test_server_that_never_answers_is_left_in_time_and_gets_everything(items, kind: str, monkeypatch) -> None:
    monkeypatch.setattr(influx, "_TIMEOUT_MS", 200)
    monkeypatch.setattr(webhook, "_TIMEOUT_S", 0.2)
    server = HostileServer(list(WAYS))
    counted = PublishedAlarm if kind == "webhook" else PublishedRevolution | PublishedAlarm
    address = {"influx": "influx://127.0.0.1:{}/car", "webhook": "webhook:http://127.0.0.1:{}/alarm"}[kind]
    worker = worker_of(address.format(server.port))
    try:
        worker.start()
        for item in items:
            worker.offer(item)
        until(lambda: not server.ways and worker.snapshot().waiting == 0 and worker.snapshot().state == "up")
        finish(worker)
        worker.discard()
    finally:
        server.close()
    expected = [item for item in items if isinstance(item, counted)]
    assert (worker.snapshot().dropped, worker.is_left) == (0, False)
    # On a busy computer an answer may come too late: what it confirms is then there twice, as one point or alarm.
    taken = {line for body in server.taken for line in body.splitlines()}
    if kind == "influx":
        taken = {line for line in taken if line.startswith((b"treadlink_revolution", b"treadlink_alarm"))}
    assert len(taken) == len(expected)


def test_server_that_swallows_for_good_is_named_and_what_it_does_not_take_is_counted(items, monkeypatch) -> None:
    monkeypatch.setattr(influx, "_TIMEOUT_MS", 100)
    server = HostileServer(["swallows"] * 10_000)
    worker = worker_of(f"influx://127.0.0.1:{server.port}/car")
    try:
        worker.start()
        for item in items:
            worker.offer(item)
        until(lambda: "does not answer" in str(worker.snapshot().note.values))
        worker.abandon()
        assert worker.join(TIMEOUT_S)
    finally:
        server.close()
    worker.discard()
    counted = sum(isinstance(item, PublishedRevolution | PublishedAlarm) for item in items)
    assert (worker.snapshot().published, worker.snapshot().dropped) == (0, counted)
    assert worker.is_left, "the exit status tells"
