"""Layout of a recording within MCAP: topics, names, and the conversion of link items to messages."""

import base64
import json
import math
import zlib
from collections.abc import Iterator, Mapping
from typing import Any, Final, NamedTuple

import numpy as np

from gateway.core.links import bus_frames
from gateway.core.links.source import (
    EVENT_DETAILS,
    BusFrames,
    Chunk,
    LinkEvent,
    LinkEventKind,
    LinkItem,
    SensorLines,
    Sentences,
    VehicleData,
)
from gateway.core.reasons import Reason
from gateway.core.storable_text import storable

PROFILE: Final = "treadlink"
FORMAT_VERSION: Final = "1"
SESSION_METADATA: Final = "treadlink"
CHANNEL_METADATA: Final = "treadlink.channel"
REPAIR_METADATA: Final = "treadlink.repair"

RAW_ENCODING: Final = "treadlink-link-bytes"
_RAW_LAYOUT: Final = """\
The bytes of a link exactly as one read delivered them, before any decoding; log_time is their arrival.
Joined in file order, the messages of one channel are the byte stream of that link, in which frames of the
treadlink protocol (A5 5A, header, payload, CRC-32) lie at any place and may span messages. The message
sequence counts the messages of the channel from 0. The channel's metadata name the link.
"""
BUS_ENCODING: Final = "treadlink-can-frames"
SENTENCES_ENCODING: Final = "treadlink-nmea-lines"
_SENTENCES_LAYOUT: Final = """\
Whole lines of a positioning receiver as received, sentences of NMEA 0183 among them; log_time is the arrival of the
last. The channel's metadata name the link.
"""
SENSORS_ENCODING: Final = "treadlink-rtl433-lines"
_SENSORS_LAYOUT: Final = """\
Whole lines of a receiver of tire pressure sensors, JSON as rtl_433 prints it; log_time is the arrival of the last. The
channel's metadata name the link.
"""
_VEHICLE_DATA: Final[Mapping[str, type[BusFrames] | type[Sentences]]] = {
    BUS_ENCODING: BusFrames,
    SENTENCES_ENCODING: Sentences,
    SENSORS_ENCODING: SensorLines,
}
DATA_SCHEMAS: Final = {
    RAW_ENCODING: ("treadlink.LinkBytes", _RAW_LAYOUT),
    BUS_ENCODING: ("treadlink.BusFrames", bus_frames.LAYOUT),
    SENTENCES_ENCODING: ("treadlink.Sentences", _SENTENCES_LAYOUT),
    SENSORS_ENCODING: ("treadlink.SensorLines", _SENSORS_LAYOUT),
}
"""Name and text of the schemas of what links have brought, by encoding; events and decoded topics have JSON schemas."""
JSON_ENCODING: Final = "json"
MARKS_TOPIC: Final = "/marks"
COMPUTER_TOPIC: Final = "/computer"
ALARMS_TOPIC: Final = "/alarms"

_DETAIL_CODES: Final = {str(code): code for code in EVENT_DETAILS}
_MAX_CHANNEL_DIGITS: Final = 5
MAX_TIME_NS: Final = 1 << 62
"""Latest time of a recording, in 2116: half of what signed 64 bits hold, so that times can be added and subtracted."""
MAX_CHANNELS: Final = 8192
"""Largest number of channels of a recording; no session has as many."""
MAX_CHANNEL_CHARS: Final = 1024
"""Largest number of characters of topic, encoding and link of a channel."""
_DBC_KEY: Final = "dbc_zlib"
_MAX_DBC_CHARS: Final = 512 << 10
_MAX_DBC_BYTES: Final = 16 << 20
_MAX_EVENT_BYTES: Final = 64 << 10
_MAX_ITEM_BYTES: Final = 1 << 20
MAX_RECORD_BYTES: Final = 16 << 20
"""Largest record, and largest content of a compressed chunk, that is read into memory.

Treadlink writes chunks of 256 KiB, other programs of up to 4 MiB.
"""


class ChannelInfo(NamedTuple):
    """A channel of a recording.

    Attributes:
        topic: name shown in other programs.
        encoding: one of `DATA_SCHEMAS`, or `json`.
        link: link of the bytes or events, empty for other channels.
    """

    topic: str
    encoding: str
    link: str = ""


class RecordedMessage(NamedTuple):
    """Message of a recording as stored."""

    channel: ChannelInfo
    sequence: int
    log_time_ns: int
    data: bytes


def seal(entries: Mapping[str, str]) -> dict[str, str]:
    """Return metadata with a checksum, which MCAP does not provide for records outside chunks."""
    plain = {key: value for key, value in entries.items() if key != "crc32"}
    return {**plain, "crc32": f"{zlib.crc32(json.dumps(plain, sort_keys=True).encode()):08x}"}


def is_sealed(entries: Mapping[str, str]) -> bool:
    """Return whether the checksum of metadata is correct."""
    return "crc32" in entries and seal(entries)["crc32"] == entries["crc32"]


def dbc_metadata(text: str) -> dict[str, str]:
    """Return a DBC file as an entry of the session's metadata; none for one that is too large for a small record."""
    packed = base64.b64encode(zlib.compress(text.encode(), 9)).decode()
    return {_DBC_KEY: packed} if len(packed) <= _MAX_DBC_CHARS else {}


def recorded_dbc(entries: Mapping[str, str]) -> str | None:
    """Return the DBC file in the session's metadata, None where there is none or it is damaged."""
    try:
        unpacker = zlib.decompressobj()
        data = unpacker.decompress(base64.b64decode(entries[_DBC_KEY], validate=True), _MAX_DBC_BYTES)
        return data.decode() if unpacker.eof else None
    except (KeyError, ValueError, zlib.error):
        return None


def declaration(number: int, channel: ChannelInfo) -> dict[str, str]:
    """Return the metadata of the second declaration of a channel, outside the chunks."""
    return seal({"id": str(number), "topic": channel.topic, "encoding": channel.encoding, "link": channel.link})


def declared_channel(entries: Mapping[str, str]) -> tuple[int, ChannelInfo] | None:
    """Return the channel declared by metadata, None when they are damaged."""
    if not is_sealed(entries) or not entries.keys() >= {"id", "topic", "encoding", "link"}:
        return None
    if not entries["id"].isdecimal() or len(entries["id"]) > _MAX_CHANNEL_DIGITS:
        return None
    return int(entries["id"]), ChannelInfo(entries["topic"], entries["encoding"], entries["link"])


def raw_topic(link: str) -> str:
    """Return the topic of a link's bytes."""
    return f"/link/{link}/raw"


def data_channel(item: Chunk | VehicleData) -> ChannelInfo:
    """Return the channel of a link's bytes, bus frames or sentences."""
    if isinstance(item, BusFrames):
        return ChannelInfo(f"/link/{item.link}/can", BUS_ENCODING, item.link)
    if isinstance(item, SensorLines):
        return ChannelInfo(f"/link/{item.link}/rtl433", SENSORS_ENCODING, item.link)
    if isinstance(item, Sentences):
        return ChannelInfo(f"/link/{item.link}/nmea", SENTENCES_ENCODING, item.link)
    return ChannelInfo(raw_topic(item.link), RAW_ENCODING, item.link)


def event_topic(link: str) -> str:
    """Return the topic of a link's events."""
    return f"/link/{link}/event"


def event_payload(event: LinkEvent) -> dict[str, Any]:
    """Return an event or mark as the JSON object that is recorded."""
    payload: dict[str, Any] = {"link": event.link, "kind": event.kind.value, "text": event.text}
    if event.rssi_dbm is not None:
        payload["rssi_dbm"] = event.rssi_dbm
    if event.details:
        payload["details"] = [{"code": str(reason.code), "values": dict(reason.values)} for reason in event.details]
    return payload


def _event_details(recorded: list[dict[str, Any]]) -> tuple[Reason, ...]:
    """Return the details of a recorded event; what this version does not know is left out."""
    details = []
    for entry in recorded:
        values, code = entry["values"], _DETAIL_CODES.get(entry["code"])
        if code is not None and {name: type(value) for name, value in values.items()} == EVENT_DETAILS[code]:
            details.append(Reason(code, **values))
    return tuple(details)


def link_items(message: RecordedMessage) -> Iterator[LinkItem]:
    """Yield the link items of a message: none for decoded topics and unreadable events, several for very many bytes."""
    channel = message.channel
    host_ns = min(message.log_time_ns, MAX_TIME_NS)
    if channel.encoding == RAW_ENCODING:
        for begin in range(0, len(message.data), _MAX_ITEM_BYTES):
            yield Chunk(channel.link, host_ns, message.data[begin : begin + _MAX_ITEM_BYTES])
        return
    vehicle_data = _VEHICLE_DATA.get(channel.encoding)
    if vehicle_data is not None:
        if len(message.data) <= _MAX_ITEM_BYTES:
            yield vehicle_data(channel.link, host_ns, message.data)
        return
    is_of_link = channel.topic.startswith("/link/") and channel.topic.endswith("/event")
    if channel.topic not in (MARKS_TOPIC, COMPUTER_TOPIC) and not is_of_link:
        return
    event = _event(message.data, host_ns) if len(message.data) <= _MAX_EVENT_BYTES else None
    if event is not None:
        yield event


def _event(data: bytes, host_ns: int) -> LinkEvent | None:
    try:
        payload = json.loads(data)
        kind, rssi_dbm = LinkEventKind(payload["kind"]), payload.get("rssi_dbm")
        return LinkEvent(
            str(payload["link"]),
            host_ns,
            kind,
            str(payload["text"]),
            None if rssi_dbm is None else int(rssi_dbm),
            _event_details(payload.get("details", [])),
        )
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError):
        return None


def encode_json(payload: Mapping[str, Any]) -> bytes:
    """Encode a decoded topic; numbers that are not finite are left out, or null in arrays.

    JSON has no NaN, and plotting programs treat a missing field as a gap.
    """
    fields = {key: value for key, raw in payload.items() if (value := _json_value(raw)) is not None}
    return storable(json.dumps(fields, separators=(",", ":"), allow_nan=False, ensure_ascii=False)).encode()


def _json_value(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        if value.dtype.kind == "f" and not np.isfinite(value).all():
            return [_json_value(entry) for entry in value.tolist()]
        return value.tolist()
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {key: cleaned for key, raw in value.items() if (cleaned := _json_value(raw)) is not None}
    if isinstance(value, list | tuple):
        return [_json_value(entry) for entry in value]
    return value
