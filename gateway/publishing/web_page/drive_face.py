"""The face of the page for whoever sits at the wheel: each wheel at a glance, and one line of what to do."""

import math
import re
from typing import Any, Final

from gateway.console.wheel_panel import state_text
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import Alarm, SessionSnapshot, WheelSnapshot, WheelState
from gateway.core.session.alarms import AlarmName
from gateway.core.text.numbers import MISSING, Unit, age, duration, split_name, unit_symbol
from gateway.core.text.readout import SPEED, WEAR, plain_wear
from gateway.core.text.text import clean, counted
from gateway.core.text.wording import text as reason_text

JsonObject = dict[str, Any]
# By which a driver's numbers differ; 1 in other units.
_STEPS: Final = {"bar": 0.1, "mm": 0.1, "kPa": 10.0, "N": 100.0, "lbf": 10.0}
# What whoever drives does about an alarm, by a part of its name; of others it is enough that the engineer knows.
_NOT_WATCHED: Final = "not watched now: drive on with care"
_DRIVER_STEPS: Final[dict[str, str]] = {
    "not monitored": _NOT_WATCHED,
    AlarmName.PRESSURE: "stop as soon as you can, and check the tire",
    AlarmName.TEMPERATURE: "slow down, and let the tire cool",
    AlarmName.LOAD: "slow down, and check the load",
    AlarmName.SPEED: "slow down",
    AlarmName.WEAR: "have the tire checked before the next drive",
    **dict.fromkeys((AlarmName.SILENT, AlarmName.STOPPED, AlarmName.LINK, AlarmName.ENVIRONMENT), _NOT_WATCHED),
}
_OTHERWISE: Final = "drive on, and tell the engineer"
_CAR: Final = re.compile(r"(?:.*[.:_ -])?(front|rear|f|r)[._ -]?(left|right|l|r)\d*", re.IGNORECASE)


def drive_face(snapshot: SessionSnapshot) -> JsonObject:
    """Return what to do, why, its kind, the alarms besides it, and each wheel with its place on the car."""
    kind, step, line = _verdict(snapshot)
    standing = _standing(snapshot)
    return {
        "kind": kind,
        "step": clean(step),
        "line": clean(line),
        "speed": _speed(snapshot),
        "alarms": [clean(_alarm_text(alarm)) for alarm in standing[1:]],
        "wheels": [_wheel(wheel, snapshot) for wheel in snapshot.wheels],
    }


def place_on_car(position: str) -> tuple[int, int] | None:
    """Return row and column of a wheel on a car seen from above, None for another name.

    >>> place_on_car("FR"), place_on_car("rear.left"), place_on_car("drum")
    ((0, 1), (1, 0), None)
    """
    match = _CAR.fullmatch(position)
    if match is None:
        return None
    return int(match[1][0].lower() == "r"), int(match[2][0].lower() == "r")


def _standing(snapshot: SessionSnapshot) -> list[Alarm]:
    """Return the alarms that nobody has acknowledged."""
    return [alarm for alarm in snapshot.alarms if not snapshot.is_acknowledged(alarm)]


def _alarm_text(alarm: Alarm) -> str:
    return f"{alarm.position}: {reason_text(alarm.reason)}"


def _since(snapshot: SessionSnapshot, alarm: Alarm) -> str:
    """Return since when an alarm stands, or how often it was raised; empty where that is not known."""
    entries = [item for item in snapshot.alarm_records if (item.position, item.name) == (alarm.position, alarm.name)]
    if not entries:
        return ""
    times = f" {entries[0].count} times" if entries[0].count > 1 else ""
    return f"{times} since {duration(entries[0].first_s)}"


def _verdict(snapshot: SessionSnapshot) -> tuple[str, str, str]:
    """Return kind, what to do (empty for nothing) and why."""
    wheels = snapshot.wheels
    if snapshot.ended:
        return "unknown", "", "The session has ended."
    if standing := _standing(snapshot):
        first = standing[0]
        step = next((step for part, step in _DRIVER_STEPS.items() if part in first.name), _OTHERWISE)
        since = _since(snapshot, first)
        return "act", f"{first.position}: {step}", f"{_alarm_text(first)}{f' (alarm{since})' if since else ''}"
    silent = [wheel for wheel in wheels if wheel.silence is not None]
    if silent:
        names = ", ".join(wheel.position for wheel in silent)
        return "act", f"{names}: {_NOT_WATCHED}", f"{names}: {state_text(silent[0])}."
    if not wheels:
        return "unknown", "", "No wheel is heard yet."
    rolling = sum(wheel.state is WheelState.ROLLING for wheel in wheels)
    if not rolling:
        return "unknown", "", "No wheel rolls."
    alarms = f" {counted(len(snapshot.alarms), 'alarm')} acknowledged." if snapshot.alarms else ""
    summary = "All is well." if rolling == len(wheels) else f"{rolling} of {len(wheels)} wheels roll."
    return "good", "", summary + alarms


def _wheel(wheel: WheelSnapshot, snapshot: SessionSnapshot) -> JsonObject:
    is_alarmed = any(alarm.position == wheel.position for alarm in snapshot.alarms)
    is_heard = wheel.silence is None
    conditions = wheel.last.conditions if wheel.last is not None else None
    is_rolling = _is_rolling(wheel)
    kind = "act" if is_alarmed or not is_heard else "good" if is_rolling else "unknown"
    return {
        "position": clean(wheel.position),
        "key": wheel.position,
        "place": place_on_car(wheel.position),
        "kind": kind,
        "state": "alarm" if is_alarmed and is_heard else state_text(wheel),
        "values": _values(wheel, conditions.pressure_std_pa if conditions is not None else 0.0, ended=snapshot.ended),
    }


def _values(wheel: WheelSnapshot, pressure_std_pa: float, *, ended: bool) -> JsonObject:
    """Return the values of a wheel; what is not of now is old and has its age, and what is stated stays so."""
    silence, old = wheel.silence, wheel.old_environment
    age_s = silence.age_s if silence is not None else None
    if wheel.has_current_environment:
        environment_s, note = None, "still received" if silence is not None else ""
    else:
        environment_s, note = old.age_s if old is not None else age_s, ""
    pressure = _number("pressure_pa", wheel.pressure_pa, pressure_std_pa, _source(wheel, "pressure_pa"))
    temperature = _number("temperature_degc", wheel.temperature_degc, 0.0, "measured")
    load = _number("load_n", wheel.load_n, _load_std_n(wheel), _source(wheel, "load_n"))
    return {
        "pressure_pa": _aged(pressure, environment_s, note, ended=ended),
        "temperature_degc": _aged(temperature, environment_s, note, ended=ended),
        WEAR: _aged(_wear(wheel.wear_mm), age_s, ended=ended),
        "load_n": _aged(load, age_s, ended=ended),
    }


def _wear(estimate: Estimate | None) -> JsonObject | None:
    """Return wear; one below zero by more than its error explains is no wear of this tire."""
    plain = plain_wear(estimate) if estimate is not None else None
    value = _value(plain)
    if value is not None and plain is not None and plain.value < 0.0:
        return {**value, "text": MISSING, "unit": "", "source": "provisional", "note": "check what is taken as new"}
    return value


def _aged(value: JsonObject | None, age_s: float | None, note: str = "", *, ended: bool) -> JsonObject | None:
    """Return a value with what stands beside its name: its source, or its age, s, where it is not of now."""
    if value is None or value["source"] == "stated":
        return value
    if age_s is not None:
        return {**value, "source": "old", "note": f"{age(age_s)} old"}
    if ended:
        return {**value, "source": "old", "note": "at the end"}
    return {**value, "source": "received", "note": note} if note else value


def _load_std_n(wheel: WheelSnapshot) -> float:
    if "load_n" in wheel.stated:
        return wheel.last.conditions.load_std_n if wheel.last is not None else 0.0
    estimate = wheel.estimate("load_n")
    return estimate.std if estimate is not None else 0.0


def _source(wheel: WheelSnapshot, name: str) -> str:
    return "stated" if name in wheel.stated else "measured"


def _is_rolling(wheel: WheelSnapshot) -> bool:
    return wheel.silence is None and wheel.state is WheelState.ROLLING


def _speed(snapshot: SessionSnapshot) -> JsonObject:
    """Return one speed for all: the middle one of the wheels that roll."""
    estimates = [estimate for wheel in snapshot.wheels if _is_rolling(wheel) and (estimate := wheel.estimate(SPEED))]
    estimates.sort(key=lambda estimate: estimate.value)
    middle = estimates[len(estimates) // 2] if estimates else None
    return _value(middle) or {"text": MISSING, "unit": unit_symbol(SPEED), "source": "unknown"}


def _value(estimate: Estimate | None) -> JsonObject | None:
    """Return an estimate as a value of the page."""
    if estimate is None:
        return None
    source = "measured" if estimate.status is Status.VALID else "provisional"
    return _number(estimate.name, estimate.value, estimate.std, source)


def _number(name: str, value: float | None, std: float, source: str) -> JsonObject | None:
    """Return a value rounded to what an eye takes in, never finer than its error; None where it is not known."""
    if value is None or not math.isfinite(value):
        return None
    unit = split_name(name)[1]
    return {
        "text": rounded(unit.of(value), std * unit.factor, unit),
        "unit": unit.symbol,
        "source": source,
        "note": "" if source == "measured" else source,
    }


def rounded(value: float, std: float, unit: Unit) -> str:
    """Return a value in steps of its unit, doubled about so often that they are no finer than its error."""
    step = _STEPS.get(unit.symbol, 1.0)
    doublings = 0
    while step < std < math.inf:
        step *= 2.5 if doublings % 3 == 1 else 2.0
        doublings += 1
    # Adding 0 turns -0 into 0.
    return f"{round(value / step) * step + 0.0:.{1 if step < 0.95 else 0}f}"
