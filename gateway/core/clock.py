"""Clocks, and waiting on them. No other module reads time; tests inject a manual clock."""

import threading
import time
from typing import Final, NamedTuple, Protocol

_WAIT_SLICE_NS: Final = 100_000_000
# Several clocks are read at one time when the reading takes no longer; tried this often.
_ONE_TIME_NS: Final = 1_000_000
_READINGS: Final = 5


class ComputerTime(NamedTuple):
    """Clocks of this computer at one time.

    Attributes:
        ahead_ns: system time less the time of this clock; it changes when the system time is set.
        now_ns: time of this clock.
        worked_ns: time for which the calling thread has used a processor.
        suspended_ns: time for which the computer was suspended, which this clock leaves out; 0 where it is not known.
    """

    ahead_ns: int
    now_ns: int
    worked_ns: int
    suspended_ns: int


class Clock(Protocol):
    """Time in ns since the Unix epoch, which never runs backwards."""

    def now_ns(self) -> int:
        """Return the present time in ns since the epoch."""
        ...

    def sleep_until_ns(self, deadline_ns: int, stop: threading.Event | None = None) -> bool:
        """Wait until `deadline_ns`, or until `stop` is set; return True when stopped early."""
        ...

    def computer(self) -> ComputerTime:
        """Return the clocks of this computer."""
        ...


def _suspended_ns() -> int:
    """Return for how long the computer was suspended since it was started, 0 where the system does not say."""
    boot_time = getattr(time, "CLOCK_BOOTTIME", None)
    return time.clock_gettime_ns(boot_time) - time.monotonic_ns() if boot_time is not None else 0


class SystemClock:
    """Epoch time that advances with the monotonic clock: a step of the system time cannot reorder a recording."""

    def __init__(self) -> None:
        self._epoch_minus_monotonic_ns = time.time_ns() - time.monotonic_ns()

    def now_ns(self) -> int:
        """Return ns since the epoch: the system time at start plus the monotonic time since."""
        return time.monotonic_ns() + self._epoch_minus_monotonic_ns

    def computer(self) -> ComputerTime:
        """Return the clocks of this computer."""
        for _ in range(_READINGS):
            begin_ns = self.now_ns()
            system_ns = time.time_ns()
            # A pause between the readings is no difference of the clocks.
            if self.now_ns() - begin_ns < _ONE_TIME_NS:
                break
        return ComputerTime(system_ns - begin_ns, begin_ns, time.thread_time_ns(), _suspended_ns())

    def sleep_until_ns(self, deadline_ns: int, stop: threading.Event | None = None) -> bool:
        """Wait until `deadline_ns`; return True when `stop` was set before it."""
        event = stop if stop is not None else threading.Event()
        while True:
            remaining_ns = deadline_ns - self.now_ns()
            if remaining_ns <= 0:
                return event.is_set()
            if event.wait(remaining_ns * 1e-9):
                return True


class ManualClock:
    """A clock that moves only by `advance_ns`, or when something sleeps on it. For tests and for full speed."""

    def __init__(self, start_ns: int = 1_700_000_000_000_000_000) -> None:
        self._now_ns = start_ns
        self._ahead_ns = self._paused_ns = 0

    def now_ns(self) -> int:
        """Return the time set so far."""
        return self._now_ns

    def advance_ns(self, step_ns: int) -> None:
        """Move the clock forward by `step_ns`."""
        self._now_ns += step_ns

    def computer(self) -> ComputerTime:
        """Return the clocks as set so far."""
        return ComputerTime(self._ahead_ns, self._paused_ns, 0, 0)

    def pause_computer(self, pause_ns: int) -> None:
        """Move the clock forward by a pause of the whole computer; sleeps on this clock are none."""
        self._now_ns += pause_ns
        self._paused_ns += pause_ns

    def set_system_time(self, step_ns: int) -> None:
        """Set the system time forward by `step_ns`, which this clock does not follow."""
        self._ahead_ns += step_ns

    def sleep_until_ns(self, deadline_ns: int, stop: threading.Event | None = None) -> bool:
        """Jump to `deadline_ns` at once; return True when `stop` is set."""
        self._now_ns = max(self._now_ns, deadline_ns)
        return stop is not None and stop.is_set()


def wait_until(clock: Clock, deadline_ns: int, stop: threading.Event, closed: threading.Event) -> bool:
    """Sleep until `deadline_ns`; return False when `stop` or, within 0.1 s, `closed` is set before it."""
    while not stop.is_set() and not closed.is_set():
        now_ns = clock.now_ns()
        if now_ns >= deadline_ns:
            return True
        if clock.sleep_until_ns(min(deadline_ns, now_ns + _WAIT_SLICE_NS), stop):
            return False
    return False
