"""Work on several recordings, in this process alone or shared with others."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Generator, Sequence
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from functools import partial
from queue import Empty, SimpleQueue
from typing import Any, Final, Generic, TypeVar

from gateway.worker_pool import Worker, Workers, reported_progress

_Order = TypeVar("_Order")
_Result = TypeVar("_Result")
Work = Callable[[_Order, Callable[[int], None]], _Result]
"""Takes an order, and a function to call with the bytes of the file read so far."""

_POLL_S: Final = 0.1


def work_on_recordings(
    work: Work[_Order, _Result],
    orders: Sequence[_Order],
    workers: Workers,
    on_bytes: Callable[[int], None],
    begin: Callable[[], object] | None = None,
    sizes: Sequence[int] = (),
) -> Generator[tuple[int, _Result]]:
    """Yield the place and the result of each order as it is done; this process works too.

    The first error ends the work. So does closing the generator, but for what others have begun.

    Args:
        work: a function of a module, since other processes import it; any function without them.
        orders: one per recording; with their results they are sent between processes.
        workers: the other processes; with a single order the work is done here.
        on_bytes: called with the number of bytes of all files read since the last call.
        begin: called first in each other process.
        sizes: of each order; processes take the largest first, so that none is left alone with it at the end. Without
            them, in order.

    Raises:
        BrokenProcessPool: a process was terminated from outside; `Workers` explains it.
    """
    turns = sorted(range(len(orders)), key=lambda place: -sizes[place] if sizes else place)
    shared = _Shared(work, orders, turns, workers, on_bytes)
    try:
        # One order is done here; of two, another process has the first, as it must not be idle.
        for worker in workers.each[: len(orders) - 1]:
            if begin is not None:
                worker.submit(begin)
            shared.feed(worker)
        while shared.left:
            place = shared.next()
            if place is not None:
                yield place, work(orders[place], shared.here())
            yield from shared.done(wait=place is None)
    finally:
        shared.waiting.clear()


class _Shared(Generic[_Order, _Result]):
    """Orders that several processes take one after the other."""

    def __init__(
        self,
        work: Work[_Order, _Result],
        orders: Sequence[_Order],
        turns: Sequence[int],
        workers: Workers,
        on_bytes: Callable[[int], None],
    ) -> None:
        self.waiting = deque(turns)
        self.left = len(orders)
        self._work = work
        self._orders = orders
        self._on_bytes = on_bytes
        self._progress = workers.progress
        self._ended: SimpleQueue[tuple[int, Future[_Result]]] = SimpleQueue()
        # What the workers read before is of other work.
        self._read = workers.progress.total()
        self._read_here = 0

    def next(self) -> int | None:
        """Return the place of the next order, which the caller does; None when all are taken."""
        try:
            place = self.waiting.popleft()
        except IndexError:
            return None
        self.left -= 1
        return place

    def feed(self, worker: Worker) -> None:
        """Give a worker the next order, and another one whenever it has done one."""
        try:
            place = self.waiting.popleft()
        except IndexError:
            return
        try:
            future = worker.submit(partial(_work_elsewhere, self._work), self._orders[place])
        except BrokenProcessPool as error:  # it ended while it had no work
            future = Future()
            future.set_exception(error)

        def ended(future: Future[_Result]) -> None:
            self._ended.put((place, future))
            if not future.cancelled() and future.exception() is None:
                self.feed(worker)

        future.add_done_callback(ended)

    def here(self) -> Callable[[int], None]:
        """Return a function that takes the bytes of a file that this process has read."""
        before = self._read_here

        def on_position(position: int) -> None:
            self._read_here = before + position
            self._report()

        return on_position

    def done(self, *, wait: bool) -> Generator[tuple[int, _Result]]:
        """Yield what other processes have done; wait for some time where there is nothing else to do."""
        while self.left:
            try:
                place, future = self._ended.get(timeout=_POLL_S) if wait else self._ended.get_nowait()
            except Empty:
                self._report()
                return
            self._report()
            self.left -= 1
            yield place, future.result()

    def _report(self) -> None:
        now = self._progress.total() + self._read_here
        self._on_bytes(now - self._read)
        self._read = now


def _work_elsewhere(work: Work[Any, _Result], order: Any) -> _Result:
    with reported_progress() as on_position:
        return work(order, on_position)
