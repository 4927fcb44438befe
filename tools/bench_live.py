"""CPU of a live session on a serial link, and processing time from samples to estimate.

Prints three tables:
  * share of one core that `treadlink live serial://...` takes for 4 wheels x 3 axes x 9600 Hz, as lines, with a
    recording and with the screen, fed through a pseudo-terminal by another process in real time, start-up left out;
  * by `--latency`, that share and the time from when the last byte that a result needs is due at the pseudo-terminal to
    its line on standard output. This is time of the clock: only a quiet machine gives figures to keep;
  * CPU time of the work on a chunk that completes revolutions, from its bytes to their estimates, at full speed.

With `--against GIT_REV` only the first table, of an older version too: both get the same bytes, alternating.
"""

import argparse
import contextlib
import fcntl
import math
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
from collections.abc import Callable, Iterable, Iterator
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np

from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.source import Chunk, open_source
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.core.session.latency import Latency
from tools.bench_throughput import THIS_TREE, best, checked_out, commit_of, ratios_line

WARM_UP_S = 4.0
COLUMNS, ROWS = 120, 40
KINDS: Final[dict[str, dict[str, bool]]] = {
    "live --plain": {},
    "live --plain --record": {"record": True},
    f"live, screen {COLUMNS} x {ROWS}": {"screen": True},
}
LATENCIES_S = (0.0, 0.1, 0.5)
# About the pace of the four wheels; the rest of a chunk of 10 ms.
_PIECE_BYTES, _PIECE_NS = 512, 1_500_000
# Less than a revolution, more than times of its start differ by.
_SAME_S = 0.01
# A frame has 32 bits of the hub's microseconds: who joins later knows its time but for whole turns of this counter.
_HUB_CLOCK_S = 2**32 * 1e-6
BINS_MS = (5, 10, 15, 20, 30, 50, 100, 200, 500, 1000)


def cpu_s(pid: int) -> float:
    """User and system time of a process and its threads, s."""
    fields = Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


Timed = list[tuple[float, bytes]]
"""Pieces with the time of the monotonic clock at which they were due or read."""


def timed_pieces(uri: str) -> Iterator[tuple[float, bytes]]:
    """Yield the bytes of a simulated hub in the pieces in which a serial link brings them, with their times, s."""
    for item in open_source(uri, ManualClock()).items(threading.Event()):
        if isinstance(item, Chunk):
            for number, first in enumerate(range(0, len(item.data), _PIECE_BYTES)):
                yield 1e-9 * (item.host_ns + _PIECE_NS * number), item.data[first : first + _PIECE_BYTES]


@cache
def hub_pieces(scenario: str, seconds: float) -> Timed:
    """Return the pieces of a simulated hub, made beforehand."""
    return list(timed_pieces(f"sim:{scenario}?speed=max&duration={seconds}"))


def feed(
    master: int,
    pieces: Iterable[tuple[float, bytes]],
    stop: threading.Event,
    written: Timed,
    lags_s: list[float] | None = None,
) -> None:
    """Write pieces in real time; note when each was due, for no hub waits as a write does, and its lag behind that."""
    begin_s: float | None = None
    for time_s, piece in pieces:
        if begin_s is None:
            begin_s = time.monotonic() - time_s
        due_s = begin_s + time_s
        if (wait_s := due_s - time.monotonic()) > 0.0:
            stop.wait(wait_s)
        view = memoryview(piece)
        while view:
            if stop.is_set():
                return
            try:
                view = view[os.write(master, view) :]
            except OSError:
                return
        if lags_s is not None:
            lags_s.append(time.monotonic() - due_s)
        written.append((due_s, piece))


def measure_process(
    scenario: str,
    seconds: float,
    *options: str,
    record: bool = False,
    screen: bool = False,
    tree: Path = THIS_TREE,
    held: Callable[[int], contextlib.AbstractContextManager[None]] = contextlib.nullcontext,
) -> tuple[float, str, Timed, Timed, float]:
    """Return the share of one core of a live session, its last link line, and what was written to it and by it.

    Last comes the largest time, s, by which a piece was written after it was due, warm-up left out.

    The modules are those of a tree. `held` is entered with the number of its process after the warm-up and left at the
    end of the measurement.
    """
    master, slave = os.openpty()
    tty.setraw(slave)
    port = os.ttyname(slave)
    toml = open_source(f"sim:{scenario}", ManualClock()).vehicle_toml
    pieces = hub_pieces(scenario, WARM_UP_S + seconds + 2)
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder) / "vehicle.toml"
        config.write_text(toml or "")
        package = "gateway.core.cli" if (tree / "gateway" / "core").is_dir() else "gateway.cli"
        command = [sys.executable, "-P", "-m", package, "live", f"serial://{port}?baudrate=921600"]
        command += ["--config", str(config), "--duration", str(WARM_UP_S + seconds + 2), *options]
        if record:
            command += ["--record", str(Path(folder) / "bench.mcap")]
        process, output = on_terminal(command, tree) if screen else as_lines([*command, "--plain"], tree)
        stop = threading.Event()
        written: Timed = []
        printed: Timed = []
        lags_s: list[float] = []
        feeder = threading.Thread(target=feed, args=(master, pieces, stop, written, lags_s), daemon=True)
        reader = threading.Thread(target=read_all, args=(output, printed))
        feeder.start()
        reader.start()
        time.sleep(WARM_UP_S)
        with held(process.pid):
            before, since = cpu_s(process.pid), time.monotonic()
            time.sleep(seconds)
            share = (cpu_s(process.pid) - before) / (time.monotonic() - since)
        # Who was held back works on what waits.
        process.wait(30 + seconds)
        stop.set()
        os.close(slave)
        os.close(master)
        feeder.join(5)
        reader.join(5)
    lines = b"".join(piece for _, piece in printed).decode(errors="replace").splitlines()
    link = next((line.strip() for line in reversed(lines) if " frames, " in line), "no link line")
    late = (lag_s for (due_s, _), lag_s in zip(written, lags_s, strict=False) if due_s > written[0][0] + WARM_UP_S)
    return share, link, written, printed, max(late, default=0.0)


def session_core(scenario: str, latency_s: float, **options: Any) -> SessionCore:
    """Return the core of a session with the vehicle of a scenario."""
    source = open_source(f"sim:{scenario}?speed=max", ManualClock())
    return SessionCore(parse_vehicle(source.vehicle_toml or "", scenario), latency_s=latency_s, **options)


def needed(scenario: str, written: Timed) -> dict[tuple[str, int], float]:
    """Return when the last byte was due that each result needs, by its wheel and the hub's time."""
    core = session_core(scenario, 0.0, estimators=("kinematic",))
    return {
        (result.position, round(result.revolution.start_s % _HUB_CLOCK_S / _SAME_S)): time_s
        for time_s, piece in written
        for result in core.take(Chunk("bench", round(time_s * 1e9), piece))
    }


def latencies_ms(scenario: str, written: Timed, printed: Timed) -> np.ndarray:
    """Return the time of every line of a revolution after the last byte that its result needs, ms, warm-up left out."""
    needed_s = needed(scenario, written)
    waits: list[float] = []
    rest = b""
    for time_s, piece in printed:
        *lines, rest = (rest + piece).split(b"\n")
        for words in map(bytes.split, lines):
            if not (len(words) > 2 and words[1].isdigit() and words[2].replace(b".", b"").isdigit()):
                continue
            # By the hub's time: a session that misses the first bytes counts revolutions from another one on.
            start = float(words[2]) % _HUB_CLOCK_S / _SAME_S
            keys = [(words[0].decode(), near) for near in (math.floor(start), math.ceil(start))]
            since_s = next((needed_s[key] for key in keys if key in needed_s), -math.inf)
            if since_s > written[0][0] + WARM_UP_S:
                waits.append(1e3 * (time_s - since_s))
    return np.array(waits)


def scheduled(scenario: str, seconds: float, latency_s: float) -> tuple[float, np.ndarray]:
    """Return the share of a core that the session's core takes, and latencies, ms, with CPU time for that of the clock.

    Reads and rounds come when they are due and the work before them is done; the work takes its CPU time. Hand-over
    between threads and output are left out. Other work on the machine matters little.
    """
    written = hub_pieces(scenario, WARM_UP_S + seconds)
    needed_s, latency, core = needed(scenario, written), Latency(latency_s), session_core(scenario, latency_s)
    begin_s = written[0][0] + WARM_UP_S
    waits: list[float] = []
    reads: Timed = []
    read_s = round_s = free_s = -math.inf
    work_s = 0.0
    gathered = b""
    for (time_s, piece), (next_s, _) in pairwise([*written, (math.inf, b"")]):
        gathered += piece
        read_s = max(read_s, time_s)
        if next_s <= read_s:
            continue
        reads.append((read_s, gathered))
        gathered, read_s, round_s = b"", read_s + latency.read_s, max(round_s, read_s)
        if next_s <= round_s:
            continue
        for arrived_s, data in reads:
            before_s = time.thread_time()
            results = core.take(Chunk("bench", round(arrived_s * 1e9), data))
            took_s = time.thread_time() - before_s
            free_s = max(free_s, round_s) + took_s
            work_s += took_s if arrived_s > begin_s else 0.0
            for result in results:
                since_s = needed_s.get((result.position, round(result.revolution.start_s / _SAME_S)), -math.inf)
                if since_s > begin_s:
                    waits.append(1e3 * (free_s - since_s))
        reads.clear()
        round_s += latency.round_s
    return work_s / (written[-1][0] - begin_s), np.array(waits)


def print_waits(head: str, waits: np.ndarray) -> None:
    """Print the distribution of latencies in ms."""
    p50, p99, top = np.percentile(waits, (50, 99, 100))
    print(f"  {head}   n {len(waits):5}   median {p50:6.1f}   99 % {p99:6.1f}   max {top:6.1f}")
    counts = np.histogram(waits, (0, *BINS_MS, np.inf))[0]
    print("    " + "  ".join(f"<{end} {count}" for end, count in zip((*BINS_MS, "inf"), counts, strict=True)))


def print_latencies(scenario: str, seconds: float, *, by_work: bool) -> None:
    """Print CPU and latency of sessions by `--latency`."""
    print("Result of a revolution after the last byte that it needs, on schedule, with the CPU time of the work (ms)")
    for latency_s in LATENCIES_S:
        share, waits = scheduled(scenario, seconds, latency_s)
        print_waits(f"--latency {latency_s:<4} core alone {100 * share:4.1f} %", waits)
    if by_work:
        return
    print("Line of a revolution after the last byte that it needs (ms, of the clock), by --latency")
    for latency_s in LATENCIES_S:
        share, link, written, printed, _ = measure_process(scenario, seconds, "--latency", str(latency_s))
        waits = latencies_ms(scenario, written, printed)
        print_waits(f"--latency {latency_s:<4} {100 * share:4.1f} % of one core", waits)
        print(f"    {link}")


def as_lines(command: list[str], tree: Path) -> tuple[subprocess.Popen[bytes], int]:
    """Start a command whose output is a pipe; return its reading end too."""
    read_end, write_end = os.pipe()
    process = subprocess.Popen(command, stdout=write_end, env={**os.environ, "PYTHONPATH": str(tree)})
    os.close(write_end)
    return process, read_end


def on_terminal(command: list[str], tree: Path) -> tuple[subprocess.Popen[bytes], int]:
    """Start a command on a terminal of COLUMNS x ROWS; return the terminal's other end too."""
    other_end, terminal = os.openpty()
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", ROWS, COLUMNS, 0, 0))
    environment = {**os.environ, "TERM": "xterm-256color", "PYTHONPATH": str(tree)}
    process = subprocess.Popen(
        command, stdin=terminal, stdout=terminal, stderr=terminal, env=environment, start_new_session=True
    )
    os.close(terminal)
    return process, other_end


def read_all(output: int, printed: Timed) -> None:
    """Collect what a command prints until it ends."""
    with contextlib.suppress(OSError):  # how Linux reports the end of a pseudo-terminal
        while piece := os.read(output, 1 << 16):
            printed.append((time.monotonic(), piece))


def measure_work(scenario: str, seconds: float) -> dict[str, np.ndarray]:
    """Return the CPU time of the work on each chunk, ms, in a session with recording, by whether it gave results."""
    source = open_source(f"sim:{scenario}?speed=max&duration={seconds}", ManualClock())
    times: dict[str, list[float]] = {"chunk with revolution": [], "chunk without": [], "per revolution": []}
    with tempfile.TemporaryDirectory() as folder:
        recorder = RecordingWriter(Path(folder) / "bench.mcap", start_ns=0)
        core = session_core(scenario, 0.0, recorder=recorder)
        for item in source.items(threading.Event()):
            begin = time.thread_time()
            results = core.take(item)
            took = (time.thread_time() - begin) * 1e3
            times["chunk with revolution" if results else "chunk without"].append(took)
            if results:
                times["per revolution"].append(took / len(results))
        core.finish()
    return {name: np.array(values) for name, values in times.items()}


def print_against(revision: str, scenario: str, seconds: float, rounds: int) -> None:
    """Print the shares of a core of an older version and of this one, and their ratio."""
    print(f"{commit_of(revision)} against now, {commit_of('HEAD')} with what is not committed; least of {rounds}")
    with checked_out(revision) as trees:
        for kind, options in KINDS.items():
            runs: list[list[dict[str, float]]] = [[] for _ in trees]
            for _ in range(rounds):
                for of_tree, tree in zip(runs, trees.values(), strict=True):
                    share, *_ = measure_process(scenario, seconds, tree=tree, **options)
                    of_tree.append({"cpu_s": share * seconds})
            shares = " to ".join(f"{100 * best(of_tree)['cpu_s'] / seconds:.1f} %" for of_tree in runs)
            print(f"  {kind:22} {shares} of one core: {ratios_line(*runs)}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenario", default="demo")
    parser.add_argument("--seconds", type=float, default=20.0)
    parser.add_argument("--work", action="store_true", help="only the CPU time of the work")
    parser.add_argument("--latency", action="store_true", help="only CPU and latency by --latency")
    parser.add_argument("--against", metavar="GIT_REV", help="only the share of a core, of this older version too")
    parser.add_argument("--rounds", type=int, default=5, help="runs of each, with --against")
    arguments = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    size = "4 wheels x 3 axes x 9600 Hz, " if arguments.scenario == "demo" else ""
    print(f"{size}scenario '{arguments.scenario}', {arguments.seconds:g} s of real time")
    if arguments.against:
        print_against(arguments.against, arguments.scenario, arguments.seconds, arguments.rounds)
        return
    for kind, options in KINDS.items() if not (arguments.work or arguments.latency) else ():
        share, link, *_ = measure_process(arguments.scenario, arguments.seconds, **options)
        print(f"  {kind:22} {100 * share:4.1f} % of one core   {link}")
    print_latencies(arguments.scenario, arguments.seconds, by_work=arguments.work)
    if arguments.latency:
        return
    print("CPU time of the work on a chunk, from its bytes to the estimates of its revolutions (ms)")
    for name, values in measure_work(arguments.scenario, arguments.seconds).items():
        p50, p99, top = np.percentile(values, 50), np.percentile(values, 99), values.max()
        print(f"  {name:22} n {len(values):6}   median {p50:6.2f}   99 % {p99:6.2f}   max {top:6.2f}")


if __name__ == "__main__":
    main()
