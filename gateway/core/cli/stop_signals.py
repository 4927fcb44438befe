"""Signals that end a command: Ctrl-C (SIGINT), SIGTERM, and SIGHUP, which a closed terminal sends."""

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType
from typing import Final

# Windows has no SIGHUP.
_ENDING: Final = tuple(number for name in ("SIGTERM", "SIGHUP") if (number := getattr(signal, name, None)) is not None)


class StopSignal(KeyboardInterrupt):
    """A signal that asks the program to end; what handles Ctrl-C handles it too.

    Attributes:
        number: of the signal.
    """

    def __init__(self, number: int) -> None:
        super().__init__()
        self.number = number


class StopRequest(threading.Event):
    """Event that is set by a signal, or by `set`.

    Attributes:
        number: of the first signal, None before.
    """

    def __init__(self) -> None:
        super().__init__()
        self.number: int | None = None

    def is_set(self) -> bool:
        """Return whether a signal has arrived, or `set` was called."""
        # A handler runs in the middle of other code, which may hold the lock that `set` takes, so it sets the number.
        return self.number is not None or super().is_set()

    def raise_if_set(self) -> None:
        """Raise StopSignal if a signal has arrived."""
        if self.number is not None:
            raise StopSignal(self.number)


def install() -> None:
    """Make SIGTERM and SIGHUP raise StopSignal in the main thread, unless the parent has them ignored (nohup)."""

    def stop(number: int, _: FrameType | None) -> None:
        raise StopSignal(number)

    for number in _ENDING:
        if signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, stop)


@contextmanager
def stop_request() -> Iterator[StopRequest]:
    """Yield an event that SIGINT, SIGTERM and SIGHUP set, so that none of them interrupts work at an arbitrary place.

    A second SIGINT raises KeyboardInterrupt: the user does not want to wait. Ignored signals stay ignored. Outside the
    main thread, which alone receives signals, the event is not set.
    """
    request = StopRequest()

    def stop(number: int, _: FrameType | None) -> None:
        if request.number is None:
            request.number = number
        elif number == signal.SIGINT:
            raise KeyboardInterrupt

    if threading.current_thread() is not threading.main_thread():
        yield request
        return
    handlers = {number: signal.getsignal(number) for number in (signal.SIGINT, *_ENDING)}
    try:
        for number, handler in handlers.items():
            if handler not in (signal.SIG_IGN, None):
                signal.signal(number, stop)
        yield request
    finally:
        for number, handler in handlers.items():
            if handler is not None:
                signal.signal(number, handler)
