"""Tasks of worker processes: given, tried again where a worker ends, and waited for."""

from __future__ import annotations

import queue
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from gateway.clock import SystemClock
from gateway.errors import TreadlinkError
from gateway.fleet.worker_cluster import Workers
from gateway.reasons import Code, Reason

ATTEMPTS: Final = 2
"""Times that a task is tried when its worker ends."""

_TOPIC: Final = "treadlink-campaign"
_REPORT_NS: Final = 500_000_000


class TaskResult(NamedTuple):
    """A finished task.

    Attributes:
        token: of the task.
        outcome: what it returned; None when its worker ended each time.
        ended: why there is no outcome.
        attempts: times that it was tried.
    """

    token: str
    outcome: Any
    ended: Reason | None
    attempts: int


class TaskPosition(NamedTuple):
    """How far a running task has read its file, in bytes."""

    token: str
    position: int


class _Running:
    """A task that a worker has, or will have."""

    def __init__(self, function: Callable[..., Any], arguments: tuple[Any, ...]) -> None:
        self.function = function
        self.arguments = arguments
        self.attempts = 0
        self.ended_before = 0
        self.future: Any = None


class WorkerTasks:
    """Tasks at the workers, by token. A task whose worker ends or has no memory left is tried once more."""

    def __init__(self, workers: Workers, memory_bytes: int = 0) -> None:
        """Take the workers.

        Args:
            workers: connected.
            memory_bytes: limit of one, for reasons; 0 when it is not known.
        """
        self._workers = workers
        self._memory_bytes = memory_bytes
        self._running: dict[str, _Running] = {}
        self._events: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._number = 0
        workers.client.subscribe_topic(_TOPIC, self._take_position)

    def places(self) -> int:
        """Return the number of tasks that run at once."""
        return self._workers.count()

    def submit(self, token: str, function: Callable[..., Any], *arguments: Any) -> None:
        """Give a task to the workers."""
        self._start(token, _Running(function, arguments))

    def wait(self, timeout_s: float) -> TaskResult | TaskPosition | None:
        """Return the next result, or how far a task is; None after the time.

        Raises:
            TreadlinkError: the workers cannot do it at all, or the task has raised it.
        """
        try:
            event = self._events.get(timeout=timeout_s)
        except queue.Empty:
            return None
        if isinstance(event, TaskPosition):
            return event if event.token in self._running else None
        token, future = event
        task = self._running.get(token)
        return None if task is None or task.future is not future else self._result(token, task)

    def cancel(self) -> None:
        """Take back all tasks."""
        futures = [task.future for task in self._running.values()]
        self._running.clear()
        if futures:
            self._workers.client.cancel(futures, force=True)
        self._workers.client.unsubscribe_topic(_TOPIC)

    def _start(self, token: str, task: _Running) -> None:
        self._number += 1
        task.attempts += 1
        task.ended_before = self._workers.ended_for_memory()
        self._running[token] = task
        # The argument `key` is dask's: one for each attempt, or it would return the result of the first.
        key = f"treadlink-{token}-{self._number}"
        future = self._workers.client.submit(task.function, *task.arguments, key=key, pure=False, retries=0)
        task.future = future
        future.add_done_callback(lambda done: self._events.put((token, done)))

    def _result(self, token: str, task: _Running) -> TaskResult | None:
        from distributed import KilledWorker

        del self._running[token]
        future, task.future = task.future, None
        try:
            outcome = future.result()
        except (KilledWorker, MemoryError) as error:
            if task.attempts < ATTEMPTS:
                self._start(token, task)
                return None
            return TaskResult(token, None, self._why_ended(task, error), task.attempts)
        except TreadlinkError:
            raise
        except Exception as error:
            # What a worker raises before it calls the function: it cannot import this treadlink.
            raise TreadlinkError(
                f"the workers cannot estimate: {type(error).__name__}: {error}",
                "Install the same version of treadlink, with the same packages, where the workers run.",
            ) from error
        finally:
            # A result that is held is computed again when the worker that has it ends.
            future.release()
        return TaskResult(token, outcome, None, task.attempts)

    def _why_ended(self, task: _Running, error: Exception) -> Reason:
        if isinstance(error, MemoryError):
            return Reason(Code.WORKER_MEMORY_FULL)
        if self._workers.ended_for_memory() != task.ended_before:
            return Reason(Code.WORKER_MEMORY_ABOVE_LIMIT, limit_bytes=self._memory_bytes)
        return Reason(Code.WORKER_ENDED)

    def _take_position(self, event: tuple[float, Any]) -> None:
        token, position = event[1]
        self._events.put(TaskPosition(str(token), int(position)))


def position_reporter(token: str) -> Callable[[int], None]:
    """Return what a task calls with the bytes read so far; it reports them twice a second."""
    from distributed import get_worker

    worker, clock, due_ns = get_worker(), SystemClock(), 0

    def report(position: int) -> None:
        nonlocal due_ns
        now_ns = clock.now_ns()
        if now_ns >= due_ns:
            due_ns = now_ns + _REPORT_NS
            worker.log_event(_TOPIC, [token, position])

    return report
