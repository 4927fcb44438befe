"""Serial ports, read with pyserial: `serial:///dev/ttyUSB0?baudrate=921600`, `serial:COM3`."""

import contextlib
import errno
import os
import re
import select
import sys
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, Final

import serial

from gateway.core.clock import Clock
from gateway.core.errors import LinkLostError, SourceError
from gateway.core.links.reasons import LinkCode
from gateway.core.links.reconnect import ReconnectingSource
from gateway.core.links.source import (
    DEFAULT_BAUDRATE,
    LinkEvent,
    LinkEventKind,
    Source,
    SourceAddress,
    rate_option,
    silence_option,
)
from gateway.core.nearest_name import did_you_mean
from gateway.core.reasons import Reason

if sys.platform == "win32":
    _TERMIOS_ERROR: type[Exception] = OSError
else:
    import termios

    _TERMIOS_ERROR: type[Exception] = termios.error

LINK_ERRORS: Final = (serial.SerialException, OSError, _TERMIOS_ERROR, TypeError, ValueError)
"""Exceptions that pyserial raises when a device disappears: its own error, a bare OSError, a termios error that is no
OSError, and TypeError or ValueError when the descriptor was closed during a read."""

_READ_BYTES: Final = 65536
_WRITE_TIMEOUT_S: Final = 1.0
_MAX_BAUDRATE: Final = 20_000_000
_YES_NO: Final = {"yes": True, "no": False}
_PROCESSES: Final = Path("/proc")


def port_holders(port: str) -> tuple[str, ...]:
    """Return the other programs that have a port open, as `minicom (process 1234)`; none where they cannot be seen.

    Linux shows the open files of the user's own processes only; other systems show none.
    """
    try:
        device = Path(port).stat().st_rdev
    except OSError:
        return ()
    return tuple(_holders(device)) if device and _PROCESSES.is_dir() else ()


def _holders(device: int) -> Iterator[str]:
    for process in sorted(_PROCESSES.glob("[0-9]*"), key=lambda path: int(path.name)):
        if process.name == str(os.getpid()):
            continue
        try:
            if any(_refers_to(path, device) for path in (process / "fd").iterdir()):
                yield f"{(process / 'comm').read_text(errors='replace').strip()} (process {process.name})"
        except OSError:  # it has ended, or belongs to another user
            continue


def _refers_to(path: Path, device: int) -> bool:
    try:
        return path.stat().st_rdev == device
    except OSError:
        return False


class PyserialLink:
    """A link over a port of pyserial.

    Where there is a descriptor it waits with `select` and reads what is there: pyserial's own timeout holds back short
    chunks until it expires, and loses what it has collected when the device disappears meanwhile.
    """

    def __init__(
        self,
        connect: Callable[[], serial.SerialBase],
        explain_open: Callable[[Exception], SourceError],
        lost: Callable[[Exception], LinkLostError],
    ) -> None:
        """Describe the connection.

        Args:
            connect: opens and returns pyserial's port.
            explain_open: turns an error of `connect` into the error for the user.
            lost: turns an error of a broken connection into the error for the user.
        """
        self._connect = connect
        self._explain_open = explain_open
        self._lost = lost
        self._port: serial.SerialBase | None = None

    def open(self) -> None:
        """Connect.

        Raises:
            SourceError: it cannot be opened now.
        """
        try:
            self._port = self._connect()
            self._port.timeout = 0 if self._selectable(self._port) else 0.02
            self._port.write_timeout = _WRITE_TIMEOUT_S
        except LINK_ERRORS as error:
            self.close()
            raise self._explain_open(error) from error

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived, or wait for the first; empty after `timeout_s`.

        Raises:
            LinkLostError: the connection broke.
        """
        port = self._port
        if port is None:
            raise self._lost(OSError("not open"))
        try:
            if port.timeout != 0:
                return bytes(port.read(_READ_BYTES))
            descriptor = port.fileno()
            if not select.select([descriptor], [], [], timeout_s)[0]:
                return b""
            data = os.read(descriptor, _READ_BYTES)
        except BlockingIOError:
            return b""
        except LINK_ERRORS as error:
            raise self._lost(error) from error
        if not data:
            # What a device that has been unplugged does.
            raise self._lost(OSError("ready to read, but without data"))
        return data

    def write(self, data: bytes) -> None:
        """Write a frame to the hub.

        Raises:
            LinkLostError: the connection broke.
        """
        port = self._port
        if port is None:
            raise self._lost(OSError("not open"))
        try:
            port.write(data)
        except LINK_ERRORS as error:
            raise self._lost(error) from error

    def close(self) -> None:
        """Disconnect."""
        port, self._port = self._port, None
        if port is not None:
            with contextlib.suppress(*LINK_ERRORS):
                port.close()

    @staticmethod
    def _selectable(port: serial.SerialBase) -> bool:
        if os.name != "posix":  # pragma: no cover - Windows selects on sockets only
            return False
        try:
            return int(port.fileno()) >= 0
        except (OSError, ValueError, AttributeError):
            return False


def open_serial(address: SourceAddress, clock: Clock) -> Source:
    """Make a source of a serial port; it is opened when its items are requested.

    Options: baudrate (default 921600), exclusive=yes|no, parity=none|even|odd, stopbits=1|2, rtscts=yes|no, rate=9600
    (Hz, set on the hub), silence=0 (seconds without a byte until the link counts as lost, 0 for never).

    Raises:
        SourceError: an option is not known or not allowed.
    """
    rate_hz = rate_option(address.options)
    # Opening a port again resets some hubs, and a cable is not half open as a connection of a network may be.
    silence_s = silence_option(address.options, 0.0)
    settings = serial_settings(
        {name: text for name, text in address.options.items() if name not in ("rate", "silence")}
    )
    return SerialSource(address.target, settings, clock, rate_hz=rate_hz, silence_s=silence_s)


class SerialSource(ReconnectingSource):
    """A serial port, which names the programs that read it too."""

    def __init__(
        self, port: str, settings: Mapping[str, Any], clock: Clock, *, rate_hz: float | None, silence_s: float
    ) -> None:
        """Name the port; nothing is opened yet. Settings are those of `serial_settings`."""
        name = f"serial:{port}"
        super().__init__(name, lambda: serial_port(port, settings), clock, rate_hz=rate_hz, silence_s=silence_s)
        self._port = port

    def _event(self, kind: LinkEventKind, text: str = "", details: tuple[Reason, ...] = ()) -> LinkEvent:
        # A lock on the port does not keep out who had it open before.
        if kind.is_open and (holders := port_holders(self._port)):
            details = (*details, Reason(LinkCode.PORT_SHARED, holders=" and ".join(holders)))
        return super()._event(kind, text, details)


def serial_port(port: str, settings: Mapping[str, Any], device: str = "hub") -> PyserialLink:
    """Return a link over a serial port with settings of `serial_settings`, and what is there; nothing is opened yet."""
    return PyserialLink(
        lambda: serial.Serial(port, **settings),
        lambda error: explain_open_error(port, error, present_ports(), device),
        lambda error: LinkLostError(f"{port} disappeared ({_brief(error)})", "Unplugged? Plug it in again."),
    )


def serial_settings(options: Mapping[str, str]) -> dict[str, Any]:
    """Convert URI options to the settings of pyserial.

    Raises:
        SourceError: an option is not known or not allowed.
    """
    readers: dict[str, Callable[[str], Any]] = {
        "baudrate": _baudrate,
        "exclusive": lambda text: _choice("exclusive", text, _YES_NO),
        "parity": lambda text: _choice("parity", text, {"none": "N", "even": "E", "odd": "O"}),
        "stopbits": lambda text: _choice("stopbits", text, {"1": 1, "2": 2}),
        "rtscts": lambda text: _choice("rtscts", text, _YES_NO),
    }
    settings: dict[str, Any] = {"baudrate": DEFAULT_BAUDRATE, "exclusive": True}
    for name, text in options.items():
        if name not in readers:
            options_known = (*readers, "rate", "silence")
            hint = did_you_mean(name, options_known)
            raise SourceError(f"serial has no option '{name}'", f"{hint}Options are {', '.join(options_known)}.")
        settings[name] = readers[name](text)
    return settings


def present_ports() -> list[str]:
    """Return the serial ports of this machine, each with its description."""
    from serial.tools import list_ports

    ports = []
    for port in sorted(list_ports.comports()):
        description = port.description if port.description not in (None, "", "n/a") else ""
        ports.append(f"{port.device} ({description})" if description else port.device)
    return ports


def _absent_remedy(port: str, present: list[str], device: str) -> str:
    if present:
        remedy = f"Ports present: {', '.join(present)}. Is the {device} plugged in?"
    else:
        remedy = f"No serial port is present; plug in the {device}, or try `treadlink live sim:demo`."
    if os.name == "posix" and re.fullmatch(r"COM\d+", port, re.IGNORECASE):
        remedy = f"{port} is a name of Windows; here ports are named /dev/... {remedy}"
    elif os.name == "nt" and port.startswith("/dev/"):
        remedy = f"{port} is a name of Linux or macOS; here ports are named COM3. {remedy}"
    elif os.name == "posix" and "/" not in port:
        remedy = f"A port is given with its folder: /dev/{port}. {remedy}"
    return remedy


def explain_open_error(port: str, error: Exception, present: list[str], device: str = "hub") -> SourceError:
    """Return the error for the user: why a port does not open, and the remedy."""
    number = getattr(error, "errno", None)
    is_absent = os.name == "posix" and "://" not in port and not Path(port).exists()
    if number == errno.ENOENT or isinstance(error, FileNotFoundError) or is_absent:
        return SourceError(f"there is no port {port}", _absent_remedy(port, present, device), cause=errno.ENOENT)
    if number in (errno.EACCES, errno.EPERM):
        group = _group_of(port)
        return SourceError(
            f"no permission to open {port}",
            f"Join its group, then log in again: sudo usermod -aG {group} $USER",
            cause=errno.EACCES,
        )
    if number in (errno.EAGAIN, errno.EWOULDBLOCK, errno.EBUSY):
        holders = port_holders(port)
        return SourceError(
            f"{port} is in use by {' and '.join(holders) or 'another program'}",
            # Not ?exclusive=no: two readers take bytes from each other, which ruins a recording of the other program.
            "Wait for its end, or quit it."
            if holders
            else f"Wait for its end, or quit it (`sudo fuser {port}` names it).",
            cause=errno.EBUSY,
        )
    if number in (errno.ENOTTY, errno.EINVAL, errno.EISDIR) or (os.name == "posix" and not Path(port).is_char_device()):
        return SourceError(
            f"{port} is not a serial port, or refuses these settings",
            "Check the port and its options.",
            cause=errno.ENOTTY,
        )
    return SourceError(
        f"cannot open {port}: {_brief(error)}",
        "Check cable and driver; `treadlink doctor` helps.",
        cause=number or type(error).__name__,
    )


def _baudrate(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= _MAX_BAUDRATE:
        raise SourceError(f"baudrate={text} is not allowed", f"Give a whole number from 1 to {_MAX_BAUDRATE}.")
    return int(text)


def _choice(name: str, text: str, choices: Mapping[str, Any]) -> Any:
    if text.lower() not in choices:
        raise SourceError(f"{name}={text} is not allowed", f"Give {name}={'|'.join(choices)}.")
    return choices[text.lower()]


def _group_of(port: str) -> str:
    with contextlib.suppress(OSError, KeyError, NotImplementedError):
        group = Path(port).group()
        if group != "root":
            return group
    return "dialout"


def _brief(error: Exception) -> str:
    strerror = getattr(error, "strerror", None)
    return str(strerror or error or type(error).__name__)
