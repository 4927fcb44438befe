"""SIGTERM, and SIGHUP of a closed terminal, end commands as Ctrl-C does: recordings are finished."""

import fcntl
import os
import pty
import select
import signal
import subprocess
import sys
import termios
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gateway.cli import exit_status
from gateway.cli.stop_signals import StopSignal, stop_request
from gateway.recording.reader import RecordingReader

TIMEOUT_S = 60


def default_signals() -> None:
    """Give a child the signal handling of a terminal, whatever runs the tests."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, signal.SIG_DFL)


def hangup_ignored() -> None:
    """Prepare a child as nohup does."""
    default_signals()
    signal.signal(signal.SIGHUP, signal.SIG_IGN)


Start = Callable[..., "subprocess.Popen[str]"]


@pytest.fixture
def start() -> Iterator[Start]:
    running: list[subprocess.Popen[str]] = []

    def begin(*arguments: object, prepare: Callable[[], None] = default_signals) -> subprocess.Popen[str]:
        running.append(
            subprocess.Popen(
                [sys.executable, "-m", "gateway.cli", *map(str, arguments)],
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, preexec_fn=prepare,
            )
        )  # fmt: skip
        return running[-1]

    yield begin
    for process in running:
        process.kill()
        process.communicate()


def read_until(process: subprocess.Popen[str], word: str, *, errors: bool = False) -> None:
    stream = process.stderr if errors else process.stdout
    assert stream is not None
    assert any(word in line for line in iter(stream.readline, "")), process.communicate()


def test_signals_finish_recordings(start: Start, tmp_path: Path) -> None:
    live = start("live", "sim:lab", "--plain", "--record", tmp_path / "live.mcap")
    record = start("record", "sim:lab", "--out", tmp_path / "record.mcap", prepare=hangup_ignored)
    simulate = start("simulate", "lab", "--duration", "100000", "--out", tmp_path / "simulate.mcap")
    read_until(live, "±")
    live.send_signal(signal.SIGHUP)
    read_until(record, "connected", errors=True)
    record.send_signal(signal.SIGHUP)  # ignored
    grown(tmp_path / "record.mcap", than=size_of(tmp_path / "record.mcap"))
    assert record.poll() is None
    record.send_signal(signal.SIGTERM)
    grown(tmp_path / "simulate.mcap.part", than=0)
    simulate.send_signal(signal.SIGTERM)
    for process, name in ((live, "live"), (record, "record")):
        printed, errors = process.communicate(timeout=TIMEOUT_S)
        assert process.returncode == 0, errors
        assert f"recording: {tmp_path / name}.mcap" in printed
    _, errors = simulate.communicate(timeout=TIMEOUT_S)
    assert (simulate.returncode, errors.split()) == (128 + signal.SIGTERM, ["Aborted!"])
    for name in ("live", "record", "simulate"):
        assert RecordingReader(tmp_path / f"{name}.mcap").info.finished


def size_of(path: Path) -> int:
    return path.stat().st_size if path.exists() else 0


def grown(path: Path, *, than: int) -> None:
    """Wait for a limited time until a file that another process writes is larger."""
    deadline = time.monotonic() + TIMEOUT_S
    while size_of(path) <= than:
        assert time.monotonic() < deadline, f"{path} does not grow"
        select.select([], [], [], 0.02)


@pytest.mark.parametrize("plain", [True, False], ids=["plain", "console"])
def test_closed_terminal_finishes_the_recording(plain: bool, tmp_path: Path) -> None:
    master, slave = pty.openpty()
    fcntl.ioctl(slave, termios.TIOCSWINSZ, b"\x28\x00\x78\x00\x00\x00\x00\x00")  # 40 x 120

    def own_terminal() -> None:
        default_signals()
        os.setsid()
        fcntl.ioctl(slave, termios.TIOCSCTTY, 0)

    path = tmp_path / "closed.mcap"
    process = subprocess.Popen(
        [sys.executable, "-m", "gateway.cli", "live", "sim:lab", "--record", path, *(["--plain"] if plain else [])],
        stdin=slave, stdout=slave, stderr=slave, preexec_fn=own_terminal, env={**os.environ, "TERM": "xterm-256color"},
    )  # fmt: skip
    os.close(slave)
    try:
        shown = b""
        while "±".encode() not in shown:
            assert select.select([master], [], [], TIMEOUT_S)[0]
            shown += os.read(master, 65536)
        os.close(master)
        assert process.wait(TIMEOUT_S) == 128 + signal.SIGHUP
    finally:
        process.kill()
        process.wait()
    assert RecordingReader(path).info.finished


def test_requests_are_postponed_until_the_second_interrupt() -> None:
    before = signal.getsignal(signal.SIGTERM)
    with stop_request() as stop:
        assert not stop.is_set()
        for number in (signal.SIGTERM, signal.SIGHUP, signal.SIGTERM):
            signal.raise_signal(number)
        assert stop.is_set()
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        with pytest.raises(StopSignal) as caught:
            stop.raise_if_set()
    assert exit_status.of_signal(caught.value) == 128 + signal.SIGTERM
    assert signal.getsignal(signal.SIGTERM) is before
