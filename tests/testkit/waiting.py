"""Waiting for what other threads do, and a clock that waits for the test."""

import threading
from collections.abc import Callable

from gateway.core.clock import ManualClock, SystemClock

TIMEOUT_S = 60.0
_tick = threading.Event()


def until(condition: Callable[[], object], timeout_s: float = TIMEOUT_S) -> None:
    """Wait until a condition holds; on a computer of any load, for the same number of seconds."""
    clock = SystemClock()
    end_ns = clock.now_ns() + round(timeout_s * 1e9)
    while not condition():
        assert clock.now_ns() < end_ns, f"the condition does not come true in {timeout_s:g} s"
        _tick.wait(0.005)


class HeldClock(ManualClock):
    """A manual clock that sleeps do not move, so that only the test advances it."""

    def sleep_until_ns(self, deadline_ns: int, stop: threading.Event | None = None) -> bool:
        (stop or _tick).wait(0.005)
        return stop is not None and stop.is_set()
