"""What goes wrong with Bluetooth, in plain words and with what to do about it."""

from __future__ import annotations

import sys
from typing import Final

from bleak.exc import (
    BleakBluetoothNotAvailableError,
    BleakBluetoothNotAvailableReason,
    BleakDBusError,
    BleakError,
)

from gateway.errors import SourceError


def _library_errors() -> tuple[type[Exception], ...]:
    if sys.platform != "linux":
        return ()
    from dbus_fast.errors import DBusFastError

    return (DBusFastError,)


BLE_ERRORS: Final[tuple[type[Exception], ...]] = (BleakError, TimeoutError, EOFError, OSError, *_library_errors())
"""What bleak and what lies below it raise when Bluetooth fails; a full D-Bus gives an EOFError."""

_LINUX: Final = sys.platform == "linux"
_SERVICE: Final = "sudo apt-get install bluez; sudo systemctl start bluetooth"
_OFF: Final = SourceError(
    "Bluetooth is switched off",
    "Switch it on: bluetoothctl power on (and rfkill unblock bluetooth)." if _LINUX else "Switch it on.",
)
_DENIED: Final = SourceError(
    "no permission to use Bluetooth",
    "Join its group, then log in again: sudo usermod -aG bluetooth $USER"
    if _LINUX
    else "Allow it for your terminal in the system's privacy settings.",
)
_UNAVAILABLE: Final = {
    BleakBluetoothNotAvailableReason.NO_BLUETOOTH: SourceError(
        "this computer has no Bluetooth adapter",
        "Plug one in (Bluetooth LE, 4.2 or newer), or connect the hub by its serial port."
        + (f" If there is one, its service is not running: {_SERVICE}" if _LINUX else ""),
    ),
    BleakBluetoothNotAvailableReason.NO_BLE_CENTRAL_ROLE: SourceError(
        "the Bluetooth adapter does not speak Bluetooth LE", "Plug in one that does (4.2 or newer)."
    ),
    BleakBluetoothNotAvailableReason.POWERED_OFF: _OFF,
    BleakBluetoothNotAvailableReason.DENIED_BY_USER: _DENIED,
    BleakBluetoothNotAvailableReason.DENIED_BY_SYSTEM: _DENIED,
    BleakBluetoothNotAvailableReason.DENIED_BY_UNKNOWN: _DENIED,
}
_DBUS: Final = {
    "org.freedesktop.DBus.Error.ServiceUnknown": SourceError("Bluetooth's service is not running", f"Run: {_SERVICE}"),
    "org.freedesktop.DBus.Error.NoReply": SourceError("Bluetooth's service does not answer", f"Run: {_SERVICE}"),
    "org.freedesktop.DBus.Error.AccessDenied": _DENIED,
    "org.bluez.Error.NotReady": _OFF,
    "org.bluez.Error.NotAuthorized": _DENIED,
    "org.bluez.Error.InProgress": SourceError(
        "the Bluetooth adapter is busy with another connection", "Wait a moment, or close the other program."
    ),
}


def explain(error: Exception, doing: str) -> SourceError:
    """Return the user's error for one of BLE_ERRORS; `doing` is what failed, as `connect to X`."""
    known: SourceError | None = None
    if isinstance(error, BleakBluetoothNotAvailableError):
        known = _UNAVAILABLE.get(error.reason)
    elif isinstance(error, BleakDBusError):
        known = _DBUS.get(error.dbus_error)
        if known is None and error.dbus_error.startswith("org.freedesktop.DBus.Error.Spawn."):
            known = _DBUS["org.freedesktop.DBus.Error.ServiceUnknown"]
    elif isinstance(error, PermissionError):
        known = _DENIED
    elif isinstance(error, FileNotFoundError | ConnectionRefusedError):
        known = SourceError(
            "there is no D-Bus here, by which Bluetooth is reached",
            f"Run: {_SERVICE} (in a container, share the host's /run/dbus with it).",
        )
    elif isinstance(error, BleakError) and "adapter '" in str(error):
        known = SourceError(f"Bluetooth {error}", "`bluetoothctl list` names the adapters; leave ?adapter= out.")
    elif isinstance(error, TimeoutError):
        known = SourceError(f"cannot {doing}: no answer in time", "Bring it nearer, or switch it off and on.")
    if known is not None:
        return SourceError(str(known), known.remedy)
    return SourceError(
        f"cannot {doing}: {_brief(error)}", "Bring it nearer, or switch it off and on; `treadlink scan` looks around."
    )


def _brief(error: Exception) -> str:
    if isinstance(error, BleakDBusError):
        return error.dbus_error_details or error.dbus_error
    return str(error) or type(error).__name__
