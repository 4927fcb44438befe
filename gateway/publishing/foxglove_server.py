"""Live output as a Foxglove WebSocket server, for plots and logs while the session runs."""

from __future__ import annotations

import threading
from copy import deepcopy
from typing import Any, Final
from urllib.parse import quote

import foxglove
from foxglove.channels import LogChannel
from foxglove.messages import Log, LogLevel, Timestamp

from gateway.core.estimates.results import WheelSnapshot
from gateway.core.reasons import Level, Notice
from gateway.core.recording.schemas import schema_of
from gateway.core.text.recording_topics import waveform_payload, wheel_topic
from gateway.core.text.wording import notice_text
from gateway.publishing.line_schema import line_schema
from gateway.publishing.origin_gate import OriginGate, hidden_loopback
from gateway.publishing.payloads import encoded, messages
from gateway.publishing.sink import (
    Item,
    PublishedAlarm,
    PublishedRevolution,
    PublishedState,
    Sink,
    SinkAddress,
    SinkDownError,
    SinkError,
    SinkSetting,
    cannot_listen,
    host_and_port,
)

_PORT: Final = 8765
_LEVELS: Final = {
    Level.INFO: LogLevel.Info,
    Level.WARNING: LogLevel.Warning,
    Level.SECURITY: LogLevel.Warning,
    Level.ERROR: LogLevel.Error,
}


def open_foxglove(address: SinkAddress, setting: SinkSetting) -> FoxgloveSink:
    """Return the output of `foxglove://HOST[:PORT]`; only this computer can connect to a HOST of 127.0.0.1.

    Raises:
        SinkError: the address cannot be used.
    """
    address.check_options(("origin",))
    host, port = host_and_port(address, _PORT)
    if address.target.partition("/")[2]:
        raise SinkError(f"'{address.name}' has a path", "Write foxglove://HOST:PORT.")
    origins = address.options.get("origin", "").split(",")
    return FoxgloveSink(host, port, frozenset(filter(None, origins)))


class FoxgloveSink(Sink):
    """Serves channels with schemas; a viewer gets what is published after it has subscribed.

    | Channel | Schema | Content |
    |---|---|---|
    | /wheel/POSITION/revolution | treadlink.Revolution | each revolution |
    | /wheel/POSITION/waveform | treadlink.Waveform | radial axis of the last revolution, once a second |
    | /wheel/POSITION/state, /link/LINK/state, /session | treadlink.Wheel, .Link, .Session | states, once a second |
    | /alarm | treadlink.Alarm | each alarm that is raised or over |
    | /log | foxglove.Log | alarms and notices as text |

    The server keeps a bounded number of messages for each viewer and drops the oldest for a slow one.
    """

    def __init__(self, host: str, port: int, origins: frozenset[str] = frozenset()) -> None:
        """Prepare the server; port 0 lets the system choose one, and web pages of `origins` may connect."""
        self._host, self._port, self._origins = host, port, origins
        self._gate: OriginGate | None = None
        self._server: foxglove.websocket.WebSocketServer | None = None
        self._context = foxglove.Context()
        self._channels: dict[str, foxglove.Channel] = {}
        self._log: LogChannel | None = None
        self._shown_revolutions: dict[str, int] = {}
        self._logged: Notice | None = None

    @property
    def port(self) -> int:
        """The port that the server listens on, 0 before it does."""
        return self._gate.port if self._gate is not None else 0

    def open(self, stop: threading.Event) -> None:
        """Start the server."""
        self._context = foxglove.Context()
        self._channels.clear()
        try:
            address = hidden_loopback()
            self._server = foxglove.start_server(name="treadlink", host=address, port=0, context=self._context)
            self._gate = OriginGate(self._host, self._port, (address, self._server.port), self._origins)
        except Exception as error:  # the library raises errors of its own
            self._stop()
            raise SinkDownError(cannot_listen(self._host, self._port, error)) from error
        self._log = LogChannel("/log", context=self._context)

    def send(self, item: Item, stop: threading.Event) -> None:
        """Log an item to its channels."""
        if isinstance(item, PublishedRevolution):
            for payload in messages(item):
                self._write(wheel_topic(item.result.position, "revolution"), payload, item.host_ns)
        elif isinstance(item, PublishedAlarm):
            for payload in messages(item):
                self._write("/alarm", payload, item.host_ns)
        else:
            for payload in messages(item):
                kind = payload["type"]
                name = "/session" if kind == "session" else f"/{kind}/{quote(payload[kind], safe='')}/state"
                self._write(name, payload, item.host_ns)
            for snapshot in item.snapshot.wheels:
                self._write_waveform(snapshot, item.host_ns)
            self._write_notices(item)

    def close(self) -> None:
        """Stop the server."""
        for channel in self._channels.values():
            channel.close()
        self._channels.clear()
        if self._log is not None:
            self._log.close()
            self._log = None
        self._stop()

    def _stop(self) -> None:
        if self._gate is not None:
            self._gate.close()
            self._gate = None
        if self._server is not None:
            self._server.stop()
            self._server = None

    def _write(self, topic: str, payload: dict[str, Any], host_ns: int) -> None:
        channel = self._channels.get(topic)
        if channel is None:
            schema = channel_schema(topic, payload.get("type", ""))
            channel = foxglove.Channel(topic, schema=schema, context=self._context)
            self._channels[topic] = channel
        if channel.has_sinks():
            channel.log(encoded(payload), log_time=host_ns)

    def _write_waveform(self, wheel: WheelSnapshot, host_ns: int) -> None:
        last, average = wheel.last, wheel.average_mps2
        if last is None or average is None:
            return
        if self._shown_revolutions.get(wheel.position) != last.revolution.index:
            self._shown_revolutions[wheel.position] = last.revolution.index
            payload = waveform_payload(last, average)
            self._write(wheel_topic(wheel.position, "waveform"), payload, host_ns)

    def _write_notices(self, item: PublishedState) -> None:
        """Log the notices that are new since the last state; one may equal an older one."""
        notices = item.snapshot.notices
        begin = max((end for end, notice in enumerate(notices, 1) if notice is self._logged), default=0)
        at_s, rest_ns = divmod(item.host_ns, 1_000_000_000)
        for notice in notices[begin:]:
            if self._log is not None:
                self._log.log(
                    Log(
                        timestamp=Timestamp(sec=at_s, nsec=rest_ns),
                        level=_LEVELS[notice.level],
                        message=notice_text(notice),
                        name=notice.subject or "session",
                    ),
                    log_time=item.host_ns,
                )
        if notices:
            self._logged = notices[-1]


def channel_schema(topic: str, kind: str) -> dict[str, Any]:
    """Return the JSON schema of a channel: plain types only, as Foxglove needs them.

    Args:
        topic: of the channel.
        kind: `type` of its messages, empty for a waveform, which has none.
    """
    if not kind:
        return deepcopy(dict(schema_of(topic).schema))
    document = line_schema()
    schema: dict[str, Any] = _plain(document["$defs"][kind], document["$defs"])
    return {**schema, "$schema": document["$schema"], "title": f"treadlink.{kind.capitalize()}"}


def _plain(schema: Any, definitions: dict[str, Any]) -> Any:
    """Return a schema without references, patterns, constants and lists of allowed values."""
    if isinstance(schema, list):
        return [_plain(part, definitions) for part in schema]
    if not isinstance(schema, dict):
        return schema
    if "$ref" in schema:
        return _plain(definitions[schema["$ref"].rpartition("/")[2]], definitions)
    if "const" in schema or "enum" in schema:
        return {"type": "string"}
    omitted_keys = {"patternProperties", "additionalProperties", "minItems", "minimum"}
    return {key: _plain(value, definitions) for key, value in schema.items() if key not in omitted_keys}
