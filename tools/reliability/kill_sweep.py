"""Kills every command that writes after each of its calls that change a file, and looks at what is left.

A library that is loaded before all others counts the calls (open to create, write, rename, link, unlink, fsync, mkdir,
truncate ...) that concern a folder, and kills the process group after the n-th, for every n; once more with each write
carried out by half; and once with SIGTERM instead, after which no part with content may remain. After each

  * the inputs are as before;
  * a file under a final name is whole: as that of a run that was not disturbed (a recording in progress: a readable
    prefix of it);
  * the same command again succeeds, unless the result is there and whole, and leaves the files of an undisturbed run,
    with the same content, and no others.

The commands run from a copy of the code: a result names its commit, and must not differ for a commit or an edit during
the sweep. Needs Linux and a C compiler. The processes are forked from one that has imported everything, so that a kill
costs little more than the work itself.
"""

import argparse
import contextlib
import filecmp
import hashlib
import importlib
import io
import json
import math
import mmap
import os
import random
import re
import shutil
import signal
import struct
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from gateway.core.config.validation import parse_document
from gateway.core.links.source import Chunk
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.writer import RecordingWriter, whole_recording
from gateway.simulator.scenario import vehicle_toml
from gateway.simulator.scenario_model import Scenario
from gateway.simulator.simulation import simulate

_CHECKOUT: Final = Path(__file__).resolve().parents[2]
_RUN_FROM: Final = ("gateway", "firmware_protocol", "treadlink", "tools/reliability")
# A campaign takes no limit of time: the search of its diagnoses ends at once, in the copy. It changes no file.
_EDITED: Final = "gateway/diagnosis/campaign_diagnosis.py"
_SEARCH: Final = "diagnosis = diagnose(campaign)"
_NO_SEARCH: Final = "diagnosis = diagnose(campaign, expired=lambda: True)"
_SHIM: Final = Path(__file__).with_name("killing_calls.c")
_STATE: Final = struct.Struct("=qqqq1024s256s")
_START_NS: Final = 1_700_000_000 * 10**9
_SHORT_S: Final = 1.6
_LONG_S: Final = 3.5
_SCENARIO: Final = """
[scenario]
seed = {seed}
[sensor]
rate_hz = 2000
[motion]
speed_kmh = 80
[[wheel]]
position = "FL"
wheel = 0
sensor_id = "0000b001"
load_n = {load_n}
"""
_ORDER_SEED: Final = 1
# What a shell shows, and a process that had not yet prepared for it.
_TERMINATED: Final = (128 + signal.SIGTERM, -signal.SIGTERM)
_SHOWN_BYTES: Final = 60


@dataclass(frozen=True, slots=True)
class Case:
    """A command to kill.

    Attributes:
        name: in the table.
        arguments: of the command, in a folder with the inputs.
        again: of the second run, the same unless given.
        is_recording: it records, so a part of its result is under the final name from the beginning.
        appends: file that each run adds lines to.
        setup: commands before it, which are not disturbed.
    """

    name: str
    arguments: str
    again: str = ""
    is_recording: bool = False
    appends: str = ""
    setup: tuple[str, ...] = ()


CASES: Final = (
    Case("record", "record replay:drive.mcap?speed=max --out new/", is_recording=True),
    Case("record --split", "record replay:drive.mcap?speed=max --out new/ --split 1s", is_recording=True),
    Case("live --record", "live replay:drive.mcap?speed=max --plain --record new/", is_recording=True),
    Case(
        "live --publish jsonl:",
        "live replay:drive.mcap?speed=max --plain --publish jsonl:out.jsonl?append=yes",
        appends="out.jsonl",
    ),
    Case("simulate --out", "simulate wheel.toml --duration 1 --out out.mcap"),
    Case("simulate --out .bin", "simulate wheel.toml --duration 1 --out out.bin --vehicle out.toml"),
    Case("import", "import samples.csv --out out.mcap"),
    Case("import --guess", "import plain.csv --guess --out out.map.toml"),
    Case("repair", "repair cut.mcap --out out.mcap"),
    Case("compact", "compact drive.mcap --out out.mcap"),
    Case("compact --in-place", "compact --in-place drive.mcap"),
    Case("merge", "merge drive.mcap other.mcap --out out.mcap --config vehicle.toml"),
    Case("note", "note drive.mcap --comment second", appends="drive.mcap.notes.jsonl"),
    Case("export .csv", "export drive.mcap out.csv --what estimates"),
    Case("export .parquet", "export drive.mcap out.parquet"),
    Case("export .mat", "export drive.mcap out.mat --what angle"),
    Case("export .mf4", "export drive.mcap out.mf4"),
    Case("export .npz", "export drive.mcap out.npz"),
    Case("export .tdx", "export drive.mcap out.tdx --what average"),
    Case("export .mcap", "export drive.mcap out.mcap"),
    Case("estimate", "estimate drive.mcap --csv out.csv --json out.jsonl --html out.html"),
    Case("estimate --parquet", "estimate drive.mcap --parquet out.parquet"),
    Case("estimate --force", "estimate drive.mcap --csv old.csv --force", setup=("estimate other.mcap --csv old.csv",)),
    Case("orders", "orders drive.mcap --json out.json --csv out.csv"),
    Case("compare", "compare drive.mcap other.mcap --csv out.csv"),
    # What a search reaches within a limit depends on the load: no time for it, or no limit.
    Case("diagnose", "diagnose long.mcap --jobs 1 --budget 0.01 --json out.json --html out.html"),
    Case("diagnose --save-effects", "diagnose long.mcap --jobs 1 --save-effects out.effects.json"),
    Case("calibrate load", "calibrate load long.mcap --out out.toml"),
    Case("campaign", "campaign drive.mcap other.mcap --out out.dataset --jobs 1 --estimator kinematic"),
    Case(
        "campaign, grown",
        "campaign drive.mcap other.mcap --out out.dataset --jobs 1 --estimator kinematic",
        setup=("campaign drive.mcap --out out.dataset --jobs 1 --estimator kinematic",),
    ),
    Case("campaign --diagnose", "campaign drive.mcap other.mcap --out out.dataset --jobs 1 --diagnose"),
    Case(
        "trends",
        "trends fleet.dataset --html out.html --json out.json --csv out.csv",
        setup=("campaign drive.mcap other.mcap --out fleet.dataset --jobs 1 --estimator kinematic",),
    ),
    Case("figures", "figures ring-fig-7 --out out"),
    Case("plan", "plan --sensor ADXL372 --speed 60 --wheels 8 --json out.json"),
    Case("keys new", "keys new 0000b009 --keys keys.toml", setup=("keys new 0000b001 --keys keys.toml",)),
    Case("protocol vectors", "protocol vectors --out out"),
    Case("protocol collector", "protocol collector --out out"),
    Case("protocol dbc", "protocol dbc --out ."),
)


@dataclass(slots=True)
class Swept:
    """What a sweep over a command left.

    Attributes:
        name: of the case.
        calls: that change files, in a run that was not disturbed.
        kills: runs that were killed.
        terminated: runs that SIGTERM ended.
        parts: kills that left a file that is not a result, by its kind of name.
        faults: what must not be, with the call.
        forced: second runs that needed `--force`, since one of several results was there.
    """

    name: str
    calls: int = 0
    kills: int = 0
    terminated: int = 0
    parts: Counter[str] = field(default_factory=Counter)
    faults: list[str] = field(default_factory=list)
    forced: int = 0


class Forked:
    """Runs commands in processes that are forked from one with the library loaded.

    Attributes:
        code: folder with the copy of the code that runs.
        output: file with what the last command printed.
        calls: of the last command that change files.
        last: call that the last command was killed at.
    """

    def __init__(self, folder: Path) -> None:
        """Compile the library, copy the code and start the process; `folder` takes its files."""
        library, self._state_path = folder / "killing_calls.so", folder / "state"
        subprocess.run(["cc", "-O2", "-shared", "-fPIC", "-o", str(library), str(_SHIM), "-ldl"], check=True)
        self._state_path.write_bytes(bytes(_STATE.size))
        with self._state_path.open("r+b") as file:
            self._state = mmap.mmap(file.fileno(), _STATE.size)
        self.output = folder / "output"
        self.code = folder / "code"
        for name in _RUN_FROM:
            shutil.copytree(_CHECKOUT / name, self.code / name)
        edited = self.code / _EDITED
        text = edited.read_text()
        assert text.count(_SEARCH) == 1, f"{_EDITED} has changed: correct _SEARCH"
        edited.write_text(text.replace(_SEARCH, _NO_SEARCH))
        environment = {
            **os.environ,
            "PYTHONPATH": str(self.code),
            "LD_PRELOAD": str(library),
            "TREADLINK_KILL_STATE": str(self._state_path),
            "PYTHONHASHSEED": "0",
            "COLUMNS": "200",
        }
        self._process = subprocess.Popen(
            [sys.executable, str(self.code / Path(__file__).resolve().relative_to(_CHECKOUT)), "--serve"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env=environment,
            text=True,
        )
        self.calls = 0
        self.last = ""

    def run(
        self,
        arguments: Sequence[str],
        folder: Path,
        *,
        kill_at: int = 0,
        torn: bool = False,
        by: signal.Signals = signal.SIGKILL,
    ) -> int:
        """Run a command in a folder and return its status, negative for a signal.

        Sets `calls` to the number of calls up to then, and `last` to the one that got the signal; empty where none did.
        """
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        _STATE.pack_into(self._state, 0, 0, kill_at, torn, by, os.fsencode(folder), b"")
        request = {"arguments": list(arguments), "folder": str(folder), "output": str(self.output)}
        self._process.stdin.write(json.dumps(request) + "\n")
        self._process.stdin.flush()
        status = int(self._process.stdout.readline())
        self.calls, *_, last = _STATE.unpack_from(self._state)
        self.last = last.split(b"\0")[0].decode(errors="replace")
        return status

    def close(self) -> None:
        """End the process."""
        assert self._process.stdin is not None
        self._process.stdin.close()
        self._process.wait(60)


def _serve() -> None:
    """Fork a process for each request on standard input, and print its status."""
    loaded = set(sys.modules)
    for line in sys.stdin:
        request = json.loads(line)
        list_path = Path(request["output"]).with_suffix(".modules")
        process = os.fork()
        if process == 0:
            _run(request, list_path, loaded)
        _, status = os.waitpid(process, 0)
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process, signal.SIGKILL)  # workers that have outlived it
        # The next ones need not import what this one has needed.
        if list_path.exists():
            for name in list_path.read_text().splitlines():
                with contextlib.suppress(Exception):
                    importlib.import_module(name)
            loaded = set(sys.modules)
            list_path.unlink()
        print(os.waitstatus_to_exitcode(status), flush=True)


def _run(request: dict[str, Any], list_path: Path, loaded: set[str]) -> None:
    status = 1
    try:
        os.setsid()
        folder = Path(request["folder"])
        os.chdir(folder)
        home = folder.parent / "home"
        os.environ.update(HOME=str(home), TMPDIR=str(folder / "tmp"))
        for name in ("XDG_CONFIG_HOME", "XDG_STATE_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME"):
            os.environ[name] = str(home)
        tempfile.tempdir = None
        output = os.open(request["output"], os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        null = os.open(os.devnull, os.O_RDONLY)
        os.dup2(null, 0)
        os.dup2(output, 1)
        os.dup2(output, 2)
        from gateway.core.cli import main

        sys.argv = ["treadlink", *request["arguments"]]
        sys.stdout = io.TextIOWrapper(io.FileIO(1, "w", closefd=False), line_buffering=True)
        try:
            main()
            status = 0
        except SystemExit as ended:
            status = int(ended.code or 0) if isinstance(ended.code, int | None) else 1
        new = [name for name in sys.modules if name not in loaded and not name.startswith("__")]
        if new:
            list_path.write_text("\n".join(new))
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
        os._exit(status)


class Sweep:
    """The sweep over one command."""

    def __init__(self, case: Case, inputs: Path, folder: Path, forked: Forked) -> None:
        """Run the command undisturbed, twice; `folder` takes the copies of `inputs`.

        Raises:
            AssertionError: it fails.
        """
        self._case, self._forked = case, forked
        self._inputs, self._work = folder / "inputs", folder / "work"
        self._reference, other = folder / "reference", folder / "other"
        (folder / "home").mkdir(parents=True)
        # All runs are in one place, those of the setup too: a dataset names its files by the paths of the recordings.
        shutil.copytree(inputs, self._work)
        (self._work / "tmp").mkdir()
        for line in case.setup:
            self._must_run(line, self._work)
        self._work.rename(self._inputs)
        self._arguments = case.arguments.split()
        for target in (self._reference, other):
            shutil.copytree(self._inputs, self._work)
            self._must_run(case.arguments, self._work)
            self._work.rename(target)
        self.swept = Swept(case.name, forked.calls)
        self._before = _contents(self._inputs)
        self._after = _contents(self._reference)
        self._new = {name for name in self._after if self._after[name] != self._before.get(name)}
        others = _contents(other)
        self._exact = {name for name in self._new if others.get(name) == self._after[name]}
        self._recorded = _recorded(self._reference.glob("new/*.mcap"))

    def _must_run(self, line: str, folder: Path) -> None:
        status = self._forked.run(line.split(), folder)
        assert status == 0, f"{line}: {status}\n{self._forked.output.read_text()}"

    def run(self, most_s: float = math.inf) -> Swept:
        """Kill the command at each call in each way, in a random order: a limit of time shall reach all its parts."""
        numbers = list(range(1, self.swept.calls + 1))
        random.Random(_ORDER_SEED).shuffle(numbers)
        end_s = time.monotonic() + most_s
        for number in numbers:
            if time.monotonic() >= end_s:
                break
            if "write" in self._kill(number):
                self._kill(number, torn=True)
            self._kill(number, by=signal.SIGTERM)
        return self.swept

    def _kill(self, number: int, *, torn: bool = False, by: signal.Signals = signal.SIGKILL) -> str:
        """Kill the command at a call, and return its name; nothing when the command has ended before it."""
        shutil.rmtree(self._work, ignore_errors=True)
        shutil.copytree(self._inputs, self._work)
        status = self._forked.run(self._arguments, self._work, kill_at=number, torn=torn, by=by)
        last = self._forked.last
        if not last:
            return ""
        call = f"{by.name} at {'half of ' if torn else ''}{last}"
        if by is signal.SIGKILL:
            self.swept.kills += 1
        else:
            self.swept.terminated += 1
            if status not in (0, *_TERMINATED):
                self._fault(call, f"it ends with {status}: {self._forked.output.read_text(errors='replace')[-300:]}")
        try:
            self._look(call, is_killed=by is signal.SIGKILL)
            self._again(call)
        except Exception as error:  # what a reader raises on half a file is what this looks for
            self._fault(call, f"{type(error).__name__}: {error}")
        return last.split()[0]

    def _fault(self, call: str, text: str) -> None:
        self.swept.faults.append(f"after {call}: {text}")

    def _look(self, call: str, *, is_killed: bool) -> None:
        """Check inputs, results and other files after a kill."""
        contents = _contents(self._work)
        for name, content in self._before.items():
            if name.endswith(".lock"):
                continue  # holds no result
            if name in self._new:
                if self._case.appends == name:
                    self._check_appended(name, call)
                elif contents.get(name) != content and (difference := self._difference(name)):
                    self._fault(call, f"'{name}' is neither the old one nor the new one: it {difference}")
            elif contents.get(name) != content:
                self._fault(call, f"the input '{name}' has changed")
        for name in contents.keys() - self._before.keys():
            if self._case.is_recording and name.endswith(".mcap"):
                continue
            if name == self._case.appends or name.endswith(".lock"):
                continue
            if name in self._after:
                if difference := self._difference(name):
                    self._fault(call, f"half a file: '{name}' {difference}")
            elif is_killed:
                self.swept.parts[_kind(name)] += 1
            elif (self._work / name).stat().st_size:
                self._fault(call, f"it leaves '{_kind(name)}'")
        if self._case.is_recording and not self._recorded.startswith(_recorded(self._work.glob("new/*.mcap"))):
            self._fault(call, "what is recorded is not what came")

    def _check_appended(self, name: str, call: str) -> None:
        old = (self._inputs / name).read_bytes()
        if not (self._work / name).read_bytes().startswith(old):
            self._fault(call, f"'{name}' has lost lines")

    def _again(self, call: str) -> None:
        """Run the command again, and compare what is there with an undisturbed run."""
        case = self._case
        first = {path: path.read_bytes() for path in self._work.glob("new/*.mcap")} if case.is_recording else {}
        line = case.again.split() or self._arguments
        status = self._forked.run(line, self._work)
        text = self._forked.output.read_text(errors="replace")
        results = [name for name in self._new if not name.startswith("tmp/")]
        if status != 0 and not (self._is_there(results)):
            if "already exist" in text or "--force" in text:
                self.swept.forced += 1
                status = self._forked.run([*line, "--force"], self._work)
                text = self._forked.output.read_text(errors="replace")
            if status != 0:
                self._fault(call, f"the second run fails: {text.strip()[-300:]}")
                return
        for path, content in first.items():
            if path.read_bytes() != content:
                self._fault(call, f"the second run has changed '{path.name}'")
        if case.is_recording and _recorded({*self._work.glob("new/*.mcap")} - first.keys()) != self._recorded:
            self._fault(call, "the second run has not recorded all that came")
        contents = _contents(self._work)
        # An empty lock holds nothing, and the next change takes it up.
        expected = (".lock", ".mcap") if case.is_recording else ".lock"
        remainder = [name for name in contents.keys() - self._after.keys() if not name.endswith(expected)]
        if remainder:
            self._fault(call, f"the second run leaves {', '.join(sorted(_kind(name) for name in remainder))}")
        if case.appends:
            self._check_lines(self._work / case.appends, call)
        elif not case.is_recording:
            for name in results:
                if difference := self._difference(name):
                    self._fault(call, f"after the second run '{name}' {difference}")

    def _is_there(self, names: Sequence[str]) -> bool:
        return bool(names) and not self._case.appends and not any(map(self._difference, names))

    def _check_lines(self, path: Path, call: str) -> None:
        """Check that all lines of the second run can be read, after at most one half line of the first."""
        lines, before = path.read_bytes().splitlines(), self._inputs / self._case.appends
        old = len(before.read_bytes().splitlines()) if before.exists() else 0
        new = len((self._reference / self._case.appends).read_bytes().splitlines()) - old
        for line in lines[-new:]:
            try:
                json.loads(line)
            except ValueError:
                self._fault(call, f"a line of the second run is joined to half of one: {line[:60]!r}")
                return

    def _difference(self, name: str) -> str:
        """Return how a result differs from that of the undisturbed run; empty where it is the same."""
        path, reference = self._work / name, self._reference / name
        if not path.exists():
            return "is missing"
        if filecmp.cmp(path, reference, shallow=False):
            return ""
        if name not in self._exact and _read(path) == _read(reference):
            return ""
        return f"differs: {first_difference(path, reference)}"


def first_difference(path: Path, reference: Path) -> str:
    """Return the first value in which a file differs from another of its kind: a cell, or a part of its bytes."""
    if path.suffix == ".parquet":
        with contextlib.suppress(Exception):  # what a reader raises on half a file
            for number, (row, other) in enumerate(zip(_rows(path), _rows(reference), strict=True)):
                for column in other:
                    if row[column] != other[column]:
                        place = f"row {number}, {column}"
                        return f"{place}: {_first_bytes(_as_bytes(row[column]), _as_bytes(other[column]))}"
    return _first_bytes(path.read_bytes(), reference.read_bytes())


def _rows(path: Path) -> list[dict[str, Any]]:
    from pyarrow import parquet

    rows: list[dict[str, Any]] = parquet.read_table(path).to_pylist()
    return rows


def _as_bytes(value: Any) -> bytes:
    return str(value).encode(errors="replace")


def _first_bytes(data: bytes, reference: bytes) -> str:
    pairs = zip(data, reference, strict=False)
    same = next((index for index, (byte, other) in enumerate(pairs) if byte != other), min(len(data), len(reference)))
    begin = max(same - _SHOWN_BYTES, 0)
    parts = (whole[begin : same + _SHOWN_BYTES] for whole in (data, reference))
    return f"at byte {same} of {len(data)} {next(parts)!r} instead of {next(parts)!r}, of {len(reference)}"


def _contents(folder: Path) -> dict[str, str]:
    """Return the hash of every file, by its path in the folder."""
    return {
        str(path.relative_to(folder)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(folder.rglob("*"))
        if path.is_file()
    }


def _kind(name: str) -> str:
    """Return a name without numbers and the random parts of temporary names."""
    return re.sub(r"\d+", "#", re.sub(r"tmp\w{8}", "tmp*", name))


def _recorded(paths: Iterable[Path]) -> bytes:
    """Return the bytes of a session's files, in the order of their times: the first is named after another clock."""
    readers = [RecordingReader(path) for path in paths if path.stat().st_size]
    parts = [[item for item in reader.items() if isinstance(item, Chunk)] for reader in readers]
    parts.sort(key=lambda part: part[0].host_ns if part else 0)
    return b"".join(chunk.data for part in parts for chunk in part)


def _mcap(path: Path) -> Any:
    reader = RecordingReader(path)
    messages = [(message.channel.topic, len(message.data)) for message in reader.messages()]
    return reader.info.finished, reader.damage, messages


def _parquet(path: Path) -> Any:
    from pyarrow import parquet

    table = parquet.read_table(path)
    return table.schema.names, table.num_rows


def _mdf(path: Path) -> Any:
    from asammdf import MDF

    with MDF(path) as file:
        return [
            (group, len(channel.samples))
            for group in range(len(file.groups))
            for channel in file.select([(None, group, 0)])
        ]


def _shape(path: Path) -> Any:
    """Return the first and last bytes and the lines of a text: it differs from run to run in a time or a duration."""
    data = path.read_bytes()
    return data[:8], data[-1:], data.count(b"\n")


_READERS: Final[dict[str, Callable[[Path], Any]]] = {".mcap": _mcap, ".parquet": _parquet, ".mf4": _mdf}


def _read(path: Path) -> Any:
    return _READERS.get(path.suffix, _shape)(path)


def make_inputs(folder: Path) -> None:
    """Write recordings of a wheel, one of them cut, and measurements of it as text."""
    from gateway.core.cli import treadlink

    folder.mkdir()
    for number, (name, duration_s) in enumerate((("drive", _SHORT_S), ("other", _SHORT_S), ("long", _LONG_S))):
        scenario = parse_document(Scenario, _SCENARIO.format(seed=number + 1, load_n=4000 + 500 * number), name)
        start_ns = _START_NS + number * 3600 * 10**9
        path, toml = folder / f"{name}.mcap", vehicle_toml(scenario)
        part = RecordingWriter(path, start_ns=start_ns, vehicle_toml=toml, sources=("sim",), in_part=True)
        with whole_recording(part) as writer:
            for chunk in simulate(scenario, duration_s=duration_s).chunks("sim", start_ns):
                writer.write(chunk)
    (folder / "vehicle.toml").write_text(vehicle_toml(scenario))
    (folder / "wheel.toml").write_text(_SCENARIO.format(seed=1, load_n=4000))
    data = (folder / "drive.mcap").read_bytes()
    (folder / "cut.mcap").write_bytes(data[: 2 * len(data) // 3])
    treadlink(["export", str(folder / "drive.mcap"), str(folder / "samples.csv")], standalone_mode=False)
    lines = [line for line in (folder / "samples.csv").read_text().splitlines() if not line.startswith("#")]
    (folder / "plain.csv").write_text("\n".join(lines) + "\n")
    treadlink(["note", str(folder / "drive.mcap"), "--comment", "first"], standalone_mode=False)


def sweep(folder: Path, names: Sequence[str] = (), most_s: float = math.inf) -> Iterator[Swept]:
    """Yield what a sweep over each command, or those named, leaves."""
    inputs = folder / "inputs"
    make_inputs(inputs)
    forked = Forked(folder)
    try:
        chosen = [case for case in CASES if not names or case.name in names]
        for number, case in enumerate(sorted(chosen, key=lambda case: names.index(case.name) if names else 0)):
            try:
                yield Sweep(case, inputs, folder / f"case{number}", forked).run(most_s)
            except AssertionError as error:
                yield Swept(case.name, faults=[str(error)])
            shutil.rmtree(folder / f"case{number}")
    finally:
        forked.close()


HEAD: Final = (
    "| command | calls | kills | faults | left by kills, until the next run | needed --force |\n"
    "|---|---|---|---|---|---|"
)


def row(swept: Swept) -> str:
    """Return a row of the table."""
    parts = ", ".join(f"{count} x `{kind}`" for kind, count in swept.parts.items()) or "nothing"
    return f"| {swept.name} | {swept.calls} | {swept.kills} | {len(swept.faults)} | {parts} | {swept.forced} |"


def main() -> int:
    """Print the table, and the faults on standard error."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--serve", action="store_true", help=argparse.SUPPRESS)
    parser.add_argument("--only", nargs="+", default=(), choices=[case.name for case in CASES], metavar="COMMAND")
    parser.add_argument(
        "--seconds", type=float, default=math.inf, help="kill for this long, each command at random calls"
    )
    arguments = parser.parse_args()
    if arguments.serve:
        _serve()
        return 0
    print(HEAD, flush=True)
    faults = 0
    with tempfile.TemporaryDirectory() as folder:
        for swept in sweep(Path(folder).resolve(), arguments.only, arguments.seconds):
            print(row(swept), flush=True)
            faults += len(swept.faults)
            for text, count in Counter(swept.faults).items():
                print(f"  {swept.name}: {count} x {text}", file=sys.stderr, flush=True)
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main())
