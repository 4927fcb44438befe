"""Events of this computer during a session: its system time is set, or it pauses."""

from typing import Final

from gateway.core.clock import Clock
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import LinkEvent, LinkEventKind
from gateway.core.reasons import Reason
from gateway.core.session.silence import LIMITS

# Less is the work of a service that keeps the time, or of a slow reading.
_STEP_NS: Final = 500_000_000
# A service that keeps the time slews it by 0.05 % as a rule (adjtime), chrony by 8.3 % at most.
_FASTEST_SLEW: Final = 1.0 / 12.0
# Time between the readings of two clocks.
_READING_NS: Final = 2_000_000
# Samples that stop for as long are silent.
_PAUSE_NS: Final = round(LIMITS["samples"].least_s * 1e9)


class ComputerWatch:
    """Compares the clocks of this computer while a session runs."""

    def __init__(self, clock: Clock) -> None:
        """Start: the session has the system time of the moment when its clock was made."""
        self._clock = clock
        self._ahead_ns = self._jumped_ns = 0
        self._last = clock.computer()
        self._reported_ns = self._last.now_ns

    def events(self) -> list[LinkEvent]:
        """Return what happened since the last call, by the thread that calls several times a second.

        A thread that has neither worked nor called for long was not let: the computer was busy with other programs, or
        its virtual machine was stopped. While it was suspended, the time of the session stood still.
        """
        last, self._last = self._last, self._clock.computer()
        stalled_ns = self._last.now_ns - last.now_ns - (self._last.worked_ns - last.worked_ns)
        suspended_ns = self._last.suspended_ns - last.suspended_ns
        details = []
        if stalled_ns >= _PAUSE_NS:
            details.append(Reason(LinkCode.COMPUTER_PAUSED, paused_s=stalled_ns * 1e-9))
        if suspended_ns >= _PAUSE_NS:
            details.append(Reason(LinkCode.COMPUTER_SUSPENDED, suspended_s=suspended_ns * 1e-9))
        change_ns = self._last.ahead_ns - last.ahead_ns
        if abs(change_ns) > _FASTEST_SLEW * (self._last.now_ns - last.now_ns) + _READING_NS:
            self._jumped_ns += change_ns
        step_ns = self._last.ahead_ns - self._ahead_ns
        if abs(step_ns) >= _STEP_NS:
            span_ns = self._last.now_ns - self._reported_ns
            is_slewed = abs(self._jumped_ns) < 0.5 * abs(step_ns)
            self._ahead_ns, self._jumped_ns, self._reported_ns = self._last.ahead_ns, 0, self._last.now_ns
            step = {"step_s": step_ns * 1e-9, "ahead_s": self._ahead_ns * 1e-9}
            details.append(
                Reason(LinkCode.SYSTEM_TIME_SLEWED, span_s=span_ns * 1e-9, **step)
                if is_slewed
                else Reason(LinkCode.SYSTEM_TIME_SET, **step)
            )
        now_ns = self._clock.now_ns()
        return [LinkEvent("", now_ns, LinkEventKind.COMPUTER, details=(detail,)) for detail in details]
