"""Hubs on Bluetooth LE as sources: `ble://NAME`, `ble://AA:BB:CC:DD:EE:FF?adapter=hci1`."""

import asyncio
import threading
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Final

from gateway.core.clock import Clock
from gateway.core.errors import SourceError
from gateway.core.links.ble_hub import Sighting, keep
from gateway.core.links.ble_link import BleLink, BleSettings, find
from gateway.core.links.ble_radio import BLE_ERRORS, explain, radio
from gateway.core.links.reasons import LinkCode
from gateway.core.links.reconnect import ReconnectingSource
from gateway.core.links.source import (
    LinkEvent,
    LinkEventKind,
    LinkItem,
    Source,
    SourceAddress,
    number_option,
    rate_option,
    silence_option,
)
from gateway.core.reasons import Reason

_MAX_SCAN_S: Final = 120.0
OPTIONS: Final = ("adapter", "scan", "silence", "notify", "rate")


class BleSource(ReconnectingSource):
    """A hub on Bluetooth LE; after a loss it is searched for and connected again.

    Once connected it stays with that hub: another one of the same name that appears later is not taken for it.
    """

    def __init__(
        self,
        settings: BleSettings,
        clock: Clock,
        *,
        rate_hz: float | None = None,
        silence_s: float = 6.0,
    ) -> None:
        """Name the hub; nothing is opened yet."""
        self._settings = settings
        link = f"ble:{settings.target}"
        super().__init__(link, lambda: BleLink(self._settings), clock, rate_hz=rate_hz, silence_s=silence_s)

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield chunks and events until stopped or closed, then an event that it was disconnected on request.

        Raises:
            SourceError: the hub could not be connected the first time.
        """
        was_connected = False
        for item in super().items(stop):
            was_connected = True
            yield item
        if was_connected:
            yield self._event(LinkEventKind.ENDED, details=(Reason(LinkCode.LINK_DISCONNECTED),))

    def look(self) -> Sighting:
        """Return the hub as its advertisement describes it, without connecting.

        Raises:
            SourceError: it is not in range, or Bluetooth fails.
        """
        try:
            return radio().run(find(self._settings))
        except BLE_ERRORS as error:
            raise explain(error, f"find {self._settings.target}") from error

    def _open(self, stop: threading.Event) -> bool:
        opened = super()._open(stop)
        link = self._current
        if opened and isinstance(link, BleLink) and link.sighting is not None:
            self._settings = replace(self._settings, target=link.sighting.address)
        return opened

    def _items_of(self, data: bytes) -> list[LinkItem]:
        items = super()._items_of(data)
        link = self._current
        if items and isinstance(link, BleLink) and (dropped := link.take_dropped()):
            details = (Reason(LinkCode.NOTIFICATIONS_DROPPED, count=dropped),)
            items.append(super()._event(LinkEventKind.CONNECTED, details=details))
        return items

    def _event(self, kind: LinkEventKind, text: str = "", details: tuple[Reason, ...] = ()) -> LinkEvent:
        event = super()._event(kind, text, details)
        link = self._current
        if not kind.is_open or not isinstance(link, BleLink):
            return event
        rssi_dbm = link.sighting.rssi_dbm if link.sighting is not None else None
        return replace(event, details=(*details, *link.details()), rssi_dbm=rssi_dbm)


def open_ble(address: SourceAddress, clock: Clock) -> Source:
    """Make a source of a hub; the search starts when its items are requested.

    Options: adapter=hci1 (Linux), scan=10 (seconds to search for it), silence=6 (seconds without a byte until the link
    counts as lost, 0 for never), notify=signal|socket (Linux: path of notifications), rate=9600 (Hz, set on the hub).

    Raises:
        SourceError: an option is not known or not allowed.
    """
    address.check_options(OPTIONS)
    options = address.options
    if options.get("notify", "signal") not in ("signal", "socket"):
        raise SourceError(f"notify={options['notify']} is not allowed", "Give notify=signal or notify=socket.")
    settings = BleSettings(
        target=address.target.rstrip("/"),
        adapter=options.get("adapter", ""),
        scan_s=number_option(options, "scan", 10.0, 0.1, _MAX_SCAN_S),
        by_socket=options.get("notify") == "socket",
    )
    return BleSource(settings, clock, rate_hz=rate_option(options), silence_s=silence_option(options))


@dataclass(frozen=True, slots=True)
class ScanResult:
    """Devices that a scan found.

    Attributes:
        sightings: strongest signal first.
        fault: why the scan failed, None when it did not.
    """

    sightings: tuple[Sighting, ...]
    fault: SourceError | None


def scan_devices(seconds: float, adapter: str = "") -> ScanResult:
    """Scan for Bluetooth LE devices; an error is returned rather than raised, as callers list other ports too."""
    sightings: dict[str, Sighting] = {}
    try:
        radio().run(_listen(seconds, adapter, sightings))
    except BLE_ERRORS as error:
        return ScanResult((), explain(error, "scan"))
    return ScanResult(tuple(sorted(sightings.values(), key=lambda sighting: -(sighting.rssi_dbm or -128))), None)


async def _listen(seconds: float, adapter: str, sightings: dict[str, Sighting]) -> None:
    def record(sighting: Sighting) -> None:
        keep(sightings, sighting)

    async with radio().scanner(adapter).listen(record):
        await asyncio.sleep(seconds)
