"""Interface of live outputs, their items, and the registry that opens them by URI."""

import importlib
import logging
import os
import threading
import zlib
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final, Protocol, runtime_checkable
from urllib.parse import urlsplit

from gateway.core.clock import Clock, SystemClock
from gateway.core.errors import TreadlinkError
from gateway.core.estimates.results import AlarmChange, RevolutionResult, SessionSnapshot
from gateway.core.feature import Registry
from gateway.core.nearest_name import did_you_mean
from gateway.core.plugins import Plugin, PluginStatus, load, missing_factory, names, statuses
from gateway.core.reasons import CoreCode, Reason
from gateway.core.text.session_control import SessionControl
from gateway.core.uri_parts import split_uri

_logger = logging.getLogger(__name__)


class SinkError(TreadlinkError):
    """A live output cannot be opened at all: unknown scheme, bad option, missing package."""


class SinkDownError(Exception):
    """A receiver is not there or has left; the output is opened again later. The message is the cause."""


class SinkRefusedError(Exception):
    """A receiver refused revolutions or alarms that were sent before; they are not sent again.

    Attributes:
        count: how many.
    """

    def __init__(self, cause: str, count: int) -> None:
        """Note what the receiver said, and how many it refused."""
        super().__init__(cause)
        self.count = count


REFUSED_FOR_GOOD: Final = frozenset({400, 413, 422})
"""Status of HTTP that answers a content: the same content will be refused again."""


class Refusals:
    """What a receiver has refused since it was last said."""

    count, _cause = 0, ""

    def add(self, cause: str, count: int) -> None:
        """Note a refusal of so many revolutions and alarms."""
        self.count, self._cause = self.count + count, cause

    def check(self) -> None:
        """Say a refusal, once.

        Raises:
            SinkRefusedError: there is one.
        """
        count, cause, self.count, self._cause = self.count, self._cause, 0, ""
        if cause:
            raise SinkRefusedError(cause, count)


class SinkEndedError(Exception):
    """A receiver has left for good, such as the reader of a pipe."""


@dataclass(frozen=True, slots=True)
class PublishedRevolution:
    """A revolution to publish.

    Attributes:
        host_ns: time of its end, ns since the epoch; that of the recording in a replay.
        result: the result. The waveforms of its revolution (`radial_mps2`, `axes_mps2`, `orders_mps2`) are empty:
            they would fill the buffer. The states carry the latest waveform of each wheel.
    """

    host_ns: int
    result: RevolutionResult


@dataclass(frozen=True, slots=True)
class PublishedAlarm:
    """A change of an alarm to publish."""

    host_ns: int
    change: AlarmChange


@dataclass(frozen=True, slots=True)
class PublishedState:
    """State of the session, once a second and at the end. Older ones are replaced, not kept."""

    host_ns: int
    snapshot: SessionSnapshot


Item = PublishedRevolution | PublishedAlarm | PublishedState


class Sink(Protocol):
    """A live output. All calls come from one thread, which belongs to it: blocking holds nothing else.

    Every method may raise SinkDownError: the output is then closed and opened again later, with the same item. `send`,
    `poll` and `flush` may raise SinkRefusedError about earlier items before they do anything else; they are repeated.
    """

    def open(self, stop: threading.Event) -> None:
        """Connect to the receiver, after `close` again.

        Raises:
            SinkDownError: the receiver is not there.
        """
        ...

    def send(self, item: Item, stop: threading.Event) -> None:
        """Hand an item to the receiver, and wait while the receiver is slow.

        Args:
            item: the item.
            stop: checked while waiting, every 0.1 s or more often; SinkDownError is raised when it is set.

        Raises:
            SinkDownError: the receiver did not take the item.
            SinkEndedError: the receiver has left for good.
        """
        ...

    def poll(self) -> None:
        """Keep the connection alive; called ten times a second while there is nothing to send. Nothing by default."""
        return

    def flush(self, stop: threading.Event) -> int:
        """Wait until the receiver has confirmed everything; with `stop` set, raise nothing and return at once.

        Returns:
            number of revolutions and alarms sent before that are not confirmed; 0 by default, as of a receiver that has
            every item once it is sent.
        """
        return 0

    def close(self) -> None:
        """Release the connection; may be called twice. Raises nothing. Nothing by default."""
        return


@runtime_checkable
class BrowsedSink(Protocol):
    """A live output that users open in a browser."""

    address: str
    """The address to open."""


@dataclass(frozen=True, slots=True)
class SinkAddress:
    """The parts of a URI, `scheme:target?key=value`.

    Attributes:
        uri: as given.
        scheme: before the first colon, lower case.
        target: the rest without options, percent signs resolved; leading slashes of `scheme://` left out.
        options: by name.
    """

    uri: str
    scheme: str
    target: str
    options: Mapping[str, str]

    @property
    def name(self) -> str:
        """The URI without options, for views; of a webhook, whose path is often a secret, host and a checksum."""
        if self.scheme == "webhook":
            return f"webhook:{urlsplit(self.target).hostname or ''}#{zlib.crc32(self.uri.encode()):08x}"
        return self.uri.partition("?")[0]

    def check_options(self, options: Collection[str]) -> None:
        """Refuse options that the output does not have.

        Raises:
            SinkError: there is one.
        """
        unknown = [name for name in self.options if name not in options]
        if unknown:
            raise SinkError(
                f"'{self.name}' has no option '{unknown[0]}'",
                f"{did_you_mean(unknown[0], options)}Known options: {', '.join(sorted(options))}."
                if options
                else "It has no options.",
            )


@dataclass(frozen=True, slots=True)
class SinkSetting:
    """Facts of the session that an output may need.

    Attributes:
        positions: configured wheels, in the order of the vehicle file; empty without one.
        session: returns the session, None before it runs.
        clock: of the session.
    """

    positions: Sequence[str] = ()
    session: Callable[[], SessionControl | None] = lambda: None
    clock: Clock = field(default_factory=SystemClock)


@dataclass(frozen=True, slots=True)
class SinkKind:
    """Entry of the registry of live outputs.

    Attributes:
        factory: "module:function" with function(address: SinkAddress, setting: SinkSetting) -> Sink. The function
            checks address and options and raises SinkError; it does not connect.
        extra: of this package, that installs what the output needs; empty when nothing is needed.
        state_interval_s: time from one state to the next.
        alarms_only: whether it is handed no revolutions; they are not counted as published.
    """

    factory: str
    extra: str = ""
    state_interval_s: float = 1.0
    alarms_only: bool = False


SINKS: Final[dict[str, SinkKind]] = {
    "jsonl": SinkKind("gateway.publishing.json_lines:open_json_lines"),
    "mqtt": SinkKind("gateway.publishing.mqtt:open_mqtt", "mqtt"),
    "mqtts": SinkKind("gateway.publishing.mqtt:open_mqtt", "mqtt"),
    "foxglove": SinkKind("gateway.publishing.foxglove_server:open_foxglove", "foxglove"),
    "can": SinkKind("gateway.publishing.can_bus:open_can", "can"),
    "web": SinkKind("gateway.publishing.page_server:open_page", "web", state_interval_s=0.25),
    "influx": SinkKind("gateway.publishing.influx:open_influx", "influx"),
    "influxs": SinkKind("gateway.publishing.influx:open_influx", "influx"),
    "webhook": SinkKind("gateway.publishing.webhook:open_webhook", alarms_only=True),
    "prometheus": SinkKind("gateway.publishing.prometheus:open_prometheus", "prometheus"),
}
"""Live outputs of this package by the scheme of their URI; plug-ins add others."""


def sink_kind(scheme: str) -> SinkKind | None:
    """Return the live output of a scheme, None when there is none.

    Raises:
        PluginError: it is a plug-in that cannot be used.
    """
    if scheme in SINKS:
        return SINKS[scheme]
    kind = load(Registry.SINKS, scheme, SINKS, plugin_fault)
    return kind if isinstance(kind, SinkKind) else None


def plugin_fault(_plugin: Plugin, sink: object) -> Reason | None:
    """Return why the object of a plug-in is no live output, None when it is one."""
    if not isinstance(sink, SinkKind):
        return Reason(CoreCode.PLUGIN_REFUSED, why="wrong_type", expected="a gateway.publishing.sink.SinkKind")
    return missing_factory(sink.factory)


def plugin_statuses() -> list[PluginStatus]:
    """Return the live outputs of plug-ins with the verdict."""
    return statuses(Registry.SINKS, tuple(SINKS), plugin_fault)


def kind_of(uri: str) -> SinkKind:
    """Return the kind of the live output of a URI."""
    kind = sink_kind(parse_sink_uri(uri).scheme)
    assert kind is not None  # parsing refuses other schemes
    return kind


def parse_sink_uri(uri: str) -> SinkAddress:
    """Split `scheme:target?options`; `scheme://target` and `scheme:target` mean the same.

    Raises:
        SinkError: no known scheme, no target, or a password in it.
    """
    try:
        scheme, authority, target, options = split_uri(uri)
    except ValueError as error:
        raise SinkError(f"--publish '{uri}' cannot be read: {error}", "Write special characters as %XX.") from error
    if sink_kind(scheme) is None:
        schemes = [f"{name}:" for name in (*SINKS, *names(Registry.SINKS, SINKS))]
        hint = did_you_mean(f"{scheme or uri}:", schemes)
        raise SinkError(
            f"unknown live output '{uri}'", f"{hint}It starts with one of {', '.join(schemes)}; for example jsonl:-"
        )
    if "@" in authority:
        raise SinkError(
            f"--publish {scheme}: has a user name or password in its address, where others can read it",
            "Set the environment variables TREADLINK_MQTT_USERNAME and TREADLINK_MQTT_PASSWORD, or "
            "TREADLINK_INFLUX_TOKEN.",
        )
    if not target:
        raise SinkError(f"--publish '{uri}' has no target after '{scheme}:'", "Give a path, host, port or channel.")
    return SinkAddress(uri, scheme, target, options)


def open_sink(uri: str, setting: SinkSetting) -> tuple[str, Sink]:
    """Return name and live output of a URI; its module is imported on first use.

    Raises:
        SinkError: the URI is wrong, or an optional package is missing.
    """
    address, kind = parse_sink_uri(uri), kind_of(uri)
    _logger.debug("opening %s with %s", address.name, kind.factory)
    module_name, factory_name = kind.factory.split(":")
    try:
        sink: Sink = getattr(importlib.import_module(module_name), factory_name)(address, setting)
    except ModuleNotFoundError as error:
        package = (error.name or "?").partition(".")[0]
        raise SinkError(
            f"'{address.name}' needs the package '{package}', which is not installed",
            f"Install it with: pip install 'treadlink[{kind.extra}]'" if kind.extra else f"Install it: {error}",
        ) from error
    return address.name, sink


def cannot_listen(host: str, port: int, error: Exception) -> str:
    """Return what a server says of an address that it cannot take; the socket's error repeats the address."""
    cause = str(getattr(error, "strerror", None) or error).partition(" (while attempting")[0]
    return f"cannot listen on {host}:{port}: {cause}"


def missing_newline(path: Path) -> bytes:
    """Return the newline that half a line at the end of a file lacks, as a killed session leaves it; else nothing."""
    with suppress(OSError):
        if path.is_file() and path.stat().st_size:
            with path.open("rb") as file:
                file.seek(-1, os.SEEK_END)
                return b"" if file.read(1) == b"\n" else b"\n"
    return b""


def host_and_port(address: SinkAddress, default_port: int) -> tuple[str, int]:
    """Return host and port of `scheme://host:port`.

    Raises:
        SinkError: there is no host, or the port is not one.
    """
    parts = urlsplit(address.uri)
    try:
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise SinkError(f"'{address.name}': {error}", "Give a port from 1 to 65535.") from error
    if not host:
        raise SinkError(f"'{address.uri}' has no host", f"Write {address.scheme}://HOST:PORT.")
    return host, default_port if port is None else port
