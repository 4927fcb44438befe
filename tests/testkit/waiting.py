"""Waiting for what other threads do, and a clock that waits for the test."""

import threading
from collections.abc import Callable

from gateway.core.clock import ManualClock

TIMEOUT_S = 20.0
_tick = threading.Event()


def until(condition: Callable[[], object], timeout_s: float = TIMEOUT_S) -> None:
    """Wait until a condition holds."""
    for _ in range(int(timeout_s / 0.005)):
        if condition():
            return
        _tick.wait(0.005)
    raise AssertionError("the condition does not come true")


class HeldClock(ManualClock):
    """A manual clock that sleeps do not move, so that only the test advances it."""

    def sleep_until_ns(self, deadline_ns: int, stop: threading.Event | None = None) -> bool:
        (stop or _tick).wait(0.005)
        return stop is not None and stop.is_set()
