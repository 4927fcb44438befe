"""Commands go through the session that has the hub: its recording loses nothing, and nobody else gets in."""

import errno
import os
import socket
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from firmware_protocol.codec import encode_frame
from firmware_protocol.decoder import FrameDecoder
from firmware_protocol.messages import HUB_ITSELF, CommandResult, Frame, LogText, MessageType, Outcome, SetRate
from gateway.core.clock import SystemClock
from gateway.core.errors import TreadlinkError
from gateway.core.links.source import Chunk, open_source
from gateway.core.recording.reader import RecordingReader
from gateway.core.session.session_opening import SessionSettings, open_session
from gateway.core.text.wording import notice_text
from gateway.security.control_socket import ControlSocket, SessionSource, SharedLink, session_of, shared_links
from gateway.security.hub_commands import execute
from tests.testkit.hub_ends import TIMEOUT_S, PtyPort, TcpHub
from tests.testkit.waiting import until

pytestmark = pytest.mark.skipif(not hasattr(socket, "AF_UNIX"), reason="sockets of files exist on POSIX only")


@pytest.fixture(autouse=True)
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    folder = tmp_path / "run"
    folder.mkdir()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(folder))
    return folder / "treadlink"


class SerialHub:
    """A hub on a pseudo-terminal that logs a line after each command, and carries all of them out."""

    def __init__(self, path: Path) -> None:
        self.port = PtyPort(path)
        self.commands: list[object] = []
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def _run(self) -> None:
        seq = 0
        while True:
            try:
                data = os.read(self.port._master, 4096)
            except OSError:  # no reader yet, or closed
                if self.port._master < 0:
                    return
                threading.Event().wait(0.005)
                continue
            # Each writer counts its frames from 0.
            for frame in FrameDecoder().feed(data):
                self.commands.append(frame.message)
                result = CommandResult(frame.seq, frame.type, Outcome.DONE)
                for kind, message in (
                    (MessageType.COMMAND_RESULT, result),
                    (MessageType.LOG_TEXT, LogText(1, f"command {frame.type}")),
                ):
                    seq += 1
                    os.write(self.port._master, encode_frame(Frame(kind, 3, HUB_ITSELF, seq, 0, message)))

    def close(self) -> None:
        self.port.close()
        self._thread.join(TIMEOUT_S)


def test_command_reaches_the_hub_through_its_session(tmp_path: Path) -> None:
    hub = SerialHub(tmp_path / "ttyHUB")
    clock, out = SystemClock(), tmp_path / "r.mcap"
    opened = open_session([f"serial:{hub.port.path}"], lambda _: None, SessionSettings(record=out), clock=clock)
    try:
        until(lambda: len(hub.commands) >= 2)
        before = len(hub.commands)
        words = [sys.executable, "-m", "gateway.core.cli", "command", "rate", f"serial:{hub.port.path}", "4800"]
        done = subprocess.run(words, capture_output=True, text=True, timeout=60, check=False)
        assert done.returncode == 0, done.stderr
        assert f"hub 3 executed the command, through the session of process {os.getpid()}" in done.stdout
        assert set(hub.commands[before:]) == {SetRate(4800.0)}
    finally:
        opened.live.close()
        hub.close()
    frames = [
        frame.message
        for item in RecordingReader(out).items()
        if isinstance(item, Chunk)
        for frame in FrameDecoder().feed(item.data)
    ]
    assert LogText(1, f"command {MessageType.SET_RATE}") in frames, "the session has every byte"
    assert session_of(f"serial:{hub.port.path}") is None


class Stream:
    """A hub that sends what the test puts into it."""

    vehicle_toml = None
    rate_hz = None
    link = "tcp:10.0.0.1:5000"

    def __init__(self) -> None:
        self.sent: list[bytes] = []

    def items(self, stop):
        while not stop.is_set():
            yield Chunk(self.link, 0, bytes(60_000))

    def send(self, data: bytes) -> None:
        self.sent.append(data)

    def close(self) -> None:
        pass


@pytest.fixture
def served(monkeypatch: pytest.MonkeyPatch):
    """A stream, its shared link, and the socket of another process."""
    stream = Stream()
    links = shared_links([stream])
    with monkeypatch.context() as patch:
        patch.setattr(os, "getpid", lambda: 4242)
        control = ControlSocket(links)
    yield stream, links[stream.link], control
    control.close()


def test_second_session_of_a_hub_is_told(monkeypatch: pytest.MonkeyPatch, tcp_hub: TcpHub) -> None:
    stream = Stream()
    stream.link = f"tcp:127.0.0.1:{tcp_hub.port}"
    with monkeypatch.context() as patch:
        patch.setattr(os, "getpid", lambda: 4242)
        control = ControlSocket(shared_links([stream]))
    opened = open_session([f"tcp://127.0.0.1:{tcp_hub.port}"], lambda _: None, SessionSettings(), clock=SystemClock())
    try:
        until(lambda: opened.live.snapshot().notices)
        texts = [notice_text(notice) for notice in opened.live.snapshot().notices]
        assert any("the session of process 4242 has this hub too" in text for text in texts)
    finally:
        control.close()
        opened.live.close()


def test_socket_is_of_this_user_alone(served, runtime: Path) -> None:
    path = runtime / "session-4242.sock"
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(runtime.stat().st_mode) == 0o700
    served[2].close()
    assert not path.exists()
    runtime.chmod(0o755)
    assert session_of(Stream.link) is None
    ControlSocket({Stream.link: SharedLink(Stream())})
    assert not list(runtime.iterdir()), "a folder that others can enter is not used"


def test_other_links_and_strange_requests_are_refused(served, runtime: Path) -> None:
    assert session_of("tcp:10.0.0.2:5000") is None
    for request in (b"\n", b"[]\n", b'{"link": 7}\n', b"[" * 5000, b"\xff\n"):
        with socket.socket(socket.AF_UNIX) as client:
            client.settimeout(TIMEOUT_S)
            client.connect(str(runtime / "session-4242.sock"))
            client.sendall(request)
            assert client.recv(10) in (b"no\n", b"")


def test_socket_of_a_killed_session_is_removed(served, runtime: Path) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(runtime / "session-17.sock"))
    result = session_of(Stream.link)
    assert result is not None
    assert result.process == 4242
    result.connection.close()
    assert [path.name for path in runtime.iterdir()] == ["session-4242.sock"]


def test_failure_that_stays_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    control = ControlSocket({})

    class Exhausted:
        calls = 0

        def accept(self) -> None:
            self.calls += 1
            if self.calls < 3:
                raise OSError(errno.EMFILE, "too many open files")
            control.close()
            raise TimeoutError

    control._accept(Exhausted())
    assert [record.levelname for record in caplog.records] == ["WARNING"]


def test_reader_that_is_too_slow_does_not_hold_the_session_up(served) -> None:
    stream, link, _ = served
    result = session_of(stream.link)
    stop, items = threading.Event(), link.items(threading.Event())
    until(lambda: link._readers)
    for _ in range(200):  # far more than a socket holds
        next(items)
    assert not link._readers
    source = SessionSource(stream.link, result.connection, SystemClock())
    kinds = [getattr(item, "kind", "data") for item in source.items(stop)]
    assert kinds[0] == "connected"
    assert kinds[-1] == "lost"


def test_command_ends_when_the_session_does(served) -> None:
    stream, _, control = served
    result = session_of(stream.link)
    source = SessionSource(stream.link, result.connection, SystemClock())
    until(lambda: served[1]._readers)
    control.close()
    with pytest.raises(TreadlinkError, match=r"has ended|did not reply"):
        execute(source, SetRate(4800.0), SystemClock(), timeout_s=TIMEOUT_S)


def test_names_of_one_port_are_one_link(tmp_path: Path) -> None:
    port = PtyPort(tmp_path / "ttyA")
    (tmp_path / "by-id").symlink_to(port.path)
    sources = [open_source(f"serial:{tmp_path}/{name}", SystemClock()) for name in ("ttyA", "by-id")]
    assert shared_links([sources[0]]).keys() == shared_links([sources[1]]).keys()
    port.close()
