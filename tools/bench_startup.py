"""CPU of the start of `treadlink`: help of every command, a completion, short runs, and the interpreter alone.

Each figure is user and system time of a fresh process, the least of several.
"""

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
from pathlib import Path

from gateway.core.cli import COMMANDS
from tools.bench_throughput import CASES, record


def cpu_s(arguments: list[str], environment: dict[str, str] | None = None) -> float:
    """User and system time of one run of the interpreter, s."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(
        [sys.executable, *arguments], env={**os.environ, **(environment or {})}, stdout=subprocess.DEVNULL, check=True
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime - before.ru_utime + after.ru_stime - before.ru_stime


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=5)
    runs = range(parser.parse_args().runs)
    print(f"{platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}; CPU of a start, s")
    bare_s = min(cpu_s(["-c", "pass"]) for _ in runs)
    print(f"  {'python alone':28} {bare_s:.3f}")
    own_s = min(cpu_s(["-m", "gateway.core.cli", "--help"]) for _ in runs)
    print(f"  {'treadlink --help':28} {own_s:.3f}")
    for name in COMMANDS:
        help_s = min(cpu_s(["-m", "gateway.core.cli", name, "--help"]) for _ in runs)
        print(f"  {f'treadlink {name} --help':28} {help_s:.3f}")
    completion = {"_TREADLINK_COMPLETE": "bash_complete", "COMP_WORDS": "treadlink e", "COMP_CWORD": "1"}
    completed_s = min(cpu_s(["-m", "gateway.core.cli"], completion) for _ in runs)
    print(f"  {'completion of a command':28} {completed_s:.3f}")
    with tempfile.TemporaryDirectory() as folder:
        recording = next(iter(record(Path(folder), 5.0, CASES[:1]).values()))
        estimation = ["estimate", str(recording)]
        runs_of = {
            "doctor": ["doctor"],
            "estimate, 5 s of four wheels": estimation,
            "the same with --parquet": [*estimation, "--parquet", f"{folder}/out.parquet", "--force"],
        }
        for name, words in runs_of.items():
            print(f"  {name:28} {min(cpu_s(['-m', 'gateway.core.cli', *words]) for _ in runs):.3f}")


if __name__ == "__main__":
    main()
