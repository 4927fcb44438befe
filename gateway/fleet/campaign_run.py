"""Run of a campaign: recordings are found, identified by content, estimated by workers and added to the dataset."""

import queue
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Final, NamedTuple

from gateway.core.clock import Clock
from gateway.core.errors import OutputError, RecordingError, TreadlinkError
from gateway.core.nearest_name import missing_path_remedy
from gateway.core.reasons import Reason
from gateway.core.recording.file_content import FileContent, read_content
from gateway.core.recording.reader import RecordingReader
from gateway.core.recording.run_description import EVERY_RUN, KEYS, RunFilter
from gateway.core.text.wording import text
from gateway.core.wheels.reasons import WheelCode
from gateway.diagnosis.reasons import DiagnosisCode
from gateway.fleet.content_keys import estimators_version, path_key
from gateway.fleet.dataset import Dataset
from gateway.fleet.reasons import FleetCode
from gateway.fleet.recording_estimation import (
    Estimated,
    EstimationOrder,
    EstimationSettings,
    Failure,
    estimate_recording,
)
from gateway.fleet.worker_tasks import TaskResult, WorkerTasks

_POLL_S: Final = 0.1
_READ_AHEAD: Final = 64
_NAMED_VALUES: Final = 10


@dataclass(slots=True)
class CampaignProgress:
    """State of a campaign, for views.

    Attributes:
        files: found.
        files_left: neither estimated nor known to need no estimate.
        total_bytes: of the files that need an estimate; a file counts until it is known to be done.
        done_bytes: estimated of these.
        elapsed_s: since the first recording was given to a worker; 0 before.
        estimated: recordings added now.
        failed: recordings that failed now.
        done_before: recordings whose results were there.
        failed_before: recordings known to fail, which have not changed.
        copies: files with the content of another file.
        damaged: paths of recordings with an unreadable part, also of those known before.
        restored: of the estimated, recordings whose file in the dataset was missing or damaged.
        standing: wheels without a revolution: path, position and why, also of recordings known before.
        alarms: recordings with each alarm by its name, also of those known before.
        with_alarms: recordings with an alarm.
        revolutions: added now.
        peak_bytes: largest memory of a worker process.
        workers: tasks at once.
    """

    files: int = 0
    files_left: int = 0
    total_bytes: int = 0
    done_bytes: int = 0
    elapsed_s: float = 0.0
    estimated: int = 0
    failed: int = 0
    done_before: int = 0
    failed_before: int = 0
    copies: int = 0
    damaged: list[Path] = field(default_factory=list)
    restored: int = 0
    standing: list[tuple[Path, str, str]] = field(default_factory=list)
    alarms: Counter[str] = field(default_factory=Counter)
    with_alarms: int = 0
    revolutions: int = 0
    peak_bytes: int = 0
    workers: int = 0

    @property
    def left_s(self) -> float | None:
        """Time to the end at the mean rate of bytes so far; None before the rate is known."""
        if self.done_bytes <= 0 or self.elapsed_s <= 0.0:
            return None
        return self.elapsed_s * max(self.total_bytes - self.done_bytes, 0) / self.done_bytes


class _Hashed(NamedTuple):
    path: Path
    content: FileContent | None
    error: RecordingError | None


@dataclass(slots=True)
class CampaignRun:
    """One run over given files.

    Attributes:
        dataset: to add to.
        settings: of the estimation.
        connect: returns the tasks of the workers; called when the first recording needs one.
        clock: reads the time.
        stop: event that asks to stop.
        on_progress: called often.
        on_failure: called with each recording that failed now.
        work: estimates one recording in a worker.
        retries_failed: whether recordings are tried again that are known to fail.
        progress: the state.
        contents: of the files considered, each with the first path at which it was found, by recording.
    """

    dataset: Dataset
    settings: EstimationSettings
    connect: Callable[[], WorkerTasks]
    clock: Clock
    stop: threading.Event
    on_progress: Callable[[CampaignProgress], None] = lambda _: None
    on_failure: Callable[[Path, Failure], None] = lambda _, __: None
    work: Callable[..., Estimated] = estimate_recording
    retries_failed: bool = False
    progress: CampaignProgress = field(default_factory=CampaignProgress)
    contents: dict[str, FileContent] = field(default_factory=dict)
    _jobs: dict[str, FileContent] = field(default_factory=dict)
    _sizes: dict[Path, int] = field(default_factory=dict)
    _tasks: WorkerTasks | None = None
    _begin_ns: int = 0
    _done_bytes: int = 0

    def run(self, paths: Sequence[Path]) -> CampaignProgress:
        """Estimate what is not done; return the state at the end, or at the request to stop.

        Raises:
            OutputError: the dataset cannot be written; it is whole.
            TreadlinkError: the workers cannot do it at all.
        """
        key = self.settings.key
        self.progress.files = self.progress.files_left = len(paths)
        self._sizes = {path: _size(path) for path in paths}
        self.progress.total_bytes = sum(self._sizes.values())
        end = threading.Event()
        waiting: queue.Queue[_Hashed | Exception | None] = queue.Queue(_READ_AHEAD)
        reader = threading.Thread(target=_read_ahead, args=(paths, waiting, end), name="identify files", daemon=True)
        reader.start()
        try:
            self._loop(key, waiting)
        finally:
            end.set()
            if self._tasks is not None:
                self._tasks.cancel()
        if not self.stop.is_set():
            self._follow_renamed(paths)
        return self.progress

    def _loop(self, key: str, waiting: queue.Queue[_Hashed | Exception | None]) -> None:
        all_read = False
        while not self.stop.is_set() and not (all_read and not self._jobs):
            self.progress.workers = self._tasks.places() if self._tasks is not None else 0
            while not all_read and len(self._jobs) < max(self.progress.workers, 1):
                try:
                    hashed = waiting.get(timeout=0.0 if self._jobs else _POLL_S)
                except queue.Empty:
                    break
                if isinstance(hashed, Exception):
                    raise hashed
                if hashed is None:
                    all_read = True
                else:
                    self._consider(hashed, key)
            self._report()
            if self._tasks is not None and self._jobs:
                event = self._tasks.wait(_POLL_S)
                if event is not None:
                    self._finished(event, key)
        self._report()

    def _consider(self, hashed: _Hashed, key: str) -> None:
        """Submit a file, unless it needs no estimate."""
        path, content = hashed.path, hashed.content
        if content is None:
            assert hashed.error is not None
            reason = Reason(DiagnosisCode.RECORDING_NOT_READ, message=str(hashed.error))
            failure = Failure(reason, hashed.error.remedy, is_final=False)
            self.dataset.fail(path, None, key, failure, self.clock.now_ns())
            self._count_failure(path, failure)
            self._settle(path)
            return
        if content.recording_id in self.contents:
            self.progress.copies += 1
            self._settle(path)
            return
        self.contents[content.recording_id] = content
        is_done = self.dataset.done(content.recording_id, key)
        if is_done and self._take_wheels(content):
            self.dataset.clear_failure(content)
            self.progress.done_before += 1
            self._settle(path)
        elif is_done:
            self.progress.restored += 1
            self._submit(content)
        elif self.dataset.failed(content, key) and not self.retries_failed:
            self.progress.failed_before += 1
            self._settle(path)
        else:
            self._submit(content)

    def _submit(self, content: FileContent) -> None:
        if self._tasks is None:
            self._tasks = self.connect()
            self._begin_ns = self.clock.now_ns()
        token = content.recording_id
        self._jobs[token] = content
        order = EstimationOrder(content, self.settings, self.dataset.incoming, token)
        self._tasks.submit(token, partial(run_order, self.work), order, Estimated)

    def _finished(self, event: TaskResult, key: str) -> None:
        content = self._jobs.pop(event.token)
        for replaced in self.dataset.replaced_by(content):
            if replaced in self.contents:  # found at another path, by the time that this is done
                self.dataset.keep(self.contents[replaced])
        outcome: Estimated | None = event.outcome
        failure = outcome.failure if outcome is not None else None
        if outcome is None:
            assert event.ended is not None
            failure = Failure(event.ended, _remedy(event.ended), is_final=False)
        else:
            self.progress.peak_bytes = max(self.progress.peak_bytes, outcome.peak_bytes)
        if failure is not None:
            self._fail(content, replace(failure, attempts=event.attempts), key)
        elif outcome is not None:
            self.dataset.commit(content, key, outcome.parts, outcome.vehicle, outcome.start_ns)
            self.progress.estimated += 1
            self.progress.revolutions += outcome.revolutions
            self._take_wheels(content, outcome.damage)
        self._settle(content.path, counts=True)

    def _take_wheels(self, content: FileContent, damage: Reason | None = None) -> bool:
        """Take what the rows of a recording say of its wheels; return False where they cannot be read."""
        wheels = self.dataset.wheels(content.recording_id)
        if wheels is None:
            return False
        if not wheels:
            self.progress.standing.append((content.path, "", text(Reason(WheelCode.NO_SAMPLES))))
        self.progress.standing += [(content.path, wheel.position, wheel.missing) for wheel in wheels if wheel.missing]
        names = {name for wheel in wheels for name in wheel.alarms}
        self.progress.alarms.update(names)
        self.progress.with_alarms += bool(names)
        if damage is not None or any(wheel.is_damaged for wheel in wheels):
            self.progress.damaged.append(content.path)
        return True

    def _fail(self, content: FileContent, failure: Failure, key: str) -> None:
        self.dataset.fail(content.path, content, key, failure, self.clock.now_ns())
        self._count_failure(content.path, failure)

    def _count_failure(self, path: Path, failure: Failure) -> None:
        self.progress.failed += 1
        self.on_failure(path, failure)

    def _settle(self, path: Path, *, counts: bool = False) -> None:
        """Take a file off the work that is left; the bytes of one that needed no estimate do not count for the rate."""
        size = self._sizes.pop(path, 0)
        self.progress.files_left -= 1
        if counts:
            self._done_bytes += size
        else:
            self.progress.total_bytes -= size

    def _report(self) -> None:
        tasks = self._tasks
        reading = 0
        if tasks is not None:
            reading = sum(min(tasks.read_bytes(token), content.size_bytes) for token, content in self._jobs.items())
        self.progress.done_bytes = self._done_bytes + reading
        if self._begin_ns:
            self.progress.elapsed_s = (self.clock.now_ns() - self._begin_ns) * 1e-9
        self.on_progress(self.progress)

    def _follow_renamed(self, paths: Sequence[Path]) -> None:
        """Give contents whose path is gone, or has another content, the path at which they were found."""
        copy_keys = {path_key(path) for path in paths} - {path_key(seen.path) for seen in self.contents.values()}
        for content in self.contents.values():
            self.dataset.follow(content, copy_keys)


def run_order(work: Callable[..., Estimated], order: EstimationOrder, on_bytes: Callable[[int], None]) -> Estimated:
    """Estimate one recording in a worker, which reports how far it has read.

    Raises:
        OutputError: the dataset cannot be written.
        TreadlinkError: the worker has another version of the estimators.
    """
    if order.settings.code != estimators_version():
        raise TreadlinkError(
            "a worker has another version of the estimators", "Install the same version of treadlink everywhere."
        )
    if not order.folder.is_dir():
        raise OutputError(
            f"a worker does not see the dataset: there is no folder '{order.folder}'",
            "Keep recordings and dataset on a disk that all workers share, under the same path.",
        )
    return work(order, on_bytes)


def _remedy(reason: Reason) -> str:
    if reason.code in (FleetCode.WORKER_MEMORY_ABOVE_LIMIT, FleetCode.WORKER_MEMORY_FULL):
        return "Give the workers more memory with --memory, and fewer workers if there is not enough."
    if reason.code is FleetCode.WORKER_SILENT:
        return "See that the worker's computer runs and reaches the scheduler, and run the same command again."
    return "Run it alone with `treadlink estimate` to see why."


def find_recordings(paths: Sequence[Path], where: RunFilter = EVERY_RUN) -> list[Path]:
    """Return the absolute paths of files as given, and of all `.mcap` files in folders, each once.

    Args:
        paths: of files and folders.
        where: what the description of a run must be.

    Raises:
        RecordingError: a path does not exist, or there is no recording; or none that `where` selects.
    """
    recordings: dict[Path, None] = {}
    for path in paths:
        if path.is_dir():
            recordings |= dict.fromkeys(sorted(_resolved(file) for file in _in_folder(path)))
        elif path.exists():
            recordings[path.resolve()] = None
        else:
            raise RecordingError(f"'{path}' does not exist", missing_path_remedy(path))
    if not recordings:
        raise RecordingError(
            f"no recording in {', '.join(map(repr, map(str, paths)))}",
            "Recordings in folders are found by their ending, .mcap.",
        )
    return _selected(list(recordings), where)


def _selected(paths: list[Path], where: RunFilter) -> list[Path]:
    """Return the recordings whose description fits; what is no recording has none."""
    if not where.conditions:
        return paths
    selected: list[Path] = []
    known_values: dict[str, set[str]] = {key: set() for key, _ in where.conditions}
    for path in paths:
        try:
            info = RecordingReader(path).info
        except RecordingError:
            continue
        run = info.described_run()
        for key, values in known_values.items():
            values.update(filter(None, KEYS[key](run, list(run.tires.values()))))
        if where.matches(run):
            selected.append(path)
    if not selected:
        named = (
            f"They have {key}: {', '.join(sorted(values)[:_NAMED_VALUES])}." if values else f"None states its {key}."
            for key, values in known_values.items()
        )
        raise RecordingError(f"none of {len(paths)} recordings fits {where}", " ".join(named))
    return selected


def _resolved(path: Path) -> Path:
    """Return the file that a link leads to; the link itself where there is none."""
    return path.resolve() if path.exists() else path.absolute()


def _in_folder(path: Path) -> Iterator[Path]:
    """Yield the recordings of a folder; a link to nothing is one that cannot be read, and is listed as that."""
    for file in path.rglob("*.mcap"):
        if not file.name.startswith(".") and (file.is_file() or (file.is_symlink() and not file.exists())):
            yield file


def _read_ahead(paths: Sequence[Path], waiting: queue.Queue[_Hashed | Exception | None], end: threading.Event) -> None:
    """Identify files, some ahead of the workers; an error that is no file's is raised by the thread that waits."""

    def put(hashed: _Hashed | Exception | None) -> None:
        while not end.is_set():
            try:
                waiting.put(hashed, timeout=_POLL_S)
                return
            except queue.Full:
                continue

    for path in paths:
        if end.is_set():
            return
        try:
            content = read_content(path, end)
        except RecordingError as error:
            put(_Hashed(path, None, error))
            continue
        except Exception as error:
            put(error)
            return
        if content is not None:
            put(_Hashed(path, content, None))
    put(None)


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except OSError:
        return 0
