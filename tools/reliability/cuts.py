"""Power cuts: recordings truncated anywhere or with torn last pages, and full disks."""

import resource
import shutil
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from gateway.core.clock import ManualClock
from gateway.core.config.vehicle import parse_vehicle
from gateway.core.links.source import Chunk, LinkItem, open_source
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter
from gateway.core.session.core import SessionCore
from gateway.upkeep.repair import repair_recording

_PAGE = 4096
_LAST_PAGES = 64
_LIMITED = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[1]), int(sys.argv[1])))
from gateway.core.cli import main
sys.argv = ["treadlink", *sys.argv[2:]]
main()
"""


def _bytes(items: Iterator[LinkItem] | list[LinkItem]) -> bytes:
    return b"".join(item.data for item in items if isinstance(item, Chunk))


def record(folder: Path, seconds: float) -> tuple[Path, bytes]:
    """Return a recording of four wheels and the recorded bytes."""
    source = open_source(f"sim:demo?speed=max&duration={seconds}", ManualClock())
    items = list(source.items(threading.Event()))
    path = folder / "whole.mcap"
    core = SessionCore(
        parse_vehicle(source.vehicle_toml or "", "demo"), recorder=RecordingWriter(path, start_ns=items[0].host_ns)
    )
    for item in items:
        core.take(item)
    core.finish()
    return path, _bytes(items)


def report(folder: Path, times: int, seed: int = 1) -> Iterator[str]:
    """Yield the results of `times` truncations, as many torn ends, and full disks."""
    seconds = 20.0
    path, sent = record(folder, seconds)
    whole = path.read_bytes()
    rng = np.random.default_rng(seed)
    wrong, missing = 0, []
    target, fixed = folder / "cut.mcap", folder / "fixed.mcap"
    for size in rng.integers(100, len(whole), times).tolist():
        target.write_bytes(whole[:size])
        got = _bytes(RecordingReader(target).items())
        wrong += not sent.startswith(got)
        missing.append((size / len(whole) - len(got) / len(sent)) * seconds)
    yield (
        f"{times} truncations anywhere: {wrong} read back wrong; read back is the data up to the cut, "
        f"{max(0.0, *missing):.2f} s less at most"
    )
    wrong, remaining, unreported = 0, [], 0
    for _ in range(times):
        torn = bytearray(whole)
        first = len(whole) // _PAGE - _LAST_PAGES
        hit = rng.choice(np.arange(first, first + _LAST_PAGES), _LAST_PAGES // 4, replace=False)
        for page in hit.tolist():
            torn[page * _PAGE : (page + 1) * _PAGE] = rng.bytes(_PAGE) if rng.random() < 0.5 else bytes(_PAGE)
        target.write_bytes(torn)
        reader = RecordingReader(target)
        safe = int(0.9 * first * _PAGE * len(sent) / len(whole))
        wrong += _bytes(reader.items())[:safe] != sent[:safe]
        unreported += reader.damage is None
        repair_recording(target, fixed)
        remaining.append(len(_bytes(RecordingReader(fixed).items())) / len(sent))
        fixed.unlink()
    yield (
        f"{times} torn ends ({_LAST_PAGES // 4} of the last {_LAST_PAGES} pages zeros or noise): {wrong} read back "
        f"wrong before them, {unreported} not reported; repair keeps {100 * min(remaining):.1f} % or more of the "
        f"link's bytes"
    )
    yield from _full(folder)


def _full(folder: Path) -> Iterator[str]:
    small = folder / "small"
    small.mkdir()
    mount = shutil.which("mount")
    command = [mount or "", "-t", "tmpfs", "-o", "size=1m", "tmpfs", str(small)]
    if mount and not subprocess.run(command, capture_output=True, check=False).returncode:
        try:
            yield _run("tmpfs of 1 MB", small / "r.mcap", resource.RLIM_INFINITY)
        finally:
            subprocess.run(["umount", str(small)], check=True)
    else:
        yield "tmpfs of 1 MB: not run, mounting takes root"
    yield _run("file size limit of 1 MB", folder / "limited.mcap", 1_000_000)


def _run(name: str, path: Path, limit: int) -> str:
    command = ["live", "sim:demo?speed=max&duration=20", "--plain", "--record", str(path)]
    done = subprocess.run(
        [sys.executable, "-c", _LIMITED, str(limit), *command], capture_output=True, text=True, check=False
    )
    notice = next((line for line in done.stdout.splitlines() if "RECORDING STOPPED" in line), "no notice")
    lines = sum("km/h" in line or "±" in line for line in done.stdout.splitlines())
    read = len(_bytes(RecordingReader(path).items()))
    size = path.stat().st_size
    return f"{name}: {lines} lines printed; {read} link bytes read back from a file of {size}; notice: {notice}"
