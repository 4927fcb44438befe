"""What every byte source looks like, and the one registry that opens them by URI."""

from __future__ import annotations

import importlib
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Final, Protocol
from urllib.parse import parse_qsl, unquote, urlsplit

from gateway.clock import Clock
from gateway.errors import SourceError


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes as one read of a link delivered them.

    Attributes:
        link: name of the link, unique in a session, e.g. `serial:/dev/ttyUSB0`.
        host_ns: arrival time, ns since the epoch.
        data: the bytes, never empty.
    """

    link: str
    host_ns: int
    data: bytes


class LinkEventKind(StrEnum):
    """What happened to a link."""

    CONNECTED = "connected"
    LOST = "lost"
    RETRYING = "retrying"
    RESTORED = "restored"
    ENDED = "ended"
    MARK = "mark"


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """Something that happened to a link, told to the user and marked in the recording.

    Attributes:
        link: name of the link.
        host_ns: when, ns since the epoch.
        kind: what happened.
        text: the same in plain words.
        rssi_dbm: signal strength of a radio link when it was connected, None where there is none.
    """

    link: str
    host_ns: int
    kind: LinkEventKind
    text: str
    rssi_dbm: int | None = None


LinkItem = Chunk | LinkEvent


class Source(Protocol):
    """A stream of link items. Opened by `open_source`, read in a thread of its own by the session."""

    @property
    def link(self) -> str:
        """Name of the link, as it appears in chunks and recordings."""
        ...

    @property
    def vehicle_toml(self) -> str | None:
        """Vehicle configuration (TOML text) that a recording or a scenario brings along; None for a live link."""
        ...

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield items until the source ends or `stop` is set (looked at every 0.1 s at least).

        Raises:
            SourceError: the source cannot be opened; nothing was yielded.
        """
        ...

    def close(self) -> None:
        """Release the port, file or process; may be called twice and from another thread."""
        ...


@dataclass(frozen=True, slots=True)
class SourceAddress:
    """A source URI taken apart: `scheme:target?key=value`."""

    uri: str
    scheme: str
    target: str
    options: Mapping[str, str]


# scheme -> "module:factory"; factory(address: SourceAddress, clock: Clock) -> Source.
SOURCES: Final[dict[str, str]] = {
    "serial": "gateway.io.serial_link:open_serial",
    "tcp": "gateway.io.tcp_link:open_tcp",
    "ble": "gateway.io.ble:open_ble",
    "replay": "gateway.recording.replay_source:open_replay",
    "sim": "gateway.simulator.simulator_source:open_simulator",
}


def parse_source_uri(uri: str) -> SourceAddress:
    """Take `scheme:target?options` apart; `scheme://target` and `scheme:target` mean the same.

    Raises:
        SourceError: no known scheme, or no target.
    """
    try:
        parts = urlsplit(uri)
    except ValueError as error:
        raise SourceError(f"source '{uri}' cannot be read: {error}", "Write special characters as %XX.") from error
    scheme = parts.scheme.lower()
    if scheme not in SOURCES:
        known = ", ".join(f"{name}:" for name in SOURCES)
        raise SourceError(
            f"unknown source '{uri}'", f"A source starts with one of {known}; try `treadlink live sim:demo`."
        )
    target = unquote(parts.netloc + parts.path)
    if not target:
        raise SourceError(
            f"source '{uri}' names nothing after '{scheme}:'", "Give a port, file, host, hub or scenario."
        )
    return SourceAddress(uri, scheme, target, dict(parse_qsl(parts.query, keep_blank_values=True)))


def open_source(uri: str, clock: Clock) -> Source:
    """Open the source that `uri` names; its module is imported only now.

    Raises:
        SourceError: the URI is wrong, or the source's optional package is missing.
    """
    address = parse_source_uri(uri)
    module_name, factory_name = SOURCES[address.scheme].split(":")
    source: Source = getattr(importlib.import_module(module_name), factory_name)(address, clock)
    return source
