"""Lines that a link's hubs may put on the screen: at most ten a second, the rest counted and reported."""

from typing import Final

from gateway.reasons import Code, Level, Notice, Reason

LINES_PER_S: Final = 10
_SECOND_NS: Final = 1_000_000_000


class HubLog:
    """Limit on the lines of one link, by the arrival times, so that a replay shows the same lines."""

    def __init__(self, link: str) -> None:
        """Start without a line."""
        self._link = link
        self._begin_ns = 0
        self._lines = 0
        self._left_out = 0

    def take(self, notice: Notice, host_ns: int) -> list[Notice]:
        """Return what may be shown now of a notice that a hub has caused."""
        shown = self.tick(host_ns)
        if self._lines < LINES_PER_S:
            self._lines += 1
            shown.append(notice)
        else:
            self._left_out += 1
        return shown

    def tick(self, host_ns: int) -> list[Notice]:
        """Begin a new second when the last one is over; return the report of the lines left out in it."""
        if 0 <= host_ns - self._begin_ns < _SECOND_NS:
            return []
        self._begin_ns = host_ns
        report = self.finish()
        self._lines = len(report)
        return report

    def finish(self) -> list[Notice]:
        """Return the report of the lines left out since the last one."""
        count, self._left_out = self._left_out, 0
        return [Notice(self._link, Reason(Code.HUB_LOG_LEFT_OUT, count=count), Level.WARNING)] if count else []
