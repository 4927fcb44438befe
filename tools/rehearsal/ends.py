"""The far ends of a day's links, the clock that its driver moves, and gates that stop the gateway's readers."""

import socket
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Protocol

from gateway.core.clock import Clock, ComputerTime, ManualClock
from gateway.core.links.bus_frames import unpack
from gateway.core.links.source import BusFrames, LinkEvent, LinkEventKind, LinkItem, Source
from gateway.simulator import pty_link

_POLL_S = 0.001


class DayClock(ManualClock):
    """A clock that only the driver of the day moves; what sleeps on it looks again."""

    def __init__(self, start_ns: int) -> None:
        """Start at a time, in ns since the epoch."""
        super().__init__(start_ns)
        # Read as one: a pause that the time has and the computer's clocks do not would be silence.
        self._lock = threading.Lock()

    def now_ns(self) -> int:
        """Return the time set so far."""
        with self._lock:
            return super().now_ns()

    def computer(self) -> ComputerTime:
        """Return the clocks as set so far."""
        with self._lock:
            return super().computer()

    def pause_computer(self, pause_ns: int) -> None:
        """Move the clock forward by a pause of the whole computer."""
        with self._lock:
            super().pause_computer(pause_ns)

    def sleep_until_ns(self, deadline_ns: int, stop: threading.Event | None = None) -> bool:
        """Wait a moment of real time; return True when `stop` is set."""
        del deadline_ns
        return (stop or threading.Event()).wait(_POLL_S)


class GatedSource:
    """A source whose reader stands still while `gate` is not set, as on a computer that pauses.

    Attributes:
        gate: open when set.
        read: bytes read, of a bus frames.
        is_connected: by the source's events.
        connected_ns: times from which it was.
    """

    def __init__(self, source: Source, clock: Clock) -> None:
        """Wrap a source with an open gate."""
        self.gate = threading.Event()
        self.gate.set()
        self.read = 0
        self.is_connected = False
        self.connected_ns: list[int] = []
        self.link, self.vehicle_toml = source.link, source.vehicle_toml
        self._source, self._clock = source, clock

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the source's items while the gate is open."""
        for item in self._source.items(stop):
            while not self.gate.wait(_POLL_S) and not stop.is_set():
                pass
            yield item
            if isinstance(item, LinkEvent):
                self.is_connected = item.kind in (LinkEventKind.CONNECTED, LinkEventKind.RESTORED)
                if self.is_connected:
                    self.connected_ns.append(self._clock.now_ns())
            else:
                self.read += sum(1 for _ in unpack(item.data, 0)) if isinstance(item, BusFrames) else len(item.data)

    def close(self) -> None:
        """Release the source."""
        self._source.close()


class HubEnd(Protocol):
    """The hub's end of a link."""

    uri: str

    def send(self, data: bytes) -> int:
        """Send what the line takes now and return the number of bytes that were lost."""
        ...

    def waiting(self) -> bool:
        """Return whether bytes wait for the line, after another try."""
        ...

    def unplug(self) -> None:
        """Break the link."""
        ...

    def plug(self) -> None:
        """Make the link possible again."""
        ...


class PtyEnd:
    """A hub or receiver on a serial port: a link in the file system to a pseudo-terminal."""

    def __init__(self, path: Path, scheme: str = "serial") -> None:
        """Plug it in."""
        self.uri = f"{scheme}:{path}"
        self._path = path
        self._port: pty_link.PtyPort | None = None
        self.plug()

    def send(self, data: bytes) -> int:
        """Send; all is lost while it is unplugged, whole chunks when the reader is too slow."""
        if self._port is None:
            return len(data)
        before = self._port.unread + self._port.dropped
        self._port.write(data)
        return self._port.unread + self._port.dropped - before

    def waiting(self) -> bool:
        """Return whether bytes wait."""
        if self._port is None or not self._port.connected:
            return False
        self._port.flush()
        return self._port.is_waiting

    def unplug(self) -> None:
        """Let the port vanish."""
        if self._port is not None:
            self._port.close()
            self._path.unlink()
        self._port = None

    def plug(self) -> None:
        """Let it appear again."""
        self._port = pty_link.PtyPort()
        self._path.symlink_to(self._port.path)


class TcpEnd:
    """A hub behind a TCP server on this computer."""

    def __init__(self) -> None:
        """Listen on a free port."""
        self._listener: socket.socket | None = None
        self._connection: socket.socket | None = None
        self._port = 0
        self._unsent = bytearray()
        self.plug()
        self.uri = f"tcp://127.0.0.1:{self._port}"

    def send(self, data: bytes) -> int:
        """Send; all is lost without a connection."""
        self._accept()
        if self._connection is None:
            return len(data)
        self._unsent += data
        return self._flush()

    def waiting(self) -> bool:
        """Return whether bytes wait."""
        self._accept()
        self._flush()
        return bool(self._unsent)

    def unplug(self) -> None:
        """Close connection and server."""
        for end in (self._connection, self._listener):
            if end is not None:
                end.close()
        self._connection = self._listener = None
        self._unsent.clear()

    def plug(self) -> None:
        """Listen again, on the same port."""
        self._listener = socket.create_server(("127.0.0.1", self._port))
        self._listener.setblocking(False)
        self._port = self._listener.getsockname()[1]

    def _accept(self) -> None:
        if self._listener is not None and self._connection is None:
            try:
                self._connection, _ = self._listener.accept()
            except BlockingIOError:
                return
            self._connection.setblocking(False)
            self._connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # small frames would wait 40 ms each

    def _flush(self) -> int:
        if self._connection is None or not self._unsent:
            return 0
        try:
            del self._unsent[: self._connection.send(self._unsent)]
        except BlockingIOError:
            return 0
        except OSError:  # the gateway has closed it
            lost = len(self._unsent)
            self._unsent.clear()
            self._connection.close()
            self._connection = None
            return lost
        return 0
