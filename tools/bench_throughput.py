"""Throughput of estimation: times real time, CPU by stage and estimator, and peak memory.

A recording of the demo car is estimated as `treadlink estimate` does (batch) and chunk by chunk as `treadlink live`
does (live), with 1 and 4 wheels, at 2 and 9.6 kHz. CPU is user time of one process without its imports. With
`--against` an older version runs beside this one, alternating in the same run; only the ratios of one round compare.

Run: `python tools/bench_throughput.py`; `--against GIT_REV` compares, `--quick` measures recordings of four
wheels at 9600 Hz only. The stages of batch and live follow. `--scaling` measures 1 to 64 wheels at 2 to 25.6 kHz on
short recordings, and four wheels over 30 s and 10 min.
`--calls` counts calls a revolution, which do not depend on the load of the machine.
"""

import argparse
import functools
import importlib
import inspect
import json
import os
import platform
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

SCENARIO: Final = Path("gateway/simulator/scenarios/demo.toml")
DEFAULT: Final = "default"
# Names of what each stage calls, in this and older versions; a name that a version does not have is skipped.
THIS_TREE: Final = Path(__file__).resolve().parent.parent
STAGES: Final = {
    "segmentation": (
        "gateway.core.contacts.segmenter:Segmenter.advance",
        "gateway.core.contacts.segmenter:Segmenter.finish",
    ),
    "contact timing": (
        "gateway.core.contacts.contact_timing:ContactTimer.time",
        "gateway.core.contacts.contact_timing:ContactTimer.renew",
    ),
    "resampling": ("gateway.core.revolutions.angle_resampling:resample_revolutions",),
    "gravity and speed": ("gateway.core.revolutions.speed_normalisation:normalise_revolutions",),
    "clipping": ("gateway.core.revolutions.clipping:is_clipped",),
    "revolution": ("gateway.core.wheels.revolution:revolutions_in_angle",),
    "sensor health": (
        "gateway.core.trust.sensor_health:SensorHealth.revolutions",
        "gateway.core.trust.sensor_health:SensorHealth.samples",
    ),
    "buffer, clocks": (
        "gateway.core.wheels.sample_buffer:SampleBuffer.append",
        "gateway.core.wheels.timebase:SampleClock.stamp",
        "gateway.core.wheels.timebase:SampleClock.stamp_blocks",
        "gateway.core.wheels.timebase:HostClock.host_ns",
    ),
    "running average": ("gateway.core.revolutions.synchronous_average:RunningAverage.update_block",),
    "evidence": (
        "gateway.core.trust.signal_evidence:assess",
        "gateway.core.trust.signal_evidence:Evidence.qualified",
    ),
    "tire estimates": ("gateway.core.wheels.tire_estimates:TireEstimates.take_block",),
    "alarms": (
        "gateway.core.session.alarm_watch:RecordingAlarms.frames",
        "gateway.core.session.alarm_watch:RecordingAlarms.results",
    ),
    "summary": ("gateway.core.text.session_summary:ResultSummary.add",),
}


@dataclass(frozen=True, slots=True)
class Case:
    """What is measured: way of working, wheels, sampling rate and estimators."""

    way: str
    wheels: int
    rate_hz: int
    estimators: str

    def __str__(self) -> str:
        return f"{self.way:5} {self.wheels} x {self.rate_hz:5} Hz  {self.estimators}"


CASES: Final = (
    Case("batch", 4, 9600, DEFAULT),
    Case("batch", 4, 9600, "kinematic"),
    Case("batch", 4, 9600, "none"),
    Case("batch", 1, 9600, DEFAULT),
    Case("batch", 4, 2000, DEFAULT),
    Case("live", 4, 9600, DEFAULT),
    Case("live", 4, 2000, DEFAULT),
    Case("decode", 4, 9600, "none"),
)
SCALING: Final = tuple(
    Case(way, wheels, rate_hz, DEFAULT)
    for way, rates_hz in (("batch", (2000, 9600, 25600)), ("live", (2000,)))
    for rate_hz in rates_hz
    for wheels in (1, 4, 16, 64)
)
LENGTHS_S: Final = (30.0, 600.0)
LENGTHS_CASE: Final = Case("batch", 4, 2000, DEFAULT)
STAGE_CASES: Final = (Case("batch", 4, 9600, DEFAULT), Case("live", 4, 9600, DEFAULT))


class StageClock:
    """CPU time of stages, each without the stages that it calls."""

    def __init__(self) -> None:
        self.spent_s: dict[str, float] = {}
        self._running: list[float] = []

    def wrap(self, stage: str, call: Callable[..., Any]) -> Callable[..., Any]:
        """Return a function that counts its time for a stage."""
        running, spent = self._running, self.spent_s
        spent.setdefault(stage, 0.0)

        @functools.wraps(call)
        def timed(*args: Any, **kwargs: Any) -> Any:
            running.append(0.0)
            begin = time.process_time()
            try:
                return call(*args, **kwargs)
            finally:
                took = time.process_time() - begin
                spent[stage] += took - running.pop()
                if running:
                    running[-1] += took

        return timed

    def install(self) -> None:
        """Wrap the functions of all stages, and the updates of all estimators."""
        for stage, targets in STAGES.items():
            for target in targets:
                self._replace(stage, *target.split(":"))
        from gateway.core.estimates.registry import ESTIMATORS, make_estimator

        for name in ESTIMATORS:
            kind = type(make_estimator(name))
            for method in ("update", "update_block"):
                if inspect.isfunction(vars(kind).get(method)):
                    setattr(kind, method, self.wrap(name, vars(kind)[method]))

    def _replace(self, stage: str, module_name: str, path: str) -> None:
        owner: Any = importlib.import_module(module_name)
        *outer, name = path.split(".")
        for part in outer:
            owner = getattr(owner, part, None)
        call = getattr(owner, name, None)
        if call is None:
            return
        timed = self.wrap(stage, call)
        setattr(owner, name, timed)
        if not outer:
            # Modules that imported the function by its name.
            for module in list(sys.modules.values()):
                if getattr(module, "__name__", "").startswith("gateway") and vars(module).get(name) is call:
                    setattr(module, name, timed)


def measure(case: Case, path: Path, clock: StageClock | None) -> dict[str, Any]:
    """Estimate a recording and return its revolutions, CPU in s, and peak memory in MB."""
    import gateway.core.cli  # noqa: F401 - sets up the process as commands do
    from gateway.core.config.vehicle import parse_vehicle
    from gateway.core.estimates.registry import DEFAULT_ESTIMATORS, make_estimator
    from gateway.core.recording.reader import RecordingReader
    from gateway.core.session.core import SessionCore
    from gateway.core.session.recording_pass import OpenedRecording, RecordingPass
    from gateway.core.text.session_summary import ResultSummary

    if clock is not None:
        clock.install()
    names = {DEFAULT: DEFAULT_ESTIMATORS, "none": ()}.get(case.estimators, (case.estimators,))
    for name in names:
        make_estimator(name)  # imports its modules
    reader = RecordingReader(path)
    vehicle = parse_vehicle(reader.vehicle_toml, "bench")
    summary = ResultSummary()
    revolutions = 0

    def take(result: Any) -> None:
        nonlocal revolutions
        revolutions += 1
        summary.add(result)

    items = list(reader.items()) if case.way == "live" else []
    begin = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    if case.way == "batch":
        for result in RecordingPass(OpenedRecording(reader, vehicle), names):
            take(result)
    elif case.way == "live":
        core = SessionCore(vehicle, estimators=names, latency_s=0.0)
        for item in items:
            for result in core.take(item):
                take(result)
        for result in core.finish():
            take(result)
    else:
        for _, batch, _ in OpenedRecording(reader).verified_blocks():
            batch.sample_groups()
    cpu_s = resource.getrusage(resource.RUSAGE_SELF).ru_utime - begin
    peak_mb = int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]) / 1024
    stages = clock.spent_s if clock is not None else {}
    return {"revolutions": revolutions, "cpu_s": cpu_s, "peak_mb": peak_mb, "stages": stages}


def print_calls(path: Path) -> None:
    """Print how many calls of Python and of C functions a revolution of the default estimators takes."""
    counts = {"call": 0, "c_call": 0}

    def count(_: Any, event: str, __: Any) -> None:
        if event in counts:
            counts[event] += 1

    measure(CASES[0], path, None)  # imports modules and fills caches
    sys.setprofile(count)
    revolutions = measure(CASES[0], path, None)["revolutions"]
    sys.setprofile(None)
    python, compiled = (number / revolutions for number in counts.values())
    print(f"calls a revolution: {python:.0f} of Python, {compiled:.0f} of C functions")


def scenario_of(wheels: int, rate_hz: int) -> str:
    """Return the demo car at a rate with the first of its wheels, or with more of them, by their numbers."""
    text = SCENARIO.read_text().replace("rate_hz = 9600.0", f"rate_hz = {rate_hz}.0")
    head, *tables = text.split("[[wheel]]")
    for number in range(len(tables), wheels):
        table = re.sub(r"(?m)^wheel = .*", f"wheel = {number}", tables[number % 4])
        table = re.sub(r"(?m)^position = .*", f'position = "W{number}"', table)
        tables.append(re.sub(r"(?m)^sensor_id = .*", f'sensor_id = "{0xA001 + number:08x}"', table))
    return "[[wheel]]".join([head, *tables[:wheels]])


def record(folder: Path, seconds: float, cases: tuple[Case, ...]) -> dict[tuple[int, int], Path]:
    """Write the recordings of all cases; return them by wheels and rate."""
    from gateway.core.clock import ManualClock
    from gateway.core.links.source import open_source
    from gateway.core.recording.writer import RecordingWriter

    made = {}
    for wheels, rate_hz in sorted({(case.wheels, case.rate_hz) for case in cases}):
        scenario = folder / f"{wheels}-{rate_hz}.toml"
        scenario.write_text(scenario_of(wheels, rate_hz))
        source = open_source(f"sim:{scenario}?speed=max&duration={seconds:g}", ManualClock())
        path = made[wheels, rate_hz] = scenario.with_suffix(".mcap")
        writer = RecordingWriter(path, start_ns=0, vehicle_toml=source.vehicle_toml or "", sources=["sim:demo"])
        for item in source.items(threading.Event()):
            writer.write(item)
        writer.close()
    return made


@contextmanager
def checked_out(revision: str | None) -> Iterator[dict[str, Path]]:
    """Yield the trees to measure by their names: the old one, when one is given, and this one."""
    if revision is None:
        yield {"now": THIS_TREE}
        return
    with tempfile.TemporaryDirectory() as folder:
        archive = subprocess.run(["git", "archive", revision], cwd=THIS_TREE, check=True, capture_output=True)
        subprocess.run(["tar", "-x", "-C", folder], input=archive.stdout, check=True)
        hook = Path(folder, "hatch_build.py")
        if hook.exists():
            subprocess.run([sys.executable, str(hook)], check=True)
        yield {revision: Path(folder), "now": THIS_TREE}


def commit_of(revision: str) -> str:
    """Return the short name of a commit of this tree."""
    order = ["git", "rev-parse", "--short", revision]
    return subprocess.run(order, cwd=Path(__file__).parent, check=True, capture_output=True, text=True).stdout.strip()


def run_child(tree: Path, case: Case, path: Path, *, by_stage: bool) -> dict[str, Any]:
    """Measure one case in a process of its own, with the modules of a tree."""
    order = json.dumps([case.way, case.wheels, case.rate_hz, case.estimators, str(path), by_stage])
    environment = {**os.environ, "PYTHONPATH": str(tree), "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    # The script of the tree itself, which knows its modules. -P: its folder is not searched for modules.
    command = [sys.executable, "-P", str(tree / "tools" / "bench_throughput.py"), "--child", order]
    done = subprocess.run(command, env=environment, cwd=tree, capture_output=True, text=True, check=False)
    if done.returncode:
        raise SystemExit(done.stderr)
    measured: dict[str, Any] = json.loads(done.stdout)
    return measured


def best(runs: list[dict[str, Any]]) -> dict[str, Any]:
    """Return the run with the least CPU: others had to share caches with strangers."""
    return min(runs, key=lambda run: float(run["cpu_s"]))


def measured_by(
    trees: dict[str, Path], case: Case, path: Path, rounds: int, *, by_stage: bool
) -> dict[str, list[dict[str, Any]]]:
    """Return runs of a case by tree; the trees alternate."""
    rows = [[run_child(tree, case, path, by_stage=by_stage) for tree in trees.values()] for _ in range(rounds)]
    return {name: [row[index] for row in rows] for index, name in enumerate(trees)}


def print_cases(
    trees: dict[str, Path],
    recordings: dict[tuple[int, int], Path],
    cases: tuple[Case, ...],
    seconds: float,
    rounds: int,
) -> list[float]:
    """Print a row for each case; return how many times as fast this version is in the median, where there are two."""
    medians = []
    print(f"\n{'case':34}" + "".join(f"{name:>12} x real  ms/rev  peak MB" for name in trees) + "   revolutions")
    for case in cases:
        path = recordings[case.wheels, case.rate_hz]
        runs = measured_by(trees, case, path, rounds, by_stage=False)
        row, revolutions = f"{case!s:34}", 0
        for name in trees:
            result = best(runs[name])
            revolutions = result["revolutions"]
            each = f"{1e3 * result['cpu_s'] / revolutions:8.3f}" if revolutions else f"{'':8}"
            row += f"{seconds / result['cpu_s']:19.1f}{each}{result['peak_mb']:9.0f}"
        print(f"{row}   {revolutions}", flush=True)
        if len(trees) > 1:
            print(f"{'':34}{ratios_line(*runs.values())}", flush=True)
            medians.append(statistics.median(ratios_of(*runs.values())))
    return medians


def ratios_of(before: list[dict[str, Any]], now: list[dict[str, Any]]) -> list[float]:
    """Return how many times as fast this version is, by round."""
    return [float(old["cpu_s"]) / float(new["cpu_s"]) for old, new in zip(before, now, strict=True)]


def ratios_line(before: list[dict[str, Any]], now: list[dict[str, Any]]) -> str:
    """Return how many times as fast this version is, and the scatter of that from round to round."""
    ratios = ratios_of(before, now)
    of_best = float(best(before)["cpu_s"]) / float(best(now)["cpu_s"])
    return (
        f"{of_best:.3f} times as fast by the best; by round {statistics.median(ratios):.3f} in the median, "
        f"{min(ratios):.3f} to {max(ratios):.3f}"
    )


def print_scaling(
    trees: dict[str, Path],
    folder: Path,
    cases: tuple[Case, ...],
    lengths_s: tuple[float, ...],
    seconds: float,
    rounds: int,
) -> None:
    """Print cases on recordings of `seconds`, and LENGTHS_CASE over each length."""
    print_cases(trees, record(folder, seconds, cases), cases, seconds, rounds)
    for length_s in lengths_s:
        print(f"\n{length_s:g} s")
        with tempfile.TemporaryDirectory(dir=folder) as part:
            print_cases(trees, record(Path(part), length_s, (LENGTHS_CASE,)), (LENGTHS_CASE,), length_s, rounds)


def print_stages(trees: dict[str, Path], path: Path, case: Case, rounds: int) -> None:
    results = {name: best(of_tree) for name, of_tree in measured_by(trees, case, path, rounds, by_stage=True).items()}
    print(f"\n{case}: microseconds of CPU a revolution, the clock of the stages included")
    print(f"{'':22}" + "".join(f"{name:>12}" for name in trees))
    used = {stage for run in results.values() for stage, spent_s in run["stages"].items() if spent_s > 0.0}
    for stage in [stage for stage in next(reversed(results.values()))["stages"] if stage in used]:
        row = "".join(f"{1e6 * run['stages'].get(stage, 0.0) / run['revolutions']:12.0f}" for run in results.values())
        print(f"{stage:22}{row}")
    rest = "".join(
        f"{1e6 * (run['cpu_s'] - sum(run['stages'].values())) / run['revolutions']:12.0f}" for run in results.values()
    )
    print(f"{'decoding and the rest':22}{rest}")


def gated(slowest: float, percent: float) -> str:
    """Return why a version costs too much, empty where it does not; `slowest` is 0 without another version."""
    if not slowest:
        return "--gate needs --against"
    more = 100.0 * (1.0 / slowest - 1.0)
    return f"costs {more:.1f} % more CPU; {percent:g} % are allowed" if more > percent else ""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--against", metavar="GIT_REV", help="measure this older version too, alternating")
    parser.add_argument("--seconds", type=float, help="length of the recordings (default: 60, with --scaling 10)")
    parser.add_argument("--rounds", type=int, help="runs of each case; the best counts (default: 3, with --against 5)")
    parser.add_argument("--quick", action="store_true", help="only four wheels at 9600 Hz in batch, and the stages")
    parser.add_argument("--gate", type=float, metavar="PERCENT", help="fail where a file or live costs so much more")
    parser.add_argument("--scaling", action="store_true", help="only 1 to 64 wheels at several rates, and lengths")
    parser.add_argument("--calls", action="store_true", help="only count calls a revolution of four wheels at 9600 Hz")
    parser.add_argument("--child", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        *values, path, by_stage = json.loads(arguments.child)
        print(json.dumps(measure(Case(*values), Path(path), StageClock() if by_stage else None)))
        return
    seconds = arguments.seconds or (10.0 if arguments.scaling else 60.0)
    rounds = arguments.rounds or (5 if arguments.against else 3)
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, Python {platform.python_version()}")
    print(f"demo car, {seconds:g} s, user CPU of one process, best of {rounds}")
    if arguments.against:
        commits = [commit_of(arguments.against), commit_of("HEAD")]
        print(f"{commits[0]} against now, {commits[1]} with what is not committed")
    with tempfile.TemporaryDirectory() as folder, checked_out(arguments.against) as trees:
        if arguments.scaling:
            print_scaling(trees, Path(folder), SCALING, LENGTHS_S, seconds, rounds)
            return
        if arguments.calls:
            print_calls(*record(Path(folder), seconds, CASES[:1]).values())
            return
        cases = STAGE_CASES if arguments.gate else CASES[:2] if arguments.quick else CASES
        recordings = record(Path(folder), seconds, (*cases, *STAGE_CASES))
        slowest = min(print_cases(trees, recordings, cases, seconds, rounds), default=0.0)
        if arguments.gate:
            sys.exit(gated(slowest, arguments.gate) or 0)
        for case in STAGE_CASES:
            print_stages(trees, recordings[case.wheels, case.rate_hz], case, rounds)


if __name__ == "__main__":
    main()
