"""Receivers of tire pressure sensors: what rtl_433 prints as JSON, from a pipe, a growing file, a server or a log."""

import contextlib
import os
import stat
import threading
from collections.abc import Iterator
from datetime import UTC, datetime, tzinfo
from pathlib import Path
from typing import IO, Final
from zoneinfo import ZoneInfo, ZoneInfoNotFoundError

from gateway.core.clock import Clock
from gateway.core.errors import LinkLostError, SourceError
from gateway.core.links.reconnect import ReconnectingSource
from gateway.core.links.source import SensorLines, Source, SourceAddress
from gateway.core.links.tcp_link import TcpLink, parse_host_port
from gateway.core.nearest_name import missing_path_remedy
from gateway.core.reasons import Reason
from gateway.vehicle.log_file import LineLog
from gateway.vehicle.log_sources import RTL433_FILE_SUFFIXES
from gateway.vehicle.nmea_source import HOST, LONGEST_LINE, ReceiverSource
from gateway.vehicle.reasons import VehicleCode
from gateway.vehicle.tire_sensors import message_of

_READ_BYTES: Final = 65536


def open_rtl433(address: SourceAddress, clock: Clock) -> Source:
    """Open `rtl433:PIPE`, `rtl433:HOST:PORT`, or `rtl433:FILE?speed=1|10|max&offset_s=0&time_zone=UTC`.

    Raises:
        SourceError: address, file or option cannot be used.
    """
    path = Path(address.target)
    if address.target.lower().endswith(RTL433_FILE_SUFFIXES) and not path.is_fifo():
        return TireSensorFileSource(address, clock)
    name = f"rtl433:{address.target}"
    if HOST.fullmatch(address.target):
        host_port = parse_host_port(address)
        return TireSensorSource(ReconnectingSource(name, lambda: TcpLink(host_port, device="receiver"), clock))
    address.check_options(())
    return TireSensorSource(ReconnectingSource(name, lambda: PipeLink(path), clock))


class PipeLink:
    """A named pipe, or the lines that are appended to a file."""

    def __init__(self, path: Path) -> None:
        """Describe the link."""
        self._path = path
        self._closed = threading.Event()
        self._descriptor: int | None = None

    def open(self) -> None:
        """Open it; of a file, only what comes from now on counts.

        Raises:
            SourceError: it cannot be opened now.
        """
        try:
            # A pipe must not wait for its writer.
            self._descriptor = os.open(self._path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
            if stat.S_ISREG(os.fstat(self._descriptor).st_mode):
                os.lseek(self._descriptor, 0, os.SEEK_END)
        except OSError as error:
            remedy = missing_path_remedy(self._path) if isinstance(error, FileNotFoundError) else "Check the path."
            raise SourceError(
                f"cannot open '{self._path}': {error.strerror}", remedy, cause=error.errno or 0
            ) from error

    def read(self, timeout_s: float) -> bytes:
        """Return the bytes that have arrived; empty after `timeout_s`.

        Raises:
            LinkLostError: it cannot be read any more.
        """
        descriptor = self._descriptor
        if descriptor is None:
            raise LinkLostError(f"'{self._path}' is not open")
        try:
            data = os.read(descriptor, _READ_BYTES)
            status = os.fstat(descriptor)
            if not data and stat.S_ISREG(status.st_mode) and status.st_size < os.lseek(descriptor, 0, os.SEEK_CUR):
                os.lseek(descriptor, 0, os.SEEK_SET)  # it was emptied, and begins again
            if not data and stat.S_ISREG(status.st_mode) and self._is_replaced(status):
                data = os.read(descriptor, _READ_BYTES)  # what came before it was renamed
                if not data:
                    self._descriptor = os.open(self._path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
                    os.close(descriptor)
                    data = os.read(self._descriptor, _READ_BYTES)
        except BlockingIOError:
            data = b""
        except OSError as error:
            raise LinkLostError(f"cannot read '{self._path}': {error.strerror}") from error
        if not data:
            self._closed.wait(timeout_s)
        return data

    def _is_replaced(self, status: os.stat_result) -> bool:
        """Return whether another file has the name now, as when logs are rotated."""
        try:
            present = self._path.stat()
        except FileNotFoundError:  # not begun yet
            return False
        return (present.st_dev, present.st_ino) != (status.st_dev, status.st_ino)

    def write(self, data: bytes) -> None:
        """Refuse to write.

        Raises:
            SourceError: always.
        """
        raise SourceError(f"'{self._path}' takes no data", f"Nothing is sent to a receiver ({len(data)} bytes).")

    def close(self) -> None:
        """Close it; may be called at any time and twice, never raises."""
        self._closed.set()
        descriptor, self._descriptor = self._descriptor, None
        if descriptor is not None:
            with contextlib.suppress(OSError):
                os.close(descriptor)


class TireSensorSource(ReceiverSource):
    """Lines of rtl_433 as they arrive."""

    lines = SensorLines


class TireSensorFileSource(LineLog):
    """Lines of a log file, at the times that they state."""

    lines = SensorLines
    undated = ("no message with a time", "Give the lines that `rtl_433 -F json` prints.")

    def __init__(self, address: SourceAddress, clock: Clock) -> None:
        """Prepare the file.

        Raises:
            SourceError: there is no such file, or an option is not known or not allowed.
        """
        super().__init__(address, clock, "time_zone")
        name = address.options.get("time_zone")
        try:
            self._zone: tzinfo | None = None if name is None else ZoneInfo(name)
        except (ZoneInfoNotFoundError, ValueError, OSError) as error:
            raise SourceError(f"invalid option time_zone={name}", "Give one such as Europe/Berlin or UTC.") from error

    def _dated(self, file: IO[bytes]) -> Iterator[tuple[int, bytes]]:
        """Yield each line; one without a time comes with the line before, those at the begin with the first message."""
        last_ns = back = 0
        begin = b""
        for line in iter(lambda: file.readline(LONGEST_LINE), b""):
            time_ns = self._time_ns(line, is_needed=not last_ns)
            if time_ns is None and not last_ns:
                begin = (begin + line)[-LONGEST_LINE:]
                continue
            back += time_ns is not None and time_ns < last_ns
            last_ns = last_ns if time_ns is None else time_ns
            if begin or line.strip():
                yield last_ns, begin + line
            begin = b""
        if back:
            self.details = (Reason(VehicleCode.LOG_STEPS_BACK, count=back),)

    def _time_ns(self, line: bytes, *, is_needed: bool) -> int | None:
        """Return the time of a line with the offset, None where it has none.

        Raises:
            SourceError: a message has none that is needed, or it is ambiguous.
        """
        message = message_of(line)
        if message is None:
            return None
        time_of_day = message.get("time")
        if isinstance(time_of_day, str | int | float):
            with contextlib.suppress(ValueError, OverflowError):
                return round(float(time_of_day) * 1e9) + self._offset_ns
            with contextlib.suppress(ValueError):
                return self._of_date_ns(datetime.fromisoformat(str(time_of_day))) + self._offset_ns
        if not is_needed:
            return None
        raise SourceError(
            f"'{self._path}' has messages without a time of day: {str(time_of_day)[:40]}",
            "Let rtl_433 print it: `rtl_433 -F json -M time:utc:usec:tz`.",
        )

    def _of_date_ns(self, date: datetime) -> int:
        """Return a date in ns since the epoch, in the stated zone where it has none.

        Raises:
            SourceError: no zone is known, or the time is twice in it.
        """
        if date.tzinfo is None:
            zoned = date.replace(tzinfo=self._zone)
            if self._zone is None or zoned.utcoffset() != zoned.replace(fold=1).utcoffset():
                fault = "states no time zone" if self._zone is None else "comes twice, as summer time ends"
                raise SourceError(
                    f"'{self._path}': the time {date} {fault}",
                    "Add the zone of the receiver's computer, such as ?time_zone=Europe/Berlin, or let rtl_433 print "
                    "UTC: -M time:utc:tz.",
                )
            date = zoned
        since = date - datetime(1970, 1, 1, tzinfo=UTC)
        return (since.days * 86_400 + since.seconds) * 1_000_000_000 + since.microseconds * 1000
