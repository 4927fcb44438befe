"""Work on several recordings, in this process one after another or in several processes."""

from __future__ import annotations

from collections.abc import Callable, Generator, MutableSequence, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, wait
from functools import partial
from multiprocessing import get_context
from typing import Any, Final, TypeVar

from gateway.closure.inference.worker_pool import Processes

_Order = TypeVar("_Order")
_Result = TypeVar("_Result")
Work = Callable[[_Order, Callable[[int], None]], _Result]
"""Takes an order, and a function to call with the bytes of the file read so far."""

_POLL_S: Final = 0.1


def work_on_recordings(
    work: Work[_Order, _Result],
    orders: Sequence[_Order],
    jobs: int,
    on_bytes: Callable[[int], None],
    begin: Callable[[], object] | None = None,
    sizes: Sequence[int] = (),
) -> Generator[tuple[int, _Result]]:
    """Yield the place and the result of each order as it is done.

    The first error ends the work on all of them. So does closing the generator.

    Args:
        work: a function of a module, since other processes import it.
        orders: one per recording; with their results they are sent between processes.
        jobs: maximum number of processes; with one job or one order the work is done here, in order.
        on_bytes: called with the number of bytes of all files read since the last call.
        begin: called first in each process.
        sizes: of each order; processes take the largest first, so that none is left alone with it at the end. Without
            them, in order.

    Raises:
        TreadlinkError: a process was terminated from outside.
    """
    if jobs > 1 and len(orders) > 1:
        turns = sorted(range(len(orders)), key=lambda place: -sizes[place] if sizes else place)
        yield from _in_processes(work, orders, turns, min(jobs, len(orders)), on_bytes, begin)
        return
    for place, order in enumerate(orders):
        read = 0

        def on_position(position: int) -> None:
            nonlocal read
            on_bytes(position - read)
            read = position

        yield place, work(order, on_position)


def _in_processes(
    work: Work[_Order, _Result],
    orders: Sequence[_Order],
    turns: Sequence[int],
    jobs: int,
    on_bytes: Callable[[int], None],
    begin: Callable[[], object] | None,
) -> Generator[tuple[int, _Result]]:
    # Shared memory carries the progress of each process without messages on a queue.
    positions = get_context("spawn").RawArray("q", len(orders))
    read = 0
    with Processes(jobs, _begin, (positions, begin)) as pool:
        places: dict[Future[_Result], int] = {
            pool.submit(partial(_work_in_process, work), orders[place], place): place for place in turns
        }
        waiting = set(places)
        while waiting:
            finished, waiting = wait(waiting, _POLL_S, FIRST_COMPLETED)
            now = sum(positions)
            on_bytes(now - read)
            read = now
            for future in finished:
                yield places[future], future.result()


_positions: MutableSequence[int] | None = None


def _begin(positions: MutableSequence[int], begin: Callable[[], object] | None) -> None:
    """Take, in a new process, the shared memory for its progress."""
    global _positions
    _positions = positions
    if begin is not None:
        begin()


def _work_in_process(work: Work[Any, _Result], order: Any, place: int) -> _Result:
    def on_position(position: int) -> None:
        assert _positions is not None
        _positions[place] = position

    return work(order, on_position)
