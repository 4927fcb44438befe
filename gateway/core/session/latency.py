"""Latency of results in a session: how long bytes, chunks and revolutions wait to be worked on with the next ones."""

from dataclasses import dataclass
from typing import Final

from gateway.core.constants import LONGEST_LATENCY_S

# A link is read this often at most: a smaller chunk costs as much as a larger one.
_MIN_READ_S: Final = 0.004
_MAX_READ_S: Final = 0.02
_MAX_ROUND_S: Final = 0.1
# Shares of the latency. The rest is for the work.
_READ_SHARE: Final = 0.12
_ROUND_SHARE: Final = 0.12
_GATHER_SHARE: Final = 0.06
_HOLD_SHARE: Final = 0.56
# A session that is late by less is in time: a pause of the system's scheduler is shorter.
_LATE_S: Final = 0.1


@dataclass(frozen=True, slots=True)
class Latency:
    """Longest waits of a session by choice, from the last byte of a revolution to its result.

    Attributes:
        longest_s: of a result by choice; with 0, results come as soon as they can.
    """

    longest_s: float

    def while_late(self, late_s: float) -> "Latency":
        """Return the latency of a session that is late by so much.

        Its results come no later by waiting as long, and take less work, so that it catches up.
        """
        steps = int(late_s / _LATE_S)
        return Latency(min(max(self.longest_s, steps * _LATE_S), LONGEST_LATENCY_S)) if steps else self

    @property
    def read_s(self) -> float:
        """Time between two reads of a link, s."""
        return min(max(_READ_SHARE * self.longest_s, _MIN_READ_S), _MAX_READ_S)

    @property
    def round_s(self) -> float:
        """Longest time that chunks wait for the next ones, s; 0 where each is taken at once."""
        return min(_ROUND_SHARE * self.longest_s, _MAX_ROUND_S)

    @property
    def gather_s(self) -> float:
        """Longest time that frames wait for the next ones, s; 0 where they wait until something can be decided."""
        return _GATHER_SHARE * self.longest_s

    @property
    def hold_s(self) -> float:
        """Longest time that a revolution waits for the next ones, s."""
        return _HOLD_SHARE * self.longest_s
