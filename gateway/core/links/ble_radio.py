"""This computer's Bluetooth: one thread with its event loop, one scanner per adapter, and its errors.

There is one loop for all hubs: on Linux every loop with bleak holds a D-Bus connection that receives the notifications
of every hub, so that n loops would read everything n times. An adapter also sets up one connection at a time.
"""

from __future__ import annotations

import asyncio
import logging
import sys
import threading
from collections.abc import AsyncIterator, Callable, Coroutine
from contextlib import asynccontextmanager, suppress
from functools import cache
from typing import Any, Final, TypeVar

from bleak import BleakAdapter, BleakScanner
from bleak.backends.device import BLEDevice
from bleak.backends.scanner import AdvertisementData
from bleak.exc import (
    BleakBluetoothNotAvailableError,
    BleakBluetoothNotAvailableReason,
    BleakDBusError,
    BleakError,
    BleakGATTProtocolError,
)

from gateway.core.errors import SourceError
from gateway.core.links.ble_hub import BATTERY_SERVICE, UART_SERVICE, Sighting

_logger = logging.getLogger(__name__)

_T = TypeVar("_T")
# Those of the controller: HCI states -127 to 20 dBm, and 127 for none; BlueZ has -127 for none.
_NO_RSSI_DBM: Final = -127
_MOST_RSSI_DBM: Final = 20
_START_TIMEOUT_S: Final = 10.0
_STOP_TIMEOUT_S: Final = 5.0
Listener = Callable[[Sighting], None]


def _library_errors() -> tuple[type[Exception], ...]:
    if sys.platform != "linux":
        return ()
    from dbus_fast.errors import DBusFastError

    return (DBusFastError,)


BLE_ERRORS: Final[tuple[type[Exception], ...]] = (BleakError, TimeoutError, EOFError, OSError, *_library_errors())
"""Errors of bleak and of the layers below it; an overloaded D-Bus gives an EOFError."""

_LINUX: Final = sys.platform == "linux"
_SERVICE: Final = "sudo apt-get install bluez; sudo systemctl start bluetooth"
_OFF: Final = SourceError(
    "Bluetooth is switched off",
    "Switch it on: bluetoothctl power on (and rfkill unblock bluetooth)." if _LINUX else "Switch it on.",
    cause="off",
)
_DENIED: Final = SourceError(
    "no permission to use Bluetooth",
    "Join its group, then log in again: sudo usermod -aG bluetooth $USER"
    if _LINUX
    else "Allow it for your terminal in the system's privacy settings.",
    cause="denied",
)
_UNAVAILABLE: Final = {
    BleakBluetoothNotAvailableReason.NO_BLUETOOTH: SourceError(
        "this computer has no Bluetooth adapter",
        "Plug one in (Bluetooth LE, 4.2 or newer), or connect the hub by its serial port."
        + (f" If there is one, its service is not running: {_SERVICE}" if _LINUX else ""),
        cause="no adapter",
    ),
    BleakBluetoothNotAvailableReason.NO_BLE_CENTRAL_ROLE: SourceError(
        "the Bluetooth adapter does not support Bluetooth LE",
        "Plug in one that does (4.2 or newer).",
        cause="no low energy",
    ),
    BleakBluetoothNotAvailableReason.POWERED_OFF: _OFF,
    BleakBluetoothNotAvailableReason.DENIED_BY_USER: _DENIED,
    BleakBluetoothNotAvailableReason.DENIED_BY_SYSTEM: _DENIED,
    BleakBluetoothNotAvailableReason.DENIED_BY_UNKNOWN: _DENIED,
}
_DBUS: Final = {
    "org.freedesktop.DBus.Error.ServiceUnknown": SourceError(
        "Bluetooth's service is not running", f"Run: {_SERVICE}", cause="no service"
    ),
    "org.freedesktop.DBus.Error.NoReply": SourceError("Bluetooth's service does not answer", f"Run: {_SERVICE}"),
    "org.freedesktop.DBus.Error.AccessDenied": _DENIED,
    "org.bluez.Error.NotReady": _OFF,
    "org.bluez.Error.NotAuthorized": _DENIED,
    "org.bluez.Error.InProgress": SourceError(
        "the Bluetooth adapter is busy with another connection", "Wait a moment, or close the other program."
    ),
}

# BlueZ's errors where either side refuses a pairing.
_NOT_PAIRED: Final = frozenset(
    f"org.bluez.Error.{name}"
    for name in ("AuthenticationCanceled", "AuthenticationFailed", "AuthenticationRejected", "AuthenticationTimeout")
)
# Insufficient authentication, encryption key size and encryption; BlueZ makes them "Not paired".
_NOT_PAIRED_ATT: Final = frozenset({5, 12, 15})
_PAIR: Final = "bluetoothctl pair {0}; bluetoothctl trust {0}" if _LINUX else "pair it in the system's settings"
_PAIR_AGAIN: Final = f"bluetoothctl remove {{0}}; {_PAIR}" if _LINUX else f"remove it and {_PAIR}"


class Radio:
    """A thread with the event loop that bleak runs in; `radio()` returns the one of this process.

    Attributes:
        connecting: held while a connection is set up.
    """

    def __init__(self) -> None:
        # Messages of bleak's libraries must not reach the screen of the console.
        logging.getLogger("dbus_fast").addHandler(logging.NullHandler())
        self._loop = asyncio.new_event_loop()
        self._scanners: dict[str, SharedScanner] = {}
        self.connecting = asyncio.Lock()
        threading.Thread(target=self._loop.run_forever, name="bluetooth", daemon=True).start()

    def run(self, work: Coroutine[Any, Any, _T], timeout_s: float | None = None) -> _T:
        """Run `work` in the loop and return its result; callable from any other thread.

        Raises:
            TimeoutError: it took too long; it is cancelled.
        """
        future = asyncio.run_coroutine_threadsafe(work, self._loop)
        try:
            return future.result(timeout_s)
        except TimeoutError:
            future.cancel()
            raise

    def scanner(self, adapter: str) -> SharedScanner:
        """Return the scanner of an adapter; an empty name means the system's first."""
        return self._scanners.setdefault(adapter, SharedScanner(adapter))


_made_radio: Final = cache(Radio)
_making_radio: Final = threading.Lock()


def radio() -> Radio:
    """Return the process's radio, started at its first use; links are opened by several threads at once."""
    with _making_radio:
        return _made_radio()


class SharedScanner:
    """The scanner of one adapter, shared by all listeners: an adapter refuses a second one."""

    def __init__(self, adapter: str) -> None:
        self._bluez: Any = {"adapter": adapter} if adapter else {}
        self._listeners: list[Listener] = []
        self._scanner: BleakScanner | None = None
        self._scanner_lock = asyncio.Lock()

    @asynccontextmanager
    async def listen(self, listener: Listener) -> AsyncIterator[None]:
        """Pass every advertisement to `listener`, hubs already connected to this computer first.

        Raises:
            BleakError: the adapter cannot scan; BLE_ERRORS has all of it.
        """
        async with self._scanner_lock:
            async with asyncio.timeout(_START_TIMEOUT_S):  # a D-Bus that ends leaves its callers waiting
                await self._start(listener)
            self._listeners.append(listener)
        try:
            yield
        finally:
            async with self._scanner_lock:
                self._listeners.remove(listener)
                if not self._listeners:
                    await self._stop()

    async def _start(self, listener: Listener) -> None:
        for device in await self._connected():
            listener(Sighting(device.address, device.name or "", None, None, is_hub=True, device=device))
        # Restarted for every new listener: a scanner does not notice that Bluetooth was restarted or switched off.
        await self._stop()
        _logger.debug("scanning with %s", self._bluez or "the system's first adapter")
        scanner = BleakScanner(self._on_advertisement, bluez=self._bluez)
        await scanner.start()
        self._scanner = scanner

    async def _stop(self) -> None:
        scanner, self._scanner = self._scanner, None
        if scanner is not None:
            with suppress(*BLE_ERRORS, AssertionError):  # an adapter that is gone does not scan anymore
                await asyncio.wait_for(scanner.stop(), _STOP_TIMEOUT_S)

    async def _connected(self) -> list[BLEDevice]:
        """Return hubs connected to this computer: after a program was killed they stay so, and do not advertise."""
        try:
            adapter = await BleakAdapter.get(bluez=self._bluez)
            return await adapter.get_connected_devices([UART_SERVICE])
        except NotImplementedError:
            return []

    def _on_advertisement(self, device: BLEDevice, advertisement: AdvertisementData) -> None:
        services = {uuid.lower() for uuid in advertisement.service_uuids}
        battery = advertisement.service_data.get(BATTERY_SERVICE, b"")
        sighting = Sighting(
            address=device.address,
            name=advertisement.local_name or device.name or "",
            rssi_dbm=advertisement.rssi if _NO_RSSI_DBM < advertisement.rssi <= _MOST_RSSI_DBM else None,
            battery_percent=battery[0] if len(battery) == 1 and battery[0] <= 100 else None,
            is_hub=UART_SERVICE in services,
            device=device,
        )
        for listener in list(self._listeners):
            listener(sighting)


def demands_pairing(error: Exception) -> bool:
    """Return whether the hub refuses because it is not paired with this computer."""
    if isinstance(error, BleakGATTProtocolError):
        return error.code in _NOT_PAIRED_ATT
    return isinstance(error, BleakDBusError) and (error.dbus_error in _NOT_PAIRED or "Not paired" in _brief(error))


def explain_pairing(error: Exception, sighting: Sighting) -> SourceError | None:
    """Return the error for the user for a hub that demands pairing, or has forgotten it; None for other errors.

    Where the hub has forgotten, the key of this computer does not fit: the link ends before the services are known.
    """
    is_refused = demands_pairing(error)
    if sighting.is_paired and (is_refused or type(error) is BleakError or "key-missing" in str(error)):
        return SourceError(
            f"{sighting} ends the connection, although this computer is paired with it",
            f"If the hub was reset, pair it again: {_PAIR_AGAIN.format(sighting.address)}",
            cause="pairing lost",
        )
    if is_refused:
        return SourceError(
            f"{sighting} demands pairing", f"Pair it once: {_PAIR.format(sighting.address)}", cause="not paired"
        )
    return None


def explain(error: Exception, doing: str) -> SourceError:
    """Return the error for the user for one of BLE_ERRORS; `doing` is what failed, such as `connect to X`."""
    explained: SourceError | None = None
    if isinstance(error, BleakBluetoothNotAvailableError):
        explained = _UNAVAILABLE.get(error.reason)
    elif isinstance(error, BleakDBusError):
        explained = _DBUS.get(error.dbus_error)
        if explained is None and error.dbus_error.startswith("org.freedesktop.DBus.Error.Spawn."):
            explained = _DBUS["org.freedesktop.DBus.Error.ServiceUnknown"]
    elif isinstance(error, PermissionError):
        explained = _DENIED
    elif isinstance(error, FileNotFoundError | ConnectionRefusedError):
        explained = SourceError(
            "there is no D-Bus here, through which Bluetooth is reached",
            f"Run: {_SERVICE} (in a container, share the host's /run/dbus with it).",
        )
    elif isinstance(error, BleakError) and "adapter '" in str(error):
        explained = SourceError(f"Bluetooth {error}", "`bluetoothctl list` names the adapters; leave ?adapter= out.")
    elif isinstance(error, TimeoutError):
        explained = SourceError(f"cannot {doing}: no answer in time", "Bring it nearer, or switch it off and on.")
    cause = error.dbus_error if isinstance(error, BleakDBusError) else type(error).__name__
    if explained is not None:
        # One error for all that have the same remedy.
        return SourceError(str(explained), explained.remedy, cause=explained.cause or cause)
    return SourceError(
        f"cannot {doing}: {_brief(error)}",
        "Bring it nearer, or switch it off and on; `treadlink scan` lists what is in range.",
        cause=cause,
    )


def _brief(error: Exception) -> str:
    if isinstance(error, BleakDBusError):
        return error.dbus_error_details or error.dbus_error
    return str(error) or type(error).__name__
