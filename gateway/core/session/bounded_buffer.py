"""A bounded buffer between two threads; `put` does not block unless given a timeout."""

import threading
from collections import deque
from typing import Final, Generic, TypeVar

Item = TypeVar("Item")

# Memory of an item besides its bytes, with a margin.
_ITEM_BYTES: Final = 256


class Buffer(Generic[Item]):
    """Items in order, bounded in number and in bytes, so that large items do not exhaust memory.

    Attributes:
        dropped: items refused because the buffer was full and no timeout was given.
    """

    def __init__(self, max_items: int, max_bytes: int) -> None:
        """Hold at most this many items and bytes."""
        self.dropped = 0
        self._max_items = max_items
        self._max_bytes = max_bytes
        self._items: deque[tuple[Item, int]] = deque()
        self._bytes = 0
        self._changed = threading.Condition()

    def __len__(self) -> int:
        """Return the number of items waiting."""
        return len(self._items)

    def put(self, item: Item, size: int, *, timeout_s: float = 0.0, below: float = 1.0, wake: bool = True) -> bool:
        """Append an item; return False when there is no room.

        Args:
            item: to append.
            size: of the item in bytes.
            timeout_s: time to wait for room; with 0 a refused item counts as dropped.
            below: refuse above this share of the capacity, so that less important items leave room for others.
            wake: wake a waiting `get`; without it the next call finds the item.
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
        """Return the oldest item, None when none arrives within `timeout_s`."""
        with self._changed:
            if not self._items and (timeout_s <= 0.0 or not self._changed.wait_for(lambda: self._items, timeout_s)):
                return None
            item, cost = self._items.popleft()
            self._bytes -= cost
            self._changed.notify_all()
            return item

    def _is_full(self, cost: int, below: float) -> bool:
        # A single item always fits, whatever its size.
        return bool(self._items) and (
            len(self._items) >= self._max_items * below or self._bytes + cost > self._max_bytes * below
        )
