"""Bluetooth in one thread for the whole process: its event loop, its scanner, its turn to connect.

One loop and not one a hub: on Linux every loop with bleak in it holds a D-Bus connection that is sent the notifications
of every hub, so that n loops would read everything n times; and an adapter sets up one connection at a time.
"""

from __future__ import annotations

import asyncio
import logging
import threading
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from functools import cache
from typing import Any, Final, TypeVar

from bleak import BleakAdapter, BleakScanner
from bleak.backends.device import BLEDevice
from bleak.backends.scanner import AdvertisementData

from gateway.io.ble_errors import BLE_ERRORS
from gateway.io.ble_hub import BATTERY_SERVICE, UART_SERVICE, Sighting

_T = TypeVar("_T")
_NO_RSSI_DBM: Final = -127
_ENTER_TIMEOUT_S: Final = 10.0
_LEAVE_TIMEOUT_S: Final = 5.0
Listener = Callable[[Sighting], None]


class Radio:
    """The thread with the event loop in which bleak lives; `radio()` gives the one of this process."""

    def __init__(self) -> None:
        # What bleak's libraries log must not end up on the console's screen.
        logging.getLogger("dbus_fast").addHandler(logging.NullHandler())
        self._loop = asyncio.new_event_loop()
        self._airs: dict[str, Air] = {}
        self.connecting = asyncio.Lock()
        """Held while a connection is set up."""
        threading.Thread(target=self._loop.run_forever, name="bluetooth", daemon=True).start()

    def run(self, work: Coroutine[Any, Any, _T], timeout_s: float | None = None) -> _T:
        """Run `work` in the loop and return what it returns; from any other thread.

        Raises:
            TimeoutError: it took too long; it is cancelled.
        """
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result(timeout_s)
        except TimeoutError:
            future.cancel()
            raise

    def air(self, adapter: str) -> Air:
        """Return what an adapter hears; an empty name is the system's first."""
        return self._airs.setdefault(adapter, Air(adapter))


@cache
def radio() -> Radio:
    """Return the process's radio, started at its first use."""
    return Radio()


class Air:
    """One scanner for all who listen: an adapter refuses a second."""

    def __init__(self, adapter: str) -> None:
        self._bluez: Any = {"adapter": adapter} if adapter else {}
        self._listeners: list[Listener] = []
        self._scanner: BleakScanner | None = None
        self._changing = asyncio.Lock()

    @asynccontextmanager
    async def listen(self, listener: Listener) -> AsyncIterator[None]:
        """Hand every advertisement to `listener`, hubs that hold a connection of this computer first.

        Raises:
            BleakError: the adapter cannot scan; BLE_ERRORS has all of it.
        """
        async with self._changing:
            async with asyncio.timeout(_ENTER_TIMEOUT_S):  # a D-Bus that dies leaves its callers waiting
                await self._start(listener)
            self._listeners.append(listener)
        try:
            yield
        finally:
            async with self._changing:
                self._listeners.remove(listener)
                if not self._listeners:
                    await self._stop()

    async def _start(self, listener: Listener) -> None:
        for device in await self._connected():
            listener(Sighting(device.address, device.name or "", None, None, is_hub=True, device=device))
        # Anew for everyone who joins: a scanner does not notice when Bluetooth was restarted or switched off meanwhile.
        await self._stop()
        scanner = BleakScanner(self._heard, bluez=self._bluez)
        await scanner.start()
        self._scanner = scanner

    async def _stop(self) -> None:
        scanner, self._scanner = self._scanner, None
        if scanner is not None:
            with suppress(*BLE_ERRORS, AssertionError):  # an adapter that is gone scans no more
                await asyncio.wait_for(scanner.stop(), _LEAVE_TIMEOUT_S)

    async def _connected(self) -> list[BLEDevice]:
        """Return hubs connected to this computer: after a program was killed they are, and do not advertise."""
        try:
            adapter = await BleakAdapter.get(bluez=self._bluez)
            return await adapter.get_connected_devices([UART_SERVICE])
        except NotImplementedError:
            return []

    def _heard(self, device: BLEDevice, advertisement: AdvertisementData) -> None:
        services = {uuid.lower() for uuid in advertisement.service_uuids}
        battery = advertisement.service_data.get(BATTERY_SERVICE, b"")
        sighting = Sighting(
            address=device.address,
            name=advertisement.local_name or device.name or "",
            rssi_dbm=advertisement.rssi if advertisement.rssi > _NO_RSSI_DBM else None,
            battery_percent=battery[0] if len(battery) == 1 and battery[0] <= 100 else None,
            is_hub=UART_SERVICE in services,
            device=device,
        )
        for listener in list(self._listeners):
            listener(sighting)
