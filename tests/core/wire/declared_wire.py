"""The declared payloads in another reading: parsed with `construct`, and turned into messages by hand.

The codec is held byte for byte and refusal for refusal against this.
"""

from collections.abc import Mapping
from typing import Any

import construct as c
import numpy as np

from firmware_protocol import messages, wire
from firmware_protocol.declaration import PAYLOADS
from firmware_protocol.layout import Field
from firmware_protocol.messages import Frame, Message, MessageType
from firmware_protocol.reference_frames import WireFrame, number, struct_of


def limited(field: Field) -> Any:
    def is_valid(value: float, _: Any) -> bool:
        is_low = field.low is not None and not value >= field.low
        is_high = field.high is not None and not value <= field.high
        return value == field.none or not (is_low or is_high)

    return c.ExprValidator(number(field), is_valid)


STRUCTS = {type_: struct_of(payload.fields, c.Terminated, element=limited) for type_, payload in PAYLOADS.items()}


def parse_payload(type_: int, payload: bytes) -> dict[str, Any]:
    fields = STRUCTS[MessageType(type_)].parse(payload)
    return {name: list(value) if isinstance(value, list) else value for name, value in fields.items() if name != "_io"}


def to_message(type_: int, fields: Mapping[str, Any]) -> Message:
    """Return the message that the fields of a payload stand for, in units and types by hand."""
    values: dict[str, Any]
    match MessageType(type_):
        case MessageType.HELLO:
            values = {name: tuple(v) if isinstance(v, list) else v for name, v in fields.items()}
            firmware = tuple(values.pop(f"firmware_{part}") for part in ("major", "minor", "patch"))
            return messages.Hello(**values | {"firmware": firmware, "coupling": messages.Coupling(values["coupling"])})
        case MessageType.SAMPLES:
            counts = np.array(fields["counts"], "<i2").reshape(fields["n"], -1)
            return messages.SampleBlock(fields["first_sample"], fields["axes"], counts)
        case MessageType.ENVIRONMENT:
            return messages.Environment(
                _physical(fields["pressure_pa"], 1, wire.NONE_I32),
                _physical(fields["temperature_cdegc"], 100, wire.NONE_I16),
                _physical(fields["supply_mv"], 1000, wire.NONE_U16),
            )
        case MessageType.HUB_STATUS:
            values = dict(fields)
            supply_w, supply_v = values.pop("supply_uw") / 1_000_000, values.pop("supply_mv") / 1000
            for name, none in (("battery_percent", wire.NONE_U8), ("rssi_dbm", wire.NONE_I8)):
                values[name] = None if values[name] == none else values[name]
            return messages.HubStatus(**values, supply_w=supply_w, supply_v=supply_v)
        case MessageType.TIME_SYNC:
            return messages.TimeSync(**fields)
        case MessageType.LOG_TEXT:
            return messages.LogText(fields["level"], fields["text"].decode(errors="replace"))
        case MessageType.COMMAND_RESULT:
            return messages.CommandResult(**fields)
        case MessageType.CHALLENGE_ANSWER:
            return messages.ChallengeAnswer(**fields)
        case MessageType.SET_STREAM:
            return messages.SetStream(bool(fields["running"]))
        case MessageType.SET_RATE:
            return messages.SetRate(**fields)
        case MessageType.SET_TIME:
            return messages.SetTime(**fields)
        case MessageType.CHALLENGE:
            return messages.Challenge(**fields)


def to_frame(frame: WireFrame) -> Frame:
    """Return the frame that a wire frame stands for."""
    return Frame(*frame[:5], to_message(frame.type, frame.payload))


def _physical(value: int, per_unit: int, none: int) -> float | None:
    return None if value == none else value / per_unit
