"""Live output to an MQTT 5 broker.

Everything is sent with QoS 1: the broker confirms it, and what it has not confirmed is sent again after a
reconnection, so a message may come twice. At most WINDOW messages are unconfirmed; `send` waits for room.
"""

from __future__ import annotations

import os
import ssl
import threading
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Final, NamedTuple
from urllib.parse import quote, unquote, urlsplit

import paho.mqtt.client as paho
from paho.mqtt.enums import CallbackAPIVersion
from paho.mqtt.packettypes import PacketTypes
from paho.mqtt.properties import Properties
from paho.mqtt.reasoncodes import ReasonCode
from paho.mqtt.subscribeoptions import SubscribeOptions

from gateway.publishing.home_assistant import (
    COMPONENTS,
    EXPIRE_S,
    Discovery,
    announced_topic,
    link_discovery,
    wheel_discovery,
)
from gateway.publishing.payloads import JsonObject, at_end, encoded, messages
from gateway.publishing.sink import (
    Item,
    PublishedAlarm,
    PublishedRevolution,
    PublishedState,
    Refusals,
    SinkAddress,
    SinkDownError,
    SinkError,
    SinkSetting,
    host_and_port,
)

USERNAME: Final = "TREADLINK_MQTT_USERNAME"
PASSWORD: Final = "TREADLINK_MQTT_PASSWORD"
KEY_PASSWORD: Final = "TREADLINK_MQTT_KEY_PASSWORD"
"""Environment variables with the credentials of the broker and the password of the client's key file."""

WINDOW: Final = 20
"""Messages that may wait for the broker's confirmation; brokers accept at least this many."""
_QOS: Final = 1
_OPTIONS: Final = frozenset({"keepalive", "discovery"})
_TLS_OPTIONS: Final = frozenset({"ca", "cert", "key"})
_PORTS: Final = {"mqtt": 1883, "mqtts": 8883}
_CONNECT_S: Final = 5.0
_WAIT_S: Final = 0.05
_KEEPALIVE_S: Final = 10
# A broker that takes longer confirms nothing on this connection any more, though it may answer pings.
CONFIRM_S: Final = 15.0
"""Time within which a broker confirms a message; then the connection is made anew and the message sent again."""
# What a broker sends: confirmations, and retained states and announcements of earlier sessions.
_MAX_PACKET_BYTES: Final = 64 << 10
# Wheels without a configuration and links have been heard by then.
_SETTLED_S: Final = 30.0
# Retained messages of earlier sessions that are removed at a time.
_MAX_RETAINED: Final = 10_000
_ONLINE: Final = b"online"
_OFFLINE: Final = b"offline"
_WITH_WILL: Final = "Disconnect with will message"


def open_mqtt(address: SinkAddress, setting: SinkSetting) -> MqttSink:
    """Return the output of `mqtt://host[:port]/prefix` or `mqtts://`.

    Raises:
        SinkError: address, option, certificate or key cannot be used.
    """
    is_tls = address.scheme == "mqtts"
    address.check_options(_OPTIONS | (_TLS_OPTIONS if is_tls else frozenset()))
    host, port = host_and_port(address, _PORTS[address.scheme])
    prefix = unquote(urlsplit(address.uri).path).strip("/") or "treadlink"
    if any(char in prefix for char in "+#\0"):
        raise SinkError(f"'{address.name}': a topic cannot contain + or #", "Give another prefix.")
    text = address.options.get("keepalive", str(_KEEPALIVE_S))
    if not (text.isascii() and text.isdigit() and 1 <= int(text) <= 3600):
        raise SinkError(f"'{address.name}': keepalive={text} is not allowed", "Give whole seconds from 1 to 3600.")
    discovery = address.options.get("discovery", "homeassistant").strip("/")
    return MqttSink(
        host,
        port,
        prefix,
        keepalive_s=int(text),
        discovery=None if discovery in ("", "off", "no") else discovery,
        tls=_tls_context(address) if is_tls else None,
        setting=setting,
        environment=os.environ,
    )


def _tls_context(address: SinkAddress) -> ssl.SSLContext:
    """Return a context that verifies the broker: with the system's authorities, or with those of `ca`."""
    options = address.options
    for name in sorted(_TLS_OPTIONS & options.keys()):
        if Path(options[name]).exists() and not Path(options[name]).is_file():  # a FIFO would wait for its writer
            raise SinkError(f"'{address.name}': {name}={options[name]} is not a file", "Give a PEM file.")
    try:
        context = ssl.create_default_context(cafile=options.get("ca"))
        if "cert" in options:
            context.load_cert_chain(options["cert"], options.get("key"), os.environ.get(KEY_PASSWORD, ""))
        elif "key" in options:
            raise SinkError(f"'{address.name}': key without cert", "Give the client's certificate with cert=FILE.")
    except (OSError, ssl.SSLError) as error:
        files = ", ".join(f"{name}={options[name]}" for name in sorted(_TLS_OPTIONS) if name in options)
        raise SinkError(
            f"'{address.name}': cannot use {files}: {error.strerror or error}",
            f"Give PEM files; the password of an encrypted key goes into {KEY_PASSWORD}.",
        ) from error
    return context


class _Client(paho.Client):
    """A client that holds the broker to the maximum packet size, which the library only announces."""

    def _sock_recv(self, bufsize: int) -> bytes:
        # The library asks for the whole rest of a packet, by the length that the broker states.
        if bufsize > _MAX_PACKET_BYTES:
            raise OSError("packet too large")
        data: bytes = super()._sock_recv(bufsize)  # type: ignore[no-untyped-call,unused-ignore]
        return data


class _Unconfirmed(NamedTuple):
    """A message that the broker has not confirmed: whether it is counted, and when it was sent last."""

    is_counted: bool
    sent_ns: int


class MqttSink:
    """Publishes JSON under a prefix.

    | Topic | Retained | Content |
    |---|---|---|
    | PREFIX/status | yes | `online`, or `offline` as last will and at the end |
    | PREFIX/wheel/POSITION/revolution | no | each revolution |
    | PREFIX/wheel/POSITION/state | yes | state of the wheel, once a second |
    | PREFIX/link/LINK/state | yes | health of the link, once a second |
    | PREFIX/alarm | no | each alarm that is raised or over |
    | PREFIX/session | yes | the session with all present alarms, once a second |

    A broker drops a retained state that is not renewed for EXPIRE_S: a client has a single last will, so that the
    states of a gateway that dies would stay. At the end, states without numbers replace them for good. States and
    discovery messages of wheels and links that only an earlier session had are removed.

    POSITION and LINK are percent-encoded. The client is driven by the worker's thread, not by one of its own.
    """

    def __init__(
        self,
        host: str,
        port: int,
        prefix: str,
        *,
        keepalive_s: int,
        discovery: str | None,
        tls: ssl.SSLContext | None,
        setting: SinkSetting,
        environment: Mapping[str, str],
    ) -> None:
        """Prepare the client.

        Args:
            host: of the broker.
            port: of the broker.
            prefix: of all topics, without slashes at its ends.
            keepalive_s: a broker that is silent for up to twice this time is given up.
            discovery: prefix of Home Assistant's discovery topics, None to send none.
            tls: for an encrypted connection.
            setting: has the configured wheels, and the clock by which confirmations are late.
            environment: holds the credentials.
        """
        self._clock = setting.clock
        self._host, self._port, self._prefix = host, port, prefix
        self._keepalive_s = keepalive_s
        self._discovery = discovery
        self._announced: set[str] = set()
        # The last state of each topic.
        self._states: dict[str, JsonObject] = {}
        self._wheels = frozenset(self._topic_of("wheel", position) for position in setting.positions)
        # Retained messages of earlier sessions: the topic of the state that each belongs to.
        self._retained: dict[str, str] = {}
        # Messages that the broker has not confirmed yet, by their number, in the order in which they were sent.
        self._window: dict[int, _Unconfirmed] = {}
        # Counted messages that the broker took from the client and refused, and why.
        self._refusals = Refusals()
        self._refusal = ""
        self._has_connected = False
        self._has_ended = False
        self._is_called_offline = False
        # An empty name makes the broker choose one, so that two gateways cannot disconnect each other.
        self._client = _Client(CallbackAPIVersion.VERSION2, client_id="", protocol=paho.MQTTv5)
        self._client.connect_timeout = _CONNECT_S
        self._client.max_inflight_messages_set(WINDOW)
        self._client.will_set(f"{prefix}/status", _OFFLINE, _QOS, retain=True)
        if tls is not None:
            self._client.tls_set_context(tls)
        if USERNAME in environment:
            self._client.username_pw_set(environment[USERNAME], environment.get(PASSWORD))
        self._client.on_connect = self._connected
        self._client.on_disconnect = self._disconnected
        self._client.on_message = self._received
        self._client.on_publish = self._confirmed

    def open(self, stop: threading.Event) -> None:
        """Connect and wait for the broker's answer."""
        self._refusal = ""
        self._announced.clear()
        try:
            if self._has_connected:
                self._client.reconnect()
            else:
                limits = Properties(PacketTypes.CONNECT)  # type: ignore[no-untyped-call]
                limits.MaximumPacketSize = _MAX_PACKET_BYTES
                self._client.connect(self._host, self._port, self._keepalive_s, properties=limits)
                self._has_connected = True
        except ssl.SSLCertVerificationError as error:
            raise SinkDownError(f"the broker's certificate is not trusted: {error.verify_message}") from error
        except (OSError, ValueError) as error:
            raise SinkDownError(_cause(error)) from error
        for _ in range(int(_CONNECT_S / _WAIT_S)):
            if self._client.is_connected() or self._refusal or stop.is_set():
                break
            if self._client.loop(_WAIT_S) is not paho.MQTT_ERR_SUCCESS and not self._refusal:
                raise SinkDownError("the broker closed the connection")
        if self._refusal:
            raise SinkDownError(self._refusal)
        if not self._client.is_connected():
            raise SinkDownError("the broker does not answer")
        # The last will of an earlier connection may come late, after this one has said that it is online.
        self._client.subscribe(f"{self._prefix}/status", _QOS)
        for topics in self._earlier_topics():
            self._client.subscribe(topics, options=SubscribeOptions(_QOS, noLocal=True))
        # The client has sent them again.
        now_ns = self._clock.now_ns()
        self._window = {number: _Unconfirmed(sent.is_counted, now_ns) for number, sent in self._window.items()}
        self._publish(f"{self._prefix}/status", _ONLINE, stop, retain=True)

    def send(self, item: Item, stop: threading.Event) -> None:
        """Publish an item and wait for room in the window."""
        self._refusals.check()
        if isinstance(item, PublishedRevolution):
            position = quote(item.result.position, safe="")
            topic = f"{self._prefix}/wheel/{position}/revolution"
            self._publish(topic, encoded(next(messages(item))), stop, counted=True)
        elif isinstance(item, PublishedAlarm):
            self._publish(f"{self._prefix}/alarm", encoded(next(messages(item))), stop, counted=True)
        else:
            for payload in messages(item):
                self._announce(payload, stop)
                topic = self._state_topic(payload)
                self._states[topic] = payload
                self._publish(topic, encoded(payload), stop, retain=True, expires=True)
            self._remove_earlier(item, stop)

    def poll(self) -> None:
        """Read confirmations and send keep-alive messages."""
        self._loop(0.0)
        self._refusals.check()

    def flush(self, stop: threading.Event) -> int:
        """Wait for the confirmations, with `offline` as the last message; return how many are missing.

        Before it, states without numbers replace the last ones.
        """
        if not stop.is_set():
            self._has_ended = True
            for topic, payload in self._states.items():
                self._publish(topic, encoded(at_end(payload)), stop, retain=True)
            self._publish(f"{self._prefix}/status", _OFFLINE, stop, retain=True)
        while self._window and not stop.is_set():
            self._loop(_WAIT_S)
        if not stop.is_set():
            self._refusals.check()
        return sum(sent.is_counted for sent in self._window.values()) + self._refusals.count

    def close(self) -> None:
        """Disconnect; what is not confirmed is sent again after `open`."""
        if self._client.is_connected():
            # A broker that has not taken the last message publishes the will.
            is_told = self._has_ended and not self._window
            self._client.disconnect(None if is_told else ReasonCode(PacketTypes.DISCONNECT, _WITH_WILL))
            self._client.loop(0.0)

    def _state_topic(self, payload: JsonObject) -> str:
        kind = payload["type"]
        return f"{self._prefix}/session" if kind == "session" else self._topic_of(kind, payload[kind])

    def _topic_of(self, kind: str, name: str) -> str:
        return f"{self._prefix}/{kind}/{quote(name, safe='')}/state"

    def _earlier_topics(self) -> Iterator[str]:
        """Yield the filters of topics that may hold states and announcements of earlier sessions."""
        for kind in ("wheel", "link"):
            yield f"{self._prefix}/{kind}/+/state"
        if self._discovery is not None:
            for component in COMPONENTS:
                yield f"{self._discovery}/{component}/+/+/config"

    def _remove_earlier(self, item: PublishedState, stop: threading.Event) -> None:
        """Remove what an earlier session has left of wheels and links that this one does not have.

        Home Assistant forgets what a user has set for an entity that is removed. So an entity stays until it is certain
        that its wheel or link is not of this session: configured wheels are certain at once, others may come late.
        """
        snapshot = item.snapshot
        is_settled = snapshot.elapsed_s >= _SETTLED_S or (snapshot.ended and bool(snapshot.wheels))
        for topic, state_topic in tuple(self._retained.items()):
            if state_topic in self._states or state_topic in self._wheels:
                del self._retained[topic]
                continue
            is_other_wheel = bool(self._wheels) and state_topic.startswith(f"{self._prefix}/wheel/")
            if topic == state_topic or is_other_wheel or is_settled:
                self._publish(topic, b"", stop, retain=True)
                self._retained.pop(topic, None)

    def _announce(self, payload: JsonObject, stop: threading.Event) -> None:
        """Announce a wheel or link to Home Assistant, once per connection."""
        kind = payload["type"]
        topic = self._state_topic(payload)
        if self._discovery is None or kind == "session" or topic in self._announced:
            return
        describe = wheel_discovery if kind == "wheel" else link_discovery
        discovery: Discovery
        for discovery in describe(self._discovery, self._prefix, payload[kind]):
            self._publish(discovery.topic, encoded(discovery.payload), stop, retain=True)
        self._announced.add(topic)

    def _publish(
        self,
        topic: str,
        payload: bytes,
        stop: threading.Event,
        *,
        retain: bool = False,
        counted: bool = False,
        expires: bool = False,
    ) -> None:
        self._loop(0.0)
        while len(self._window) >= WINDOW:
            if stop.is_set():
                raise SinkDownError("the session has ended")
            self._loop(_WAIT_S)
        self._hand_over(topic, payload, retain=retain, counted=counted, expires=expires)

    def _hand_over(
        self, topic: str, payload: bytes, *, retain: bool, counted: bool = False, expires: bool = False
    ) -> None:
        """Give a message to the client, which sends it, and sends it again after a reconnection."""
        properties = None
        if expires:
            properties = Properties(PacketTypes.PUBLISH)  # type: ignore[no-untyped-call]
            properties.MessageExpiryInterval = EXPIRE_S
        info = self._client.publish(topic, payload, _QOS, retain, properties)
        if info.rc is paho.MQTT_ERR_QUEUE_SIZE:
            raise SinkDownError("the client takes no message")
        # With any other result the client keeps the message, also where the link broke in that very call. The result
        # says nothing about it later: only the broker's confirmation does.
        self._window[info.mid] = _Unconfirmed(counted, self._clock.now_ns())

    def _loop(self, timeout_s: float) -> None:
        result = self._client.loop(timeout_s)
        if result is not paho.MQTT_ERR_SUCCESS or not self._client.is_connected():
            raise SinkDownError(self._refusal or "the connection to the broker is lost")
        oldest = next(iter(self._window.values()), None)
        if oldest is not None and self._clock.now_ns() - oldest.sent_ns > CONFIRM_S * 1e9:
            raise SinkDownError(f"the broker has confirmed nothing for {CONFIRM_S:g} s")
        if self._is_called_offline and len(self._window) < WINDOW:
            self._is_called_offline = False
            self._hand_over(f"{self._prefix}/status", _ONLINE, retain=True)

    def _connected(self, client: paho.Client, data: Any, flags: Any, reason: ReasonCode, properties: Any) -> None:
        if reason.is_failure:
            self._refusal = f"the broker refuses: {str(reason).lower()}"

    def _disconnected(self, client: paho.Client, data: Any, flags: Any, reason: ReasonCode, properties: Any) -> None:
        if flags.is_disconnect_packet_from_server and not self._refusal:
            self._refusal = f"the broker ended the connection: {str(reason).lower()}"

    def _confirmed(self, client: paho.Client, data: Any, number: int, reason: ReasonCode, properties: Any) -> None:
        sent = self._window.pop(number, None)
        if sent is not None and sent.is_counted and reason.is_failure:
            self._refusals.add(str(reason).lower(), 1)

    def _received(self, client: paho.Client, data: Any, message: paho.MQTTMessage) -> None:
        if message.topic == f"{self._prefix}/status":
            self._is_called_offline = message.payload == _OFFLINE and not self._has_ended
        elif message.retain and message.payload and len(self._retained) < _MAX_RETAINED:
            is_state = message.topic.startswith(f"{self._prefix}/")
            topic = message.topic if is_state else announced_topic(bytes(message.payload), f"{self._prefix}/status")
            if topic is not None:
                self._retained[message.topic] = topic


def _cause(error: Exception) -> str:
    """Return the message of an error without its number."""
    text = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return text[:1].lower() + text[1:]
