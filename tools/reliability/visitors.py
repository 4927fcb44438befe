"""Clients of a running session: browsers, viewers, a stranger; and a relay to a broker that swallows confirmations."""

import contextlib
import itertools
import json
import socket
import threading
import time
import urllib.request
from collections import deque
from collections.abc import Callable
from typing import Any, Final

from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Origin, Subprotocol

from tools.mqtt_broker import TIMEOUT_S

_VISIT_S: Final = 10.0
_END_S: Final = 60.0
_HELD: Final = 900
_PUBACK: Final = 4


class Visitors:
    """Clients that come one after the other, and go without a word.

    Attributes:
        served: visits that got what they came for.
        refused: what went wrong with the others.
    """

    def __init__(self, visit: Callable[[int, int, threading.Event], None], port: int) -> None:
        """Begin with the first visit, which takes the port and its number and returns when the event is set."""
        self._visit, self._port = visit, port
        self._stop = threading.Event()
        self.served = 0
        self.refused: list[str] = []
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        for number in itertools.count():
            if self._stop.is_set():
                return
            try:
                self._visit(self._port, number, self._stop)
                self.served += 1
            except (OSError, WebSocketException) as error:
                if not self._stop.is_set():
                    self.refused.append(repr(error))
                self._stop.wait(1.0)

    def close(self) -> None:
        """End the last visit."""
        self._stop.set()
        self._thread.join(_END_S)


def visit_page(port: int, number: int, stop: threading.Event) -> None:
    """Look at a wheel's trend on the page."""
    address = f"127.0.0.1:{port}"
    with connect(f"ws://{address}/", origin=Origin(f"http://{address}"), open_timeout=_END_S, max_size=None) as page:
        page.send(json.dumps({"wheel": ("FL", "FR", "RL", "RR")[number % 4], "trend": "speed_mps"}))
        _watch(page, stop)


def visit_viewer(port: int, _: int, stop: threading.Event) -> None:
    """Subscribe to every channel of the Foxglove server."""
    protocol = Subprotocol("foxglove.sdk.v1")
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[protocol], open_timeout=_END_S, max_size=None) as viewer:
        channels = json.loads(viewer.recv(timeout=_END_S)) and json.loads(viewer.recv(timeout=_END_S))
        chosen = [{"id": each["id"], "channelId": each["id"]} for each in channels.get("channels", ())]
        viewer.send(json.dumps({"op": "subscribe", "subscriptions": chosen}))
        _watch(viewer, stop)


def visit_metrics(port: int, _: int, stop: threading.Event) -> None:
    """Scrape the Prometheus endpoint."""
    with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=_END_S) as answer:
        answer.read()
    stop.wait(_VISIT_S)


def _watch(connection: Any, stop: threading.Event) -> None:
    until_s = time.monotonic() + _VISIT_S
    while time.monotonic() < until_s and not stop.is_set():
        connection.recv(timeout=_END_S)


class Stranger:
    """Holds idle connections from another address of this computer, and makes a new one for each that it gives up.

    Attributes:
        connections: how many were made.
    """

    def __init__(self, ports: list[int], rate_hz: float = 50.0) -> None:
        """Begin."""
        self._ports, self._rate_hz = ports, rate_hz
        self.connections = 0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        held: deque[socket.socket] = deque()
        for port in itertools.cycle(self._ports):
            if self._stop.wait(1.0 / self._rate_hz):
                break
            held.append(socket.socket())
            held[-1].bind(("127.0.0.2", 0))
            held[-1].setblocking(False)
            held[-1].connect_ex(("127.0.0.1", port))
            self.connections += 1
            if len(held) > _HELD:
                held.popleft().close()
        for connection in held:
            connection.close()

    def close(self) -> None:
        """Leave."""
        self._stop.set()
        self._thread.join(_END_S)


class SwallowingRelay:
    """Stands between clients and a broker, and swallows confirmations when told to.

    Attributes:
        port: where it listens.
        swallowed: confirmations that it has swallowed.
        to_swallow: how many of the next ones it will swallow.
    """

    def __init__(self, broker_port: int) -> None:
        """Listen on a free port for clients of the broker."""
        self._broker_port = broker_port
        self.swallowed = self.to_swallow = 0
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._listening.accept()
                broker = socket.create_connection(("127.0.0.1", self._broker_port), timeout=TIMEOUT_S)
                broker.settimeout(None)
                for copy, ends in ((self._to_broker, (client, broker)), (self._to_client, (broker, client))):
                    threading.Thread(target=self._relay, args=(copy, *ends), daemon=True).start()

    def _relay(self, copy: Callable[..., None], source: socket.socket, sink: socket.socket) -> None:
        with contextlib.suppress(OSError):
            copy(source, sink)
        for end in (source, sink):
            with contextlib.suppress(OSError):
                end.shutdown(socket.SHUT_RDWR)

    def _to_broker(self, client: socket.socket, broker: socket.socket) -> None:
        while data := client.recv(1 << 16):
            broker.sendall(data)

    def _to_client(self, broker: socket.socket, client: socket.socket) -> None:
        with broker.makefile("rb") as stream:
            while packet := stream.read(2):
                while packet[-1] & 0x80:
                    packet += stream.read(1)
                size = sum((byte & 0x7F) << 7 * index for index, byte in enumerate(packet[1:]))
                packet += stream.read(size)
                if packet[0] >> 4 == _PUBACK and self.to_swallow > 0:
                    self.to_swallow -= 1
                    self.swallowed += 1
                else:
                    client.sendall(packet)

    def close(self) -> None:
        """Stop listening."""
        self._listening.close()
