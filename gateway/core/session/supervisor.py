"""The supervisor of the threads of a session: it sees the end of every one that an error ends, whoever started it."""

import logging
import threading
from collections import deque
from typing import NamedTuple

_logger = logging.getLogger(__name__)


class ThreadEnd(NamedTuple):
    """A thread that an error has ended.

    Attributes:
        name: of the thread.
        error: what it raised.
    """

    name: str
    error: BaseException


class Supervisor:
    """Takes note of errors that end threads until it is closed; threads of plug-ins and libraries are included."""

    def __init__(self) -> None:
        """Begin to take note."""
        self._ends: deque[ThreadEnd] = deque()
        self._previous_hook, self._hook = threading.excepthook, self._ended
        threading.excepthook = self._hook

    def close(self) -> None:
        """Leave errors to who had them before."""
        if threading.excepthook is self._hook:
            threading.excepthook = self._previous_hook

    def take(self) -> list[ThreadEnd]:
        """Return the threads that have ended by an error since the last call."""
        ends: list[ThreadEnd] = []
        while self._ends:
            ends.append(self._ends.popleft())
        return ends

    def _ended(self, args: threading.ExceptHookArgs) -> None:
        if args.exc_type is SystemExit or args.exc_value is None:
            return
        name = args.thread.name if args.thread is not None else "?"
        _logger.debug("thread %s ended by an error", name, exc_info=args.exc_value)
        self._ends.append(ThreadEnd(name, args.exc_value))
