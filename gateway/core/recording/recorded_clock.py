"""What a recording says of its own times."""

from typing import Final

from gateway.core.links.nmea_sentences import ReceiverClock, SentenceReader
from gateway.core.links.reasons import LinkCode
from gateway.core.links.source import LinkEvent, Sentences, VehicleData
from gateway.core.reasons import Reason

_CLOCK_CHANGES: Final = frozenset({LinkCode.SYSTEM_TIME_SET, LinkCode.SYSTEM_TIME_SLEWED})


class RecordedClock:
    """What a recording says of its own times, from its events and the sentences of a positioning receiver.

    A receiver counts more than a step of the system time, which may have set it from wrong to wrong.
    """

    def __init__(self) -> None:
        """Start without an item."""
        self.set: Reason | None = None
        """The last change of the system time."""
        self._sentences, self._receiver = SentenceReader(), ReceiverClock()

    def take(self, item: VehicleData | LinkEvent) -> None:
        """Take an item, in the order of the recording."""
        if isinstance(item, Sentences):
            for fix in self._sentences.read(item.data):
                self._receiver.take(fix, item.host_ns)
        elif isinstance(item, LinkEvent):
            self.set = next((detail for detail in item.details if ahead_of_step_s(detail) is not None), self.set)

    @property
    def ahead_s(self) -> float | None:
        """What is to be added to its times, in s: 0 if a receiver agrees, None if nothing is said."""
        if self._receiver.has_time:
            return self._receiver.ahead_s or 0.0
        return (ahead_of_step_s(self.set) or None) if self.set is not None else None


def ahead_of_step_s(detail: Reason) -> float | None:
    """Return what a change of the system time adds to the times of the recording, None of other details."""
    value = detail["ahead_s"] if detail.code in _CLOCK_CHANGES else None
    return value if isinstance(value, float) else None
