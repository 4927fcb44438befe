"""Links of a running session for other commands of the same user, by a local socket.

A command that finds the hub taken by a session reads and writes its bytes through it: the socket carries those of one
link both ways. It is a Unix socket of mode 0600 in a folder of mode 0700; systems without such sockets have none.
"""

import json
import logging
import os
import select
import socket
import stat
import tempfile
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

from gateway.core.clock import Clock
from gateway.core.errors import LinkLostError, TreadlinkError
from gateway.core.links.source import Chunk, LinkEvent, LinkEventKind, LinkItem, Source, TwoWaySource, WrappedSource
from gateway.core.reasons import Level, Notice, Reason
from gateway.core.session.frame_guard import FrameGuard
from gateway.security.hub_commands import with_commands
from gateway.security.key_file import command_keys
from gateway.security.reasons import SecurityCode

_logger = logging.getLogger(__name__)

_POLL_S: Final = 0.1
_ANSWER_S: Final = 2.0
_MOST_CLIENTS: Final = 8
_MAX_BYTES: Final = 65536
_LONGEST_REQUEST: Final = 4096
_IS_PRIVATE: Final = 0o077


class SharedLink(WrappedSource):
    """A source whose bytes others can read too, and write through it.

    Attributes:
        source: that is shared.
        rate_hz: sampling rate to set on the hub, None to leave it.
    """

    def __init__(self, source: TwoWaySource) -> None:
        """Wrap a source."""
        super().__init__(source)
        self.source = source
        self.rate_hz = source.rate_hz
        self._lock = threading.Lock()
        self._readers: list[socket.socket] = []

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the items of the source; those who read with it get the bytes first, or are let go when too slow."""
        for item in self.source.items(stop):
            if isinstance(item, Chunk) and self._readers:
                with self._lock:
                    self._readers = [reader for reader in self._readers if _is_sent(reader, item.data)]
            yield item

    def send(self, data: bytes) -> None:
        """Write a frame to the hub.

        Raises:
            LinkLostError: the write failed.
            SourceError: the hub takes no data.
        """
        self.source.send(data)

    def add_reader(self, reader: socket.socket) -> None:
        """Give the bytes that arrive from now on to a socket that does not block."""
        with self._lock:
            self._readers.append(reader)

    def remove_reader(self, reader: socket.socket) -> None:
        """Give it nothing more."""
        with self._lock:
            self._readers = [client for client in self._readers if client is not reader]


def _is_sent(reader: socket.socket, data: bytes) -> bool:
    """Write bytes at once; who is too slow for them is let go, since a part would tear the stream apart."""
    try:
        if reader.send(data) == len(data):
            return True
    except OSError:
        pass
    with suppress(OSError):
        reader.shutdown(socket.SHUT_RDWR)
    return False


class ControlSocket:
    """Serves the links of a session until it is closed."""

    def __init__(self, links: Mapping[str, SharedLink]) -> None:
        """Open the socket, where the system has one and its folder is private; a session runs without one as well."""
        self._links = dict(links)
        self._closed = threading.Event()
        self._clients = threading.Semaphore(_MOST_CLIENTS)
        self._listener: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._path: Path | None = None
        if not links or not hasattr(socket, "AF_UNIX"):
            return
        try:
            folder = _private_folder(create=True)
            path = folder / f"session-{os.getpid()}.sock" if folder is not None else None
            if path is not None:
                self._listen(path)
        except OSError as error:
            _logger.info("no control socket: %s", error)

    def close(self) -> None:
        """Remove the socket; may be called twice."""
        self._closed.set()
        listener, self._listener = self._listener, None
        if listener is not None:
            listener.close()
        if self._thread is not None:
            self._thread.join(2.0 * _POLL_S)
            self._thread = None
        if self._path is not None:
            self._path.unlink(missing_ok=True)
            self._path = None

    def _listen(self, path: Path) -> None:
        path.unlink(missing_ok=True)  # of a session with the same number that was killed
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            listener.bind(str(path))
            path.chmod(0o600)
            listener.listen(_MOST_CLIENTS)
            listener.settimeout(_POLL_S)
        except OSError:
            listener.close()
            raise
        self._listener, self._path = listener, path
        self._thread = threading.Thread(target=self._accept, args=(listener,), name="control", daemon=True)
        self._thread.start()

    def _accept(self, listener: socket.socket) -> None:
        is_failing = False
        while not self._closed.is_set():
            try:
                client, _ = listener.accept()
            except TimeoutError:
                continue
            except OSError as error:
                if not self._closed.wait(_POLL_S) and not is_failing:  # such as no free descriptor, which may come back
                    _logger.warning("a command cannot reach the session: %s", error)
                is_failing = True
                continue
            is_failing = False
            if not self._clients.acquire(blocking=False):
                client.close()
                continue
            threading.Thread(target=self._serve, args=(client,), name="control-client", daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        try:
            with client, suppress(OSError):
                client.settimeout(_ANSWER_S)
                link = self._links.get(_canonical(_request(client)))
                if link is None:
                    client.sendall(b"no\n")
                    return
                client.sendall(b"yes\n")
                client.setblocking(False)
                link.add_reader(client)
                try:
                    self._forward(client, link)
                finally:
                    link.remove_reader(client)
        finally:
            self._clients.release()

    def _forward(self, client: socket.socket, link: SharedLink) -> None:
        """Write what a client sends to the hub, until it leaves."""
        while not self._closed.is_set():
            if not select.select([client], [], [], _POLL_S)[0]:
                continue
            data = client.recv(_MAX_BYTES)
            if not data:
                return
            with suppress(TreadlinkError):  # no answer comes, which the client reports
                link.send(data)


def shared_links(sources: Sequence[TwoWaySource]) -> dict[str, SharedLink]:
    """Return sources as links that can be shared, by the names under which others ask for them."""
    return {_canonical(source.link): SharedLink(source) for source in sources}


class SessionOfLink(NamedTuple):
    """A connection to the session that has a link.

    Attributes:
        connection: carries the bytes of the link.
        process: number of the session's process.
    """

    connection: socket.socket
    process: int


def session_of(link: str) -> SessionOfLink | None:
    """Return a connection to the session of this user that has a link, None where there is none."""
    folder = _private_folder(create=False) if hasattr(socket, "AF_UNIX") else None
    for path in sorted(folder.glob("session-*.sock")) if folder is not None else ():
        number = path.stem.partition("-")[2]
        if not number.isdecimal() or int(number) == os.getpid():
            continue
        connection = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        try:
            connection.settimeout(_ANSWER_S)
            connection.connect(str(path))
            connection.sendall(json.dumps({"link": link}).encode() + b"\n")
            if connection.recv(4) == b"yes\n":
                return SessionOfLink(connection, int(number))
        except ConnectionRefusedError:  # its session was killed
            path.unlink(missing_ok=True)
        except OSError as error:
            _logger.info("%s does not answer: %s", path, error)
        connection.close()
    return None


class SessionSource:
    """The bytes of a link, read and written through the session that has it.

    Attributes:
        rate_hz: None: the session sets the rate.
    """

    vehicle_toml: str | None = None
    rate_hz: float | None = None

    def __init__(self, link: str, connection: socket.socket, clock: Clock) -> None:
        """Take a connection of `session_of`."""
        self._link = link
        self._connection = connection
        self._clock = clock

    @property
    def link(self) -> str:
        """Name of the link."""
        return self._link

    def items(self, stop: threading.Event) -> Iterator[LinkItem]:
        """Yield the connection, and the bytes of the link until stopped; a session that ends is a lost link."""
        yield LinkEvent(self._link, self._clock.now_ns(), LinkEventKind.CONNECTED)
        self._connection.settimeout(_POLL_S)
        while not stop.is_set():
            try:
                data = self._connection.recv(_MAX_BYTES)
            except TimeoutError:
                continue
            except OSError:
                data = b""
            if not data:
                yield LinkEvent(self._link, self._clock.now_ns(), LinkEventKind.LOST, "the session has ended")
                return
            yield Chunk(self._link, self._clock.now_ns(), data)

    def send(self, data: bytes) -> None:
        """Write a frame to the hub.

        Raises:
            LinkLostError: the session has ended.
        """
        try:
            self._connection.sendall(data)
        except OSError as error:
            raise LinkLostError(f"the session that has {self._link} has ended", "Try again.") from error

    def close(self) -> None:
        """Leave the session."""
        self._connection.close()


def _request(client: socket.socket) -> str:
    data = b""
    while not data.endswith(b"\n") and len(data) < _LONGEST_REQUEST:
        part = client.recv(_LONGEST_REQUEST)
        if not part:
            break
        data += part
    try:
        link = json.loads(data)["link"]
    except (ValueError, KeyError, TypeError, RecursionError):
        return ""
    return link if isinstance(link, str) else ""


def _canonical(link: str) -> str:
    """Return a name that two names of one serial port share."""
    scheme, _, target = link.partition(":")
    return f"serial:{os.path.realpath(target)}" if scheme == "serial" and "/" in target else link


def _private_folder(*, create: bool) -> Path | None:
    """Return the folder of the sockets, None where it is missing or not this user's alone.

    Raises:
        OSError: it cannot be made.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    folder = Path(runtime) / "treadlink" if runtime else Path(tempfile.gettempdir()) / f"treadlink-{os.getuid()}"
    if create:
        folder.mkdir(mode=0o700, exist_ok=True)
    try:
        status = folder.lstat()
    except OSError:
        return None
    is_private = stat.S_ISDIR(status.st_mode) and status.st_uid == os.getuid() and not status.st_mode & _IS_PRIVATE
    if not is_private:
        _logger.warning("'%s' is not private to this user: commands cannot go through sessions", folder)
    return folder if is_private else None


class CommandedLinks:
    """Links of a session whose hubs are sent the settings, shared with other commands.

    Attributes:
        sources: of the session, those that can be written to with their commands.
    """

    def __init__(
        self, sources: Sequence[Source], clock: Clock, key_file: Path | None, guard: FrameGuard | None
    ) -> None:
        """Wrap sources; commands are signed where a guard checks frames.

        Raises:
            SecurityError: the keys cannot be read.
        """
        keys = command_keys(key_file) if guard is not None else {}
        # The policy `warn` is for a time in which not every hub signs yet.
        may_be_unsigned = guard is not None and not guard.requires
        self._links = shared_links([source for source in sources if isinstance(source, TwoWaySource)])
        shared_by_id = {id(link.source): link for link in self._links.values()}
        self.sources = [
            with_commands(shared_by_id.get(id(source), source), clock, keys, may_be_unsigned=may_be_unsigned)
            for source in sources
        ]

    def serve(self) -> ControlSocket:
        """Begin to serve the links to other commands."""
        return ControlSocket(self._links)

    def in_use(self) -> Iterator[Notice]:
        """Yield a notice for each link that another session has."""
        for link in self._links.values():
            session = session_of(link.link)
            if session is not None:
                session.connection.close()
                yield Notice(link.link, Reason(SecurityCode.LINK_IN_USE, process=session.process), Level.WARNING)
