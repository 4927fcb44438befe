"""A broker for MQTT 5 of a few packets, which ends its connections when a test says so."""

import socket
import struct
import threading
from contextlib import suppress
from typing import Final, NamedTuple

_CONNECT: Final = 1
_PUBLISH: Final = 3
_SUBSCRIBE: Final = 8
_PING: Final = 12
_SHUTTING_DOWN: Final = bytes.fromhex("e0028b00")
"""DISCONNECT as mosquitto sends it when it is stopped."""


class Received(NamedTuple):
    """A message that was published; its properties are encoded."""

    topic: str
    payload: bytes
    is_retained: bool
    properties: bytes


class ScriptedBroker:
    """Confirms every message of one client after the other.

    Attributes:
        port: the port it listens on.
        messages: what was published, in the order of arrival.
        connects: the bytes of each CONNECT packet, which hold the last will.
        confirms: cleared by a test that wants messages to stay unconfirmed.
    """

    def __init__(self) -> None:
        """Listen on a free port."""
        self.messages: list[Received] = []
        self.connects: list[bytes] = []
        self.confirms = threading.Event()
        self.confirms.set()
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self._peer: socket.socket | None = None
        self._thread = threading.Thread(target=self._serve, name="scripted broker", daemon=True)
        self._thread.start()

    def say_goodbye(self) -> None:
        """End the connection as a broker that is stopped does."""
        peer = self._peer
        if peer is not None:
            with suppress(OSError):  # the client was faster
                peer.sendall(_SHUTTING_DOWN)
                peer.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Stop listening, and end the connection."""
        with suppress(OSError):  # a second call finds it closed
            self._listening.shutdown(socket.SHUT_RDWR)
        self._listening.close()
        self.say_goodbye()
        self._thread.join()

    def _serve(self) -> None:
        while True:
            try:
                peer, _ = self._listening.accept()
            except OSError:
                return
            self._peer = peer
            try:
                self._answer(peer)
            except OSError:
                pass
            finally:
                peer.close()

    def _answer(self, peer: socket.socket) -> None:
        with peer.makefile("rb") as stream:
            while head := stream.read(1):
                body = stream.read(_length(stream.read))
                kind = head[0] >> 4
                if kind == _CONNECT:
                    self.connects.append(body)
                    peer.sendall(bytes.fromhex("2003000000"))
                elif kind == _SUBSCRIBE:
                    peer.sendall(b"\x90\x04" + body[:2] + b"\x00\x01")
                elif kind == _PUBLISH:
                    number = self._take(head[0], body)
                    if self.confirms.is_set():
                        peer.sendall(b"\x40\x02" + number)
                elif kind == _PING:
                    peer.sendall(b"\xd0\x00")

    def _take(self, head: int, body: bytes) -> bytes:
        (size,) = struct.unpack(">H", body[:2])
        begin = 5 + size + body[4 + size]
        topic, properties = body[2 : 2 + size].decode(), body[5 + size : begin]
        self.messages.append(Received(topic, body[begin:], bool(head & 1), properties))
        return body[2 + size : 4 + size]


def _length(read) -> int:
    total, shift = 0, 0
    while byte := read(1):
        total |= (byte[0] & 0x7F) << shift
        shift += 7
        if byte[0] < 0x80:
            break
    return total
