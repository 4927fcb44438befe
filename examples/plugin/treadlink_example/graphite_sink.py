"""Live output `graphite:HOST:PORT`: valid estimates as lines `path value time` of Graphite's plaintext protocol."""

from __future__ import annotations

import socket
import threading

from gateway.core.estimates.estimator import Status
from gateway.publishing.sink import (
    Item,
    PublishedRevolution,
    SinkAddress,
    SinkDownError,
    SinkError,
    SinkKind,
    SinkSetting,
)

_TIMEOUT_S = 2.0


class GraphiteSink:
    """Connection to a Graphite server; follows `gateway.publishing.sink.Sink`."""

    def __init__(self, host: str, port: int, prefix: str) -> None:
        self._place, self._prefix = (host, port), prefix
        self._socket: socket.socket | None = None

    def open(self, stop: threading.Event) -> None:
        """Connect."""
        try:
            self._socket = socket.create_connection(self._place, _TIMEOUT_S)
        except OSError as error:
            raise SinkDownError(str(error)) from error

    def send(self, item: Item, stop: threading.Event) -> None:
        """Send the valid estimates of a revolution; alarms and states have no place in Graphite."""
        if self._socket is None or not isinstance(item, PublishedRevolution):
            return
        path = f"{self._prefix}.{item.result.position}"
        lines = [
            f"{path}.{estimate.name} {estimate.value!r} {item.host_ns // 1_000_000_000}\n"
            for estimate in item.result.estimates
            if estimate.status is Status.VALID
        ]
        try:
            self._socket.sendall("".join(lines).encode())
        except OSError as error:
            raise SinkDownError(str(error)) from error

    def poll(self) -> None:
        """Do nothing: the protocol has no messages of its own."""

    def flush(self, stop: threading.Event) -> int:
        """Return 0: the protocol has no confirmations."""
        return 0

    def close(self) -> None:
        """Disconnect."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None


def open_graphite(address: SinkAddress, setting: SinkSetting) -> GraphiteSink:
    """Return the live output of `graphite:HOST:PORT?prefix=...`.

    Raises:
        SinkError: the address or an option is wrong.
    """
    address.check_options(("prefix",))
    host, _, port = address.target.rpartition(":")
    if not host or not port.isdecimal():
        raise SinkError(
            f"'{address.name}' names no port", "Write graphite:HOST:PORT, for example graphite:localhost:2003."
        )
    return GraphiteSink(host, int(port), address.options.get("prefix", "treadlink"))


KIND = SinkKind("treadlink_example.graphite_sink:open_graphite")
