"""A link over anything pyserial opens: big reads that return at once when something is there."""

from __future__ import annotations

import contextlib
import os
import select
import sys
from collections.abc import Callable
from typing import Final

import serial

from gateway.errors import LinkLostError, SourceError

if sys.platform == "win32":
    _TERMIOS_ERROR: type[Exception] = OSError
else:
    import termios

    _TERMIOS_ERROR: type[Exception] = termios.error

_READ_BYTES: Final = 65536
LINK_ERRORS: Final = (serial.SerialException, OSError, _TERMIOS_ERROR, TypeError, ValueError)
"""What pyserial raises when a device goes away: its own error, a bare OSError, a termios error that is no OSError,
and TypeError or ValueError when the descriptor was closed under a read."""


class PyserialLink:
    """Reads with pyserial.

    Waiting is done by `select`, because pyserial's own timeout would hold back short chunks until it expires and
    loses what it has collected when the device goes away meanwhile.
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
            explain_open: makes the user's error of an error of `connect`.
            lost: makes the user's error of a broken connection.
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
        except LINK_ERRORS as error:
            self.close()
            raise self._explain_open(error) from error

    def read(self, timeout_s: float) -> bytes:
        """Return what has arrived, or wait for the first bytes; empty after `timeout_s`.

        Raises:
            LinkLostError: the connection broke.
        """
        port = self._port
        if port is None:
            raise self._lost(OSError("not open"))
        try:
            if port.timeout == 0 and not select.select([port.fileno()], [], [], timeout_s)[0]:
                return b""
            return bytes(port.read(_READ_BYTES))
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
