"""Soak of `treadlink live` in real time with all its outputs, while the clock is set again and again.

Four wheels come through a pseudo-terminal, and one after the other is silent for a while. The session records in files
of a few minutes, writes lines of JSON and of Influx, sends to a CAN bus and to a broker that swallows a window of
confirmations between two readings, and serves Foxglove, Prometheus and its page, to which clients come and go. One tab
of a browser stays open. A stranger holds as many idle connections as it gets. The wall clock steps by up to 58 days,
both ways. At equal steps of time: memory, descriptors, threads, processor time, the time from the last byte that a
revolution needs to its line, and the memory of the tab. At the end every byte that was sent must be in the recordings,
in order.
"""

import argparse
import contextlib
import hashlib
import itertools
import json
import math
import os
import resource
import signal
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

sys.path.insert(0, str(Path(__file__).parents[2]))

from gateway.core.clock import ManualClock
from gateway.core.links.source import Chunk, open_source
from gateway.core.recording.reader import RecordingReader
from gateway.publishing.mqtt import CONFIRM_S, WINDOW
from tools.bench_live import cpu_s, feed, latencies_ms, read_all, timed_pieces
from tools.browser import CHROMIUM, Browser, Tab
from tools.mqtt_broker import PROGRAM, Broker, Listener, free_port
from tools.reliability.visitors import Stranger, SwallowingRelay, Visitors, visit_metrics, visit_page, visit_viewer

_SCENARIO: Final = "demo"
_SHIM: Final = Path(__file__).with_name("shifted_clock.c")
_DAY_S: Final = 86400
_STEPS_S: Final = (3600, -7200, 58 * _DAY_S, -58 * _DAY_S, -30, 40, -_DAY_S)
"""Changes of the wall clock, one after the other: a wrong time zone, a clock without battery, small corrections."""
_WINDOW_S: Final = 30.0
_DESCRIPTORS: Final = 1024
_SILENT_S: Final = 20.0
_BETWEEN_S: Final = 120.0
_BUS: Final = "can:udp_multicast:239.74.163.2?port=43219&hop_limit=0"
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
        tab_mb: memory of the page's objects in the browser.
    """

    minute: float
    memory_mb: float
    descriptors: int
    threads: int
    cpu: float
    latency_ms: tuple[float, float]
    load: float
    tab_mb: float


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
        clients: pages, viewers and scrapes.
        strange: connections of the stranger.
        swallowed: confirmations of the broker that did not arrive.
        tab_errors: errors of the page in the browser.
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
    clients: list[Visitors] = field(default_factory=list)
    strange: int = 0
    swallowed: int = 0
    tab_errors: list[str] = field(default_factory=list)
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


def _shim(folder: Path) -> Path:
    library = folder / "shifted_clock.so"
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", str(library), str(_SHIM)], check=True)
    return library


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
    steps_s = itertools.accumulate(itertools.cycle(_STEPS_S))
    uri = f"sim:{_SCENARIO}?speed=max&fault={_absences(minutes)}"
    config = folder / "vehicle.toml"
    config.write_text(open_source(uri, ManualClock()).vehicle_toml or "")
    master, slave = os.openpty()
    tty.setraw(slave)
    broker = Broker(folder).start() if PROGRAM else None
    topics = "soak/wheel/+/revolution"
    listener = Listener(broker.port, topics, lambda sent: b"%d" % json.loads(sent)["index"]) if broker else None
    relay = SwallowingRelay(broker.port) if broker else None
    ports = [free_port() for _ in range(3)]
    command = [sys.executable, "-m", "gateway.core.cli", "live", f"serial://{os.ttyname(slave)}?baudrate=921600"]
    command += f"--plain --config {config} --record {folder}/recordings --split {round(split_s)}s".split()
    outputs = [f"jsonl:{folder}/soak.jsonl", f"influx:{folder}/soak.lp", f"web://127.0.0.1:{ports[0]}", _BUS]
    outputs += [f"foxglove://127.0.0.1:{ports[1]}", f"prometheus://127.0.0.1:{ports[2]}"]
    outputs += [f"mqtt://127.0.0.1:{relay.port}/soak?discovery=off"] if relay else []
    for output in outputs:
        command += ["--publish", output]
    (folder / "recordings").mkdir()
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        env={**os.environ, "LD_PRELOAD": str(_shim(folder)), "TREADLINK_CLOCK_SHIFT": str(shift)},
    )
    resource.prlimit(process.pid, resource.RLIMIT_NOFILE, (_DESCRIPTORS, _DESCRIPTORS))
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

    def disturb() -> None:
        with shift.open("r+b") as file:  # mapped by the program, so not truncated
            file.write(struct.pack("=q", 10**9 * next(steps_s)))
        soak.clock_steps += 1
        if relay and (60.0 * minutes / readings > 3 * CONFIRM_S or not relay.swallowed):
            relay.to_swallow = WINDOW

    stranger = browser = tab = None
    try:
        _wait_for(lambda: (b"".join(piece for _, piece in printed)).decode() + "".join(said), "connected")
        for visit, port in zip((visit_page, visit_viewer, visit_metrics), ports, strict=True):
            soak.clients.append(Visitors(visit, port))
        if CHROMIUM:
            browser = Browser(folder / "browser")
            tab = browser.tab()
            tab.open(f"http://127.0.0.1:{ports[0]}/")
        stranger = Stranger(ports)
        feeder = threading.Thread(target=feed, args=(master, timed_pieces(uri), stop, sent), daemon=True)
        feeder.start()
        _read_regularly(soak, process.pid, 60.0 * minutes / readings, readings, disturb, sent, printed, tab)
        soak.tab_errors = tab.errors if tab else []
        stop.set()
        feeder.join(_END_S)
        time.sleep(2.0)
        for client in soak.clients:
            client.close()
        process.send_signal(signal.SIGTERM)  # SIGINT is ignored by what a shell starts in the background
        soak.status = process.wait(_DRAIN_S)
    finally:
        stop.set()
        if stranger:
            stranger.close()
            soak.strange = stranger.connections
        if browser:
            browser.close()
        if process.poll() is None:
            process.kill()
        for thread in threads:
            thread.join(_END_S)
        os.close(slave)
        os.close(master)
        if listener:
            soak.messages = len({(topic, index) for topic, _, index in listener.messages})
            listener.close()
        if relay:
            soak.swallowed = relay.swallowed
            relay.close()
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


def _absences(minutes: float) -> str:
    """Return faults: one sensor after the other is silent for a while."""
    times_s = [_BETWEEN_S * (number + 1) for number in range(int(60.0 * minutes / _BETWEEN_S))]
    return ";".join(
        f"silence:part=1,wheel={number % 4},at={at_s},for={_SILENT_S}" for number, at_s in enumerate(times_s)
    )


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
    step_s: float,
    readings: int,
    disturb: Callable[[], None],
    sent: _SentPieces,
    printed: MutableSequence[tuple[float, bytes]],
    tab: Tab | None,
) -> None:
    """Take readings at equal steps of time, with a disturbance halfway between them."""
    before_cpu_s, before_s = cpu_s(pid), time.monotonic()
    begin_s = before_s
    for number in range(1, readings + 1):
        time.sleep(max(0.0, begin_s + (number - 0.5) * step_s - time.monotonic()))
        disturb()
        time.sleep(max(0.0, begin_s + number * step_s - time.monotonic()))
        window, since_s = sent.window(), time.monotonic() - 2 * _WINDOW_S
        lines = [piece for piece in tuple(printed) if piece[0] > since_s]
        now_cpu_s, now_s = cpu_s(pid), time.monotonic()
        reading = Reading(
            (now_s - begin_s) / 60.0,
            _status(pid, "VmRSS") / 1024,
            len([*Path(f"/proc/{pid}/fd").iterdir()]),
            _status(pid, "Threads"),
            (now_cpu_s - before_cpu_s) / (now_s - before_s),
            _percentiles(latencies_ms(_SCENARIO, window, lines)),
            os.getloadavg()[0],
            _memory_mb(tab) if tab else math.nan,
        )
        before_cpu_s, before_s = now_cpu_s, now_s
        soak.readings.append(reading)
        print(_row(reading), file=sys.stderr, flush=True)


def _memory_mb(tab: Tab) -> float:
    tab.call("HeapProfiler.collectGarbage")
    return float(tab.call("Runtime.getHeapUsage")["usedSize"] / 1e6)


def _percentiles(waits_ms: np.ndarray) -> tuple[float, float]:
    median, high = np.percentile(waits_ms, (50, 99)) if len(waits_ms) else (math.nan, math.nan)
    return float(median), float(high)


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


_HEAD: Final = "minute  memory MB  descriptors  threads  of a core  latency ms median   99 %  load  tab MB"


def _row(reading: Reading) -> str:
    median_ms, most_ms = reading.latency_ms
    return (
        f"{reading.minute:6.1f} {reading.memory_mb:10.1f} {reading.descriptors:12d} {reading.threads:8d} "
        f"{100 * reading.cpu:8.1f} % {median_ms:18.1f} {most_ms:6.0f} {reading.load:5.1f} {reading.tab_mb:7.2f}"
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
        f"revolutions: {soak.lines} lines of JSON, {soak.messages} from the broker, which swallowed "
        f"{soak.swallowed} confirmations"
    )
    served = ", ".join(f"{each.served} (failed: {each.refused or 'none'})" for each in soak.clients)
    yield (
        f"visits of page, viewer, scrapes: {served}; a stranger made {soak.strange} "
        f"connections; errors of the tab: {soak.tab_errors or 'none'}"
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
