"""Positioning receivers: on a serial port, behind a TCP server or gpsd, or in a log file."""

import re
import threading
from collections.abc import Iterator
from contextlib import suppress
from typing import IO, ClassVar, Final

from gateway.core.clock import Clock
from gateway.core.errors import LinkLostError, SourceError
from gateway.core.links.nmea_sentences import SentenceReader, can_read_sentences
from gateway.core.links.reconnect import ReconnectingSource
from gateway.core.links.serial_link import serial_port, serial_settings
from gateway.core.links.source import (
    Chunk,
    LinkItem,
    Sentences,
    Source,
    SourceAddress,
    WrappedSource,
    parse_source_uri,
    silence_option,
)
from gateway.core.links.tcp_link import TcpLink, parse_host_port
from gateway.vehicle.log_file import LineLog
from gateway.vehicle.log_sources import NMEA_FILE_SUFFIXES

GPSD_PORT: Final = 2947
"""Port at which gpsd serves its clients."""

# The rate of NMEA 0183; receivers on USB take any.
_BAUDRATE: Final = "9600"
_DEVICE: Final = "receiver"
_WATCH: Final = b'?WATCH={"enable":true,"nmea":true};\n'
HOST: Final = re.compile(r"(\[[^\]]+\]|[^:/\\]+):\d{1,5}")
"""Address of a server."""
LONGEST_LINE: Final = 4096
"""What is longer without a line end is no text."""


def open_nmea(address: SourceAddress, clock: Clock) -> Source:
    """Open `nmea:PORT?baudrate=9600`, `nmea:HOST:PORT`, gpsd by `nmea:HOST:2947`, or `nmea:FILE?speed=1|10|max`.

    Raises:
        SourceError: pynmeagps is missing, or address, file or option cannot be used.
    """
    if not can_read_sentences():
        raise SourceError(
            "a positioning receiver needs the package 'pynmeagps', which is not installed",
            "Install it with: pip install 'treadlink[nmea]'",
        )
    if address.target.lower().endswith(NMEA_FILE_SUFFIXES):
        return ReceiverFileSource(address, clock)
    name = f"nmea:{address.target}"
    options = dict(address.options)
    if HOST.fullmatch(address.target) and not address.target.upper().startswith("COM"):
        silence_s = silence_option(options)
        address.check_options(("silence",))
        host_port = parse_host_port(address)
        kind = GpsdLink if host_port.port == GPSD_PORT else TcpLink
        return ReceiverSource(
            ReconnectingSource(name, lambda: kind(host_port, device=_DEVICE), clock, silence_s=silence_s)
        )
    port = parse_source_uri(address.target) if address.target.startswith(("/dev/", "COM")) else address
    silence_s = silence_option(options, 0.0)
    options.pop("silence", None)
    settings = serial_settings({"baudrate": _BAUDRATE, **port.options, **options})
    return ReceiverSource(
        ReconnectingSource(name, lambda: serial_port(port.target, settings, _DEVICE), clock, silence_s=silence_s)
    )


class GpsdLink(TcpLink):
    """A connection to gpsd, which sends the sentences of its receiver when asked to."""

    def open(self) -> None:
        """Connect, and ask for sentences.

        Raises:
            SourceError: it cannot be opened now.
        """
        super().open()
        with suppress(LinkLostError):  # the next read says so
            self.write(_WATCH)


class ReceiverSource(WrappedSource):
    """Lines of a receiver as they arrive, in whole lines; nothing is sent to it but by its link.

    Attributes:
        lines: what its lines are.
    """

    lines: ClassVar[type[Sentences]] = Sentences

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield lines and events of the link until stopped or closed.

        Raises:
            SourceError: the link could not be opened the first time.
        """
        unfinished = b""
        for item in self._source.items(stop):
            if not isinstance(item, Chunk):
                unfinished = b""
                yield item
                continue
            lines, end, unfinished = (unfinished + item.data).rpartition(b"\n")
            if len(unfinished) > LONGEST_LINE:
                lines, end, unfinished = unfinished, b"", b""
            if lines or end:
                yield self.lines(item.link, item.host_ns, lines + end)


class ReceiverFileSource(LineLog):
    """Sentences of a log file, at the times that they state."""

    undated = (
        "no sentence RMC with a time and date",
        "Give a log of NMEA 0183, as `gpspipe -r` and most receivers write it.",
    )

    def _dated(self, file: IO[bytes]) -> Iterator[tuple[int, bytes]]:
        """Yield the lines up to each fix; those behind the last one are left out."""
        reader, lines, size = SentenceReader(), list[bytes](), 0
        for line in iter(lambda: file.readline(LONGEST_LINE), b""):
            lines.append(line)
            size += len(line)
            times_ns = [fix.utc_ns for fix in reader.read(line) if fix.utc_ns is not None]
            if times_ns:
                yield times_ns[-1] + self._offset_ns, b"".join(lines)
            if times_ns or size > LONGEST_LINE * 16:
                lines, size = [], 0
