"""How late what arrives is taken by a computer that is too slow, before anything is dropped."""

from typing import Final

# A driver takes a number that is older for the present one.
_LATE_NS: Final = 3_000_000_000
# A pause of this computer, or a page of a disk that spins up, is made up for within this time.
_LASTING_NS: Final = 5_000_000_000


class LatenessWatch:
    """Watches the time between the arrival of items and their turn."""

    def __init__(self) -> None:
        """Start in time."""
        self._late_since_ns: int | None = None
        self._is_reported = False

    def take(self, arrived_ns: int, now_ns: int) -> float | None:
        """Take an item.

        Args:
            arrived_ns: time of its arrival.
            now_ns: time of its turn, by the same clock.

        Returns:
            How late it is, in s, once where items have been late for long; None otherwise.
        """
        if now_ns - arrived_ns < _LATE_NS:
            self._late_since_ns, self._is_reported = None, False
            return None
        if self._late_since_ns is None:
            self._late_since_ns = now_ns
        if self._is_reported or now_ns - self._late_since_ns < _LASTING_NS:
            return None
        self._is_reported = True
        return (now_ns - arrived_ns) * 1e-9
