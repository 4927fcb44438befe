"""Lines that a link's hubs may put on the screen: at most ten a second, the rest counted and reported."""

from typing import Final

from firmware_protocol.messages import COMMANDS, CommandResult, LogText, Message, MessageType, Outcome
from gateway.core.reasons import Level, Notice, Reason
from gateway.core.session.reasons import SessionCode
from gateway.core.text.recording_topics import log_level

LINES_PER_S: Final = 10
_SECOND_NS: Final = 1_000_000_000


class HubLog:
    """Limit on the lines of one link, by the arrival times, so that a replay shows the same lines."""

    def __init__(self, link: str) -> None:
        """Start without a line."""
        self._link = link
        self._begin_ns = 0
        self._lines = 0
        self._omitted_lines = 0

    def take(self, hub: str, message: Message, host_ns: int) -> list[Notice]:
        """Return what may be shown now of a message of a hub: a line of its log, or why it has refused a command."""
        if isinstance(message, LogText):
            reason = Reason(SessionCode.HUB_LOG, severity=log_level(message), text=message.text)
            notice = Notice(hub, reason)
        elif isinstance(message, CommandResult) and (refused := refusal(message)) is not None:
            notice = Notice(hub, refused, Level.WARNING)
        else:
            return []
        notices = self.tick(host_ns)
        if self._lines < LINES_PER_S:
            self._lines += 1
            notices.append(notice)
        else:
            self._omitted_lines += 1
        return notices

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
        count, self._omitted_lines = self._omitted_lines, 0
        return [Notice(self._link, Reason(SessionCode.HUB_LOG_LEFT_OUT, count=count), Level.WARNING)] if count else []


def refusal(result: CommandResult) -> Reason | None:
    """Return why a hub did not execute a command, None when it did."""
    if result.outcome == Outcome.DONE:
        return None
    is_defined = result.outcome in set(Outcome)
    outcome = Outcome(result.outcome).name.lower() if is_defined else f"outcome {result.outcome}"
    name = MessageType(result.command).name if result.command in COMMANDS else f"command {result.command}"
    return Reason(SessionCode.COMMAND_REFUSED, command=name, outcome=outcome)
