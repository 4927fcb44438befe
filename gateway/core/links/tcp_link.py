"""TCP connections to hubs behind a serial device server or a network gateway: `tcp://host:port`."""

import contextlib
import errno
import os
import re
import socket
import sys
from typing import Final, NamedTuple

from gateway.core.clock import Clock
from gateway.core.errors import LinkLostError, SourceError
from gateway.core.links.reconnect import ReconnectingSource
from gateway.core.links.source import Source, SourceAddress, rate_option, silence_option

CONNECT_TIMEOUT_S: Final = 5.0

_READ_BYTES: Final = 65536
_TARGET: Final = re.compile(r"(?P<host>\[[0-9A-Fa-f:.%\w]+\]|[^\[\]:/]+):(?P<port>\d{1,5})/?")
_NO_HOST: Final = (socket.gaierror, ValueError)
"""Errors of a name that has no address; a name that no resolver accepts, such as `a..b`, is a ValueError."""


class Keepalive(NamedTuple):
    """Probes of an idle connection, which find a peer that vanished without closing it.

    Attributes:
        idle_s: silence before the first probe.
        interval_s: time between probes.
        probes: unanswered probes after which the connection is lost.
    """

    idle_s: int = 5
    interval_s: int = 5
    probes: int = 3


class HostPort(NamedTuple):
    """Host and port of a TCP server."""

    host: str
    port: int

    def __str__(self) -> str:
        return f"[{self.host}]:{self.port}" if ":" in self.host else f"{self.host}:{self.port}"


def parse_host_port(address: SourceAddress) -> HostPort:
    """Return host and port of a source's address.

    Raises:
        SourceError: it has none, or an option is not known.
    """
    match = _TARGET.fullmatch(address.target)
    if match is None or not 1 <= int(match["port"]) <= 65535:
        form = "tcp://host:port" if address.scheme == "tcp" else f"{address.scheme}:host:port"
        raise SourceError(f"'{address.uri}' is not an address", f"Give {form}, port 1 to 65535.")
    address.check_options(("rate", "silence"))
    return HostPort(match["host"].strip("[]"), int(match["port"]))


def open_tcp(address: SourceAddress, clock: Clock) -> Source:
    """Make a source of a TCP connection; it is opened when its items are requested.

    Options: rate=9600 (Hz, set on the hub), silence=6 (seconds without a byte until the link counts as lost, 0 for
    never).

    Raises:
        SourceError: no host and port, or an option is not known or not allowed.
    """
    host_port, rate_hz = parse_host_port(address), rate_option(address.options)
    silence_s = silence_option(address.options)
    return ReconnectingSource(
        f"tcp:{host_port}", lambda: TcpLink(host_port), clock, rate_hz=rate_hz, silence_s=silence_s
    )


def connect(host_port: HostPort, device: str = "hub") -> socket.socket:
    """Return a connection to the first address of the host that accepts one.

    Args:
        host_port: host and port.
        device: what answers there, for errors.

    Raises:
        SourceError: the host is not known, or no address of it accepts a connection.
    """
    try:
        return socket.create_connection(host_port, CONNECT_TIMEOUT_S)
    except _NO_HOST as error:
        raise SourceError(
            f"cannot connect to {host_port}: there is no host '{host_port.host}'",
            "Check the name, or give the address in numbers.",
            cause=type(error).__name__,
        ) from error
    except TimeoutError as error:
        raise SourceError(
            f"cannot connect to {host_port}: no answer for {CONNECT_TIMEOUT_S:g} s",
            f"Is the {device} on, and is it in the same network?",
            cause=errno.ETIMEDOUT,
        ) from error
    except OSError as error:
        raise SourceError(
            f"cannot connect to {host_port}: {_brief(error)}",
            f"Is the {device} on, and are host and port right?",
            cause=error.errno or 0,
        ) from error


class TcpLink:
    """A `Link` of `gateway.core.links.reconnect` over a socket: every byte from the moment the peer accepts it."""

    def __init__(self, host_port: HostPort, keepalive: Keepalive | None = None, device: str = "hub") -> None:
        """Describe the connection.

        Args:
            host_port: host and port.
            keepalive: probes of an idle connection.
            device: what answers there, for errors.
        """
        self._host_port, self._device = host_port, device
        self._keepalive = keepalive if keepalive is not None else Keepalive()
        self._socket: socket.socket | None = None

    def open(self) -> None:
        """Connect.

        Raises:
            SourceError: it cannot be opened now.
        """
        self._socket = connect(self._host_port, self._device)
        set_keepalive(self._socket, self._keepalive)

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived, or wait for the first; empty after `timeout_s`.

        Raises:
            LinkLostError: the connection broke.
        """
        connection = self._socket
        if connection is None:
            raise LinkLostError(f"{self._host_port} is not connected")
        connection.settimeout(timeout_s)
        try:
            data = connection.recv(_READ_BYTES)
        except TimeoutError as error:
            # A peer that answers no probe gives the same error, with a number.
            if error.errno is None:
                return b""
            raise LinkLostError(
                f"{self._host_port} does not answer any more", f"Is the {self._device} still on, and in the network?"
            ) from error
        except OSError as error:
            raise LinkLostError(
                f"{self._host_port} broke the connection: {_brief(error)}", f"Is the {self._device} still on?"
            ) from error
        if not data:
            raise LinkLostError(f"{self._host_port} closed the connection", f"Is the {self._device} still on?")
        return data

    def write(self, data: bytes) -> None:
        """Write a frame to the hub.

        Raises:
            LinkLostError: the connection broke.
        """
        connection = self._socket
        if connection is None:
            raise LinkLostError(f"{self._host_port} is not connected")
        try:
            connection.sendall(data)
        except OSError as error:
            raise LinkLostError(
                f"{self._host_port} broke the connection: {_brief(error)}", f"Is the {self._device} still on?"
            ) from error

    def close(self) -> None:
        """Disconnect; may be called at any time and twice, never raises."""
        connection, self._socket = self._socket, None
        if connection is not None:
            with contextlib.suppress(OSError):
                connection.close()


def set_keepalive(connection: socket.socket, keepalive: Keepalive) -> None:
    """Make the system probe a connection while it is idle, as far as the system supports it."""
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    if sys.platform == "win32":
        # Windows takes both times in ms; the number of probes is fixed.
        connection.ioctl(socket.SIO_KEEPALIVE_VALS, (1, keepalive.idle_s * 1000, keepalive.interval_s * 1000))
        return
    # macOS names the time before the first probe differently.
    idle = getattr(socket, "TCP_KEEPIDLE", getattr(socket, "TCP_KEEPALIVE", None))
    for option, value in (
        (idle, keepalive.idle_s),
        (getattr(socket, "TCP_KEEPINTVL", None), keepalive.interval_s),
        (getattr(socket, "TCP_KEEPCNT", None), keepalive.probes),
    ):
        if option is not None:
            connection.setsockopt(socket.IPPROTO_TCP, option, value)


def _brief(error: OSError) -> str:
    if error.errno is None:
        return str(error) or type(error).__name__
    return os.strerror(error.errno)
