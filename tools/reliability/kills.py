"""`kill -9` of `treadlink record` on a serial line: data on the wire 0.3 s earlier is in the file."""

import contextlib
import os
import select
import signal
import subprocess
import sys
import threading
import time
import tty
from bisect import bisect_right
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mcap.exceptions import McapError
from mcap.reader import make_reader
from mcap.records import Channel, Message
from mcap.stream_reader import StreamReader

from gateway.core.clock import ManualClock
from gateway.core.links.source import Chunk, open_source
from gateway.core.recording.reader import RecordingReader
from gateway.upkeep.repair import repair_recording

SAFE_S = 0.3
_START_TIMEOUT_S = 60.0


@dataclass(frozen=True, slots=True)
class Killed:
    """One killed recorder.

    Attributes:
        after_s: time from the first byte to the kill.
        sent: bytes on the wire at the kill.
        safe: bytes on the wire 0.3 s before it.
        ours: bytes that our reader finds.
        stock: bytes that the stock streaming reader finds in the file as it is.
        repaired: bytes that the stock indexed reader finds in the repaired file.
        age_s: age of the oldest byte lost, 0 when none was.
    """

    after_s: float
    sent: int
    safe: int
    ours: int
    stock: int
    repaired: int
    age_s: float


def hub_bytes(seconds: float) -> tuple[list[bytes], str]:
    """Return what four simulated wheels send in 10 ms each, and the vehicle."""
    source = open_source(f"sim:demo?speed=max&duration={seconds}", ManualClock())
    chunks = [item.data for item in source.items(threading.Event()) if isinstance(item, Chunk)]
    return chunks, source.vehicle_toml or ""


def kill_once(folder: Path, chunks: Sequence[bytes], after_s: float) -> Killed:
    """Record in another process, kill it `after_s` after its first byte, and read back the file.

    Raises:
        AssertionError: the bytes read back differ from those sent.
    """
    folder.mkdir()
    path = folder / "r.mcap"
    master, slave = os.openpty()
    tty.setraw(slave)
    os.set_blocking(master, False)
    command = [sys.executable, "-m", "gateway.core.cli", "record", f"serial://{os.ttyname(slave)}", "--out", str(path)]
    config = folder.parent / "vehicle.toml"
    process = subprocess.Popen(
        [*command, "--config", str(config)], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    )
    try:
        assert process.stderr is not None
        line = process.stderr.readline()
        while line and "connected" not in line:
            line = process.stderr.readline()
        assert "connected" in line, "the recorder did not start"
        times, totals = _send(master, chunks, after_s)
        os.kill(process.pid, signal.SIGKILL)
        killed_s = time.monotonic()
        process.wait(10)
    finally:
        if process.poll() is None:
            process.kill()
        if process.stderr is not None:
            process.stderr.close()
        os.close(master)
        os.close(slave)
    sent = b"".join(chunks)
    ours = b"".join(item.data for item in RecordingReader(path).items() if isinstance(item, Chunk))
    assert sent.startswith(ours), "what was recorded is not what was sent"
    stock = _stock_streaming(path)
    assert ours.startswith(stock)
    fixed = folder / "fixed.mcap"
    repair_recording(path, fixed)
    with fixed.open("rb") as file:
        read = make_reader(file, validate_crcs=True).iter_messages(topics=None)
        repaired = b"".join(message.data for _, channel, message in read if channel.topic.endswith("/raw"))
    assert sent.startswith(repaired)
    safe_at = bisect_right(times, killed_s - SAFE_S)
    first_lost = bisect_right(totals, len(ours))
    return Killed(
        after_s=after_s,
        sent=totals[-1] if totals else 0,
        safe=totals[safe_at - 1] if safe_at else 0,
        ours=len(ours),
        stock=len(stock),
        repaired=len(repaired),
        age_s=killed_s - times[first_lost] if first_lost < len(times) else 0.0,
    )


def _send(master: int, chunks: Sequence[bytes], for_s: float) -> tuple[list[float], list[int]]:
    """Write chunks in real time; return when each was on the wire, and the bytes up to it."""
    times: list[float] = []
    totals: list[int] = []
    total = 0
    begin = time.monotonic()
    for number, chunk in enumerate(chunks):
        due = begin + number * 0.01
        if due > begin + for_s:
            break
        time.sleep(max(0.0, due - time.monotonic()))
        view = memoryview(chunk)
        while view and time.monotonic() < begin + for_s:
            if select.select([], [master], [], 0.05)[1]:
                with contextlib.suppress(BlockingIOError):
                    written = os.write(master, view[:1024])
                    view = view[written:]
                    total += written
        if view:
            break
        times.append(time.monotonic())
        totals.append(total)
    time.sleep(max(0.0, begin + for_s - time.monotonic()))
    return times, totals


def _stock_streaming(path: Path) -> bytes:
    """Return the link bytes that the stock reader gives before it meets the missing end."""
    out = bytearray()
    raw: set[int] = set()
    with path.open("rb") as file, contextlib.suppress(McapError, EOFError):
        for record in StreamReader(file, validate_crcs=True).records:
            if isinstance(record, Channel) and record.topic.endswith("/raw"):
                raw.add(record.id)
            elif isinstance(record, Message) and record.channel_id in raw:
                out += record.data
    return bytes(out)


def kill_many(folder: Path, times: int, seed: int, workers: int = 3) -> list[Killed]:
    """Kill recorders at random moments, some at once."""
    rng = np.random.default_rng(seed)
    chunks, toml = hub_bytes(4.0)
    (folder / "vehicle.toml").write_text(toml)
    moments = rng.uniform(0.05, 3.0, times)
    with ThreadPoolExecutor(workers) as pool:
        return list(pool.map(lambda k: kill_once(folder / f"kill{k}", chunks, float(moments[k])), range(times)))
