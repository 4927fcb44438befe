"""Byte sources: the protocol that all of them follow, their items, and the registry that opens them by URI."""

import importlib
import logging
import math
import re
import shlex
import threading
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path
from typing import Final, Protocol, runtime_checkable

from gateway.core.clock import Clock
from gateway.core.errors import SourceError
from gateway.core.feature import Registry, added, object_of
from gateway.core.links.bus_frames import unpack
from gateway.core.links.reasons import LinkCode
from gateway.core.nearest_name import did_you_mean
from gateway.core.plugins import Plugin, load, missing_factory, names
from gateway.core.reasons import Code, CoreCode, Reason
from gateway.core.uri_parts import split_uri

_logger = logging.getLogger(__name__)


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes as one read of a link delivered them.

    Attributes:
        link: name of the link, unique in a session, e.g. `serial:/dev/ttyUSB0`.
        host_ns: arrival time, ns since the epoch.
        data: the bytes; none where a simulation only tells that its time has gone on.
    """

    link: str
    host_ns: int
    data: bytes


@dataclass(frozen=True, slots=True)
class BusFrames:
    """Frames of a vehicle bus that arrived within some milliseconds.

    Attributes:
        link: name of the link, e.g. `can:socketcan:can0`.
        host_ns: arrival of the first, ns since the epoch.
        data: the frames as `gateway.core.links.bus_frames` packs them.
    """

    link: str
    host_ns: int
    data: bytes

    @property
    def count(self) -> int:
        """Number of frames."""
        return sum(1 for _ in unpack(self.data, self.host_ns))


@dataclass(frozen=True, slots=True)
class Sentences:
    """Lines of a positioning receiver.

    Attributes:
        link: name of the link, e.g. `nmea:/dev/ttyACM0`.
        host_ns: arrival of the last, ns since the epoch.
        data: whole lines as received, NMEA 0183 among them, never empty.
    """

    link: str
    host_ns: int
    data: bytes

    @property
    def count(self) -> int:
        """Number of lines."""
        return len(self.data.splitlines())


class SensorLines(Sentences):
    """Lines of a receiver of tire pressure sensors: JSON as rtl_433 prints it."""


class LinkEventKind(StrEnum):
    """Kind of a change of a link; a mark of the user and an event of this computer concern all links."""

    CONNECTED = "connected"
    LOST = "lost"
    RETRYING = "retrying"
    RESTORED = "restored"
    ENDED = "ended"
    MARK = "mark"
    COMPUTER = "computer"

    @property
    def is_open(self) -> bool:
        """Whether the link is open after it."""
        return self in (LinkEventKind.CONNECTED, LinkEventKind.RESTORED)


_EVENT_CODES: Final = {
    LinkEventKind.CONNECTED: LinkCode.LINK_CONNECTED,
    LinkEventKind.LOST: LinkCode.LINK_LOST,
    LinkEventKind.RETRYING: LinkCode.LINK_RETRYING,
    LinkEventKind.RESTORED: LinkCode.LINK_RESTORED,
    LinkEventKind.ENDED: LinkCode.LINK_ENDED,
    LinkEventKind.COMPUTER: LinkCode.COMPUTER_EVENT,
}

_LONGEST_PAUSE_S: Final = 1e9
# In the year 2116: sums of such times fit into 64 bits, as recordings and tables have them.
_LATEST_NS: Final = 1 << 62

EVENT_DETAILS: Final[Mapping[Code, Mapping[str, type]]] = {
    LinkCode.BATTERY_LEVEL: {"level": float},
    LinkCode.BLE_DEVICE: {"device": str},
    LinkCode.COMPUTER_PAUSED: {"paused_s": float},
    LinkCode.COMPUTER_SUSPENDED: {"suspended_s": float},
    LinkCode.LINK_AWAY: {"away_s": float},
    LinkCode.LINK_DISCONNECTED: {},
    LinkCode.MARK_NOT_KEPT: {},
    LinkCode.MTU: {"mtu": int},
    LinkCode.MTU_TOO_SMALL: {"mtu": int, "needed": int},
    LinkCode.MTU_UNKNOWN: {"needed": int},
    LinkCode.NOTIFICATIONS_DROPPED: {"count": int},
    LinkCode.PORT_SHARED: {"holders": str},
    LinkCode.RECORDING_CHANNEL_UNDECLARED: {"recording": str, "channel": int},
    LinkCode.RECORDING_CHUNK_DAMAGED: {"recording": str, "at_byte": int, "skipped_bytes": int},
    LinkCode.RECORDING_CUT_OFF: {"recording": str, "at_byte": int},
    LinkCode.RECORDING_DESCRIPTION_DAMAGED: {"recording": str},
    LinkCode.RECORDING_PARTS_DAMAGED: {
        "recording": str,
        "parts": int,
        "at_byte": int,
        "unread_bytes": int,
        "size_bytes": int,
    },
    LinkCode.RECORDING_RECORD_DAMAGED: {"recording": str, "at_byte": int},
    LinkCode.RECORDING_RECORD_MISSING: {"recording": str, "at_byte": int},
    LinkCode.RETRY_INTERVAL: {"interval_s": float},
    LinkCode.SYSTEM_TIME_SLEWED: {"step_s": float, "span_s": float, "ahead_s": float},
    LinkCode.SYSTEM_TIME_SET: {"step_s": float, "ahead_s": float},
}
"""Codes that the details of an event may have, with the types of their values; a recording is checked against them."""


@dataclass(frozen=True, slots=True)
class LinkEvent:
    """A change of a link, shown to the user and kept in the recording.

    The recording keeps kind, text and details as they are here; views make the words from `reason`.

    Attributes:
        link: name of the link; of an event of this computer empty.
        host_ns: time of the event, ns since the epoch.
        kind: what happened.
        text: words from outside: those of a mark, or message and remedy of the error behind the event. Empty where
            kind and details say everything.
        rssi_dbm: signal strength of a radio link when it was connected, None where there is none.
        details: what else is known of the event, of the codes in EVENT_DETAILS.
    """

    link: str
    host_ns: int
    kind: LinkEventKind
    text: str = ""
    rssi_dbm: int | None = None
    details: tuple[Reason, ...] = ()

    @property
    def is_of_link(self) -> bool:
        """Whether it is a change of its link."""
        return self.kind not in (LinkEventKind.MARK, LinkEventKind.COMPUTER)

    @property
    def pause_ns(self) -> int | None:
        """Time before the event for which this computer paused, in the time of the session; None for other events.

        It is 0 after a suspension, in which that time stands still.
        """
        if self.kind is not LinkEventKind.COMPUTER or not self.details:
            return None
        detail = self.details[0]
        if detail.code is LinkCode.COMPUTER_SUSPENDED:
            return 0
        pause_s = detail["paused_s"] if detail.code is LinkCode.COMPUTER_PAUSED else None
        # Recordings may hold any number.
        if not isinstance(pause_s, float) or math.isnan(pause_s):
            return None
        return round(min(max(pause_s, 0.0), _LONGEST_PAUSE_S) * 1e9)

    @property
    def reason(self) -> Reason:
        """Kind, text and details as one reason, for views."""
        if self.kind is LinkEventKind.MARK:
            event = Reason(LinkCode.MARK, text=self.text)
            return Reason(LinkCode.LINK_EVENT, event=event, details=self.details) if self.details else event
        event = Reason(_EVENT_CODES[self.kind])
        quoted = (Reason(LinkCode.QUOTED_TEXT, text=self.text),) if self.text else ()
        details = (*quoted, *self.details)
        return Reason(LinkCode.LINK_EVENT, event=event, details=details) if details else event


def is_time(host_ns: int) -> bool:
    """Return whether a time can be recorded: between 1970 and 2116."""
    return 0 <= host_ns < _LATEST_NS


VehicleData = BusFrames | Sentences
"""What is recorded of the vehicle beside the wheels."""

LinkItem = Chunk | VehicleData | LinkEvent


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
        """Yield items until the source ends or `stop` is set (checked every 0.1 s or more often).

        Raises:
            SourceError: the source cannot be opened; nothing was yielded.
        """
        ...

    def close(self) -> None:
        """Release the port, file or process; may be called twice and from another thread."""
        ...


@runtime_checkable
class TwoWaySource(Source, Protocol):
    """A source that can be written to.

    Attributes:
        rate_hz: sampling rate to set on its hub, None to leave it.
    """

    rate_hz: float | None

    def send(self, data: bytes) -> None:
        """Write a frame.

        Raises:
            LinkLostError: the write failed.
            SourceError: the hub takes no data.
        """
        ...


class WrappedSource:
    """A source around another one, whose name, configuration and end are that one's."""

    def __init__(self, source: Source) -> None:
        """Wrap a source."""
        self._source = source

    @property
    def link(self) -> str:
        """Name of the link."""
        return self._source.link

    @property
    def vehicle_toml(self) -> str | None:
        """Configuration that comes with the source."""
        return self._source.vehicle_toml

    def close(self) -> None:
        """Release the source."""
        self._source.close()


@dataclass(frozen=True, slots=True)
class SourceAddress:
    """The parts of a source URI, `scheme:target?key=value`."""

    uri: str
    scheme: str
    target: str
    options: Mapping[str, str]

    def check_options(self, names: Collection[str], shown: str = "") -> None:
        """Refuse options that the source does not have.

        Args:
            names: options that it has.
            shown: these with their values, for the message; empty for the names alone.

        Raises:
            SourceError: there is one.
        """
        unknown = next((name for name in self.options if name not in names), None)
        if unknown is not None:
            raise SourceError(
                f"{self.scheme} has no option '{unknown}'",
                f"{did_you_mean(unknown, names)}Options are {shown or ', '.join(names)}.",
            )


DEFAULT_BAUDRATE: Final = 921600
"""Baud rate of a hub on a serial port unless the source says otherwise."""


@dataclass(frozen=True, slots=True)
class SourceKind:
    """Entry of the registry of sources.

    Attributes:
        factory: "module:function" with function(address: SourceAddress, clock: Clock) -> Source.
        live: whether bytes arrive now and are lost unless they are read, unlike those of a file or a simulation.
        file_suffixes: ends of targets that are files although others are live.
    """

    factory: str
    live: bool = True
    file_suffixes: tuple[str, ...] = ()


SOURCES: Final[dict[str, SourceKind]] = {
    "serial": SourceKind("gateway.core.links.serial_link:open_serial"),
    "tcp": SourceKind("gateway.core.links.tcp_link:open_tcp"),
    "ble": SourceKind("gateway.core.links.ble_source:open_ble"),
    "replay": SourceKind("gateway.core.recording.replay_source:open_replay", live=False),
}
"""Sources of the core by the scheme of their URI; features and plug-ins add others."""


def schemes_of_package() -> list[str]:
    """Return the schemes of this package's sources, those of features last; nothing is imported."""
    return [*SOURCES, *added(Registry.SOURCES)]


def source_kind(scheme: str) -> SourceKind | None:
    """Return the source of a scheme, None when there is none.

    Raises:
        PluginError: it is a plug-in that cannot be used.
    """
    if scheme in SOURCES:
        return SOURCES[scheme]
    if (target := added(Registry.SOURCES).get(scheme)) is not None:
        kind: SourceKind = object_of(target)
        return kind
    loaded = load(Registry.SOURCES, scheme, schemes_of_package(), plugin_fault)
    return loaded if isinstance(loaded, SourceKind) else None


def plugin_fault(_plugin: Plugin, loaded: object) -> Reason | None:
    """Return why the object of a plug-in is no source, None when it is one."""
    if not isinstance(loaded, SourceKind):
        return Reason(CoreCode.PLUGIN_REFUSED, why="wrong_type", expected="a gateway.core.links.source.SourceKind")
    return missing_factory(loaded.factory)


# Addresses without a scheme, as other programs take them: a port with its baud rate, and host:port.
_PORT: Final = re.compile(
    r"(?:(?:serial:(?://(?=/))?)?(?P<path>/dev/[^?]+?|COM\d+)|serial:(?P<name>[\w.-]+))(?::(?P<baudrate>\d{3,}))?"
    r"(?P<options>\?.*)?",
    re.IGNORECASE,
)
_HOST: Final = re.compile(r"(?:localhost|[A-Za-z0-9-]+(?:\.[A-Za-z0-9-]+)+|\[[0-9A-Fa-f:.]+\]):\d{1,5}(?:\?.*)?")


def _with_scheme(uri: str) -> str:
    """Return a source with the scheme that `/dev/ttyUSB0` and `host:5000` leave out, and a baud rate as option."""
    if port := _PORT.fullmatch(uri):
        path, name, baudrate, options = port.groups(default="")
        mark = "&" if options else "?"
        return f"serial:{path or name}{options}" + (f"{mark}baudrate={baudrate}" if baudrate else "")
    return f"tcp://{uri}" if _HOST.fullmatch(uri) else uri


def parse_source_uri(uri: str) -> SourceAddress:
    """Split `scheme:target?options`; `scheme://target` and `scheme:target` mean the same.

    A serial port and `host:port` need no scheme.

    Raises:
        SourceError: no known scheme, or no target.
    """
    try:
        scheme, _, target, options = split_uri(_with_scheme(uri))
    except ValueError as error:
        raise SourceError(f"source '{uri}' cannot be read: {error}", "Write special characters as %XX.") from error
    if source_kind(scheme) is None:
        schemes = [f"{name}:" for name in (*schemes_of_package(), *names(Registry.SOURCES, schemes_of_package()))]
        remedy = (
            f"It is a file. `treadlink replay {shlex.quote(uri)}` shows a recording, "
            f"`treadlink import --guess {shlex.quote(uri)}` begins the import of a measurement."
            if Path(uri).is_file()
            else f"{did_you_mean(f'{scheme or uri}:', schemes)}A source starts with one of {', '.join(schemes)}; try "
            "`treadlink live sim:demo`."
        )
        raise SourceError(f"unknown source '{uri}'", remedy)
    if not target:
        raise SourceError(
            f"source '{uri}' has no target after '{scheme}:'", "Give a port, file, host, hub or scenario."
        )
    return SourceAddress(uri, scheme, target, options)


def _kind_of(address: SourceAddress) -> SourceKind:
    kind = source_kind(address.scheme)
    assert kind is not None  # parsing refuses other schemes
    return kind


def is_live(uri: str) -> bool:
    """Return whether the source of a URI delivers bytes as they arrive.

    Raises:
        SourceError: no known scheme, or no target.
    """
    address = parse_source_uri(uri)
    kind = _kind_of(address)
    return kind.live and not address.target.lower().endswith(kind.file_suffixes)


def _number(text: str) -> float:
    """Return the number of a text, NaN where it is none."""
    try:
        return float(text)
    except ValueError:
        return math.nan


def positive_option(name: str, text: str, *, or_max: bool = False) -> float:
    """Return the value of an option that is a number above 0; with `or_max`, infinity for `max`.

    Raises:
        SourceError: anything else.
    """
    if or_max and text == "max":
        return math.inf
    value = _number(text)
    if not 0.0 < value < math.inf:
        raise SourceError(f"invalid option {name}={text}", f"Give a number above 0{' or max' if or_max else ''}.")
    return value


RATES_HZ: Final = (2000.0, 25600.0)
"""Lowest and highest sampling rate that a hub can be asked for."""
_MAX_SILENCE_S: Final = 3600.0


def number_option(options: Mapping[str, str], name: str, default: float, low: float, high: float) -> float:
    """Return the number of an option, its default where it is not given.

    Raises:
        SourceError: it is no number from `low` to `high`.
    """
    text = options.get(name)
    if text is None:
        return default
    value = _number(text)
    if not low <= value <= high:
        raise SourceError(f"{name}={text} is not allowed", f"Give a number from {low:g} to {high:g}.")
    return value


def rate_option(options: Mapping[str, str]) -> float | None:
    """Return the sampling rate in Hz to set on a hub, None without the option `rate`; errors as `number_option`."""
    return number_option(options, "rate", 0.0, *RATES_HZ) or None


def silence_option(options: Mapping[str, str], default_s: float = 6.0) -> float:
    """Return the time in s without a byte after which a link counts as lost, 0 for never; errors likewise."""
    return number_option(options, "silence", default_s, 0.0, _MAX_SILENCE_S)


def open_source(uri: str, clock: Clock) -> Source:
    """Open the source of a URI; its module is imported on first use.

    Raises:
        SourceError: the URI is wrong, or the source's optional package is missing.
    """
    address = parse_source_uri(uri)
    factory = _kind_of(address).factory
    _logger.debug("opening %s with %s", uri, factory)
    module_name, factory_name = factory.split(":")
    source: Source = getattr(importlib.import_module(module_name), factory_name)(address, clock)
    return source
