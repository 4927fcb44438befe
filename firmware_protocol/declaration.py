"""Declaration of the payloads: all code that reads or writes them follows from it, as do the specification's tables.

Field names and units are those of the wire; `attribute`, `per_unit` and `kind` relate them to the values in
`messages.py`. `wire.py` declares the header.
"""

from typing import Any, Final

from firmware_protocol import wire
from firmware_protocol.checks import MAX_F32
from firmware_protocol.layout import Field, Layout
from firmware_protocol.messages import (
    Challenge,
    ChallengeAnswer,
    CommandResult,
    Coupling,
    Environment,
    Hello,
    HubStatus,
    LogText,
    MessageType,
    SampleBlock,
    SetRate,
    SetStream,
    SetTime,
    TimeSync,
)


class Payload(Layout):
    """Layout of the payloads of one type.

    Attributes:
        type: type byte of the frame.
        message: class of the values.
        purpose: of the message.
    """

    def __init__(self, type_: MessageType, message: Any, purpose: str, *fields: Field) -> None:
        super().__init__(*fields)
        self.type, self.message, self.purpose = type_, message, purpose


def _real(name: str, docs: str, low: float = -MAX_F32, high: float = MAX_F32, elements: int = 1) -> Field:
    return Field(name, "f", docs, low, high, elements=elements)


def _axes(docs: str) -> Field:
    return Field("axes", "B", docs, 1, wire.ALL_AXES)


_DECLARED: Final = (
    Payload(
        MessageType.HELLO,
        Hello,
        "identity of the sender and scale of its samples",
        Field("protocol_major", "B", "major protocol version of the firmware"),
        Field("protocol_minor", "B", "minor protocol version of the firmware"),
        Field("firmware_major", "B", "version of the firmware, for display", attribute="firmware"),
        Field("firmware_minor", "B", attribute="firmware"),
        Field("firmware_patch", "H", attribute="firmware"),
        _axes("axis mask: bit 0 circumferential, 1 lateral, 2 radial"),
        Field("coupling", "B", "0 DC, 1 AC", min(Coupling), max(Coupling), kind=Coupling),
        Field("hub_id", "Q", "serial number of the hub"),
        Field("sensor_id", "I", "serial number of the sensor"),
        Field("boot_count", "I", "number of starts of the hub"),
        _real("rate_hz", "sampling rate in Hz", wire.MIN_RATE_HZ, wire.MAX_RATE_HZ),
        _real("highpass_hz", "corner of the AC coupling in Hz, 0 when DC or not known", 0.0),
        _real("range_mps2", "full scale in m/s² of axes 0, 1, 2; 0 where absent or not known", 0.0, elements=3),
        _real(
            "scale_mps2",
            "m/s² per count, not 0 on a present axis; its sign turns the axis into the protocol's direction",
            elements=3,
        ),
        _real("offset_counts", "counts at zero acceleration", elements=3),
        Field(
            "saturation_counts",
            "H",
            "abs(count) at or above which a sample is saturated",
            1,
            wire.MAX_SATURATION_COUNTS,
        ),
    ),
    Payload(
        MessageType.SAMPLES,
        SampleBlock,
        "consecutive samples of one wheel",
        Field("first_sample", "I", "running number of the first sample, wraps; includes samples never sent"),
        _axes("axis mask"),
        Field("n", "B", "samples in this block; 109, 54 or 36 fit with 1, 2 or 3 axes", 1, wire.MAX_SAMPLES),
        Field(
            "counts",
            "h",
            "n rows, each the channels of one sample in ascending bit order of the axis mask",
            elements=None,
        ),
    ),
    Payload(
        MessageType.ENVIRONMENT,
        Environment,
        "slow quantities measured at the inner liner",
        Field("pressure_pa", "i", "inflation pressure above ambient in Pa", none=wire.NONE_I32, per_unit=1),
        Field(
            "temperature_cdegc",
            "h",
            "inner liner in 0.01 °C",
            none=wire.NONE_I16,
            attribute="temperature_degc",
            per_unit=100,
        ),
        Field("supply_mv", "H", "supply of the sensor in mV", none=wire.NONE_U16, attribute="supply_v", per_unit=1000),
    ),
    Payload(
        MessageType.HUB_STATUS,
        HubStatus,
        "health of the hub",
        Field("uptime_s", "I", "s since the hub's start"),
        Field("frames_sent", "I", "frames handed to the link, wraps"),
        Field("frames_dropped", "I", "frames the hub could not send, wraps"),
        Field("samples_dropped", "I", "samples the hub could not send, wraps"),
        Field("link_retries", "I", "retransmissions on the sensor link, wraps"),
        Field("supply_uw", "I", "supply power of the hub in µW", attribute="supply_w", per_unit=1_000_000),
        Field("supply_mv", "H", "supply voltage of the hub in mV", attribute="supply_v", per_unit=1000),
        Field("battery_percent", "B", "state of charge in %", 0, wire.MAX_BATTERY_PERCENT, wire.NONE_U8),
        Field("rssi_dbm", "b", "signal strength of the sensor link in dBm", none=wire.NONE_I8),
    ),
    Payload(
        MessageType.TIME_SYNC,
        TimeSync,
        "full count of the hub's clock",
        Field("hub_us", "Q", "µs since the hub's start; its low 32 bits are the frame's tick_us"),
        Field("host_ns", "Q", "latest host time received by the hub, ns since 1970; 0 when none"),
    ),
    Payload(
        MessageType.LOG_TEXT,
        LogText,
        "a line of the hub's log",
        Field("level", "B", "0 debug, 1 info, 2 warning, 3 error; others reserved"),
        Field("text", "s", "one line of UTF-8, not terminated", elements=None),
    ),
    Payload(
        MessageType.COMMAND_RESULT,
        CommandResult,
        "the hub's answer to a command; tick_us is the time of execution",
        Field("seq", "I", "seq of the command's frame; with outcome 5, the highest accepted seq"),
        Field("command", "B", "type of the command"),
        Field("outcome", "B", "0 done, 1 unknown command, 2 value refused, 3 failed, 4 not verified, 5 repeated"),
    ),
    Payload(
        MessageType.CHALLENGE_ANSWER,
        ChallengeAnswer,
        "the hub's answer to a challenge",
        Field("nonce", "Q", "nonce of the challenge"),
        Field("boot_count", "I", "the hub's present start; the tag is under it"),
        Field("highest_seq", "I", "highest accepted seq under the hub's key in this start, 0 before the first"),
    ),
    Payload(
        MessageType.SET_STREAM,
        SetStream,
        "command: start or stop sending samples",
        Field("running", "B", "1: send samples, 0: send none; all other messages continue", 0, 1, kind=bool),
    ),
    Payload(
        MessageType.SET_RATE,
        SetRate,
        "command: sample at another rate",
        _real(
            "rate_hz",
            "requested sampling rate in Hz; the sensor takes the nearest that it supports",
            wire.MIN_RATE_HZ,
            wire.MAX_RATE_HZ,
        ),
    ),
    Payload(
        MessageType.SET_TIME,
        SetTime,
        "command: the host's time, echoed by TIME_SYNC",
        Field("host_ns", "Q", "host time, ns since 1970"),
    ),
    Payload(
        MessageType.CHALLENGE,
        Challenge,
        "command: prove that the hub is there now; never signed",
        Field("nonce", "Q", "random number, never used before"),
    ),
)

PAYLOADS: Final = {payload.type: payload for payload in _DECLARED}
SAMPLES: Final = PAYLOADS[MessageType.SAMPLES]
SAMPLES_FRAME: Final = Layout(*wire.HEADER.fields, *SAMPLES.fields)
"""Header and payload of a sample frame."""
SAMPLES_WORD: Final = int.from_bytes(wire.SYNC + bytes((wire.VERSION_BYTE, MessageType.SAMPLES)), "little")
"""Sync, version and type of a sample frame as one number."""
