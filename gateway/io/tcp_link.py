"""Frames over TCP, as serial device servers and network gateways give them: `tcp://host:port`."""

from __future__ import annotations

import re
from typing import Final

import serial

from gateway.clock import Clock
from gateway.errors import LinkLostError, SourceError
from gateway.io.pyserial_link import PyserialLink
from gateway.io.reconnect import ReconnectingSource
from gateway.io.source import Source, SourceAddress

_TARGET: Final = re.compile(r"(?P<host>\[[0-9A-Fa-f:.%\w]+\]|[^\[\]:/]+):(?P<port>\d{1,5})/?")


def open_tcp(address: SourceAddress, clock: Clock) -> Source:
    """Make a source of a TCP connection; it is opened when its items are asked for.

    Raises:
        SourceError: no host and port, or an option (there are none).
    """
    match = _TARGET.fullmatch(address.target)
    if match is None or not 1 <= int(match["port"]) <= 65535:
        raise SourceError(f"'{address.uri}' is no address", "Give tcp://host:port, port 1 to 65535.")
    if address.options:
        raise SourceError(f"tcp has no option '{next(iter(address.options))}'", "Give tcp://host:port only.")
    place = f"{match['host']}:{int(match['port'])}"

    def connect() -> serial.SerialBase:
        return serial.serial_for_url(f"socket://{place}")

    def explain(error: Exception) -> SourceError:
        reason = re.sub(r"^Could not open port \S+: (\[Errno -?\d+\] )?", "", str(error))
        return SourceError(f"cannot connect to {place}: {reason}", "Is the hub on, and are host and port right?")

    def make_link() -> PyserialLink:
        return PyserialLink(
            connect,
            explain,
            lambda error: LinkLostError(f"{place} closed the connection ({error})", "Is the hub still on?"),
        )

    return ReconnectingSource(f"tcp:{place}", make_link, clock)
