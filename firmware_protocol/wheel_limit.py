"""Limit on the wheels of a session, since anyone who can send frames can make up 65,280 wheels a link."""

from collections.abc import Collection
from typing import Final

from firmware_protocol.messages import HUB_ITSELF

MOST_WHEELS: Final = 64
"""Wheels that a session takes; the longest road trains have fewer."""


class WheelLimit:
    """Admission of wheels: configured ones always, others in the order of their first frames while there is room."""

    def __init__(self, configured: Collection[tuple[int, int]] = ()) -> None:
        """Reserve places.

        Args:
            configured: (hub, wheel) of wheels that are always admitted, on the first link that has them.
        """
        self._configured = frozenset(configured)
        self._owners: dict[tuple[int, int], str] = {}
        self._room = MOST_WHEELS - len(self._configured)
        self._admitted: set[tuple[str, int, int]] = set()
        self._refused: set[tuple[str, int, int]] = set()

    @property
    def refused(self) -> int:
        """Number of different wheels refused so far."""
        return len(self._refused)

    def admits(self, link: str, hub: int, wheel: int) -> bool:
        """Return whether a source has a place: hubs always, a new wheel as long as there is room."""
        source = link, hub, wheel
        if wheel == HUB_ITSELF or source in self._admitted:
            return True
        if (hub, wheel) in self._configured and self._owners.setdefault((hub, wheel), link) == link:
            self._admitted.add(source)
            return True
        if self._room > 0:
            self._room -= 1
            self._admitted.add(source)
            return True
        self._refused.add(source)
        return False
