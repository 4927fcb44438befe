"""JSON schema of the objects that live outputs publish."""

from copy import deepcopy
from typing import Any, Final

from gateway.core.estimates.estimator import SOURCE_COLUMNS
from gateway.core.estimates.results import SinkState, WheelState
from gateway.core.quantity_catalogue import in_state
from gateway.core.recording.schemas import schema_of

_NUMBER: Final = {"type": "number"}
_COUNT: Final = {"type": "integer", "minimum": 0}
_TEXT: Final = {"type": "string"}
_SOURCES: Final = {column: {"enum": ["stated", "measured"]} for column in SOURCE_COLUMNS.values()}
_REASON: Final = {"$ref": "#/$defs/reason"}
_TIME: Final = {"type": "number", "description": "s since 1970-01-01 UTC; that of the recording in a replay"}
_NAMES: Final = {"type": "array", "items": _TEXT}


def line_schema() -> dict[str, Any]:
    """Return the schema (draft 2020-12) of one line of `jsonl:`, and of one payload of MQTT or Foxglove."""
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "treadlink live output",
        "description": "A revolution, an alarm or a state. Units are in the names; unknown numbers are left out.",
        "type": "object",
        "required": ["type", "time_s"],
        "oneOf": [{"$ref": f"#/$defs/{name}"} for name in ("revolution", "alarm", "wheel", "link", "session")],
        "$defs": {
            "reason": {
                "type": "object",
                "description": "why: a code, its values (SI units, names as given) and a text in English",
                "properties": {"code": _TEXT, "values": {"type": "object"}, "text": _TEXT},
                "required": ["code", "values", "text"],
                "additionalProperties": False,
            },
            "standing_alarm": _object("", {"subject": _TEXT, "name": _TEXT, "reason": _REASON}),
            "revolution": object_schema("revolution"),
            "alarm": object_schema("alarm"),
            "wheel": object_schema("wheel"),
            "link": object_schema("link"),
            "session": object_schema("session"),
        },
    }


def object_schema(kind: str) -> dict[str, Any]:
    """Return the schema of the objects with this `type`; reasons refer to `#/$defs/reason`."""
    return {
        "revolution": _revolution,
        "alarm": _alarm,
        "wheel": _wheel,
        "link": _link,
        "session": _session,
    }[kind]()


def _object(
    kind: str, required: dict[str, Any], optional: dict[str, Any] | None = None, description: str = ""
) -> dict[str, Any]:
    head = {"type": {"const": kind}, "time_s": _TIME} if kind else {}
    return {
        "type": "object",
        **({"description": description} if description else {}),
        "properties": {**head, **required, **(optional or {})},
        "required": [*head, *required],
        "additionalProperties": False,
    }


def _revolution() -> dict[str, Any]:
    recorded = deepcopy(dict(schema_of("/wheel/any/revolution").schema))
    schema = _object(
        "revolution",
        {"wheel": _TEXT, "index": _COUNT},
        {name: field for name, field in recorded["properties"].items() if name != "index"} | _SOURCES,
        "one revolution of one wheel; each estimate is NAME, NAME_std (one standard error), NAME_scatter_std (its "
        "scattering part, where known), NAME_status, NAME_reasons",
    )
    schema["patternProperties"] = {
        "_status$": {"enum": ["valid", "provisional", "invalid"]},
        "_reasons$": {"type": "array", "items": _REASON, "minItems": 1},
    }
    # Estimates and their errors; a plug-in may add some.
    schema["additionalProperties"] = _NUMBER
    return schema


def _alarm() -> dict[str, Any]:
    return _object(
        "alarm",
        {
            "subject": {**_TEXT, "description": "wheel, hub, link or output"},
            "name": _TEXT,
            "reason": _REASON,
            "raised": {"type": "boolean", "description": "false when it is over"},
        },
        {
            "stood_s": {**_NUMBER, "description": "time for which it stood, when it is over"},
            "acknowledged": {"type": "boolean", "description": "true when the user has acknowledged it"},
        },
        "an alarm that was raised, has another reason, was acknowledged, or is over",
    )


def _wheel() -> dict[str, Any]:
    counts = ("revolutions", "revolutions_rejected", "samples", "samples_lost", "samples_saturated")
    numbers = ("rate_hz", *in_state(), "pressure_pa", "temperature_degc", "silent_s", "environment_silent_s")
    return _object(
        "wheel",
        {
            "wheel": _TEXT,
            "state": {"enum": [str(state) for state in WheelState]},
            **dict.fromkeys(counts, _COUNT),
            "alarms": {**_NAMES, "description": "names of the alarms that stand"},
        },
        {
            "sensor_id": _TEXT,
            **_SOURCES,
            **dict.fromkeys(numbers, _NUMBER),
        },
        "state of a wheel, once a second",
    )


def _link() -> dict[str, Any]:
    counts = ("bytes_received", "frames", "frames_lost", "crc_errors", "noise_bytes", "duplicates", "reordered")
    numbers = ("latency_s", "battery_percent", "rssi_dbm", "supply_w", "silent_s")
    return _object(
        "link",
        {
            "link": _TEXT,
            "connected": {"type": "boolean"},
            "note": {**_TEXT, "description": "last event"},
            **dict.fromkeys(counts, _COUNT),
            "dropped": {**_COUNT, "description": "items that this computer had no time for"},
            "alarms": _NAMES,
        },
        dict.fromkeys(numbers, _NUMBER),
        "health of a link, once a second",
    )


def _session() -> dict[str, Any]:
    output = _object(
        "",
        {
            "output": _TEXT,
            "state": {"enum": [str(state) for state in SinkState]},
            "published": _COUNT,
            "dropped": _COUNT,
        },
    )
    return _object(
        "session",
        {
            "elapsed_s": _NUMBER,
            "ended": {"type": "boolean"},
            "recording": {**_TEXT, "description": "path, empty without one"},
            "alarms": {"type": "array", "items": {"$ref": "#/$defs/standing_alarm"}},
            "outputs": {"type": "array", "items": output},
        },
        None,
        "the session, once a second, after its wheels and links",
    )
