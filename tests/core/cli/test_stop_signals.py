"""Ends from outside: Ctrl-C, SIGTERM, SIGHUP of a closed terminal, and a reader of the summary that leaves."""

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

import click
import pytest

from gateway.core.cli import LazyGroup, exit_status
from gateway.core.cli.stop_signals import StopSignal, stop_request
from gateway.core.cli.summary_output import SummaryOutput
from gateway.core.recording.reader import RecordingReader
from tests.testkit.campaign_recordings import START_NS, write_recording
from tests.testkit.commands import invoked

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
                [sys.executable, "-m", "gateway.core.cli", *map(str, arguments)],
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
        [sys.executable, "-m", "gateway.core.cli", "live", "sim:lab", "--record", path, *["--plain"] * plain],
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


# Python runs this first: the first worker process presses Ctrl-C while it is still starting.
PRESSES = """
import os, signal, sys

if any("spawn_main" in word for word in sys.orig_argv):
    try:
        os.close(os.open({marker!r}, os.O_CREAT | os.O_EXCL))
    except FileExistsError:
        pass
    else:
        os.kill(os.getpid(), signal.SIGINT)  # itself first, before the others can end it
        os.killpg(0, signal.SIGINT)
"""


@pytest.mark.skipif(not hasattr(os, "killpg"), reason="this system has no process groups")
def test_interrupt_while_processes_start(tmp_path: Path) -> None:
    at_60 = "[motion]\nspeed_kmh = 60.0"
    recordings = [
        write_recording(tmp_path / f"{number}.mcap", at_60, duration_s=2.0, start_ns=START_NS + number * 10**10)
        for number in range(2)
    ]
    marker = tmp_path / "pressed"
    (tmp_path / "sitecustomize.py").write_text(PRESSES.format(marker=str(marker)))
    process = subprocess.Popen(
        [sys.executable, "-m", "gateway.core.cli", "diagnose", *recordings, "--jobs", "2"],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([str(tmp_path), *sys.path])},
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    try:
        printed, errors = process.communicate(timeout=TIMEOUT_S)
    finally:
        process.kill()
    assert marker.exists()
    assert errors.split() == ["Aborted!"]
    assert printed == ""
    assert sorted(tmp_path.glob("[!_]*")) == sorted([*recordings, marker, tmp_path / "sitecustomize.py"])
    # Where the signal comes again as the interpreter ends, it dies of it, which a shell shows as 130 too.
    assert process.returncode in (130, -signal.SIGINT)


def test_interrupt_sets_the_exit_status(monkeypatch: pytest.MonkeyPatch) -> None:
    def pressed() -> None:
        signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(LazyGroup, "get_command", lambda *_: click.Command("figures", callback=pressed))
    result = invoked("figures")
    assert result.exit_code == 130
    assert "Aborted!" in result.output


@pytest.fixture(scope="module")
def recordings(tmp_path_factory) -> list[Path]:
    folder = tmp_path_factory.mktemp("summary")
    return [
        write_recording(folder / f"{name}.mcap", "[sensor]\nrate_hz = 3200.0", duration_s=1.8) for name in ("a", "b")
    ]


def run_unread(*words: object) -> tuple[int, str]:
    """Run a command whose output nobody reads; return its status and what it says of errors."""
    command = [sys.executable, "-m", "gateway.core.cli", *map(str, words)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None and process.stderr is not None  # noqa: PT018
        process.stdout.close()
        errors = process.stderr.read().decode()
        return process.wait(60), errors


@pytest.mark.skipif(sys.platform == "win32", reason="no closed pipes")
def test_orders_writes_all_its_files(recordings, tmp_path: Path) -> None:
    outputs = {"--figure": tmp_path / "o.svg", "--csv": tmp_path / "o.csv", "--json": tmp_path / "o.json"}
    options = [word for pair in outputs.items() for word in pair]
    status, errors = run_unread("orders", recordings[0], *options)
    assert status == exit_status.CLOSED_PIPE
    assert "Traceback" not in errors
    assert all(path.stat().st_size > 100 for path in outputs.values())


@pytest.mark.skipif(sys.platform == "win32", reason="no closed pipes")
def test_estimate_writes_the_rows_of_all_recordings(recordings, tmp_path: Path) -> None:
    table = tmp_path / "t.csv"
    status, _ = run_unread("estimate", *recordings, "--csv", table)
    assert status == exit_status.CLOSED_PIPE
    rows = table.read_text(encoding="utf-8").splitlines()[1:]
    assert {name for path in recordings for name in [path.name] if any(path.name in row for row in rows)} == {
        "a.mcap",
        "b.mcap",
    }
    assert run_unread("estimate", *recordings)[0] == exit_status.CLOSED_PIPE


def test_lines_after_the_reader_left_are_dropped_and_the_end_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    printed: list[tuple[str, bool]] = []

    def echo(line: str, *, err: bool) -> None:
        if len(printed) == 2:
            raise BrokenPipeError
        printed.append((line, err))

    monkeypatch.setattr(click, "echo", echo)
    say = SummaryOutput([Path("-")])
    say.finish()
    for line in ("a", "b", "c"):
        say(line)
    printed.clear()
    say("d")
    assert printed == []
    with pytest.raises(BrokenPipeError):
        say.finish()
