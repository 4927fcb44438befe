"""What a page of a drive says first: what was driven, what happened, and what to do."""

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from gateway.compare.views.drive import Drive, DriveWheel
from gateway.core.estimates.estimator import Status
from gateway.core.estimates.results import AlarmRecord
from gateway.core.reasons import Code
from gateway.core.session.alarms import AlarmName
from gateway.core.session.reasons import SessionCode
from gateway.core.text.numbers import age, duration, fixed, round_to_error
from gateway.core.text.text import clean, counted
from gateway.core.text.wording import text

_SILENT_S: Final = 2.0
_SILENCE_STEP: Final = "Check the sensor's battery, its distance from the hub, and the hub's antenna"
_SILENCE_STEPS: Final[Mapping[Code, str]] = {
    SessionCode.SAMPLES_SILENT: "Its sensor sent other messages meanwhile: look for a command that stopped it, else "
    "have its firmware checked",
}
# From a kilometre on a distance is written in km.
_KM_FROM_M: Final = 1000.0


class Event(NamedTuple):
    """Something that happened in a drive.

    Attributes:
        begin_s: time since the beginning of the drive.
        end_s: likewise; equal for a moment, infinite where it lasted to the end.
        kind: `alarm`, `mark`, `silence` or `standstill`.
        wheel: of which wheel or link, empty for all.
        text: what happened, without its time.
    """

    begin_s: float
    end_s: float
    kind: str
    wheel: str
    text: str

    def times(self) -> str:
        """Return `0:00:40` or `0:00:40 to 0:01:15`."""
        begin = duration(self.begin_s)
        if self.end_s == self.begin_s:
            return begin
        return f"{begin} to {'the end' if self.end_s == float('inf') else duration(self.end_s)}"


class Action(NamedTuple):
    """What to do, and what it is about."""

    about: str
    step: str


class Verdict(NamedTuple):
    """First lines of the page.

    Attributes:
        summary: sentences.
        actions: empty when there is nothing to do.
        events: in the order of their begin.
    """

    summary: str
    actions: list[Action]
    events: list[Event]


def verdict(drive: Drive, start_ns: int, end_ns: int) -> Verdict:
    """Return what to say first of a drive from the first to the last end of a revolution, ns."""
    silences = _silence_alarms(drive, start_ns)
    events = sorted(_events(drive, start_ns, silences))
    standing = [alarm for alarm in drive.alarms if alarm.is_standing]
    actions = [Action(f"{clean(alarm.position)} {alarm.name}", clean(text(alarm.reason))) for alarm in standing]
    actions += [Action(clean(notice.subject) or "note", clean(text(notice.reason))) for notice in drive.notices]
    for wheel in dict.fromkeys(event.wheel for event in events if event.kind == "silence"):
        alarm = silences.get(wheel)
        step = _SILENCE_STEPS.get(alarm.reason.code, _SILENCE_STEP) if alarm is not None else _SILENCE_STEP
        actions.append(Action(wheel, f"find why it was silent, before it happens again. {step}"))
    took = age((end_ns - start_ns) * 1e-9)
    sentences = [f"{counted(len(drive.wheels), 'wheel')}{_distance(list(drive.wheels.values()))} in {took}."]
    sentences += _silences(events)
    ended_count = len(drive.alarms) - len(standing) - len(silences)
    if ended_count:
        sentences.append(f"{counted(ended_count, 'alarm')} came and went.")
    if standing:
        sentences.append(f"{counted(len(standing), 'alarm')} stood at the end.")
    if len(actions) == len({event.wheel for event in events if event.kind == "silence"}):
        sentences.append("Nothing else to act on." if len(sentences) > 1 else "Nothing to act on.")
    return Verdict(" ".join(sentences), actions, events)


def _distance(wheels: list[DriveWheel]) -> str:
    """Return the distance of the wheel that rolled farthest, with its error, empty where none is known.

    A distance that is taken from the mean speed in part counts only where there is no other.
    """
    distances = [wheel.rolled for wheel in wheels if wheel.rolled is not None]
    distances = [estimate for estimate in distances if estimate.status is Status.VALID] or distances
    if not distances:
        return ""
    farthest = max(distances, key=lambda estimate: estimate.value)
    in_km = farthest.value >= _KM_FROM_M
    scale, unit = (1e-3, "km") if in_km else (1.0, "m")
    number = round_to_error(farthest.value * scale, farthest.std * scale).joined()
    return (
        f", {number} {unit}" if farthest.std > 0.0 else f", {fixed(farthest.value * scale, 2 if in_km else 0)} {unit}"
    )


def _silences(events: list[Event]) -> Iterator[str]:
    by_wheel: dict[str, list[Event]] = {}
    for event in events:
        if event.kind == "silence":
            by_wheel.setdefault(event.wheel, []).append(event)
    for wheel, silences in by_wheel.items():
        total = age(sum(event.end_s - event.begin_s for event in silences))
        times = "" if len(silences) == 1 else f" in {len(silences)} times"
        yield f"{wheel} was silent for {total}{times}."


def _silence_alarms(drive: Drive, start_ns: int) -> dict[str, AlarmRecord]:
    """Return the alarms of silences that have ended and that the wheel's revolutions show too, by wheel."""
    offset_s = _offset_s(drive, start_ns)
    alarms = {}
    for alarm in drive.alarms:
        wheel = drive.wheels.get(alarm.position)
        if alarm.name != AlarmName.SILENT or alarm.is_standing or wheel is None:
            continue
        first_ns, last_ns = (start_ns + round((time_s + offset_s) * 1e9) for time_s in (alarm.first_s, alarm.last_s))
        if any(gap.silent_s >= _SILENT_S and gap.begin_ns <= last_ns and first_ns <= gap.end_ns for gap in wheel.gaps):
            alarms[clean(alarm.position)] = alarm
    return alarms


def _offset_s(drive: Drive, start_ns: int) -> float:
    """Return the time of the session's start since that from which times count."""
    return 0.0 if drive.start_ns is None else (drive.start_ns - start_ns) * 1e-9


def _events(drive: Drive, start_ns: int, silences: Mapping[str, AlarmRecord]) -> Iterator[Event]:
    for position, wheel in drive.wheels.items():
        for gap in wheel.gaps:
            begin_s, end_s = (gap.begin_ns - start_ns) * 1e-9, (gap.end_ns - start_ns) * 1e-9
            if end_s <= begin_s:
                continue
            is_silence = gap.silent_s >= _SILENT_S
            kind, state = ("silence", "silent") if is_silence else ("standstill", "no revolution")
            words = f"{state} for {age(end_s - begin_s)}"
            alarm = silences.get(clean(position)) if is_silence else None
            if alarm is not None and alarm.count == 1:
                words = f"{alarm.name}: {clean(text(alarm.reason))}"
            yield Event(begin_s, end_s, kind, clean(position), words)
    for time_ns, words in drive.marks:
        moment_s = (time_ns - start_ns) * 1e-9
        yield Event(moment_s, moment_s, "mark", "", f"mark: {clean(words)}" if words else "mark")
    for alarm in drive.alarms:
        if silences.get(clean(alarm.position)) is not alarm:
            yield _alarm_event(alarm, _offset_s(drive, start_ns))


def _alarm_event(alarm: AlarmRecord, offset_s: float) -> Event:
    end_s = float("inf") if alarm.is_standing else alarm.last_s + offset_s
    times = "" if alarm.count == 1 else f"{alarm.count} times, {age(alarm.total_s)} in all: "
    words = f"{alarm.name}: {times}{text(alarm.reason)}"
    return Event(alarm.first_s + offset_s, end_s, "alarm", clean(alarm.position), clean(words))
