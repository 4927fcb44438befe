"""Processes that share the work of a command: they end quietly on Ctrl-C, and a lost one is explained."""

import gc
import os
import signal
import sys
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, MutableSequence, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, ExitStack, contextmanager, nullcontext, suppress
from functools import partial
from importlib import import_module
from multiprocessing import get_context, parent_process, resource_tracker
from multiprocessing.connection import wait
from queue import Empty, SimpleQueue
from types import ModuleType, TracebackType
from typing import Any, Final, ParamSpec, Self, TypeVar

from gateway.core.errors import TreadlinkError

# Pieces of work that processes can count off together; a diagnosis has some ten to a hundred.
_COUNTERS: Final = 4096
_NONE_LEFT: Final = 1 << 60

# Time between two looks at the progress of other processes.
_POLL_S: Final = 0.1

_P = ParamSpec("_P")
_T = TypeVar("_T")
_Order = TypeVar("_Order")
_Result = TypeVar("_Result")
Work = Callable[[_Order, Callable[[int], None]], _Result]
"""Takes an order, and a function to call with how much of it is done, such as the bytes of a file read so far."""


class WorkerLostError(TreadlinkError):
    """A worker process ended before its work was done."""


class SharedNumbers:
    """Whole numbers in memory that the processes of a command share."""

    def __init__(self, count: int) -> None:
        """Create `count` zeros."""
        self._lock: AbstractContextManager[object] = nullcontext()
        self._numbers: MutableSequence[int] = []
        if count:
            context = get_context("spawn")
            self._lock, self._numbers = context.Lock(), context.RawArray("q", count)

    def take(self, index: int) -> int:
        """Return a number and add one to it, as one step."""
        with self._lock:
            number = self._numbers[index]
            self._numbers[index] = number + 1
        return number

    def put(self, index: int, number: int) -> None:
        """Change a number that no other process changes."""
        self._numbers[index] = number

    def at(self, index: int) -> int:
        """Return a number."""
        return self._numbers[index]

    def total(self) -> int:
        """Return the sum."""
        return sum(self._numbers)

    def end(self) -> None:
        """Make all numbers larger than any that is counted to."""
        with self._lock:
            for index in range(len(self._numbers)):
                self._numbers[index] = _NONE_LEFT


@contextmanager
def main_module_hidden() -> Iterator[None]:
    """Start processes meanwhile that do not import the program which runs: a script would do all its work again."""
    main = sys.modules["__main__"]
    sys.modules["__main__"] = ModuleType("__main__")
    try:
        yield
    finally:
        sys.modules["__main__"] = main


class Worker(ProcessPoolExecutor):
    """One fresh interpreter, which does its work in order; a fork would copy whatever threads and locks the caller has.

    Ctrl-C reaches all processes of a terminal. One that is still importing would print a traceback each, so they begin
    with it held back, and end by it without a word when they are up.
    """

    def __init__(self, index: int, counters: SharedNumbers, progress: SharedNumbers) -> None:
        """Create a worker; its process starts when work is submitted.

        Args:
            index: of the worker among those of the command.
            counters: that all of them count with.
            progress: of each.
        """
        super().__init__(1, get_context("spawn"), _begin, (index, counters, progress, gc.get_threshold()))

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Call `fn` in the process."""
        with interrupt_held_back(), main_module_hidden():  # what starts here inherits that
            future = super().submit(fn, *args, **kwargs)
        future.add_done_callback(self._stop_feeding)
        return future

    def work(self, work: Work[_Order, _Result], order: _Order) -> Future[_Result]:
        """Do work in the process, which reports its progress; where it has ended, the future has that error."""
        try:
            return self.submit(_worked, work, order)
        except BrokenProcessPool as error:
            lost: Future[_Result] = Future()
            lost.set_exception(error)
            return lost

    @property
    def pid(self) -> int | None:
        """Number of the process; None where none runs."""
        return next(iter(tuple(self._processes or ())), None)

    def end(self, *, at_once: bool) -> None:
        """End the process, with its work or, at once, without."""
        if at_once:
            for process in tuple((self._processes or {}).values()):
                process.terminate()
        self.shutdown(wait=True, cancel_futures=True)

    def _stop_feeding(self, done: Future[Any]) -> None:
        """Close the queue of a process that has ended.

        Python 3.11 before 3.11.5 waits without end where more than a pipe holds is on its way (python/cpython#94777).
        """
        if not done.cancelled() and isinstance(done.exception(), BrokenProcessPool):
            queue: Any = getattr(self, "_call_queue", None)
            if queue is not None:
                queue._reader.close()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait for the work to end; after an error or an interrupt, end it at once.

        Raises:
            WorkerLostError: the process was terminated from outside.
        """
        self.end(at_once=kind is not None)
        if isinstance(error, BrokenProcessPool):
            raise WorkerLostError(
                "a worker process was terminated from outside, possibly for lack of memory",
                "Close other programs, or use one process: --jobs 1.",
            ) from error


class Workers:
    """The other processes of a command that uses several; without any, the command does all work itself.

    Attributes:
        each: the processes.
        counters: shared with them: of the next piece of some work that is left to take.
        progress: likewise: of the work that each has done, as the work counts it.
    """

    def __init__(self, count: int = 0, imports: Sequence[str] = ()) -> None:
        """Start no process yet.

        Args:
            count: of processes.
            imports: names of modules that each imports first, while this process does something else.
        """
        self.counters = SharedNumbers(_COUNTERS if count else 0)
        self.progress = SharedNumbers(count)
        self.each = tuple(Worker(index, self.counters, self.progress) for index in range(count))
        self._imports = tuple(imports)
        self._counted = 0
        self._exit = ExitStack()

    def __len__(self) -> int:
        """Return the number of processes."""
        return len(self.each)

    def __enter__(self) -> Self:
        for worker in self.each:
            self._exit.enter_context(worker)
            worker.submit(_import, self._imports)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the processes.

        Raises:
            WorkerLostError: one was terminated from outside.
        """
        self.counters.end()
        self._exit.__exit__(kind, error, trace)

    def replace(self, index: int) -> None:
        """End a process at once, and put another one in its place."""
        self.each[index].end(at_once=True)
        self.progress.put(index, 0)
        worker = self._exit.enter_context(Worker(index, self.counters, self.progress))
        self.each = (*self.each[:index], worker, *self.each[index + 1 :])

    def work_on(
        self,
        work: Work[_Order, _Result],
        orders: Sequence[_Order],
        on_done: Callable[[int], None],
        sizes: Sequence[int] = (),
    ) -> Generator[tuple[int, _Result]]:
        """Yield the place and the result of each order as it is done; this process works too.

        The first error ends the work. So does closing the generator, but for what others have begun.

        Args:
            work: a function of a module, since other processes import it; any function without them.
            orders: with their results they are sent between processes; a single one is done here.
            on_done: called with how much of all orders was done since the last call.
            sizes: of each order; processes take the largest first, so that none is left alone with it at the end.
                Without them, in order.

        Raises:
            BrokenProcessPool: a process was terminated from outside; leaving `Workers` explains it.
        """
        pending = deque(sorted(range(len(orders)), key=lambda index: -sizes[index] if sizes else index))
        ended: SimpleQueue[tuple[int, Future[_Result]]] = SimpleQueue()
        # What the processes did before is of other work.
        remaining, reported, done_here = len(orders), self.progress.total(), 0

        def feed(worker: Worker) -> None:
            """Give a process the next order, and another one whenever it has done one."""
            with suppress(IndexError):
                index = pending.popleft()
                worker.work(work, orders[index]).add_done_callback(partial(take_result, worker, index))

        def take_result(worker: Worker, index: int, future: Future[_Result]) -> None:
            ended.put((index, future))
            if not future.cancelled() and future.exception() is None:
                feed(worker)

        def report(now_here: int) -> None:
            nonlocal reported
            total = self.progress.total() + now_here
            on_done(total - reported)
            reported = total

        try:
            # One order is done here; of two, another process has the first, as it must not be idle.
            for worker in self.each[: remaining - 1]:
                feed(worker)
            while remaining:
                index = None
                with suppress(IndexError):
                    index = pending.popleft()
                if index is not None:
                    done_before = done_here

                    def on_part(part: int, done_before: int = done_before) -> None:
                        nonlocal done_here
                        done_here = done_before + part
                        report(done_here)

                    result = work(orders[index], on_part)
                    remaining -= 1
                    yield index, result
                while remaining:
                    try:
                        order_index, future = ended.get(timeout=_POLL_S) if index is None else ended.get_nowait()
                    except Empty:
                        report(done_here)
                        break
                    report(done_here)
                    remaining -= 1
                    yield order_index, future.result()
        finally:
            pending.clear()

    def new_counter(self) -> int | None:
        """Return the place of a counter that is 0; None where there is no process to share it with, or none left."""
        if not self.each or self._counted == _COUNTERS:
            return None
        self._counted += 1
        return self._counted - 1


_worker_index: int = 0
_counters: SharedNumbers | None = None
_progress: SharedNumbers | None = None
_done: int = 0


def shared_counters() -> SharedNumbers:
    """Return, in a worker, the counters of its command."""
    assert _counters is not None
    return _counters


@contextmanager
def reported_progress() -> Iterator[Callable[[int], None]]:
    """Yield, in a worker, a function that takes how much of a piece of work is done."""
    global _done
    assert _progress is not None
    progress, done_before, done_here = _progress, _done, 0

    def report(done: int) -> None:
        nonlocal done_here
        done_here = done
        progress.put(_worker_index, done_before + done_here)

    yield report
    _done = done_before + done_here


def _worked(work: Work[_Order, _Result], order: _Order) -> _Result:
    """Do work in a worker."""
    with reported_progress() as report:
        return work(order, report)


def _begin(index: int, counters: SharedNumbers, progress: SharedNumbers, gc_threshold: tuple[int, int, int]) -> None:
    global _worker_index, _counters, _progress
    gc.set_threshold(*gc_threshold)
    _worker_index, _counters, _progress = index, counters, progress
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:  # as of a command that a script runs in the background
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    """End this process when the command is gone: killed, it cannot end its processes itself."""
    parent = parent_process()
    if parent is not None:
        wait([parent.sentinel])
        os._exit(1)


def _import(names: Sequence[str]) -> None:
    for name in names:
        import_module(name)


@contextmanager
def interrupt_held_back() -> Iterator[None]:
    """Block Ctrl-C in this thread, if the system can; it is delivered afterwards.

    Processes and threads that are started meanwhile inherit that it is blocked.
    """
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Starting the first process starts this one, which then unblocks what is blocked here.
    resource_tracker.ensure_running()
    previous_mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, previous_mask)
