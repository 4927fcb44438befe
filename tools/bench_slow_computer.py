"""A live session on a part of one core, as on a computer of a car: what it loses, what it says and how late it is.

`treadlink live` reads the simulated hub of the demo car in real time from a pseudo-terminal. After the warm-up it has
one processor, and a control group holds it to a share of that; the simulator runs outside. At the end of the
measurement it has the whole machine again and prints what waits. A line is late by the time since the last byte that
its result needs was due.

Run as root: `python -m tools.bench_slow_computer`
"""

import argparse
import os
import platform
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np

from tools.bench_live import latencies_ms, measure_process
from tools.bench_throughput import scenario_of

_GROUPS: Final = Path("/sys/fs/cgroup")
# Short, so that a process runs often and little, as on a slow core, and not 10 ms in every 100.
_PERIOD_US: Final = 20_000
_LEAST_US: Final = 1_000


@contextmanager
def held_to(share: float, pid: int) -> Iterator[None]:
    """Hold a process and its threads to a share of the first processor by a control group, version 1 or 2.

    Raises:
        SystemExit: this machine permits no control groups.
    """
    is_first_version = (_GROUPS / "cpu").is_dir()
    parent = _GROUPS / "cpu" if is_first_version else _GROUPS
    group = parent / f"treadlink-bench-{os.getpid()}"
    quota_us = max(round(share * _PERIOD_US), _LEAST_US)
    try:
        group.mkdir()
        if is_first_version:
            (group / "cpu.cfs_period_us").write_text(f"{_PERIOD_US}")
            (group / "cpu.cfs_quota_us").write_text(f"{quota_us}")
        else:
            (group / "cpu.max").write_text(f"{quota_us} {_PERIOD_US}")
    except OSError as error:
        if group.is_dir():
            group.rmdir()
        raise SystemExit(f"a share of a core needs a control group: {error}. Run as root.") from error
    before = _group_of(pid, is_first_version)
    (group / "cgroup.procs").write_text(f"{pid}")
    _run_on(pid, {0})
    try:
        yield
    finally:
        with suppress(ProcessLookupError, FileNotFoundError):  # it has ended
            (before / "cgroup.procs").write_text(f"{pid}")
            _run_on(pid, os.sched_getaffinity(0))
        group.rmdir()


def _group_of(pid: int, is_first_version: bool) -> Path:
    """Return the folder of a process's control group of the processor."""
    for line in Path(f"/proc/{pid}/cgroup").read_text().splitlines():
        _, controllers, path = line.split(":", 2)
        if is_first_version and "cpu" in controllers.split(","):
            return _GROUPS / "cpu" / path.lstrip("/")
        if not is_first_version and not controllers:
            return _GROUPS / path.lstrip("/")
    raise SystemExit("this process is in no control group of the processor")


def _run_on(pid: int, processors: set[int]) -> None:
    for thread in Path(f"/proc/{pid}/task").iterdir():
        os.sched_setaffinity(int(thread.name), processors)


def print_session(wheels: int, rate_hz: int, share: float, seconds: float, options: tuple[str, ...]) -> None:
    """Print what a session with this share of a core took, lost and said."""
    with tempfile.TemporaryDirectory() as folder:
        scenario = Path(folder, "car.toml")
        scenario.write_text(scenario_of(wheels, rate_hz))
        uri = str(scenario)
        took, link, written, printed, lag_s = measure_process(uri, seconds, *options, held=partial(held_to, share))
        late_s = 1e-3 * latencies_ms(uri, written, printed)
    print(f"{wheels} x {rate_hz} Hz, share {100 * share:.0f} % {' '.join(options)}: took {100 * took:.1f} % of a core")
    print(f"  {link}; bytes waited for up to {lag_s:.3f} s before it, which a UART's buffer must hold")
    if late_s.size:
        print(f"  {late_s.size} lines, late by {np.median(late_s):.2f} s at the median, {late_s.max():.2f} s at most")
    else:
        print("  no line of a revolution after the warm-up")
    said = b"".join(piece for _, piece in printed).decode(errors="replace").splitlines()
    for line in dict.fromkeys(line for line in said if line.startswith("#") and "computer" in line):
        print(f"  {line}", flush=True)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--share", type=float, default=0.1, help="of one core (default: 0.1)")
    parser.add_argument("--wheels", type=int, action="append", help="number of wheels (default: 1, then 4)")
    parser.add_argument("--rate", type=int, default=9600, help="samples a second of each axis (default: 9600)")
    parser.add_argument("--seconds", type=float, default=60.0, help="of real time for each (default: 60)")
    parser.add_argument("--latency", default="0", help="of the session (default: 0)")
    arguments = parser.parse_args()
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    for wheels in arguments.wheels or (1, 4):
        print_session(wheels, arguments.rate, arguments.share, arguments.seconds, ("--latency", arguments.latency))


if __name__ == "__main__":
    main()
