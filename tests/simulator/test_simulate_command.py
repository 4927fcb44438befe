"""`treadlink simulate` and its pseudo-terminal."""

import os
import threading
from pathlib import Path

import pytest

from firmware_protocol.decoder import FrameDecoder
from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import load_vehicle
from gateway.core.errors import OutputError, SourceError
from gateway.core.links.source import Chunk, open_source
from gateway.core.recording.reader import RecordingReader
from gateway.simulator.pty_link import BACKLOG_BYTES, PtyPort
from tests.testkit.commands import invoked, run


@pytest.fixture
def pty() -> PtyPort:
    if not hasattr(os, "openpty"):
        if os.environ.get("CI"):
            pytest.fail("CI must have pseudo-terminals")
        pytest.skip("this system has no pseudo-terminals")
    return PtyPort()


def test_bin_and_mcap_hold_the_source_bytes(tmp_path: Path) -> None:
    raw, recording = tmp_path / "a.bin", tmp_path / "a.mcap"
    options = ("--duration", "0.5", "--seed", "3", "--fault", "flip:rate=0.1")
    output = run("simulate", "demo", "--out", str(raw), *options)
    assert "FL: 4650 N" in output
    assert "fault flip:rate=0.1,bits=1:" in output
    run("simulate", "demo", "--out", str(recording), *options)
    source = open_source("sim:demo?speed=max&duration=0.5&seed=3&fault=flip:rate=0.1", ManualClock())
    expected = b"".join(item.data for item in source.items(threading.Event()) if isinstance(item, Chunk))
    assert raw.read_bytes() == expected
    reader = RecordingReader(recording)
    assert b"".join(item.data for item in reader.items() if isinstance(item, Chunk)) == expected
    assert reader.vehicle_toml == source.vehicle_toml


def test_files_are_never_overwritten(tmp_path: Path) -> None:
    for name in ("a.bin", "a.mcap"):
        path = tmp_path / name
        path.write_bytes(b"mine")
        with pytest.raises(Exception, match=r"a\.") as caught:
            run("simulate", "lab", "--out", str(path), "--duration", "0.1")
        assert "exist" in str(caught.value)
        assert path.read_bytes() == b"mine"


def test_vehicle_file_reads_back(tmp_path: Path) -> None:
    path = tmp_path / "car.toml"
    run("simulate", "demo", "--out", str(tmp_path / "a.bin"), "--duration", "0.1", "--vehicle", str(path))
    assert load_vehicle(path).name == "Demo car"


def test_usage_errors_are_reported(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="unknown suffix"):
        run("simulate", "lab", "--out", str(tmp_path / "a.txt"), "--duration", "0.1")
    with pytest.raises(SourceError, match="is endless"):
        run("simulate", "lab", "--out", str(tmp_path / "a.bin"))
    neither = invoked("simulate", "lab")
    assert neither.exit_code == 2
    assert all(way in neither.output for way in ("--out FILE", "--pty"))


def test_list_names_scenarios_and_faults() -> None:
    output = run("simulate", "--list")
    assert "standstill_restart" in output
    assert "reboot:at=5" in output


def test_pty_command_prints_how_to_read_it(pty: PtyPort) -> None:
    pty.close()
    output = run("simulate", "lab", "--pty", "--speed", "max", "--duration", "0.3")
    assert "treadlink live serial:///dev/" in output
    assert "0 bytes read" in output


def test_pty_delivers_every_byte_to_a_reader(pty: PtyPort) -> None:
    source = open_source("sim:demo?speed=max&duration=0.5", ManualClock())
    chunks = [item.data for item in source.items(threading.Event()) if isinstance(item, Chunk)]
    reader = os.open(pty.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    received = b""
    try:
        assert pty.connected
        for chunk in chunks:
            pty.write(chunk)
            received += _read_all(reader)
        for _ in range(100):
            if len(received) == sum(map(len, chunks)):
                break
            pty.flush()
            received += _read_all(reader)
    finally:
        os.close(reader)
        pty.close()
    assert received == b"".join(chunks)
    assert (pty.sent, pty.unread, pty.dropped) == (len(received), 0, 0)


def _read_all(reader: int) -> bytes:
    data = b""
    while True:
        try:
            piece = os.read(reader, 65536)
        except BlockingIOError:
            return data
        if not piece:
            return data
        data += piece


def test_pty_without_a_reader_discards_bytes(pty: PtyPort) -> None:
    for _ in range(100):
        pty.write(bytes(2600))
    assert not pty.connected
    assert pty.unread == 260_000
    # A late reader gets later bytes only, not those sent before it connected.
    reader = os.open(pty.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    pty.write(b"now")
    assert _read_all(reader) == b"now"
    os.close(reader)
    pty.write(b"gone")
    assert pty.unread == 260_004
    pty.close()
    pty.close()


def test_pty_drops_whole_chunks_for_a_slow_reader(pty: PtyPort) -> None:
    source = open_source("sim:demo?speed=max&duration=3", ManualClock())
    reader = os.open(pty.path, os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
    received, written = b"", 0
    for item in source.items(threading.Event()):
        if isinstance(item, Chunk):
            pty.write(item.data)
            written += len(item.data)
    assert pty.dropped > 0
    for _ in range(1000):
        data = _read_all(reader)
        received += data
        pty.flush()
        if not data:
            break
    os.close(reader)
    pty.close()
    assert len(received) == pty.sent == written - pty.dropped >= BACKLOG_BYTES
    decoder = FrameDecoder()
    decoder.feed(received)
    # Only whole frames arrive. A slow reader loses frames, as their counters show, but none is damaged.
    assert decoder.counters.crc_errors == decoder.counters.noise_bytes == 0
