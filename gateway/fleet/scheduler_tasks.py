"""Tasks of a campaign at the workers of a dask scheduler."""

from __future__ import annotations

import logging
import threading
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import CancelledError
from contextlib import contextmanager
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Final

from gateway.core.clock import Clock, SystemClock
from gateway.core.errors import OutputError, TreadlinkError
from gateway.core.reasons import Reason
from gateway.core.text.wording import text
from gateway.fleet.content_keys import diagnosis_version, estimators_version
from gateway.fleet.reasons import FleetCode
from gateway.fleet.worker_tasks import RunningTask, TaskResult, Work, WorkerTasks

_log = logging.getLogger(__name__)

_CONNECT_S: Final = 10.0
_CLOSE_S: Final = 5.0
# Longer than a busy scheduler takes, or a short cut of the network.
_ANSWER_S: Final = 60.0
# A worker sends signs of life to its scheduler every few seconds, also while it estimates.
_SILENT_NS: Final = 60_000_000_000
_LOOK_NS: Final = 5_000_000_000
# One that ended is started again by its nanny within a few seconds.
_LOOKS_WITHOUT_WORKER: Final = 3
_TOPIC: Final = "treadlink-campaign"
_REPORT_NS: Final = 500_000_000


@contextmanager
def scheduler_tasks(address: str) -> Iterator[SchedulerTasks]:
    """Connect to a dask scheduler.

    Raises:
        OutputError: dask is not installed.
        TreadlinkError: no scheduler answers at this address, or it or a worker is of another version.
    """
    try:
        import dask
        from distributed import Client
    except ImportError as error:
        raise OutputError(
            "--scheduler needs the package dask[distributed]", "Install: pip install 'treadlink[campaign,cluster]'"
        ) from error
    # What dask reports of ended workers, the campaign reports.
    level = logging.INFO if logging.getLogger("gateway").isEnabledFor(logging.DEBUG) else logging.CRITICAL
    logging.getLogger("distributed").setLevel(level)

    class AbandonedClient(Client):
        """A client that may be left behind: that of dask waits for its scheduler when the program ends."""

        def __del__(self) -> None:
            """Leave the connection to the end of the process."""

    def connected() -> Any:
        with dask.config.set({"distributed.comm.timeouts.connect": f"{_CONNECT_S:.0f}s"}):
            return AbandonedClient(address, timeout=_CONNECT_S, set_as_default=False)  # type: ignore[no-untyped-call]

    try:
        client = _in_time(connected, 2 * _CONNECT_S)
    except Exception as error:  # whatever dask makes of an answer that is not of a scheduler
        raise TreadlinkError(
            f"no dask scheduler answers at '{address}': {error}",
            "Start one with `dask scheduler`, and workers with `dask worker`; tls:// needs certificates on all sides.",
        ) from error
    try:
        _check_workers(client)
        yield SchedulerTasks(client, SystemClock())
    finally:
        client.close(timeout=_CLOSE_S)


def _in_time(call: Callable[[], Any], most_s: float) -> Any:
    """Return the result of a call that is left to itself when it takes too long, as with a port that says nothing.

    Raises:
        TimeoutError: it takes longer than `most_s`.
        Exception: the call's own.
    """
    results: SimpleQueue[tuple[Any, Exception | None]] = SimpleQueue()

    def run() -> None:
        try:
            results.put((call(), None))
        except Exception as error:
            results.put((None, error))

    threading.Thread(target=run, name="scheduler", daemon=True).start()
    try:
        result, error = results.get(timeout=most_s)
    except Empty:
        raise TimeoutError(f"no answer for {most_s:.0f} s") from None
    if error is not None:
        raise error
    return result


def code_of_worker() -> tuple[str, str]:
    """Return the identity of the code that estimates and diagnoses where this runs."""
    return estimators_version(), diagnosis_version()


def _check_workers(client: Any) -> None:
    """Compare the code of the workers with this one's, before any recording is estimated by another.

    Raises:
        TreadlinkError: a worker has another, or none.
    """
    try:
        codes = _in_time(partial(client.run, code_of_worker, on_error="return"), _CONNECT_S)
    except TimeoutError:  # one is busy, paused or cut off; each is asked again before its first recording
        return
    others = [str(worker) for worker, code in codes.items() if code != _own_code()]
    if others:
        raise _other_version(f"{len(others)} of {len(codes)} workers have another treadlink, or none: {others[0]}")


def _own_code() -> tuple[str, str]:
    return code_of_worker()


def _other_version(message: str) -> TreadlinkError:
    return TreadlinkError(
        message, "Install the same version of treadlink, with the same packages, where the workers run."
    )


def _silence(worker: str) -> Reason:
    return Reason(FleetCode.WORKER_SILENT, worker=worker, silent_s=_SILENT_NS * 1e-9)


def _lost_connection() -> TreadlinkError:
    return TreadlinkError(
        "the connection to the dask scheduler was lost: it ended or restarted, or the network is down",
        "Start it again with its workers, and repeat the command: recordings that are done are kept.",
    )


class _SignsOfLife:
    """Time for which each worker has sent nothing to its scheduler."""

    def __init__(self, clock: Clock) -> None:
        self.silent: set[str] = set()
        self.alive: set[str] = set()
        self._clock = clock
        self._looked_ns: int | None = None
        # The scheduler's time of the last sign, and for how long it has not changed.
        self._workers: dict[str, tuple[float, int]] = {}

    def is_due(self) -> bool:
        """Return whether it is time to look."""
        return self._looked_ns is None or self._clock.now_ns() - self._looked_ns >= _LOOK_NS

    def look(self, last_seen: Mapping[str, float]) -> list[str]:
        """Take the scheduler's times of the last signs by worker; return the workers that are silent from now on."""
        now_ns = self._clock.now_ns()
        # A pause of this computer is no silence of the workers.
        elapsed_ns = 0 if self._looked_ns is None else min(now_ns - self._looked_ns, 2 * _LOOK_NS)
        self._looked_ns = now_ns
        previous, self._workers = self._workers, {}
        for worker, sign_s in last_seen.items():
            previous_sign_s, silent_ns = previous.get(worker, (None, 0))
            self._workers[worker] = sign_s, silent_ns + elapsed_ns if sign_s == previous_sign_s else 0
        silent_before = self.silent
        self.silent = {worker for worker, (_, silent_ns) in self._workers.items() if silent_ns >= _SILENT_NS}
        self.alive = self._workers.keys() - self.silent
        return sorted(self.silent - silent_before)


class SchedulerTasks(WorkerTasks):
    """Tasks at the workers of a dask scheduler."""

    def __init__(self, client: Any, clock: Clock) -> None:
        """Take the client of dask.distributed, and the clock by which workers are silent."""
        super().__init__()
        self._client = client
        self._number = 0
        self._signs = _SignsOfLife(clock)
        # Looks in a row at which there was no worker.
        self._without_worker = 0
        client.subscribe_topic(_TOPIC, self._take_position)

    def places(self) -> int:
        """Return the number of threads of all workers but the silent ones."""
        threads: dict[str, int] = self._answer(self._client.scheduler.ncores)
        return sum(number for worker, number in threads.items() if worker not in self._signs.silent)

    def read_bytes(self, token: str) -> int:
        """Return how far a running task has read its file."""
        task = self._running.get(token)
        return 0 if task is None else task.read_bytes

    def wait(self, timeout_s: float) -> TaskResult | None:
        """Return the next result; None after the time.

        Raises:
            TreadlinkError: the workers cannot do it at all, or the task has raised it.
        """
        if self._signs.is_due() and (result := self._take_from_silent_workers()) is not None:
            return result
        return super().wait(timeout_s)

    def cancel(self) -> None:
        """Take back all tasks."""
        futures = [task.future for task in self._running.values()]
        self._running.clear()
        if futures:
            self._client.cancel(futures, force=True)

    def _answer(self, question: Callable[..., Any], **options: Any) -> Any:
        """Return an answer of the scheduler.

        Raises:
            TreadlinkError: there is no connection, or no answer in time.
        """
        try:
            return self._client.sync(question, callback_timeout=_ANSWER_S, **options)
        except OSError as error:
            raise _lost_connection() from error

    def _take_from_silent_workers(self) -> TaskResult | None:
        """Name workers that have become silent and give their tasks to others; return one that is not tried again."""
        identity = self._answer(self._client.scheduler.identity)
        newly_silent = self._signs.look({name: entry["last_seen"] for name, entry in identity["workers"].items()})
        for worker in newly_silent:
            _log.warning("%s", text(_silence(worker)))
        self._without_worker = 0 if identity["workers"] else self._without_worker + 1
        if self._without_worker == _LOOKS_WITHOUT_WORKER:
            _log.warning("%s", text(Reason(FleetCode.WORKERS_ABSENT, address=identity["address"])))
        if not self._signs.silent or not self._signs.alive:
            return None
        tasks = {task.key: task for task in self._running.values()}
        keys_by_worker = self._answer(self._client.scheduler.processing)
        for worker in sorted(self._signs.silent):
            for task in (tasks[key] for key in keys_by_worker.get(worker, ()) if key in tasks):
                del self._running[task.token]
                self._client.cancel([task.future], force=True)
                task.read_bytes = 0
                # A scheduler that balances its workers gives tasks to a silent one, which seems idle: no attempt.
                task.attempts -= worker not in newly_silent
                if (result := self._try_again(task, _silence(worker))) is not None:
                    return result
        return None

    def _begin(self, task: RunningTask) -> Any:
        self._number += 1
        # The argument `key` is dask's: one for each attempt, or it would return the result of the first.
        task.key = f"treadlink-{task.token}-{self._number}"
        work = partial(_work, task.work, task.token, _own_code())
        options: dict[str, Any] = {}
        if self._signs.silent and self._signs.alive:
            # Others may do it when all of these have ended.
            options = {"workers": sorted(self._signs.alive), "allow_other_workers": True}
        return self._client.submit(work, task.order, key=task.key, pure=False, retries=0, **options)

    def _outcome(self, task: RunningTask) -> Any:
        from distributed import KilledWorker

        try:
            return task.future.result()
        except KilledWorker:
            return Reason(FleetCode.WORKER_ENDED)
        except (MemoryError, TreadlinkError):
            raise
        except CancelledError as error:  # this side cancels no task that it waits for
            raise _lost_connection() from error
        except Exception as error:
            # What a worker raises before it calls the function: it cannot import this treadlink.
            raise _other_version(f"the workers cannot estimate: {type(error).__name__}: {error}") from error
        finally:
            # A result that is held is computed again when the worker that has it ends.
            task.future.release()

    def _take_position(self, event: tuple[float, Any]) -> None:
        match event:
            case [_, [str(token), int(position)]] if position >= 0 and token in self._running:
                self._running[token].read_bytes = position


def _work(work: Work, token: str, code: tuple[str, str], order: Any) -> Any:
    """Do the work in a worker of dask, which reports the bytes read twice a second; it may have come later.

    Raises:
        TreadlinkError: the worker has another code.
    """
    from distributed import get_worker

    if code != code_of_worker():
        raise _other_version(f"the worker {get_worker().address} has another treadlink")
    worker, clock, due_ns = get_worker(), SystemClock(), 0

    def report(position: int) -> None:
        nonlocal due_ns
        now_ns = clock.now_ns()
        if now_ns >= due_ns:
            due_ns = now_ns + _REPORT_NS
            worker.log_event(_TOPIC, [token, position])

    return work(order, report)
