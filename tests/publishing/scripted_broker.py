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
CLOSE: Final = "close"
RESET: Final = "reset"
RESTART: Final = "restart"
# MQTT 5, table 3-13: those that a server may send.
_DISCONNECT_REASONS: Final = (
    0x00, 0x80, 0x81, 0x82, 0x83, 0x87, 0x89, 0x8B, 0x8D, 0x8E, 0x8F, 0x90, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99,
    0x9A, 0x9B, 0x9C, 0x9D, 0x9E, 0x9F, 0xA0, 0xA1, 0xA2,
)  # fmt: skip
CUTS: Final[tuple[str | int, ...]] = (CLOSE, RESET, RESTART, *_DISCONNECT_REASONS)
"""Ways in which a broker ends a connection; a number is the reason code of a DISCONNECT."""
_END_S: Final = 20.0
_LINGER_NONE: Final = struct.pack("ii", 1, 0)


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
        swallowed: number of the next messages on this connection that stay unconfirmed; 0 on a new connection.
        refusals: reason codes with which the next revolutions are refused, one each.
        connect_refusals: reason codes with which the next connections are refused, one each.
    """

    def __init__(self) -> None:
        """Listen on a free port."""
        self.messages: list[Received] = []
        self.connects: list[bytes] = []
        self.swallowed = 0
        self.refusals: list[int] = []
        self.connect_refusals: list[int] = []
        self._listening = socket.create_server(("127.0.0.1", 0))
        self.port: int = self._listening.getsockname()[1]
        self._is_closed = False
        self._peer: socket.socket | None = None
        self._is_over = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="scripted broker", daemon=True)
        self._thread.start()

    def cut(self, way: str | int) -> None:
        """End the connection in one of CUTS, and wait for its end; a broker that restarts is not there for a moment."""
        peer = self._peer
        if way == RESTART:
            with suppress(OSError):
                self._listening.shutdown(socket.SHUT_RDWR)
        if peer is None:
            return
        with suppress(OSError):  # the client was faster
            if isinstance(way, int):
                peer.sendall(bytes([0xE0, 2, way, 0]))
            if way == RESET:
                peer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, _LINGER_NONE)
                peer.shutdown(socket.SHUT_RD)  # the thread that reads closes it, which sends the reset
            else:
                peer.shutdown(socket.SHUT_RDWR)
        self._is_over.wait(_END_S)

    def close(self) -> None:
        """Stop listening, and end the connection."""
        self._is_closed = True
        self.cut(RESTART)
        self._thread.join()
        self._listening.close()

    def _serve(self) -> None:
        while True:
            try:
                peer, _ = self._listening.accept()
            except OSError:
                self._listening.close()
                if self._is_closed:
                    return
                self._listening = socket.create_server(("127.0.0.1", self.port))
                continue
            self._is_over.clear()
            self._peer = peer
            try:
                self._answer(peer)
            except OSError:
                pass
            finally:
                peer.close()
                self._is_over.set()

    def _answer(self, peer: socket.socket) -> None:
        with peer.makefile("rb") as stream:
            while head := stream.read(1):
                length = _length(stream.read)
                body = stream.read(length)
                if len(body) < length:
                    return  # a packet that the end of the connection has cut is none
                kind = head[0] >> 4
                if kind == _CONNECT:
                    self.swallowed = 0
                    self.connects.append(body)
                    reason = self.connect_refusals.pop(0) if self.connect_refusals else 0
                    peer.sendall(bytes([0x20, 3, 0, reason, 0]))
                    if reason:
                        return
                elif kind == _SUBSCRIBE:
                    peer.sendall(b"\x90\x04" + body[:2] + b"\x00\x01")
                elif kind == _PUBLISH:
                    number = self._take(head[0], body)
                    if self.refusals and self.messages[-1].topic.endswith("/revolution"):
                        self.messages.pop()
                        peer.sendall(b"\x40\x03" + number + bytes([self.refusals.pop(0)]))
                    elif self.swallowed > 0:
                        self.swallowed -= 1
                    else:
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
