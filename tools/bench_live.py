"""CPU of a live session on a serial link, and processing time from samples to estimate.

Prints two tables:
  * share of one core that `treadlink live serial://...` takes for 4 wheels x 3 axes x 9600 Hz, as lines, with a
    recording and with the screen, fed through a pseudo-terminal by another process in real time, start-up left out;
  * CPU time of the work on a chunk that completes revolutions, from its bytes to their estimates, in process, at full
    speed.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import os
import platform
import struct
import subprocess
import sys
import tempfile
import termios
import threading
import time
import tty
from pathlib import Path

import numpy as np

from gateway.clock import ManualClock, SystemClock
from gateway.config.vehicle import parse_vehicle
from gateway.io.source import Chunk, open_source
from gateway.recording.writer import RecordingWriter
from gateway.session.core import SessionCore

WARM_UP_S = 4.0
COLUMNS, ROWS = 120, 40


def cpu_s(pid: int) -> float:
    """User and system time of a process and its threads, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def feed(master: int, source_uri: str, stop: threading.Event) -> None:
    """Write the simulated hub's bytes to the pseudo-terminal in real time."""
    for item in open_source(source_uri, SystemClock()).items(stop):
        if isinstance(item, Chunk):
            view = memoryview(item.data)
            while view and not stop.is_set():
                try:
                    view = view[os.write(master, view) :]
                except OSError:
                    return


def measure_process(scenario: str, seconds: float, *, record: bool = False, screen: bool = False) -> tuple[float, str]:
    """Return the share of one core of a live session, and its last link line."""
    master, slave = os.openpty()
    tty.setraw(slave)
    port = os.ttyname(slave)
    uri = f"sim:{scenario}?speed=1"
    toml = open_source(uri, SystemClock()).vehicle_toml
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "vehicle.toml"
        config.write_text(toml or "")
        command = [sys.executable, "-m", "gateway.cli", "live", f"serial://{port}?baudrate=921600"]
        command += ["--config", str(config), "--duration", str(WARM_UP_S + seconds + 2)]
        if record:
            command += ["--record", str(Path(folder) / "bench.mcap")]
        process, output = on_terminal(command) if screen else as_lines([*command, "--plain"])
        stop = threading.Event()
        feeder = threading.Thread(target=feed, args=(master, uri, stop), daemon=True)
        printed: list[bytes] = []
        reader = threading.Thread(target=read_all, args=(output, printed))
        feeder.start()
        reader.start()
        time.sleep(WARM_UP_S)
        before, since = cpu_s(process.pid), time.monotonic()
        time.sleep(seconds)
        share = (cpu_s(process.pid) - before) / (time.monotonic() - since)
        process.wait(30)
        stop.set()
        os.close(slave)
        os.close(master)
        feeder.join(5)
        reader.join(5)
    lines = b"".join(printed).decode(errors="replace").splitlines()
    return share, next((line.strip() for line in reversed(lines) if " frames, " in line), "no link line")


def as_lines(command: list[str]) -> tuple[subprocess.Popen[bytes], int]:
    """Start a command whose output is a pipe; return its reading end too."""
    read_end, write_end = os.pipe()
    process = subprocess.Popen(command, stdout=write_end)
    os.close(write_end)
    return process, read_end


def on_terminal(command: list[str]) -> tuple[subprocess.Popen[bytes], int]:
    """Start a command on a terminal of COLUMNS x ROWS; return the terminal's other end too."""
    other_end, terminal = os.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    environment = {**os.environ, "TERM": "xterm-256color"}
    process = subprocess.Popen(
        command, stdin=terminal, stdout=terminal, stderr=terminal, env=environment, start_new_session=True
    )
    os.close(terminal)
    return process, other_end


def read_all(output: int, printed: list[bytes]) -> None:
    """Collect what a command prints until it ends."""
    with contextlib.suppress(OSError):  # how Linux reports the end of a pseudo-terminal
        while piece := os.read(output, 1 << 16):
            printed.append(piece)


def measure_work(scenario: str, seconds: float) -> dict[str, np.ndarray]:
    """Return the CPU time of the work on each chunk, ms, in a session with recording, by whether it gave results."""
    source = open_source(f"sim:{scenario}?speed=max&duration={seconds}", ManualClock())
    times: dict[str, list[float]] = {"chunk with revolution": [], "chunk without": [], "per revolution": []}
    with tempfile.TemporaryDirectory() as folder:
        recorder = RecordingWriter(Path(folder) / "bench.mcap", start_ns=0)
        core = SessionCore(parse_vehicle(source.vehicle_toml or "", scenario), recorder=recorder)
        for item in source.items(threading.Event()):
            begin = time.thread_time()
            results = core.take(item)
            took = (time.thread_time() - begin) * 1e3
            times["chunk with revolution" if results else "chunk without"].append(took)
            if results:
                times["per revolution"].append(took / len(results))
        core.finish()
    return {name: np.array(values) for name, values in times.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="demo")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--work", action="store_true", help="only the work on chunks")
    arguments = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print(f"4 wheels x 3 axes x 9600 Hz, scenario '{arguments.scenario}', {arguments.seconds:g} s of real time")
    kinds = {
        "live --plain": {},
        "live --plain --record": {"record": True},
        f"live, screen {COLUMNS} x {ROWS}": {"screen": True},
    }
    for kind, options in kinds.items() if not arguments.work else ():
        share, link = measure_process(arguments.scenario, arguments.seconds, **options)
        print(f"  {kind:22} {share:6.1%} of one core   {link}")
    print("CPU time of the work on a chunk, from its bytes to the estimates of its revolutions (ms)")
    for name, values in measure_work(arguments.scenario, arguments.seconds).items():
        p50, p99, top = np.percentile(values, 50), np.percentile(values, 99), values.max()
        print(f"  {name:22} n {len(values):6}   median {p50:6.2f}   99 % {p99:6.2f}   max {top:6.2f}")


if __name__ == "__main__":
    main()
