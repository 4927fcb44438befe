"""The face of the page for whoever sits at the wheel: each wheel at a glance, and one line of what to do."""

import math
import re
from typing import Any, Final

from gateway.console.wheel_panel import state_text
from gateway.core.estimates.estimator import Estimate, Status
from gateway.core.estimates.results import Alarm, SessionSnapshot, WheelSnapshot, WheelState
from gateway.core.text.readout import SPEED, WEAR
from gateway.core.text.text import clean, counted
from gateway.core.text.wording import text as reason_text

JsonObject = dict[str, Any]
_CAR: Final = re.compile(r"(?:.*[.:_ -])?(front|rear|f|r)[._ -]?(left|right|l|r)\d*", re.IGNORECASE)


def drive_face(snapshot: SessionSnapshot) -> JsonObject:
    """Return the line of what to do, its kind, the alarms besides it, and each wheel with its place on the car."""
    kind, line = _verdict(snapshot)
    standing = _standing(snapshot)
    return {
        "kind": kind,
        "line": clean(line),
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


def _verdict(snapshot: SessionSnapshot) -> tuple[str, str]:
    wheels = snapshot.wheels
    if snapshot.ended:
        return "unknown", "The session has ended."
    if standing := _standing(snapshot):
        return "act", _alarm_text(standing[0])
    silent = [wheel for wheel in wheels if wheel.silence is not None]
    if silent:
        return "act", f"{', '.join(wheel.position for wheel in silent)}: {state_text(silent[0])}."
    if not wheels:
        return "unknown", "No wheel is heard yet."
    rolling = sum(wheel.state is WheelState.ROLLING for wheel in wheels)
    if not rolling:
        return "unknown", "No wheel rolls."
    alarms = f" {counted(len(snapshot.alarms), 'alarm')} acknowledged." if snapshot.alarms else ""
    whole = "All is well." if rolling == len(wheels) else f"{rolling} of {len(wheels)} wheels roll."
    return "good", whole + alarms


def _wheel(wheel: WheelSnapshot, snapshot: SessionSnapshot) -> JsonObject:
    is_alarmed = any(alarm.position == wheel.position for alarm in snapshot.alarms)
    is_heard = wheel.silence is None
    is_current = wheel.has_current_environment and not snapshot.ended
    conditions = wheel.last.conditions if wheel.last is not None else None
    is_rolling = is_heard and wheel.state is WheelState.ROLLING
    kind = "act" if is_alarmed or not is_heard else "good" if is_rolling else "unknown"
    return {
        "position": clean(wheel.position),
        "key": wheel.position,
        "place": place_on_car(wheel.position),
        "kind": kind,
        "state": "alarm" if is_alarmed and is_heard else state_text(wheel),
        SPEED: _value(wheel.estimate(SPEED)) if is_rolling else None,
        "values": {
            "pressure_pa": _number(
                wheel.pressure_pa if is_current else None,
                conditions.pressure_std_pa if conditions is not None else 0.0,
                _source(wheel, "pressure_pa"),
            ),
            "temperature_degc": _number(wheel.temperature_degc if is_current else None, 0.0, "measured"),
            WEAR: _value(wheel.wear_mm) if is_heard else None,
            "load_n": _number(
                wheel.load_n if is_heard else None,
                _load_std_n(wheel),
                _source(wheel, "load_n"),
            ),
        },
    }


def _load_std_n(wheel: WheelSnapshot) -> float:
    if "load_n" in wheel.stated:
        return wheel.last.conditions.load_std_n if wheel.last is not None else 0.0
    estimate = wheel.estimate("load_n")
    return estimate.std if estimate is not None else 0.0


def _source(wheel: WheelSnapshot, name: str) -> str:
    return "stated" if name in wheel.stated else "measured"


def _value(estimate: Estimate | None) -> JsonObject | None:
    """Return an estimate as a value of the page."""
    if estimate is None:
        return None
    return _number(estimate.value, estimate.std, "measured" if estimate.status is Status.VALID else "provisional")


def _number(value: float | None, std: float, source: str) -> JsonObject | None:
    if value is None or not math.isfinite(value):
        return None
    return {"value": value, "std": std if math.isfinite(std) else 0.0, "source": source}
