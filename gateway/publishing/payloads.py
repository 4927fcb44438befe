"""Items of live outputs as JSON objects. Numbers that are not known are left out; JSON has no NaN."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any, Final

from gateway.core.estimates.estimator import SOURCE_COLUMNS, source_in
from gateway.core.estimates.results import Alarm, LinkSnapshot, SessionSnapshot, WheelSnapshot, WheelState
from gateway.core.links.reasons import LinkCode
from gateway.core.quantity_catalogue import in_state
from gateway.core.reasons import Reason
from gateway.core.text.recording_topics import finite, revolution_payload
from gateway.core.text.text import json_text
from gateway.core.text.wording import as_json, text
from gateway.publishing.sink import Item, PublishedAlarm, PublishedRevolution, PublishedState

JsonObject = dict[str, Any]
# Fields of states that say how it is now, beside estimates; the others identify and count.
_PRESENT: Final = frozenset({
    "rate_hz", "pressure_pa", "temperature_degc", "silent_s", "environment_silent_s", "latency_s", "battery_percent",
    "rssi_dbm", "supply_w",
})  # fmt: skip
# Ends of the names of speeds, and what is one over speeds.
_OF_MOTION: Final = ("_mps", "_radps", "_rpm", "curve_radius_m")
_AT_END: Final[Mapping[str, JsonObject]] = {
    "wheel": {"state": str(WheelState.ENDED), "alarms": []},
    "link": {"connected": False, "alarms": []},
    "session": {"ended": True, "alarms": []},
}


def messages(item: Item) -> Iterator[JsonObject]:
    """Yield the objects of an item, each with `type` and `time_s`: one per revolution or alarm, several per state."""
    if isinstance(item, PublishedRevolution):
        yield revolution(item)
    elif isinstance(item, PublishedAlarm):
        yield alarm(item)
    else:
        yield from (wheel(item, part) for part in item.snapshot.wheels)
        yield from (link(item, part) for part in item.snapshot.links)
        yield session(item)


def encoded(payload: Mapping[str, Any]) -> bytes:
    """Return an object as compact JSON, UTF-8, without a line end."""
    return json_text(payload, compact=True).encode()


def revolution(item: PublishedRevolution) -> JsonObject:
    """Return a revolution: the topic `/wheel/POSITION/revolution` of a recording, and what of it is stated."""
    result = item.result
    return {
        "type": "revolution",
        "time_s": _seconds(item.host_ns),
        "wheel": result.position,
        **revolution_payload(result),
        **result.conditions.sources,
    }


def alarm(item: PublishedAlarm) -> JsonObject:
    """Return an alarm that was raised, acknowledged or is over."""
    change = item.change
    return {
        "type": "alarm",
        "time_s": _seconds(item.host_ns),
        **_alarm(change.alarm),
        "raised": change.is_raised,
        **({"acknowledged": True} if change.is_acknowledged else {}),
        **({} if change.is_raised else {"stood_s": round(change.stood_s, 3)}),
    }


def wheel(item: PublishedState, snapshot: WheelSnapshot) -> JsonObject:
    """Return the state of a wheel: what is silent has an age in place of its numbers."""
    silence, old = snapshot.silence, snapshot.old_environment
    counters = snapshot.counters
    has_environment = snapshot.has_current_environment
    numbers = {
        "rate_hz": (snapshot.rate_hz or None) if silence is None else None,
        **{name: _last_value(snapshot, name) for name in in_state()},
        "pressure_pa": snapshot.pressure_pa if has_environment else None,
        "temperature_degc": snapshot.temperature_degc if has_environment else None,
        "load_n": snapshot.load_n if silence is None else None,
        "silent_s": silence.age_s if silence is not None else None,
        "environment_silent_s": old.age_s if old is not None else None,
    }
    return {
        "type": "wheel",
        "time_s": _seconds(item.host_ns),
        "wheel": snapshot.position,
        "state": str(snapshot.state),
        **({"sensor_id": snapshot.sensor_id} if snapshot.sensor_id else {}),
        **finite(numbers),
        **{
            column: source_in(snapshot.stated, name)
            for name, column in SOURCE_COLUMNS.items()
            if numbers[name] is not None
        },
        "revolutions": counters.revolutions,
        "revolutions_rejected": counters.revolutions_rejected,
        "samples": counters.samples,
        "samples_lost": counters.samples_lost,
        "samples_saturated": counters.samples_saturated,
        "alarms": [alarm.name for alarm in item.snapshot.alarms if alarm.position == snapshot.position],
    }


def link(item: PublishedState, snapshot: LinkSnapshot) -> JsonObject:
    """Return the health of a link: one that is silent or down has none of the numbers that its hub sends."""
    readings = {
        "latency_s": snapshot.latency_s,
        "battery_percent": snapshot.battery_percent,
        "rssi_dbm": snapshot.rssi_dbm,
        "supply_w": snapshot.supply_w,
    }
    numbers = {**(readings if snapshot.connected and snapshot.silent_s is None else {}), "silent_s": snapshot.silent_s}
    return {
        "type": "link",
        "time_s": _seconds(item.host_ns),
        "link": snapshot.link,
        "connected": snapshot.connected,
        "note": text(snapshot.note),
        "bytes_received": snapshot.bytes_received,
        "frames": snapshot.frames,
        "frames_lost": snapshot.frames_lost,
        "crc_errors": snapshot.crc_errors,
        "noise_bytes": snapshot.noise_bytes,
        "duplicates": snapshot.duplicates,
        "reordered": snapshot.reordered,
        "dropped": sum(snapshot.queue_dropped.values()),
        **finite(numbers),
        "alarms": [alarm.name for alarm in item.snapshot.alarms if alarm.position == snapshot.link],
    }


def session(item: PublishedState) -> JsonObject:
    """Return the state of the session, with all present alarms."""
    snapshot = item.snapshot
    return {
        "type": "session",
        "time_s": _seconds(item.host_ns),
        "elapsed_s": round(snapshot.elapsed_s, 3),
        "ended": snapshot.ended,
        "recording": snapshot.recording,
        "alarms": [_alarm(alarm) for alarm in snapshot.alarms],
        "outputs": [_output(snapshot, index) for index in range(len(snapshot.sinks))],
    }


def at_end(payload: JsonObject) -> JsonObject:
    """Return a state as it is to be kept after the session: nothing in it is of the present."""
    permanent = {name: value for name, value in payload.items() if name not in _PRESENT.union(in_state())}
    # A link that was open to the end has not sent that it ended.
    note = {"note": text(Reason(LinkCode.LINK_ENDED))} if payload.get("connected") else {}
    return {**permanent, **note, **_AT_END[payload["type"]]}


def _seconds(host_ns: int) -> float:
    """Return seconds since the epoch with microseconds; JSON readers have no 64-bit integers."""
    return round(host_ns * 1e-9, 6)


def _alarm(alarm: Alarm) -> JsonObject:
    return {"subject": alarm.position, "name": str(alarm.name), "reason": as_json(alarm.reason)}


def _output(snapshot: SessionSnapshot, index: int) -> JsonObject:
    sink = snapshot.sinks[index]
    return {"output": sink.sink, "state": str(sink.state), "published": sink.published, "dropped": sink.dropped}


def is_current(snapshot: WheelSnapshot, name: str) -> bool:
    """Return whether an estimate of the last revolution may stand for now: a wheel that stands has no speed."""
    is_of_now = snapshot.state is WheelState.ROLLING or not name.endswith(_OF_MOTION)
    return snapshot.silence is None and is_of_now


def _last_value(snapshot: WheelSnapshot, name: str) -> float | None:
    """Return the value of an estimate of the last revolution unless it is invalid or not of now."""
    estimate = snapshot.estimate(name) if is_current(snapshot, name) else None
    return estimate.value if estimate is not None else None
