"""Latency of results in a session: how long bytes, chunks and revolutions wait to be worked on with the next ones."""

from dataclasses import dataclass
from typing import Final

# A link is read this often at most: a smaller chunk costs as much as a larger one.
_LEAST_READ_S: Final = 0.004
_MOST_READ_S: Final = 0.02
_MOST_ROUND_S: Final = 0.1
# Shares of the latency. The rest is for the wheels that are due together, one of which is worked on with each chunk.
_READ_SHARE: Final = 0.12
_ROUND_SHARE: Final = 0.12
_HOLD_SHARE: Final = 0.5


@dataclass(frozen=True, slots=True)
class Latency:
    """Longest waits of a session by choice, from the last byte of a revolution to its result.

    Attributes:
        longest_s: of a result by choice; with 0, results come as soon as they can.
    """

    longest_s: float

    @property
    def read_s(self) -> float:
        """Time between two reads of a link, s."""
        return min(max(_READ_SHARE * self.longest_s, _LEAST_READ_S), _MOST_READ_S)

    @property
    def round_s(self) -> float:
        """Longest time that chunks wait for the next ones, s; 0 where each is taken at once."""
        return min(_ROUND_SHARE * self.longest_s, _MOST_ROUND_S)

    @property
    def hold_s(self) -> float:
        """Longest time that a revolution waits for the next ones, s."""
        return _HOLD_SHARE * self.longest_s
