"""Pool of worker processes that ends quietly on Ctrl-C."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from types import TracebackType
from typing import Any, ParamSpec, TypeVar

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
        """Cancel work that has not started and wait for the rest; after an interrupt, end that too."""
        if kind is not None and issubclass(kind, KeyboardInterrupt):
            for process in tuple((self._processes or {}).values()):
                process.terminate()
        self.shutdown(wait=True, cancel_futures=True)


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
