"""Hubs on Bluetooth LE: their services and characteristics, and picking one of several."""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Final

from bleak.backends.characteristic import BleakGATTCharacteristic
from bleak.backends.device import BLEDevice
from bleak.backends.service import BleakGATTServiceCollection

from gateway.core.errors import SourceError

# Nordic's UART service; the gateway writes to the hub's receive characteristic.
UART_SERVICE: Final = "6e400001-b5a3-f393-e0a9-e50e24dcca9e"
UART_TO_HUB: Final = "6e400002-b5a3-f393-e0a9-e50e24dcca9e"
UART_FROM_HUB: Final = "6e400003-b5a3-f393-e0a9-e50e24dcca9e"
BATTERY_SERVICE: Final = "0000180f-0000-1000-8000-00805f9b34fb"
MAX_SIGHTINGS: Final = 1000
"""Devices that one scan keeps: addresses are free, so that a sender can advertise under any number of them."""
_MAX_LISTED: Final = 8
_ADDRESS: Final = re.compile(r"([0-9A-F]{2}:){5}[0-9A-F]{2}|[0-9A-F]{8}(-[0-9A-F]{4}){3}-[0-9A-F]{12}", re.IGNORECASE)


@dataclass(frozen=True, slots=True)
class Sighting:
    """A device that advertises, or that is already connected to this computer.

    Attributes:
        address: six bytes in hex; on macOS an identifier that only this computer uses.
        name: as advertised, empty when it is not.
        rssi_dbm: signal strength of the advertisement, None without one.
        battery_percent: from the advertisement, None when not given.
        is_hub: whether it advertises the UART service.
        device: bleak's handle.
    """

    address: str
    name: str
    rssi_dbm: int | None
    battery_percent: int | None
    is_hub: bool
    device: BLEDevice = field(repr=False, compare=False)

    @property
    def is_paired(self) -> bool:
        """Whether this computer has a key of it, where the system tells."""
        details = self.device.details
        properties = details.get("props", {}) if isinstance(details, dict) else {}
        return bool(properties.get("Paired", False))

    def __str__(self) -> str:
        """Return name, address and signal in one phrase."""
        signal = f" ({self.rssi_dbm} dBm)" if self.rssi_dbm is not None else ""
        return f"{self.name or 'unnamed'} at {self.address}{signal}"


def is_address(text: str) -> bool:
    """Return whether a target is an address rather than a name."""
    return _ADDRESS.fullmatch(text) is not None


def is_meant(sighting: Sighting, target: str) -> bool:
    """Return whether `target`, an address or a name, names this device; case is ignored."""
    advertised = sighting.address if is_address(target) else sighting.name
    return advertised.casefold() == target.casefold()


def keep(seen: dict[str, Sighting], sighting: Sighting, target: str = "") -> None:
    """Add a sighting to those of a scan by address; above MAX_SIGHTINGS in place of one that matters less.

    What matters most is the device that `target`, an address or a name, names, then hubs.
    """

    def rank(candidate: Sighting) -> tuple[bool, bool]:
        return bool(target) and is_meant(candidate, target), candidate.is_hub

    if len(seen) >= MAX_SIGHTINGS and sighting.address not in seen:
        lowest = min(seen.values(), key=rank)
        if rank(sighting) <= rank(lowest):
            return
        del seen[lowest.address]
    seen[sighting.address] = sighting


def pick(sightings: Iterable[Sighting], target: str) -> Sighting:
    """Return the device that `target` names.

    Raises:
        SourceError: it is not among them, or several have its name.
    """
    candidates = list(sightings)
    matches = [sighting for sighting in candidates if is_meant(sighting, target)]
    if len(matches) > 1:
        raise SourceError(
            f"{len(matches)} hubs are named '{target}': {_listed(matches)}",
            f"Give the address of the one you want: ble://{matches[0].address}",
            cause="several",
        )
    if not matches:
        hubs = [sighting for sighting in candidates if sighting.is_hub]
        hint = f"Hubs in range: {_listed(hubs)}." if hubs else "No hub is in range."
        raise SourceError(
            f"no hub {'at' if is_address(target) else 'named'} {target} answers",
            f"{hint} Is it on, near, and not connected to another computer? `treadlink scan` lists what is in range.",
            cause="absent",
        )
    return matches[0]


def uart_characteristics(
    services: BleakGATTServiceCollection, who: str
) -> tuple[BleakGATTCharacteristic, BleakGATTCharacteristic | None]:
    """Return the characteristic that notifies and the one to write to, None when the hub takes no data.

    Both UUID and property must match: the firmware of some hubs has the two UUIDs swapped.

    Raises:
        SourceError: no characteristic notifies, so it is not a hub.
    """
    characteristics = [c for c in services.characteristics.values() if c.service_uuid == UART_SERVICE]
    by_uuid = {uuid: [c for c in characteristics if c.uuid == uuid] for uuid in (UART_FROM_HUB, UART_TO_HUB)}
    ordered = [*by_uuid[UART_FROM_HUB], *by_uuid[UART_TO_HUB]]
    notifying = [c for c in ordered if {"notify", "indicate"} & set(c.properties)]
    writable = [c for c in reversed(ordered) if {"write", "write-without-response"} & set(c.properties)]
    if not notifying:
        raise SourceError(
            f"{who} is not a treadlink hub: it has no UART service that notifies",
            "Choose another: `treadlink scan`.",
            cause="no hub",
        )
    return notifying[0], writable[0] if writable else None


def _listed(sightings: Iterable[Sighting]) -> str:
    strongest = sorted(sightings, key=lambda sighting: -(sighting.rssi_dbm or -128))
    omitted = f" and {len(strongest) - _MAX_LISTED} more" if len(strongest) > _MAX_LISTED else ""
    return ", ".join(map(str, strongest[:_MAX_LISTED])) + omitted
