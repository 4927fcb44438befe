"""One Bluetooth LE connection to a hub: found by a scan, subscribed to, read until it breaks."""

import asyncio
import logging
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Final

from bleak import BleakClient
from bleak.backends.characteristic import BleakGATTCharacteristic
from bleak.backends.device import BLEDevice

from gateway.core.errors import LinkLostError, SourceError
from gateway.core.links.ble_hub import Sighting, is_address, is_meant, keep, pick, uart_characteristics
from gateway.core.links.ble_radio import BLE_ERRORS, demands_pairing, explain, explain_pairing, radio
from gateway.core.links.reasons import LinkCode
from gateway.core.reasons import Reason

_logger = logging.getLogger(__name__)

FRAME_MTU: Final = 247
"""ATT MTU that a frame of 244 bytes needs."""

_SETTLE_SHARE: Final = 0.2  # of the scan time, for a second hub of the same name to appear
_CONNECT_TIMEOUT_S: Final = 10.0
_ATTEMPTS: Final = 3
_RETRY_PAUSE_S: Final = 0.25
_CLOSE_TIMEOUT_S: Final = 12.0
_WRITE_TIMEOUT_S: Final = 5.0
_MTU_POLLS: Final = 5
_MTU_POLL_S: Final = 0.1
_LEAST_WRITE_BYTES: Final = 20
_ATT_HEADER_BYTES: Final = 3
_PENDING_BYTES: Final = 16 << 20


@dataclass(slots=True)
class BleSettings:
    """Settings of a connection to a hub.

    Attributes:
        target: name or address.
        adapter: of this computer, such as `hci0`; empty for the system's first.
        scan_s: time to search for it.
        by_socket: receive notifications through a socket of their own (Linux) instead of D-Bus signals.
    """

    target: str
    adapter: str = ""
    scan_s: float = 10.0
    by_socket: bool = False


async def find(settings: BleSettings) -> Sighting:
    """Search for the hub; for a name somewhat longer, in case another hub has the same one.

    Raises:
        SourceError: not found, or several have the name.
        BleakError: Bluetooth fails; BLE_ERRORS lists all errors.
    """
    sightings: dict[str, Sighting] = {}
    target_sighted = asyncio.Event()

    def record(sighting: Sighting) -> None:
        keep(sightings, sighting, settings.target)
        if is_meant(sighting, settings.target):
            target_sighted.set()

    async with radio().scanner(settings.adapter).listen(record):
        with suppress(TimeoutError):
            await asyncio.wait_for(target_sighted.wait(), settings.scan_s)
            if not is_address(settings.target):
                await asyncio.sleep(settings.scan_s * _SETTLE_SHARE)
    return pick(sightings.values(), settings.target)


class BleLink:
    """A `Link` of `gateway.core.links.reconnect` that can also be written to.

    Attributes:
        sighting: the hub it is connected to, None before.
        mtu: ATT MTU of the connection, None when the system does not report it.
    """

    def __init__(self, settings: BleSettings) -> None:
        """Describe the connection."""
        self.sighting: Sighting | None = None
        self.mtu: int | None = None
        self._settings = settings
        self._client: BleakClient | None = None
        self._write_to: BleakGATTCharacteristic | None = None
        self._arrival = threading.Condition()
        self._arrived = bytearray()
        self._dropped = 0
        self._is_lost = False
        self._is_closing = False

    def open(self) -> None:
        """Find the hub, connect and subscribe.

        Raises:
            SourceError: no adapter, no such hub, or it refuses.
        """
        try:
            radio().run(self._open())
        except BLE_ERRORS as error:
            pairing = explain_pairing(error, self.sighting) if self.sighting is not None else None
            raise pairing or explain(error, f"connect to {self.sighting or self._settings.target}") from error

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived, or wait for the first notification; empty after `timeout_s`.

        Raises:
            LinkLostError: the connection broke.
        """
        with self._arrival:
            if not self._arrived and not self._is_lost:
                self._arrival.wait(timeout_s)
            data = bytes(self._arrived)
            self._arrived = bytearray()
            is_lost = self._is_lost
        if is_lost and not data:
            raise LinkLostError(
                f"{self._name()} was lost unexpectedly", "Out of range, or without power? Searching for it."
            )
        return data

    def write(self, data: bytes) -> None:
        """Write one frame to the hub.

        Raises:
            SourceError: the hub has no characteristic to write to.
            LinkLostError: the write failed.
        """
        client, target = self._client, self._write_to
        if client is None or self._is_lost:
            raise LinkLostError(f"{self._name()} is not connected")
        if target is None:
            raise SourceError(f"{self._name()} takes no commands", "Its firmware has no characteristic to write to.")
        confirmed = "write" in target.properties
        try:
            radio().run(client.write_gatt_char(target, data, response=confirmed), _WRITE_TIMEOUT_S)
        except BLE_ERRORS as error:
            reason = explain(error, f"write to {self._name()}")
            raise LinkLostError(str(reason), reason.remedy) from error

    def close(self) -> None:
        """Disconnect; may be called at any time and twice, never raises."""
        self._is_closing = True
        client, self._client = self._client, None
        if client is not None:
            with suppress(*BLE_ERRORS):
                radio().run(_leave(client))

    def take_dropped(self) -> int:
        """Return how many notifications were dropped since the last call."""
        with self._arrival:
            dropped, self._dropped = self._dropped, 0
        return dropped

    def details(self) -> tuple[Reason, ...]:
        """Return what is connected: device, MTU and, where known, battery."""
        if self.mtu is None:
            mtu = Reason(LinkCode.MTU_UNKNOWN, needed=FRAME_MTU)
        elif self.mtu < FRAME_MTU:
            mtu = Reason(LinkCode.MTU_TOO_SMALL, mtu=self.mtu, needed=FRAME_MTU)
        else:
            mtu = Reason(LinkCode.MTU, mtu=self.mtu)
        device = Reason(LinkCode.BLE_DEVICE, device=str(self.sighting))
        battery = self.sighting.battery_percent if self.sighting is not None else None
        return (
            (device, mtu) if battery is None else (device, mtu, Reason(LinkCode.BATTERY_LEVEL, level=battery / 100.0))
        )

    def _name(self) -> str:
        return f"{self.sighting.name} ({self.sighting.address})" if self.sighting else self._settings.target

    async def _open(self) -> None:
        attempt = 0
        while True:
            attempt += 1
            self.sighting = await find(self._settings)
            try:
                async with radio().connecting:
                    await self._connect(self.sighting.device)
            except BLE_ERRORS as error:
                _logger.debug("attempt %d to connect to %s: %r", attempt, self.sighting, error)
                if attempt == _ATTEMPTS or demands_pairing(error):  # each attempt asks the user again
                    raise
                # A second attempt after a new scan mostly works: the system may have dropped the device that the first
                # scan found.
                await asyncio.sleep(_RETRY_PAUSE_S * attempt)
            else:
                return

    async def _connect(self, device: BLEDevice) -> None:
        self._is_lost = False
        client = BleakClient(device, disconnected_callback=self._on_disconnected, timeout=_CONNECT_TIMEOUT_S)
        try:
            await client.connect()
            notifying, self._write_to = uart_characteristics(client.services, str(self.sighting))
            async with asyncio.timeout(_CONNECT_TIMEOUT_S):
                await client.start_notify(
                    notifying, self._on_notification, bluez={"use_start_notify": not self._settings.by_socket}
                )
                self.mtu = await _mtu(notifying)
        except BaseException:
            await _leave(client)
            raise
        self._client = client

    def _on_notification(self, _: BleakGATTCharacteristic, data: bytearray) -> None:
        if not data:
            return
        with self._arrival:
            if len(self._arrived) + len(data) > _PENDING_BYTES:
                self._dropped += 1
                return
            self._arrived += data
            self._arrival.notify()

    def _on_disconnected(self, _: BleakClient) -> None:
        if self._is_closing:
            return
        with self._arrival:
            self._is_lost = True
            self._arrival.notify()


async def _leave(client: BleakClient) -> None:
    """Disconnect, also after the hub has left: otherwise bleak keeps a D-Bus connection open for good."""
    with suppress(*BLE_ERRORS, AssertionError):
        async with asyncio.timeout(_CLOSE_TIMEOUT_S):
            await client.disconnect()


async def _mtu(characteristic: BleakGATTCharacteristic) -> int | None:
    """Return the ATT MTU once it is known: Windows may report it a moment after connecting, an old BlueZ never."""
    for poll in range(_MTU_POLLS + 1):
        payload_bytes: Any = characteristic.max_write_without_response_size
        if payload_bytes > _LEAST_WRITE_BYTES:
            return int(payload_bytes) + _ATT_HEADER_BYTES
        if poll < _MTU_POLLS:
            await asyncio.sleep(_MTU_POLL_S)
    return None
