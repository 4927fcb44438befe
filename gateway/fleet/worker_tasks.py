"""Tasks of a campaign at worker processes: given, tried again where a worker ends, and waited for."""

import queue
from abc import ABC, abstractmethod
from collections.abc import Callable
from typing import Any, Final, NamedTuple

from gateway.core.errors import TreadlinkError
from gateway.core.reasons import Reason
from gateway.fleet.reasons import FleetCode

ATTEMPTS: Final = 2
"""Times that a task is tried when its worker ends."""

Work = Callable[[Any, Callable[[int], None]], Any]
"""Takes an order, and a function to call with the bytes of the file read so far."""


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


class RunningTask:
    """A task that a worker has, or will have; `key` names its attempt to a scheduler."""

    def __init__(self, token: str, work: Work, order: Any, returns: type) -> None:
        """Take the work, its order and the type of its result."""
        self.token = token
        self.work = work
        self.order = order
        self.returns = returns
        self.attempts = 0
        self.read_bytes = 0
        self.key = ""
        self.future: Any = None


class WorkerTasks(ABC):
    """Tasks at the workers, by token. A task whose worker ends, is silent or has no memory left is tried once more."""

    def __init__(self) -> None:
        """Begin without a task."""
        self._running: dict[str, RunningTask] = {}
        self._ended: queue.SimpleQueue[tuple[str, Any]] = queue.SimpleQueue()

    @abstractmethod
    def places(self) -> int:
        """Return the number of tasks that run at once."""

    @abstractmethod
    def read_bytes(self, token: str) -> int:
        """Return how far a running task has read its file."""

    @abstractmethod
    def cancel(self) -> None:
        """Take back all tasks, those that run too."""

    @abstractmethod
    def _begin(self, task: RunningTask) -> Any:
        """Give a task to a worker and return its future."""

    @abstractmethod
    def _outcome(self, task: RunningTask) -> Any:
        """Return what a task returned, or the reason for which its worker ended."""

    def submit(self, token: str, work: Work, order: Any, returns: type = object) -> None:
        """Give a task to the workers, as many as there are places; `returns` is the type of its result."""
        self._start(RunningTask(token, work, order, returns))

    def wait(self, timeout_s: float) -> TaskResult | None:
        """Return the next result; None after the time.

        Raises:
            TreadlinkError: the workers cannot do it at all, or the task has raised it.
        """
        try:
            token, future = self._ended.get(timeout=timeout_s)
        except queue.Empty:
            return None
        task = self._running.get(token)
        if task is None or task.future is not future:
            return None
        del self._running[token]
        try:
            outcome = self._outcome(task)
        except MemoryError:
            outcome = Reason(FleetCode.WORKER_MEMORY_FULL)
        if not isinstance(outcome, Reason):
            if not isinstance(outcome, task.returns):
                raise TreadlinkError(
                    f"a worker returned {type(outcome).__name__} instead of {task.returns.__name__}",
                    "Use a scheduler and workers of your own.",
                )
            return TaskResult(token, outcome, None, task.attempts)
        return self._try_again(task, outcome)

    def _try_again(self, task: RunningTask, ended: Reason) -> TaskResult | None:
        """Give a task to a worker again, or return why its worker did not do it."""
        if task.attempts == ATTEMPTS:
            return TaskResult(task.token, None, ended, task.attempts)
        self._start(task)
        return None

    def _start(self, task: RunningTask) -> None:
        task.attempts += 1
        self._running[task.token] = task
        task.future = future = self._begin(task)
        future.add_done_callback(lambda done: self._ended.put((task.token, done)))
