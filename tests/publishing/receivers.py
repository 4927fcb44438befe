"""Receivers that tests control."""

import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, HTTPServer
from typing import TypeVar

from gateway.core.clock import SystemClock
from gateway.publishing.sink import Item, PublishedState, SinkDownError, SinkEndedError, SinkSetting, open_sink
from gateway.publishing.sink_worker import SinkWorker
from tests.testkit.waiting import TIMEOUT_S

_S = TypeVar("_S", bound=HTTPServer)


@contextmanager
def serving(server: _S) -> Iterator[_S]:
    """Serve requests in a thread."""
    thread = threading.Thread(target=server.serve_forever, args=(0.01,))
    thread.start()
    yield server
    server.shutdown()
    thread.join()
    server.server_close()


class PostServer(HTTPServer):
    """Answers every POST with `status`; keeps path, authorization and body of each, and the lines that it accepted."""

    def __init__(self, port: int = 0) -> None:
        super().__init__(("127.0.0.1", port), _PostHandler)
        self.status = 204
        self.requests: list[tuple[str, str | None, bytes]] = []
        self.lines: list[str] = []


class _PostHandler(BaseHTTPRequestHandler):
    server: PostServer

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        self.server.requests.append((self.path, self.headers["Authorization"], body))
        if self.server.status < 300:
            self.server.lines += body.decode().splitlines()
        self.send_response(self.server.status)
        if self.server.status in (302, 307):
            self.send_header("Location", "/elsewhere")
        self.end_headers()

    def log_message(self, format: str, *args: object) -> None:
        pass


class Receiver:
    """A sink that takes items while `gate` is set and is there while `present` is set."""

    def __init__(self) -> None:
        self.gate, self.present, self.entered = threading.Event(), threading.Event(), threading.Event()
        self.gate.set()
        self.present.set()
        self.taken: list[Item] = []
        self.states = 0
        self.opened = 0
        self.closed = 0
        self.unconfirmed = 0
        self.has_left = False
        self.poison: Item | None = None

    def open(self, stop: threading.Event) -> None:
        self.opened += 1
        if not self.present.is_set():
            raise SinkDownError("no receiver")

    def send(self, item: Item, stop: threading.Event) -> None:
        self.entered.set()
        while not self.gate.wait(0.01):
            if stop.is_set():
                raise SinkDownError("the session has ended")
        if self.has_left:
            raise SinkEndedError
        if not self.present.is_set():
            raise SinkDownError("connection lost")
        if item is self.poison:
            raise ValueError("cannot encode")
        if isinstance(item, PublishedState):
            self.states += 1
        else:
            self.taken.append(item)

    def poll(self) -> None:
        if not self.present.is_set():
            raise SinkDownError("connection lost")

    def flush(self, stop: threading.Event) -> int:
        return self.unconfirmed

    def close(self) -> None:
        self.closed += 1


def worker_of(uri: str) -> SinkWorker:
    name, sink = open_sink(uri, SinkSetting())
    return SinkWorker(name, sink, SystemClock())


def finish(worker: SinkWorker) -> None:
    """Let a worker hand over what waits, and end."""
    worker.finish()
    assert worker.join(TIMEOUT_S)


def publish(output: str | SinkWorker, items: Iterable[Item]) -> SinkWorker:
    """Offer items to an output, given by its URI or its worker that has not started, and let it finish."""
    worker = worker_of(output) if isinstance(output, str) else output
    worker.start()
    for item in items:
        worker.offer(item)
    finish(worker)
    return worker
