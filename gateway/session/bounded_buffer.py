"""A bounded hand-over between two threads: full means full, nobody waits unless he asks to."""

from __future__ import annotations

import threading
from collections import deque
from typing import Final, Generic, TypeVar

Item = TypeVar("Item")

# What an item takes beside its bytes, generously.
_ITEM_BYTES: Final = 256


class Buffer(Generic[Item]):
    """Items in order, bounded in number and in bytes, so that memory is bounded whatever the size of the items.

    Attributes:
        dropped: items that were refused because it was full and nobody waited.
    """

    def __init__(self, most_items: int, most_bytes: int) -> None:
        """Hold at most so many items and so many bytes."""
        self.dropped = 0
        self._most_items = most_items
        self._most_bytes = most_bytes
        self._items: deque[tuple[Item, int]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()

    def __len__(self) -> int:
        """Return the number of items waiting."""
        return len(self._items)

    @property
    def filled(self) -> float:
        """Share of the room that is taken, 0 to 1."""
        return max(len(self._items) / self._most_items, self._bytes / self._most_bytes)

    def put(self, item: Item, size: int, *, timeout_s: float = 0.0, below: float = 1.0, wake: bool = True) -> bool:
        """Append an item; return False when there is no room for it.

        Args:
            item: what to hand over.
            size: its bytes.
            timeout_s: wait so long for room; with 0 a refused item counts as dropped.
            below: refuse when more than this share of the room is taken: items of less worth leave room for others.
            wake: wake a waiting `get`; without it the item is found at the next look.
        """
        cost = size + _ITEM_BYTES
        with self._changed:
            if self._is_full(cost, below) and not (
                timeout_s > 0.0 and self._changed.wait_for(lambda: not self._is_full(cost, below), timeout_s)
            ):
                self.dropped += timeout_s <= 0.0
                return False
            self._items.append((item, cost))
            self._bytes += cost
            if wake:
                self._changed.notify_all()
            return True

    def get(self, timeout_s: float = 0.0) -> Item | None:
        """Take the oldest item; None when none comes within `timeout_s`."""
        with self._changed:
            if not self._items and (timeout_s <= 0.0 or not self._changed.wait_for(lambda: self._items, timeout_s)):
                return None
            item, cost = self._items.popleft()
            self._bytes -= cost
            self._changed.notify_all()
            return item

    def _is_full(self, cost: int, below: float) -> bool:
        # One item always fits, however big.
        return bool(self._items) and (
            len(self._items) >= self._most_items * below or self._bytes + cost > self._most_bytes * below
        )
