"""Pool of worker processes that ends quietly on Ctrl-C, and explains a lost process."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from types import TracebackType
from typing import Any, ParamSpec, TypeVar

from gateway.errors import TreadlinkError

_P = ParamSpec("_P")
_T = TypeVar("_T")


class Processes(ProcessPoolExecutor):
    """A pool of fresh interpreters; a fork would copy whatever threads and locks the caller has.

    Ctrl-C reaches all processes of a terminal. One that is still importing would print a traceback each, so they begin
    with it held back, and end by it without a word when they are up.
    """

    def __init__(self, jobs: int, begin: Callable[..., object] | None = None, arguments: tuple[Any, ...] = ()) -> None:
        """Create a pool; processes start when work is submitted.

        Args:
            jobs: maximum number of processes.
            begin: called first in each process.
            arguments: arguments of `begin`.
        """
        super().__init__(jobs, get_context("spawn"), _begin, (begin, arguments))

    def submit(self, fn: Callable[_P, _T], /, *args: _P.args, **kwargs: _P.kwargs) -> Future[_T]:
        """Call `fn` in a process."""
        with _interrupt_held_back():  # what starts here inherits that
            return super().submit(fn, *args, **kwargs)

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait for the work to end; after an error or an interrupt, end it at once.

        Raises:
            TreadlinkError: a process was terminated from outside.
        """
        if kind is not None:
            for process in tuple((self._processes or {}).values()):
                process.terminate()
        self.shutdown(wait=True, cancel_futures=True)
        if isinstance(error, BrokenProcessPool):
            raise TreadlinkError(
                "a worker process was terminated from outside, possibly for lack of memory",
                "Close other programs, or use one process: --jobs 1.",
            ) from error


def _begin(begin: Callable[..., object] | None, arguments: tuple[Any, ...]) -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)
    if hasattr(signal, "pthread_sigmask"):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    if begin is not None:
        begin(*arguments)


@contextmanager
def _interrupt_held_back() -> Iterator[None]:
    """Block Ctrl-C in this thread, if the system can; it is delivered afterwards."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)
