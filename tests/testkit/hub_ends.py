"""A serial port on a pseudo-terminal, a TCP hub on loopback, and a reader thread like that of a session."""

import os
import queue
import select
import socket
import threading
from pathlib import Path

import pytest

from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, Source
from tests.testkit.waiting import TIMEOUT_S


class PtyPort:
    """A port for unplugging and replugging: `path` is a symlink to a pseudo-terminal, the rest is the hub's end."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._master = -1
        self._hung_up, self._hang_up = os.pipe()
        self.plug()

    def plug(self) -> None:
        tty = pytest.importorskip("tty", reason="pseudo-terminals exist on POSIX only")
        self._master, slave = os.openpty()
        tty.setraw(slave)
        name = os.ttyname(slave)
        os.close(slave)
        self.path.symlink_to(name)

    def send(self, data: bytes) -> None:
        """Write all bytes, until the port hangs up; fails without a reader."""
        view = memoryview(data)
        while view:
            hung_up, ready, _ = select.select([self._hung_up], [self._master], [], TIMEOUT_S)
            if hung_up:
                return
            assert ready, "the gateway does not read"
            view = view[os.write(self._master, view[:2048]) :]

    def hang_up(self) -> None:
        """End a `send` in another thread; a descriptor closed meanwhile could already belong to another file."""
        os.write(self._hang_up, b"x")

    def unplug(self) -> None:
        os.close(self._master)
        self._master = -1
        self.path.unlink()

    def close(self) -> None:
        if self._master >= 0:
            self.unplug()
        os.close(self._hung_up)
        os.close(self._hang_up)


class TcpHub:
    """Listener on loopback; `accept` returns the gateway's connection."""

    def __init__(self, host: str = "127.0.0.1") -> None:
        self._listener = socket.create_server((host, 0), family=socket.AF_INET6 if ":" in host else socket.AF_INET)
        self._listener.settimeout(TIMEOUT_S)
        self.port: int = self._listener.getsockname()[1]
        self._greeter: threading.Thread | None = None

    def greet(self, *greetings: bytes) -> None:
        """Accept one connection for each greeting, send it at once, and close; the last connection stays open."""

        def run() -> None:
            for greeting in greetings:
                connection = self.accept()
                connection.sendall(greeting)
                if greeting is not greetings[-1]:
                    connection.close()
            self._last = connection

        self._greeter = threading.Thread(target=run)
        self._greeter.start()

    def accept(self) -> socket.socket:
        connection, _ = self._listener.accept()
        connection.settimeout(TIMEOUT_S)
        return connection

    def close(self) -> None:
        self._listener.close()
        if self._greeter is not None:
            self._greeter.join(TIMEOUT_S)
            self._last.close()


class Reader:
    """Reader of a source in a thread; items arrive in a queue, so that tests wait without sleeping."""

    def __init__(self, source: Source) -> None:
        self.source = source
        self.stop = threading.Event()
        self.error: Exception | None = None
        self._queue: queue.Queue[LinkItem | None] = queue.Queue()
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        try:
            for item in self.source.items(self.stop):
                self._queue.put(item)
        except Exception as error:
            self.error = error
        finally:
            self._queue.put(None)

    def next(self) -> LinkItem | None:
        """Return the next item, None at the end."""
        return self._queue.get(timeout=TIMEOUT_S)

    def event(self, kind: LinkEventKind) -> LinkEvent:
        item = self.next()
        assert isinstance(item, LinkEvent), item or self.error
        assert item.kind is kind, item
        return item

    def bytes(self, count: int) -> list[Chunk]:
        chunks: list[Chunk] = []
        while sum(len(chunk.data) for chunk in chunks) < count:
            item = self.next()
            assert isinstance(item, Chunk), item or self.error
            chunks.append(item)
        return chunks

    def finish(self) -> None:
        self.stop.set()
        self._thread.join(TIMEOUT_S)
        assert not self._thread.is_alive(), "the source does not stop"
