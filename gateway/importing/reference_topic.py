"""Measured references in recordings: to compare estimates with, and channels of a rig that vary."""

import json
import math
import re
from dataclasses import dataclass, field
from typing import Any, Final

from gateway.core.recording.mcap_layout import RecordedMessage
from gateway.core.recording.reader import RecordingReader

_TOPIC: Final = re.compile(r"/wheel/([^/]+)/reference/([^/]+)")
_QUANTITIES: Final = ("speed", "rotation", "angle", "pulses", "load", "side_force", "slip_angle", "camber", "torque")
_MAX_VALUES: Final = 10_000_000
_MAX_REFERENCES: Final = 256


@dataclass(slots=True)
class RecordedReference:
    """One reference of one wheel.

    Attributes:
        position: wheel position.
        name: name of the reference.
        quantity: as in an import map.
        value_std: one standard error of a value.
        times_s: hub times.
        values: in m/s, turns per second, turns so far, N, rad or N*m.
    """

    position: str
    name: str
    quantity: str
    value_std: float = 0.0
    times_s: list[float] = field(default_factory=list)
    values: list[float] = field(default_factory=list)


def reference_topic(position: str, name: str) -> str:
    """Return the topic of a reference."""
    return f"/wheel/{position}/reference/{name}"


class RecordedReferences:
    """References of a recording, collected while its items are read."""

    def __init__(self, reader: RecordingReader) -> None:
        """Watch a reader that begins its pass next."""
        self._references: dict[str, RecordedReference] = {}
        self._count = 0
        reader.watch(self._watch)

    def references(self) -> tuple[RecordedReference, ...]:
        """Return the references in order of appearance, complete after the last item."""
        return tuple(self._references.values())

    def _watch(self, message: RecordedMessage) -> None:
        match = _TOPIC.fullmatch(message.channel.topic)
        if match is not None and self._count < _MAX_VALUES:
            self._take(message, match[1], match[2])

    def _take(self, message: RecordedMessage, position: str, name: str) -> None:
        topic = message.channel.topic
        try:
            content: Any = json.loads(message.data)
            quantity, std = content["quantity"], content.get("value_std", 0.0)
            numbers = [float(number) for number in (content["time_s"], content["value"], std)]
        except (ValueError, TypeError, KeyError, AttributeError, OverflowError, RecursionError):
            # A damaged message; the others are still worth comparing.
            return
        if quantity not in _QUANTITIES or not all(map(math.isfinite, numbers)):
            return
        if topic not in self._references:
            if len(self._references) >= _MAX_REFERENCES:
                return
            self._references[topic] = RecordedReference(position, name, quantity, numbers[2])
        self._count += 1
        self._references[topic].times_s.append(numbers[0])
        self._references[topic].values.append(numbers[1])
