"""Declaration of the packets, the source of the specification's tables, the C code and the test vectors.

Slow and readable on purpose: `codec.py` does the work at run time and is held byte for byte against this. Field names
and units are those of the wire; `to_message` relates them to the values in `messages.py`.
"""

import zlib
from collections.abc import Mapping
from typing import Any, Final, NamedTuple

import construct as c
import numpy as np

from firmware_protocol import wire
from firmware_protocol.checks import MAX_F32
from firmware_protocol.messages import (
    Challenge,
    ChallengeAnswer,
    CommandResult,
    Coupling,
    Environment,
    Frame,
    Hello,
    HubStatus,
    LogText,
    Message,
    MessageType,
    SampleBlock,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)


class Limited(c.Validator):  # type: ignore[misc]
    """A number from `low` to `high`, or `none` where the value is not available."""

    def __init__(
        self, subcon: Any, low: float | None = None, high: float | None = None, *, none: int | None = None
    ) -> None:
        super().__init__(subcon)
        self.low, self.high, self.none = low, high, none

    def _validate(self, obj: float, context: Any, path: Any) -> bool:  # noqa: ARG002 - construct's signature
        if obj == self.none:
            return True
        return (self.low is None or obj >= self.low) and (self.high is None or obj <= self.high)


def _real(low: float = -MAX_F32, high: float = MAX_F32) -> Limited:
    return Limited(c.Float32l, low, high)


AXES: Final = Limited(c.Int8ul, 1, wire.ALL_AXES)
MAX_SAMPLES: Final = (wire.MAX_PAYLOAD_BYTES - wire.SAMPLES_HEADER_BYTES) // 2

HEADER: Final = c.Struct(
    "sync" / c.Const(wire.SYNC) * "A5 5A",
    "version" / c.Int8ul * "16 * major + minor; minor is the version in which the layout of this frame appeared",
    "type" / c.Int8ul * "message type",
    "length" / Limited(c.Int8ul, 0, wire.MAX_PAYLOAD_BYTES) * "bytes of the payload",
    "hub" / c.Int8ul * "number of the hub on its link",
    "wheel" / c.Int8ul * "number of the wheel at the hub; 255: the hub itself",
    "flags" / c.Int8ul * "0; bit 0: signed (below)",
    "seq" / c.Int32ul * "counter of the source (hub, wheel), 0 at start, one more with every frame, wraps",
    "tick_us" / c.Int32ul * "µs since the hub's start, low 32 bits; of the first sample for samples",
)

FRAME: Final = c.Struct(
    "body" / c.RawCopy(c.Struct(*HEADER.subcons, "payload" / c.Bytes(c.this.length))),
    "crc32" / c.Checksum(c.Int32ul, zlib.crc32, c.this.body.data),
)

HELLO: Final = c.Struct(
    "protocol_major" / c.Int8ul * "major protocol version of the firmware",
    "protocol_minor" / c.Int8ul * "minor protocol version of the firmware",
    "firmware_major" / c.Int8ul * "version of the firmware, for display",
    "firmware_minor" / c.Int8ul * "",
    "firmware_patch" / c.Int16ul * "",
    "axes" / AXES * "axis mask: bit 0 circumferential, 1 lateral, 2 radial",
    "coupling" / Limited(c.Int8ul, min(Coupling), max(Coupling)) * "0 DC, 1 AC",
    "hub_id" / c.Int64ul * "serial number of the hub",
    "sensor_id" / c.Int32ul * "serial number of the sensor",
    "boot_count" / c.Int32ul * "number of starts of the hub",
    "rate_hz" / _real(wire.MIN_RATE_HZ, wire.MAX_RATE_HZ) * "sampling rate in Hz",
    "highpass_hz" / _real(0.0) * "corner of the AC coupling in Hz, 0 when DC or not known",
    "range_mps2" / c.Array(3, _real(0.0)) * "full scale in m/s² of axes 0, 1, 2; 0 where absent or not known",
    "scale_mps2"
    / c.Array(3, _real())
    * "m/s² per count, not 0 on a present axis; its sign turns the axis into the protocol's direction",
    "offset_counts" / c.Array(3, _real()) * "counts at zero acceleration",
    "saturation_counts"
    / Limited(c.Int16ul, 1, wire.MAX_SATURATION_COUNTS)
    * "abs(count) at or above which a sample is saturated",
    c.Terminated,
)

SAMPLES: Final = c.Struct(
    "first_sample" / c.Int32ul * "running number of the first sample, wraps; includes samples never sent",
    "axes" / AXES * "axis mask",
    "n" / Limited(c.Int8ul, 1, MAX_SAMPLES) * "samples in this block; 109, 54 or 36 fit with 1, 2 or 3 axes",
    "counts"
    / c.Array(lambda this: this.n * this.axes.bit_count(), c.Int16sl)
    * "n rows, each the channels of one sample in ascending bit order of the axis mask",
    c.Terminated,
)

ENVIRONMENT: Final = c.Struct(
    "pressure_pa" / Limited(c.Int32sl, none=wire.NONE_I32) * "inflation pressure above ambient in Pa",
    "temperature_cdegc" / Limited(c.Int16sl, none=wire.NONE_I16) * "inner liner in 0.01 °C",
    "supply_mv" / Limited(c.Int16ul, none=wire.NONE_U16) * "supply of the sensor in mV",
    c.Terminated,
)

HUB_STATUS: Final = c.Struct(
    "uptime_s" / c.Int32ul * "s since the hub's start",
    "frames_sent" / c.Int32ul * "frames handed to the link, wraps",
    "frames_dropped" / c.Int32ul * "frames the hub could not send, wraps",
    "samples_dropped" / c.Int32ul * "samples the hub could not send, wraps",
    "link_retries" / c.Int32ul * "retransmissions on the sensor link, wraps",
    "supply_uw" / c.Int32ul * "supply power of the hub in µW",
    "supply_mv" / c.Int16ul * "supply voltage of the hub in mV",
    "battery_percent" / Limited(c.Int8ul, 0, wire.MAX_BATTERY_PERCENT, none=wire.NONE_U8) * "state of charge in %",
    "rssi_dbm" / Limited(c.Int8sl, none=wire.NONE_I8) * "signal strength of the sensor link in dBm",
    c.Terminated,
)

TIME_SYNC: Final = c.Struct(
    "hub_us" / c.Int64ul * "µs since the hub's start; its low 32 bits are the frame's tick_us",
    "host_ns" / c.Int64ul * "latest host time received by the hub, ns since 1970; 0 when none",
    c.Terminated,
)

LOG_TEXT: Final = c.Struct(
    "level" / c.Int8ul * "0 debug, 1 info, 2 warning, 3 error; others reserved",
    "text" / c.GreedyBytes * "one line of UTF-8, not terminated",
)

COMMAND_RESULT: Final = c.Struct(
    "seq" / c.Int32ul * "seq of the command's frame; with outcome 5, the highest accepted seq",
    "command" / c.Int8ul * "type of the command",
    "outcome" / c.Int8ul * "0 done, 1 unknown command, 2 value refused, 3 failed, 4 not verified, 5 repeated",
    c.Terminated,
)

CHALLENGE_ANSWER: Final = c.Struct(
    "nonce" / c.Int64ul * "nonce of the challenge",
    "boot_count" / c.Int32ul * "the hub's present start; the tag is under it",
    "highest_seq" / c.Int32ul * "highest accepted seq under the hub's key in this start, 0 before the first",
    c.Terminated,
)

SET_STREAM: Final = c.Struct(
    "running" / Limited(c.Int8ul, 0, 1) * "1: send samples, 0: send none; all other messages continue",
    c.Terminated,
)

SET_RATE: Final = c.Struct(
    "rate_hz"
    / _real(wire.MIN_RATE_HZ, wire.MAX_RATE_HZ)
    * "requested sampling rate in Hz; the sensor takes the nearest that it supports",
    c.Terminated,
)

SET_TIME: Final = c.Struct(
    "host_ns" / c.Int64ul * "host time, ns since 1970",
    c.Terminated,
)

CHALLENGE: Final = c.Struct(
    "nonce" / c.Int64ul * "random number, never used before",
    c.Terminated,
)

PAYLOADS: Final[dict[MessageType, c.Struct]] = {
    MessageType.HELLO: HELLO,
    MessageType.SAMPLES: SAMPLES,
    MessageType.ENVIRONMENT: ENVIRONMENT,
    MessageType.HUB_STATUS: HUB_STATUS,
    MessageType.TIME_SYNC: TIME_SYNC,
    MessageType.LOG_TEXT: LOG_TEXT,
    MessageType.COMMAND_RESULT: COMMAND_RESULT,
    MessageType.CHALLENGE_ANSWER: CHALLENGE_ANSWER,
    MessageType.SET_STREAM: SET_STREAM,
    MessageType.SET_RATE: SET_RATE,
    MessageType.SET_TIME: SET_TIME,
    MessageType.CHALLENGE: CHALLENGE,
}

PURPOSES: Final[dict[MessageType, str]] = {
    MessageType.HELLO: "identity of the sender and scale of its samples",
    MessageType.SAMPLES: "consecutive samples of one wheel",
    MessageType.ENVIRONMENT: "slow quantities measured at the inner liner",
    MessageType.HUB_STATUS: "health of the hub",
    MessageType.TIME_SYNC: "full count of the hub's clock",
    MessageType.LOG_TEXT: "a line of the hub's log",
    MessageType.COMMAND_RESULT: "the hub's answer to a command; tick_us is the time of execution",
    MessageType.CHALLENGE_ANSWER: "the hub's answer to a challenge",
    MessageType.SET_STREAM: "command: start or stop sending samples",
    MessageType.SET_RATE: "command: sample at another rate",
    MessageType.SET_TIME: "command: the host's time, echoed by TIME_SYNC",
    MessageType.CHALLENGE: "command: prove that the hub is there now; never signed",
}


class WireFrame(NamedTuple):
    """A frame in the units of the wire; `payload` has the fields of its declaration."""

    type: int
    hub: int
    wheel: int
    seq: int
    tick_us: int
    payload: Mapping[str, Any]


def build(frame: WireFrame) -> bytes:
    """Return the bytes of `frame`, laid out by the declaration."""
    return build_raw(PAYLOADS[MessageType(frame.type)].build(dict(frame.payload)), frame)


def build_raw(payload: bytes, frame: WireFrame, *, version: int = wire.VERSION_BYTE, flags: int = 0) -> bytes:
    """Return a frame with the header values of `frame` around any payload."""
    header = frame._asdict() | {"version": version, "flags": flags, "length": len(payload), "payload": payload}
    built: bytes = FRAME.build({"body": {"value": header}})
    return built


def parse_payload(type_: int, payload: bytes) -> dict[str, Any]:
    """Return the fields of a payload.

    Raises:
        construct.ConstructError: the payload breaks its layout.
    """
    fields = PAYLOADS[MessageType(type_)].parse(payload)
    return {name: list(value) if isinstance(value, list) else value for name, value in fields.items() if name != "_io"}


def to_message(type_: int, fields: Mapping[str, Any]) -> Message:
    """Return the message that the fields of a payload stand for."""
    values: dict[str, Any]
    match MessageType(type_):
        case MessageType.HELLO:
            values = {name: tuple(v) if isinstance(v, list) else v for name, v in fields.items()}
            firmware = tuple(values.pop(f"firmware_{part}") for part in ("major", "minor", "patch"))
            return Hello(**values | {"firmware": firmware, "coupling": Coupling(values["coupling"])})
        case MessageType.SAMPLES:
            counts = np.array(fields["counts"], "<i2").reshape(fields["n"], -1)
            return SampleBlock(fields["first_sample"], fields["axes"], counts)
        case MessageType.ENVIRONMENT:
            return Environment(
                _physical(fields["pressure_pa"], 1, wire.NONE_I32),
                _physical(fields["temperature_cdegc"], 100, wire.NONE_I16),
                _physical(fields["supply_mv"], 1000, wire.NONE_U16),
            )
        case MessageType.HUB_STATUS:
            values = dict(fields)
            supply_w, supply_v = values.pop("supply_uw") / 1_000_000, values.pop("supply_mv") / 1000
            for name, none in (("battery_percent", wire.NONE_U8), ("rssi_dbm", wire.NONE_I8)):
                values[name] = None if values[name] == none else values[name]
            return HubStatus(**values, supply_w=supply_w, supply_v=supply_v)
        case MessageType.TIME_SYNC:
            return TimeSync(**fields)
        case MessageType.LOG_TEXT:
            return LogText(fields["level"], fields["text"].decode(errors="replace"))
        case MessageType.COMMAND_RESULT:
            return CommandResult(**fields)
        case MessageType.CHALLENGE_ANSWER:
            return ChallengeAnswer(**fields)
        case MessageType.SET_STREAM:
            return SetStream(bool(fields["running"]))
        case MessageType.SET_RATE:
            return SetRate(**fields)
        case MessageType.SET_TIME:
            return SetTime(**fields)
        case MessageType.CHALLENGE:
            return Challenge(**fields)


def to_frame(frame: WireFrame) -> Frame:
    """Return the frame that a wire frame stands for."""
    return Frame(*frame[:5], to_message(frame.type, frame.payload))


def _physical(value: int, per_unit: int, none: int) -> float | None:
    return None if value == none else value / per_unit
