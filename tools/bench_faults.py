"""Injected faults and their consequences.

`--full` runs the documented sizes (hours); without it everything runs small (minutes). `--only` picks sections.
"""

import argparse
import os
import platform
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from tools.reliability import cuts, kills, named, noise, sensors


def noise_report(frames: int) -> Iterator[str]:
    each = frames // len(noise.NOISES)
    total = noise.Outcome()
    heads = ("frames", "intact", "delivered")
    yield " " * 22 + "".join(f" {head:>9s}" for head in heads) + " repeated  corrupt  lost  delay"
    for kind in noise.NOISES:
        batch = noise.through_batch(kind, each, 1)
        stream = noise.through_stream(kind, max(3000, each // 50), 1, largest_chunk=8)
        yield (
            f"{kind.name:22s} {batch.sent:9d} {batch.intact:9d} {batch.delivered:9d} {batch.duplicates:8d} "
            f"{batch.corrupt_accepted + stream.corrupt_accepted:8d} {batch.intact_lost + stream.intact_lost:5d} "
            f"{stream.worst_delay_bytes:4d} B"
        )
        total.sent += batch.sent + stream.sent
        total.corrupt_accepted += batch.corrupt_accepted + stream.corrupt_accepted
        total.intact_lost += batch.intact_lost + stream.intact_lost
        total.worst_delay_bytes = max(total.worst_delay_bytes, stream.worst_delay_bytes)
    yield (
        f"{total.sent} frames in all: {total.corrupt_accepted} corrupt accepted, {total.intact_lost} intact lost; "
        f"an intact frame is out at most {total.worst_delay_bytes} bytes after its end (frame: {noise.FRAME_BYTES})"
    )


def kill_report(times: int) -> Iterator[str]:
    with tempfile.TemporaryDirectory() as folder:
        all_killed = kills.kill_many(Path(folder), times, 1)
    ages = np.array([killed.age_s for killed in all_killed])
    short = sum(killed.ours < killed.safe for killed in all_killed)
    stock = sum(killed.stock < killed.safe for killed in all_killed)
    repaired = sum(killed.repaired < killed.safe for killed in all_killed)
    yield (
        f"{times} kills: {short} lost a byte older than {kills.SAFE_S} s (stock reader {stock}, after repair "
        f"{repaired}); oldest byte lost: median {np.median(ages):.3f} s, most {ages.max():.3f} s"
    )


def cut_report(times: int) -> Iterator[str]:
    with tempfile.TemporaryDirectory() as folder:
        yield from cuts.report(Path(folder), times)


# name: (function, default size, size with --full)
SECTIONS: dict[str, tuple[Callable[[int], Iterator[str]], int, int]] = {
    "noise": (noise_report, 200_000, 10_000_000),
    "kills": (kill_report, 6, 200),
    "cuts": (cut_report, 30, 300),
    "named": (lambda _: named.report(), 0, 0),
    "sensors": (lambda _: sensors.report(), 0, 0),
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true")
    parser.add_argument("--only", nargs="+", choices=list(SECTIONS), default=list(SECTIONS))
    parser.add_argument("--size", type=int, help="of the sections chosen: frames, kills, cuts")
    arguments = parser.parse_args()
    print(
        f"{platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}, "
        f"Python {platform.python_version()}"
    )
    for name in arguments.only:
        run, small, full = SECTIONS[name]
        begin = time.perf_counter()
        print(f"\n== {name}", flush=True)
        for line in run(arguments.size or (full if arguments.full else small)):
            print(line, flush=True)
        print(f"({time.perf_counter() - begin:.0f} s)", flush=True)


if __name__ == "__main__":
    main()
