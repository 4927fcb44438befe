"""JSON schemas of the decoded topics, so that Foxglove and PlotJuggler can offer and plot their fields.

Only plain types are used (no unions, no null): Foxglove refuses schemas with more. A number that is not known is left
out of the message. Fields beyond the listed ones are allowed, such as the estimates of a later version. A reason is an
object with `code`, `values` (SI units, their names depend on the code) and `text`. The fields of the vehicle's signals
are those of the configuration, numbers in SI units.
"""

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final, NamedTuple

from gateway.core.recording import revolution_fields
from gateway.core.recording.mcap_layout import (
    ALARMS_TOPIC,
    COMPUTER_TOPIC,
    DATA_SCHEMAS,
    MARKS_TOPIC,
    ChannelInfo,
)


class TopicSchema(NamedTuple):
    """Schema of the topics that match a pattern."""

    name: str
    topic: re.Pattern[str]
    required: tuple[str, ...]
    schema: Mapping[str, Any]

    def to_bytes(self) -> bytes:
        """Return the JSON schema as stored."""
        return json.dumps(self.schema, separators=(",", ":")).encode()


_TYPES: Final[dict[str, dict[str, Any]]] = {
    "n": {"type": "number"},
    "i": {"type": "integer"},
    "s": {"type": "string"},
    "b": {"type": "boolean"},
    "[n]": {"type": "array", "items": {"type": "number"}},
    "o": {"type": "object"},
    "[o]": {"type": "array", "items": {"type": "object"}},
}


def _listed(fields: str) -> Iterator[tuple[str, str, str]]:
    """Yield name, type and description from `name: type: description` lines."""
    for line in fields.strip().splitlines():
        field, kind, description = (part.strip() for part in line.split(":", 2))
        yield field, kind, description


def _topic(name: str, pattern: str, required: str, fields: str | Iterable[tuple[str, str, str]]) -> TopicSchema:
    """Declare a topic: `fields` has name, type and description of each, types as in _TYPES."""
    properties: dict[str, Any] = {}
    for field, kind, description in _listed(fields) if isinstance(fields, str) else fields:
        properties[field] = {**_TYPES[kind], "description": description}
    schema = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": name,
        "type": "object",
        "properties": properties,
        "required": required.split(),
    }
    return TopicSchema(name, re.compile(pattern), tuple(required.split()), schema)


TOPICS: Final[tuple[TopicSchema, ...]] = (
    _topic(
        "treadlink.Revolution",
        r"/wheel/[^/]+/revolution",
        "index",
        revolution_fields.fields(),
    ),
    _topic(
        "treadlink.Waveform",
        r"/wheel/[^/]+/waveform",
        "index",
        """
        index: i: running number of the wheel's revolutions
        theta_rad: [n]: angle of the sensor from the contact centre
        radial_mps2: [n]: radial specific force of the revolution, gravity removed
        average_mps2: [n]: running average at the same speed
        """,
    ),
    _topic(
        "treadlink.Reference",
        r"/wheel/[^/]+/reference/[^/]+",
        "quantity time_s value",
        """
        quantity: s: speed, rotation, angle or pulses
        time_s: n: hub time
        value: n: speed in m/s, rotation in turns per second, or turns so far
        value_std: n: one standard error
        """,
    ),
    _topic(
        "treadlink.Environment",
        r"/wheel/[^/]+/environment",
        "",
        """
        pressure_pa: n: inflation pressure (gauge)
        temperature_degc: n: temperature of the inner liner
        supply_v: n: supply of the sensor
        """,
    ),
    _topic(
        "treadlink.HubStatus",
        r"/hub/[^/]+/status",
        "uptime_s",
        """
        uptime_s: i: since the hub's start
        battery_percent: i: state of charge
        supply_v: n: supply voltage
        supply_w: n: supply power
        rssi_dbm: i: signal strength of the sensor link
        frames_sent: i: frames handed to the link
        frames_dropped: i: frames the hub could not send
        samples_dropped: i: samples the hub could not send
        link_retries: i: retransmissions on the sensor link
        """,
    ),
    _topic(
        "treadlink.Hello",
        r"/hub/[^/]+/hello",
        "",
        """
        wheel: i: wheel number at the hub
        protocol: s: version of the protocol, major.minor
        hub_id: s: serial number of the hub, hex
        sensor_id: s: serial number of the sensor, hex
        firmware: s: version of the firmware
        boot_count: i: how often the hub has started
        rate_hz: n: sampling rate
        axes: i: axis mask: 1 circumferential, 2 lateral, 4 radial
        coupling: s: dc or ac
        highpass_hz: n: corner of the AC coupling
        range_mps2: [n]: full scale, circumferential, lateral, radial; 0 where absent or not known
        scale_mps2: [n]: m/s^2 a count, circumferential, lateral, radial
        offset_counts: [n]: counts at zero, circumferential, lateral, radial
        saturation_counts: i: counts at or above which a sample is saturated
        """,
    ),
    _topic("treadlink.VehicleSignals", r"/vehicle/signals", "", ""),
    _topic(
        "treadlink.LinkEvent",
        r"/link/.+/event",
        "link kind text",
        """
        link: s: name of the link
        kind: s: connected, lost, retrying, restored or ended
        text: s: message of the error behind the event, empty without one
        rssi_dbm: i: signal strength of a radio link when it was connected
        details: [o]: codes with their values
        """,
    ),
    _topic(
        "treadlink.Mark",
        re.escape(MARKS_TOPIC),
        "link kind text",
        """
        link: s: link the mark belongs to, may be empty
        kind: s: always mark
        text: s: what the user typed
        """,
    ),
    _topic(
        "treadlink.ComputerEvent",
        re.escape(COMPUTER_TOPIC),
        "link kind text",
        """
        link: s: always empty
        kind: s: always computer
        text: s: always empty
        details: [o]: codes with their values
        """,
    ),
    _topic(
        "treadlink.Alarm",
        re.escape(ALARMS_TOPIC),
        "subject name state",
        """
        subject: s: wheel, link, hub or live output
        name: s: kind of the alarm
        state: s: raised, acknowledged or over
        at_s: n: time from the beginning of the session
        stood_s: n: time for which it has stood
        code: s: code of its reason
        values: o: values of the code, in SI units
        text: s: its reason in words
        """,
    ),
    _topic(
        "treadlink.Log",
        r"/log",
        "level text",
        """
        level: s: debug, info, warning, error, or level N of a later version
        text: s: the line
        hub: i: hub that wrote it
        link: s: link it came by
        subject: s: link, hub or wheel that a line of the gateway is about
        code: s: code of a line of the gateway
        values: o: values of the code, in SI units
        """,
    ),
)


def schema_of(topic: str) -> TopicSchema:
    """Return the schema of a decoded topic.

    Raises:
        ValueError: the topic is not one of the recording's.
    """
    for candidate in TOPICS:
        if candidate.topic.fullmatch(topic):
            return candidate
    patterns = ", ".join(entry.topic.pattern for entry in TOPICS)
    raise ValueError(f"no schema for topic '{topic}'; topics look like {patterns}")


class StoredSchema(NamedTuple):
    """A schema record: name, encoding, text."""

    name: str
    encoding: str
    data: bytes


def stored_schema(channel: ChannelInfo) -> StoredSchema:
    """Return the schema record that a channel points to; topics of other versions get one that allows anything."""
    if channel.encoding in DATA_SCHEMAS:
        name, layout = DATA_SCHEMAS[channel.encoding]
        return StoredSchema(name, "text/plain", layout.encode())
    try:
        schema = schema_of(channel.topic)
    except ValueError:
        return StoredSchema("treadlink.Any", "jsonschema", b'{"type":"object"}')
    return StoredSchema(schema.name, "jsonschema", schema.to_bytes())
