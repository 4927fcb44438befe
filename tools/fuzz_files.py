"""Fuzz of everything that the program reads, with seeded changes of good inputs.

    python -m tools.fuzz_files --kind mat --count 100000 --seed 1
    python -m tools.fuzz_files                                       # every kind, a short run
    python -m tools.fuzz_files --kind mat --seed 1 --only 1234       # one case again, with its traceback

Each case ends with success or with a message for the user. Anything else is a failure: a traceback, a warning, a
crash of the process, more than MEMORY_MB of further memory, more than LIMIT_S seconds of computing. A failing input is
kept in `build/fuzz`. The parsers of foreign files have a process of their own, which serves many cases; its crash by a
signal is a message, counted, and the next case gets a new process.
"""

import argparse
import faulthandler
import json
import math
import os
import signal
import subprocess
import sys
import tempfile
import time
import traceback
import warnings
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from pathlib import Path

import numpy as np

from tools.reliability.fuzz_targets import TARGETS, parser_crashes
from tools.reliability.mutations import mutate

MEMORY_MB = 256
LIMIT_S = 20
_WAITING_SHARE = 10
_SHORT_COUNT = 200
_SAVED = Path("build/fuzz")


class _TooSlowError(BaseException):
    """Raised by the alarm, so that no handler of errors catches it."""


@dataclass
class Outcome:
    """Counts of a run.

    Attributes:
        accepted: cases that were read.
        rejected: cases that ended with a message.
        crashes: those among them that crashed the process of a foreign parser.
        failures: number and description of each failed case.
        slowest_s: longest time of a case.
    """

    accepted: int = 0
    rejected: int = 0
    crashes: list[int] = field(default_factory=list)
    failures: list[tuple[int, str]] = field(default_factory=list)
    slowest_s: float = 0.0

    @property
    def cases(self) -> int:
        """Number of cases that ran."""
        return self.accepted + self.rejected + len(self.failures)


def case(kind: str, seed: int, number: int) -> bytes:
    """Return the input of a case, which depends on nothing else."""
    seeds = TARGETS[kind].seeds() if kind not in _SEEDS else _SEEDS[kind]
    _SEEDS[kind] = seeds
    rng = np.random.default_rng([seed, zlib.crc32(kind.encode()), number])
    return mutate(rng, seeds[int(rng.integers(len(seeds)))], seeds, TARGETS[kind].inner)


_SEEDS: dict[str, list[bytes]] = {}


def run_cases(
    kind: str, seed: int, first: int, end: int, current: Path | None = None, stop_s: float = math.inf
) -> Outcome:
    """Run the cases `first` to `end` - 1 in this process.

    Args:
        kind: name of a target.
        seed: seed of the run.
        first: number of the first case.
        end: number after the last case.
        current: file that always contains the number of the case that runs, then the counts as JSON.
        stop_s: time of the monotonic clock after which no case begins.
    """
    outcome = Outcome()
    target = TARGETS[kind]
    descriptor = os.open(current, os.O_RDWR | os.O_CREAT) if current is not None else -1
    for number in range(first, end):
        if time.monotonic() > stop_s:
            break
        if descriptor >= 0:
            os.pwrite(descriptor, f"{number:12d}{json.dumps(asdict(outcome))}".encode(), 0)
        data = case(kind, seed, number)
        begin, crashes = time.process_time(), parser_crashes()
        try:
            with _alarm():
                accepted = target.run(data)
        except (Exception, _TooSlowError) as error:
            last = traceback.extract_tb(error.__traceback__)[-1]
            outcome.failures.append((number, f"{type(error).__name__}: {error} ({last.filename}:{last.lineno})"[:500]))
        else:
            outcome.accepted += accepted
            outcome.rejected += not accepted
            outcome.crashes += [number] * (parser_crashes() - crashes)
        outcome.slowest_s = max(outcome.slowest_s, time.process_time() - begin)
    if descriptor >= 0:
        os.close(descriptor)
    return outcome


def run(kind: str, seed: int, count: int, most_s: float = math.inf) -> Outcome:
    """Run the cases in other processes, for at most `most_s`; one that crashes costs its case only."""
    total = Outcome()
    stop_s = time.monotonic() + most_s
    first = 0
    with tempfile.TemporaryDirectory() as folder:
        current = Path(folder) / "current"
        while first < count and time.monotonic() <= stop_s:
            current.write_bytes(b"")
            # Not with -m: processes that the worker starts would import this module again, each of them.
            arguments = (kind, seed, first, count, str(current), str(stop_s))
            code = f"from tools.fuzz_files import work; work(*{arguments!r})"
            done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
            if done.returncode == 0:
                _add(total, json.loads(done.stdout.splitlines()[-1]))
                break
            state = current.read_text()
            if not state:
                raise SystemExit(done.stderr)
            number, counts = int(state[:12]), json.JSONDecoder().raw_decode(state[12:])[0]
            _add(total, counts)
            total.failures.append((number, f"crash, exit code {done.returncode}: {done.stderr[-300:]}"))
            first = number + 1
    return total


def _add(total: Outcome, counts: dict) -> None:
    total.accepted += counts["accepted"]
    total.rejected += counts["rejected"]
    total.crashes += counts["crashes"]
    total.failures += [(number, text) for number, text in counts["failures"]]
    total.slowest_s = max(total.slowest_s, counts["slowest_s"])


@contextmanager
def _alarm() -> Iterator[None]:
    def ring(*_: object) -> None:
        raise _TooSlowError(f"longer than {LIMIT_S} s")

    before = signal.signal(signal.SIGPROF, ring), signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    signal.setitimer(signal.ITIMER_REAL, _WAITING_SHARE * LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGPROF, before[0])
        signal.signal(signal.SIGALRM, before[1])


def work(kind: str, seed: int, first: int, end: int, current: str, stop_s: str) -> None:
    """Run cases in this process with limited memory, and print their counts as JSON."""
    faulthandler.enable()
    warnings.simplefilter("error", RuntimeWarning)
    _limit_memory(kind, seed)
    print(json.dumps(asdict(run_cases(kind, seed, first, end, Path(current), float(stop_s)))))


def _limit_memory(kind: str, seed: int) -> None:
    """Let this process take MEMORY_MB more than after a first case, which imports everything."""
    import resource

    for data in (*TARGETS[kind].seeds(), case(kind, seed, 0)):
        TARGETS[kind].run(data)
    pages = int(Path("/proc/self/statm").read_text().split()[0])
    limit_bytes = pages * resource.getpagesize() + (MEMORY_MB << 20)
    resource.setrlimit(resource.RLIMIT_AS, (limit_bytes, resource.getrlimit(resource.RLIMIT_AS)[1]))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--kind", action="append", choices=sorted(TARGETS), help="kind of input; repeat for several")
    parser.add_argument("--count", type=int, default=_SHORT_COUNT)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=math.inf, help="longest time for each kind")
    parser.add_argument("--only", type=int, help="run one case in this process")
    options = parser.parse_args()
    kinds = options.kind or list(TARGETS)
    if options.only is not None:
        data = case(kinds[0], options.seed, options.only)
        print(f"{len(data)} bytes; accepted: {TARGETS[kinds[0]].run(data)}")
        return
    failed = False
    print(
        f"seed {options.seed}\n{'kind':<18}{'cases':>9}{'accepted':>10}{'rejected':>10}{'crashes':>9}"
        f"{'failures':>10}{'slowest':>9}"
    )
    for kind in kinds:
        result = run(kind, options.seed, options.count, 60 * options.minutes)
        print(
            f"{kind:<18}{result.cases:>9}{result.accepted:>10}{result.rejected:>10}{len(result.crashes):>9}"
            f"{len(result.failures):>10}{result.slowest_s:>7.2f} s",
            flush=True,
        )
        crashed = [(number, "the parser crashed, which was a message") for number in result.crashes]
        failed = failed or bool(result.failures)
        for number, text in [*result.failures[:20], *crashed[:5]]:
            _SAVED.mkdir(parents=True, exist_ok=True)
            (_SAVED / f"{kind}-{options.seed}-{number}").write_bytes(case(kind, options.seed, number))
            print(f"  --kind {kind} --seed {options.seed} --only {number}: {text}", flush=True)
    sys.exit(failed)


if __name__ == "__main__":
    main()
