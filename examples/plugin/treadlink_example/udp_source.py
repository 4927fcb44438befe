"""Source `udp:HOST:PORT`: frames in datagrams, as a collector on a network sends them."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator

from gateway.core.clock import Clock
from gateway.core.errors import SourceError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, SourceAddress, SourceKind

# The session asks to stop at most this long before it is heard.
_WAIT_S = 0.1
_LARGEST_DATAGRAM = 65536


class UdpSource:
    """Datagrams that arrive at a port; follows `gateway.core.links.source.Source`."""

    vehicle_toml: str | None = None

    def __init__(self, host: str, port: int, clock: Clock) -> None:
        self.link = f"udp:{host}:{port}"
        self._clock = clock
        # Bound at once, so that what is sent before `items` is called waits in the socket.
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            message = f"{self.link} cannot be opened: {error}"
            raise SourceError(message, "Choose a free port of this computer.") from error
        self._socket.settimeout(_WAIT_S)

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield one chunk per datagram until `stop` is set."""
        yield LinkEvent(self.link, self._clock.now_ns(), LinkEventKind.CONNECTED)
        while not stop.is_set():
            try:
                data = self._socket.recv(_LARGEST_DATAGRAM)
            except TimeoutError:
                continue
            except OSError:
                return  # closed from another thread
            if data:
                yield Chunk(self.link, self._clock.now_ns(), data)

    def close(self) -> None:
        """Release the port."""
        self._socket.close()


def open_udp(address: SourceAddress, clock: Clock) -> UdpSource:
    """Return the source of `udp:HOST:PORT`.

    Raises:
        SourceError: the address is wrong or the port is taken.
    """
    host, _, port = address.target.rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise SourceError(f"'{address.uri}' names no port", "Write udp:HOST:PORT, for example udp:0.0.0.0:5005.")
    return UdpSource(host, int(port), clock)


KIND = SourceKind("treadlink_example.udp_source:open_udp")
