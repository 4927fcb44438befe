"""Events of this computer during a session: its system time is set."""

from __future__ import annotations

from typing import Final

from gateway.clock import Clock
from gateway.io.source import LinkEvent, LinkEventKind
from gateway.reasons import Code, Reason

# Less is the work of a service that keeps the time, or of a slow reading.
_STEP_NS: Final = 500_000_000


class ComputerWatch:
    """Compares the clocks of this computer while a session runs."""

    def __init__(self, clock: Clock) -> None:
        """Start: the session has the system time of the moment when its clock was made."""
        self._clock = clock
        self._ahead_ns = 0

    def events(self) -> list[LinkEvent]:
        """Return what happened since the last call."""
        ahead_ns = self._clock.computer().ahead_ns
        step_ns = ahead_ns - self._ahead_ns
        if abs(step_ns) < _STEP_NS:
            return []
        self._ahead_ns = ahead_ns
        step = Reason(Code.SYSTEM_TIME_SET, step_s=step_ns * 1e-9, ahead_s=ahead_ns * 1e-9)
        return [LinkEvent("", self._clock.now_ns(), LinkEventKind.COMPUTER, details=(step,))]
