"""Tasks of a campaign at processes of this machine. They talk through pipes: no socket is opened."""

import logging
import signal
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from types import TracebackType
from typing import Any, Final, Self

from gateway.core.errors import TreadlinkError
from gateway.core.reasons import Reason
from gateway.core.worker_pool import Workers
from gateway.fleet.reasons import FleetCode
from gateway.fleet.worker_tasks import RunningTask, TaskResult, WorkerTasks

DEFAULT_MEMORY_BYTES: Final = 2_000_000_000
"""Memory of a worker process, at which it is ended."""


class WorkersNotStartedError(TreadlinkError):
    """The worker processes of this machine did not start."""


class LocalTasks(WorkerTasks):
    """Tasks at processes of this machine, one at a time each. A process that ends is replaced."""

    def __init__(self, count: int, memory_bytes: int = DEFAULT_MEMORY_BYTES) -> None:
        """Start no process yet.

        Args:
            count: of processes.
            memory_bytes: of a process, at which it is ended.
        """
        super().__init__()
        self._workers = Workers(count)
        self._memory_bytes = memory_bytes
        self._tasks: list[RunningTask | None] = [None] * count
        self._preparations: list[Future[None] | None] = [None] * count
        self._start_bytes = [0] * count
        self._above_limit: set[int] = set()

    def __enter__(self) -> Self:
        self._workers.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the processes, with what they do."""
        self.cancel()
        self._workers.__exit__(kind, error, trace)

    def places(self) -> int:
        """Return the number of processes."""
        return len(self._workers)

    def read_bytes(self, token: str) -> int:
        """Return how far a running task has read its file."""
        task = self._running.get(token)
        if task is None:
            return 0
        index = self._tasks.index(task)
        return self._workers.progress.at(index) - self._start_bytes[index]

    def wait(self, timeout_s: float) -> TaskResult | None:
        """Return the next result; None after the time.

        Raises:
            WorkersNotStartedError: a process ended while it started.
            TreadlinkError: the task has raised it.
        """
        self._end_above_limit()
        return super().wait(timeout_s)

    def cancel(self) -> None:
        """Take back all tasks; a process that has one is ended."""
        self._running.clear()
        for index, task in enumerate(self._tasks):
            if task is not None:
                self._replace(index)

    def _begin(self, task: RunningTask) -> Future[Any]:
        index = self._tasks.index(None)
        self._tasks[index] = task
        try:
            if self._preparations[index] is None:
                self._preparations[index] = self._workers.each[index].submit(_ignore_interrupt)
            self._start_bytes[index] = self._workers.progress.at(index)
            return self._workers.each[index].work(task.work, task.order)
        except OSError as error:
            raise _not_started(error) from error

    def _outcome(self, task: RunningTask) -> Any:
        index = self._tasks.index(task)
        try:
            outcome = task.future.result()
        except BrokenProcessPool as error:
            preparation = self._preparations[index]
            above_limit = index in self._above_limit
            self._replace(index)
            if preparation is not None and preparation.exception() is not None:
                raise _not_started(error) from error
            if above_limit:
                return Reason(FleetCode.WORKER_MEMORY_ABOVE_LIMIT, limit_bytes=self._memory_bytes)
            return Reason(FleetCode.WORKER_ENDED)
        finally:
            self._tasks[index] = None
        return outcome

    def _replace(self, index: int) -> None:
        self._workers.replace(index)
        self._tasks[index] = None
        self._preparations[index] = None
        self._above_limit.discard(index)

    def _end_above_limit(self) -> None:
        import psutil

        for index, worker in enumerate(self._workers.each):
            pid = worker.pid
            with suppress(psutil.Error):
                if pid is not None and psutil.Process(pid).memory_info().rss > self._memory_bytes:
                    self._above_limit.add(index)
                    psutil.Process(pid).kill()


def _not_started(error: Exception) -> WorkersNotStartedError:
    return WorkersNotStartedError(
        f"the worker processes did not start: {error}",
        "Another program may have ended them, or memory is short; try again, or with a smaller --jobs.",
    )


def _ignore_interrupt() -> None:
    """Prepare a worker: a terminal sends Ctrl-C to all processes, and the campaign ends its workers itself.

    Alarms are rows of the dataset. Printed by a worker, they would stand within the progress of the campaign, and name
    a wheel but no recording.
    """
    program = logging.getLogger("gateway")
    if not program.handlers:
        program.addHandler(logging.NullHandler())
    signal.signal(signal.SIGINT, signal.SIG_IGN)
