"""Serial ports: pyserial on pseudo-terminals."""

import errno
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import serial

from gateway.core.clock import ManualClock
from gateway.core.errors import LinkLostError, SourceError
from gateway.core.links.reasons import LinkCode
from gateway.core.links.serial_link import PyserialLink, explain_open_error, port_holders, serial_settings
from gateway.core.links.source import LinkEventKind, Source, open_source
from gateway.core.reasons import Level
from gateway.core.session.core import SessionCore
from gateway.core.text.wording import notice_text
from tests.testkit.hub_ends import PtyPort, Reader

Read = Callable[[Source], Reader]


def test_bytes_arrive_unchanged_in_few_reads(pty_port: PtyPort, read: Read) -> None:
    data = np.random.default_rng(1).integers(0, 256, 300_000, dtype=np.uint8).tobytes()
    reader = read(open_source(f"serial://{pty_port.path}?baudrate=921600", ManualClock()))
    connected = reader.event(LinkEventKind.CONNECTED)
    assert str(pty_port.path) in connected.link
    pty_port.send(data)
    chunks = reader.bytes(len(data))
    assert b"".join(chunk.data for chunk in chunks) == data
    assert len(chunks) < len(data) / 50, "reads are not big"


def test_unplugged_port_is_reported_and_reopened(pty_port: PtyPort, read: Read) -> None:
    reader = read(open_source(f"serial:{pty_port.path}", ManualClock()))
    reader.event(LinkEventKind.CONNECTED)
    pty_port.send(b"before")
    assert b"".join(chunk.data for chunk in reader.bytes(6)) == b"before"
    pty_port.unplug()
    lost = reader.event(LinkEventKind.LOST)
    assert str(pty_port.path) in lost.text
    assert "Unplugged?" in lost.text
    retrying = reader.event(LinkEventKind.RETRYING)
    assert f"there is no port {pty_port.path}" in retrying.text
    pty_port.plug()
    reader.event(LinkEventKind.RESTORED)
    pty_port.send(b"after")
    assert b"".join(chunk.data for chunk in reader.bytes(5)) == b"after"


def test_port_ready_without_data_is_lost(pty_port: PtyPort, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    link = PyserialLink(
        lambda: serial.Serial(str(pty_port.path)),
        lambda error: SourceError(str(error), ""),
        lambda error: LinkLostError(str(error), ""),
    )
    link.open()
    at_its_end = tmp_path / "empty"
    at_its_end.touch()
    with at_its_end.open("rb") as empty:
        monkeypatch.setattr(serial.Serial, "fileno", lambda _: empty.fileno())
        with pytest.raises(LinkLostError, match="without data"):
            link.read(0.0)
    link.close()


def test_missing_port_lists_those_present(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, read: Read) -> None:
    monkeypatch.setattr("gateway.core.links.serial_link.present_ports", lambda: ["/dev/ttyUSB3 (FT232R)"])
    reader = read(open_source(f"serial:{tmp_path}/ttyNO", ManualClock()))
    assert reader.next() is None
    assert isinstance(reader.error, SourceError)
    assert str(reader.error) == f"there is no port {tmp_path}/ttyNO"
    assert "/dev/ttyUSB3 (FT232R)" in reader.error.remedy


def test_no_port_suggests_the_simulator() -> None:
    error = explain_open_error("/nowhere/ttyUSB0", FileNotFoundError(errno.ENOENT, "no"), [])
    assert "sim:demo" in error.remedy


_HOLDER = """
import os, sys
port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY)
if sys.argv[2] == "True":
    import fcntl
    fcntl.flock(port, fcntl.LOCK_EX)
print("open", flush=True)
sys.stdin.read()
"""


@contextmanager
def held_by_another(port: Path, *, locks: bool) -> Iterator[int]:
    """Yield the number of another process that has a port open, and locks it as pyserial does."""
    command = [sys.executable, "-S", "-c", _HOLDER, str(port), str(locks)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout.readline() == b"open\n"
        yield process.pid
        process.stdin.close()


def test_busy_port_is_not_to_be_shared(pty_port: PtyPort, read: Read) -> None:
    with held_by_another(pty_port.path, locks=True) as process:
        reader = read(open_source(f"serial:{pty_port.path}", ManualClock()))
        assert reader.next() is None
        assert isinstance(reader.error, SourceError)
        if sys.platform == "linux":
            assert f"(process {process})" in str(reader.error)
        else:
            assert "in use by another program" in str(reader.error)
        assert "exclusive" not in reader.error.remedy, "half of a running recording would be lost"
        shared = read(open_source(f"serial:{pty_port.path}?exclusive=no", ManualClock()))
        shared.event(LinkEventKind.CONNECTED)


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not tell")
def test_who_reads_the_port_too_is_named(pty_port: PtyPort, read: Read) -> None:
    with held_by_another(pty_port.path, locks=False) as process:
        connected = read(open_source(f"serial:{pty_port.path}", ManualClock())).event(LinkEventKind.CONNECTED)
        (detail,) = connected.details
        assert detail.code is LinkCode.PORT_SHARED
        assert f"(process {process})" in detail["holders"]
        core = SessionCore(None)
        core.take(connected)
        (notice,) = [notice for notice in core.take_notices() if notice.subject == connected.link]
        assert notice.level is Level.WARNING
        assert "takes a part of its bytes" in notice_text(notice)


def test_a_port_that_nobody_holds_names_nobody(pty_port: PtyPort, tmp_path: Path) -> None:
    assert port_holders(str(tmp_path / "ttyNO")) == ()
    assert port_holders(str(tmp_path)) == ()
    busy = explain_open_error(str(pty_port.path), serial.SerialException(errno.EBUSY, "busy"), [])
    assert "another program" in str(busy)
    assert "fuser" in busy.remedy


def test_permission_names_the_group(pty_port: PtyPort) -> None:
    denied = serial.SerialException(errno.EACCES, "could not open port")
    error = explain_open_error(str(pty_port.path), denied, [])
    assert "no permission" in str(error)
    assert "usermod -aG" in error.remedy


@pytest.mark.parametrize("make", [Path.mkdir, Path.touch])
def test_other_files_are_not_serial_ports(tmp_path: Path, read: Read, make: Callable[[Path], None]) -> None:
    make(tmp_path / "thing")
    reader = read(open_source(f"serial:{tmp_path}/thing", ManualClock()))
    assert reader.next() is None
    assert "is not a serial port" in str(reader.error)


def test_options_reach_pyserial() -> None:
    assert serial_settings({"parity": "even", "stopbits": "2", "rtscts": "yes", "exclusive": "NO"}) == {
        "baudrate": 921600,
        "exclusive": False,
        "parity": "E",
        "stopbits": 2,
        "rtscts": True,
    }
