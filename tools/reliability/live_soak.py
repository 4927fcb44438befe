"""Soak of `treadlink live` in real time with all its outputs, while the clock is set again and again.

Four wheels come through a pseudo-terminal. The session records in files of a few minutes, writes JSON lines, publishes
to a broker and serves its page, to which browsers come and go. The wall clock steps by up to 58 days, both ways. At
equal steps of time: memory, descriptors, threads, processor time, and the time from the last byte that a revolution
needs to its line. At the end every byte that was sent must be in the recordings, in order.
"""

import argparse
import contextlib
import hashlib
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections import deque
from collections.abc import Callable, Iterator, MutableSequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np
from websockets.exceptions import WebSocketException
from websockets.sync.client import connect
from websockets.typing import Origin

sys.path.insert(0, str(Path(__file__).parents[2]))

from gateway.core.clock import ManualClock
from gateway.core.links.source import Chunk, open_source
from gateway.core.recording.reader import RecordingReader
from tools.bench_live import cpu_s, feed, latencies_ms, read_all, timed_pieces
from tools.mqtt_broker import PROGRAM, Broker, Listener

_SCENARIO: Final = "demo"
_SHIM: Final = Path(__file__).with_name("shifted_clock.c")
_DAY_S: Final = 86400
_STEPS_S: Final = (3600, -7200, 58 * _DAY_S, -58 * _DAY_S, -30, 40, -_DAY_S)
"""Changes of the wall clock, one after the other: a wrong time zone, a clock without battery, small corrections."""
_WINDOW_S: Final = 30.0
_PAGE_S: Final = 10.0
_END_S: Final = 60.0
# A computer with too much other work may have a backlog.
_DRAIN_S: Final = 600.0


@dataclass(frozen=True, slots=True)
class Reading:
    """The process at one moment of the soak.

    Attributes:
        minute: since the first byte.
        memory_mb: resident memory.
        descriptors: open files and sockets.
        threads: threads.
        cpu: share of one core since the reading before.
        latency_ms: median and 99 % of the time from the last byte that a revolution needs to its line, in the last
            half a minute.
        load: runnable processes of the computer, mean over a minute.
    """

    minute: float
    memory_mb: float
    descriptors: int
    threads: int
    cpu: float
    latency_ms: tuple[float, float]
    load: float


@dataclass(slots=True)
class LiveSoak:
    """Result of the soak.

    Attributes:
        readings: at equal steps of time.
        clock_steps: how often the wall clock was set.
        said_steps: how often the program said so.
        files: recordings.
        sent_bytes: bytes on the line.
        recorded_bytes: bytes of the line in the recordings.
        is_equal: whether these are those, in order.
        lines: revolutions among the lines of JSON.
        messages: revolutions that came from the broker.
        pages: browsers that were served.
        refused_pages: browsers that were not.
        status: of the program.
        summary: last lines of the program.
    """

    readings: list[Reading] = field(default_factory=list)
    clock_steps: int = 0
    said_steps: int = 0
    files: int = 0
    sent_bytes: int = 0
    recorded_bytes: int = 0
    is_equal: bool = False
    lines: int = 0
    messages: int = 0
    pages: int = 0
    refused_pages: int = 0
    status: int = 0
    summary: list[str] = field(default_factory=list)


class _SentPieces(deque[tuple[float, bytes]]):
    """The pieces of the last `_WINDOW_S`, and the hash of all."""

    def __init__(self) -> None:
        super().__init__()
        self.digest = hashlib.sha256()
        self.size = 0
        self.lock = threading.Lock()

    def append(self, piece: tuple[float, bytes]) -> None:
        self.digest.update(piece[1])
        self.size += len(piece[1])
        with self.lock:
            super().append(piece)
            while self[0][0] < piece[0] - _WINDOW_S:
                self.popleft()

    def window(self) -> list[tuple[float, bytes]]:
        with self.lock:
            return list(self)


class _Browsers:
    """Browsers that open the page one after the other, watch for `_PAGE_S` and go without a word."""

    def __init__(self, address: str) -> None:
        self._address = address
        self._stop = threading.Event()
        self.served = self.refused = 0
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        wheels = ("FL", "FR", "RL", "RR")
        while not self._stop.is_set():
            until_s = time.monotonic() + _PAGE_S
            try:
                origin = Origin(self._address.replace("ws://", "http://").rstrip("/"))
                with connect(self._address, origin=origin, open_timeout=_END_S, max_size=None) as page:
                    page.send(json.dumps({"wheel": wheels[self.served % 4], "trend": "speed_mps"}))
                    while time.monotonic() < until_s and not self._stop.is_set():
                        page.recv(timeout=_END_S)
                    self.served += 1
            except (OSError, TimeoutError, WebSocketException):
                self.refused += not self._stop.is_set()
                self._stop.wait(1.0)

    def close(self) -> None:
        self._stop.set()
        self._thread.join(_END_S)


def _shim(folder: Path) -> Path:
    library = folder / "shifted_clock.so"
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", str(library), str(_SHIM)], check=True)
    return library


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        return int(free.getsockname()[1])


def _descriptors(pid: int) -> int:
    return sum(1 for _ in Path(f"/proc/{pid}/fd").iterdir())


def _status(pid: int, key: str) -> int:
    return int(Path(f"/proc/{pid}/status").read_text().split(f"{key}:")[1].split()[0])


def run_live_soak(minutes: float, folder: Path, *, readings: int = 10, split_s: float = 300.0) -> LiveSoak:
    """Run the program for a time.

    Args:
        minutes: of real time.
        folder: takes configuration, recordings (some 50 MB a minute) and outputs.
        readings: how many.
        split_s: length of a file of the recording.
    """
    soak = LiveSoak()
    shift = folder / "shift"
    shift.write_bytes(bytes(8))
    uri = f"sim:{_SCENARIO}?speed=max"
    config = folder / "vehicle.toml"
    config.write_text(open_source(uri, ManualClock()).vehicle_toml or "")
    master, slave = os.openpty()
    tty.setraw(slave)
    broker = Broker(folder).start() if PROGRAM else None
    listener = Listener(broker.port, "soak/wheel/+/revolution", lambda _: b"") if broker else None
    command = [
        sys.executable,
        "-m",
        "gateway.core.cli",
        "live",
        f"serial://{os.ttyname(slave)}?baudrate=921600",
        "--plain",
    ]
    command += ["--config", str(config), "--record", str(folder / "recordings"), "--split", f"{round(split_s)}s"]
    command += ["--publish", f"jsonl:{folder}/soak.jsonl", "--publish", f"web://127.0.0.1:{_free_port()}"]
    command += ["--publish", f"mqtt://127.0.0.1:{broker.port}/soak?discovery=off"] if broker else []
    (folder / "recordings").mkdir()
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "LD_PRELOAD": str(_shim(folder)), "TREADLINK_CLOCK_SHIFT": str(shift)},
    )
    assert process.stdout is not None
    assert process.stderr is not None
    stop, sent = threading.Event(), _SentPieces()
    printed: list[tuple[float, bytes]] = []
    said: list[str] = []
    threads = [
        threading.Thread(target=read_all, args=(process.stdout.fileno(), printed)),
        threading.Thread(target=lambda: said.extend(line.decode() for line in process.stderr or ())),
    ]
    for thread in threads:
        thread.start()
    browsers = None
    try:
        text = _wait_for(lambda: (b"".join(piece for _, piece in printed)).decode() + "".join(said), "connected")
        browsers = _Browsers("ws://" + text.split("http://")[1].split()[0])
        feeder = threading.Thread(target=feed, args=(master, timed_pieces(uri), stop, sent), daemon=True)
        feeder.start()
        _read_regularly(soak, process.pid, minutes, readings, shift, sent, printed)
        stop.set()
        feeder.join(_END_S)
        time.sleep(2.0)
        browsers.close()
        soak.pages, soak.refused_pages = browsers.served, browsers.refused
        process.send_signal(signal.SIGTERM)  # SIGINT is ignored by what a shell starts in the background
        soak.status = process.wait(_DRAIN_S)
    finally:
        stop.set()
        if process.poll() is None:
            process.kill()
        for thread in threads:
            thread.join(_END_S)
        os.close(slave)
        os.close(master)
        if listener:
            soak.messages = len(listener.messages)
            listener.close()
        if broker:
            broker.kill()
    text = b"".join(piece for _, piece in printed).decode() + "".join(said)
    soak.said_steps = text.count("system time jumped")
    soak.summary = text.splitlines()[-30:]
    with (folder / "soak.jsonl").open() as lines:
        soak.lines = sum(json.loads(line)["type"] == "revolution" for line in lines)
    soak.sent_bytes = sent.size
    _compare_recordings(soak, folder / "recordings", sent)
    return soak


def _wait_for(text: Callable[[], str], part: str) -> str:
    until_s = time.monotonic() + _END_S
    while part not in text():
        if time.monotonic() > until_s:
            raise TimeoutError(f"no '{part}' in: {text()}")
        time.sleep(0.1)
    return text()


def _read_regularly(
    soak: LiveSoak,
    pid: int,
    minutes: float,
    readings: int,
    shift: Path,
    sent: _SentPieces,
    printed: MutableSequence[tuple[float, bytes]],
) -> None:
    """Take readings at equal steps of time, and set the clock halfway between them."""
    begin_s = time.monotonic()
    step_s = 60.0 * minutes / readings
    before_cpu_s, before_s, shift_ns = cpu_s(pid), begin_s, 0
    for number in range(1, readings + 1):
        time.sleep(max(0.0, begin_s + (number - 0.5) * step_s - time.monotonic()))
        shift_ns += round(1e9 * _STEPS_S[(number - 1) % len(_STEPS_S)])
        with shift.open("r+b") as file:
            file.write(struct.pack("=q", shift_ns))
        soak.clock_steps += 1
        time.sleep(max(0.0, begin_s + number * step_s - time.monotonic()))
        window, since_s = sent.window(), time.monotonic() - 2 * _WINDOW_S
        lines = [piece for piece in tuple(printed) if piece[0] > since_s]
        now_cpu_s, now_s = cpu_s(pid), time.monotonic()
        reading = Reading(
            (now_s - begin_s) / 60.0,
            _status(pid, "VmRSS") / 1024,
            _descriptors(pid),
            _status(pid, "Threads"),
            (now_cpu_s - before_cpu_s) / (now_s - before_s),
            _percentiles(latencies_ms(_SCENARIO, window, lines)),
            os.getloadavg()[0],
        )
        before_cpu_s, before_s = now_cpu_s, now_s
        soak.readings.append(reading)
        print(_row(reading), file=sys.stderr, flush=True)


def _percentiles(waits_ms: np.ndarray) -> tuple[float, float]:
    if not len(waits_ms):
        return float("nan"), float("nan")
    median, most = np.percentile(waits_ms, (50, 99))
    return float(median), float(most)


def _compare_recordings(soak: LiveSoak, folder: Path, sent: _SentPieces) -> None:
    """Compare the bytes of all files, in the order of their numbers, with those sent."""
    digest = hashlib.sha256()
    paths = sorted(folder.glob("*.mcap"), key=lambda path: path.stat().st_mtime_ns)
    soak.files = len(paths)
    for path in paths:
        for item in RecordingReader(path).items():
            if isinstance(item, Chunk):
                digest.update(item.data)
                soak.recorded_bytes += len(item.data)
    soak.is_equal = digest.digest() == sent.digest.digest()


_HEAD: Final = "minute  memory MB  descriptors  threads  of a core  latency ms median   99 %  load"


def _row(reading: Reading) -> str:
    median_ms, most_ms = reading.latency_ms
    return (
        f"{reading.minute:6.1f} {reading.memory_mb:10.1f} {reading.descriptors:12d} {reading.threads:8d} "
        f"{reading.cpu:10.1%} {median_ms:18.1f} {most_ms:6.0f} {reading.load:5.1f}"
    )


def report(soak: LiveSoak) -> Iterator[str]:
    """Yield the lines of the report."""
    yield _HEAD
    for reading in soak.readings:
        yield _row(reading)
    yield (
        f"sent {soak.sent_bytes} bytes, recorded {soak.recorded_bytes} in {soak.files} files, "
        f"{'equal' if soak.is_equal else 'DIFFERENT'}"
    )
    yield (
        f"revolutions: {soak.lines} lines of JSON, {soak.messages} messages from the broker; "
        f"pages: {soak.pages} served, {soak.refused_pages} refused"
    )
    yield f"clock set {soak.clock_steps} times, reported {soak.said_steps} times; exit status {soak.status}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=120.0)
    parser.add_argument("--readings", type=int, default=12)
    parser.add_argument("--split-s", type=float, default=300.0)
    arguments = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder, contextlib.suppress(KeyboardInterrupt):
        soak = run_live_soak(arguments.minutes, Path(folder), readings=arguments.readings, split_s=arguments.split_s)
        for line in [*report(soak), *soak.summary]:
            print(line, flush=True)


if __name__ == "__main__":
    main()
