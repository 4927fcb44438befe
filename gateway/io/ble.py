"""Hubs over Bluetooth LE: `ble://NAME`, `ble://AA:BB:CC:DD:EE:FF?adapter=hci1`."""

from __future__ import annotations

import asyncio
import difflib
import threading
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Final

from gateway.clock import Clock
from gateway.errors import LinkLostError, SourceError
from gateway.io.ble_errors import BLE_ERRORS, explain
from gateway.io.ble_hub import Sighting
from gateway.io.ble_link import BleLink, BleSettings, find
from gateway.io.ble_radio import radio
from gateway.io.reconnect import Backoff, ReconnectingSource
from gateway.io.source import LinkEvent, LinkEventKind, LinkItem, Source, SourceAddress

_MAX_SCAN_S: Final = 120.0
_MAX_SILENCE_S: Final = 3600.0
_RATES_HZ: Final = (2000.0, 25600.0)
OPTIONS: Final = ("adapter", "scan", "silence", "notify", "rate")


class BleSource(ReconnectingSource):
    """A hub by Bluetooth LE; a lost one is searched for and connected again.

    Once connected it stays with that hub: another one of the same name that shows up later is not taken for it.

    Attributes:
        rate_hz: sampling rate that the hub shall be told, None to leave it.
    """

    def __init__(
        self, settings: BleSettings, clock: Clock, *, rate_hz: float | None = None, backoff: Backoff | None = None
    ) -> None:
        """Name the hub; nothing is opened yet."""
        self._settings = settings
        self._ble_clock = clock
        self.rate_hz = rate_hz
        super().__init__(f"ble:{settings.target}", self._fresh_link, clock, backoff)

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield chunks and events until stopped or closed; then, once disconnected, that this was as asked.

        Raises:
            SourceError: the hub could not be connected the first time.
        """
        was_connected = False
        for item in super().items(stop):
            was_connected = True
            yield item
        if was_connected:
            yield self._event(LinkEventKind.ENDED, f"{self.link} was disconnected as asked")

    def send(self, data: bytes) -> None:
        """Write a frame to the hub; from any thread.

        Raises:
            LinkLostError: it is not connected, or the write failed.
            SourceError: it takes nothing.
        """
        link = self._current
        if not isinstance(link, BleLink):
            raise LinkLostError(f"{self.link} is not connected")
        link.write(data)

    def look(self) -> Sighting:
        """Return the hub as its advertisement shows it, without connecting.

        Raises:
            SourceError: it is not there, or Bluetooth fails.
        """
        try:
            return radio().run(find(self._settings))
        except BLE_ERRORS as error:
            raise explain(error, f"find {self._settings.target}") from error

    def _fresh_link(self) -> BleLink:
        return BleLink(self._settings, self._ble_clock)

    def _open(self, stop: threading.Event) -> bool:
        opened = super()._open(stop)
        link = self._current
        if opened and isinstance(link, BleLink) and link.sighting is not None:
            self._settings = replace(self._settings, target=link.sighting.address)
        return opened

    def _chunks(self, stop: threading.Event) -> Iterator[LinkItem]:
        for item in super()._chunks(stop):
            yield item
            link = self._current
            if isinstance(link, BleLink) and (dropped := link.take_dropped()):
                text = f"this computer is too slow: {dropped} notifications of {self.link} were dropped"
                yield super()._event(LinkEventKind.CONNECTED, text)

    def _event(self, kind: LinkEventKind, text: str) -> LinkEvent:
        event = super()._event(kind, text)
        link = self._current
        if kind not in (LinkEventKind.CONNECTED, LinkEventKind.RESTORED) or not isinstance(link, BleLink):
            return event
        rssi_dbm = link.sighting.rssi_dbm if link.sighting is not None else None
        return replace(event, text=f"{text}: {link.details()}", rssi_dbm=rssi_dbm)


def open_ble(address: SourceAddress, clock: Clock) -> Source:
    """Make a source of a hub; it is searched for when its items are asked for.

    Options: adapter=hci1 (Linux), scan=10 (seconds to look for it), silence=6 (seconds without a byte until the link
    counts as lost, 0 for never), notify=signal|socket (Linux: how notifications come), rate=9600 (Hz, told to the hub).

    Raises:
        SourceError: an option is not known or not allowed.
    """
    options = address.options
    for name in options:
        if name not in OPTIONS:
            near = difflib.get_close_matches(name, OPTIONS, 1)
            hint = f"Did you mean {near[0]}? " if near else ""
            raise SourceError(f"ble has no option '{name}'", f"{hint}Options are {', '.join(OPTIONS)}.")
    if options.get("notify", "signal") not in ("signal", "socket"):
        raise SourceError(f"notify={options['notify']} is not allowed", "Give notify=signal or notify=socket.")
    settings = BleSettings(
        target=address.target.rstrip("/"),
        adapter=options.get("adapter", ""),
        scan_s=_number(options, "scan", 10.0, 0.1, _MAX_SCAN_S),
        silence_s=_number(options, "silence", 6.0, 0.0, _MAX_SILENCE_S),
        by_socket=options.get("notify") == "socket",
    )
    rate_hz = _number(options, "rate", 0.0, *_RATES_HZ) if "rate" in options else None
    return BleSource(settings, clock, rate_hz=rate_hz)


@dataclass(frozen=True, slots=True)
class Around:
    """What a scan found.

    Attributes:
        sightings: by signal strength.
        fault: why nothing could be heard, None when it could.
    """

    sightings: tuple[Sighting, ...]
    fault: SourceError | None


def scan(seconds: float, adapter: str = "") -> Around:
    """Listen for Bluetooth LE devices for a while; a fault is handed back, for there is more to list than these."""
    seen: dict[str, Sighting] = {}
    try:
        radio().run(_listen(seconds, adapter, seen))
    except BLE_ERRORS as error:
        return Around((), explain(error, "scan"))
    return Around(tuple(sorted(seen.values(), key=lambda sighting: -(sighting.rssi_dbm or -128))), None)


async def _listen(seconds: float, adapter: str, seen: dict[str, Sighting]) -> None:
    def hear(sighting: Sighting) -> None:
        seen[sighting.address] = sighting

    async with radio().air(adapter).listen(hear):
        await asyncio.sleep(seconds)


def _number(options: Mapping[str, str], name: str, default: float, low: float, high: float) -> float:
    text = options.get(name)
    if text is None:
        return default
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not low <= value <= high:
        raise SourceError(f"{name}={text} is not allowed", f"Give a number from {low:g} to {high:g}.")
    return value
