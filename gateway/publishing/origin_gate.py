"""A port in front of a WebSocket server that admits web pages by their Origin; the server's library cannot."""

import os
import secrets
import socket
import struct
import threading
from contextlib import suppress
from typing import Final

from gateway.core.clock import SystemClock
from gateway.publishing.admission import HEAD_S, Admission

_PAUSE_S: Final = 0.1
# A viewer that takes nothing for this long, or a server, is left.
_SEND_S: Final = 10
_MOST_HEAD_BYTES: Final = 16 << 10
# The option takes a `struct timeval`, and milliseconds on Windows. Reading has no limit: a viewer may only listen.
_SEND_LIMIT: Final = struct.pack("i", _SEND_S * 1000) if os.name == "nt" else struct.pack("ll", _SEND_S, 0)
_CHUNK_BYTES: Final = 64 << 10
_HEAD_END: Final = b"\r\n\r\n"
_REFUSAL: Final = (
    b"HTTP/1.1 403 Forbidden\r\nConnection: close\r\nContent-Type: text/plain\r\n\r\n"
    b"treadlink admits no web page of this origin: see the option origin of foxglove://\n"
)


def hidden_loopback() -> str:
    """Return a loopback address that a web page cannot find by trying, or 127.0.0.1 where there is only that."""
    address = f"127.{secrets.randbelow(254) + 1}.{secrets.randbelow(256)}.{secrets.randbelow(254) + 1}"
    with suppress(OSError), socket.create_server((address, 0)):
        return address
    return "127.0.0.1"


def is_admitted(head: bytes, allowed: frozenset[str]) -> bool:
    """Return whether the head of a request opens a WebSocket for no web page, or for one of an allowed origin."""
    lines = head.decode("latin-1").split("\r\n")
    if not lines[0].startswith("GET "):
        return False
    fields = [(name.strip().lower(), value.strip()) for name, _, value in (line.partition(":") for line in lines[1:])]
    origins = [value for name, value in fields if name == "origin"]
    upgrades = [value.lower() for name, value in fields if name == "upgrade"]
    return upgrades == ["websocket"] and (not origins or (len(origins) == 1 and origins[0] in allowed))


class OriginGate:
    """Listens for viewers and passes the admitted ones on to a server of this computer."""

    def __init__(self, host: str, port: int, server: tuple[str, int], allowed: frozenset[str]) -> None:
        """Listen.

        Raises:
            OSError: the address cannot be used.
        """
        self._server = server
        self._allowed = allowed
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._listener = socket.create_server((host, port), family=family)
        self._closing = threading.Event()
        self._open: set[socket.socket] = set()
        self._lock = threading.Lock()
        self._admission = Admission()
        threading.Thread(target=self._accept, name="viewers", daemon=True).start()

    @property
    def port(self) -> int:
        """The port that it listens on."""
        port: int = self._listener.getsockname()[1]
        return port

    def close(self) -> None:
        """Stop listening and end all connections."""
        self._closing.set()
        with suppress(OSError):
            self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        with self._lock:
            for end in self._open:
                _end(end)

    def _accept(self) -> None:
        while not self._closing.is_set():
            try:
                viewer, address = self._listener.accept()
            except OSError:  # also without a free descriptor, which comes back
                self._closing.wait(_PAUSE_S)
                continue
            peer = str(address[0])
            if not self._admission.admit(peer):
                viewer.close()
                continue
            try:
                threading.Thread(target=self._serve, args=(viewer, peer), name="viewer", daemon=True).start()
            except RuntimeError:  # no room for another thread
                self._admission.release(peer)
                viewer.close()

    def _serve(self, viewer: socket.socket, peer: str) -> None:
        sockets = [viewer]
        try:
            with self._lock:
                self._open.add(viewer)
            head = _head(viewer)
            if not is_admitted(head.partition(_HEAD_END)[0], self._allowed):
                viewer.sendall(_REFUSAL)
                return
            server = socket.create_connection(self._server, HEAD_S)
            sockets.append(server)
            with self._lock:
                self._open.add(server)
            for endpoint in sockets:
                endpoint.settimeout(None)
                endpoint.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, _SEND_LIMIT)
            server.sendall(head)
            return_thread = threading.Thread(target=_pass_on, args=(server, viewer), name="viewer", daemon=True)
            return_thread.start()
            _pass_on(viewer, server)
            return_thread.join()
        except OSError:
            pass  # the viewer is gone or says nothing
        finally:
            with self._lock:
                self._open.difference_update(sockets)
            for endpoint in sockets:
                endpoint.close()
            self._admission.release(peer)


def _head(viewer: socket.socket) -> bytes:
    clock = SystemClock()
    end_ns = clock.now_ns() + round(HEAD_S * 1e9)
    head = b""
    while _HEAD_END not in head:
        viewer.settimeout(max(1e-9 * (end_ns - clock.now_ns()), 0.001))
        data = viewer.recv(_MOST_HEAD_BYTES)
        head += data
        if not data or len(head) > _MOST_HEAD_BYTES:
            raise ConnectionError
    return head


def _pass_on(source: socket.socket, target: socket.socket) -> None:
    with suppress(OSError):
        while data := source.recv(_CHUNK_BYTES):
            target.sendall(data)
    _end(source)
    _end(target)


def _end(connection: socket.socket) -> None:
    with suppress(OSError):
        connection.shutdown(socket.SHUT_RDWR)
