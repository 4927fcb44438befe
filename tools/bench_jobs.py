"""Time of `treadlink estimate` for several recordings, one after another and in processes, with equal output."""

from __future__ import annotations

import argparse
import os
import platform
import subprocess
import sys
import tempfile
import time
from pathlib import Path

RECORDINGS = 10


def treadlink(*arguments: object) -> bytes:
    """Output of a command."""
    return subprocess.run(
        [sys.executable, "-m", "gateway.cli", *map(str, arguments)], stdout=subprocess.PIPE, check=True
    ).stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=30.0, help="length of a recording")
    parser.add_argument("--rounds", type=int, default=2, help="runs of each kind, alternating; the shortest counts")
    arguments = parser.parse_args()
    jobs = os.cpu_count() or 1
    with tempfile.TemporaryDirectory() as folder:
        recordings = [Path(folder) / f"{number}.mcap" for number in range(RECORDINGS)]
        for seed, path in enumerate(recordings):
            treadlink("simulate", "demo", "--seed", seed, "--duration", arguments.seconds, "--out", path)
        times: dict[int, list[float]] = {1: [], jobs: []}
        outputs = set()
        for _ in range(arguments.rounds):
            for number, taken in times.items():
                table = Path(folder) / "out.csv"
                begin = time.perf_counter()
                printed = treadlink("estimate", *recordings, "--csv", table, "--force", "--jobs", number)
                taken.append(time.perf_counter() - begin)
                outputs.add((printed, table.read_bytes()))
    print(f"{platform.machine()}, {jobs} cores, Python {platform.python_version()}")
    print(f"{RECORDINGS} recordings of {arguments.seconds:g} s, 4 wheels x 3 axes x 9600 Hz, with a CSV table")
    serial_s, parallel_s = min(times[1]), min(times[jobs])
    print(f"  --jobs 1   {serial_s:6.1f} s")
    print(f"  --jobs {jobs}   {parallel_s:6.1f} s   {serial_s / parallel_s:.2f} x as fast")
    print(f"  outputs {'equal' if len(outputs) == 1 else 'DIFFERENT'}")


if __name__ == "__main__":
    main()
