"""Log of alarms: when each was raised and over, as notices and as records."""

import logging
import math
from collections import deque
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Final

from gateway.core.estimates.results import Alarm, AlarmChange, AlarmRecord
from gateway.core.reasons import Code, Level, Notice, Reason
from gateway.core.session.alarms import SILENCES, AlarmKey, AlarmName
from gateway.core.session.reasons import SessionCode
from gateway.core.text.wording import notice_text

_logger = logging.getLogger(__name__)

# Alarms raised more often than this within a minute are reported again only after a minute without a change.
_RAISED_PER_MINUTE: Final = 3
_MINUTE_S: Final = 60.0
# Latest times of an alarm that are kept.
_PAST_SPANS: Final = 256
# Changes waiting for `take_changes`; the oldest are dropped.
_WAITING_CHANGES: Final = 1024
# Silence that goes on is reported again at these ages, then every hour.
_REMINDERS_S: Final = (60.0, 600.0, 3600.0)
# Events of the link, notices of the guard and of the session report these already.
_REPORTED_ELSEWHERE: Final = frozenset({AlarmName.LINK, AlarmName.SECURITY, AlarmName.STOPPED})


@dataclass(slots=True)
class _Entry:
    """History of one alarm; times in s from the beginning of the session."""

    alarm: Alarm
    first_s: float
    raised_s: float
    seen_s: float
    count: int = 0
    before_s: float = 0.0
    is_standing: bool = False
    is_muted: bool = False
    is_acknowledged: bool = False
    recent_s: list[float] = field(default_factory=list)
    reminded_s: float = 0.0
    past: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=_PAST_SPANS))

    def spans(self) -> Iterator[tuple[float, float]]:
        """Yield begin and end of the times for which it stood."""
        yield from self.past
        if self.is_standing:
            yield self.raised_s, math.inf

    def record(self) -> AlarmRecord:
        standing_s = self.seen_s - self.raised_s if self.is_standing else 0.0
        total_s = self.before_s + standing_s
        alarm = self.alarm
        return AlarmRecord(
            alarm.position,
            alarm.name,
            alarm.reason,
            self.count,
            total_s,
            self.first_s,
            self.seen_s,
            self.is_standing,
            self.is_acknowledged,
            self.raised_s,
        )


class AlarmLog:
    """Compares the present alarms with those before and reports what changed."""

    def __init__(self, *, logs: bool = True) -> None:
        """Start empty; `logs` is False where no notice goes to the program's log."""
        self._logs = logs
        self._entries: dict[AlarmKey, _Entry] = {}
        self._changes: deque[AlarmChange] = deque(maxlen=_WAITING_CHANGES)

    def take_changes(self) -> list[AlarmChange]:
        """Return the changes since the last call, all of them: notices leave out what is reported elsewhere."""
        changes = list(self._changes)
        self._changes.clear()
        return changes

    def acknowledge(self, at_s: float) -> None:
        """Note that the user has seen the alarms that stand; one with another reason has to be seen again."""
        for entry in self._entries.values():
            if entry.is_standing and not entry.is_acknowledged:
                entry.is_acknowledged = True
                self._changes.append(AlarmChange(entry.alarm, True, at_s, at_s - entry.raised_s, is_acknowledged=True))

    def standing(self) -> Mapping[AlarmKey, Code]:
        """Return the standing alarms with the codes of their reasons."""
        return {key: entry.alarm.reason.code for key, entry in self._entries.items() if entry.is_standing}

    def standing_at(self, position: str, at_s: float) -> tuple[Alarm, ...]:
        """Return the alarms that stood at a wheel at a time, with their reasons as last seen."""
        entries = [entry for (entry_position, _), entry in self._entries.items() if entry_position == position]
        return tuple(entry.alarm for entry in entries if any(begin <= at_s < end for begin, end in entry.spans()))

    def records(self) -> tuple[AlarmRecord, ...]:
        """Return the history of every alarm, in the order of their first raising."""
        return tuple(entry.record() for entry in sorted(self._entries.values(), key=lambda entry: entry.first_s))

    def update(
        self,
        present: Iterable[Alarm],
        at_s: float,
        *,
        hidden: Collection[AlarmKey] = (),
        values: Callable[[], Mapping[AlarmKey, Reason]] = dict,
        covers: Callable[[AlarmKey], bool] = lambda _: True,
    ) -> list[Notice]:
        """Take the present alarms; return a notice for each that was raised or is over.

        Args:
            present: the alarms.
            at_s: time from the beginning of the session or recording.
            hidden: alarms that stay as they are, because a wider one covers them: they are neither present nor over.
            values: returns the present values of what raised alarms.
            covers: whether this call decides on an alarm; others stay as they are.
        """
        notices: list[Notice] = []
        # Of several reasons of one alarm the last counts: they would replace each other at each update.
        present_alarms = {key: alarm for alarm in present if covers(key := (alarm.position, alarm.name))}
        for key, alarm in present_alarms.items():
            notices += self._raise_or_remind(key, alarm, at_s)
        standing = [key for key, entry in self._entries.items() if entry.is_standing]
        ended_keys = [key for key in standing if key not in present_alarms and key not in hidden and covers(key)]
        present_values = values() if ended_keys else {}
        for key in ended_keys:
            notices += self._clear(key, at_s, present_values.get(key))
        for notice in notices if self._logs else ():
            # Every view shows the notice too: standard error needs it in a verbose log only.
            level = logging.WARNING if notice.level is Level.WARNING else logging.INFO
            _logger.log(level, "%s", notice_text(notice), extra={"is_shown": True})
        return notices

    def _raise_or_remind(self, key: AlarmKey, alarm: Alarm, at_s: float) -> list[Notice]:
        entry = self._entries.get(key)
        if entry is None:
            entry = self._entries[key] = _Entry(alarm, at_s, at_s, at_s)
        is_new = not entry.is_standing
        has_new_reason = entry.alarm.reason.code is not alarm.reason.code
        entry.alarm, entry.seen_s = alarm, at_s
        if is_new or has_new_reason:
            entry.is_acknowledged = False
            self._changes.append(AlarmChange(alarm, True, at_s))
        if is_new:
            entry.is_standing, entry.raised_s, entry.reminded_s = True, at_s, 0.0
            entry.count += 1
            entry.recent_s = [*(time_s for time_s in entry.recent_s if at_s - time_s < _MINUTE_S), at_s]
            was_muted, entry.is_muted = entry.is_muted, len(entry.recent_s) > _RAISED_PER_MINUTE
            if entry.is_muted:
                return (
                    []
                    if was_muted
                    else self._notice(alarm, Reason(SessionCode.ALARM_COMES_AND_GOES, at_s=at_s, alarm=alarm.reason))
                )
        elif not has_new_reason or entry.is_muted:
            return self._reminder(entry, at_s)
        return self._notice(alarm, Reason(SessionCode.ALARM_RAISED, at_s=at_s, alarm=alarm.reason))

    def _reminder(self, entry: _Entry, at_s: float) -> list[Notice]:
        if entry.alarm.name not in SILENCES:
            return []
        stood_s = at_s - entry.raised_s
        due_s = next((step_s for step_s in _REMINDERS_S if step_s > entry.reminded_s), entry.reminded_s + 3600.0)
        if stood_s < due_s:
            return []
        entry.reminded_s = due_s
        return self._notice(entry.alarm, Reason(SessionCode.ALARM_STANDS, at_s=at_s, alarm=entry.alarm.reason))

    def _clear(self, key: AlarmKey, at_s: float, value: Reason | None) -> list[Notice]:
        entry = self._entries[key]
        entry.is_standing = False
        duration_s = at_s - entry.raised_s
        entry.before_s += duration_s
        entry.past.append((entry.raised_s, at_s))
        self._changes.append(AlarmChange(entry.alarm, False, at_s, duration_s))
        final_reason = value or entry.alarm.reason
        if entry.alarm.name in SILENCES:
            age_s = entry.alarm.reason["silence_s"]
            assert isinstance(age_s, float)
            final_reason = Reason(SessionCode.SENDS_AGAIN, away_s=age_s + at_s - entry.seen_s)
        entry.seen_s = at_s
        if entry.is_muted:
            return []
        cleared = Reason(SessionCode.ALARM_CLEARED, at_s=at_s, duration_s=duration_s, what=final_reason)
        return self._notice(entry.alarm, cleared, Level.INFO)

    @staticmethod
    def _notice(alarm: Alarm, reason: Reason, level: Level = Level.WARNING) -> list[Notice]:
        return [] if alarm.name in _REPORTED_ELSEWHERE else [Notice(alarm.position, reason, level)]
